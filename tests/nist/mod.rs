//! The NIST StRD nonlinear regressions as problems: reading the `.dat` files and scoring an answer.

pub mod models;

use gough::problem::{Dual, EvalError, Formula, Linearized, Param, Problem, cost};
use gough::solve::Stop;
use models::model;
use std::path::Path;

/// NIST certifies 11 digits.
pub const CERTIFIED_DIGITS: f64 = 11.0;

/// Everything that double precision gives: no tolerance ends a run before the steps do.
pub const TIGHT: Stop = Stop { iterations: 5000, step: 1e-15, gradient: 1e-15, cost: 1e-30 };

/// One regression: data, both starts and the certified answer.
pub struct Regression {
    /// Name of the data set.
    pub name: String,
    /// The two starting points.
    pub starts: [Vec<f64>; 2],
    /// Certified parameters.
    pub certified: Vec<f64>,
    /// Certified residual sum of squares.
    certified_rss: f64,
    formula: Formula<Residual>,
}

/// Residuals as a function of the parameters.
type Residual = Box<dyn Fn(&[Dual]) -> Result<Vec<Dual>, EvalError> + Sync>;

impl Regression {
    /// Digits of the worst parameter that agree with the certified ones, 0 to 11.
    pub fn digits(&self, b: &[f64]) -> f64 {
        b.iter().zip(&self.certified).fold(CERTIFIED_DIGITS, |least, (b, c)| {
            let error = ((b - c) / c).abs();
            let digits = if error.is_nan() { 0.0 } else { -error.log10() };
            least.min(digits).max(0.0)
        })
    }

    /// Itself, if model and data give the certified sum of squares at the certified parameters.
    fn checked(self) -> Result<Self, String> {
        let rss = 2.0 * cost(&self.residual(&self.certified).map_err(|e| e.to_string())?);
        // Lanczos1 has residuals of 1e-13: eleven digits of the parameters do not settle them.
        if (rss - self.certified_rss).abs() <= 1e-6 * self.certified_rss + 1e-20 {
            Ok(self)
        } else {
            Err(format!("{}: sum of squares {rss:e} where {:e} is certified", self.name, self.certified_rss))
        }
    }
}

impl Problem for Regression {
    fn params(&self) -> &[Param] {
        self.formula.params()
    }

    fn residual(&self, x: &[f64]) -> Result<Vec<f64>, EvalError> {
        self.formula.residual(x)
    }

    fn linearize(&self, x: &[f64]) -> Result<Linearized, EvalError> {
        self.formula.linearize(x)
    }
}

/// All regressions whose `.dat` file is in `directory`, by name; an error where a model does not reproduce the
/// certified sum of squares.
pub fn read_all(directory: &Path) -> Result<Vec<Regression>, String> {
    let entries = std::fs::read_dir(directory).map_err(|e| format!("{}: {e}", directory.display()))?;
    let mut files: Vec<_> = entries.filter_map(|e| e.ok().map(|e| e.path())).collect();
    files.retain(|f| f.extension().is_some_and(|e| e == "dat"));
    files.sort();
    files.iter().map(|file| read(file).and_then(Regression::checked)).collect()
}

/// One `.dat` file.
pub fn read(file: &Path) -> Result<Regression, String> {
    let name = file.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
    let bytes = std::fs::read(file).map_err(|e| format!("{}: {e}", file.display()))?;
    parse(&name, &String::from_utf8_lossy(&bytes)).map_err(|why| format!("{}: {why}", file.display()))
}

fn parse(name: &str, text: &str) -> Result<Regression, String> {
    let model = model(name).ok_or("no model of that name")?;
    let lines: Vec<&str> = text.lines().collect();
    let (mut first, mut second, mut certified) = (Vec::new(), Vec::new(), Vec::new());
    let mut certified_rss = None;
    for line in &lines {
        let trimmed = line.trim_start();
        if let (true, Some((_, numbers))) = (trimmed.starts_with('b'), trimmed.split_once('=')) {
            let values = numbers_of(numbers)?;
            if let [a, b, c, ..] = values[..] {
                first.push(a);
                second.push(b);
                certified.push(c);
            }
        } else if let Some(value) = line.strip_prefix("Residual Sum of Squares:") {
            certified_rss = Some(value.trim().parse::<f64>().map_err(|e| e.to_string())?);
        }
    }
    let data = lines.iter().rposition(|l| l.starts_with("Data:")).ok_or("no data")?;
    let (mut response, mut predictors) = (Vec::new(), Vec::new());
    for line in lines[data + 1..].iter().filter(|l| !l.trim().is_empty()) {
        let values = numbers_of(line)?;
        let (y, x) = values.split_first().ok_or("an empty row")?;
        response.push(if name == "Nelson" { y.ln() } else { *y });
        predictors.push(x.to_vec());
    }
    let n = certified.len();
    let residual: Residual = Box::new(move |b| {
        Ok(predictors.iter().zip(&response).map(|(x, y): (&Vec<f64>, &f64)| model(b, x) - *y).collect())
    });
    Ok(Regression {
        name: name.into(),
        starts: [first, second],
        certified,
        certified_rss: certified_rss.ok_or("no residual sum of squares")?,
        formula: Formula::new(n, residual),
    })
}

fn numbers_of(text: &str) -> Result<Vec<f64>, String> {
    text.split_whitespace().map(|t| t.parse::<f64>().map_err(|e| format!("'{t}': {e}"))).collect()
}
