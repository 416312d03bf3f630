//! Where the machine was placed and its tool mounted: the one rigid motion that all first links have in common, or all last
//! ones, with its standard error, and what each link deviates beside it.
//!
//! With `g_i0 = X N_i exp(r_i)` the motion `X` is the one beside which the links deviate least in their tolerances, one far
//! off counting less: one wrong joint does not move the others. Links without tolerances are weighed by their standard
//! errors. Likewise `g_if = N_i exp(r_i) Y` (docs/theory.md (10.16)).

use super::link_weight::{by_errors, variances, without_idle};
use super::registration::FreeEnds;
use super::run::Identification;
use crate::lie::se3::{self, Twist};
use crate::lie::{Se3, so3};
use crate::model::{Limb, Link, Mechanism, Motion, Tolerance};
use faer::Mat;
use nalgebra::Matrix6;

/// Most rounds of weights.
const ROUNDS: usize = 200;
/// Step, rad or machine sizes, at which the motion stands.
const SETTLED: f64 = 1e-13;
/// Standard error added to that of each link, rad and machine sizes: what does not matter.
const FLOOR: f64 = 1e-5;
/// The same where no standard errors are known.
const UNKNOWN: f64 = 1e-2;
/// Turn, rad or m, that is left of what a passive joint makes up for.
const TURNED: f64 = 1e-14;
/// Standard error of what is no error at all, rad or machine sizes.
const ARBITRARY: f64 = 1e3;
/// Tolerance of what is free beside something that is stated, rad and machine sizes.
const LOOSE: f64 = 1.0;

/// A rigid motion of the whole machine at its base, or of the tool.
#[derive(Clone, Debug, PartialEq)]
pub struct Mount {
    /// The motion, m.
    pub pose: Se3,
    /// Standard error of its rotation vector (rad) and displacement (m), in the axes of {S}, or of the tool as drawn;
    /// `None` where linear theory does not apply.
    pub std: Option<[f64; 6]>,
    /// What the link of each limb deviates beside it.
    pub beside: Vec<Beside>,
}

/// Deviation of a link beside the motion, rad and m.
#[derive(Clone, Debug, PartialEq)]
pub struct Beside {
    /// Index of the link among those of all limbs.
    pub link: usize,
    /// The deviation.
    pub deviation: [f64; 6],
    /// Its standard errors; `None` where linear theory does not apply.
    pub std: Option<[f64; 6]>,
}

/// Placement and tool mounting; `None` of an end of which nothing is to be found.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mounts {
    /// In front of all first links.
    pub placement: Option<Mount>,
    /// Behind all last links.
    pub tool_mounting: Option<Mount>,
}

impl Mounts {
    /// Of what was found of a drawing.
    pub fn of(drawn: &Mechanism, found: &Identification) -> Self {
        let FreeEnds { base, tool } = FreeEnds::of(drawn);
        let ends = drawn.ends;
        let free =
            FreeEnds { base: base || ends.placement.is_some(), tool: tool || ends.tool_mounting.is_some() };
        if !free.base && !free.tool {
            return Self::default();
        }
        let root = found.link_root().map(|links| links.root);
        let length = drawn.characteristic_length();
        let mount = |end| common(end, drawn, found, root.as_ref(), length);
        Self {
            placement: free.base.then(|| mount(End::Base)),
            tool_mounting: free.tool.then(|| mount(End::Tool)),
        }
    }

    /// Deviations of all links beside placement and mounting, where `deviations` are those from the drawing.
    pub fn beside(&self, deviations: &[f64]) -> Vec<f64> {
        let mut out = deviations.to_vec();
        for link in self.links() {
            out[6 * link.link..6 * link.link + 6].copy_from_slice(&link.deviation);
        }
        out
    }

    /// Every link that deviates beside a motion.
    pub fn links(&self) -> impl Iterator<Item = &Beside> {
        [&self.placement, &self.tool_mounting].into_iter().flatten().flat_map(|mount| &mount.beside)
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum End {
    Base,
    Tool,
}

/// One limb's link at an end.
struct One {
    link: usize,
    nominal: Se3,
    found: Se3,
    /// What the link deviates by itself, in the tolerances that the data support.
    tolerance: Tolerance,
    /// Errors of one standard deviation, a column each: body twists of the link.
    root: Option<Mat<f64>>,
    /// A twist that changes nothing but the zero of a passive joint.
    idle: Option<Twist>,
}

impl One {
    /// The deviation beside the motion.
    fn beside(&self, end: End, motion: &Se3) -> Twist {
        let r = match end {
            End::Base => self.nominal.inverse() * (motion.inverse() * self.found),
            End::Tool => self.nominal.inverse() * self.found * motion.inverse(),
        };
        let Some(idle) = self.idle else { return se3::log(&r) };
        let (mut left, mut turned) = (se3::log(&r), 0.0);
        for _ in 0..ROUNDS {
            let more = idle.dot(&left) / idle.norm_squared();
            if more.is_nan() || more.abs() < TURNED {
                break;
            }
            turned += more;
            let back = se3::exp(&(idle * -turned));
            left = se3::log(&match end {
                End::Base => r * back,
                End::Tool => back * r,
            });
        }
        left
    }

    fn without_idle(&self, r: &Twist) -> Twist {
        self.idle.map_or(*r, |idle| r - idle * (idle.dot(r) / idle.norm_squared()))
    }

    /// By how much it falls for a twist of the motion: body twists at the base, spatial ones at the tool.
    fn by_motion(&self, end: End, motion: &Se3) -> Matrix6<f64> {
        match end {
            End::Base => se3::adjoint(&(self.found.inverse() * *motion)),
            End::Tool => Matrix6::identity(),
        }
    }

    /// Errors of the deviation, a column each, those of the motion left aside.
    fn errors(&self, end: End, motion: &Se3) -> Vec<Twist> {
        let Some(root) = &self.root else { return Vec::new() };
        let turn = match end {
            End::Base => Matrix6::identity(),
            End::Tool => se3::adjoint(motion),
        };
        (0..root.ncols()).map(|j| turn * Twist::from_fn(|i, _| root[(i, j)])).collect()
    }

    /// Inverse of the covariance of the deviation: of what the link's tolerance makes it or, where that is free, of its
    /// errors. A turn that a passive joint makes up for counts for nothing.
    fn weight(&self, errors: &[Twist], length: f64) -> Matrix6<f64> {
        let weight = match variances(self.tolerance, LOOSE, length) {
            Some(own) => Matrix6::from_diagonal(&own.map(f64::recip)),
            None => {
                let least = if self.root.is_some() { FLOOR } else { UNKNOWN };
                let floor = Twist::from_fn(|i, _| f64::powi(if i < 3 { least } else { least * length }, 2));
                by_errors(&floor, errors)
            }
        };
        self.idle.map_or(weight, |idle| without_idle(&weight, &idle))
    }
}

/// The motion on its way.
struct Sought {
    motion: Se3,
    /// What of a link's error becomes one of the motion.
    shares: Vec<Matrix6<f64>>,
    /// Covariance of the motion, the links being known.
    covariance: Matrix6<f64>,
}

/// The motion of the least sum over links, from `motion`; `power` of the distance of a link by which it counts less.
fn sought(end: End, ones: &[One], stated: Option<Twist>, length: f64, power: i32, motion: Se3) -> Sought {
    let mut at = Sought { motion, shares: Vec::new(), covariance: Matrix6::zeros() };
    for _ in 0..ROUNDS {
        let (mut matrix, mut right) = (Matrix6::zeros(), Twist::zeros());
        at.shares.clear();
        for one in ones {
            let weight = one.weight(&one.errors(end, &at.motion), length);
            let r = one.beside(end, &at.motion);
            let far = (r.dot(&(weight * r)) / 6.0).sqrt().max(1.0).powi(power);
            let by = one.by_motion(end, &at.motion);
            let share = by.transpose() * weight / far;
            matrix += share * by;
            right += share * r;
            at.shares.push(share);
        }
        if let Some(stated) = stated {
            let weight = Matrix6::from_diagonal(&stated.map(f64::recip));
            let by = Matrix6::from_fn(|i, j| {
                displacement(end, &at.motion, &Twist::from_fn(|k, _| f64::from(u8::from(k == j))))[i]
            });
            matrix += by.transpose() * weight * by;
            right -= by.transpose() * weight * se3::join(&so3::log(&at.motion.r), &at.motion.p);
        }
        let Some(inverse) = matrix.try_inverse() else { break };
        let step = inverse * right;
        at.motion = match end {
            End::Base => at.motion * se3::exp(&step),
            End::Tool => se3::exp(&step) * at.motion,
        };
        at.shares.iter_mut().for_each(|share| *share = inverse * *share);
        at.covariance = inverse;
        if step.fixed_rows::<3>(0).norm() + step.fixed_rows::<3>(3).norm() / length < SETTLED {
            break;
        }
    }
    at
}

fn common(
    end: End,
    drawn: &Mechanism,
    found: &Identification,
    root: Option<&Mat<f64>>,
    length: f64,
) -> Mount {
    let ones = ones(end, drawn, found, root);
    let (start, tolerance) = match end {
        End::Base => (found.placed.0, found.supported.ends.placement),
        End::Tool => (found.placed.1, found.supported.ends.tool_mounting),
    };
    let stated = tolerance.and_then(|tolerance| variances(tolerance, ARBITRARY, length));
    let mut at = sought(end, &ones, stated, length, 1, start);
    // Scatter within tolerances is part of what is not known of the motion; errors of free links are so already.
    let by_tolerances = ones.iter().any(|one| variances(one.tolerance, LOOSE, length).is_some());
    if by_tolerances {
        at = sought(end, &ones, stated, length, 2, at.motion);
    }
    let Sought { motion, shares, covariance } = at;
    let scatter: Vec<Twist> = match covariance.cholesky().filter(|_| by_tolerances) {
        Some(factor) => factor.l().column_iter().map(|column| column.into_owned()).collect(),
        None => Vec::new(),
    };
    let columns = root.map(Mat::ncols);
    let errors: Vec<Vec<Twist>> = ones.iter().map(|one| one.errors(end, &motion)).collect();
    let of_motion: Option<Vec<Twist>> = columns.map(|count| {
        let error = |j: usize| shares.iter().zip(&errors).map(|(share, of)| share * of[j]).sum();
        (0..count).map(error).chain(scatter.iter().copied()).collect()
    });
    let std = of_motion.as_ref().map(|errors| spread(errors.iter().map(|e| displacement(end, &motion, e))));
    let beside = ones.iter().zip(&errors).map(|(one, errors)| {
        let by = one.by_motion(end, &motion);
        let std = of_motion.as_ref().map(|of_motion| {
            // The scatter is no error of the link's.
            let own = errors.iter().copied().chain(std::iter::repeat(Twist::zeros()));
            spread(own.zip(of_motion).map(|(own, common)| one.without_idle(&(own - by * common))))
        });
        Beside { link: one.link, deviation: one.beside(end, &motion).into(), std }
    });
    Mount { pose: motion, std, beside: beside.collect() }
}

/// Rotation and displacement of the motion's origin, in the axes in front of it.
fn displacement(end: End, motion: &Se3, error: &Twist) -> Twist {
    let (w, v) = se3::split(error);
    match end {
        End::Base => se3::join(&(motion.r * w), &(motion.r * v)),
        End::Tool => se3::join(&w, &(v + so3::hat(&w) * motion.p)),
    }
}

fn spread(errors: impl Iterator<Item = Twist>) -> [f64; 6] {
    let sum = errors.fold(Twist::zeros(), |sum, error| sum + error.component_mul(&error));
    sum.map(f64::sqrt).into()
}

fn ones(end: End, drawn: &Mechanism, found: &Identification, root: Option<&Mat<f64>>) -> Vec<One> {
    let mut ones = Vec::with_capacity(drawn.limbs.len());
    let mut first = 0;
    let supported = found.supported.limbs.iter().map(|limb| &limb.links);
    for ((limb, links), supported) in drawn.limbs.iter().zip(&found.geometry.limbs).zip(supported) {
        let at = match end {
            End::Base => 0,
            End::Tool => links.len() - 1,
        };
        if let (Some(Link { nominal, .. }), Some(found), Some(link)) =
            (limb.links.get(at), links.get(at), supported.get(at))
        {
            let tolerance = link.tolerance;
            let link = first + at;
            let rows = |root: &Mat<f64>| Mat::from_fn(6, root.ncols(), |i, j| root[(6 * link + i, j)]);
            let root = root.map(rows);
            ones.push(One { link, nominal: *nominal, found: *found, tolerance, root, idle: idle(end, limb) });
        }
        first += links.len();
    }
    ones
}

/// What the joint at the end makes up for by its own motion, where nobody reads it.
fn idle(end: End, limb: &Limb) -> Option<Twist> {
    let joint = match end {
        End::Base => limb.joints.first()?,
        End::Tool => limb.joints.last()?,
    };
    let own = match joint.motion {
        Motion::Prismatic => [0.0, 0.0, 0.0, 0.0, 0.0, 1.0],
        Motion::Revolute => [0.0, 0.0, 1.0, 0.0, 0.0, 0.0],
        Motion::Helical { advance } => [0.0, 0.0, 1.0, 0.0, 0.0, advance],
    };
    let own = Twist::from_column_slice(&own);
    let carried = match end {
        End::Base => own,
        End::Tool => se3::adjoint(&limb.links.last()?.nominal.inverse()) * own,
    };
    (!joint.actuated && !joint.sensed).then_some(carried)
}
