//! One motion in front of all first links, one behind all last ones: stated once, with what links deviate beside it.

mod support;

use gough::calibration::{Calibration, Coordinates, Sample};
use gough::files::{DataPlaces, read_problem};
use gough::identify::{Mounts, identify};
use gough::lie::{Se3, se3, se3::Twist, so3};
use gough::measure::Pose;
use gough::model::mechanism::pose_difference;
use gough::model::{Ends, Mechanism, Prior, Tolerance};
use gough::problem::{Form, Problem, check};
use gough::simulate::{close, draw_deviations, draw_postures};
use gough::solve::{Stop, minimal::Minimal};
use nalgebra::{Matrix6, Vector3, Vector6};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use support::{file, gough, json as read, write};

const FREE: Tolerance = Tolerance { angle: Prior::Free, length: Prior::Free };
const HELD: Tolerance = Tolerance { angle: Prior::Held, length: Prior::Held };

fn case(name: &str) -> PathBuf {
    file("tests/data/cases/setup").join(name)
}

/// The case with its base links stated to the general tolerance, and one free placement instead.
fn placed(name: &str, folder: &Path) -> PathBuf {
    let mut problem = read(&case(name));
    for limb in problem["mechanism"]["limbs"].as_array_mut().unwrap() {
        limb["joints"][0].as_object_mut().unwrap().remove("tolerance");
    }
    problem["mechanism"]["placement"] = json!("free");
    problem["data"]["file"] = json!(case(problem["data"]["file"].as_str().unwrap()));
    write(folder, name, &problem)
}

fn identified(problem: &Path, folder: &Path, more: &str) -> Value {
    let out = folder.join("result.json");
    let ran = gough(&format!("identify {{0}} -o {{1}} {more}"), &[problem, &out]);
    assert!(ran.status < 2, "{ran:?}");
    read(&out)
}

fn size(v: &Value) -> f64 {
    v.as_array().unwrap().iter().map(|v| v.as_f64().unwrap().powi(2)).sum::<f64>().sqrt()
}

/// How far each base joint is beside the placement, mm.
fn base_points(result: &Value) -> Vec<(String, f64)> {
    let links = result["links"].as_array().unwrap().iter().filter(|link| link["link"] == "base.1");
    links.map(|l| (l["limb"].as_str().unwrap().to_owned(), size(&l["beside"]["translation"]))).collect()
}

/// A point of the base drawn 63 mm off is seen where it is, whether base links are free or stated beside a free placement.
#[test]
fn a_typo_of_the_drawing_is_seen_where_it_is() {
    let folder = tempfile::tempdir().unwrap();
    let result = identified(&case("o_tracker_point_typo.json"), folder.path(), "");
    let place = &result["placement"];
    let stood = [2500.0, -800.0, 300.0];
    let apart = |i: usize, v: f64| (v - stood[i]).abs();
    assert!((0..3).all(|i| apart(i, place["position"][i].as_f64().unwrap()) < 1.0), "{place}");
    assert!(size(&place["std"]["translation"]) < 1.0 && size(&place["std"]["translation"]) > 1e-4, "{place}");
    for (limb, off) in base_points(&result) {
        match limb.as_str() {
            "limb3" => assert!((off - 63.0).abs() < 6.0, "{limb} {off}"),
            _ => assert!(off < 6.0, "{limb} {off}"),
        }
    }
    let out = folder.path().join("result.json");
    let table = gough("export {0} --format csv", &[&out]);
    let rows: Vec<Vec<&str>> = table.stdout.lines().skip(1).map(|line| line.split(',').collect()).collect();
    let number = |row: &[&str], k: usize| row[k].parse::<f64>().unwrap();
    let length = |row: &[&str]| (5..8).map(|k| number(row, k).powi(2)).sum::<f64>().sqrt();
    let placements: Vec<_> = rows.iter().filter(|row| row[1] == "placement").collect();
    assert_eq!(placements.len(), 1, "{}", table.stdout);
    assert!((0..3).all(|i| apart(i, number(placements[0], 5 + i)) < 1.0), "{}", table.stdout);
    assert!(number(placements[0], 11) > 0.0);
    let far = rows.iter().filter(|row| row[1] == "base.1" && length(row) > 6.0);
    assert_eq!(far.map(|row| row[0]).collect::<Vec<_>>(), ["limb3"]);
}

/// A hexapod that stands as drawn: a placement that is free is found where the drawing has it, and its base joints deviate as
/// they do without one: none of them turns.
#[test]
fn a_machine_that_stands_as_drawn_is_placed_there() {
    let folder = tempfile::tempdir().unwrap();
    let mut problem = read(&placed("n_ok_free.json", folder.path()));
    let with = identified(&write(folder.path(), "with.json", &problem), folder.path(), "");
    problem["mechanism"].as_object_mut().unwrap().remove("placement");
    let without = identified(&write(folder.path(), "without.json", &problem), folder.path(), "");
    let place = &with["placement"];
    for (value, std) in [("position", "translation"), ("rotation", "rotation")] {
        for i in 0..3 {
            let (value, std) = (place[value][i].as_f64().unwrap(), place["std"][std][i].as_f64().unwrap());
            assert!(value.abs() < 2.0 * std, "{place}");
        }
    }
    let bases = |result: &Value| -> Vec<Value> {
        let links = result["links"].as_array().unwrap().iter();
        links.filter(|link| link["link"] == "base.1").cloned().collect()
    };
    for (with, without) in bases(&with).iter().zip(&bases(&without)) {
        // Tolerances are 0.05 deg and 0.5 mm.
        for (part, tolerance) in [("rotation", 0.05), ("translation", 0.5)] {
            for i in 0..3 {
                let a = with["beside"][part][i].as_f64().unwrap();
                let b = without["deviation"][part][i].as_f64().unwrap();
                assert!(
                    (a - b).abs() < if i < 2 || part == "rotation" { 0.4 } else { 0.5 } * tolerance,
                    "{with} {without}"
                );
            }
        }
    }
}

/// A true machine stands and carries its tool within the tolerances of placement and mounting, each component of its own;
/// its links are those without them.
#[test]
fn placement_and_mounting_are_drawn_from_their_tolerances() {
    let plain = problem("tripod-3prs.json");
    let tolerance = |angle, length| Tolerance { angle: Prior::Sigma(angle), length: Prior::Sigma(length) };
    let mut machine = plain.clone();
    machine.ends =
        Ends { placement: Some(tolerance(0.02, 0.03)), tool_mounting: Some(tolerance(0.01, 0.005)) };
    let (mut square, count) = ([0.0_f64; 12], 400);
    for seed in 0..count {
        let own = plain.deviated(&draw_deviations(&plain, seed, 1.0));
        let whole = plain.deviated(&draw_deviations(&machine, seed, 1.0));
        let mut motions = Vec::new();
        for (own, whole) in own.limbs.iter().zip(&whole.limbs) {
            let (first, last) = (0, own.len() - 1);
            let x = whole[first] * own[first].inverse();
            let y = own[last].inverse() * whole[last];
            for k in 1..last {
                assert!((whole[k].p - own[k].p).norm() < 1e-12);
            }
            motions.push((x, y));
        }
        // One motion for all limbs.
        for (x, y) in &motions {
            let (w, p) = pose_difference(x, &motions[0].0);
            let (v, q) = pose_difference(y, &motions[0].1);
            assert!(w.norm() + p.norm() + v.norm() + q.norm() < 1e-12);
        }
        let both = [se3::log(&motions[0].0), se3::log(&motions[0].1)];
        for (sum, value) in square.iter_mut().zip(both.iter().flat_map(|twist| twist.iter())) {
            *sum += value * value;
        }
    }
    for (i, sum) in square.iter().enumerate() {
        let sigma = [0.02, 0.03, 0.01, 0.005][i / 3];
        let ratio = (sum / count as f64).sqrt() / sigma;
        assert!((0.88..1.12).contains(&ratio), "{i} {ratio}");
    }
    // What is free stays as drawn.
    machine.ends = Ends { placement: Some(FREE), tool_mounting: Some(HELD) };
    let (a, b) = (draw_deviations(&plain, 5, 1.0), draw_deviations(&machine, 5, 1.0));
    assert!(a.iter().zip(&b).all(|(a, b)| (a - b).abs() < 1e-15));
}

/// What an instrument anywhere says of links is what the same data in the machine's frame say.
#[test]
fn links_beside_a_placement_do_not_depend_on_where_the_instrument_is() {
    let folder = tempfile::tempdir().unwrap();
    let found =
        |name: &str| identified(&placed(name, folder.path()), folder.path(), "--holdout 0.25 --seed 1");
    let (away, own) = (found("c_free_quat.json"), found("n_ok_free.json"));
    assert_eq!(away["counts"], own["counts"]);
    assert_eq!(away["counts"]["structural"], 138);
    for (a, b) in away["links"].as_array().unwrap().iter().zip(own["links"].as_array().unwrap()) {
        let value = |link: &Value, part: &str, i: usize| {
            let own = if link["beside"].is_null() { &link["deviation"] } else { &link["beside"] };
            own[part][i].as_f64().unwrap()
        };
        for (part, tolerance) in [("rotation", 0.05), ("translation", 0.5)] {
            for i in 0..3 {
                let (a, b) = (value(a, part, i), value(b, part, i));
                assert!((a - b).abs() < 0.02 * tolerance, "{}.{} {part} {a} {b}", a, b);
            }
        }
    }
    let holdout = |result: &Value| result["holdout"]["after"]["weighted_rms"].as_f64().unwrap();
    assert!((holdout(&away) - holdout(&own)).abs() < 0.02 * holdout(&own));
    // The base's own tolerance is worth something: no worse than links that are each free.
    let free = identified(&case("c_free_quat.json"), folder.path(), "--holdout 0.25 --seed 1");
    assert!(holdout(&away) < 1.05 * holdout(&free), "{} {}", holdout(&away), holdout(&free));
}

fn problem(name: &str) -> Mechanism {
    read_problem(&file("problems").join(name), &DataPlaces::from_environment(None)).unwrap().mechanism
}

fn noise() -> Matrix6<f64> {
    Matrix6::from_diagonal(&Vector6::repeat(4e-10))
}

fn samples(
    mechanism: &Mechanism,
    truth: &gough::model::Geometry,
    move_by: (&Se3, &Se3),
    count: usize,
    seed: u64,
) -> Vec<Sample> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let postures = draw_postures(mechanism, &[&mechanism.nominal(), truth], count, seed).unwrap();
    let sample = |(k, actuators): (usize, &Vec<f64>)| {
        let pose = *move_by.0 * close(mechanism, truth, actuators).unwrap().tool() * *move_by.1;
        let mut normal =
            || Vector3::from_fn(|_, _| 2e-5 * Distribution::<f64>::sample(&StandardNormal, &mut rng));
        let measured = Se3 { r: so3::exp(&normal()) * pose.r, p: pose.p + normal() };
        let measurement = Arc::new(Pose::new(measured, [true; 6], &noise()).unwrap());
        Sample { name: format!("sample {}", k + 1), actuators: actuators.clone(), measurement }
    };
    postures.iter().enumerate().map(sample).collect()
}

/// Jacobians by shared motions are those of finite differences, gradients those of the Jacobians, in every form; what is
/// redundant changes no residual; and where nothing is held the structural count is that without the motions.
#[test]
fn shared_motions_are_coordinates_like_others() {
    for name in ["hexapod-6ups.json", "tripod-3prs.json", "serial-puma560.json"] {
        let plain = problem(name);
        let structural = Coordinates::new(&plain, Form::Minimal).count();
        let mut machine = plain.clone();
        machine.ends = Ends { placement: Some(FREE), tool_mounting: Some(FREE) };
        assert_eq!(Coordinates::new(&machine, Form::Minimal).count(), structural, "{name}");
        let truth = plain.deviated(&draw_deviations(&plain, 3, 1.0));
        let measured = samples(&plain, &truth, (&Se3::identity(), &Se3::identity()), 6, 3);
        let zero = vec![0.0; machine.component_count()];
        for form in [Form::Minimal, Form::Complete, Form::Plain] {
            let problem = Calibration::new(&machine, &measured, form, &zero);
            let unit = if form == Form::Plain { 1e-4 } else { 0.3 };
            let x: Vec<f64> = (0..problem.params().len()).map(|i| unit * (1.0 + i as f64).sin()).collect();
            // Free motions have units of 0.1 rad: too far for one unit of each.
            let shrunk = |(x, param): (&f64, &gough::problem::Param)| match form {
                Form::Complete if param.scale > 0.05 => 1e-3 * x,
                _ => *x,
            };
            let mut x: Vec<f64> = x.iter().zip(problem.params()).map(shrunk).collect();
            if form == Form::Minimal {
                x.iter_mut().for_each(|v| *v *= 1e-2);
            }
            let step = if form == Form::Plain { 1e-5 } else { 1e-3 };
            let error = check::jacobian_error(&problem, &x, step).unwrap();
            assert!(error < 1e-7, "{name} {form:?} {error:.1e}");
            let (linear, (_, gradient)) = (problem.linearize(&x).unwrap(), problem.gradient(&x).unwrap());
            let largest = gradient.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
            for (j, by) in gradient.iter().enumerate() {
                let sum: f64 = (0..linear.r.len()).map(|i| linear.jac[(i, j)] * linear.r[i]).sum();
                assert!((sum - by).abs() < 1e-9 * largest, "{name} {form:?} {j} {sum} {by}");
            }
            let null = problem.redundant(&x);
            if form != Form::Minimal {
                assert_eq!(null.ncols(), x.len() - structural, "{name} {form:?}");
            }
            let moved = &linear.jac * &null;
            assert!(moved.norm_max() < 1e-8 * linear.jac.norm_max(), "{name} {form:?}");
            // The way to coordinates and back keeps the machine.
            let d = problem.coordinates().deviations(&x);
            let again = problem.coordinates().deviations(&problem.coordinates().nearest(&d));
            let (one, other) = (machine.deviated(&d), machine.deviated(&again));
            if form == Form::Complete {
                continue;
            }
            for sample in &measured {
                let (a, b) =
                    (close(&machine, &one, &sample.actuators), close(&machine, &other, &sample.actuators));
                let (w, p) = pose_difference(&a.unwrap().tool(), &b.unwrap().tool());
                let moved = x.iter().map(|v| v * v).sum::<f64>().sqrt()
                    * if form == Form::Plain { 1.0 } else { 1e-3 };
                assert!(w.norm() + p.norm() < 2e-2 * moved * moved + 1e-9, "{name} {form:?} {w} {p} {moved}");
            }
        }
        // Held ends leave the six numbers of a motion each, less what a first or last joint's neighbour makes up for.
        for limb in &mut machine.limbs {
            limb.links.first_mut().unwrap().tolerance = HELD;
        }
        let rank = {
            let fixed = Mechanism { ends: Ends::default(), ..machine.clone() };
            let problem = Calibration::new(&machine, &measured, Form::Minimal, &zero);
            let held = Coordinates::new(&fixed, Form::Minimal).count();
            assert!(problem.params().len() <= held + 6, "{name}");
            assert!(problem.params().len() > held, "{name}");
            problem.params().len()
        };
        assert!(rank < structural || plain.limbs.len() == 1, "{name} {rank} {structural}");
    }
}

/// Placement, what is beside it and the tool's mounting sum up to the machine, near where the instrument and the tool are.
#[test]
fn placement_and_what_is_beside_it_sum_up_to_the_machine() {
    for seed in 0..4 {
        let mut machine = problem("hexapod-6ups.json");
        let base = se3::exp(&Twist::from_column_slice(&[0.7, -1.4, 0.4, 1.5, -0.8, 2.2]));
        let tool = se3::exp(&Twist::from_column_slice(&[0.2, 0.5, -1.0, 0.05, -0.02, 0.1]));
        let truth = machine.deviated(&draw_deviations(&machine, seed, 1.0));
        let measured = samples(&machine, &truth, (&base, &tool), 60, seed);
        machine.ends = Ends { placement: Some(FREE), tool_mounting: Some(FREE) };
        let found = identify(&machine, &measured, &Minimal::default(), &Stop::default()).unwrap();
        assert!(found.report.outcome.converged(), "{seed}");
        let mounts = Mounts::of(&machine, &found);
        let (placement, mounting) = (mounts.placement.unwrap(), mounts.tool_mounting.unwrap());
        for (mount, truth) in [(&placement, &base), (&mounting, &tool)] {
            let (w, p) = pose_difference(&mount.pose, truth);
            // Links that are half a millimetre and a milliradian off each have a part of that in common.
            assert!(w.norm() < 1e-2 && p.norm() < 1e-2, "{w} {p}");
            assert!(mount.std.unwrap().iter().all(|std| *std > 1e-7 && *std < 5e-3));
        }
        let links: Vec<_> =
            machine.limbs.iter().flat_map(|limb| limb.links.iter().map(|l| l.nominal)).collect();
        let whole: Vec<Se3> = found.geometry.limbs.concat();
        for (mount, front) in [(&placement, true), (&mounting, false)] {
            for beside in &mount.beside {
                let own = links[beside.link] * se3::exp(&Twist::from_column_slice(&beside.deviation));
                let sum = if front { mount.pose * own } else { own * mount.pose };
                let apart = se3::log(&(whole[beside.link].inverse() * sum));
                // Up to the zero of a passive joint at that end, which is a turn about the last joint's axis.
                let axis = match front {
                    true => Twist::from_column_slice(&[0.0, 0.0, 1.0, 0.0, 0.0, 0.0]),
                    false => se3::adjoint(&whole[beside.link].inverse()) * Vector6::z(),
                };
                let turn = axis * (axis.dot(&apart) / axis.norm_squared());
                assert!((apart - turn).norm() < 1e-9, "{apart} {turn}");
            }
        }
    }
}

/// A column that is named for two joints says what to do.
#[test]
fn a_column_of_several_joints_says_how_to_write_it() {
    let ran = gough("identify {0}", &[&case("delta_6rods.json")]);
    assert!(ran.status == 2 && ran.stderr.contains("copy its column in the table"), "{ran:?}");
    let ran = gough("check {0}", &[&case("delta_6rods_dup.json")]);
    assert!(ran.status < 2, "{ran:?}");
}

/// Positions see joint offsets alone; what the file lets deviate beside them is counted, and the noise explains the rest.
#[test]
fn offsets_from_twelve_positions_are_no_worse_than_the_file_says() {
    let folder = tempfile::tempdir().unwrap();
    let result = identified(&case("12-joint-offsets-only-12-positions.json"), folder.path(), "");
    assert_eq!(result["counts"]["structural"], 16);
    assert!(result["holdout"]["after"]["weighted_rms"].as_f64().unwrap() < 1.0);
}
