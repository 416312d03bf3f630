//! The continuous relaxations of D- and A-optimality as conic programs (Sagnol 2011; Sagnol & Harman 2015), for clarabel.

use clarabel::algebra::CscMatrix;
use clarabel::solver::{DefaultSettings, DefaultSolver, IPSolver, SolverStatus, SupportedConeT};
use faer::{Mat, Side};
use gough::design::Information;
use gough::design::information::ROWS;

/// Rows `b - A x` that lie in cones, entry by entry.
#[derive(Default)]
struct Program {
    entries: Vec<(usize, usize, f64)>,
    right: Vec<f64>,
    cones: Vec<SupportedConeT<f64>>,
    cost: Vec<f64>,
}

impl Program {
    fn variable(&mut self, cost: f64) -> usize {
        self.cost.push(cost);
        self.cost.len() - 1
    }

    /// One row with the value `constant + sum of terms`.
    fn row(&mut self, terms: &[(usize, f64)], constant: f64) {
        let row = self.right.len();
        self.entries.extend(terms.iter().map(|(column, value)| (row, *column, -value)));
        self.right.push(constant);
    }

    /// `|v|^2 <= t w`, `w` a variable or 1.
    fn rotated(&mut self, t: usize, w: Option<usize>, v: &[usize]) {
        let both = |sign: f64| match w {
            Some(w) => (vec![(t, 1.0), (w, sign)], 0.0),
            None => (vec![(t, 1.0)], sign),
        };
        let (sum, difference) = (both(1.0), both(-1.0));
        self.row(&sum.0, sum.1);
        self.row(&difference.0, difference.1);
        for &v in v {
            self.row(&[(v, 2.0)], 0.0);
        }
        self.cones.push(SupportedConeT::SecondOrderConeT(v.len() + 2));
    }

    fn solve(&self) -> f64 {
        let (rows, columns) = (self.right.len(), self.cost.len());
        let (mut i, mut j, mut v) = (Vec::new(), Vec::new(), Vec::new());
        for &(row, column, value) in &self.entries {
            i.push(row);
            j.push(column);
            v.push(value);
        }
        let a = CscMatrix::new_from_triplets(rows, columns, i, j, v);
        let p = CscMatrix::zeros((columns, columns));
        let settings = DefaultSettings { verbose: false, ..DefaultSettings::default() };
        let mut solver = DefaultSolver::new(&p, &self.cost, &a, &self.right, &self.cones, settings).unwrap();
        solver.solve();
        assert!(matches!(solver.solution.status, SolverStatus::Solved), "{:?}", solver.solution.status);
        solver.solution.obj_val
    }

    /// Weights of all candidates between 0 and 1, their sum `poses`.
    fn weights(&mut self, count: usize, poses: usize) -> Vec<usize> {
        let weights: Vec<usize> = (0..count).map(|_| self.variable(0.0)).collect();
        let all: Vec<(usize, f64)> = weights.iter().map(|w| (*w, 1.0)).collect();
        self.row(&all, -(poses as f64));
        self.cones.push(SupportedConeT::ZeroConeT(1));
        for &w in &weights {
            self.row(&[(w, 1.0)], 0.0);
            self.row(&[(w, -1.0)], 1.0);
        }
        self.cones.push(SupportedConeT::NonnegativeConeT(2 * count));
        weights
    }
}

/// Rows of every candidate, and of the prior as one more.
fn parts(info: &Information) -> Vec<Mat<f64>> {
    let mut parts: Vec<Mat<f64>> =
        (0..info.count()).map(|i| info.rows.get(ROWS * i..ROWS * (i + 1), ..).to_owned()).collect();
    parts.push(info.base.llt(Side::Lower).unwrap().L().transpose().to_owned());
    parts
}

/// Largest `log det M(w)`.
pub fn d_optimum(info: &Information, poses: usize) -> f64 {
    let k = info.scale.len();
    let mut program = Program::default();
    let weights = program.weights(info.count(), poses);
    let parts = parts(info);
    let z: Vec<Vec<Vec<usize>>> = parts
        .iter()
        .map(|part| (0..k).map(|_| (0..part.nrows()).map(|_| program.variable(0.0)).collect()).collect())
        .collect();
    let entry = |r: usize, c: usize| -> Vec<(usize, f64)> {
        let of = |(part, z): (&Mat<f64>, &Vec<Vec<usize>>)| -> Vec<(usize, f64)> {
            (0..part.nrows()).map(|q| (z[c][q], part[(q, r)])).collect()
        };
        parts.iter().zip(&z).flat_map(of).collect()
    };
    for c in 0..k {
        for r in 0..c {
            program.row(&entry(r, c), 0.0);
        }
    }
    program.cones.push(SupportedConeT::ZeroConeT(k * (k - 1) / 2));
    for c in 0..k {
        let mut sum = entry(c, c);
        for (i, z) in z.iter().enumerate() {
            let t = program.variable(0.0);
            program.rotated(t, weights.get(i).copied(), &z[c]);
            sum.push((t, -1.0));
        }
        program.row(&sum, 0.0);
        program.cones.push(SupportedConeT::NonnegativeConeT(1));
        let logarithm = program.variable(-1.0);
        program.row(&[(logarithm, 1.0)], 0.0);
        program.row(&[], 1.0);
        program.row(&entry(c, c), 0.0);
        program.cones.push(SupportedConeT::ExponentialConeT());
    }
    -program.solve()
}

/// Least sum of the variances of the kept directions.
pub fn a_optimum(info: &Information, poses: usize) -> f64 {
    let kept: Vec<usize> = (0..info.scale.len()).filter(|&i| info.scale[i].powi(2) < 0.5).collect();
    let mut program = Program::default();
    let weights = program.weights(info.count(), poses);
    let parts = parts(info);
    let y: Vec<Vec<Vec<usize>>> = parts
        .iter()
        .map(|part| kept.iter().map(|_| (0..part.nrows()).map(|_| program.variable(0.0)).collect()).collect())
        .collect();
    for (c, &direction) in kept.iter().enumerate() {
        for r in 0..info.scale.len() {
            let of = |(part, y): (&Mat<f64>, &Vec<Vec<usize>>)| -> Vec<(usize, f64)> {
                (0..part.nrows()).map(|q| (y[c][q], part[(q, r)])).collect()
            };
            let terms: Vec<(usize, f64)> = parts.iter().zip(&y).flat_map(of).collect();
            program.row(&terms, if r == direction { -info.scale[r] } else { 0.0 });
        }
    }
    program.cones.push(SupportedConeT::ZeroConeT(kept.len() * info.scale.len()));
    for (i, y) in y.iter().enumerate() {
        let u = program.variable(1.0);
        program.rotated(u, weights.get(i).copied(), &y.concat());
    }
    program.solve()
}
