//! The board that a `Board` holds until it is closed.

use crate::error::BoardError;
use pyo3::prelude::*;
use std::sync::{Mutex, MutexGuard, PoisonError};
use thermyo_boards::live::LiveBoard;

pub struct Held(Mutex<Option<LiveBoard>>);

impl Held {
    pub fn new(live: LiveBoard) -> Self {
        Self(Mutex::new(Some(live)))
    }

    pub fn lock(&self) -> MutexGuard<'_, Option<LiveBoard>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Uses the board without holding the interpreter's lock.
    pub fn with<T: Send>(
        &self,
        py: Python<'_>,
        using: impl FnOnce(&mut LiveBoard) -> PyResult<T> + Send,
    ) -> PyResult<T> {
        py.detach(|| match self.lock().as_mut() {
            Some(board) => using(board),
            None => Err(BoardError::new_err("the board is closed")),
        })
    }
}
