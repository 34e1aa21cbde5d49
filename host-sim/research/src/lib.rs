//! Benches alone: forms of the filter (`filter_forms`), integrators of the plant (`integrators`).
