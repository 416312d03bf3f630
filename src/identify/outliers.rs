//! Postures that stand out from the others (docs/theory.md (10.9)).

use super::cross_validation::Influence;
use super::run::Identification;
use super::score::score;
use crate::calibration::Sample;
use crate::model::{Geometry, Mechanism};
use rayon::prelude::*;
use statrs::distribution::{ChiSquared, ContinuousCDF};

/// Probability with which any posture at all is called an outlier where there is none.
pub const FALSE_ALARM: f64 = 0.01;
/// Part of the postures up to which outliers are sought: beyond it nobody can say which ones are wrong.
const MOST: f64 = 0.5;

/// A posture whose prediction stands out.
#[derive(Clone, Debug, PartialEq)]
pub struct Outlier {
    /// The sample.
    pub name: String,
    /// Root mean square of its whitened residuals, by the machine that the postures that do not stand out give.
    pub weighted_rms: f64,
    /// Probability that noise alone makes a residual as large as this.
    pub probability: f64,
}

/// A sample with its residual by some geometry.
#[derive(Clone, Copy)]
struct Tested {
    sample: usize,
    weighted_rms: f64,
    probability: f64,
}

/// Postures whose residual noise does not explain, worst first.
///
/// The worst posture is tested by chi-square at [`FALSE_ALARM`] divided by the number of postures left (Holm, *Scand. J.
/// Statistics* 6, 1979). Where it fails it is taken out, the machine that the others give follows from the influence
/// matrix (10.6), and the next is tested by that: a gross error drags its neighbours along, which are not to blame. In
/// the end those taken out are tested once more by the last machine. An estimate that linear theory does not describe is
/// judged as it is.
///
/// Where the median posture is worse than the stated noise makes it, its excess counts as noise: a model that misses
/// everywhere by a little has no outliers.
pub fn outliers(found: &Identification, samples: &[Sample]) -> Vec<Outlier> {
    let taking = found.taking_part(samples);
    let mut geometry = found.geometry.clone();
    let mut influence = None;
    let mut out: Vec<usize> = Vec::new();
    let mut removed: Vec<Tested> = Vec::new();
    loop {
        let tested = tests(&found.start, &geometry, &taking, &out);
        let left = tested.iter().filter(|t| !out.contains(&t.sample)).count();
        let worst = tested.iter().filter(|t| !out.contains(&t.sample)).find(|t| t.fails(left));
        let Some(worst) = worst.filter(|_| (out.len() as f64) < MOST * taking.len() as f64) else {
            // Those that no longer close are to blame as when they were taken out.
            let open = removed.iter().filter(|r| !tested.iter().any(|t| t.sample == r.sample));
            let blamed = tested.iter().filter(|t| out.contains(&t.sample) && t.fails(left.max(1)));
            return open.chain(blamed).map(|t| t.named(&taking)).collect();
        };
        out.push(worst.sample);
        removed.push(*worst);
        if out.len() == 1 {
            influence = Influence::new(found, &taking).ok();
        }
        match influence.as_ref().and_then(|influence| influence.without(&out)) {
            Some(next) => geometry = next,
            // The others do not say where the machine would be: what stands out by the present one is all there is.
            None => {
                let failing = tested.iter().enumerate().take_while(|(k, t)| t.fails(tested.len() - k));
                return failing.map(|(_, t)| t.named(&taking)).collect();
            }
        }
    }
}

impl Tested {
    /// Whether noise does not explain it, as the worst of so many.
    fn fails(&self, count: usize) -> bool {
        self.probability <= FALSE_ALARM / count as f64
    }

    fn named(&self, samples: &[Sample]) -> Outlier {
        let name = samples[self.sample].name.clone();
        Outlier { name, weighted_rms: self.weighted_rms, probability: self.probability }
    }
}

/// All samples that close, least probable first. The noise is the median excess of those not taken `out`.
fn tests(mechanism: &Mechanism, geometry: &Geometry, samples: &[Sample], out: &[usize]) -> Vec<Tested> {
    let squares: Vec<(usize, f64, ChiSquared)> = samples
        .par_iter()
        .enumerate()
        .filter_map(|(k, sample)| {
            let fit = score(mechanism, geometry, std::slice::from_ref(sample))?;
            let law = ChiSquared::new(sample.measurement.rows() as f64).ok()?;
            Some((k, fit.weighted_rms, law))
        })
        .collect();
    let square = |rms: f64, law: &ChiSquared| rms.powi(2) * law.freedom();
    let inside = squares.iter().filter(|(k, _, _)| !out.contains(k));
    let mut excess: Vec<f64> = inside.map(|(_, rms, law)| square(*rms, law) / law.inverse_cdf(0.5)).collect();
    excess.sort_by(f64::total_cmp);
    let noise = excess.get(excess.len() / 2).map_or(1.0, |median| median.max(1.0));
    let mut tested: Vec<Tested> = squares
        .into_iter()
        .map(|(sample, weighted_rms, law)| Tested {
            sample,
            weighted_rms,
            probability: law.sf(square(weighted_rms, &law) / noise),
        })
        .collect();
    tested.sort_by(|a, b| {
        let worst = b.weighted_rms.total_cmp(&a.weighted_rms);
        a.probability.total_cmp(&b.probability).then(worst).then(a.sample.cmp(&b.sample))
    });
    tested
}
