//! Coordinates of link deviations, per limb (docs/theory.md section 6).
//!
//! Three sets of numbers describe the errors of one limb:
//! - the body twists of its links (complete, 6 per link), in which the kinematics is differentiated;
//! - a *slice* of them, as many as are not redundant, whose columns are single joint-like screws and therefore
//!   cheap; every redundant direction is a combination that leaves the slice;
//! - the coordinates `x` that an identifier sees, in which the prior is a unit sphere.
//!
//! Jacobians are assembled in the slice, compressed there, and only then carried to `x` by one small matrix a
//! limb. This never multiplies the tall Jacobian by a basis.

use super::redundancy::{pivot_rows, redundancy};
use super::shared::Shared;
use crate::lie::Se3;
use crate::linalg;
use crate::model::{Constant, Limb, Mechanism, Prior, Quantity};
use crate::problem::{Form, Group, Param};
use faer::Mat;

/// Sigma that stands for no prior on a constant of the instrument, in rad, in machine sizes or 1.
const FREE: f64 = 1.0;
/// The same on a link, whose place is known by registration: far beyond what registration leaves, and near enough that
/// valleys of links that replace each other are not followed for hundreds of steps.
pub(super) const FREE_LINK: f64 = 0.1;

/// Coordinates of all limbs.
#[derive(Clone, Debug)]
pub struct Coordinates {
    /// One entry per limb.
    pub limbs: Vec<LimbCoordinates>,
    /// The instrument's constants, behind the limbs: each is its own coordinate, none is redundant.
    pub instrument: LimbCoordinates,
    pub(super) form: Form,
    /// Motions that all limbs share, behind the limbs.
    pub(super) shared: Option<Shared>,
}

/// Coordinates of one limb, or of the instrument.
#[derive(Clone, Debug)]
pub struct LimbCoordinates {
    /// Components (of 6 per link; the instrument's constants) that are not held.
    pub free: Vec<usize>,
    /// Components that make the slice, ascending.
    pub slice: Vec<usize>,
    /// The same per link: which rotations and which translations; empty for constants.
    pub in_slice: Vec<[[bool; 3]; 2]>,
    /// Components that the redundancy is solved for.
    pub(super) pivots: Vec<usize>,
    /// Standard deviation of each component, rad or m; 0 where held.
    pub sigma: Vec<f64>,
    /// The same with what shared motions add: 0 where nothing moves it.
    pub(super) reach: Vec<f64>,
    /// Number of redundant directions of the components that are not held.
    pub(super) redundant: usize,
    /// `u = basis z` over `free`: orthonormal complement of the redundancy at nominal, in tolerance units.
    pub(super) basis: Mat<f64>,
    /// Where this limb's `x` starts, and how many there are.
    pub offset: usize,
    /// Number of this limb's `x`.
    pub count: usize,
    /// Where this limb's slice columns start.
    pub slice_offset: usize,
}

impl Coordinates {
    /// Coordinates about the nominal machine.
    pub fn new(mechanism: &Mechanism, form: Form) -> Self {
        let nominal = mechanism.nominal();
        let length = mechanism.characteristic_length();
        let (mut offset, mut slice_offset) = (0, 0);
        let mut limbs = Vec::with_capacity(mechanism.limbs.len());
        let mut shared = Shared::of(mechanism, form, length);
        let mut complements = Vec::new();
        let mut first = 0;
        for (limb, links) in mechanism.limbs.iter().zip(&nominal.limbs) {
            let sigma: Vec<f64> = limb.links.iter().flat_map(|link| sigmas(link, length)).collect();
            let free: Vec<usize> = (0..sigma.len()).filter(|&i| sigma[i] > 0.0).collect();
            let mut scaled = scaled_redundancy(limb, links, &sigma, &free);
            let redundant = scaled.ncols();
            let own = scaled.clone();
            let (mut reach, mut reached) = (sigma.clone(), free.clone());
            if let Some(shared) = &shared {
                let lifted = reach.iter_mut().enumerate();
                lifted.for_each(|(i, reach)| *reach = reach.hypot(shared.reach(first + i)));
                reached = (0..reach.len()).filter(|&i| reach[i] > 0.0).collect();
                scaled = scaled_redundancy(limb, links, &reach, &reached);
                complements.push(complement(&scaled));
            }
            first += sigma.len();
            let pivots: Vec<usize> = pivot_rows(&scaled).into_iter().map(|i| reached[i]).collect();
            let slice: Vec<usize> = reached.iter().copied().filter(|i| !pivots.contains(i)).collect();
            let mut in_slice = vec![[[false; 3]; 2]; limb.links.len()];
            for &i in &slice {
                in_slice[i / 6][i % 6 / 3][i % 3] = true;
            }
            let basis = match form {
                Form::Minimal => complement(&own),
                Form::Complete | Form::Plain => Mat::identity(free.len(), free.len()),
            };
            let count = basis.ncols();
            let columns = slice.len();
            limbs.push(LimbCoordinates {
                free,
                slice,
                in_slice,
                pivots,
                sigma,
                reach,
                redundant,
                basis,
                offset,
                count,
                slice_offset,
            });
            offset += count;
            slice_offset += columns;
        }
        if let Some(shared) = &mut shared {
            shared.own_count = offset;
            if form == Form::Minimal {
                shared.reduce(&limbs, &complements);
            }
            offset = shared.gauge.as_ref().map_or(offset + shared.count(), Mat::ncols);
        }
        let instrument = LimbCoordinates::of_constants(&mechanism.instrument, length, offset, slice_offset);
        Self { limbs, instrument, form, shared }
    }

    /// Whether the limbs have coordinates in common.
    pub fn shares_motions(&self) -> bool {
        self.shared.is_some()
    }

    /// The limbs, then the instrument.
    pub fn blocks(&self) -> impl Iterator<Item = &LimbCoordinates> {
        self.limbs.iter().chain([&self.instrument])
    }

    /// Coordinates of limb `i` alone.
    pub fn of_limb(&self, i: usize) -> Coordinates {
        let limb = LimbCoordinates { offset: 0, slice_offset: 0, ..self.limbs[i].clone() };
        let instrument = LimbCoordinates::of_constants(&[], 1.0, limb.count, limb.slice.len());
        Coordinates { limbs: vec![limb], instrument, form: self.form, shared: None }
    }

    /// Number of coordinates `x`.
    pub fn count(&self) -> usize {
        self.instrument.offset + self.instrument.count
    }

    /// Number of slice columns: the structural count, or more where held links hide some, or limbs share motions.
    pub fn slice_count(&self) -> usize {
        self.instrument.slice_offset + self.instrument.slice.len()
    }

    /// Deviations (rad, m; six per link, then the instrument's constants) at `x`.
    pub fn deviations(&self, x: &[f64]) -> Vec<f64> {
        if let Some(shared) = &self.shared {
            let (x, constants) = x.split_at(self.instrument.offset);
            let full = match &shared.gauge {
                Some(gauge) => linalg::mul(gauge.as_ref(), x),
                None => x.to_vec(),
            };
            let mut out = self.own_deviations(self.limbs.iter(), &full);
            let lifted = linalg::mul(shared.lift.as_ref(), &full[full.len() - shared.count()..]);
            out.iter_mut().zip(lifted).for_each(|(d, lifted)| *d += lifted);
            let units = (0..constants.len()).map(|i| self.unit(&self.instrument, i));
            out.extend(constants.iter().zip(units).map(|(x, unit)| x * unit));
            return out;
        }
        self.own_deviations(self.blocks(), x)
    }

    /// Deviations of these blocks by their own coordinates among `x`.
    fn own_deviations<'a>(
        &'a self,
        blocks: impl Iterator<Item = &'a LimbCoordinates>,
        x: &[f64],
    ) -> Vec<f64> {
        let mut out = Vec::new();
        for limb in blocks {
            let mut d = vec![0.0; limb.sigma.len()];
            let u = linalg::mul(limb.basis.as_ref(), &x[limb.offset..limb.offset + limb.count]);
            for (&i, u) in limb.free.iter().zip(&u) {
                d[i] = u * self.unit(limb, i);
            }
            out.extend(d);
        }
        out
    }

    /// The coordinates whose deviations come closest to `deviations`, in tolerance units.
    pub fn nearest(&self, deviations: &[f64]) -> Vec<f64> {
        let Some(shared) = &self.shared else { return self.own_nearest(self.blocks(), deviations) };
        let asked = shared.asked_for(&self.limbs, deviations);
        let lifted = linalg::mul(shared.lift.as_ref(), &asked);
        let rest: Vec<f64> = deviations.iter().zip(&lifted).map(|(d, lifted)| d - lifted).collect();
        let mut x = self.own_nearest(self.limbs.iter(), &rest);
        x.extend(asked);
        if let Some(gauge) = &shared.gauge {
            x = linalg::mul_transpose(gauge.as_ref(), &x);
        }
        let constants = &deviations[lifted.len()..];
        x.extend(constants.iter().enumerate().map(|(i, d)| d / self.unit(&self.instrument, i)));
        x
    }

    fn own_nearest<'a>(
        &'a self,
        blocks: impl Iterator<Item = &'a LimbCoordinates>,
        deviations: &[f64],
    ) -> Vec<f64> {
        let mut x = Vec::with_capacity(self.count());
        let mut start = 0;
        for limb in blocks {
            let u: Vec<f64> = limb.free.iter().map(|&i| deviations[start + i] / self.unit(limb, i)).collect();
            x.extend(linalg::mul_transpose(limb.basis.as_ref(), &u));
            start += limb.sigma.len();
        }
        x
    }

    /// One unit of component `i`: its tolerance, or 1 rad or m in the plain form.
    pub(super) fn unit(&self, limb: &LimbCoordinates, i: usize) -> f64 {
        match self.form {
            Form::Plain => 1.0,
            Form::Minimal | Form::Complete => limb.sigma[i],
        }
    }

    /// Names, units and bounds of `x`.
    pub fn params(&self, mechanism: &Mechanism) -> Vec<Param> {
        let mut params = Vec::with_capacity(self.count());
        for (limb, drawn) in self.limbs.iter().zip(&mechanism.limbs) {
            if self.form == Form::Minimal {
                params.extend((0..limb.count).map(|k| Param {
                    name: format!("{} combination {}", drawn.name, k + 1),
                    unit: "",
                    scale: 1.0,
                    bounds: (f64::NEG_INFINITY, f64::INFINITY),
                }));
                continue;
            }
            for &i in &limb.free {
                let link = &drawn.links[i / 6];
                let unit = self.unit(limb, i);
                let limit = match link.bounds {
                    Some((angle, length)) => (if i % 6 < 3 { angle } else { length }) / unit,
                    None => f64::INFINITY,
                };
                let kind = if i % 6 < 3 { "rotation" } else { "translation" };
                params.push(Param {
                    name: format!("{}.{} {kind} {}", drawn.name, link.name, ["x", "y", "z"][i % 3]),
                    unit: if i % 6 < 3 { "rad" } else { "m" },
                    scale: unit,
                    bounds: (-limit, limit),
                });
            }
        }
        if let Some(shared) = &self.shared {
            if shared.gauge.is_some() {
                params.clear();
            }
            params.extend(shared.params());
        }
        params.extend(mechanism.instrument.iter().enumerate().map(|(i, constant)| {
            let unit = self.unit(&self.instrument, i);
            let limit = constant.bounds.map_or(f64::INFINITY, |limit| limit / unit);
            Param { name: constant.name(), unit: constant.unit(), scale: unit, bounds: (-limit, limit) }
        }));
        params
    }

    /// The components of each link and of each thing that the instrument refers to, in complete forms.
    pub fn groups(&self, mechanism: &Mechanism) -> Vec<Group> {
        if self.form == Form::Minimal {
            return Vec::new();
        }
        let mut groups: Vec<Group> = Vec::new();
        let mut next = 0;
        for (limb, drawn) in self.limbs.iter().zip(&mechanism.limbs) {
            for (j, link) in drawn.links.iter().enumerate() {
                let size = limb.free.iter().filter(|&&i| i / 6 == j).count();
                if size > 0 {
                    let name = format!("{}.{}", drawn.name, link.name);
                    groups.push(Group { name, members: (next..next + size).collect() });
                    next += size;
                }
            }
        }
        for (name, size) in self.shared.iter().flat_map(Shared::groups) {
            groups.push(Group { name: name.to_owned(), members: (next..next + size).collect() });
            next += size;
        }
        for (i, constant) in mechanism.instrument.iter().enumerate() {
            match groups.last_mut().filter(|group| i > 0 && group.name == constant.element) {
                Some(group) => group.members.push(next + i),
                None => groups.push(Group { name: constant.element.clone(), members: vec![next + i] }),
            }
        }
        groups
    }
}

impl LimbCoordinates {
    /// Coordinates of constants, none of them redundant; `length` is the machine's size, m.
    fn of_constants(constants: &[Constant], length: f64, offset: usize, slice_offset: usize) -> Self {
        let count = constants.len();
        let sigma = |constant: &Constant| match (constant.prior, constant.quantity) {
            (Prior::Sigma(sigma), _) => sigma,
            (Prior::Free, Quantity::Length) => FREE * length,
            (Prior::Free | Prior::Held, _) => FREE,
        };
        Self {
            free: (0..count).collect(),
            slice: (0..count).collect(),
            in_slice: Vec::new(),
            pivots: Vec::new(),
            reach: Vec::new(),
            redundant: 0,
            sigma: constants.iter().map(sigma).collect(),
            basis: Mat::identity(count, count),
            offset,
            count,
            slice_offset,
        }
    }
}

/// The redundancy among the components `free`, in units of `sigma`.
fn scaled_redundancy(limb: &Limb, links: &[Se3], sigma: &[f64], free: &[usize]) -> Mat<f64> {
    let null = redundancy(limb, links, sigma);
    Mat::from_fn(free.len(), null.ncols(), |i, j| null[(free[i], j)] / sigma[free[i]])
}

/// Orthonormal complement of a redundancy.
fn complement(scaled: &Mat<f64>) -> Mat<f64> {
    linalg::complement(scaled.as_ref()).unwrap_or_else(|| Mat::identity(scaled.nrows(), scaled.nrows()))
}

/// Standard deviations of a link's six components, 0 where held.
fn sigmas(link: &crate::model::Link, length: f64) -> [f64; 6] {
    let sigma = |prior: Prior, free: f64| match prior {
        Prior::Held => 0.0,
        Prior::Sigma(sigma) => sigma,
        Prior::Free => free,
    };
    let angle = sigma(link.tolerance.angle, FREE_LINK);
    let translation = sigma(link.tolerance.length, FREE_LINK * length);
    [angle, angle, angle, translation, translation, translation]
}
