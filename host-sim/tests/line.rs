//! A long line between valves and muscle: compared with an independent fine discretisation, its
//! balances, and a core that drives a muscle through it.

use crate::leak::late_error_k;
use crate::plant_support::{MassFlow, muscle};
use crate::run_support::rows;
use model_core::Faults;
use ode_solvers::{DVector, Dop853, OutputType, System};
use std::f64::consts::PI;
use thermyo_plant::Actuation;
use thermyo_plant::chamber::braid::Geometry;
use thermyo_plant::flow::{Iso6358, Streams};
use thermyo_plant::gas::{IdealGas, air_conductivity, air_viscosity};
use thermyo_record::trace::Row;
use thermyo_runs::signals::rms_difference;
use thermyo_scenario::{HeatModel, LoadKind, PlantModel, Scenario};

const BORE_M: f64 = 0.004;
const AIR_K: f64 = 298.0;
const START_PA: f64 = 1.2e5;

/// A muscle of one volume without heat, filled from 7 bar through an ideal valve and a line.
fn filled(length_m: f64) -> Scenario {
    let mut s = muscle(PlantModel::Full);
    s.run.step_s = 1.0e-4;
    s.load.kind = LoadKind::Isometric;
    s.heat.model = HeatModel::Adiabatic;
    s.muscle.zones = 1;
    s.plant.initial_pressure_pa = START_PA;
    s.valve.pwm_hz = 1000.0;
    s.valve.switch_time_s = 0.0;
    s.valve.dead_time_s = 0.0;
    s.supply.droop_pa_s_kg = 0.0;
    s.tube.volume_m3 = 1.0e-6;
    s.tube.conductance_m3_s_pa = 2.0e-8;
    s.tube.length_m = Some(length_m);
    s.tube.diameter_m = Some(BORE_M);
    s
}

const CELLS: usize = 200;

/// The same with 200 cells, implemented separately: mass and energy of tube and muscle, then flux
/// \[kg/(s m2)\], density and energy per volume from face to face; the last cell is half as long.
struct Fine {
    scenario: Scenario,
    gas: IdealGas,
    valve: Iso6358,
    port: Iso6358,
    muscle_m3: f64,
    /// Whether the momentum transported by the gas is included, which the plant leaves out.
    carries_momentum: bool,
}

impl Fine {
    fn cell_m(&self) -> f64 {
        self.scenario.tube.length_m.unwrap() / CELLS as f64
    }

    fn tube_m3(&self) -> f64 {
        self.scenario.tube.volume_m3 + 0.5 * 0.25 * PI * BORE_M * BORE_M * self.cell_m()
    }

    /// Times at which the muscle reaches each of the rising pressures \[s\].
    fn times(self, pressures_pa: &[f64], end_s: f64) -> Vec<f64> {
        let (tube_m3, muscle_m3, gas) = (self.tube_m3(), self.muscle_m3, self.gas);
        let density = START_PA / (gas.r * AIR_K);
        let energy = START_PA / (gas.k - 1.0);
        let mut initial = DVector::<f64>::zeros(4 + 3 * CELLS);
        initial.as_mut_slice()[..4].copy_from_slice(&[
            density * tube_m3,
            energy * tube_m3,
            density * muscle_m3,
            energy * muscle_m3,
        ]);
        for cell in 0..CELLS {
            initial[4 + 3 * cell + 1] = density;
            initial[4 + 3 * cell + 2] = energy;
        }
        // Usual parameters; the problem is stiff, and a slow explicit method suffices.
        let dense = OutputType::Dense;
        let mut solver = Dop853::from_param(
            self,
            0.0,
            end_s,
            2.0e-4,
            initial,
            1e-6,
            1e-9,
            0.9,
            0.0,
            0.333,
            6.0,
            end_s,
            0.0,
            10_000_000,
            u32::MAX,
            dense,
        );
        solver.integrate().unwrap();
        let pressure = |y: &DVector<f64>| (gas.k - 1.0) * y[3] / muscle_m3;
        let curve: Vec<(f64, f64)> =
            solver.x_out().iter().copied().zip(solver.y_out().iter().map(pressure)).collect();
        crossings(&curve, pressures_pa)
    }
}

/// Times at which a rising curve passes each of the values, interpolated.
fn crossings(curve: &[(f64, f64)], values: &[f64]) -> Vec<f64> {
    let crossing = |value: &f64| {
        let at = curve.iter().position(|(_, y)| y > value).expect("it comes there");
        let ((x0, y0), (x1, y1)) = (curve[at - 1], curve[at]);
        x0 + (x1 - x0) * (value - y0) / (y1 - y0)
    };
    values.iter().map(crossing).collect()
}

impl System<f64, DVector<f64>> for Fine {
    fn system(&self, _: f64, y: &DVector<f64>, dy: &mut DVector<f64>) {
        let (gas, s) = (&self.gas, &self.scenario);
        let (cell_m, section) = (self.cell_m(), 0.25 * PI * BORE_M * BORE_M);
        let state = |m: f64, u: f64, v: f64| ((gas.k - 1.0) * u / v, u / (gas.cv * m));
        let tube = state(y[0], y[1], self.tube_m3());
        let muscle = state(y[2], y[3], self.muscle_m3);
        let supply = (s.supply.pressure_pa, s.supply.temperature_k);
        let inflow = self.valve.mass_flow(supply.0, supply.1, tube.0);
        let cell = |i: usize| state(y[4 + 3 * i + 1], y[4 + 3 * i + 2], 1.0);
        let mut port = Streams::default();
        port.add(muscle, cell(CELLS - 1), |p, t, q| self.port.mass_flow(p, t, q));
        let last = port.net() / section;
        let last_enthalpy = gas.cp * port.net_enthalpy_over_cp(muscle.1) / section;

        let viscosity = air_viscosity(AIR_K);
        let flux = |i: usize| if i < CELLS { y[4 + 3 * i] } else { last };
        let density = |i: usize| y[4 + 3 * i + 1];
        let tube_density = tube.0 / (gas.r * tube.1);
        let carried = |i: usize| (0.5 * (flux(i) + flux(i + 1))).powi(2) / density(i);
        let enthalpy = |i: usize| {
            if i == CELLS {
                return last_enthalpy;
            }
            let upwind = match (flux(i) > 0.0, i) {
                (true, 0) => tube.1,
                (true, _) => cell(i - 1).1,
                (false, _) => cell(i).1,
            };
            gas.cp * flux(i) * upwind
        };
        for i in 0..CELLS {
            let (before, before_density) =
                if i == 0 { (tube, tube_density) } else { (cell(i - 1), density(i - 1)) };
            let here = cell(i);
            let mean = 0.5 * (before_density + density(i));
            let reynolds = (flux(i).abs() * BORE_M / viscosity).max(1e-9);
            // Between 2300 and 4000, f Re and Nu change from one law to the other.
            let turbulent = ((reynolds - 2300.0) / 1700.0).clamp(0.0, 1.0);
            let blasius = 0.3164 / reynolds.powf(0.25);
            let factor = (1.0 - turbulent) * 64.0 / reynolds + turbulent * blasius;
            let colburn = blasius / 8.0 * reynolds * 0.71_f64.powf(1.0 / 3.0);
            let nusselt = (1.0 - turbulent) * 3.66 + turbulent * colburn;
            let friction = factor / (2.0 * BORE_M) * flux(i) * flux(i).abs() / mean;
            dy[4 + 3 * i] = (before.0 - here.0) / cell_m - friction;
            if self.carries_momentum {
                let carried_in =
                    if i == 0 { flux(0).powi(2) / tube_density } else { carried(i - 1) };
                dy[4 + 3 * i] += (carried_in - carried(i)) / cell_m;
            }
            let length = if i == CELLS - 1 { 0.5 * cell_m } else { cell_m };
            let h = nusselt * air_conductivity(AIR_K) / BORE_M;
            dy[4 + 3 * i + 1] = (flux(i) - flux(i + 1)) / length;
            dy[4 + 3 * i + 2] =
                (enthalpy(i) - enthalpy(i + 1)) / length - 4.0 * h / BORE_M * (here.1 - AIR_K);
        }
        dy[0] = inflow - section * flux(0);
        dy[1] = gas.cp * inflow * supply.1 - section * enthalpy(0);
        dy[2] = section * last;
        dy[3] = section * last_enthalpy;
    }
}

/// Time to fill to fractions of the supply's pressure, in the plant and with 200 cells.
#[test]
fn fill_times_agree_with_a_fine_discretisation() {
    // Shares for the front, and for the filling.
    let shares = [0.01, 0.2, 0.5, 0.8];
    for length_m in [1.0, 2.0, 4.0, 8.0] {
        let scenario = filled(length_m);
        let levels =
            shares.map(|share| START_PA + share * (scenario.supply.pressure_pa - START_PA));
        let mut plant = thermyo_plant::build(&scenario, None).unwrap();
        let mut curve = vec![(0.0, START_PA)];
        while curve.last().unwrap().1 < levels[3] {
            plant.advance(Actuation { inlet: 1.0, outlet: 0.0 }).unwrap();
            let truth = plant.truth();
            curve.push((truth.time_s, truth.pressure_pa));
        }
        let found = crossings(&curve, &levels);
        let m = &scenario.muscle;
        let braid = Geometry::new(m.thread_length_m, m.turns, m.dead_volume_m3);
        let gas = IdealGas::new(&scenario.gas);
        let b = scenario.valve.critical_ratio;
        let fine = |carries_momentum| {
            let fine = Fine {
                gas,
                valve: Iso6358::valve(scenario.valve.conductance_m3_s_pa, b, &gas),
                port: Iso6358::tube(scenario.tube.conductance_m3_s_pa, b, &gas),
                muscle_m3: braid.volume(scenario.load.length_m),
                scenario: scenario.clone(),
                carries_momentum,
            };
            fine.times(&levels, 1.2 * found[3])
        };
        let off = |fine: &[f64]| -> Vec<f64> {
            found.iter().zip(fine).map(|(found, fine)| found / fine - 1.0).collect()
        };
        let off_fine = off(&fine(false));
        let percent = |off: &[f64]| -> String {
            let each = off.iter().map(|off| format!("{:+.3} %", 100.0 * off));
            each.collect::<Vec<_>>().join(", ")
        };
        let times: Vec<String> = found.iter().map(|t| format!("{:.1}", 1e3 * t)).collect();
        println!("{length_m} m: {} ms, off by {}", times.join(", "), percent(&off_fine));
        let sound_m_s = (gas.k * gas.r * AIR_K).sqrt();
        assert!((1.0..3.0).contains(&(found[0] * sound_m_s / length_m)), "{}", found[0]);
        assert!((1e-5..0.01).contains(&off_fine[0].abs()), "{length_m} m: front {off_fine:?}");
        for off in &off_fine[1..] {
            assert!((1e-6..5e-4).contains(&off.abs()), "{length_m} m: {off_fine:?}");
        }
        if length_m == 4.0 {
            let off_carried = off(&fine(true));
            println!("... with the momentum that gas carries {}", percent(&off_carried));
            assert!((0.01..0.1).contains(&off_carried[0]), "front {off_carried:?}");
            for off in &off_carried[1..] {
                assert!((1e-4..0.01).contains(&off.abs()), "{off_carried:?}");
            }
        }
    }
}

#[test]
fn the_books_close_behind_a_line() {
    let mut scenario = muscle(PlantModel::Full);
    scenario.tube.length_m = Some(4.0);
    scenario.tube.diameter_m = Some(BORE_M);
    let drive = MassFlow::new(&scenario);
    let mut plant = thermyo_plant::build(&scenario, None).unwrap();
    for _ in 0..20_000 {
        plant.advance(drive.actuation(&plant.truth())).unwrap();
    }
    let ledger = plant.ledger();
    let errors =
        [ledger.mass_balance_error(), ledger.energy_balance_error(), ledger.wall_balance_error()];
    println!("{:.1e}, {:.1e}, {:.1e}", errors[0], errors[1], errors[2]);
    assert!(ledger.mass_in_kg > 0.001);
    assert!(errors[0] < 1e-9 && errors[1] < 1e-6 && errors[2] < 1e-9, "{errors:?}");
}

#[test]
fn a_line_of_no_length_is_none() {
    let scenario = muscle(PlantModel::Full);
    let mut zero = scenario.clone();
    zero.tube.length_m = Some(0.0);
    zero.tube.diameter_m = Some(BORE_M);
    let drive = MassFlow::new(&scenario);
    let mut plants = [scenario, zero].map(|s| thermyo_plant::build(&s, None).unwrap());
    for _ in 0..1000 {
        for plant in &mut plants {
            plant.advance(drive.actuation(&plant.truth())).unwrap();
        }
        assert_eq!(plants[0].truth(), plants[1].truth());
    }
}

#[test]
fn a_line_that_is_too_fast_is_named() {
    let mut scenario = filled(1.0e-4);
    let error = thermyo_plant::build(&scenario, None).err().unwrap().to_string();
    assert!(
        error.starts_with("tube.length_m is too short, or tube.diameter_m too small"),
        "{error}"
    );
    scenario.tube.length_m = Some(0.1);
    assert!(thermyo_plant::build(&scenario, None).is_ok());
}

#[test]
fn pressure_and_position_are_held_through_a_line() {
    let off = |rows: &[Row], of: fn(&Row) -> f64, set_point: f64| {
        let values: Vec<f64> = rows.iter().map(of).collect();
        rms_difference(&values, &vec![set_point; values.len()])
    };
    for length_m in [1.0, 4.0, 8.0] {
        let late = |drive: &str| -> Vec<Row> {
            let text = format!(
                "run = {{ duration_s = 5, log_every = 1 }}\nplant.model = \"full\"\ndrive = {{ {drive} }}\n\
                 tube = {{ volume_m3 = 1e-6, length_m = {length_m:?}, diameter_m = {BORE_M:?} }}\n"
            );
            let rows = rows(&text);
            assert!(rows.iter().all(|row| row.telemetry.faults == Faults::NONE), "{length_m} m");
            rows.into_iter().filter(|row| row.truth.time_s > 3.0).collect()
        };
        let held = late("kind = \"pressure\", pressure_pa = 2.5e5");
        let pressure_pa = off(&held, |row| row.truth.pressure_pa, 2.5e5);
        let held = late("kind = \"contraction\", contraction = 0.15");
        let length_mm = 1e3 * off(&held, |row| row.truth.length_m, 0.85 * 0.3);
        println!("{length_m} m: {pressure_pa:.0} Pa, {length_mm:.2} mm");
        assert!((10.0..2.0e3).contains(&pressure_pa), "{length_m} m: {pressure_pa} Pa");
        assert!((0.001..0.6).contains(&length_mm), "{length_m} m: {length_mm} mm");
    }
}

/// The gas in the line keeps the temperature of the line's wall, and comes and goes as the pressure changes. The estimate
/// is as good as without a line.
#[test]
fn the_estimate_is_as_good_behind_a_line() {
    let error_k = |tube: &str| {
        late_error_k(&format!(
            "run = {{ duration_s = 40, log_every = 10 }}\nplant.model = \"full\"\ntube = {{ {tube} }}\n"
        ))
    };
    let line = format!("volume_m3 = 1e-6, length_m = 4.0, diameter_m = {BORE_M:?}");
    let [behind_k, without_k] = [&line, "volume_m3 = 1e-6"].map(error_k);
    println!("{behind_k:.3} K, {without_k:.3} K without a line");
    assert!((0.1..0.35).contains(&behind_k), "{behind_k} K");
    assert!((0.5..1.5).contains(&(behind_k / without_k)), "{without_k} K");
}
