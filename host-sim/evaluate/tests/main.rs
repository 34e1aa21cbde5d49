//! The smoother, and stopped work.

mod smoother;
mod stop;
