//! What came out, in one paragraph and two tables.

use super::errors::{self, measured};
use super::study::Study;
use crate::calibration::ByPosture;
use crate::cli::wording::counted;
use crate::files::ResultFile;
use crate::render::text::digits;
use crate::render::{Cell, Part, Section, Table};

/// The first paragraph of the page.
pub(super) fn intro(result: &ResultFile) -> String {
    let outcome = if result.converged { "" } else { "The identifier did not converge. " };
    let mut text =
        format!("{outcome}Stopped after {}: {}.", counted(result.iterations, "iteration"), result.reason);
    let which =
        if result.holdout.is_some() { "on readings that took no part" } else { "on the readings used" };
    if let (Some(first), Some(fit)) = (measured(result).first(), result.holdout.or(result.fit))
        && let (Some(before), Some(after)) = (first.rms(&fit.before), first.rms(&fit.after))
    {
        text.push_str(&format!(
            " The {} error {which} went from {} to {} {} (root mean square).",
            first.name,
            digits(before, 3),
            digits(after, 3),
            first.unit(result.units)
        ));
    }
    text
}

/// Tables of the outcome and of the errors, and what deserves attention.
pub(super) fn section(result: &ResultFile, study: &Result<Study, String>) -> Section {
    let mut section = Section::new("Summary")
        .with(Part::Table(errors::table(result)))
        .with(Part::Table(outcome(result, study)));
    if matches!(study, Ok(study) if !study.reproduced) {
        section.parts.push(Part::Text(
            "Attention: the problem file no longer gives the errors that the result states. It has changed since; \
             what is drawn below from residuals and covariances belongs to the file as it is now."
                .into(),
        ));
    }
    section.parts.extend(result.warnings.iter().map(|warning| Part::Text(format!("Attention: {warning}."))));
    section
}

fn outcome(result: &ResultFile, study: &Result<Study, String>) -> Table {
    let mut table = Table::new("outcome", "Outcome.", &["what", "value"]);
    let mut row = |what: &str, value: String| table.push(vec![Cell::text(what), Cell::text(value)]);
    row("problem", result.problem.clone());
    row("identifier", result.solver.clone());
    for (key, value) in &result.settings {
        row(&format!("setting {key}"), value.clone());
    }
    row("converged", if result.converged { "yes" } else { "no" }.into());
    row("reason", result.reason.clone());
    row("iterations", result.iterations.to_string());
    if let Ok(study) = study {
        let rows: usize = study.training.iter().map(|sample| sample.measurement.rows()).sum();
        let (postures, samples) = (ByPosture::of(&study.training).count(), study.training.len());
        match postures == samples {
            true => row("postures and readings", format!("{postures} and {rows}")),
            false => row("postures, samples and readings", format!("{postures}, {samples} and {rows}")),
        }
    }
    row("postures set aside", result.set_aside.len().to_string());
    row("parameters, structural", result.counts.structural.to_string());
    row("parameters, first order", result.counts.first_order.to_string());
    row("parameters, practical", result.counts.practical.to_string());
    if let Some(chi) = &result.chi_square {
        let freedom = digits(chi.degrees_of_freedom, 4);
        row("chi-square and degrees of freedom", format!("{} and {freedom}", digits(chi.value, 4)));
        if let Some(verdict) = &chi.verdict {
            row("residual", verdict.clone());
        }
    }
    if let Some(factor) = &result.tolerance_factor {
        row("tolerances", factor.verdict.clone());
        if factor.in_force != 1.0 {
            row("tolerances in force, times the stated ones", digits(factor.in_force, 4));
        }
    }
    if let Some(kkt) = result.kkt {
        row("KKT residual", digits(kkt, 3));
    }
    for bound in &result.active_bounds {
        row("active bound", format!("{} at {} tolerances", bound.name, digits(bound.limit, 3)));
    }
    table
}
