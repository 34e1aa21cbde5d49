//! The gas along the muscle: four zones of equal volume, port first, each with its own mass and wall.
//!
//! At one pressure P in all zones, the energy balance of the zones beyond a face gives the enthalpy that crosses it (V
//! dP + k P dV for each zone, and the heat Q that it loses), and thus the volume that moves:
//!
//! ```text
//! H_f = sum over the zones beyond of (H_port - Q)/4 + Q_i
//! x_f = 4 H_f/(k E)                        in volumes of a zone, with E = P V/(k-1)
//! dm_f = x_f (3/4 m_behind + 1/4 m_ahead) + y_f (m_(f-1) - m_f)
//! ```
//!
//! where y_f is what jet and diffusion exchange. Taking all of x_f from behind would mix as much as four stirred
//! vessels in series; a quarter from ahead makes it eight. Gas in a tube mixes less than either.
//!
//! A large valve on a small chamber replaces a zone's gas within one movement. Masses that grow meanwhile would then
//! count as if they had been as large all the time; instead, the shape of the masses moves ([`Zones::replaced`]).

use super::coefficients::Coefficients;
use super::per_zone::{PerZone, ZONES, least, minus, plus, scaled, times, total};
use super::profile::{Conduction, Modes, SETTLED_CONDUCTION};
use crate::math::{absolute, limit, sqrt};

/// Share of the gas across a face that comes from ahead \[-\].
const AHEAD: f32 = 0.25;
/// Powers of the temperature with which the conductivity of air grows, and with which buoyancy's lambda^3/(T^3 mu)
/// falls, at 300 K: Sutherland's laws of conductivity and viscosity (White, Viscous Fluid Flow, tables 1-2 and 1-3) have
/// slopes of 0.893 and 0.770 there.
const CONDUCTIVITY: f32 = 0.893;
const BUOYANCY: f32 = 3.0 + 0.770 - 3.0 * CONDUCTIVITY;
/// Volumes of a zone that must cross a face to replace its gas \[-\].
const REPLACED: f32 = 1.0;
/// Smallest and largest mass of a zone, in shares of the mean \[-\].
const LEAST: f32 = 0.3;
const MOST: f32 = 3.0;

/// Heat transfer to the wall for as long as it is kept: `per_k` of the gas's mean temperature, less `offset_j`, in one
/// step.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Exchange {
    /// \[J/K\].
    pub per_k: f32,
    /// \[J\].
    pub offset_j: f32,
    /// Conductance of each zone, and its part due to flows that stir \[J/K\].
    pub zone_j_k: PerZone,
    pub stirred_j_k: PerZone,
    pub jet: Jet,
    /// Energy that the profile adds in each zone \[J\].
    pub profile_j: PerZone,
    /// Conductance for a persistent error, over that of a profile that has formed \[-\].
    pub settled: f32,
    pub still: Still,
}

/// Still gas.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Still {
    /// Conductance of each zone once its profile has formed \[J/K\].
    pub formed_j_k: PerZone,
    pub conduction: [Conduction; ZONES],
    pub turn: Turn,
}

/// Zones whose still gas follows next.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Turn {
    #[default]
    All,
    Even,
    Odd,
}

impl Turn {
    fn skips(self, zone: usize) -> bool {
        match self {
            Self::All => false,
            Self::Even => !zone.is_multiple_of(2),
            Self::Odd => zone.is_multiple_of(2),
        }
    }

    fn next(self) -> Self {
        if self == Self::Even { Self::Odd } else { Self::Even }
    }
}

/// Heat transfer by a jet that stirs only while it lasts: a step's is `per_k` of the gas's mean temperature, less
/// `offset_j`, for each kilogram that comes in.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Jet {
    /// \[J/(K kg)\].
    per_k: f32,
    /// \[J/kg\].
    offset_j: f32,
    /// Conductance of each zone \[J/(K kg)\].
    zone_j_k: PerZone,
    /// Largest mass that counts in a step \[kg\]: within one movement the gas does not pass its wall's temperature.
    most_kg: f32,
}

impl Jet {
    /// Heat to the wall in a step \[J\] whose enthalpy exceeds the heat to the wall without it by `net_j`: net
    /// q/(cp T_s - q) for a heat of q per mass. `per_j`: 1/(cp T_s) \[kg/J\].
    #[inline(never)] // Few muscles have such jets.
    pub fn heat_j(&self, net_j: f32, per_j: f32, gas_k: f32) -> f32 {
        // Gas that fills gives off up to 0.3 of cp T_s for each mass; hotter gas, within a few steps, more.
        const MOST: f32 = 0.75;
        let per_mass_j = self.per_k * gas_k - self.offset_j;
        let part = limit(per_mass_j * per_j, -1.0, MOST);
        let most_j = absolute(per_mass_j) * self.most_kg;
        limit(net_j * part / (1.0 - part), -most_j, most_j)
    }

    /// Conductance of each zone in a step \[J/K\], in the mean over a movement in which this mass comes in \[kg\].
    fn mean_j_k(&self, inflow_kg: f32, steps: f32) -> PerZone {
        scaled(&self.zone_j_k, limit(inflow_kg / steps, 0.0, self.most_kg))
    }
}

impl Exchange {
    /// Adds the jet of a movement that has ended.
    pub fn add_jet(&mut self, flow: &Flow) {
        let jet_j_k = self.jet.mean_j_k(flow.inflow_kg, f32::from(flow.steps));
        self.stirred_j_k = plus(&self.stirred_j_k, &jet_j_k);
        self.zone_j_k = plus(&self.zone_j_k, &jet_j_k);
    }

    /// Share of still gas in the conductance at a foil that averages over the zones with these weights \[-\].
    pub fn still_share(&self, weights: &PerZone) -> f32 {
        let formed_j_k = total(&times(weights, &self.still.formed_j_k));
        let all = formed_j_k + total(&times(weights, &self.stirred_j_k));
        if all > 0.0 { formed_j_k / all } else { 1.0 }
    }

    /// Conductance of each zone for a persistent error \[J/K\].
    pub fn settled_j_k(&self) -> PerZone {
        plus(&self.stirred_j_k, &scaled(&self.still.formed_j_k, self.settled))
    }
}

/// Sums over some steps that move the zones.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Flow {
    pub steps: u16,
    /// Sum of the gas temperatures \[K\].
    pub gas_k: f32,
    pub inflow_kg: f32,
    pub outflow_kg: f32,
    /// Enthalpy that came in \[J\].
    pub enthalpy_j: f32,
    /// Energy before \[J\].
    pub energy_j: f32,
    pub flowing_steps: u16,
}

impl Flow {
    /// Begins a step with this energy \[J\].
    pub fn begin(&mut self, energy_j: f32) {
        if self.steps == 0 {
            self.energy_j = energy_j;
        }
    }

    /// Ends a step at this temperature of the gas \[K\].
    pub fn end(&mut self, gas_k: f32) {
        self.steps += 1;
        self.gas_k += gas_k;
    }

    /// Scales what flowed and the energy, because the volume was wrong by this factor.
    pub fn scale(&mut self, by: f32) {
        for sum in
            [&mut self.inflow_kg, &mut self.outflow_kg, &mut self.enthalpy_j, &mut self.energy_j]
        {
            *sum *= by;
        }
    }
}

/// State of the chamber while the zones move.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    pub energy_j: f32,
    pub pressure_pa: f32,
    pub length_m: f32,
    pub rest_length_m: f32,
    pub volume_m3: f32,
    pub surface_m2: f32,
    /// Increase of the muscle's length \[m\].
    pub way_m: f32,
    /// Heat of friction to the wall, over the movement before \[J\].
    pub friction_j: f32,
    pub mass_kg: f32,
}

impl Place {
    /// State before the first reading.
    pub const NONE: Self = Self {
        energy_j: 0.0,
        pressure_pa: 1.0e5,
        length_m: 0.0,
        rest_length_m: 0.0,
        volume_m3: 0.0,
        surface_m2: 0.0,
        way_m: 0.0,
        friction_j: 0.0,
        mass_kg: 1.0,
    };
}

/// Gas that crossed the three faces between the zones, up and down, in shares of a zone's gas \[-\].
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Faces {
    pub up: [f32; 3],
    pub down: [f32; 3],
}

/// Result of one movement of the zones.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Moved {
    pub steps: u16,
    pub faces: Faces,
    /// Heat to the wall, and the part of it by stirring \[J\].
    pub heat_j: PerZone,
    pub stirred_j: PerZone,
    /// Temperatures in the middle of it \[K\].
    pub gas_k: PerZone,
    pub energy_j: f32,
}

/// Masses and walls of the zones.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Zones {
    /// Mass of each \[kg\].
    pub mass_kg: PerZone,
    /// Temperature over the mean \[-\].
    pub ratio: PerZone,
    /// Inner layer of the wall, and the outer one \[K\].
    pub wall_k: PerZone,
    pub outer_k: PerZone,
    /// Mean of the inner layer \[K\]; kept, because every step needs it.
    mean_wall_k: f32,
    /// Flows through the port as the gas still feels them \[kg/s\].
    stirring_in: f32,
    stirring_out: f32,
    /// Profile of still gas in each.
    pub profile_k: [Modes; ZONES],
}

impl Faces {
    /// Whether so much gas crosses the first face, where most does, that it replaces a zone's gas.
    pub fn replace_a_zone(&self) -> bool {
        let [first, ..] = self.net();
        absolute(first) > REPLACED
    }

    fn net(&self) -> [f32; 3] {
        let Self { up: [p1, p2, p3], down: [q1, q2, q3] } = self;
        [p1 - q1, p2 - q2, p3 - q3]
    }
}

impl Zones {
    /// Zones with this mass of gas \[kg\], everything at this temperature \[K\].
    pub fn at(temperature_k: f32, mass_kg: f32) -> Self {
        Self {
            mass_kg: [mass_kg / ZONES as f32; ZONES],
            ratio: [1.0; ZONES],
            wall_k: [temperature_k; ZONES],
            outer_k: [temperature_k; ZONES],
            mean_wall_k: temperature_k,
            stirring_in: 0.0,
            stirring_out: 0.0,
            profile_k: [[0.0; 2]; ZONES],
        }
    }

    /// Mean of the inner wall \[K\].
    pub fn mean_wall_k(&self) -> f32 {
        self.mean_wall_k
    }

    /// Sets both layers of the wall \[K\].
    pub fn set_walls(&mut self, wall_k: &PerZone, outer_k: &PerZone) {
        (self.wall_k, self.outer_k) = (*wall_k, *outer_k);
        self.mean_wall_k = total(wall_k) * (1.0 / ZONES as f32);
    }

    /// Sets both layers of the wall to one temperature \[K\].
    pub fn set_walls_to(&mut self, temperature_k: f32) {
        self.set_walls(&[temperature_k; ZONES], &[temperature_k; ZONES]);
    }

    /// Scales the masses to this sum \[kg\], with no zone far from the others.
    pub fn set_mass(&mut self, mass_kg: f32) {
        let mean_kg = mass_kg * (1.0 / ZONES as f32);
        let limited = self.mass_kg.map(|kg| limit(kg, LEAST * mean_kg, MOST * mean_kg));
        self.mass_kg = scaled(&limited, mass_kg / total(&limited));
        self.ratio = self.mass_kg.map(|kg| mean_kg / kg);
    }

    /// Returns the heat transfer in a step, for these factors on the configured values: on all of it, and on the
    /// stirred part.
    pub fn exchange(
        &self,
        c: &Coefficients,
        (scale, stirring): (f32, f32),
        place: &Place,
        gas_k: f32,
        before: &Still,
    ) -> Exchange {
        let share = scale * place.surface_m2 * c.step_s * (1.0 / ZONES as f32);
        let gas_k = scaled(&self.ratio, gas_k);
        let film = plus(&gas_k, &self.wall_k).map(|sum_k| c.film(sum_k));
        let still = self.still(c, place, share, (&gas_k, &film), before);
        let lasting = if c.stirring.lasts { c.stirring.forced(self.stirring_in) } else { 0.0 };
        let stirred = plus(
            &scaled(&c.jet, lasting),
            &scaled(&c.column, c.stirring.forced(self.stirring_out)),
        );
        let stirred_j_k = scaled(&times(&stirred, &film.map(conductivity)), share * stirring);
        // Within one movement no zone passes the temperature of its wall.
        let most_j_kg_k = c.gas.cp_j_kg_k() * c.per_move * ZONES as f32;
        let stirred_j_k = least(&stirred_j_k, &scaled(&self.mass_kg, most_j_kg_k));
        let zone_j_k = scaled(&still.conduction.map(|zone| zone.per_k), c.per_move * ZONES as f32);
        let zone_j_k = plus(&zone_j_k, &stirred_j_k);
        let mut profile_j = [0.0; ZONES];
        for (profile_j, (zone, modes_k)) in
            profile_j.iter_mut().zip(still.conduction.iter().zip(&self.profile_k))
        {
            *profile_j = c.per_move * ZONES as f32 * zone.profile_j(modes_k);
        }
        Exchange {
            per_k: total(&times(&zone_j_k, &self.ratio)),
            offset_j: total(&times(&zone_j_k, &self.wall_k)) - total(&profile_j),
            zone_j_k,
            stirred_j_k,
            jet: self.jet(c, scale * stirring * place.surface_m2, most_j_kg_k),
            profile_j,
            settled: if c.profile.exists { SETTLED_CONDUCTION } else { 1.0 },
            still,
        }
    }

    /// Jet whose stirring does not last, for the scaled surface of the gas \[m2\] and the largest conductance in a step
    /// per mass \[J/(K kg)\].
    fn jet(&self, c: &Coefficients, surface_m2: f32, most_j_kg_k: f32) -> Jet {
        if c.stirring.lasts {
            return Jet::default();
        }
        // No zone gives off more than it has within a movement: it would swing about its wall.
        const LEAST_KG: f32 = 1.0e-12;
        let step_kg = limit(self.stirring_in * c.step_s, LEAST_KG, f32::MAX);
        let most_zone_j_k = scaled(&self.mass_kg, most_j_kg_k / step_kg);
        let zone_j_k = scaled(&c.jet, surface_m2 * (1.0 / ZONES as f32));
        let zone_j_k = least(&zone_j_k, &most_zone_j_k);
        let per_k = total(&times(&zone_j_k, &self.ratio));
        let most_j_k = most_j_kg_k * total(&self.mass_kg);
        let most_kg = if per_k > 0.0 { most_j_k / per_k } else { 0.0 };
        Jet { per_k, offset_j: total(&times(&zone_j_k, &self.wall_k)), zone_j_k, most_kg }
    }

    /// Still gas of this share of the surface in a step \[m2 s\], temperatures \[K\] and films. With a profile, which
    /// takes most of the work, two zones follow with each movement, and the others with the next.
    fn still(
        &self,
        c: &Coefficients,
        place: &Place,
        share: f32,
        (gas_k, film): (&PerZone, &PerZone),
        before: &Still,
    ) -> Still {
        let mut still = Still { turn: before.turn.next(), ..*before };
        let per_pa2 = place.pressure_pa * place.pressure_pa;
        let steps = f32::from(c.counts.move_steps);
        let zone_m2 = place.surface_m2 * (1.0 / ZONES as f32);
        let per_zone_m3 = ZONES as f32 / place.volume_m3;
        let gas = gas_k.iter().zip(&self.wall_k).zip(film).zip(&self.mass_kg);
        let zones = still.formed_j_k.iter_mut().zip(&mut still.conduction).zip(gas);
        for (i, ((formed_j_k, conduction), (((gas_k, wall_k), film), mass_kg))) in zones.enumerate()
        {
            if c.profile.exists && before.turn.skips(i) {
                continue;
            }
            let pa2_k = per_pa2 * absolute(gas_k - wall_k);
            *formed_j_k = share * c.still_w_m2_k(pa2_k, *film);
            *conduction = Conduction::even(steps * *formed_j_k);
            if c.profile.exists {
                let density_kg_m3 = mass_kg * per_zone_m3;
                *conduction = Conduction::new(&c.profile, conduction.per_k, density_kg_m3, zone_m2);
            }
        }
        still
    }

    /// Moves gas and walls by a number of steps.
    pub fn advance(
        &mut self,
        c: &Coefficients,
        flow: &Flow,
        exchange: &Exchange,
        place: &Place,
    ) -> Moved {
        let steps = f32::from(flow.steps);
        let duration_s = steps * c.step_s;
        let mean_k = flow.gas_k / steps;
        let gas_k = scaled(&self.ratio, mean_k);
        let excess_k = minus(&gas_k, &self.wall_k);
        if c.profile.exists {
            let zones = exchange.still.conduction.iter().zip(&excess_k);
            for (modes_k, (zone, excess_k)) in self.profile_k.iter_mut().zip(zones) {
                *modes_k = zone.advance(modes_k, *excess_k);
            }
        }
        let excess_k = scaled(&excess_k, steps);
        let profile_j = scaled(&exchange.profile_j, steps);
        let heat_j = plus(&times(&exchange.zone_j_k, &excess_k), &profile_j);
        let stirred_j = times(&exchange.stirred_j_k, &excess_k);
        let energy_j = 0.5 * (flow.energy_j + place.energy_j);
        let faces = self.faces(c, flow, place, &heat_j, energy_j);
        let port_kg = flow.inflow_kg - flow.outflow_kg;
        self.mass_kg = if faces.replace_a_zone() {
            self.replaced(&faces.net(), (flow.energy_j, place.energy_j), port_kg)
        } else {
            self.transported(&faces, port_kg)
        };
        let before = self.ratio;
        self.set_mass(place.mass_kg);
        self.warm_walls(c, place, &heat_j, duration_s);
        let stirring = |flow_kg: f32, stirs: f32| {
            stirs + c.stirring.share * (limit(flow_kg, 0.0, f32::MAX) * (1.0 / duration_s) - stirs)
        };
        self.stirring_in = stirring(flow.inflow_kg, self.stirring_in);
        self.stirring_out = stirring(flow.outflow_kg, self.stirring_out);
        let gas_k = scaled(&plus(&before, &self.ratio), 0.5 * mean_k);
        Moved { steps: flow.steps, faces, heat_j, stirred_j, gas_k, energy_j }
    }

    fn faces(
        &self,
        c: &Coefficients,
        flow: &Flow,
        place: &Place,
        heat_j: &PerZone,
        energy_j: f32,
    ) -> Faces {
        let per_zone = 1.0 / ZONES as f32;
        let gain_j = (flow.enthalpy_j - total(heat_j)) * per_zone;
        let [_, second_j, third_j, last_j] = heat_j;
        let last = gain_j + last_j;
        let third = last + gain_j + third_j;
        let second = third + gain_j + second_j;
        let per_j = ZONES as f32 / (c.gas.heat_capacity_ratio * energy_j);
        // Volume that came in, relative to a zone's.
        let jet = limit(flow.inflow_kg, 0.0, 1.0) * c.supply_r_j_kg * ZONES as f32
            / (place.pressure_pa * place.volume_m3);
        let gas_length_m = limit(
            c.length_m + place.length_m - place.rest_length_m,
            0.2 * c.length_m,
            5.0 * c.length_m,
        );
        let steps_s = f32::from(flow.steps) * c.step_s;
        let diffused =
            c.diffusivity_m2_s * (ZONES * ZONES) as f32 * steps_s / (gas_length_m * gas_length_m);
        let mut faces = Faces::default();
        let crossing = [second, third, last].into_iter().zip(c.recirculation);
        for ((up, down), (enthalpy_j, recirculation)) in
            faces.up.iter_mut().zip(&mut faces.down).zip(crossing)
        {
            let volumes = per_j * enthalpy_j;
            let (forth, back) = if volumes > 0.0 { (volumes, 0.0) } else { (0.0, -volumes) };
            let mixed = recirculation * jet + diffused - AHEAD * (forth + back);
            *up = forth + mixed;
            *down = back + mixed;
        }
        faces
    }

    /// Returns the masses after the gas crossed the faces, and after `port_kg` came through the port \[kg\]: Crank and
    /// Nicolson's mean of before and after, or after alone where much mixes.
    fn transported(&self, faces: &Faces, port_kg: f32) -> PerZone {
        const AT_ONCE: f32 = 1.0;
        let Faces { up: [p1, p2, p3], down: [q1, q2, q3] } = *faces;
        let [m0, m1, m2, m3] = self.mass_kg;
        let most =
            [p1 + q1, p2 + q2, p3 + q3].into_iter().fold(0.0, |most, x| limit(x, most, f32::MAX));
        let after = if most > AT_ONCE { 1.0 } else { 0.5 };
        let before = 1.0 - after;
        let f1 = before * (p1 * m0 - q1 * m1);
        let f2 = before * (p2 * m1 - q2 * m2);
        let f3 = before * (p3 * m2 - q3 * m3);
        let (p1, p2, p3) = (after * p1, after * p2, after * p3);
        let (q1, q2, q3) = (after * q1, after * q2, after * q3);
        // Thomas: elimination from the port, substitution back.
        let d0 = 1.0 / (1.0 + p1);
        let r0 = (m0 + port_kg - f1) * d0;
        let u0 = q1 * d0;
        let d1 = 1.0 / (1.0 + q1 + p2 - p1 * u0);
        let r1 = (m1 + f1 - f2 + p1 * r0) * d1;
        let u1 = q2 * d1;
        let d2 = 1.0 / (1.0 + q2 + p3 - p2 * u1);
        let r2 = (m2 + f2 - f3 + p2 * r1) * d2;
        let u2 = q3 * d2;
        let d3 = 1.0 / (1.0 + q3 - p3 * u2);
        let r3 = (m3 + f3 + p3 * r2) * d3;
        let r2 = r2 + u2 * r3;
        let r1 = r1 + u1 * r2;
        [r0 + u0 * r1, r1, r2, r3]
    }

    /// Returns the shape of the masses where a zone's gas is replaced. While all zones become denser or larger by the
    /// same factor e^g, and gas of that density crosses the faces, the shape stays: dn_i/dt = x_i (n_(i-1) - n_i) for n
    /// = m/e^g and the volumes x_i that come in, taken after the movement. Gas that came through the port \[kg\] in
    /// proportion to that growth counts with g/(e^g - 1). The crossing volume while the energy changes is dH/(k E) at
    /// every instant: divided by the logarithmic mean of the energies, by Polya (2 G + A)/3 of their geometric and
    /// arithmetic means.
    #[cold] // In few muscles: as small as can be.
    fn replaced(&self, net: &[f32; 3], (before_j, after_j): (f32, f32), port_kg: f32) -> PerZone {
        let arithmetic_j = 0.5 * (before_j + after_j);
        let per_mean = 3.0 * arithmetic_j / (2.0 * sqrt(before_j * after_j) + arithmetic_j);
        let [x1, x2, x3] = net.map(|volumes| absolute(volumes) * per_mean);
        let [m0, m1, m2, m3] = self.mass_kg;
        let joined = |own_kg: f32, x: f32, behind_kg: f32| (own_kg + x * behind_kg) / (1.0 + x);
        let [first, ..] = *net;
        if first > 0.0 {
            // g is the volume across the last face, x3: growth of one zone. Growth of three passes the first face, of
            // four the port.
            let growth = 1.0 + x3 * (1.0 / 2.0 + x3 * (1.0 / 6.0 + x3 * (1.0 / 24.0)));
            let m0 = (m0 + port_kg / growth) / (1.0 + x1 * (4.0 / 3.0));
            let m1 = joined(m1, x1, m0);
            let m2 = joined(m2, x2, m1);
            [m0, m1, m2, joined(m3, x3, m2)]
        } else {
            let m2 = joined(m2, x3, m3);
            let m1 = joined(m1, x2, m2);
            [joined(m0, x1, m1), m1, m2, m3]
        }
    }

    fn warm_walls(&mut self, c: &Coefficients, place: &Place, heat_j: &PerZone, duration_s: f32) {
        let speed_m_s = place.way_m / duration_s;
        let lost_j_k = c.heat.outer_w_k(place.surface_m2, speed_m_s) * duration_s;
        let friction_j = place.friction_j;
        let ambient_k = [c.ambient.temperature_k; ZONES];
        let friction_j = [friction_j * (1.0 / ZONES as f32); ZONES];
        let per_inner = ZONES as f32 / c.wall_j_k;
        let (wall_k, outer_k);
        // A wall does not overshoot its surroundings.
        if c.layers_w_k > 0.0 {
            let per_outer = ZONES as f32 / c.outer_j_k;
            let through = minus(&self.wall_k, &self.outer_k);
            let through_j = scaled(&through, c.layers_w_k * duration_s * (1.0 / ZONES as f32));
            let lost_share = limit(lost_j_k / c.outer_j_k, 0.0, 1.0);
            let lost_k = scaled(&minus(&self.outer_k, &ambient_k), lost_share);
            let gained_j = plus(&through_j, &friction_j);
            outer_k = plus(&self.outer_k, &minus(&scaled(&gained_j, per_outer), &lost_k));
            let inner_j = minus(heat_j, &through_j);
            wall_k = plus(&self.wall_k, &scaled(&inner_j, per_inner));
        } else {
            let lost_share = limit(lost_j_k / c.wall_j_k, 0.0, 1.0);
            let lost_k = scaled(&minus(&self.wall_k, &ambient_k), lost_share);
            let gained_j = plus(heat_j, &friction_j);
            wall_k = plus(&self.wall_k, &minus(&scaled(&gained_j, per_inner), &lost_k));
            outer_k = self.outer_k;
        }
        let sound = |k: f32| limit(k, super::COLDEST_K, super::HOTTEST_K);
        self.set_walls(&wall_k.map(sound), &outer_k.map(sound));
    }
}

impl Coefficients {
    /// How much warmer a film is than the one for which the configured coefficients hold, share of its temperature
    /// \[-\], for the sum of its gas and wall temperatures \[K\]. Coefficients that are no laws of air, without a profile,
    /// hold for any film.
    fn film(&self, sum_k: f32) -> f32 {
        if self.profile.exists { sum_k * self.per_film_k - 1.0 } else { 0.0 }
    }

    /// Heat transfer coefficient of still gas for the square of the pressure times the difference from the wall \[Pa2
    /// K\] and the film: conduction, or buoyancy where it is stronger, h^4 = h_c^4 + h_b^4 (Churchill and Usagi, AIChE J.
    /// 18, 1972), h_b^4 in proportion to lambda^4 times the Rayleigh number, that is, to P^2 dT lambda^3/(T^3 mu).
    fn still_w_m2_k(&self, pa2_k: f32, film: f32) -> f32 {
        if self.buoyancy4 < f32::MIN_POSITIVE {
            return self.heat.inner_w_m2_k * conductivity(film);
        }
        let square = conductivity(film) * conductivity(film);
        let buoyancy = self.buoyancy4 * pa2_k * limit(1.0 - BUOYANCY * film, 0.0, 2.0);
        sqrt(sqrt(self.conduction4 * square * square + buoyancy))
    }
}

/// Conductivity of air over that of the film for which the coefficients hold \[-\]; see [`CONDUCTIVITY`].
fn conductivity(film: f32) -> f32 {
    1.0 + CONDUCTIVITY * film
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Config;

    /// Coefficients of air in a bore of 20 mm, with this buoyancy.
    fn air(buoyancy_w_m2_k: f32) -> Coefficients {
        let mut config = Config::default();
        config.heat.inner_w_m2_k = 7.5;
        (config.zones.bore_m, config.zones.buoyancy_w_m2_k) = (0.02, buoyancy_w_m2_k);
        Coefficients::new(&config)
    }

    /// Conductance of still gas in the zones of these shares of the mean mass, at 2 bar, relative to a wall at ambient
    /// temperature \[-\].
    fn formed(c: &Coefficients, shares: PerZone, gas_k: f32) -> PerZone {
        let mut zones = Zones::at(c.ambient.temperature_k, 4.0e-4);
        zones.mass_kg = scaled(&shares, 1.0e-4);
        zones.set_mass(4.0e-4);
        let place = Place {
            pressure_pa: 2.0e5,
            surface_m2: 0.02,
            volume_m3: 1.0e-4,
            mass_kg: 4.0e-4,
            ..Place::NONE
        };
        let exchange = zones.exchange(c, (1.0, 0.0), &place, gas_k, &Still::default());
        scaled(&exchange.still.formed_j_k, ZONES as f32 / (0.02 * c.step_s * 7.5))
    }

    #[test]
    fn still_air_conducts_as_its_film_does() {
        let sutherland = |t: f64| t * t.sqrt() / (t + 194.0);
        let c = air(0.0);
        let wall_k = f64::from(c.ambient.temperature_k);
        for above_k in [-60.0, -20.0, 20.0, 60.0] {
            let film_k = wall_k + 0.5 * above_k;
            let exact = sutherland(film_k) / sutherland(wall_k + 10.0);
            let [ours, ..] = formed(&c, [1.0; ZONES], (wall_k + above_k) as f32);
            assert!((f64::from(ours) / exact - 1.0).abs() < 0.005, "{above_k} K: {ours}, {exact}");
        }
    }

    /// Where the mean gas is as warm as its wall, the zones are not.
    #[test]
    fn each_zone_convects_by_its_own_difference() {
        let c = air(10.0);
        let [warm, even, _, cold] = formed(&c, [0.95, 1.0, 1.0, 1.05], c.ambient.temperature_k);
        assert!((0.9..1.0).contains(&even), "{even}");
        assert!((1.2..1.6).contains(&warm) && (1.2..1.6).contains(&cold), "{warm} {cold}");
    }

    /// Ratios of the zones after gas has compressed the original gas fourfold without mixing: a layer that comes in at
    /// the pressure p has its own temperature there and (p_end/p)^((k-1)/k) times that in the end, where it fills the
    /// volume down to (p/p_end)^(1/k) of all.
    fn plug_flow(k: f64) -> [f64; ZONES] {
        const LAYERS: usize = 1000;
        let first = 0.25_f64.powf(1.0 / k);
        let density = |x: f64| (1.0 - x).max(first).powf(k - 1.0);
        let mass = |zone: usize| {
            let at = |i: usize| (zone as f64 + (i as f64 + 0.5) / LAYERS as f64) / ZONES as f64;
            (0..LAYERS).map(|i| density(at(i))).sum::<f64>()
        };
        let masses = [0, 1, 2, 3].map(mass);
        let mean = masses.iter().sum::<f64>() / ZONES as f64;
        masses.map(|mass| mean / mass)
    }

    /// A large valve fills a small chamber within one movement: the gas that came last is the coldest, at the port.
    #[test]
    fn a_fill_within_one_movement_leaves_the_cold_gas_at_the_port() {
        let mut config = Config::default();
        config.zones.diffusivity_m2_s = 0.0;
        let c = Coefficients::new(&config);
        let (supply_k, per_cv) = (config.supply.temperature_k, c.per_cv);
        let (before_j, enthalpy_j) = (10.0, 30.0);
        let before_kg = before_j * per_cv / supply_k;
        let inflow_kg = enthalpy_j * c.per_cp_supply;
        let mut zones = Zones::at(supply_k, before_kg);
        let flow = Flow {
            steps: c.counts.move_steps,
            gas_k: supply_k * f32::from(c.counts.move_steps),
            inflow_kg,
            enthalpy_j,
            energy_j: before_j,
            flowing_steps: c.counts.move_steps,
            ..Flow::default()
        };
        let place = Place {
            energy_j: before_j + enthalpy_j,
            pressure_pa: 4.0e5,
            volume_m3: 4.0e-5,
            mass_kg: before_kg + inflow_kg,
            ..Place::NONE
        };
        let moved = zones.advance(&c, &flow, &Exchange::default(), &place);
        assert!(moved.faces.replace_a_zone());
        let exact = plug_flow(f64::from(config.gas.heat_capacity_ratio));
        for (ratio, exact) in zones.ratio.iter().zip(exact) {
            let error = f64::from(*ratio) / exact - 1.0;
            assert!(error.abs() < 0.13, "{:?} for {exact:?}", zones.ratio);
        }
    }
}
