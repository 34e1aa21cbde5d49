//! tmp
use std::path::Path;
/// tmp
#[derive(Debug)]
pub struct InputError(pub String);
impl std::fmt::Display for InputError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}
impl InputError {
    /// tmp
    pub fn output(path: &Path, error: &std::io::Error) -> Self {
        Self(format!("{}: cannot be written: {error}", path.display()))
    }
}
