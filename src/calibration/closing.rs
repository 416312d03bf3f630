//! Where the loops of samples are closed, with one set of links after another (docs/theory.md section 7).
//!
//! A sample keeps the posture in which it was closed. Where its reading stands out from the others', or its loops do not
//! close, other postures at the same actuator variables are tried, and the one that explains the reading is taken.

use super::evaluate::PostureRows;
use super::postures::telling;
use super::sample::{Postures, Sample, close_again};
use crate::model::{Geometry, Mechanism, NotClosed, Turn};
use rayon::prelude::*;

/// Mean square of a sample's residuals, in medians of all, from which other postures are looked for.
pub(super) const STANDS_OUT: f64 = 25.0;
/// The same, where residuals are rounding: 1e-6 of the noise.
const NOTHING: f64 = 1e-12;

/// A closed posture, and the second one where two are compared.
#[derive(Clone, Debug)]
pub(super) struct Closing {
    /// Joint variables.
    pub turns: Vec<Turn>,
    /// Those of the second posture; empty where there is one.
    pub second: Vec<Turn>,
    /// Sign of the determinant of the first posture's wrenches.
    pub mode: f64,
    /// Mean square of the residuals; 0 where nobody asks.
    pub square: f64,
    /// Ratio of the extreme singular values of the wrench matrix; 1 where nobody asks.
    pub regularity: f64,
    /// Whether it is the posture in which the sample was closed before.
    pub kept: bool,
}

/// What was measured at one posture.
pub(super) type Together<'a> = Vec<&'a Sample>;

/// Measured postures to be closed with given links.
pub(super) struct Closer<'a> {
    pub mechanism: &'a Mechanism,
    pub geometry: &'a Geometry,
    /// Postures at home, from which those of a thread are copied.
    pub home: &'a Postures,
    pub postures: &'a [Together<'a>],
    /// Whether to tell how regular the postures are.
    pub regularity: bool,
}

pub(super) type Work = (Postures, PostureRows);

impl Closer<'_> {
    pub(super) fn work(&self) -> Work {
        (self.home.clone(), PostureRows::default())
    }

    /// Every sample, from where it is `known` to close, and where that does not explain its reading elsewhere.
    pub fn close(&self, known: &[Option<Closing>]) -> Vec<Result<Closing, NotClosed>> {
        let mut closed = self.follow(known);
        let limit = STANDS_OUT * typical(&closed);
        if self.mechanism.is_open_chain() || !limit.is_finite() {
            return closed;
        }
        let fits = |outcome: &Result<Closing, NotClosed>| outcome.as_ref().is_ok_and(|c| c.square <= limit);
        let doubtful: Vec<usize> = (0..closed.len()).filter(|&i| !fits(&closed[i])).collect();
        let better: Vec<(usize, Closing)> = doubtful
            .par_iter()
            .filter_map(|&index| Some((index, self.elsewhere(index, &closed, limit)?)))
            .collect();
        for (index, closing) in better {
            closed[index] = Ok(closing);
        }
        closed
    }

    /// Every posture, from where it is `known` to close.
    pub fn follow(&self, known: &[Option<Closing>]) -> Vec<Result<Closing, NotClosed>> {
        let one = |work: &mut Work, (index, of): (usize, &Together<'_>)| {
            let Some(sample) = telling(of.iter().copied()) else { return Err(NotClosed::NotFinite) };
            let again =
                known.get(index).and_then(Option::as_ref).is_some_and(|at| self.again(at, sample, work));
            if !again {
                sample.close_all(self.mechanism, self.geometry, &mut work.0)?;
            }
            Ok(Closing { kept: again, ..self.closing(of, work) })
        };
        if self.mechanism.is_open_chain() {
            // Nothing to close: sharing the work among threads would cost more than it.
            let mut work = self.work();
            return self.postures.iter().enumerate().map(|at| one(&mut work, at)).collect();
        }
        self.postures.par_iter().enumerate().map_init(|| self.work(), one).collect()
    }

    /// Whether the sample closes from where it was closed.
    fn again(&self, at: &Closing, sample: &Sample, (postures, _): &mut Work) -> bool {
        close_again(self.mechanism, self.geometry, &at.turns, &mut postures.first)
            && (sample.measurement.second().is_none()
                || close_again(self.mechanism, self.geometry, &at.second, &mut postures.second))
    }

    /// What is kept of a closed posture.
    pub(super) fn closing(&self, of: &Together<'_>, (postures, rows): &mut Work) -> Closing {
        let two = of.first().is_some_and(|sample| sample.measurement.second().is_some());
        let (mut square, mut regularity) = (0.0, 1.0);
        if !self.mechanism.is_open_chain() {
            let evaluated = rows.evaluate(of.iter().copied(), postures, self.geometry);
            square = evaluated.map_or(f64::INFINITY, |e| e.square() / e.rows.len().max(1) as f64);
            if self.regularity {
                let second = if two { postures.second.regularity() } else { 1.0 };
                regularity = postures.first.regularity().min(second);
            }
        }
        Closing {
            turns: postures.first.turns().to_vec(),
            second: if two { postures.second.turns().to_vec() } else { Vec::new() },
            mode: postures.first.mode,
            square,
            regularity,
            kept: false,
        }
    }
}

/// Mean square of the median sample's residuals.
pub(super) fn typical(closed: &[Result<Closing, NotClosed>]) -> f64 {
    let mut squares: Vec<f64> = closed.iter().flatten().map(|closing| closing.square).collect();
    squares.sort_by(f64::total_cmp);
    squares.get(squares.len() / 2).map_or(f64::INFINITY, |median| median + NOTHING)
}
