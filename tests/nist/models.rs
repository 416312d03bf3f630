//! The model functions of the 27 NIST StRD nonlinear regressions, as printed in the data files.

use gough::problem::Dual;
use std::f64::consts::PI;

/// A model: parameters `b`, predictors `x` of one observation, to the response.
pub type Model = fn(&[Dual], &[f64]) -> Dual;

/// The model of that data set.
pub fn model(name: &str) -> Option<Model> {
    Some(match name {
        "Bennett5" => |b, x| b[0] * (b[1] + x[0]).pow(-1.0 / b[2]),
        "BoxBOD" | "Misra1a" => |b, x| b[0] * (1.0 - (-b[1] * x[0]).exp()),
        "Chwirut1" | "Chwirut2" => |b, x| (-b[0] * x[0]).exp() / (b[1] + b[2] * x[0]),
        "DanWood" => |b, x| b[0] * (b[1] * x[0].ln()).exp(),
        "ENSO" => enso,
        "Eckerle4" => |b, x| (b[0] / b[1]) * (-0.5 * ((x[0] - b[2]) / b[1]).square()).exp(),
        "Gauss1" | "Gauss2" | "Gauss3" => gauss,
        "Hahn1" | "Thurber" => |b, x| {
            let x = x[0];
            (b[0] + x * (b[1] + x * (b[2] + x * b[3]))) / (1.0 + x * (b[4] + x * (b[5] + x * b[6])))
        },
        "Kirby2" => |b, x| {
            let x = x[0];
            (b[0] + x * (b[1] + x * b[2])) / (1.0 + x * (b[3] + x * b[4]))
        },
        "Lanczos1" | "Lanczos2" | "Lanczos3" => |b, x| {
            let term = |k: usize| b[k] * (-b[k + 1] * x[0]).exp();
            term(0) + term(2) + term(4)
        },
        "MGH09" => |b, x| {
            let square = x[0] * x[0];
            b[0] * (square + b[1] * x[0]) / (square + b[2] * x[0] + b[3])
        },
        "MGH10" => |b, x| b[0] * (b[1] / (b[2] + x[0])).exp(),
        "MGH17" => |b, x| b[0] + b[1] * (-b[3] * x[0]).exp() + b[2] * (-b[4] * x[0]).exp(),
        "Misra1b" => |b, x| b[0] * (1.0 - (1.0 + b[1] * (x[0] / 2.0)).powf(-2.0)),
        "Misra1c" => |b, x| b[0] * (1.0 - (1.0 + b[1] * (2.0 * x[0])).powf(-0.5)),
        "Misra1d" => |b, x| b[0] * b[1] * x[0] / (1.0 + b[1] * x[0]),
        // The response is log(y).
        "Nelson" => |b, x| b[0] - b[1] * x[0] * (-b[2] * x[1]).exp(),
        "Rat42" => |b, x| b[0] / (1.0 + (b[1] - b[2] * x[0]).exp()),
        "Rat43" => |b, x| b[0] / (1.0 + (b[1] - b[2] * x[0]).exp()).pow(1.0 / b[3]),
        "Roszman1" => |b, x| b[0] - b[1] * x[0] - (b[2] / (x[0] - b[3])).atan() / PI,
        _ => return None,
    })
}

fn enso(b: &[Dual], x: &[f64]) -> Dual {
    let turn = 2.0 * PI * x[0];
    let year = turn / 12.0;
    let first = turn / b[3];
    let second = turn / b[6];
    b[0] + b[1] * year.cos()
        + b[2] * year.sin()
        + b[4] * first.cos()
        + b[5] * first.sin()
        + b[7] * second.cos()
        + b[8] * second.sin()
}

fn gauss(b: &[Dual], x: &[f64]) -> Dual {
    let peak = |k: usize| b[k] * (-((x[0] - b[k + 1]) / b[k + 2]).square()).exp();
    b[0] * (-b[1] * x[0]).exp() + peak(2) + peak(5)
}
