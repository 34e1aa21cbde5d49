//! Drivers of the digital sensors that the firmware reads, over the traits of `embedded-hal-async`. They give raw codes:
//! what a code stands for is `model_core::sensing`'s business.

#![no_std]
#![forbid(unsafe_code)]
#![cfg_attr(not(test), deny(clippy::indexing_slicing, clippy::unwrap_used))]

#[cfg(test)]
extern crate std;

pub mod max31865;
pub mod mpr;

/// Why there is no reading.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Error<E> {
    /// The bus failed, or nobody answered.
    Bus(E),
    /// Not the part that was started: nobody is there, another chip is, or its power was gone.
    NotThere,
    /// The part says that its sensor, or it itself, is broken.
    Broken,
}

impl<E> From<E> for Error<E> {
    fn from(error: E) -> Self {
        Self::Bus(error)
    }
}

/// Waits for what a mock has ready at once.
#[cfg(test)]
fn now<F: Future>(future: F) -> F::Output {
    let mut future = std::boxed::Box::pin(future);
    let mut context = core::task::Context::from_waker(core::task::Waker::noop());
    match future.as_mut().poll(&mut context) {
        core::task::Poll::Ready(output) => output,
        core::task::Poll::Pending => panic!("a mock does not wait"),
    }
}
