//! A long line between valves and muscle: its gas in a chain of cells, with inertia and friction
//! on the faces between them.
//!
//! Along x, for the mass flow m through the section A = pi D^2/4, with p = rho R T:
//!
//! ```text
//! A d(rho)/dt      = - dm/dx
//! A d(rho cv T)/dt = - d(m cp T)/dx - pi lambda Nu (T - T_w)
//! dm/dt            = - A dp/dx - f m |m|/(2 D A rho)
//! ```
//!
//! (Wylie and Streeter, Fluid Transients in Systems, 1993) with the friction factor f = 64/Re of laminar flow and
//! Blasius' 0.3164 Re^-0.25, Re = |m| D/(A mu); Nu = 3.66 in laminar flow and Colburn's analogy, f/8 Re Pr^(1/3), in
//! turbulent flow. The cells conserve energy, so that sound is adiabatic: in a bore of 4 mm, heat takes some 0.1 s to
//! the wall, sound a hundredth of that along the line. The wall stays at ambient temperature: the wall of a hose has
//! hundreds of times the heat capacity of its gas.
//!
//! The momentum that the gas carries along, (d/dx)(m^2/(A rho)), is left out: in the difference of the squared
//! pressures it is 2 ln(p1/p2) against f L/D. Friction is that of steady flow, which damps sound too little.
//!
//! Pressures and flows are staggered, which makes the scheme of second order: N faces a cell's length apart, half a
//! cell at either end. The half at the valves is merged with the gas of the tube beside it.

use super::flow::Iso6358;
use super::gas::{IdealGas, air_conductivity, air_viscosity};
use std::f64::consts::PI;
use thermyo_compute::math;
use thermyo_scenario::Scenario;

/// Length of a cell, a tenth of the line within these limits \[m\]: sound takes 0.3 or 0.6 ms through a cell, a valve 2
/// ms to switch, and shorter cells would only need shorter steps.
const CELL_M: [f64; 2] = [0.1, 0.2];
/// Flow is laminar up to the first Reynolds number and turbulent from the second on \[-\].
const LAMINAR_TO_TURBULENT: [f64; 2] = [2300.0, 4000.0];
/// Nusselt number of laminar flow far from the inlet, at a wall of uniform temperature (Incropera).
const LAMINAR_NUSSELT: f64 = 3.66;
/// Cube root of air's Prandtl number, 0.71.
const PRANDTL_ROOT: f64 = 0.892_112;

/// A bore, whose wall stays at ambient temperature.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bore {
    section_m2: f64,
    diameter_m: f64,
    wall_k: f64,
    viscosity_pa_s: f64,
    conductivity_w_m_k: f64,
}

impl Bore {
    /// Bore of this diameter \[m\] and wall temperature \[K\].
    pub fn new(diameter_m: f64, wall_k: f64) -> Self {
        Self {
            section_m2: 0.25 * PI * diameter_m * diameter_m,
            diameter_m,
            wall_k,
            viscosity_pa_s: air_viscosity(wall_k),
            conductivity_w_m_k: air_conductivity(wall_k),
        }
    }

    /// Bore of the tube: the line's, or a bore that passes as much as tube and port.
    pub fn of_tube(scenario: &Scenario, gas: &IdealGas) -> Self {
        let port = Iso6358::port(&scenario.tube, scenario.valve.critical_ratio, gas);
        let passes_m = port.equivalent_diameter(gas);
        let diameter_m = scenario.tube.line().map_or(passes_m, |[_, diameter_m]| diameter_m);
        Self::new(diameter_m, scenario.ambient.temperature_k)
    }

    /// Share of the supply's temperature difference to the wall that a steady flow \[kg/s\] keeps behind a tube, whose
    /// gas is mixed \[m3\], and a length of line \[m\]: 1/(1 + G/(m cp)) exp(-G/(m cp)), each with its own conductance
    /// G.
    pub fn kept(&self, gas: &IdealGas, tube_m3: f64, line_m: f64, flow_kg_s: f64) -> f64 {
        let transfers = self.transfers(gas, flow_kg_s);
        math::exp(-transfers(self.volume_m3(line_m))) / (1.0 + transfers(tube_m3))
    }

    /// Volume of tube and line whose compression warms the gas that a steady flow \[kg/s\] carries into the chamber
    /// \[m3\]: at a rising pressure that gas is V dP/dt/(m cp) warmer than the walls. Each length of a line adds A dP,
    /// and loses what the wall takes up on the way; a mixed volume adds V dP/(1 + G/(m cp)).
    pub fn warming_m3(&self, gas: &IdealGas, tube_m3: f64, line_m: f64, flow_kg_s: f64) -> f64 {
        let transfers = self.transfers(gas, flow_kg_s);
        let line_m3 = self.volume_m3(line_m);
        let through = transfers(line_m3);
        let left = math::exp(-through);
        let of_line = if through > 0.0 { line_m3 * (1.0 - left) / through } else { 0.0 };
        of_line + left * tube_m3 / (1.0 + transfers(tube_m3))
    }

    /// Conductance of the wall of a volume \[m3\] over the heat capacity of a steady flow \[kg/s\], G/(m cp) \[-\].
    fn transfers(&self, gas: &IdealGas, flow_kg_s: f64) -> impl Fn(f64) -> f64 {
        let nusselt = self.friction(flow_kg_s).1;
        let (bore, per_capacity) = (*self, 1.0 / (flow_kg_s * gas.cp));
        move |m3| bore.conductance(m3, nusselt) * per_capacity
    }

    /// Friction factor times Reynolds number, f Re, and Nusselt number \[-\], at a flow \[kg/s\]. Both are interpolated
    /// between laminar and turbulent flow.
    fn friction(&self, flow: f64) -> (f64, f64) {
        let [laminar, turbulent] = LAMINAR_TO_TURBULENT;
        let reynolds = flow.abs() * self.diameter_m / (self.section_m2 * self.viscosity_pa_s);
        if reynolds <= laminar {
            return (64.0, LAMINAR_NUSSELT);
        }
        let share = ((reynolds - laminar) / (turbulent - laminar)).min(1.0);
        // 0.3164 Re^0.75
        let blasius = 0.3164 * reynolds.sqrt() * reynolds.sqrt().sqrt();
        let colburn = 0.125 * blasius * PRANDTL_ROOT;
        (64.0 + share * (blasius - 64.0), LAMINAR_NUSSELT + share * (colburn - LAMINAR_NUSSELT))
    }

    pub fn volume_m3(&self, length_m: f64) -> f64 {
        self.section_m2 * length_m
    }

    /// Steady flow \[kg/s\] through a length from the higher to the lower of two pressures \[Pa\], at the wall's
    /// temperature: the momentum above without its time derivative, m f Re = A D^2 (p1^2 - p2^2)/(R T mu L).
    pub fn steady_kg_s(&self, gas: &IdealGas, length_m: f64, [from_pa, to_pa]: [f64; 2]) -> f64 {
        let squares = (from_pa * from_pa - to_pa * to_pa).max(0.0);
        let driving = squares * self.diameter_m * self.diameter_m;
        let resisting = gas.r * self.wall_k * self.viscosity_pa_s * length_m;
        let wanted = self.section_m2 * driving / resisting;
        // f Re never falls with the flow, and is least in laminar flow.
        let [mut least, mut most] = [0.0, wanted / self.friction(0.0).0];
        for _ in 0..60 {
            let middle = 0.5 * (least + most);
            if middle * self.friction(middle).0 < wanted {
                least = middle;
            } else {
                most = middle;
            }
        }
        most
    }

    /// Lowest frequency at which gas of this length \[m\] swings between two volumes \[m3\], without friction \[Hz\]:
    /// tan(k L) (k^2 V_1 V_2/S^2 - 1) = k (V_1 + V_2)/S, with 2 pi f = k c; c/4 L between a shut and an open end.
    pub fn resonance_hz(&self, gas: &IdealGas, length_m: f64, ends_m3: [f64; 2]) -> f64 {
        let [one_m, other_m] = ends_m3.map(|volume_m3| volume_m3 / self.section_m2);
        let beyond = |k: f64| {
            let (sine, cosine) = (math::sin(k * length_m), math::cos(k * length_m));
            sine * (k * k * one_m * other_m - 1.0) - k * (one_m + other_m) * cosine
        };
        // Half a wave fits between two open ends; between other ends the frequency is lower.
        let [mut least, mut most] = [0.0, PI / length_m];
        for _ in 0..60 {
            let middle = 0.5 * (least + most);
            if beyond(middle) < 0.0 {
                least = middle;
            } else {
                most = middle;
            }
        }
        least * (gas.k * gas.r * self.wall_k).sqrt() / (2.0 * PI)
    }

    /// Quality of a swing of this frequency \[Hz\] in gas of this pressure \[Pa\]: 2 pi f over the rate 32 mu/(rho D^2)
    /// at which laminar friction slows its flow \[-\].
    pub fn quality(&self, gas: &IdealGas, frequency_hz: f64, pressure_pa: f64) -> f64 {
        let density = pressure_pa / (gas.r * self.wall_k);
        let square_m2 = self.diameter_m * self.diameter_m;
        2.0 * PI * frequency_hz * density * square_m2 / (32.0 * self.viscosity_pa_s)
    }

    /// Conductance to the wall \[W/K\] of a volume of gas \[m3\], at a Nusselt number.
    fn conductance(&self, volume_m3: f64, nusselt: f64) -> f64 {
        PI * self.conductivity_w_m_k * nusselt * volume_m3 / self.section_m2
    }

    pub fn heat_w(&self, volume_m3: f64, gas_k: f64, flow: f64) -> f64 {
        self.conductance(volume_m3, self.friction(flow).1) * (gas_k - self.wall_k)
    }

    /// Fastest rate \[1/s\] at which gas of the lowest pressure \[Pa\] and highest temperature \[K\] follows the wall, at the
    /// largest flow \[kg/s\].
    pub fn fastest_rate(&self, gas: &IdealGas, least_pa: f64, hottest_k: f64, flow: f64) -> f64 {
        let capacity_j_m3_k = least_pa / (gas.r * hottest_k) * gas.cv;
        self.conductance(1.0, self.friction(flow).1) / capacity_j_m3_k
    }
}

/// The line; its state has the flows, then the masses, then the energies.
#[derive(Debug, Clone, PartialEq)]
pub struct Line {
    gas: IdealGas,
    cells: usize,
    cell_m: f64,
    bore: Bore,
}

impl Line {
    /// The line of a scenario, if it has one.
    pub fn new(scenario: &Scenario, gas: &IdealGas) -> Option<Self> {
        let [length_m, diameter_m] = scenario.tube.line()?;
        let longest_m = (0.1 * length_m).clamp(CELL_M[0], CELL_M[1]);
        let cells = (length_m / longest_m - 1e-9).ceil().max(1.0);
        Some(Self {
            gas: *gas,
            cells: cells as usize,
            cell_m: length_m / cells,
            bore: Bore::new(diameter_m, scenario.ambient.temperature_k),
        })
    }

    /// Number of its states.
    pub fn states(&self) -> usize {
        3 * self.cells
    }

    /// Volume of half a cell \[m3\]: the half at the valves is part of the tube's volume.
    pub fn half_cell_m3(&self) -> f64 {
        0.5 * self.bore.section_m2 * self.cell_m
    }

    /// Volume of the gas after this face \[m3\].
    fn volume_m3(&self, face: usize) -> f64 {
        if face + 1 == self.cells { self.half_cell_m3() } else { 2.0 * self.half_cell_m3() }
    }

    /// Writes gas at rest into the line's state.
    pub fn fill(&self, pressure: f64, temperature: f64, state: &mut [f64]) {
        let (flows, masses, energies) = self.parts_mut(state);
        flows.fill(0.0);
        for (face, (mass, energy)) in masses.iter_mut().zip(energies).enumerate() {
            let volume = self.volume_m3(face);
            *mass = pressure * volume / (self.gas.r * temperature);
            *energy = pressure * volume / (self.gas.k - 1.0);
        }
    }

    /// The gas at the muscle's port.
    pub fn end(&self, state: &[f64]) -> (f64, f64) {
        let (_, masses, energies) = self.parts(state);
        let last = self.cells - 1;
        self.gas_of(masses[last], energies[last], self.half_cell_m3())
    }

    /// Fastest rate \[1/s\]: of sound from face to face, and of the half cell that empties at the port, or of friction.
    /// `port`: its [`super::flow::Iso6358::steepest`]; `least_pa`, `hottest_k`: lowest pressure and highest temperature
    /// of the gas.
    pub fn fastest_rate(&self, port: f64, least_pa: f64, hottest_k: f64) -> f64 {
        let gas = &self.gas;
        let sound = (gas.k * gas.r * hottest_k).sqrt();
        let density = least_pa / (gas.r * hottest_k);
        let friction = self.bore.friction(density * sound * self.bore.section_m2).0;
        // No flow is faster than sound, and heat passes no faster than momentum. Where the flow turns turbulent, its
        // friction grows 3.2 times as fast as the flow.
        let braking = 3.2 * self.braking(friction, density);
        let emptying = gas.k * gas.r * hottest_k * port / self.half_cell_m3();
        2.0 * sound / self.cell_m + emptying.max(braking)
    }

    /// Fraction of its momentum that a flow loses to friction per time \[1/s\], f |m|/(2 D A rho), for
    /// [`Self::friction`] and a density \[kg/m3\].
    fn braking(&self, friction: f64, density: f64) -> f64 {
        0.5 * self.bore.viscosity_pa_s * friction
            / (self.bore.diameter_m * self.bore.diameter_m * density)
    }

    /// Pressure \[Pa\] and temperature \[K\] of a mass \[kg\] and energy \[J\] in a volume \[m3\].
    fn gas_of(&self, mass: f64, energy: f64, volume: f64) -> (f64, f64) {
        ((self.gas.k - 1.0) * energy / volume, energy / (self.gas.cv * mass))
    }

    /// Writes the rates of the line's state, between gas (p, T) of the tube at the valves and the flow into the muscle
    /// \[kg/s\] with its enthalpy over cp \[kg K/s\]. Returns the flow out of the tube, in the same units.
    pub fn rates(
        &self,
        state: &[f64],
        tube: (f64, f64),
        into_muscle: (f64, f64),
        rates: &mut [f64],
    ) -> (f64, f64) {
        let gas = &self.gas;
        let (flows, masses, energies) = self.parts(state);
        let (flow_rates, mass_rates, energy_rates) = self.parts_mut(rates);
        let by_length = self.bore.section_m2 / self.cell_m;
        let (mut from, mut from_density) = (tube, tube.0 / (gas.r * tube.1));
        let mut out_of_tube = (0.0, 0.0);
        for face in 0..self.cells {
            let (flow, volume) = (flows[face], self.volume_m3(face));
            let here = self.gas_of(masses[face], energies[face], volume);
            let density = masses[face] / volume;
            // With the mean of the densities, the steps of p^2 add up to f L/D (m/A)^2 R T.
            let (friction, nusselt) = self.bore.friction(flow);
            let braking = self.braking(friction, 0.5 * (from_density + density));
            flow_rates[face] = by_length * (from.0 - here.0) - braking * flow;
            let enthalpy = flow * if flow > 0.0 { from.1 } else { here.1 };
            if face == 0 {
                out_of_tube = (flow, enthalpy);
            } else {
                mass_rates[face - 1] -= flow;
                energy_rates[face - 1] -= gas.cp * enthalpy;
            }
            let conductance = self.bore.conductance(volume, nusselt);
            mass_rates[face] = flow;
            energy_rates[face] = gas.cp * enthalpy - conductance * (here.1 - self.bore.wall_k);
            (from, from_density) = (here, density);
        }
        let last = self.cells - 1;
        mass_rates[last] -= into_muscle.0;
        energy_rates[last] -= gas.cp * into_muscle.1;
        out_of_tube
    }

    /// Flows \[kg/s\], masses \[kg\] and energies \[J\]: through each face, and around the place after it.
    fn parts<'a>(&self, state: &'a [f64]) -> (&'a [f64], &'a [f64], &'a [f64]) {
        let (flows, rest) = state.split_at(self.cells);
        let (masses, energies) = rest.split_at(self.cells);
        (flows, masses, energies)
    }

    fn parts_mut<'a>(&self, state: &'a mut [f64]) -> (&'a mut [f64], &'a mut [f64], &'a mut [f64]) {
        let (flows, rest) = state.split_at_mut(self.cells);
        let (masses, energies) = rest.split_at_mut(self.cells);
        (flows, masses, energies)
    }
}

#[cfg(test)]
mod tests {
    use super::super::ode::Rk4;
    use super::*;
    use thermyo_compute::math;

    const AIR_K: f64 = 298.0;

    fn line(length_m: f64, diameter_m: f64) -> Line {
        let mut scenario = Scenario::default();
        scenario.ambient.temperature_k = AIR_K;
        scenario.tube.length_m = Some(length_m);
        scenario.tube.diameter_m = Some(diameter_m);
        Line::new(&scenario, &IdealGas::new(&scenario.gas)).unwrap()
    }

    /// Runs the line for `seconds`, between gas of this pressure and an end that takes a flow.
    fn run(line: &Line, state: &mut [f64], tube_pa: f64, flow: f64, seconds: f64) {
        let step = 1.0 / line.fastest_rate(0.0, 1.0e5, AIR_K);
        let steps = (seconds / step).ceil();
        let mut integrator = Rk4::new(state.len());
        for _ in 0..steps as usize {
            integrator.step(state, seconds / steps, |_, y, rates| {
                line.rates(y, (tube_pa, AIR_K), (flow, flow * line.end(y).1), rates);
            });
        }
    }

    /// Quarter wave, a Helmholtz resonator, and two volumes that share the spring of one.
    #[test]
    fn gas_of_a_line_resonates_as_closed_forms_do() {
        let gas = IdealGas::new(&Scenario::default().gas);
        let bore = Bore::new(0.006, AIR_K);
        let sound_m_s = (gas.k * gas.r * AIR_K).sqrt();
        let section_m2 = PI / 4.0 * 0.006 * 0.006;
        let helmholtz_hz =
            |volume_m3: f64| sound_m_s / (2.0 * PI) * (section_m2 / (0.1 * volume_m3)).sqrt();
        for (length_m, ends_m3, expected_hz) in [
            (1.5, [0.0, 1.0e3], sound_m_s / 6.0),
            (0.1, [1.0e-3, 1.0e3], helmholtz_hz(1.0e-3)),
            (0.1, [1.0e-3, 1.0e-3], helmholtz_hz(0.5e-3)),
        ] {
            let found_hz = bore.resonance_hz(&gas, length_m, ends_m3);
            assert!((found_hz / expected_hz - 1.0).abs() < 3.0e-3, "{ends_m3:?}: {found_hz} Hz");
        }
        let quality = bore.quality(&gas, 50.0, 2.0e5);
        assert!((quality / bore.quality(&gas, 100.0, 1.0e5) - 1.0).abs() < 1e-12);
        assert!((40.0..50.0).contains(&quality), "{quality}");
    }

    fn at_rest(line: &Line, pressure: f64) -> Vec<f64> {
        let mut state = vec![0.0; line.states()];
        line.fill(pressure, AIR_K, &mut state);
        state
    }

    /// p1^2 - p2^2 = f L/D (m/A)^2 R T, at constant temperature.
    #[test]
    fn steady_flow_loses_the_pressure_of_darcy_and_weisbach() {
        let square = |x: f64| x * x;
        for (reynolds, factor) in [(800.0, 64.0 / 800.0), (2.0e4, 0.3164 / math::pow(2.0e4, 0.25))]
        {
            for (length_m, diameter_m) in [(1.0, 0.002), (4.0, 0.004), (8.0, 0.006)] {
                let line = line(length_m, diameter_m);
                let flow = 0.25 * PI * diameter_m * air_viscosity(AIR_K) * reynolds;
                let per_area = flow / (0.25 * PI * diameter_m * diameter_m);
                let squares =
                    factor * length_m / diameter_m * square(per_area) * line.gas.r * AIR_K;
                let tube_pa = (square(2.0e5) + squares).sqrt();
                let mut state = at_rest(&line, tube_pa);
                run(&line, &mut state, tube_pa, flow, 6.0);
                let end_pa = line.end(&state).0;
                let off = (square(tube_pa) - square(end_pa)) / squares - 1.0;
                println!(
                    "Re {reynolds}, {length_m} m: {tube_pa:.0} to {end_pa:.0} Pa, off by {off:.1e}"
                );
                assert!(off.abs() < 1e-6, "{off}");
                assert!(tube_pa - end_pa > 100.0, "something is lost");
                let steady = line.bore.steady_kg_s(&line.gas, length_m, [tube_pa, 2.0e5]);
                assert!((steady / flow - 1.0).abs() < 1e-6, "{steady} kg/s");
            }
        }
    }

    /// Cells of 0.1 m mix gas that a plug flow would not.
    #[test]
    fn a_cold_supply_keeps_the_stated_share_of_its_difference() {
        const COLD_K: f64 = 273.0;
        for (length_m, flow) in [(0.5, 1.0e-4), (0.3, 3.6e-4), (0.3, 1.5e-3)] {
            let line = line(length_m, 0.004);
            let mut state = at_rest(&line, 3.0e5);
            let step = 1.0 / line.fastest_rate(0.0, 1.0e5, AIR_K);
            let mut integrator = Rk4::new(state.len());
            for _ in 0..(3.0 / step) as usize {
                integrator.step(&mut state, step, |_, y, rates| {
                    line.rates(y, (3.0e5, COLD_K), (flow, flow * line.end(y).1), rates);
                });
            }
            let left = (line.end(&state).1 - AIR_K) / (COLD_K - AIR_K);
            let stated = line.bore.kept(&line.gas, 0.0, length_m, flow);
            println!("{length_m} m, {flow} kg/s: {left:.3} of the difference, stated {stated:.3}");
            assert!(
                (left - stated).abs() < 0.15 && (0.05..0.9).contains(&stated),
                "{left} {stated}"
            );
        }
    }

    #[test]
    fn laminar_flow_turns_turbulent_without_a_jump() {
        let line = line(1.0, 0.004);
        let flow = |reynolds: f64| {
            reynolds * line.bore.section_m2 * line.bore.viscosity_pa_s / line.bore.diameter_m
        };
        let mut last = (0.0, 0.0);
        for i in 1..1000 {
            let reynolds = 10.0 * f64::from(i);
            let (friction, nusselt) = line.bore.friction(-flow(reynolds));
            let drop = friction * reynolds;
            assert!(drop > last.0 && nusselt >= last.1, "{reynolds}");
            assert!(i == 1 || drop < last.0 + 64.0 * 10.0 * 9.0, "{reynolds}");
            last = (drop, nusselt);
        }
        assert!((last.0 / (0.3164 * math::pow(9990.0, 1.75)) - 1.0).abs() < 1e-12);
    }

    /// The front of a small step arrives after L/c. Cells disperse it: its middle is late by some (L cell^2/8)^(1/3)/4.
    #[test]
    fn a_front_travels_with_sound() {
        for length_m in [1.0, 2.0, 4.0, 8.0] {
            let line = line(length_m, 0.006);
            let sound_m_s = (line.gas.k * line.gas.r * AIR_K).sqrt();
            assert!((sound_m_s - 346.0).abs() < 1.0);
            let mut state = at_rest(&line, 5.0e5);
            let (mut time_s, mut rises) = (0.0, Vec::new());
            let step = 2.0e-5;
            while time_s < 2.0 * length_m / sound_m_s {
                run(&line, &mut state, 5.001e5, 0.0, step);
                time_s += step;
                rises.push(line.end(&state).0 - 5.0e5);
            }
            // At a closed end it reaches twice its height, less the loss to friction.
            let highest = rises.iter().fold(0.0_f64, |highest, rise| highest.max(*rise));
            assert!((150.0..300.0).contains(&highest), "{highest}");
            let found = step * rises.iter().position(|rise| *rise > 90.0).unwrap() as f64;
            let off = found * sound_m_s / length_m - 1.0;
            println!("{length_m} m: {:.2} ms, off by {:.1} %", 1e3 * found, 100.0 * off);
            assert!((0.001..0.06).contains(&off), "{length_m} m: {off}");
        }
    }

    /// For any state, mass and energy only move between cells or through the ends.
    #[test]
    fn mass_and_energy_go_nowhere() {
        let mut line = line(3.0, 0.004);
        line.bore.conductivity_w_m_k = 0.0;
        let mut state = at_rest(&line, 3.0e5);
        for (i, y) in state.iter_mut().enumerate() {
            let share = f64::from((i * 37 % 23) as u32) / 23.0 - 0.5;
            *y = if i < line.cells { 2.0e-3 * share } else { *y * (1.0 + 0.2 * share) };
        }
        let mut rates = vec![0.0; state.len()];
        let into_muscle = (1.0e-3, 0.31);
        let left_tube = line.rates(&state, (3.1e5, 310.0), into_muscle, &mut rates);
        let (_, masses, energies) = line.parts(&rates);
        let sum = |rates: &[f64]| rates.iter().sum::<f64>();
        assert!((sum(masses) - (left_tube.0 - into_muscle.0)).abs() < 1e-15);
        assert!((sum(energies) - line.gas.cp * (left_tube.1 - into_muscle.1)).abs() < 1e-10);
        assert!(left_tube.0 != 0.0 && left_tube.1 != 0.0);
    }

    /// Still gas: C dT/dt = -pi lambda 3.66 L (T - T_w).
    #[test]
    fn the_wall_takes_heat() {
        let line = line(0.1, 0.004);
        let mut state = at_rest(&line, 3.0e5);
        let hot = 1.1 * AIR_K;
        state[2] *= 1.1;
        let time_constant =
            line.gas.cv * state[1] / (PI * 3.66 * line.bore.conductivity_w_m_k * 0.05);
        assert!((0.05..0.15).contains(&time_constant), "{time_constant} s");
        let mut integrator = Rk4::new(3);
        for _ in 0..1000 {
            integrator.step(&mut state, 0.001 * time_constant, |_, y, rates| {
                line.rates(y, line.end(y), (0.0, 0.0), rates);
            });
        }
        let left = (line.end(&state).1 - AIR_K) / (hot - AIR_K);
        assert!((left / math::exp(-1.0) - 1.0).abs() < 1e-6, "{left}");
    }
}
