//! Wrong results made of a right one.

use gough::calibration::Coordinates;
use gough::identify::{Fit, Identification};
use gough::model::Posture;
use gough::problem::Form;
use gough::simulate::close;
use rand::seq::SliceRandom;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

struct Planter<'a> {
    found: &'a Identification,
    coordinates: Coordinates,
    at: Vec<f64>,
    rng: ChaCha8Rng,
}

impl<'a> Planter<'a> {
    fn new(found: &'a Identification, seed: u64) -> Self {
        let at = found.geometry.deviations_from(&found.start.nominal());
        let coordinates = Coordinates::new(&found.start, Form::Complete);
        Self { found, coordinates, at, rng: ChaCha8Rng::seed_from_u64(seed) }
    }

    fn with(&self, deviations: &[f64]) -> Identification {
        Identification { geometry: self.found.start.deviated(deviations), ..self.found.clone() }
    }

    /// Square root of the covariance of the complete coordinates with the full prior, a column a direction (10.1).
    fn covariance_root(&self) -> Vec<Vec<f64>> {
        let seen = self.found.visibility.as_ref().unwrap();
        let minimal = Coordinates::new(&self.found.start, Form::Minimal);
        let columns = seen.directions.col_iter().zip(&seen.singular_values);
        let links = |(v, s): (faer::ColRef<f64>, &f64)| {
            let scaled: Vec<f64> = v.iter().map(|v| v / (1.0 + s * s).sqrt()).collect();
            self.coordinates.nearest(&minimal.deviations(&scaled))
        };
        columns.map(links).collect()
    }

    /// A link off in one component by some standard errors, up to a tolerance.
    fn link_off(&mut self, root: &[Vec<f64>]) -> Option<Identification> {
        let count = self.coordinates.count();
        let std = |i: usize| root.iter().map(|column| column[i] * column[i]).sum::<f64>().sqrt();
        let known: Vec<usize> = (0..count).filter(|&i| std(i) > 1e-9 && std(i) < 1.0 / 3.0).collect();
        let &i = known.get(self.rng.random_range(0..known.len().max(1)))?;
        let share: f64 = self.rng.random();
        let size = (3.0 * std(i)).powf(1.0 - share);
        let mut x = self.coordinates.nearest(&self.at);
        x[i] += if self.rng.random() { size } else { -size };
        Some(self.with(&self.coordinates.deviations(&x)))
    }

    /// All directions off by a part of a standard error.
    fn shaken(&mut self, root: &[Vec<f64>], part: f64) -> Identification {
        let mut x = self.coordinates.nearest(&self.at);
        for column in root {
            let normal: f64 = StandardNormal.sample(&mut self.rng);
            x.iter_mut().zip(column).for_each(|(x, c)| *x += part * normal * c);
        }
        self.with(&self.coordinates.deviations(&x))
    }

    /// Deviations of two links exchanged, of different limbs where there are several.
    fn exchanged(&mut self) -> Identification {
        let limbs = &self.found.start.limbs;
        let mut first = vec![0];
        limbs.iter().for_each(|limb| first.push(first[first.len() - 1] + limb.links.len()));
        let mut pairs = Vec::new();
        for a in 0..first[limbs.len()] {
            for b in a + 1..first[limbs.len()] {
                let limb = |link: usize| first.iter().rposition(|f| *f <= link).unwrap();
                if limbs.len() == 1 || (limb(a) != limb(b) && a - first[limb(a)] == b - first[limb(b)]) {
                    pairs.push((a, b));
                }
            }
        }
        pairs.shuffle(&mut self.rng);
        let (a, b) = pairs[0];
        let mut at = self.at.clone();
        (0..6).for_each(|i| at.swap(6 * a + i, 6 * b + i));
        self.with(&at)
    }

    /// The machine in another assembly mode at home.
    fn other_mode(&mut self) -> Option<Identification> {
        let (machine, geometry) = (&self.found.start, &self.found.geometry);
        let home = close(machine, geometry, &vec![0.0; machine.actuator_count()]).ok()?.tool();
        let mut posture = Posture::new(machine);
        let passive = posture.passive(machine).len();
        for _ in 0..60 {
            let random: Vec<f64> = (0..passive).map(|_| self.rng.random_range(-1.5..1.5)).collect();
            posture.set_joints(machine, &vec![0.0; machine.actuator_count()], &random);
            if posture.close(machine, geometry).is_err() || (posture.tool().p - home.p).norm() < 1e-3 {
                continue;
            }
            let mut turned = geometry.clone();
            let mut q = posture.q.iter();
            for (limb, links) in machine.limbs.iter().zip(&mut turned.limbs) {
                for (joint, link) in limb.joints.iter().zip(links.iter_mut()) {
                    *link = joint.motion.moved(link, *q.next()?);
                }
            }
            return Some(Identification { geometry: turned, ..self.found.clone() });
        }
        None
    }
}

/// What is planted, by kind.
pub fn planted(
    found: &Identification,
    other: Option<&Identification>,
    stopped: Option<&Identification>,
    seed: u64,
) -> Vec<(&'static str, Identification)> {
    let mut planter = Planter::new(found, seed);
    let root = planter.covariance_root();
    let mut out = Vec::new();
    for _ in 0..2 {
        out.extend(planter.link_off(&root).map(|wrong| ("a link off", wrong)));
    }
    out.push(("noise of a standard error", planter.shaken(&root, 1.0)));
    out.push(("noise of half of one", planter.shaken(&root, 0.5)));
    let signs: Vec<f64> = planter.at.iter().map(|d| -d).collect();
    out.push(("wrong sign", planter.with(&signs)));
    let mut one = planter.at.clone();
    let link = 6 * planter.rng.random_range(0..found.start.link_component_count() / 6);
    one[link..link + 6].iter_mut().for_each(|d| *d = -*d);
    out.push(("wrong sign of a link", planter.with(&one)));
    out.push(("links exchanged", planter.exchanged()));
    out.push(("the drawing", planter.with(&vec![0.0; planter.at.len()])));
    if !found.start.is_open_chain() {
        out.extend(planter.other_mode().map(|wrong| ("another assembly mode", wrong)));
    }
    let with_geometry =
        |of: &Identification| Identification { geometry: of.geometry.clone(), ..found.clone() };
    out.extend(other.map(|of| ("deviations of another seed", with_geometry(of))));
    out.extend(stopped.map(|of| ("stopped early", of.clone())));
    // It says that it fits to perfection, whatever it is.
    let mut lies = planter.link_off(&root).unwrap_or_else(|| planter.shaken(&root, 1.0));
    lies.report.cost = 0.0;
    lies.report.kkt = Some(0.0);
    lies.trace.iter_mut().for_each(|step| step.cost = 0.0);
    let little = lies.fit.1.map(|fit| Fit { weighted_rms: 0.5 * fit.weighted_rms, ..fit });
    lies.fit.1 = little;
    out.push(("a lower cost stated", lies));
    out
}
