//! Warnings about control: loops that cannot come to rest, or that act too late or too rarely, and a line that makes
//! the core take healthy valves for faulty ones.
//!
//! `docs/background/control.md`, "Where the loop cannot come to rest", derives the conditions.

use super::core_config::{core_config, flow_late_s};
use super::loaded::Loaded;
use model_core::Config;
use model_core::control::valve_drive::least_opening_s;
use thermyo_compute::math::ends;
use thermyo_plant::chamber::{self, Chamber};
use thermyo_plant::flow::Iso6358;
use thermyo_plant::gas::IdealGas;
use thermyo_plant::line::Bore;
use thermyo_plant::load_n;
use thermyo_scenario::{DriveKind, LoadKind, PlantKind, Scenario, ValveKind};

/// Conditions under which a held pressure swings at a half or a third of the PWM frequency: the line's own frequency is
/// within a factor `NEAR` of that, up to `FASTEST_PWM_HZ`, and has `LEAST_QUALITY` or more; measured on `full`
/// (`docs/background/control.md`) \[-\].
const BEATS: [f64; 2] = [2.0, 3.0];
const NEAR: [f64; 2] = [0.9, 1.3];
const FASTEST_PWM_HZ: f64 = 150.0;
const LEAST_QUALITY: f64 = 16.0;

/// Key, value, and the consequence.
pub type Unrest = (&'static str, String, String);

/// Distance from its goal at which the loop wakes, in dead zones of contraction:
/// `model-core/src/control/contraction.rs`.
const WAKES_AT_ZONES: f64 = 1.5;
/// PWM frequency below which steps overshoot and settle late: measured on `full` (`docs/background/control.md`) \[Hz\].
const SLOW_PWM_HZ: f64 = 30.0;
/// Way by which a load may fly past its goal, as a share of the rest length: a step overshoots by as much anyway
/// (`docs/background/control.md`) \[-\].
const THROWN: f64 = 0.01;
/// Factor by which a flow may be wrong before the core finds a fault: `model-core/src/safety/plausibility.rs` \[-\].
pub(super) const WRONG_FLOW: f64 = 4.0;
/// Share of the chamber in the volume of chamber and line below which the chamber gets too little of the inflow:
/// measured on `full`, behind 8 m of 10 mm, with 0.14, there is no fault, behind 10 m of 12 mm, with 0.08, there is one
/// \[-\].
const LEAST_SHARE: f64 = 0.1;

/// Warnings for a scenario of one chamber.
pub fn unrest(loaded: &Loaded) -> Vec<Unrest> {
    let (plant, believed) = (&loaded.plant, &loaded.believed);
    let is_controlled = matches!(plant.drive.kind, DriveKind::Pressure | DriveKind::Contraction);
    let mut found = valves_and_line(loaded, is_controlled.then_some(SLOW_PWM_HZ));
    let Some(moving) = chamber::of(believed).filter(|_| is_controlled) else { return found };
    let config = core_config(believed);
    let at = |goal: f64| {
        let rest = Rest::at_the_goal(believed, &config, moving.as_ref(), goal);
        let found = [
            resonant(plant, rest.pressure_pa, moving.as_ref()),
            coarse(believed, &config, &rest),
            leaking(plant, &rest),
            thrown(believed, &config, moving.as_ref(), goal),
        ];
        found.into_iter().flatten().collect::<Vec<Unrest>>()
    };
    found.extend(
        goals(loaded).into_iter().map(at).find(|found| !found.is_empty()).unwrap_or_default(),
    );
    found
}

/// Set points at which a loop has to rest, in their unit: the middle, the least and the largest.
fn goals(loaded: &Loaded) -> [f64; 3] {
    let (drive, profile) = (&loaded.plant.drive, &loaded.drive_profile);
    let given = profile.as_ref().map(|given| ends(given.points().iter().map(|point| point.1)));
    let middle = given.map_or(drive.middle(), |[least, most]| 0.5 * (least + most));
    let [least, most] = given.unwrap_or(drive.extremes());
    [middle, least, most]
}

/// Warnings about valves and line, of one chamber or of a joint's muscle; `slowest_hz`: the PWM frequency below which
/// the loops, if any drive it, act too rarely \[Hz\].
pub fn valves_and_line(loaded: &Loaded, slowest_hz: Option<f64>) -> Vec<Unrest> {
    let believed = &loaded.believed;
    let loops = slowest_hz
        .map(|slowest_hz| [seldom(believed, slowest_hz), uneven(believed), late(believed)]);
    let found = loops.into_iter().flatten().chain([starved(loaded)]);
    found.flatten().collect()
}

/// Point at which a loop has to rest.
///
/// A mass dm changes the pressure by k R T dm/V and moves the end by A dP over the stiffness of gas and spring,
/// k P A^2/V + K. If that leads from one end of the zone in which the loop rests beyond the other, the loop never rests.
struct Rest {
    pressure_pa: f64,
    volume_m3: f64,
    /// Length per pressure, if the contraction is controlled \[m/Pa\].
    moved_m_pa: Option<f64>,
    /// Width of the zone \[Pa\], or \[m\].
    zone: f64,
}

impl Rest {
    fn at_the_goal(s: &Scenario, config: &Config, moving: &dyn Chamber, goal: f64) -> Self {
        let rest_m = moving.rest_length();
        if s.drive.kind == DriveKind::Pressure {
            return Self {
                pressure_pa: goal,
                volume_m3: with_tube_m3(s, moving.volume(rest_m)),
                moved_m_pa: None,
                zone: 2.0 * f64::from(config.controller.pressure_dead_zone_pa),
            };
        }
        let length_m = rest_m * (1.0 - goal);
        let area_m2 = moving.force_area(length_m);
        let volume_m3 = with_tube_m3(s, moving.volume(length_m));
        let gauge_pa = (load_n(s, moving) - moving.elastic(length_m)) / area_m2;
        let pressure_pa = s.ambient.pressure_pa + gauge_pa.max(0.0);
        let gas_n_m = IdealGas::new(&s.gas).k * pressure_pa * area_m2 * area_m2 / volume_m3;
        let stiffness_n_m = gas_n_m + moving.elastic_slope(length_m).abs();
        let dead_zone = f64::from(config.controller.contraction_dead_zone);
        Self {
            pressure_pa,
            volume_m3,
            moved_m_pa: Some(area_m2.abs() / stiffness_n_m),
            zone: 2.0 * WAKES_AT_ZONES * dead_zone * rest_m,
        }
    }

    /// The change by k R T dm \[J\] in words, if it leads beyond the zone, and its consequence.
    fn beyond(&self, changed_j: f64, so: &str) -> Option<String> {
        let changed_pa = changed_j / self.volume_m3;
        let Some(moved_m_pa) = self.moved_m_pa else {
            let zone_pa = self.zone;
            return (changed_pa > zone_pa).then(|| {
                format!(
                    "the pressure by {changed_pa:.0} Pa, and the loop rests within {zone_pa:.0} Pa, \
                     controller.pressure_dead_zone_pa to either side: {so}"
                )
            });
        };
        let (moved_m, zone_m) = (changed_pa * moved_m_pa, self.zone);
        (moved_m > zone_m).then(|| {
            format!(
                "the end by {:.2} mm, and the loop rests within {:.2} mm, one and a half \
                 controller.contraction_dead_zone to either side: {so}",
                1e3 * moved_m,
                1e3 * zone_m
            )
        })
    }
}

fn with_tube_m3(s: &Scenario, volume_m3: f64) -> f64 {
    if s.moves_in_full() { volume_m3 + s.tube.volume_m3 } else { volume_m3 }
}

/// Whether the drive should let gas in.
pub(super) fn fills(scenario: &Scenario) -> bool {
    !matches!(scenario.drive.kind, DriveKind::Discharge | DriveKind::Closed)
}

/// Flow of the core's valve, open to the supply \[kg/s\].
pub(super) fn open_kg_s(s: &Scenario, config: &Config) -> f64 {
    let conductance = f64::from(config.valve.conductance_m3_s_pa);
    let open = Iso6358::valve(conductance, s.valve.critical_ratio, &IdealGas::new(&s.gas));
    open.mass_flow(s.supply.pressure_pa, s.supply.temperature_k, 0.0)
}

/// The shortest pulse is too large.
fn coarse(s: &Scenario, config: &Config, rest: &Rest) -> Option<Unrest> {
    if s.valve.kind == ValveKind::Proportional {
        return None;
    }
    let opening_s = f64::from(least_opening_s(config, s.pwm_period_s() as f32));
    let gas = IdealGas::new(&s.gas);
    let moved_kg = opening_s * open_kg_s(s, config);
    let so = "the loop may rest off its goal by half of that, or go on with single pulses";
    let beyond = rest.beyond(gas.k * gas.r * s.supply.temperature_k * moved_kg, so)?;
    let why = format!("the shortest pulse, controller.minimum_pulse_s, moves {beyond}");
    Some(("valve.conductance_m3_s_pa", format!("{:e}", s.valve.conductance_m3_s_pa), why))
}

/// A leak takes too much from one pulse to the next.
fn leaking(s: &Scenario, rest: &Rest) -> Option<Unrest> {
    let gas = IdealGas::new(&s.gas);
    let leak_m3_s_pa = s.leak.conductance_m3_s_pa;
    let leak = Iso6358::leak(leak_m3_s_pa, s.valve.critical_ratio, &gas)?;
    let wall_k = s.ambient.temperature_k;
    let lost_kg = leak.mass_flow(rest.pressure_pa, wall_k, s.ambient.pressure_pa) / s.valve.pwm_hz;
    let so = "the loop may never come to rest";
    let beyond = rest.beyond(gas.k * gas.r * wall_k * lost_kg, so)?;
    let why = format!("in a period of valve.pwm_hz it moves {beyond}");
    Some(("leak.conductance_m3_s_pa", format!("{leak_m3_s_pa:e}"), why))
}

/// A muscle pulls, and cannot push: a load that flies on is braked only by its own force. A piston holds it, with its
/// spring and friction.
fn thrown(s: &Scenario, config: &Config, moving: &dyn Chamber, goal: f64) -> Option<Unrest> {
    let mass_kg = f64::from(config.moving_mass_kg);
    if s.drive.kind != DriveKind::Contraction || mass_kg <= 0.0 {
        return None;
    }
    let rest_m = moving.rest_length();
    let load = load_n(s, moving).abs();
    let is_muscle = s.plant.kind == PlantKind::Muscle;
    let held_n = if is_muscle {
        0.0
    } else {
        moving.elastic(rest_m * (1.0 - goal)).abs() + s.friction.force_n
    };
    let speed_m_s = f64::from(config.controller.contraction_rate_per_s) * rest_m;
    let way_m = 0.5 * speed_m_s * speed_m_s * mass_kg / (load + held_n);
    (way_m > THROWN * rest_m).then(|| {
        let by = if s.load.kind == LoadKind::Mass { "its weight" } else { "load.force_n" };
        let why = format!(
            "it flies {:.0} mm past a goal that it comes to at controller.contraction_rate_per_s, since only {by} {} it, \
             and may swing on; a lower rate lets it stop",
            1e3 * way_m,
            if is_muscle { "brakes" } else { "and friction brake" }
        );
        ("load.mass_kg", format!("{:?}", config.moving_mass_kg), why)
    })
}

/// The loops run once per period, which may be too rare.
fn seldom(s: &Scenario, slowest_hz: f64) -> Option<Unrest> {
    let pwm_hz = s.valve.pwm_hz;
    (pwm_hz < slowest_hz).then(|| {
        let why = format!(
            "the loops act once in {:.0} ms: steps overshoot by a tenth and more, and settle late; from \
             {slowest_hz:.0} Hz on by less",
            1e3 / pwm_hz
        );
        ("valve.pwm_hz", format!("{pwm_hz:?}"), why)
    })
}

/// The board counts a period in steps.
fn uneven(s: &Scenario) -> Option<Unrest> {
    let (asked_hz, has_hz) = (s.valve.pwm_hz, 1.0 / s.pwm_period_s());
    ((has_hz / asked_hz - 1.0).abs() > 1e-6).then(|| {
        let why = format!(
            "its period is no whole number of run.step_s: board and valves have {has_hz:.4} Hz, {} steps",
            s.pwm_period_steps()
        );
        ("valve.pwm_hz", format!("{asked_hz:?}"), why)
    })
}

/// The flow through a line arrives later than the core compensates.
fn late(s: &Scenario) -> Option<Unrest> {
    let [length_m, _] = s.tube.line().filter(|_| s.moves_in_full())?;
    let [late_s, compensated_s] = flow_late_s(s);
    (late_s > compensated_s).then(|| {
        let why = format!(
            "with valve.dead_time_s its flow comes {:.1} ms late, and the loops compensate {:.1} ms, a period of \
             valve.pwm_hz less the valve's stroke: steps overshoot, and a pressure may swing on",
            1e3 * late_s,
            1e3 * compensated_s
        );
        ("tube.length_m", format!("{length_m:?}"), why)
    })
}

/// Pulses that beat with the line's gas: the loop responds to each swing with the next one.
fn resonant(s: &Scenario, pressure_pa: f64, moving: &dyn Chamber) -> Option<Unrest> {
    let [length_m, diameter_m] = s.tube.line().filter(|_| s.moves_in_full())?;
    let [late_s, compensated_s] = flow_late_s(s);
    let pulses = s.valve.kind == ValveKind::Switching && s.valve.pwm_hz < FASTEST_PWM_HZ;
    let held = s.drive.kind == DriveKind::Pressure && pulses && late_s <= compensated_s;
    let gas = IdealGas::new(&s.gas);
    let bore = Bore::new(diameter_m, s.ambient.temperature_k);
    let ends_m3 = [s.tube.volume_m3, moving.volume(moving.rest_length())];
    let own_hz = bore.resonance_hz(&gas, length_m, ends_m3);
    let rings = held && bore.quality(&gas, own_hz, pressure_pa) > LEAST_QUALITY;
    let near = |beat: &&f64| {
        let ratio = own_hz * **beat / s.valve.pwm_hz;
        rings && (NEAR[0]..NEAR[1]).contains(&ratio)
    };
    let beat = BEATS.iter().find(near)?;
    let part = if *beat == 2.0 { "half" } else { "third" };
    let why = format!(
        "the line's gas swings at {own_hz:.0} Hz, near a {part} of valve.pwm_hz = {:?}, and a bore of {:.1} mm damps it \
         little: a held pressure may swing on at {:.0} Hz; a bore of 3 mm, or another length, lets it rest",
        s.valve.pwm_hz,
        1e3 * diameter_m,
        s.valve.pwm_hz / beat
    );
    Some(("tube.length_m", format!("{length_m:?}"), why))
}

/// The core does not model a line: gas that does not arrive, or arrives late, looks to it like an inlet that does not
/// open.
///
/// The core expects at least 1/4 of its valve's flow m_v, and finds a fault if a quarter of the gas m in the chamber is
/// missing. In steady flow, friction reduces the flow of a line, and once waves have died away the line keeps V_line/(V
/// + V_line) of the inflow.
fn starved(loaded: &Loaded) -> Option<Unrest> {
    let s = &loaded.plant;
    let [length_m, diameter_m] = s.tube.line().filter(|_| s.moves_in_full())?;
    let fills = !matches!(s.drive.kind, DriveKind::Discharge);
    let chamber = chamber::of(s).filter(|_| fills)?;
    let gas = IdealGas::new(&s.gas);
    let volume_m3 = chamber.volume(chamber.rest_length());
    let believed_kg_s = open_kg_s(&loaded.believed, &core_config(&loaded.believed));
    let bore = Bore::new(diameter_m, s.ambient.temperature_k);
    let pressures_pa = [s.supply.pressure_pa, s.plant.initial_pressure_pa];
    let passed_kg_s = bore.steady_kg_s(&gas, length_m, pressures_pa);
    let vents = "so that it takes the inlet for shut and vents with the fault \"no inflow\"";
    if WRONG_FLOW * passed_kg_s < believed_kg_s {
        let why = format!(
            "{length_m} m of it pass {:.2} g/s by friction, below a quarter of the {:.2} g/s that the core expects of \
             valve.conductance_m3_s_pa, {vents}",
            1e3 * passed_kg_s,
            1e3 * believed_kg_s
        );
        return Some(("tube.diameter_m", format!("{diameter_m:?}"), why));
    }
    let line_m3 = bore.volume_m3(length_m);
    (volume_m3 < LEAST_SHARE * (volume_m3 + line_m3)).then(|| {
        let why = format!(
            "{length_m} m of it have {:.0} cm3 beside the {:.0} cm3 of the chamber, and keep more than nine tenths of what \
             flows in, {vents}",
            1e6 * line_m3,
            1e6 * volume_m3
        );
        ("tube.diameter_m", format!("{diameter_m:?}"), why)
    })
}

#[cfg(test)]
mod tests {
    use super::unrest;
    use crate::parse;
    use thermyo_scenario::DriveKind;

    #[test]
    fn set_points_over_time_rest_in_their_middle() {
        let text = |contraction: f64| {
            format!(
                "[drive]\nkind = \"contraction\"\ncontraction = {contraction}\n\
                 [valve]\nconductance_m3_s_pa = 1e-7\n"
            )
        };
        let loaded = |contraction| parse(&text(contraction), "c.toml".as_ref()).unwrap();
        let held = unrest(&loaded(0.2));
        let driven = loaded(0.1).driven(DriveKind::Contraction, vec![(0.0, 0.15), (1.0, 0.25)]);
        assert_eq!(unrest(&driven), held);
        assert!(!held.is_empty() && held != unrest(&loaded(0.1)), "{held:?}");
        let pressure = loaded(0.1).driven(DriveKind::Pressure, vec![(0.0, 2e5), (1.0, 4e5)]);
        assert!(unrest(&pressure)[0].2.contains("controller.pressure_dead_zone_pa"));
    }
}
