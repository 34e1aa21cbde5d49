//! What is made of a run: its page, its comparison with another, its replay, the reproduction of the paper.

pub mod compare;
mod faulted;
pub mod replay;
pub mod reproduce;
pub mod run_page;
pub mod run_report;
pub mod signals;

pub use faulted::Faulted;
