//! Drivers of the digital sensors that the firmware reads, over the traits of `embedded-hal-async`.
//! They return raw codes, which `model_core::sensing` converts.

#![no_std]
#![forbid(unsafe_code)]
#![cfg_attr(not(test), deny(clippy::indexing_slicing, clippy::unwrap_used))]

#[cfg(test)]
extern crate std;

pub mod as5600;
pub mod max31865;
pub mod mpr;

/// Reason why there is no reading.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Error<E> {
    /// The bus failed, or there was no answer.
    Bus(E),
    /// Not the chip that was started: it is missing, it was replaced, or it has lost power.
    NotThere,
    /// The chip reports that its sensor, or the chip itself, is broken.
    Broken,
}

impl<E> From<E> for Error<E> {
    fn from(error: E) -> Self {
        Self::Bus(error)
    }
}

/// Runs a future that is ready at once, as a mock's are.
#[cfg(test)]
fn now<F: Future>(future: F) -> F::Output {
    let mut future = std::boxed::Box::pin(future);
    let mut context = core::task::Context::from_waker(core::task::Waker::noop());
    match future.as_mut().poll(&mut context) {
        core::task::Poll::Ready(output) => output,
        core::task::Poll::Pending => panic!("a mock does not wait"),
    }
}
