//! A limb: a chain of joints from base to platform, and the links between them.

use super::joint::Joint;
use crate::lie::Se3;

/// What is known of a deviation component before anything is measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Prior {
    /// Held at nominal.
    Held,
    /// Standard deviation, rad or m.
    Sigma(f64),
    /// Nothing is known.
    Free,
}

/// What is known of a link's deviation, per component.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tolerance {
    /// Of each rotation component.
    pub angle: Prior,
    /// Of each translation component.
    pub length: Prior,
}

impl Tolerance {
    /// Nothing deviates.
    pub const HELD: Self = Self { angle: Prior::Held, length: Prior::Held };
    /// Nothing is known.
    pub const FREE: Self = Self { angle: Prior::Free, length: Prior::Free };

    /// Standard deviations of each rotation (rad) and translation (m) component; 0 holds it.
    pub fn sigma(angle: f64, length: f64) -> Self {
        let prior = |sigma: f64| if sigma == 0.0 { Prior::Held } else { Prior::Sigma(sigma) };
        Self { angle: prior(angle), length: prior(length) }
    }
}

/// Link `j` of a limb: the constant transform from behind joint `j` to the frame of joint `j + 1`, or to the
/// tool. It deviates as `nominal * exp(d)`, `d` in the frame of the *next* joint (docs/theory.md (6.1)).
#[derive(Clone, Debug)]
pub struct Link {
    /// Name within its limb: that of the joint that it carries, or `tool`.
    pub name: String,
    /// Nominal transform.
    pub nominal: Se3,
    /// Prior of its deviation.
    pub tolerance: Tolerance,
    /// Hard limits on each rotation (rad) and translation (m) component of the deviation.
    pub bounds: Option<(f64, f64)>,
}

/// A chain of f joints and f + 1 links.
#[derive(Clone, Debug)]
pub struct Limb {
    /// Its name.
    pub name: String,
    /// Equivalent joints from base to platform, f.
    pub joints: Vec<Joint>,
    /// Links from base to platform, f + 1.
    pub links: Vec<Link>,
}

impl Limb {
    /// Number of passive joints, m.
    pub fn passive_count(&self) -> usize {
        self.joints.iter().filter(|joint| !joint.actuated).count()
    }

    /// Analytic null basis of the limb (18), (21), for links `g_0..g_f` as they are, by columns.
    ///
    /// Each column stacks, over the f + 1 links, the body twist (in the frame behind the link) of a change
    /// that no pose shows. Per revolute or helical joint two columns, per prismatic joint four: the twists
    /// that commute with the joint's own, taken from the link before it and given to the link behind it; per
    /// passive joint that no sensor reads its zero offset.
    pub fn null_basis(&self, links: &[Se3]) -> Vec<Vec<f64>> {
        let mut columns = Vec::new();
        for (j, joint) in self.joints.iter().enumerate() {
            let behind = crate::lie::se3::adjoint(&links[j + 1].inverse());
            let twist = |components: &[(usize, f64)]| {
                let mut xi = crate::lie::se3::Twist::zeros();
                for &(i, value) in components {
                    xi[i] = value;
                }
                xi
            };
            let commuting = match joint.motion {
                super::Motion::Prismatic => {
                    vec![twist(&[(2, 1.0)]), twist(&[(3, 1.0)]), twist(&[(4, 1.0)]), twist(&[(5, 1.0)])]
                }
                super::Motion::Revolute | super::Motion::Helical { .. } => {
                    vec![twist(&[(2, 1.0)]), twist(&[(5, 1.0)])]
                }
            };
            let own = match joint.motion {
                super::Motion::Prismatic => twist(&[(5, 1.0)]),
                super::Motion::Revolute => twist(&[(2, 1.0)]),
                super::Motion::Helical { advance } => twist(&[(2, 1.0), (5, advance)]),
            };
            let size = 6 * (self.joints.len() + 1);
            for xi in commuting {
                let mut column = vec![0.0; size];
                let carried = behind * xi;
                for i in 0..6 {
                    column[6 * j + i] = -xi[i];
                    column[6 * (j + 1) + i] = carried[i];
                }
                columns.push(column);
            }
            if !joint.actuated && !joint.sensed {
                let mut column = vec![0.0; size];
                column[6 * j..6 * j + 6].copy_from_slice(own.as_slice());
                columns.push(column);
            }
        }
        columns
    }
}
