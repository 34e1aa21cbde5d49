//! Evaluation of a run: its page, comparison with others, replay, reproduction of the paper.

pub mod compare;
mod faulted;
pub mod replay;
pub mod reproduce;
pub mod run_page;
pub mod run_report;
pub mod signals;

pub use faulted::Faulted;
