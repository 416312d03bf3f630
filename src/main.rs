//! gough
fn main() {}
