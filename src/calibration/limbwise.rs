//! One limb as a problem of its own: the decoupled form `W_i Phi_i x_i = W_i dy` (11).
//!
//! With whole poses measured, a limb's own wrenches tell its errors whatever the other limbs do. What is lost is the
//! correlation of one pose's noise between limbs.

use super::approach::{ABREAST, Approach};
use super::coordinates::{Coordinates, LimbCoordinates};
use super::problem::Calibration;
use super::rows::RowWriter;
use super::sample::Sample;
use crate::lie::Se3;
use crate::linalg::{RowBlock, RowStream, dot};
use crate::measure::{Evaluation, Row, View};
use crate::model::{Ends, Geometry, Mechanism, Posture, Turn};
use crate::problem::{Compressed, EvalError, Linearized, Param, Problem};
use crate::wide::narrow;
use faer::{Mat, MatRef};
use nalgebra::Matrix6;
use std::ops::Range;

/// A whole measured pose.
#[derive(Clone, Debug)]
pub struct WholePose {
    pub(super) measured: Se3,
    /// Square root of its covariance, `[rotation; displacement]`, row by row.
    root: [[f64; 6]; 6],
}

impl WholePose {
    /// What was measured of `sample`, one of `count` of its posture; `None` where it is less than a whole pose.
    ///
    /// A limb sees samples one by one. What the samples of a posture have in common is given to each of them so many
    /// times that their mean has it once.
    pub fn of(sample: &Sample, count: usize) -> Option<Self> {
        let measured = *sample.measurement.pose()?;
        if sample.measurement.rows() != 6 {
            return None;
        }
        // At the measured pose itself the derivative is the whitening matrix.
        let mut there = Evaluation::default();
        sample.measurement.evaluate(&View::of_tool(&measured), &mut there);
        if let Some(common) = sample.measurement.posture_noise() {
            common.scaled((count as f64).sqrt()).whiten(&mut there);
        }
        let root = Matrix6::from_fn(|i, j| there.rows[i].by_tool[j]).try_inverse()?;
        Some(Self { measured, root: std::array::from_fn(|i| std::array::from_fn(|j| root[(i, j)])) })
    }
}

/// A posture as one limb sees it.
#[derive(Clone, Debug)]
pub struct LimbStart<'a> {
    /// Name of the sample.
    pub name: &'a str,
    /// Joint variables of the limb to start from.
    pub turns: &'a [Turn],
    /// What was measured.
    pub pose: WholePose,
}

/// The errors of one limb, `6 - m` residuals a posture.
#[derive(Debug)]
pub struct LimbProblem<'a> {
    mechanism: Mechanism,
    coordinates: Coordinates,
    starts: Vec<LimbStart<'a>>,
    params: Vec<Param>,
    home: Posture,
}

impl<'a> LimbProblem<'a> {
    /// Limb `i` of a machine in the coordinates that it has there.
    pub fn new(
        mechanism: &Mechanism,
        coordinates: &Coordinates,
        i: usize,
        starts: Vec<LimbStart<'a>>,
    ) -> Self {
        let mechanism = Mechanism {
            limbs: vec![mechanism.limbs[i].clone()],
            instrument: Vec::new(),
            ends: Ends::default(),
        };
        let coordinates = coordinates.of_limb(i);
        let params = coordinates.params(&mechanism);
        let home = Posture::new(&mechanism);
        Self { mechanism, coordinates, starts, params, home }
    }

    fn limb(&self) -> &LimbCoordinates {
        &self.coordinates.limbs[0]
    }

    fn wrench_count(&self) -> usize {
        6 - self.mechanism.limbs[0].passive_count()
    }

    /// Jacobian of the whitened residuals at `x` (rows x count), and each residual by the noise of its posture's
    /// measured pose in standard deviations (rows x 6, `C^(-1/2)` of that pose's covariance applied), up to the sign.
    pub fn sensitivities(&self, x: &[f64]) -> Result<(Mat<f64>, Mat<f64>), EvalError> {
        let (_, geometry) = self.geometry(x);
        let mut by_noise = Mat::zeros(self.starts.len() * self.wrench_count(), 6);
        let (mut first, mut posture_number) = (0, 0);
        self.visit(&geometry, |_, rows| {
            let root = &self.starts[posture_number].pose.root;
            for (i, row) in rows.iter().enumerate() {
                for j in 0..6 {
                    by_noise[(first + i, j)] = (0..6).map(|l| row.by_tool[l] * root[l][j]).sum();
                }
            }
            first += rows.len();
            posture_number += 1;
        })?;
        Ok((self.linearize(x)?.jac, by_noise))
    }

    fn visit(&self, geometry: &Geometry, mut visit: impl FnMut(&Posture, &[Row])) -> Result<(), EvalError> {
        let mut approach = Approach::new(&self.mechanism, geometry, &self.home);
        let mut rows = vec![Row::default(); self.wrench_count()];
        for starts in self.starts.chunks(ABREAST) {
            // Always from where the sample was closed first, so that a residual depends on nothing that was asked before.
            for (posture, start) in approach.postures.iter_mut().zip(starts) {
                posture.set_turns(start.turns);
            }
            approach.close(starts).map_err(|late| {
                let limb = &self.mechanism.limbs[0].name;
                EvalError(format!("{}: {limb} does not come near the measured pose", starts[late].name))
            })?;
            for (lane, start) in starts.iter().enumerate() {
                self.evaluate(&approach, lane, start, &mut rows)?;
                visit(&approach.postures[lane], &rows);
            }
        }
        Ok(())
    }

    /// `C^-1 W e` and its derivative by the limb's tool twist, `C C'` the covariance of `W e`.
    fn evaluate(
        &self,
        approach: &Approach<'_>,
        lane: usize,
        start: &LimbStart<'_>,
        rows: &mut [Row],
    ) -> Result<(), EvalError> {
        let per_length = 1.0 / self.home.length();
        // Gram-Schmidt on the rows of W root, done to W as well, whitens W e.
        let mut spreads = [[0.0; 6]; 6];
        for (i, wrench) in approach.wrenches(lane).enumerate() {
            let [a, b, c, x, y, z] = wrench;
            let mut w = [a, b, c, x * per_length, y * per_length, z * per_length];
            let mut spread = [0.0; 6];
            for (w, root) in w.iter().zip(&start.pose.root) {
                add(&mut spread, *w, root);
            }
            for (row, earlier) in rows.iter().zip(&spreads[..i]) {
                let along = dot(&spread, earlier);
                add(&mut spread, -along, earlier);
                add(&mut w, -along, &row.by_tool);
            }
            let size = dot(&spread, &spread).sqrt();
            if !(size > 0.0 && size.is_finite()) {
                return Err(EvalError(format!("{}: the noise of the limb's wrenches vanishes", start.name)));
            }
            spreads[i] = spread.map(|v| v / size);
            let by_tool = w.map(|v| v / size);
            rows[i] = Row { r: dot(&by_tool, &approach.errors[lane]), by_tool };
        }
        Ok(())
    }

    fn geometry(&self, x: &[f64]) -> (Vec<f64>, Geometry) {
        let d = self.coordinates.deviations(x);
        let geometry = self.mechanism.deviated(&d);
        (d, geometry)
    }
}

/// `sum += factor * v`.
fn add(sum: &mut [f64; 6], factor: f64, v: &[f64; 6]) {
    sum.iter_mut().zip(v).for_each(|(sum, v)| *sum += factor * v);
}

impl Calibration<'_> {
    /// Every limb by itself with the coordinates that are its own, where every posture was measured as a whole pose.
    pub fn limbs(&self) -> Option<Vec<(LimbProblem<'_>, Range<usize>)>> {
        if self.coordinates.shares_motions() {
            return None;
        }
        let by_posture = self.starts.taking.iter().map(|start| {
            let count = 1 + start.others.len();
            start.samples().map(|sample| WholePose::of(sample, count)).collect::<Option<Vec<_>>>()
        });
        let poses: Vec<Vec<WholePose>> = by_posture.collect::<Option<_>>()?;
        let mut parts = Vec::with_capacity(self.mechanism.limbs.len());
        let mut joint = 0;
        for (i, limb) in self.mechanism.limbs.iter().enumerate() {
            let own = joint..joint + limb.joints.len();
            joint = own.end;
            let mut starts = Vec::with_capacity(self.sample_count());
            for (start, poses) in self.starts.taking.iter().zip(&poses) {
                let turns = start.closing.turns.get(own.clone())?;
                let each = start.samples().zip(poses);
                starts.extend(each.map(|(s, pose)| LimbStart { name: &s.name, turns, pose: pose.clone() }));
            }
            let own = &self.coordinates.limbs[i];
            let problem = LimbProblem::new(self.mechanism, &self.coordinates, i, starts);
            parts.push((problem, own.offset..own.offset + own.count));
        }
        Some(parts)
    }
}

impl Problem for LimbProblem<'_> {
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
        narrow();
        Ok(Linearized { r: r.to_vec(), jac })
    }

    fn compress(&self, x: &[f64]) -> Result<Compressed, EvalError> {
        let (d, geometry) = self.geometry(x);
        let expected = self.starts.len() * self.wrench_count();
        let mut stream = RowStream::new(self.limb().slice.len(), expected);
        let mut writer = RowWriter::default();
        self.visit(&geometry, |posture, rows| {
            let block = stream.next(rows.len());
            writer.write_alone(self.limb(), &posture.frames, &posture.tool().p, rows, block);
            stream.add_square(rows.iter().map(|row| row.r * row.r).sum());
        })?;
        let sliced = stream.finish();
        let jac = match self.coordinates.transforms(&self.mechanism, &geometry, &d).first() {
            Some(transform) => sliced.jac * transform,
            None => sliced.jac,
        };
        narrow();
        Ok(Compressed { jac, ..sliced })
    }

    fn gradient(&self, x: &[f64]) -> Result<(f64, Vec<f64>), EvalError> {
        let (d, geometry) = self.geometry(x);
        let columns = self.limb().slice.len();
        let (mut square, mut by_slice) = (0.0, vec![0.0; columns]);
        let mut writer = RowWriter::default();
        let mut data = vec![0.0; self.wrench_count() * (columns + 1)];
        self.visit(&geometry, |posture, rows| {
            let block = RowBlock::new(&mut data, rows.len(), 0, rows.len());
            writer.write_alone(self.limb(), &posture.frames, &posture.tool().p, rows, block);
            for (sum, column) in by_slice.iter_mut().zip(data.chunks_exact(rows.len().max(1))) {
                *sum += column.iter().zip(rows).map(|(j, row)| j * row.r).sum::<f64>();
            }
            square += rows.iter().map(|row| row.r * row.r).sum::<f64>();
        })?;
        let by_x = self.coordinates.pull_back(&self.mechanism, &geometry, &d, &by_slice);
        Ok((0.5 * square, by_x))
    }
}
