//! What is common to all that is measured at one posture, beside the noise of each reading (docs/theory.md (8.12), (8.13)).

use super::measurement::{
    Clue, ConstantDerivative, Errors, Evaluation, LimbDerivative, Measurement, View, Weights,
};
use nalgebra::{Matrix6, Vector6};
use std::sync::Arc;

/// Most rounds of a decomposition: without a limit one of numbers that are not finite never ends.
const ROUNDS: usize = 1000;

/// Standard deviations of each component of a tool twist `[w; dp]`, {S} axes, by which all readings of one posture err
/// together: how well the machine returns to a posture, how it sags there.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PostureNoise {
    /// Of each rotation component, rad.
    pub angle: f64,
    /// Of each displacement of the tool point, m.
    pub length: f64,
}

impl PostureNoise {
    /// Whether there is none.
    pub fn is_zero(self) -> bool {
        self.angle == 0.0 && self.length == 0.0
    }

    /// So many times the size.
    pub fn scaled(self, factor: f64) -> Self {
        Self { angle: factor * self.angle, length: factor * self.length }
    }

    /// Of each component of a twist.
    fn sigma(self) -> [f64; 6] {
        let Self { angle: a, length: l } = self;
        [a, a, a, l, l, l]
    }

    /// Variance of each component, rad^2 and m^2.
    pub fn variances(self) -> Vector6<f64> {
        Vector6::from(self.sigma().map(|sigma| sigma * sigma))
    }

    /// A draw: a tool twist `[w; dp]`.
    pub fn draw(self, normal: &mut dyn FnMut() -> f64) -> [f64; 6] {
        self.sigma().map(|sigma| sigma * normal())
    }

    /// Whitens the rows of all samples of one posture, which so far are whitened each by its own noise.
    ///
    /// Their covariance is `Sigma = 1 + T T'`, T the derivatives by the common twist in standard deviations, of one posture
    /// or of two side by side. With `T'T = Q diag(l) Q'` its symmetric inverse root is
    /// `1 - T Q diag(eta) Q' T'`, `eta = 1 / (sqrt(1 + l) (sqrt(1 + l) + 1))`: linear in the number of rows. T depends on the
    /// machine so weakly that it counts as constant in derivatives. Returns `log det Sigma`.
    pub fn whiten(self, rows: &mut Evaluation) -> f64 {
        let sigma = self.sigma();
        let first: Vec<Vector6<f64>> =
            rows.rows.iter().map(|row| Vector6::from_fn(|i, _| row.by_tool[i] * sigma[i])).collect();
        let log_det = Mixing::new(&first).apply(rows);
        // The second posture has a twist of its own: one factor after the other.
        let second: Vec<Vector6<f64>> =
            rows.by_second.iter().map(|by| Vector6::from_fn(|i, _| by[i] * sigma[i])).collect();
        if second.is_empty() { log_det } else { log_det + Mixing::new(&second).apply(rows) }
    }
}

/// The symmetric inverse root of `1 + T T'`.
struct Mixing<'a> {
    by: &'a [Vector6<f64>],
    /// `Q diag(eta) Q'`.
    inner: Matrix6<f64>,
    log_det: f64,
}

impl<'a> Mixing<'a> {
    fn new(by: &'a [Vector6<f64>]) -> Self {
        let square: Matrix6<f64> = by.iter().map(|b| b * b.transpose()).sum();
        let Some(eigen) = square.try_symmetric_eigen(f64::EPSILON, ROUNDS) else {
            return Self { by, inner: Matrix6::zeros(), log_det: f64::NAN };
        };
        let values = eigen.eigenvalues.map(|d| d.max(0.0));
        let root = values.map(|d| (1.0 + d).sqrt());
        let c = root.map(|root| 1.0 / (root * (root + 1.0)));
        let inner = eigen.eigenvectors * Matrix6::from_diagonal(&c) * eigen.eigenvectors.transpose();
        Self { by, inner, log_det: values.map(f64::ln_1p).sum() }
    }

    /// What is taken from each row, `b . t`, where the rows hold `values`.
    fn taken(&self, values: impl Iterator<Item = (usize, f64)>) -> Vector6<f64> {
        let sum: Vector6<f64> = values.map(|(row, v)| self.by[row] * v).sum();
        self.inner * sum
    }

    fn apply(&self, out: &mut Evaluation) -> f64 {
        let t = self.taken(out.rows.iter().map(|row| row.r).enumerate());
        out.rows.iter_mut().zip(self.by).for_each(|(row, b)| row.r -= b.dot(&t));
        for i in 0..6 {
            let t = self.taken(out.rows.iter().map(|row| row.by_tool[i]).enumerate());
            out.rows.iter_mut().zip(self.by).for_each(|(row, b)| row.by_tool[i] -= b.dot(&t));
            let t = self.taken(out.by_second.iter().map(|by| by[i]).enumerate());
            out.by_second.iter_mut().zip(self.by).for_each(|(by, b)| by[i] -= b.dot(&t));
        }
        self.apply_to_limbs(&mut out.by_limb);
        self.apply_to_constants(&mut out.by_constant);
        self.log_det
    }

    /// Rows that did not answer to a limb of its own do so afterwards, where others of the posture do.
    fn apply_to_limbs(&self, all: &mut Vec<LimbDerivative>) {
        let mut limbs: Vec<usize> = all.iter().map(|by| by.limb).collect();
        limbs.sort_unstable();
        limbs.dedup();
        let own = all.len();
        for limb in limbs {
            let of_limb = || all[..own].iter().filter(move |by| by.limb == limb);
            let t: [Vector6<f64>; 6] =
                std::array::from_fn(|i| self.taken(of_limb().map(|by| (by.row, by.by_twist[i]))));
            let rest = self.by.iter().enumerate().map(|(row, b)| LimbDerivative {
                row,
                limb,
                by_twist: std::array::from_fn(|i| -b.dot(&t[i])),
            });
            let rest: Vec<LimbDerivative> = rest.collect();
            all.extend(rest);
        }
    }

    fn apply_to_constants(&self, all: &mut Vec<ConstantDerivative>) {
        let mut constants: Vec<usize> = all.iter().map(|by| by.constant).collect();
        constants.sort_unstable();
        constants.dedup();
        let own = all.len();
        for constant in constants {
            let of_constant = all[..own].iter().filter(|by| by.constant == constant);
            let t = self.taken(of_constant.map(|by| (by.row, by.value)));
            let rest = self.by.iter().enumerate();
            all.extend(rest.map(|(row, b)| ConstantDerivative { row, constant, value: -b.dot(&t) }));
        }
    }
}

/// Any measurement whose posture has an error that its other measurements share. Its own rows are whitened by its own
/// noise alone; who has all rows of a posture whitens them together, by [`PostureNoise::whiten`].
#[derive(Clone, Debug)]
pub struct OfPosture {
    inner: Arc<dyn Measurement>,
    noise: PostureNoise,
}

impl OfPosture {
    /// The measurement with what its posture's measurements have in common, in place of what it had; itself where that
    /// is nothing.
    pub fn by(inner: Arc<dyn Measurement>, noise: PostureNoise) -> Arc<dyn Measurement> {
        let inner = inner.alone().unwrap_or(inner);
        if noise.is_zero() { inner } else { Arc::new(Self { inner, noise }) }
    }

    fn again(&self, inner: Arc<dyn Measurement>) -> Arc<dyn Measurement> {
        Arc::new(Self { inner, noise: self.noise })
    }
}

impl Measurement for OfPosture {
    fn inner(&self) -> Option<&dyn Measurement> {
        Some(self.inner.as_ref())
    }

    fn rows(&self) -> usize {
        self.inner.rows()
    }

    fn evaluate(&self, view: &View<'_>, out: &mut Evaluation) {
        self.inner.evaluate(view, out);
    }

    fn posture_noise(&self) -> Option<PostureNoise> {
        Some(self.noise)
    }

    fn alone(&self) -> Option<Arc<dyn Measurement>> {
        Some(self.inner.clone())
    }

    fn clue(&self) -> Clue {
        self.inner.clue()
    }

    fn readings(&self) -> Vec<f64> {
        self.inner.readings()
    }

    fn error(&self, view: &View<'_>) -> Errors {
        self.inner.error(view)
    }

    fn expected(&self, view: &View<'_>) -> Arc<dyn Measurement> {
        self.again(self.inner.expected(view))
    }

    /// By its own noise: what is common belongs to the posture.
    fn perturbed(&self, normal: &mut dyn FnMut() -> f64) -> Arc<dyn Measurement> {
        self.again(self.inner.perturbed(normal))
    }

    fn with_second(&self, actuators: &[f64]) -> Option<Arc<dyn Measurement>> {
        Some(self.again(self.inner.with_second(actuators)?))
    }

    /// What is common has a part in weights by noise alone.
    fn reweighted(&self, weights: Weights) -> Arc<dyn Measurement> {
        let inner = self.inner.reweighted(weights);
        match weights {
            Weights::Unit | Weights::SpatialTwist => inner,
            Weights::Isotropic { .. } => self.again(inner),
            Weights::Scaled(factor) => Arc::new(Self { inner, noise: self.noise.scaled(factor) }),
        }
    }
}
