//! Gas in axial zones, port first: equal volumes, uniform pressure, each zone its own
//! mass and temperature.
//!
//! Since pressure is uniform, the energy balance of one zone fixes the enthalpy that crosses its faces: every zone
//! gains (V dP/dt + k P dV/dt)/((k-1) N), and the part not due to heat flows in from its neighbours. Mixing exchanges
//! equal volumes, which carry the same enthalpy at equal pressure, so that it moves only mass.

use thermyo_compute::math;

/// Volume that the jet recirculates, per volume that it brings: 0.47 D/d - 0.5 for a jet of diameter d
/// in a tube of diameter D (Thring and Newby, 4th Symp. Combustion, 1953), with 20 over 4.4 mm.
pub const RECIRCULATION: f64 = 1.6;
/// Reach of the jet's stirring: a confined jet meets the wall within some 3 diameters of the tube.
pub const JET_REACH_DIAMETERS: f64 = 3.0;
/// Axial diffusivity of the gas between strokes \[m2/s\]: five times the molecular value, to allow for buoyant
/// currents.
pub const BACKGROUND_DIFFUSIVITY: f64 = 1.0e-4;

/// Shares of a zone in the stirring of the flows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shares {
    /// Share of the inflow, mean 1 over the zones: for a coefficient with a constant part and a part that grows with
    /// inflow.
    pub inflow: f64,
    /// Share of the jet's forced convection.
    pub jet: f64,
    /// Share of the column's forced convection.
    pub column: f64,
}

impl Shares {
    /// A vessel, all of which a jet stirs: Woodfield's values are means over vessels. Its outflow stirs nothing: with a
    /// share of 1 the measured discharge of air (`docs/background/validation.md`) would be off by 8.9 instead of 3.1 K.
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
    /// Stirring for gas of this length and diameter \[m\].
    pub fn new(zones: usize, length_m: f64, diameter_m: f64) -> Self {
        // Limited to the range of the exponential: beyond, the first zone has all of the jet.
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

    /// Largest of each share over the zones.
    pub fn largest(&self) -> Shares {
        let none = Shares { inflow: 1.0, jet: 0.0, column: 0.0 };
        self.zones.iter().fold(none, |most, share| Shares {
            inflow: most.inflow.max(share.inflow),
            jet: most.jet.max(share.jet),
            column: most.column.max(share.column),
        })
    }

    /// Fastest rate \[1/s\] at which a zone's gas is replaced, for a volume \[m3\], a length \[m\] and volume flows in
    /// and out \[m3/s\]: by the flow through it, and by four times the exchange over a face, the largest eigenvalue of
    /// diffusion in cells.
    pub fn fastest_rate(&self, volume: f64, length: f64, inflow: f64, outflow: f64) -> f64 {
        let strongest = self.faces.iter().fold(0.0_f64, |most, face| face.max(most));
        // A single zone has no face.
        let background = if self.faces.is_empty() { 0.0 } else { self.background(volume, length) };
        let through = (inflow * (1.0 + 4.0 * strongest)).max(outflow);
        (through + 4.0 * background) * self.zones.len() as f64 / volume
    }

    /// Volume that diffusion exchanges each way over every face \[m3/s\], for gas of this volume \[m3\] and length
    /// \[m\].
    pub fn background(&self, volume: f64, length: f64) -> f64 {
        BACKGROUND_DIFFUSIVITY * volume * self.zones.len() as f64 / (length * length)
    }

    /// Volume exchanged each way over the face between `zone` and the next \[m3/s\], for a volume inflow \[m3/s\] and
    /// the background exchange.
    pub fn exchange(&self, zone: usize, volume_inflow: f64, background: f64) -> f64 {
        self.faces[zone] * volume_inflow + background
    }
}
