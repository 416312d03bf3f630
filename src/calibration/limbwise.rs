//! One limb as a problem of its own: the decoupled form `W_i Phi_i x_i = W_i dy` (11).
//!
//! With whole poses measured, a limb's own wrenches tell its errors whatever the other limbs do. What is lost is the
//! correlation of one pose's noise between limbs.

use super::coordinates::{Coordinates, LimbCoordinates};
use super::rows::RowWriter;
use super::sample::Sample;
use crate::lie::Se3;
use crate::linalg::RowBlock;
use crate::measure::{Evaluation, Row, View};
use crate::model::mechanism::pose_difference;
use crate::model::{Geometry, Mechanism, Posture};
use crate::problem::{EvalError, Linearized, Param, Problem};
use faer::{Mat, MatRef};
use nalgebra::Matrix6;

/// Passive joint step (rad, machine sizes) below which the limb is at the pose: the residual depends on it by
/// second order only, 1e-11.
const AT_POSE: f64 = 3e-6;
const MAX_ITERATIONS: usize = 30;

/// A posture as one limb sees it.
#[derive(Clone, Debug)]
pub struct LimbStart {
    name: String,
    actuators: Vec<f64>,
    passive: Vec<f64>,
    measured: Se3,
    /// Square root of the covariance of the measured pose, `[rotation; displacement]`.
    root: Matrix6<f64>,
}

impl LimbStart {
    /// `None` where less than a whole pose was measured.
    pub fn new(sample: &Sample, actuators: &[f64], passive: &[f64]) -> Option<Self> {
        let measured = *sample.measurement.pose()?;
        if sample.measurement.rows() != 6 {
            return None;
        }
        // At the measured pose itself the derivative is the whitening matrix.
        let mut there = Evaluation::default();
        sample.measurement.evaluate(&View::of_tool(&measured), &mut there);
        let root = Matrix6::from_fn(|i, j| there.rows[i].by_tool[j]).try_inverse()?;
        let (actuators, passive) = (actuators.to_vec(), passive.to_vec());
        Some(Self { name: sample.name.clone(), actuators, passive, measured, root })
    }
}

/// The errors of one limb, `6 - m` residuals a posture.
#[derive(Clone, Debug)]
pub struct LimbProblem {
    mechanism: Mechanism,
    coordinates: Coordinates,
    starts: Vec<LimbStart>,
    params: Vec<Param>,
}

impl LimbProblem {
    /// Limb `i` of a machine in the coordinates that it has there.
    pub fn new(mechanism: &Mechanism, coordinates: &Coordinates, i: usize, starts: Vec<LimbStart>) -> Self {
        let mechanism = Mechanism { limbs: vec![mechanism.limbs[i].clone()], instrument: Vec::new() };
        let coordinates = coordinates.of_limb(i);
        let params = coordinates.params(&mechanism);
        Self { mechanism, coordinates, starts, params }
    }

    fn limb(&self) -> &LimbCoordinates {
        &self.coordinates.limbs[0]
    }

    fn wrench_count(&self) -> usize {
        6 - self.mechanism.limbs[0].passive_count()
    }

    fn visit(&self, geometry: &Geometry, mut visit: impl FnMut(&Posture, &[Row])) -> Result<(), EvalError> {
        let mut posture = Posture::new(&self.mechanism);
        let mut rows = vec![Row::default(); self.wrench_count()];
        for start in &self.starts {
            posture.set_joints(&self.mechanism, &start.actuators, &start.passive);
            self.approach(&mut posture, geometry, start)?;
            self.evaluate(&posture, start, &mut rows)?;
            visit(&posture, &rows);
        }
        Ok(())
    }

    /// Passive joints that bring the limb's tool closest to the measured pose.
    fn approach(
        &self,
        posture: &mut Posture,
        geometry: &Geometry,
        start: &LimbStart,
    ) -> Result<(), EvalError> {
        let length = posture.length();
        for _ in 0..MAX_ITERATIONS {
            posture.open(&self.mechanism, geometry);
            let (w, v) = pose_difference(&start.measured, &posture.tool());
            let gap = [w.x, w.y, w.z, v.x / length, v.y / length, v.z / length];
            let steps = posture.splits[0].motions(&gap);
            let passive =
                self.mechanism.limbs[0].joints.iter().zip(&mut posture.q).filter(|(j, _)| !j.actuated);
            let mut longest = 0.0_f64;
            for ((_, q), step) in passive.zip(&steps) {
                *q += step;
                longest = longest.max(step.abs());
            }
            if longest <= AT_POSE {
                return Ok(());
            }
        }
        let limb = &self.mechanism.limbs[0].name;
        Err(EvalError(format!("{}: {limb} does not come near the measured pose", start.name)))
    }

    /// `C^-1 W e` and its derivative by the limb's tool twist, `C C'` the covariance of `W e`.
    fn evaluate(&self, posture: &Posture, start: &LimbStart, rows: &mut [Row]) -> Result<(), EvalError> {
        let length = posture.length();
        let k = rows.len();
        // Gram-Schmidt on the rows of W root, done to W as well, whitens W e.
        let mut w = [[0.0; 6]; 6];
        let mut spread = [[0.0; 6]; 6];
        for (i, wrench) in posture.splits[0].wrenches().iter().enumerate() {
            w[i] = std::array::from_fn(|j| if j < 3 { wrench[j] } else { wrench[j] / length });
            spread[i] = std::array::from_fn(|j| (0..6).map(|l| w[i][l] * start.root[(l, j)]).sum());
        }
        for i in 0..k {
            for j in 0..i {
                let along = dot(&spread[i], &spread[j]);
                for l in 0..6 {
                    spread[i][l] -= along * spread[j][l];
                    w[i][l] -= along * w[j][l];
                }
            }
            let size = dot(&spread[i], &spread[i]).sqrt();
            if !(size > 0.0 && size.is_finite()) {
                return Err(EvalError(format!("{}: the noise of the limb's wrenches vanishes", start.name)));
            }
            for l in 0..6 {
                spread[i][l] /= size;
                w[i][l] /= size;
            }
        }
        let (turn, dp) = pose_difference(&posture.tool(), &start.measured);
        let error = [turn.x, turn.y, turn.z, dp.x, dp.y, dp.z];
        for (row, w) in rows.iter_mut().zip(&w) {
            *row = Row { r: dot(w, &error), by_tool: *w };
        }
        Ok(())
    }

    fn geometry(&self, x: &[f64]) -> (Vec<f64>, Geometry) {
        let d = self.coordinates.deviations(x);
        let geometry = self.mechanism.deviated(&d);
        (d, geometry)
    }
}

fn dot(a: &[f64; 6], b: &[f64; 6]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

impl Problem for LimbProblem {
    fn params(&self) -> &[Param] {
        &self.params
    }

    fn has_prior(&self) -> bool {
        true
    }

    fn residual(&self, x: &[f64]) -> Result<Vec<f64>, EvalError> {
        let (_, geometry) = self.geometry(x);
        let mut r = Vec::with_capacity(self.starts.len() * self.wrench_count());
        self.visit(&geometry, |_, rows| r.extend(rows.iter().map(|row| row.r)))?;
        Ok(r)
    }

    fn linearize(&self, x: &[f64]) -> Result<Linearized, EvalError> {
        let (d, geometry) = self.geometry(x);
        let (m, columns) = (self.starts.len() * self.wrench_count(), self.limb().slice.len());
        let mut data = vec![0.0; m * (columns + 1)];
        let mut first = 0;
        let mut writer = RowWriter::default();
        self.visit(&geometry, |posture, rows| {
            let block = RowBlock::new(&mut data, m, first, rows.len());
            writer.write_alone(self.limb(), &posture.frames, &posture.tool().p, rows, block);
            first += rows.len();
        })?;
        let (jac, r) = data.split_at(m * columns);
        let jac = MatRef::from_column_major_slice(jac, m, columns);
        let jac: Mat<f64> = match self.coordinates.transforms(&self.mechanism, &geometry, &d).first() {
            Some(transform) => jac * transform,
            None => jac.to_owned(),
        };
        Ok(Linearized { r: r.to_vec(), jac })
    }
}
