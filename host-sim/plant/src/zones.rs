//! Gas in axial zones, port first: equal volumes, uniform pressure, each zone its own
//! mass and temperature.
//!
//! Pressure being uniform, the energy balance of one zone fixes the enthalpy that crosses its
//! faces: every zone gains (V dP/dt + k P dV/dt)/((k-1) N), and what heat does not account for flows in
//! from its neighbours. Mixing exchanges equal volumes, which at equal pressure carry the same
//! enthalpy, so that it moves mass only.

use thermyo_compute::math;

/// Volume that the jet recirculates, per volume that it brings: 0.47 D/d - 0.5 for a jet of diameter d
/// in a tube of diameter D (Thring and Newby, 4th Symp. Combustion, 1953), with 20 over 4.4 mm.
pub const RECIRCULATION: f64 = 1.6;
/// How far the jet stirs: a confined jet meets the wall within some 3 diameters of the tube.
pub const JET_REACH_DIAMETERS: f64 = 3.0;
/// Axial diffusivity of the gas between strokes \[m2/s\]: five times the molecular one, for the
/// buoyant currents.
pub const BACKGROUND_DIFFUSIVITY: f64 = 1.0e-4;

/// Shares of a zone in what the flows stir.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shares {
    /// Of the inflow, mean 1 over the zones: where the coefficient is a constant and a part that grows with inflow.
    pub inflow: f64,
    /// Of the jet's forced convection.
    pub jet: f64,
    /// Of the column's forced convection.
    pub column: f64,
}

impl Shares {
    /// A vessel, all of which a jet stirs: Woodfield's are means over vessels. Its outflow stirs nothing: with a share of
    /// 1 the measured discharge of air (`docs/background/validation.md`) would be 8.9 instead of 3.1 K off.
    pub const VESSEL: Self = Self { inflow: 1.0, jet: 1.0, column: 0.0 };
}

/// Where jet and mixing act along the muscle.
#[derive(Debug, Clone)]
pub struct Stirring {
    /// Strength of the jet at the face between zone i and i + 1 \[-\].
    faces: Vec<f64>,
    zones: Vec<Shares>,
}

impl Stirring {
    /// For gas of that length and diameter \[m\].
    pub fn new(zones: usize, length_m: f64, diameter_m: f64) -> Self {
        // Within the range of the exponential: beyond, the first zone has all of the jet.
        let decay = (length_m / (JET_REACH_DIAMETERS * diameter_m)).min(700.0);
        let at = |position: f64| math::exp(-decay * position / zones as f64);
        let strengths: Vec<f64> = (0..zones).map(|i| at(i as f64 + 0.5)).collect();
        let mean = strengths.iter().sum::<f64>() / zones as f64;
        let shares = |(i, strength): (usize, f64)| {
            let (from, to) = (i as f64, i as f64 + 1.0);
            Shares {
                inflow: strength / mean,
                // Means over the zone.
                jet: (at(from) - at(to)) * zones as f64 / decay,
                column: 1.0 - 0.5 * (from + to) / zones as f64,
            }
        };
        Self {
            faces: (1..zones).map(|i| RECIRCULATION * at(i as f64)).collect(),
            zones: strengths.into_iter().enumerate().map(shares).collect(),
        }
    }

    pub fn zones(&self) -> &[Shares] {
        &self.zones
    }

    /// The largest of each of these shares.
    pub fn largest(&self) -> Shares {
        let none = Shares { inflow: 1.0, jet: 0.0, column: 0.0 };
        self.zones.iter().fold(none, |most, share| Shares {
            inflow: most.inflow.max(share.inflow),
            jet: most.jet.max(share.jet),
            column: most.column.max(share.column),
        })
    }

    /// Fastest rate \[1/s\] at which a zone's gas is replaced, for gas of that volume \[m3\] and length \[m\] and volume flows
    /// in and out \[m3/s\]: by what flows through it, and by four times what is exchanged over a face, the largest eigenvalue of
    /// diffusion in cells.
    pub fn fastest_rate(&self, volume: f64, length: f64, inflow: f64, outflow: f64) -> f64 {
        let strongest = self.faces.iter().fold(0.0_f64, |most, face| face.max(most));
        // A single zone has no face.
        let background = if self.faces.is_empty() { 0.0 } else { self.background(volume, length) };
        let through = (inflow * (1.0 + 4.0 * strongest)).max(outflow);
        (through + 4.0 * background) * self.zones.len() as f64 / volume
    }

    /// Volume that diffusion exchanges each way over every face \[m3/s\], of gas of that volume \[m3\] and
    /// length \[m\].
    pub fn background(&self, volume: f64, length: f64) -> f64 {
        BACKGROUND_DIFFUSIVITY * volume * self.zones.len() as f64 / (length * length)
    }

    /// Volume exchanged each way over the face between `zone` and the next \[m3/s\], for a volume flow
    /// in \[m3/s\] and the exchange of the background.
    pub fn exchange(&self, zone: usize, volume_inflow: f64, background: f64) -> f64 {
        self.faces[zone] * volume_inflow + background
    }
}
