//! Benches alone: integrators of the plant (`integrators`).
