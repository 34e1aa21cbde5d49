//! The file of a unit: its archive, and the shared library in it.

pub mod archive;
pub mod library;
mod zip;
