//! The `thermyo` command.
fn main() {}
