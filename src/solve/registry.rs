//! Every identifier by name.

use super::conic::Conic;
use super::identifier::Identifier;

/// All registered identifiers with their default settings, the default identifier first.
pub fn all() -> Vec<Box<dyn Identifier>> {
    vec![
        Box::new(super::minimal::Minimal::default()),
        Box::new(super::argmin_lm::ArgminLm::default()),
        Box::new(super::map::Map::default()),
        Box::new(super::limbwise::Limbwise),
        Box::new(Conic::bounded()),
        Box::new(Conic::ridge()),
        Box::new(Conic::lasso()),
        Box::new(Conic::group_lasso()),
        Box::new(Conic::huber()),
        Box::new(Conic::minimax()),
        Box::new(super::argmin_trust_region::ArgminTrustRegion),
        Box::new(super::argmin_lbfgs::ArgminLbfgs),
        Box::new(super::complete::Complete),
        Box::new(super::textbook::Textbook),
    ]
}

/// The identifier of that name, or the list of the names there are.
pub fn find(name: &str) -> Result<Box<dyn Identifier>, UnknownSolver> {
    let mut known = Vec::new();
    for identifier in all() {
        if identifier.name() == name {
            return Ok(identifier);
        }
        known.push(identifier.name());
    }
    Err(UnknownSolver { name: name.into(), known: known.join(", ") })
}

/// No identifier of that name.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("unknown solver '{name}'; known: {known}")]
pub struct UnknownSolver {
    name: String,
    known: String,
}
