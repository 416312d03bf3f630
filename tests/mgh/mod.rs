//! Problems 1 to 19 of Moré, Garbow, Hillstrom, *Testing Unconstrained Optimization Software*, ACM TOMS 7 (1981).

use gough::problem::{Dual, EvalError, Formula};
use std::f64::consts::PI;

/// Residuals of one problem.
type Residual = fn(&[Dual]) -> Vec<Dual>;

/// One of the problems.
pub type Function = Formula<Box<dyn Fn(&[Dual]) -> Result<Vec<Dual>, EvalError> + Sync>>;

/// The problem of that number as a problem of `n` parameters.
pub fn problem(number: usize, n: usize) -> Option<Function> {
    let residual = residual(number)?;
    Some(Formula::new(n, Box::new(move |x| Ok(residual(x)))))
}

fn count(to: usize) -> impl Iterator<Item = f64> {
    (1..=to).map(|i| i as f64)
}

fn residual(number: usize) -> Option<Residual> {
    Some(match number {
        1 => |x| vec![10.0 * (x[1] - x[0].square()), 1.0 - x[0]],
        2 => |x| {
            let (a, b) = (x[0], x[1]);
            vec![a - 13.0 + ((5.0 - b) * b - 2.0) * b, a - 29.0 + ((b + 1.0) * b - 14.0) * b]
        },
        3 => |x| vec![1e4 * x[0] * x[1] - 1.0, (-x[0]).exp() + (-x[1]).exp() - 1.0001],
        4 => |x| vec![x[0] - 1e6, x[1] - 2e-6, x[0] * x[1] - 2.0],
        5 => |x| {
            let y = [1.5, 2.25, 2.625];
            (1..=3).map(|i| y[i as usize - 1] - x[0] * (1.0 - x[1].powf(f64::from(i)))).collect()
        },
        6 => |x| count(10).map(|i| 2.0 + 2.0 * i - ((i * x[0]).exp() + (i * x[1]).exp())).collect(),
        7 => helical_valley,
        8 => bard,
        9 => gaussian,
        10 => meyer,
        11 => |x| {
            count(100)
                .map(|i| {
                    let t = i / 100.0;
                    let y = 25.0 + (-50.0 * t.ln()).powf(2.0 / 3.0);
                    (-((y - x[1]).abs().pow(x[2]) / x[0])).exp() - t
                })
                .collect()
        },
        12 => |x| {
            count(3)
                .map(|i| {
                    let t = 0.1 * i;
                    (-t * x[0]).exp() - (-t * x[1]).exp() - x[2] * ((-t).exp() - (-10.0 * t).exp())
                })
                .collect()
        },
        13 => |x| {
            vec![
                x[0] + 10.0 * x[1],
                5f64.sqrt() * (x[2] - x[3]),
                (x[1] - 2.0 * x[2]).square(),
                10f64.sqrt() * (x[0] - x[3]).square(),
            ]
        },
        14 => |x| {
            vec![
                10.0 * (x[1] - x[0].square()),
                1.0 - x[0],
                90f64.sqrt() * (x[3] - x[2].square()),
                1.0 - x[2],
                10f64.sqrt() * (x[1] + x[3] - 2.0),
                (x[1] - x[3]) / 10f64.sqrt(),
            ]
        },
        15 => kowalik_osborne,
        16 => |x| {
            count(20)
                .map(|i| {
                    let t = i / 5.0;
                    (x[0] + t * x[1] - t.exp()).square() + (x[2] + t.sin() * x[3] - t.cos()).square()
                })
                .collect()
        },
        17 => osborne_1,
        18 => |x| {
            count(13)
                .map(|i| {
                    let t = 0.1 * i;
                    let y = (-t).exp() - 5.0 * (-10.0 * t).exp() + 3.0 * (-4.0 * t).exp();
                    x[2] * (-t * x[0]).exp() - x[3] * (-t * x[1]).exp() + x[5] * (-t * x[4]).exp() - y
                })
                .collect()
        },
        19 => osborne_2,
        _ => return None,
    })
}

fn helical_valley(x: &[Dual]) -> Vec<Dual> {
    // The angle that goes from -1/4 to 3/4 turn, with its jump on the negative second axis.
    let turn = (x[1] / x[0]).atan() / (2.0 * PI) + if x[0].v < 0.0 { 0.5 } else { 0.0 };
    vec![10.0 * (x[2] - 10.0 * turn), 10.0 * ((x[0].square() + x[1].square()).sqrt() - 1.0), x[2]]
}

fn bard(x: &[Dual]) -> Vec<Dual> {
    let y = [0.14, 0.18, 0.22, 0.25, 0.29, 0.32, 0.35, 0.39, 0.37, 0.58, 0.73, 0.96, 1.34, 2.10, 4.39];
    let row = |(i, y): (f64, f64)| {
        let (u, v) = (i, 16.0 - i);
        y - (x[0] + u / (v * x[1] + u.min(v) * x[2]))
    };
    count(15).zip(y).map(row).collect()
}

fn gaussian(x: &[Dual]) -> Vec<Dual> {
    let half = [0.0009, 0.0044, 0.0175, 0.0540, 0.1295, 0.2420, 0.3521, 0.3989];
    let y = |i: usize| half[if i < 8 { i } else { 14 - i }];
    let row = |i: usize| {
        let t = (7.0 - i as f64) / 2.0;
        x[0] * (-(x[1] * (t - x[2]).square()) / 2.0).exp() - y(i)
    };
    (0..15).map(row).collect()
}

fn meyer(x: &[Dual]) -> Vec<Dual> {
    let y = [
        34780.0, 28610.0, 23650.0, 19630.0, 16370.0, 13720.0, 11540.0, 9744.0, 8261.0, 7030.0, 6005.0,
        5147.0, 4427.0, 3820.0, 3307.0, 2872.0,
    ];
    count(16).zip(y).map(|(i, y)| x[0] * (x[1] / (45.0 + 5.0 * i + x[2])).exp() - y).collect()
}

fn kowalik_osborne(x: &[Dual]) -> Vec<Dual> {
    let y = [0.1957, 0.1947, 0.1735, 0.1600, 0.0844, 0.0627, 0.0456, 0.0342, 0.0323, 0.0235, 0.0246];
    let u = [4.0, 2.0, 1.0, 0.5, 0.25, 0.167, 0.125, 0.1, 0.0833, 0.0714, 0.0625];
    u.iter().zip(y).map(|(&u, y)| y - x[0] * (u * u + u * x[1]) / (u * u + u * x[2] + x[3])).collect()
}

fn osborne_1(x: &[Dual]) -> Vec<Dual> {
    let y = [
        0.844, 0.908, 0.932, 0.936, 0.925, 0.908, 0.881, 0.850, 0.818, 0.784, 0.751, 0.718, 0.685, 0.658,
        0.628, 0.603, 0.580, 0.558, 0.538, 0.522, 0.506, 0.490, 0.478, 0.467, 0.457, 0.448, 0.438, 0.431,
        0.424, 0.420, 0.414, 0.411, 0.406,
    ];
    let row = |(i, y): (f64, f64)| {
        let t = 10.0 * (i - 1.0);
        y - (x[0] + x[1] * (-t * x[3]).exp() + x[2] * (-t * x[4]).exp())
    };
    count(33).zip(y).map(row).collect()
}

fn osborne_2(x: &[Dual]) -> Vec<Dual> {
    let y = [
        1.366, 1.191, 1.112, 1.013, 0.991, 0.885, 0.831, 0.847, 0.786, 0.725, 0.746, 0.679, 0.608, 0.655,
        0.616, 0.606, 0.602, 0.626, 0.651, 0.724, 0.649, 0.649, 0.694, 0.644, 0.624, 0.661, 0.612, 0.558,
        0.533, 0.495, 0.500, 0.423, 0.395, 0.375, 0.372, 0.391, 0.396, 0.405, 0.428, 0.429, 0.523, 0.562,
        0.607, 0.653, 0.672, 0.708, 0.633, 0.668, 0.645, 0.632, 0.591, 0.559, 0.597, 0.625, 0.739, 0.710,
        0.729, 0.720, 0.636, 0.581, 0.428, 0.292, 0.162, 0.098, 0.054,
    ];
    let row = |(i, y): (f64, f64)| {
        let t = (i - 1.0) / 10.0;
        let peak = |height: usize, width: usize, place: usize| {
            x[height] * (-((t - x[place]).square() * x[width])).exp()
        };
        y - (x[0] * (-t * x[4]).exp() + peak(1, 5, 8) + peak(2, 6, 9) + peak(3, 7, 10))
    };
    count(65).zip(y).map(row).collect()
}
