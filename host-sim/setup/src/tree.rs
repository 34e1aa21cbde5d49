//! A scenario as TOML, key by key.

use toml::Value;

pub(super) fn value<'a>(tree: &'a toml::Table, table: &str, key: &str) -> Option<&'a Value> {
    table.split('.').try_fold(tree, |tree, name| tree.get(name)?.as_table())?.get(key)
}

/// Whether values are equal to the bit, so that 0.0 and -0.0 differ.
pub(super) fn same(a: Option<&Value>, b: Option<&Value>) -> bool {
    match (a, b) {
        (Some(Value::Float(a)), Some(Value::Float(b))) => a.to_bits() == b.to_bits(),
        _ => a == b,
    }
}
