//! Forward-mode derivatives: a value with its gradient by at most nine parameters, exact to rounding.

use std::ops::{Add, Div, Mul, Neg, Sub};

/// Most parameters of a problem in the set (ENSO).
pub const WIDTH: usize = 9;

/// `v + g . db`.
#[derive(Clone, Copy, Debug)]
pub struct Dual {
    /// Value.
    pub v: f64,
    /// Derivatives by the parameters.
    pub g: [f64; WIDTH],
}

impl Dual {
    /// A constant.
    pub fn constant(v: f64) -> Self {
        Self { v, g: [0.0; WIDTH] }
    }

    /// Parameter `index` at value `v`.
    pub fn parameter(v: f64, index: usize) -> Self {
        let mut g = [0.0; WIDTH];
        g[index] = 1.0;
        Self { v, g }
    }

    /// `f(self)` from `f` and `f'` at the value.
    fn chain(self, v: f64, slope: f64) -> Self {
        Self { v, g: self.g.map(|g| slope * g) }
    }

    /// A function of both with partial derivatives `a` and `b`.
    fn combine(self, other: Dual, v: f64, a: f64, b: f64) -> Self {
        Self { v, g: std::array::from_fn(|i| a * self.g[i] + b * other.g[i]) }
    }

    pub fn exp(self) -> Self {
        let e = self.v.exp();
        self.chain(e, e)
    }

    pub fn sin(self) -> Self {
        self.chain(self.v.sin(), self.v.cos())
    }

    pub fn cos(self) -> Self {
        self.chain(self.v.cos(), -self.v.sin())
    }

    pub fn atan(self) -> Self {
        self.chain(self.v.atan(), 1.0 / (1.0 + self.v * self.v))
    }

    pub fn ln(self) -> Self {
        self.chain(self.v.ln(), 1.0 / self.v)
    }

    pub fn square(self) -> Self {
        self.chain(self.v * self.v, 2.0 * self.v)
    }

    /// `self^power` for a constant power.
    pub fn powf(self, power: f64) -> Self {
        self.chain(self.v.powf(power), power * self.v.powf(power - 1.0))
    }

    /// `self^power`.
    pub fn pow(self, power: Dual) -> Self {
        let v = self.v.powf(power.v);
        let base = power.v * self.v.powf(power.v - 1.0);
        let log = self.v.ln();
        self.combine(power, v, base, v * log)
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
        self.combine(o, self.v / o.v, o.v.recip(), -(self.v / o.v) / o.v)
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
