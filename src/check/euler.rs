//! Three angles about axes of the frame, as controllers and instruments state rotations.

use crate::lie::so3;
use nalgebra::{Matrix3, Vector3};

/// Turns about three axes, in the order in which the angles are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Euler {
    /// Of each angle: 0 for x, 1 for y, 2 for z.
    pub axes: [usize; 3],
    /// Whether the axes are fixed in {S}; else they move with the tool.
    pub fixed: bool,
}

impl Euler {
    /// All of them, turns about three different axes first, those about x, y, z first of all.
    pub fn all() -> Vec<Euler> {
        let mut all = Vec::with_capacity(24);
        let different = [[0, 1, 2], [2, 1, 0], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1]];
        let same = [[2, 0, 2], [2, 1, 2], [0, 1, 0], [0, 2, 0], [1, 0, 1], [1, 2, 1]];
        for axes in different.into_iter().chain(same) {
            all.extend([true, false].map(|fixed| Euler { axes, fixed }));
        }
        all
    }

    /// The rotation, angles in rad.
    pub fn rotation(&self, angles: &Vector3<f64>) -> Matrix3<f64> {
        let [a, b, c] = [0, 1, 2].map(|i| {
            let mut turn = Vector3::zeros();
            turn[self.axes[i]] = angles[i];
            so3::exp(&turn)
        });
        if self.fixed { c * b * a } else { a * b * c }
    }

    /// The letters of its axes.
    pub fn letters(&self) -> [char; 3] {
        self.axes.map(|i| ['x', 'y', 'z'][i % 3])
    }

    /// Its rotation as a product of turns of the angles a, b, c.
    pub fn formula(&self) -> String {
        let [a, b, c] = self.letters();
        match self.fixed {
            true => format!("R{c}(c) R{b}(b) R{a}(a)"),
            false => format!("R{a}(a) R{b}(b) R{c}(c)"),
        }
    }

    /// Its name, as formats write it: capitals for moving axes, lower case for fixed ones.
    pub fn name(&self) -> String {
        let letters: String = self.letters().iter().collect();
        if self.fixed { letters } else { letters.to_uppercase() }
    }
}
