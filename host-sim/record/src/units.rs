//! Units of the columns of a trace.

/// The unit in the suffix of a name; none for a ratio, a count or a flag.
pub fn unit_of(name: &str) -> Option<&'static Unit> {
    JOINT_UNITS.iter().chain(&UNITS).find(|unit| name.ends_with(unit.suffix))
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Unit {
    suffix: &'static str,
    /// Name, as the SI writes it.
    pub name: &'static str,
    /// Exponents of kg, m, s and K.
    pub exponents: [(&'static str, i32); 4],
}

/// Units that only a joint's trace has; they come first.
pub const JOINT_UNITS: [Unit; 5] = [
    unit("_n_m_rad", "N m/rad", [1, 2, -2, 0]),
    unit("_rad_s", "rad/s", [0, 0, -1, 0]),
    unit("_rad", "rad", [0, 0, 0, 0]),
    unit("_n_m", "N m", [1, 2, -2, 0]),
    unit("_n", "N", [1, 1, -2, 0]),
];

/// Units of a muscle's trace. A suffix that ends another one comes after it.
pub const UNITS: [Unit; 7] = [
    unit("_pa", "Pa", [1, -1, -2, 0]),
    unit("_kg_s", "kg/s", [1, 0, -1, 0]),
    unit("_m3", "m3", [0, 3, 0, 0]),
    unit("_kg", "kg", [1, 0, 0, 0]),
    unit("_m", "m", [0, 1, 0, 0]),
    unit("_k", "K", [0, 0, 0, 1]),
    unit("_s", "s", [0, 0, 1, 0]),
];

const fn unit(suffix: &'static str, name: &'static str, [kg, m, s, k]: [i32; 4]) -> Unit {
    Unit { suffix, name, exponents: [("kg", kg), ("m", m), ("s", s), ("K", k)] }
}
