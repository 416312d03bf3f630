//! Where the machine was placed and its tool mounted: the one rigid motion that all first links have in common, or all last
//! ones, with its standard error, and what each link deviates beside it.
//!
//! With `g_i0 = X N_i exp(r_i)` the motion `X` is the one beside which as few links as possible deviate: the sum of the
//! lengths of the `r_i` in their standard errors is least, so that one wrong joint does not move the others. Likewise
//! `g_if = N_i exp(r_i) Y`.

use super::registration::FreeEnds;
use super::run::Identification;
use crate::lie::se3::{self, Twist};
use crate::lie::{Se3, so3};
use crate::model::{Limb, Link, Mechanism, Motion};
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

    /// Inverse of the covariance of the deviation.
    fn weight(&self, errors: &[Twist], length: f64) -> Matrix6<f64> {
        let least = if self.root.is_some() { FLOOR } else { UNKNOWN };
        let mut covariance = Matrix6::from_diagonal(&Twist::from_fn(|i, _| {
            f64::powi(if i < 3 { least } else { least * length }, 2)
        }));
        for error in errors {
            covariance += error * error.transpose();
        }
        if let Some(idle) = self.idle {
            covariance += idle * idle.transpose() * ARBITRARY.powi(2);
        }
        covariance.try_inverse().unwrap_or_else(Matrix6::identity)
    }
}

fn common(
    end: End,
    drawn: &Mechanism,
    found: &Identification,
    root: Option<&Mat<f64>>,
    length: f64,
) -> Mount {
    let ones = ones(end, drawn, found, root);
    let mut motion = match end {
        End::Base => found.placed.0,
        End::Tool => found.placed.1,
    };
    let mut shares = Vec::new();
    for _ in 0..ROUNDS {
        let (mut matrix, mut right) = (Matrix6::zeros(), Twist::zeros());
        shares.clear();
        for one in &ones {
            let weight = one.weight(&one.errors(end, &motion), length);
            let r = one.beside(end, &motion);
            let far = (r.dot(&(weight * r)) / 6.0).sqrt().max(1.0);
            let by = one.by_motion(end, &motion);
            let share = by.transpose() * weight / far;
            matrix += share * by;
            right += share * r;
            shares.push(share);
        }
        let Some(inverse) = matrix.try_inverse() else { break };
        let step = inverse * right;
        motion = match end {
            End::Base => motion * se3::exp(&step),
            End::Tool => se3::exp(&step) * motion,
        };
        shares.iter_mut().for_each(|share| *share = inverse * *share);
        if step.fixed_rows::<3>(0).norm() + step.fixed_rows::<3>(3).norm() / length < SETTLED {
            break;
        }
    }
    let columns = root.map(Mat::ncols);
    let errors: Vec<Vec<Twist>> = ones.iter().map(|one| one.errors(end, &motion)).collect();
    let of_motion: Option<Vec<Twist>> = columns.map(|count| {
        let error = |j: usize| shares.iter().zip(&errors).map(|(share, of)| share * of[j]).sum();
        (0..count).map(error).collect()
    });
    let std = of_motion.as_ref().map(|errors| spread(errors.iter().map(|e| displacement(end, &motion, e))));
    let beside = ones.iter().zip(&errors).map(|(one, errors)| {
        let by = one.by_motion(end, &motion);
        let std = of_motion.as_ref().map(|of_motion| {
            spread(errors.iter().zip(of_motion).map(|(own, common)| one.without_idle(&(own - by * common))))
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
    for (limb, links) in drawn.limbs.iter().zip(&found.geometry.limbs) {
        let at = match end {
            End::Base => 0,
            End::Tool => links.len() - 1,
        };
        if let (Some(Link { nominal, .. }), Some(found)) = (limb.links.get(at), links.get(at)) {
            let link = first + at;
            let rows = |root: &Mat<f64>| Mat::from_fn(6, root.ncols(), |i, j| root[(6 * link + i, j)]);
            let root = root.map(rows);
            ones.push(One { link, nominal: *nominal, found: *found, root, idle: idle(end, limb) });
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
