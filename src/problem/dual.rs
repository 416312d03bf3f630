//! A number with one derivative: forward-mode differentiation, exact to rounding.

use std::ops::{Add, Div, Mul, Neg, Sub};

/// `v + d e` with `e^2 = 0`: a value and its derivative by whatever was seeded with `d = 1`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dual {
    /// Value.
    pub v: f64,
    /// Derivative.
    pub d: f64,
}

impl Dual {
    /// A constant.
    pub fn constant(v: f64) -> Self {
        Self { v, d: 0.0 }
    }

    /// `f(self)` from `f` and `f'` at the value.
    pub fn chain(self, v: f64, slope: f64) -> Self {
        Self { v, d: slope * self.d }
    }

    /// A function of `self` and `other` with partial derivatives `a` and `b`.
    pub fn combine(self, other: Self, v: f64, a: f64, b: f64) -> Self {
        Self { v, d: a * self.d + b * other.d }
    }

    /// Exponential.
    pub fn exp(self) -> Self {
        let e = self.v.exp();
        self.chain(e, e)
    }

    /// Natural logarithm.
    pub fn ln(self) -> Self {
        self.chain(self.v.ln(), 1.0 / self.v)
    }

    /// Sine.
    pub fn sin(self) -> Self {
        self.chain(self.v.sin(), self.v.cos())
    }

    /// Cosine.
    pub fn cos(self) -> Self {
        self.chain(self.v.cos(), -self.v.sin())
    }

    /// Arc tangent.
    pub fn atan(self) -> Self {
        self.chain(self.v.atan(), 1.0 / (1.0 + self.v * self.v))
    }

    /// Square root.
    pub fn sqrt(self) -> Self {
        let root = self.v.sqrt();
        self.chain(root, 0.5 / root)
    }

    /// Magnitude; the derivative at zero is taken from above.
    pub fn abs(self) -> Self {
        self.chain(self.v.abs(), 1f64.copysign(self.v))
    }

    /// Square.
    pub fn square(self) -> Self {
        self.chain(self.v * self.v, 2.0 * self.v)
    }

    /// A constant power.
    pub fn powf(self, power: f64) -> Self {
        self.chain(self.v.powf(power), power * self.v.powf(power - 1.0))
    }

    /// A power that varies; the base must be positive.
    pub fn pow(self, power: Dual) -> Self {
        let v = self.v.powf(power.v);
        self.combine(power, v, power.v * self.v.powf(power.v - 1.0), v * self.v.ln())
    }
}

impl From<f64> for Dual {
    fn from(v: f64) -> Self {
        Self::constant(v)
    }
}

impl<T: Into<Dual>> Add<T> for Dual {
    type Output = Dual;
    fn add(self, other: T) -> Dual {
        let o = other.into();
        self.combine(o, self.v + o.v, 1.0, 1.0)
    }
}

impl<T: Into<Dual>> Sub<T> for Dual {
    type Output = Dual;
    fn sub(self, other: T) -> Dual {
        let o = other.into();
        self.combine(o, self.v - o.v, 1.0, -1.0)
    }
}

impl<T: Into<Dual>> Mul<T> for Dual {
    type Output = Dual;
    fn mul(self, other: T) -> Dual {
        let o = other.into();
        self.combine(o, self.v * o.v, o.v, self.v)
    }
}

impl<T: Into<Dual>> Div<T> for Dual {
    type Output = Dual;
    fn div(self, other: T) -> Dual {
        let o = other.into();
        let quotient = self.v / o.v;
        self.combine(o, quotient, o.v.recip(), -quotient / o.v)
    }
}

impl Neg for Dual {
    type Output = Dual;
    fn neg(self) -> Dual {
        self.chain(-self.v, -1.0)
    }
}

macro_rules! from_the_left {
    ($($trait:ident $method:ident),*) => {$(
        impl $trait<Dual> for f64 {
            type Output = Dual;
            fn $method(self, other: Dual) -> Dual {
                Dual::constant(self).$method(other)
            }
        }
    )*};
}
from_the_left!(Add add, Sub sub, Mul mul, Div div);
