//! Only benches: integrators of the plant (`integrators`).
