//! Kinematic calibration of parallel and serial manipulators.
//!
//! # The problem
//!
//! A machine is `n` limbs that join base and platform; `n = 1` is a serial robot. Limb `i` is a chain of joints of one
//! degree of freedom and of links `g_i0 .. g_if` between them. With joint variables `q` it carries the tool to
//!
//! ```text
//! g_i(q) = g_i0 exp(z_1 q_1) g_i1 exp(z_2 q_2) ... exp(z_f q_f) g_if,      g_1 = g_2 = ... = g_n.
//! ```
//!
//! Some joints are actuated: their readings are known. The others, the passive ones, follow from the limbs meeting. The
//! links are known by drawing only: `g_ij = nominal_ij exp(d_ij)`, each component of `d` within a stated tolerance.
//!
//! Given readings and measured tool poses `y_k` with their noise, find the deviations `d`:
//!
//! ```text
//! minimise |r(u)|^2 + (what the tolerances know better than the data),    r_k = C^(-1/2) (pose_k(u) - y_k),    d = S u
//! ```
//!
//! with `C` the noise covariance of a pose error, taken at the tool point, and `S` the tolerances. Many combinations
//! of `d` change no pose at all, and more of them have no first-order effect on machines with square and meeting axes;
//! the crate knows the first kind in closed form, counts the second, and leaves both near nominal. `docs/theory.md` has
//! the mathematics with numbered equations, `docs/conventions.md` frames and orders, `docs/design.md` the layers.
//!
//! # Example
//!
//! ```
//! use gough::files::{DataPlaces, read_problem};
//! use gough::identify::{identify, score::score};
//! use gough::model::Geometry;
//! use gough::solve::{Stop, registry};
//!
//! // A tripod with 60 measured poses, and 40 more that take no part.
//! let problem = read_problem("problems/tripod-3rps.json".as_ref(), &DataPlaces::from_environment(None))?;
//! let identifier = registry::find("minimal")?;
//! let found = identify(&problem.mechanism, &problem.data.samples, identifier.as_ref(), &Stop::default())?;
//! assert!(found.report.outcome.converged());
//!
//! // Position errors of the drawing and of the identified machine, rms in m.
//! let holdout = |machine: &Geometry| {
//!     score(&found.start, machine, &problem.holdout.samples).and_then(|fit| fit.position)
//! };
//! let before = holdout(&found.start.nominal()).ok_or("no hold-out")?.rms;
//! let after = holdout(&found.geometry).ok_or("no hold-out")?.rms;
//! assert!(before > 1e-3 && after < 1e-5);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Modules
//!
//! From the bottom up: [`lie`] rotations and rigid motions; [`linalg`] dense factorisations; [`statistics`]
//! medians and intervals; [`problem`] what an
//! identifier sees; [`model`] joints, limbs, postures; [`measure`] instruments; [`calibration`] machine and
//! measurements as a problem; [`simulate`] synthetic measurements; [`solve`] identifiers; [`identify`] a whole
//! identification; [`design`] which postures to measure; [`check`] mistakes in data; [`files`] problem and result
//! files; [`formats`] those of other programs; [`render`] figures, tables and pages; [`compare`] identifiers side by
//! side; [`cli`] the commands.

pub mod calibration;
pub mod cells;
pub mod check;
pub mod cli;
pub mod compare;
pub mod design;
pub mod files;
pub mod formats;
pub mod identify;
pub mod lie;
pub mod linalg;
pub mod measure;
pub mod model;
pub mod problem;
pub mod render;
pub mod simulate;
pub mod solve;
pub mod statistics;
pub mod wide;
