//! Postures that stand out from the others (docs/theory.md (10.9)).

use super::cross_validation::Influence;
use super::run::Identification;
use super::score::{Together, scores};
use crate::calibration::Sample;
use crate::calibration::postures::{by_posture, posture_name};
use crate::model::{Geometry, Mechanism};
use statrs::distribution::{ChiSquared, ContinuousCDF};

/// Probability with which any posture at all is called an outlier where there is none.
pub const FALSE_ALARM: f64 = 0.01;
/// Part of the postures up to which outliers are sought: beyond it nobody can say which ones are wrong.
const MOST: f64 = 0.5;
/// So many that are out already allow one more to be taken out at a time.
const AT_ONCE: usize = 4;

/// A posture whose prediction stands out.
#[derive(Clone, Debug, PartialEq)]
pub struct Outlier {
    /// The sample; of several, the first and the last.
    pub name: String,
    /// Names of its samples.
    pub samples: Vec<String>,
    /// Root mean square of its whitened residuals, by the machine that the postures that do not stand out give.
    pub weighted_rms: f64,
    /// Probability that noise alone makes a residual as large as this.
    pub probability: f64,
}

/// A posture with its residual by some geometry.
#[derive(Clone, Copy)]
struct Tested {
    posture: usize,
    weighted_rms: f64,
    probability: f64,
}

/// Postures whose residual noise does not explain, worst first.
///
/// The worst posture is tested by chi-square at [`FALSE_ALARM`] divided by the number of postures left (Holm, *Scand. J.
/// Statistics* 6, 1979). Where it fails it is taken out, the machine that the others give follows from the influence
/// matrix (10.6), and the next is tested by that: a gross error drags its neighbours along, which are not to blame. In
/// the end those taken out are tested once more by the last machine. An estimate that linear theory does not describe is
/// judged as it is. Where many fail, as many are taken out at a time as a quarter of those that are out already, so that
/// what it takes grows with the number of postures and not with its square.
///
/// Where the median posture is worse than the stated noise makes it, its excess counts as noise: a model that misses
/// everywhere by a little has no outliers.
pub fn outliers(found: &Identification, samples: &[Sample]) -> Vec<Outlier> {
    let taking = found.taking_part(samples);
    let postures = by_posture(&taking);
    let mut geometry = found.geometry.clone();
    let mut influence = None;
    let mut out: Vec<usize> = Vec::new();
    let mut is_out = vec![false; postures.len()];
    let mut removed: Vec<Tested> = Vec::new();
    loop {
        let tested = tests(&found.start, &geometry, &postures, &is_out);
        let inside: Vec<Tested> = tested.iter().filter(|t| !is_out[t.posture]).copied().collect();
        let left = inside.len();
        let most = ((MOST * postures.len() as f64).ceil() as usize).saturating_sub(out.len());
        let count = (1 + out.len() / AT_ONCE).min(most);
        let worst = inside.iter().take(count).enumerate().take_while(|(k, t)| t.fails(left - k));
        let worst: Vec<Tested> = worst.map(|(_, t)| *t).collect();
        if worst.is_empty() {
            // Those that no longer close are to blame as when they were taken out.
            let mut closes = vec![false; postures.len()];
            tested.iter().for_each(|t| closes[t.posture] = true);
            let open = removed.iter().filter(|r| !closes[r.posture]);
            let blamed = tested.iter().filter(|t| is_out[t.posture] && t.fails(left.max(1)));
            return open.chain(blamed).map(|t| t.named(&postures)).collect();
        }
        if out.is_empty() {
            influence = Influence::new(found, &taking).ok();
        }
        for t in &worst {
            out.push(t.posture);
            is_out[t.posture] = true;
        }
        removed.extend(worst);
        match influence.as_ref().and_then(|influence| influence.without(&out)) {
            Some(next) => geometry = next,
            // The others do not say where the machine would be: what stands out by the present one is all there is.
            None => {
                let failing = tested.iter().enumerate().take_while(|(k, t)| t.fails(tested.len() - k));
                return failing.map(|(_, t)| t.named(&postures)).collect();
            }
        }
    }
}

impl Tested {
    /// Whether noise does not explain it, as the worst of so many.
    fn fails(&self, count: usize) -> bool {
        self.probability <= FALSE_ALARM / count as f64
    }

    fn named(&self, postures: &[Together<'_>]) -> Outlier {
        let names: Vec<&str> = postures[self.posture].iter().map(|sample| sample.name.as_str()).collect();
        let samples = names.iter().map(|name| (*name).to_owned()).collect();
        let Tested { weighted_rms, probability, .. } = *self;
        Outlier { name: posture_name(&names), samples, weighted_rms, probability }
    }
}

/// All postures that close, least probable first. The noise is the median excess of those not taken `out`.
fn tests(mechanism: &Mechanism, geometry: &Geometry, postures: &[Together<'_>], out: &[bool]) -> Vec<Tested> {
    let scored = scores(mechanism, geometry, postures).into_iter().enumerate();
    let squares: Vec<(usize, f64, ChiSquared)> = scored
        .filter_map(|(k, scored)| {
            let scored = scored?;
            let law = ChiSquared::new(scored.rows as f64).ok()?;
            Some((k, (scored.square / scored.rows as f64).sqrt(), law))
        })
        .collect();
    let square = |rms: f64, law: &ChiSquared| rms.powi(2) * law.freedom();
    let inside = squares.iter().filter(|(k, _, _)| !out[*k]);
    let mut excess: Vec<f64> = inside.map(|(_, rms, law)| square(*rms, law) / law.inverse_cdf(0.5)).collect();
    excess.sort_by(f64::total_cmp);
    let noise = excess.get(excess.len() / 2).map_or(1.0, |median| median.max(1.0));
    let mut tested: Vec<Tested> = squares
        .into_iter()
        .map(|(posture, weighted_rms, law)| Tested {
            posture,
            weighted_rms,
            probability: law.sf(square(weighted_rms, &law) / noise),
        })
        .collect();
    tested.sort_by(|a, b| {
        let worst = b.weighted_rms.total_cmp(&a.weighted_rms);
        a.probability.total_cmp(&b.probability).then(worst).then(a.posture.cmp(&b.posture))
    });
    tested
}
