//! The calibration problem: whitened pose errors by link deviations, loops closed.

use super::coordinates::Coordinates;
use super::evaluate::PostureRows;
use super::representative::with_derivative;
use super::rows::RowWriter;
use super::sample::{Postures, Sample, SetAside};
use super::starts::{OtherPosture, Start, Starts};
use crate::linalg::{RowBlock, RowStream};
use crate::measure::Evaluation;
use crate::model::{Geometry, Mechanism, NotClosed};
use crate::problem::{Compressed, EvalError, Form, Group, Linearized, Param, Part, Problem, Representative};
use crate::wide::narrow;
use faer::{Mat, MatRef};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::OnceLock;

/// Postures that one thread takes at a time; fixed, so that results do not depend on how many threads there are.
const CHUNK: usize = 128;

/// A machine with measurements, in the coordinates of one [`Form`].
#[derive(Clone, Debug)]
pub struct Calibration<'a> {
    pub(super) mechanism: &'a Mechanism,
    pub(super) coordinates: Coordinates,
    /// Postures at home, from which those of a thread are copied.
    home: Postures,
    pub(super) starts: Starts<'a>,
    params: Vec<Param>,
    groups: Vec<Group>,
    /// Those of the minimal form, once they are asked for.
    minimal: OnceLock<Coordinates>,
}

impl<'a> Calibration<'a> {
    /// Closes every sample at link deviations `at` (rad, m); those that do not close are set aside.
    pub fn new(mechanism: &'a Mechanism, samples: &'a [Sample], form: Form, at: &[f64]) -> Self {
        let coordinates = Coordinates::new(mechanism, form);
        let (params, groups) = (coordinates.params(mechanism), coordinates.groups(mechanism));
        let mut problem = Self {
            mechanism,
            coordinates,
            home: Postures::new(mechanism),
            starts: Starts::default(),
            params,
            groups,
            minimal: OnceLock::new(),
        };
        problem.take_back(samples, at, 0.0);
        problem
    }

    /// Closes every sample at deviations `at` (rad, m), from where it was closed before, and sets aside those that do not
    /// close. Where `least` is positive, those wait whose wrench matrix has a smaller ratio of extreme singular values, and
    /// those whose reading has little to do with the posture that closes. Returns whether other samples take part than
    /// before, or in other postures.
    pub fn take_back(&mut self, samples: &'a [Sample], at: &[f64], least: f64) -> bool {
        let geometry = self.mechanism.deviated(at);
        self.starts.take_back((self.mechanism, &geometry, &self.home), samples, least)
    }

    /// Tries other postures for the samples `doubted` (indices) with links that the others gave, `at` (rad, m). Where one
    /// explains the reading, the sample is closed there from now on or, where that is another assembly mode than the one
    /// that was followed, takes no part: so near to each other, nothing else tells the modes apart. Returns whether any
    /// did.
    pub fn reconsider(&mut self, samples: &'a [Sample], doubted: &[usize], at: &[f64]) -> bool {
        let geometry = self.mechanism.deviated(at);
        self.starts.reconsider((self.mechanism, &geometry, &self.home), samples, doubted)
    }

    /// Other postures in which each `wanted` one of those that take part closes with links that deviate by `at` (rad, m), of
    /// `samples`, those that the problem was made of.
    pub fn alternatives(&self, samples: &[Sample], at: &[f64], wanted: &[usize]) -> Vec<Vec<OtherPosture>> {
        let geometry = self.mechanism.deviated(at);
        self.starts.alternatives((self.mechanism, &geometry, &self.home), samples, wanted)
    }

    /// The same problem, one posture of those that take part to be closed elsewhere.
    pub fn closed_in(&self, posture: usize, other: &OtherPosture) -> Self {
        Self { starts: self.starts.closed_in(posture, other), ..self.clone() }
    }

    /// Whether a posture that takes part, with links that deviate by `at` (rad, m), stays near where it is closed, and
    /// elsewhere than in the problem `before`.
    pub fn is_apart(&self, posture: usize, at: &[f64], before: &Self) -> bool {
        let geometry = self.mechanism.deviated(at);
        self.starts.is_apart((self.mechanism, &geometry, &self.home), posture, &before.starts)
    }

    /// The samples, those that close to be closed from where they are closed here.
    pub fn closed(&self, samples: &[Sample]) -> Vec<Sample> {
        self.starts.closed(samples)
    }

    /// Samples that take no part, and why.
    pub fn set_aside(&self) -> &[SetAside] {
        &self.starts.set_aside
    }

    /// Number of samples that take part.
    pub fn sample_count(&self) -> usize {
        self.starts.taking.iter().map(|start| 1 + start.others.len()).sum()
    }

    /// Number of postures that take part.
    pub fn posture_count(&self) -> usize {
        self.starts.taking.len()
    }

    /// Names of the samples of each posture that takes part.
    pub fn names_of_postures(&self) -> impl Iterator<Item = Vec<&'a str>> + '_ {
        self.starts.taking.iter().map(|start| start.samples().map(|sample| sample.name.as_str()).collect())
    }

    /// The coordinates.
    pub fn coordinates(&self) -> &Coordinates {
        &self.coordinates
    }

    /// Number of residuals of the samples that take part.
    pub fn rows(&self) -> usize {
        self.starts.taking.iter().map(Start::rows).sum()
    }

    /// Number of residuals of each posture that takes part: in evaluations they stand one after the other.
    pub fn rows_of_postures(&self) -> impl Iterator<Item = usize> + '_ {
        self.starts.taking.iter().map(Start::rows)
    }

    /// Closes each posture of a chunk in turn and hands it on with the rows of its samples.
    fn visit(
        &self,
        starts: &[Start<'_>],
        geometry: &Geometry,
        mut visit: impl FnMut(&Postures, &Evaluation),
    ) -> Result<(), EvalError> {
        let mut postures = self.home.clone();
        let mut rows = PostureRows::default();
        for start in starts {
            let open = |why: NotClosed| EvalError(format!("{}: {}", start.sample.name, why.unitless()));
            postures.first.set_turns(&start.closing.turns);
            postures.first.close(self.mechanism, geometry).map_err(open)?;
            if start.sample.measurement.second().is_some() {
                postures.second.set_turns(&start.closing.second);
                postures.second.close(self.mechanism, geometry).map_err(open)?;
            }
            visit(&postures, rows.evaluate(start.samples(), &postures, geometry)?);
        }
        Ok(())
    }

    /// `work` on every chunk of the postures, in their order; on this thread where there is but one.
    fn by_chunks<T: Send>(
        &self,
        work: impl Fn(&[Start<'_>]) -> Result<T, EvalError> + Sync + Send,
    ) -> Result<Vec<T>, EvalError> {
        if self.starts.taking.len() <= CHUNK {
            return Ok(vec![work(&self.starts.taking)?]);
        }
        self.starts.taking.par_chunks(CHUNK).map(work).collect()
    }

    /// Compressed rows in slice columns, before coordinates are chosen.
    fn compress_slice(&self, geometry: &Geometry) -> Result<Compressed, EvalError> {
        let columns = self.coordinates.slice_count();
        let chunk = |starts: &[Start<'_>]| -> Result<Compressed, EvalError> {
            let expected = starts.iter().map(Start::rows).sum();
            let mut stream = RowStream::new(columns, expected);
            let mut writer = RowWriter::default();
            self.visit(starts, geometry, |postures, sample| {
                let block = stream.next(sample.rows.len());
                writer.write(self.mechanism, &self.coordinates, postures, sample, block);
                stream.add_square(sample.square());
            })?;
            Ok(stream.finish())
        };
        let mut parts = self.by_chunks(chunk)?;
        if parts.len() == 1
            && let Some(only) = parts.pop()
        {
            return Ok(only);
        }
        let mut stream = RowStream::new(columns, parts.iter().map(|part| part.r.len()).sum());
        for part in parts {
            stream.push(&part);
        }
        Ok(stream.finish())
    }

    /// All rows `[J r]` in slice columns, the minimal Jacobian in its cheapest coordinates: column-major, m x
    /// (count + 1), written over `data`.
    pub fn slice_rows(&self, geometry: &Geometry, data: &mut Vec<f64>) -> Result<(), EvalError> {
        let total = self.rows();
        data.resize(total * (self.coordinates.slice_count() + 1), 0.0);
        let mut first = 0;
        let mut writer = RowWriter::default();
        self.visit(&self.starts.taking, geometry, |postures, sample| {
            let block = RowBlock::new(data, total, first, sample.rows.len());
            writer.write(self.mechanism, &self.coordinates, postures, sample, block);
            first += sample.rows.len();
        })
    }

    /// Residual and Jacobian at `x`, posture by posture, and the derivative of each row by the tool twist.
    pub fn linearize_with_twists(&self, x: &[f64]) -> Result<(Linearized, Vec<[f64; 6]>), EvalError> {
        let (_, geometry) = self.at(x);
        let mut twists = Vec::with_capacity(self.rows());
        self.visit(&self.starts.taking, &geometry, |_, sample| {
            twists.extend(sample.rows.iter().map(|row| row.by_tool))
        })?;
        Ok((self.linearize(x)?, twists))
    }

    /// The same with only these of the postures that take part, closed from where they are closed here.
    pub fn only(&self, postures: Range<usize>) -> Self {
        Self {
            mechanism: self.mechanism,
            coordinates: self.coordinates.clone(),
            home: self.home.clone(),
            starts: self.starts.only(postures),
            params: self.params.clone(),
            groups: self.groups.clone(),
            minimal: self.minimal.clone(),
        }
    }

    fn at(&self, x: &[f64]) -> (Vec<f64>, Geometry) {
        let d = self.coordinates.deviations(x);
        let geometry = self.mechanism.deviated(&d);
        (d, geometry)
    }

    /// `a * blockdiag(transforms)`, limb by limb.
    fn carry(&self, a: MatRef<'_, f64>, transforms: &[Mat<f64>]) -> Mat<f64> {
        let mut out = Mat::zeros(a.nrows(), self.coordinates.count());
        for (limb, transform) in self.coordinates.blocks().zip(transforms) {
            let columns = a.get(.., limb.slice_offset..limb.slice_offset + limb.slice.len());
            if transform.ncols() != limb.count {
                // Motions that limbs share are coordinates of all of them.
                let mut all = out.as_mut().subcols_mut(0, transform.ncols());
                all += columns * transform;
                continue;
            }
            out.as_mut().subcols_mut(limb.offset, limb.count).copy_from(columns * transform);
        }
        narrow();
        out
    }
}

impl Problem for Calibration<'_> {
    fn params(&self) -> &[Param] {
        &self.params
    }

    fn groups(&self) -> &[Group] {
        &self.groups
    }

    fn has_prior(&self) -> bool {
        true
    }

    fn residual(&self, x: &[f64]) -> Result<Vec<f64>, EvalError> {
        let (_, geometry) = self.at(x);
        let chunk = |starts: &[Start<'_>]| -> Result<Vec<f64>, EvalError> {
            let mut r = Vec::new();
            self.visit(starts, &geometry, |_, sample| r.extend(sample.rows.iter().map(|row| row.r)))?;
            Ok(r)
        };
        Ok(self.by_chunks(chunk)?.concat())
    }

    fn linearize(&self, x: &[f64]) -> Result<Linearized, EvalError> {
        let (d, geometry) = self.at(x);
        let (m, columns) = (self.rows(), self.coordinates.slice_count());
        let mut data = Vec::new();
        self.slice_rows(&geometry, &mut data)?;
        let (jac, r) = data.split_at(m * columns);
        let transforms = self.coordinates.transforms(self.mechanism, &geometry, &d);
        let jac = MatRef::from_column_major_slice(jac, m, columns);
        Ok(Linearized { r: r.to_vec(), jac: self.carry(jac, &transforms) })
    }

    fn compress(&self, x: &[f64]) -> Result<Compressed, EvalError> {
        let (d, geometry) = self.at(x);
        let sliced = self.compress_slice(&geometry)?;
        let transforms = self.coordinates.transforms(self.mechanism, &geometry, &d);
        Ok(Compressed { jac: self.carry(sliced.jac.as_ref(), &transforms), r: sliced.r, cost: sliced.cost })
    }

    fn gradient(&self, x: &[f64]) -> Result<(f64, Vec<f64>), EvalError> {
        let (d, geometry) = self.at(x);
        let columns = self.coordinates.slice_count();
        let chunk = |starts: &[Start<'_>]| -> Result<(f64, Vec<f64>), EvalError> {
            let (mut square, mut by_slice) = (0.0, vec![0.0; columns]);
            let mut writer = RowWriter::default();
            let mut data = vec![0.0; columns + 1];
            self.visit(starts, &geometry, |postures, sample| {
                // r'J is linear in the rows: their sum is carried through the machine as one.
                let block = RowBlock::new(&mut data, 1, 0, 1);
                writer.write(self.mechanism, &self.coordinates, postures, &sample.weighted_sum(), block);
                by_slice.iter_mut().zip(&data).for_each(|(sum, part)| *sum += part);
                square += sample.square();
            })?;
            Ok((square, by_slice))
        };
        let (mut square, mut by_slice) = (0.0, vec![0.0; columns]);
        for (part, by_part) in self.by_chunks(chunk)? {
            square += part;
            by_slice.iter_mut().zip(by_part).for_each(|(sum, part)| *sum += part);
        }
        let by_x = self.coordinates.pull_back(self.mechanism, &geometry, &d, &by_slice);
        Ok((0.5 * square, by_x))
    }

    /// One block a posture.
    fn blocks(&self) -> Vec<Range<usize>> {
        let mut next = 0;
        let block = |rows: usize| {
            next += rows;
            next - rows..next
        };
        self.rows_of_postures().map(block).collect()
    }

    /// One part a limb, where every posture was measured as a whole pose and nothing else is unknown.
    fn parts(&self) -> Option<Vec<Part<'_>>> {
        if self.coordinates.instrument.count > 0 {
            return None;
        }
        let parts = self.limbs()?.into_iter();
        Some(parts.map(|(of, members)| Part { problem: Box::new(of), members: members.collect() }).collect())
    }

    fn representative(&self, x: &[f64]) -> Option<Representative> {
        if self.coordinates.form != Form::Complete || self.coordinates.shares_motions() {
            return None;
        }
        let minimal = self.minimal.get_or_init(|| Coordinates::new(self.mechanism, Form::Minimal));
        let (d, geometry) = self.at(x);
        Some(with_derivative(self.mechanism, minimal, &geometry, &d))
    }

    fn redundant(&self, x: &[f64]) -> Mat<f64> {
        let (d, geometry) = self.at(x);
        self.coordinates.redundant(self.mechanism, &geometry, &d)
    }
}
