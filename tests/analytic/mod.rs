//! Small problems with known structure, for every identifier.

use gough::problem::{Dual, EvalError, Formula};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Residuals as a function of the parameters.
pub type Residual = Box<dyn Fn(&[Dual]) -> Result<Vec<Dual>, EvalError> + Sync>;

/// Uniform numbers in [-1, 1], the same on every machine.
pub fn numbers(seed: u64, count: usize) -> Vec<f64> {
    let mut stream = ChaCha8Rng::seed_from_u64(seed);
    (0..count).map(|_| stream.random_range(-1.0..1.0)).collect()
}

/// A mildly curved machine of `links` links with three coordinates each, of which the data see all but one: the
/// first two coordinates only count by their sum. Residuals are `rows` of noise of size one at `truth`.
pub struct Machine {
    /// Coordinates that the noise-free data were made with.
    pub truth: Vec<f64>,
    /// Noise of every row.
    pub noise: Vec<f64>,
    rows: Vec<Vec<f64>>,
    bends: Vec<Vec<f64>>,
}

impl Machine {
    /// Data of size `gain` a unit of `x`, at a `truth` of 3 `links` coordinates.
    pub fn new(seed: u64, rows: usize, gain: f64, truth: Vec<f64>) -> Self {
        let n = truth.len();
        let make = |seed: u64, gain: f64| -> Vec<Vec<f64>> {
            let mut rows: Vec<Vec<f64>> =
                numbers(seed, rows * n).chunks(n).map(|row| row.iter().map(|v| gain * v).collect()).collect();
            rows.iter_mut().for_each(|row| row[1] = row[0]);
            rows
        };
        let noise = numbers(seed + 2, rows).iter().map(|v| 1.7 * v).collect();
        Self { truth, noise, rows: make(seed, gain), bends: make(seed + 1, (0.02 * gain).sqrt()) }
    }

    fn value(&self, row: usize, x: &[Dual]) -> Dual {
        let dot = |a: &[f64]| a.iter().zip(x).fold(Dual::constant(0.0), |sum, (a, x)| sum + *x * *a);
        dot(&self.rows[row]) + dot(&self.bends[row]).square()
    }

    /// The problem, in groups of three and with a prior.
    pub fn problem(self) -> Formula<Residual> {
        let n = self.truth.len();
        let at: Vec<Dual> = self.truth.iter().map(|&v| Dual::constant(v)).collect();
        let data: Vec<f64> = (0..self.rows.len()).map(|i| self.value(i, &at).v + self.noise[i]).collect();
        let residual: Residual =
            Box::new(move |x| Ok((0..data.len()).map(|i| self.value(i, x) - data[i]).collect()));
        Formula::new(n, residual).grouped(3).with_prior()
    }
}
