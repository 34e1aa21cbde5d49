//! Hosts that send only angles: the core continues the motion between them.

use model_core::joint::Motion;
use std::f64::consts::TAU;
use thermyo_joint::{Inputs, JointLoaded, Rig, Row, parse};

const TEXT: &str = "[plant]\nmodel = \"full\"\ninitial_pressure_pa = 290000\n[tube]\nlength_m = 0.5\n\
                    diameter_m = 0.004\n[joint]\ngravity_n_m = 4.9\n";
const STIFFNESS: f32 = 14.0;

fn loaded(inertia_kg_m2: f64) -> JointLoaded {
    let text = format!("{TEXT}inertia_kg_m2 = {inertia_kg_m2}\n");
    parse(&text, "joint.toml".as_ref()).unwrap_or_else(|error| panic!("{error}"))
}

/// Times of a host: arrival of each value, and the time to which the value belongs \[s\].
struct Host(Vec<(f64, f64)>);

impl Host {
    /// A host that sends `per_s` values a second, each late by up to `jitter_s`; one in `lost_of` is lost, unless that
    /// is 0.
    fn new(per_s: f64, jitter_s: f64, lost_of: u32) -> Self {
        let mut state = 0x9E37_79B9_u32;
        let mut next = || {
            state ^= state << 13;
            state ^= state >> 17;
            state ^= state << 5;
            state
        };
        let mut times = Vec::new();
        for n in 0..(6.0 * per_s) as u32 {
            let meant_s = f64::from(n) / per_s;
            let late_s = jitter_s * f64::from(next()) / f64::from(u32::MAX);
            if lost_of == 0 || next() % lost_of != 0 {
                times.push((meant_s + late_s, meant_s));
            }
        }
        Self(times)
    }

    /// Holds up values that come in these intervals until their end, when they come together.
    fn held_up(mut self, every_s: f64, for_s: f64) -> Self {
        for (comes_s, _) in &mut self.0 {
            let since_s = *comes_s % every_s;
            if since_s < for_s {
                *comes_s += for_s - since_s + 1e-3 * (since_s / for_s * 3.0).floor();
            }
        }
        self
    }

    /// The arm's angles under this course of angles alone \[rad\].
    fn leads(
        &self,
        loaded: &JointLoaded,
        duration_s: f64,
        angle_rad: impl Fn(f64) -> f64,
    ) -> Vec<Row> {
        let inputs = |time_s: f64| {
            let come = self.0.partition_point(|(comes_s, _)| *comes_s <= time_s + 1e-9);
            let meant_s = self.0[..come].last().map_or(0.0, |(_, meant_s)| *meant_s);
            Inputs::of(Motion::still(angle_rad(meant_s) as f32, STIFFNESS))
        };
        let mut rig = Rig::new(loaded, inputs(0.0)).unwrap();
        let steps = (duration_s * 1000.0) as u32;
        (1..=steps).map(|step| rig.step(inputs(f64::from(step) * 1e-3)).unwrap()).collect()
    }
}

/// A sine of 1 Hz and this size, after a second at rest.
fn sine(size_deg: f64) -> impl Fn(f64) -> f64 {
    move |time_s| size_deg.to_radians() * (TAU * (time_s - 1.0).max(0.0)).sin()
}

/// RMS error from 2 s on \[deg\].
fn rms_deg(rows: &[Row], angle_rad: impl Fn(f64) -> f64) -> f64 {
    let errors = rows.iter().filter(|row| row.time_s > 2.0);
    let squares =
        errors.map(|row| (row.truth.angle_rad - angle_rad(row.time_s)).to_degrees().powi(2));
    let squares: Vec<f64> = squares.collect();
    (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
}

/// Inertia of the light arm and of the heavy one \[kg m2\].
const ARMS_KG_M2: [f64; 2] = [0.02, 0.145];

/// RMS error of 10 deg at 1 Hz, of both arms \[deg\].
fn sine_errors_deg(host: &Host) -> [f64; 2] {
    ARMS_KG_M2.map(|inertia_kg_m2| {
        let rows = host.leads(&loaded(inertia_kg_m2), 5.0, sine(10.0));
        rms_deg(&rows, sine(10.0))
    })
}

/// With each angle as a set point at rest, the arms were 4.4 and 5.5, 4.0 and 3.9, 3.6 and 3.6 deg off.
#[test]
fn angles_alone_are_followed() {
    for (per_s, most) in [(20.0, [0.9, 1.5]), (50.0, [0.5, 0.75]), (100.0, [0.35, 0.5])] {
        let found = sine_errors_deg(&Host::new(per_s, 0.003, 0));
        for (rms_deg, most_deg) in found.into_iter().zip(most) {
            assert!((0.4 * most_deg..most_deg).contains(&rms_deg), "{per_s}/s: {found:?} deg");
        }
    }
}

/// One value in ten lost, or all of 90 ms at once: no worse than without a course, which gave 3.9 and 4.1, 4.0 and 4.5
/// deg.
#[test]
fn values_that_are_lost_or_held_up_do_no_harm() {
    let lost = sine_errors_deg(&Host::new(50.0, 0.003, 10));
    assert!(lost.iter().all(|rms_deg| (0.3..1.2).contains(rms_deg)), "{lost:?} deg");
    let held_up = sine_errors_deg(&Host::new(50.0, 0.0, 0).held_up(0.37, 0.09));
    assert!(held_up.iter().all(|rms_deg| (0.5..3.6).contains(rms_deg)), "{held_up:?} deg");
}

/// Ten values a second are ten steps.
#[test]
fn a_slow_host_sends_steps() {
    let found = sine_errors_deg(&Host::new(10.0, 0.0, 0));
    for (rms_deg, usual_deg) in found.into_iter().zip([5.11, 6.21]) {
        assert!((rms_deg - usual_deg).abs() < 0.02, "{found:?} deg");
    }
}

/// Way of an arm beyond the end of a course, with a host that sends 50 angles a second \[deg\].
fn beyond_deg(inertia_kg_m2: f64, end_deg: f64, course_deg: impl Fn(f64) -> f64) -> f64 {
    let angle_rad = |time_s: f64| course_deg(time_s).to_radians();
    let rows = Host::new(50.0, 0.003, 0).leads(&loaded(inertia_kg_m2), 3.0, angle_rad);
    rows.iter().map(|row| row.truth.angle_rad.to_degrees()).fold(0.0, f64::max) - end_deg
}

#[test]
fn a_step_stays_a_step() {
    for inertia_kg_m2 in ARMS_KG_M2 {
        for step_deg in [1.0, 20.0] {
            let step = |time_s| if time_s < 1.0 { 0.0 } else { step_deg };
            let beyond_deg = beyond_deg(inertia_kg_m2, step_deg, step);
            assert!((-0.2..0.5).contains(&beyond_deg), "{step_deg} deg: {beyond_deg} deg");
        }
    }
}

/// 50 deg/s, and a hold from one value to the next: 2.6 and 3.6 deg too far, and 0.3 to 3.6 deg with other delays of the
/// host. An interval is 1 deg, and the course continues for up to one and a quarter.
#[test]
fn a_ramp_ends_in_its_hold() {
    for inertia_kg_m2 in ARMS_KG_M2 {
        let ramp = |time_s: f64| (50.0 * (time_s - 1.0)).clamp(0.0, 20.0);
        let beyond_deg = beyond_deg(inertia_kg_m2, 20.0, ramp);
        assert!((1.3..4.0).contains(&beyond_deg), "{inertia_kg_m2} kg m2: {beyond_deg} deg");
        // A course that slows down by 13 rad/s2, and then rests.
        let eases = |time_s: f64| {
            let share = (2.5 * (time_s - 1.0)).clamp(0.0, 1.0);
            20.0 * share * share * (3.0 - 2.0 * share)
        };
        let beyond_deg = self::beyond_deg(inertia_kg_m2, 20.0, eases);
        assert!((0.1..2.1).contains(&beyond_deg), "{inertia_kg_m2} kg m2: {beyond_deg} deg");
    }
}
