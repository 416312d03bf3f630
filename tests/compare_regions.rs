//! The stated uncertainty is the true one: 1,000 simulated calibrations of the PUMA 560.

use gough::compare::campaign::{Campaign, Contestant, Subject};
use gough::compare::execute::execute;
use gough::compare::line::{RunLine, Source};
use gough::compare::tolerance::Tolerance;
use gough::files::{DataPlaces, read_problem};
use gough::solve::registry;
use gough::statistics::middle;
use std::sync::Mutex;

/// Lines of a campaign with `minimal` and `map` on the PUMA.
fn lines(seeds: u64, noises: &[f64]) -> Vec<RunLine> {
    let places = DataPlaces { data_dir: None, shared: "no such folder".into() };
    let problem = read_problem("problems/serial-puma560.json".as_ref(), &places).unwrap();
    let campaign = Campaign {
        subjects: vec![Subject::new(problem)],
        contestants: ["minimal", "map"].map(|name| Contestant::new(registry::find(name).unwrap())).into(),
        source: Source::Simulated,
        noises: noises.to_vec(),
        starts: Vec::new(),
        seeds,
        tolerance: Tolerance::named("default").unwrap(),
        limit: None,
        shard: None,
    };
    let lines = Mutex::new(Vec::new());
    let keep = |line| {
        lines.lock().unwrap().push(line);
        Ok::<(), ()>(())
    };
    execute(&campaign, &campaign.cells(), keep).unwrap();
    lines.into_inner().unwrap()
}

#[test]
fn stated_regions_cover_the_truth() {
    let lines = lines(1000, &[1.0]);
    for solver in ["minimal", "map"] {
        let runs: Vec<&RunLine> = lines.iter().filter(|line| line.run.solver.name == solver).collect();
        assert_eq!(runs.len(), 1000);
        assert!(runs.iter().all(|line| line.verified.success), "{solver}");
        let nees: Vec<_> = runs.iter().map(|line| line.score.consistency.unwrap()).collect();
        let inside = nees.iter().filter(|c| c.probability <= 0.95).count();
        eprintln!("{solver}: {inside} of 1000 within the 95 % region");
        assert!((900..=980).contains(&inside), "{solver}: {inside}");
        // The median of chi-square with 30 degrees of freedom is 29.336 (Wilson and Hilferty), its deviation at 1,000
        // draws 0.31.
        assert!(nees.iter().all(|c| c.freedom == 30));
        let median = middle(nees.iter().map(|c| c.nees)).unwrap().median;
        assert!((median - 29.336).abs() < 4.0 * 0.31, "{solver}: {median}");
        // On average the bound is reached, for parameters and for predictions.
        let mean = |of: fn(&RunLine) -> f64| runs.iter().map(|line| of(line)).sum::<f64>() / 1000.0;
        let parameters = mean(|line| line.score.parameters.map(|p| (p.rms / p.bound).powi(2)).unwrap());
        let poses = mean(|line| line.score.ratio.unwrap().powi(2));
        eprintln!("{solver}: mean squared error {parameters:.4} and {poses:.4} times the bound");
        assert!(
            (parameters - 1.0).abs() < 0.06 && (poses - 1.0).abs() < 0.06,
            "{solver}: {parameters} {poses}"
        );
    }
}

#[test]
fn a_tenth_of_the_noise_is_a_tenth_of_error_and_bound() {
    let lines = lines(5, &[1.0, 0.1]);
    for line in lines.iter().filter(|line| line.run.noise == 1.0) {
        let same = |other: &&RunLine| {
            other.run.noise == 0.1
                && other.run.seed == line.run.seed
                && other.run.solver.name == line.run.solver.name
        };
        let tenth = lines.iter().find(same).unwrap();
        let near = |a: f64, b: f64| assert!((a - b).abs() < 0.02 * b, "{a} {b}");
        near(10.0 * tenth.score.after.position.unwrap(), line.score.after.position.unwrap());
        near(
            10.0 * tenth.score.bound.unwrap().position.unwrap(),
            line.score.bound.unwrap().position.unwrap(),
        );
        near(
            10.0 * tenth.score.bound.unwrap().rotation.unwrap(),
            line.score.bound.unwrap().rotation.unwrap(),
        );
    }
}
