//! The smoother, and work that is stopped.

mod smoother;
mod stop;
