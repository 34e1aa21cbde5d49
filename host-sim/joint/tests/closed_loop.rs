//! The joint's core on the joint's plant.

use model_core::joint::{JointFaults, JointMode, JointSetPoint, Motion};
use model_core::{Command, Faults};
use std::f64::consts::TAU;
use thermyo_joint::{Inputs, JointLoaded, Rig, Row, parse};

fn loaded(text: &str) -> JointLoaded {
    let text = format!("[plant]\ninitial_pressure_pa = 290000\n{text}");
    parse(&text, "joint.toml".as_ref()).unwrap_or_else(|error| panic!("{error}"))
}

fn run(loaded: &JointLoaded, duration_s: f64, inputs: impl Fn(f64) -> Inputs) -> Vec<Row> {
    let mut rig = Rig::new(loaded, inputs(0.0)).unwrap();
    let steps = (duration_s * 1000.0) as u32;
    (1..=steps).map(|step| rig.step(inputs(f64::from(step) * 1e-3)).unwrap()).collect()
}

fn still(angle_deg: f64, stiffness: f32) -> Inputs {
    Inputs::of(Motion::still(angle_deg.to_radians() as f32, stiffness))
}

#[test]
fn a_step_arrives_with_its_stiffness_and_rests() {
    for model in ["lumped", "full"] {
        let loaded = loaded(&format!("model = \"{model}\"\n[joint]\ngravity_n_m = 4.9\n"));
        let rows = run(&loaded, 4.0, |t| still(if t < 0.5 { 0.0 } else { 20.0 }, 16.0));
        let settled = &rows[1500..];
        let worst = settled.iter().map(|row| (row.truth.angle_rad.to_degrees() - 20.0).abs());
        let worst = worst.fold(0.0, f64::max);
        assert!((1e-3..0.5).contains(&worst), "{model}: {worst} deg");
        let off = settled.iter().map(|row| (row.stiffness_n_m_rad / 16.0 - 1.0).abs());
        let off = off.fold(0.0, f64::max);
        assert!((1e-5..0.05).contains(&off), "{model}: {off}");
        let shut = settled.iter().filter(|row| row.shut()).count() as f64 / settled.len() as f64;
        assert!(shut > 0.8, "{model}: shut for {shut} of the time");
    }
}

const HOSED: &str =
    "model = \"full\"\n[tube]\nlength_m = 0.5\ndiameter_m = 0.004\n[joint]\ngravity_n_m = 4.9\n";

/// A sine of this angular frequency \[rad/s\] and size \[rad\], after half a second at rest.
fn sine(w: f64, size: f64, time_s: f64) -> Inputs {
    let (sin, cos) = if time_s < 0.5 { (0.0, 0.0) } else { (w * (time_s - 0.5)).sin_cos() };
    Inputs::of(Motion {
        angle_rad: (size * sin) as f32,
        speed_rad_s: (size * w * cos) as f32,
        acceleration_rad_s2: (-size * w * w * sin) as f32,
        stiffness_n_m_rad: 14.0,
    })
}

/// If the reference ignores the time that gas takes through valve and hose, the arm is 0.64 deg late.
#[test]
fn a_heavy_arm_is_followed_at_two_hertz() {
    let loaded = loaded(&format!("{HOSED}inertia_kg_m2 = 0.145\n"));
    let (w, size) = (2.0 * TAU, 10.0_f64.to_radians());
    let rows = run(&loaded, 2.5, |t| sine(w, size, t));
    let errors = rows.iter().filter(|row| row.time_s > 1.0).map(|row| {
        (row.truth.angle_rad - size * (w * (row.time_s - 0.5)).sin()).to_degrees().powi(2)
    });
    let errors: Vec<f64> = errors.collect();
    let rms_deg = (errors.iter().sum::<f64>() / errors.len() as f64).sqrt();
    assert!((0.05..0.35).contains(&rms_deg), "{rms_deg} deg");
}

/// Slow creep turns an arm that rests for minutes, by more than the zone in which it may be. When a rest could begin
/// anywhere within the zone, 17 and 8 pulses followed after 10 s. Four of 36 arms still leave the zone.
#[test]
fn an_arm_at_rest_has_room_for_its_creep() {
    let mut corrected = 0;
    for arm in 0..36 {
        let inertia_kg_m2 = 0.015 + 0.0041 * f64::from(arm);
        let loaded = loaded(&format!("{HOSED}inertia_kg_m2 = {inertia_kg_m2}\n"));
        let rows = run(&loaded, 21.0, |t| still(if t < 1.0 { 0.0 } else { 20.0 }, 14.0));
        corrected += u8::from(rows[11_000..].iter().any(|row| !row.shut()));
        let errors = rows[3000..].iter().map(|row| (row.truth.angle_rad.to_degrees() - 20.0).abs());
        let worst = errors.fold(0.0, f64::max);
        assert!((0.02..0.3).contains(&worst), "{inertia_kg_m2} kg m2: {worst} deg");
    }
    assert!((1..=6).contains(&corrected), "{corrected} arms");
}

/// Largest error of an arm that moves to an angle and rests there, from 2 s after the step on \[deg\].
fn worst_at_rest_deg(text: &str, goal_deg: f64, stiffness: f32, duration_s: f64) -> f64 {
    let loaded = loaded(text);
    let goal = |t: f64| still(if t < 1.0 { -0.4 * goal_deg } else { goal_deg }, stiffness);
    let rows = run(&loaded, duration_s, goal);
    let errors = rows[3000..].iter().map(|row| (row.truth.angle_rad.to_degrees() - goal_deg).abs());
    errors.fold(0.0, f64::max)
}

/// At rest the gas cools and friction holds the arm: the observer takes this for a disturbance, and friction is
/// compensated too. Both in the first pulse of a correction threw the arm by 1.7 deg.
#[test]
fn a_correction_at_rest_does_not_throw_the_arm() {
    let text = "model = \"lumped\"\n[muscle]\npreset = \"dmsp-20\"\n[supply]\npressure_pa = 617000\n[valve]\n\
                pwm_hz = 60\nconductance_m3_s_pa = 9.93e-9\n[joint]\nradius_m = 0.0236\nmid_length_a_m = 0.2723\n\
                mid_length_b_m = 0.2723\nminimum_rad = -0.6\nmaximum_rad = 0.6\ninertia_kg_m2 = 0.00794\n\
                gravity_n_m = 1.454\ngravity_angle_rad = \"-90 deg\"\nviscous_n_m_s = 0.2\n";
    let worst_deg = worst_at_rest_deg(text, 10.26, 14.8, 12.0);
    assert!((0.02..0.5).contains(&worst_deg), "{worst_deg} deg");
}

/// Valves of 60 Hz that pass more than is believed turn a light arm to and fro within the zone, in the other direction
/// each period: when a rest could only begin in the middle of the zone, there were 118 pulses a second without end.
#[test]
fn pulses_within_the_zone_end() {
    let text = "model = \"lumped\"\n[muscle]\npreset = \"dmsp-20\"\n[supply]\npressure_pa = 713310\n[valve]\n\
                pwm_hz = 60\nconductance_m3_s_pa = 8.922e-9\n[joint]\nradius_m = 0.03077\nmid_length_a_m = 0.2723\n\
                mid_length_b_m = 0.2723\nminimum_rad = -0.65\nmaximum_rad = 0.65\ninertia_kg_m2 = 0.00919\n\
                gravity_n_m = 2.925\nviscous_n_m_s = 0\nfriction_n_m = 0.5\n[believed.joint]\n\
                inertia_kg_m2 = 0.01126\ngravity_n_m = 4.021\nfriction_n_m = 0.452\n[believed.valve]\n\
                conductance_m3_s_pa = 6.332e-9\n[believed.friction]\nforce_n = 10.908\n";
    let loaded = loaded(text);
    let rows = run(&loaded, 15.0, |t| still(if t < 1.0 { 6.13 } else { -15.32 }, 25.2));
    let moving = rows[11_000..].iter().filter(|row| !row.shut()).count();
    assert!(moving < 200, "valves are open in {moving} of 4000 steps");
}

/// Beyond its goal an arm needs twice the friction to turn back. The integral's limit used to be less than the friction
/// of a bearing of 2 N m: the arm stayed 2.5 deg off for good.
#[test]
fn friction_does_not_keep_an_arm_beyond_its_goal() {
    let text = "model = \"full\"\n[muscle]\npreset = \"dmsp-20\"\n[supply]\npressure_pa = 640000\n[valve]\n\
                pwm_hz = 50\nconductance_m3_s_pa = 1.61e-8\n[tube]\nlength_m = 2\ndiameter_m = 0.004\n[joint]\n\
                radius_m = 0.0162\nmid_length_a_m = 0.2723\nmid_length_b_m = 0.2723\ninertia_kg_m2 = 0.0388\n\
                gravity_n_m = 0.2\ngravity_angle_rad = \"-90 deg\"\nfriction_n_m = 2\n";
    for goal_deg in [-22.25, 22.0] {
        let worst_deg = worst_at_rest_deg(text, goal_deg, 6.9, 8.0);
        assert!((1e-3..0.3).contains(&worst_deg), "{worst_deg} deg at {goal_deg} deg");
    }
}

/// The integral used to keep the torque that friction held at rest, and took a step 0.3 deg too far.
#[test]
fn a_step_forgets_what_friction_held() {
    let loaded = loaded(HOSED);
    let rows = run(&loaded, 3.0, |t| still(if t < 1.5 { 0.0 } else { 20.0 }, 14.0));
    let beyond = rows.iter().map(|row| row.truth.angle_rad.to_degrees() - 20.0);
    let beyond = beyond.fold(f64::NEG_INFINITY, f64::max);
    assert!((-0.2..0.15).contains(&beyond), "{beyond} deg");
}

/// RMS error of 20 deg at 1 Hz \[deg\].
fn sine_error_deg(loaded: &JointLoaded) -> f64 {
    let (w, size) = (TAU, 20.0_f64.to_radians());
    let rows = run(loaded, 4.5, |t| sine(w, size, t));
    let moving = &rows[1500..];
    let errors =
        moving.iter().map(|row| row.truth.angle_rad - size * (w * (row.time_s - 0.5)).sin());
    (errors.map(|error| error.to_degrees().powi(2)).sum::<f64>() / moving.len() as f64).sqrt()
}

/// Radii that vary by 20 % over 60 deg, as configured in the core and not.
#[test]
fn a_pulley_that_varies_is_followed_as_a_round_one() {
    let varies = "radius_a_per_rad = 0.19\nradius_b_per_rad = -0.19\n";
    let round = sine_error_deg(&loaded(HOSED));
    let known = sine_error_deg(&loaded(&format!("{HOSED}{varies}")));
    let believed = "[believed.joint]\nradius_a_per_rad = 0\nradius_b_per_rad = 0\n";
    let unknown = sine_error_deg(&loaded(&format!("{HOSED}{varies}{believed}")));
    assert!((0.05..0.25).contains(&round), "{round} deg");
    assert!((0.05..0.25).contains(&known), "{known} deg");
    assert!((1.2 * known..3.0).contains(&unknown), "{unknown} deg where {known}");
}

/// 20 deg at 1 Hz by a host that sends 100 set points a second, at every PWM period. Earlier, the reference stopped
/// between two set points (0.3 deg), at 50 Hz a small pulse waited for 20 ms (0.8 deg), and at 200 Hz gas masses took
/// 14 ms to follow (0.6 deg). At 60 Hz the plant's valves took up each duty a period late, and the joint swung from
/// stop to stop; 0.40 deg remain there.
#[test]
fn a_host_leads_the_joint_at_every_pwm_frequency() {
    // The period of 60 Hz is not a whole number of steps.
    for pwm_hz in [50, 60, 100, 200, 400] {
        let loaded = loaded(&format!(
            "{HOSED}[valve]\npwm_hz = {pwm_hz}\n[run]\nduration_s = 4\n[drive]\nkind = \"joint\"\n\
             shape = \"sine\"\namplitude_rad = \"20 deg\"\nperiod_s = 1\nstiffness_n_m_rad = 14\n"
        ));
        let mut squares = Vec::new();
        thermyo_joint::run(&loaded, &mut |row| {
            if row.time_s > 1.0 {
                let reference_rad = 20.0_f64.to_radians() * (TAU * row.time_s).sin();
                squares.push((row.truth.angle_rad - reference_rad).to_degrees().powi(2));
            }
            Ok(())
        })
        .unwrap();
        let rms_deg = (squares.iter().sum::<f64>() / squares.len() as f64).sqrt();
        assert!((0.05..0.42).contains(&rms_deg), "{pwm_hz} Hz: {rms_deg} deg");
    }
}

/// Checks that the arm rests at every goal.
fn rests(text: &str, goals_deg: &[f64]) {
    let loaded = loaded(text);
    for goal_deg in goals_deg {
        let rows = run(&loaded, 5.0, |t| still(if t < 0.5 { 0.0 } else { *goal_deg }, 14.0));
        let last = &rows[3500..];
        let shut = last.iter().filter(|row| row.shut()).count() as f64 / last.len() as f64;
        let errors = last.iter().map(|row| (row.truth.angle_rad.to_degrees() - goal_deg).abs());
        let worst = errors.fold(0.0, f64::max);
        assert!(shut > 0.5 && (1e-4..0.6).contains(&worst), "{goal_deg}: {shut}, {worst} deg");
    }
}

/// With an observer that is as fast for the disturbance as for the speed, the arm swings by 1 deg, with 90 pulses a
/// second.
#[test]
fn an_inertia_believed_twice_does_not_hunt_at_rest() {
    let text = format!("{HOSED}[believed.joint]\ninertia_kg_m2 = 0.04\n");
    rests(&text, &[-23.0, 6.0, 16.0, 27.0]);
}

/// With the gain of a heavier arm, it swings by 1 to 5 deg, with 100 pulses a second.
#[test]
fn a_light_arm_does_not_hunt_at_rest() {
    for inertia_kg_m2 in [0.001, 0.004] {
        rests(&format!("{HOSED}inertia_kg_m2 = {inertia_kg_m2}\n"), &[-20.0, 20.0]);
    }
}

/// Two equal inlets fill pressures that have different ways to go: the stiffness must wait for the slower one, or the
/// arm is thrown by 3 to 4 deg.
#[test]
fn another_stiffness_does_not_throw_the_arm() {
    for goal_deg in [-30.0, 20.0] {
        let loaded = loaded(HOSED);
        let rows = run(&loaded, 4.0, |t| still(goal_deg, if t < 2.0 { 12.0 } else { 24.0 }));
        let changing = rows.iter().filter(|row| row.time_s > 2.0);
        let thrown = changing.map(|row| (row.truth.angle_rad.to_degrees() - goal_deg).abs());
        let thrown_deg = thrown.fold(0.0, f64::max);
        assert!((0.01..0.8).contains(&thrown_deg), "{thrown_deg} deg at {goal_deg} deg");
    }
}

/// Arms that swing at 10 Hz on their gas, with late valves: from the step at 4 s on, another angle every 4 s. Returns
/// the worst swing in the last second before the next angle, and the error there \[deg\].
fn swings_deg(text: &str, stiffness: f32, angles_deg: &[f64]) -> [f64; 2] {
    let text = format!("[plant]\nmodel = \"full\"\ninitial_pressure_pa = 220000\n{text}");
    let loaded = parse(&text, "joint.toml".as_ref()).unwrap_or_else(|error| panic!("{error}"));
    let angle_deg = |t: f64| angles_deg[((t / 4.0) as usize).min(angles_deg.len() - 1)];
    let rows = run(&loaded, 4.0 * angles_deg.len() as f64, |t| still(angle_deg(t), stiffness));
    let (mut swing_deg, mut off_deg) = (0.0_f64, 0.0_f64);
    for (held, wanted_deg) in rows.chunks(4000).zip(angles_deg).skip(1) {
        let errors = held[3000..].iter().map(|row| row.truth.angle_rad.to_degrees() - wanted_deg);
        let (low, high) = errors
            .fold((f64::MAX, f64::MIN), |(low, high), error| (low.min(error), high.max(error)));
        swing_deg = swing_deg.max(0.5 * (high - low));
        off_deg = off_deg.max(high.abs()).max(low.abs());
    }
    [swing_deg, off_deg]
}

const SMALL: &str =
    "[muscle]\npreset = \"dmsp-10\"\n[joint]\nmid_length_a_m = 0.23375\nmid_length_b_m = 0.23375\n";

/// The error used to be predicted from its present speed, which the gas reverses before the torque acts: valves that
/// opened to and fro drove the arm by 11 to 23 deg.
#[test]
fn a_small_arm_behind_late_valves_comes_to_rest() {
    for (text, stiffness, angles_deg) in [
        (
            "radius_m = 0.01079\ninertia_kg_m2 = 0.000654\ngravity_n_m = 0.0612\nviscous_n_m_s = 0\n[supply]\n\
             pressure_pa = 550404\n[valve]\nconductance_m3_s_pa = 3.603e-9\npwm_hz = 60\n[tube]\nlength_m = 0.3\n\
             diameter_m = 0.0025\n",
            2.8,
            [0.0, 24.6, 15.5],
        ),
        (
            "radius_m = 0.01285\ninertia_kg_m2 = 0.001118\nviscous_n_m_s = 0\n[supply]\npressure_pa = 721971\n\
             [valve]\nconductance_m3_s_pa = 9.359e-10\npwm_hz = 125\n[tube]\nlength_m = 1\ndiameter_m = 0.0025\n",
            4.6,
            [0.0, -3.4, 7.4],
        ),
        (
            "radius_m = 0.01266\ninertia_kg_m2 = 0.000645\ngravity_n_m = 0.1131\ngravity_angle_rad = -1.5708\n\
             viscous_n_m_s = 0\n[supply]\npressure_pa = 661667\n[valve]\nconductance_m3_s_pa = 6.753e-9\n\
             kind = \"proportional\"\nbandwidth_hz = 119\n[tube]\nlength_m = 0.1\ndiameter_m = 0.0025\n",
            4.0,
            [0.0, 4.4, -16.5],
        ),
    ] {
        let [swing_deg, off_deg] = swings_deg(&format!("{SMALL}{text}"), stiffness, &angles_deg);
        assert!((1e-4..0.5).contains(&swing_deg), "{swing_deg} deg: {text}");
        assert!((1e-3..0.5).contains(&off_deg), "{off_deg} deg: {text}");
    }
}

/// Muscles of 8.7 mm that their valves fill in 0.24 s move an arm of 0.01 kg m2: the response to its swing used to ask
/// for more than the open valves gave before it turned, and drove it from stop to stop.
#[test]
fn small_valves_do_not_drive_a_swing() {
    let text = "[muscle]\nrest_length_m = 0.113\ndiameter_m = 0.00874\nbraid_angle_deg = 24.4\n\
                bladder_stiffness_n_m = 366\nslip_force_n = 0.88\ndead_volume_m3 = 9.546e-7\n[friction]\n\
                force_n = 3.452\nstribeck_force_n = 0.382\nviscous_n_s_m = 7.64\n[supply]\npressure_pa = 734171\n\
                [valve]\nconductance_m3_s_pa = 5.194e-10\npwm_hz = 50\n[tube]\nlength_m = 0.3\n\
                diameter_m = 0.0025\n[joint]\nradius_m = 0.00989\nmid_length_a_m = 0.10171\n\
                mid_length_b_m = 0.10171\nminimum_rad = -0.789\nmaximum_rad = 0.789\ninertia_kg_m2 = 0.01024\n\
                gravity_n_m = 0.2788\ngravity_angle_rad = -1.5708\nviscous_n_m_s = 0.0138\nfriction_n_m = 0.1103\n";
    let [swing_deg, off_deg] = swings_deg(text, 1.3, &[0.0, 21.8, -19.5]);
    assert!((1e-4..0.5).contains(&swing_deg), "{swing_deg} deg");
    assert!((1e-3..0.6).contains(&off_deg), "{off_deg} deg");
}

/// Whether a stiffness gives way depends on the torque at rest, not on the last torque of the motion: the joint used to
/// rest with 4.8 % too little at 27 deg, with 4.7 % at 33 deg.
#[test]
fn a_stiffness_that_pressures_give_is_waited_for() {
    let loaded = loaded(HOSED);
    for (angle_deg, stiffness) in [(27.0, 28.0), (33.0, 27.0)] {
        let at = |t: f64| still(if t < 1.0 { 5.0 } else { angle_deg }, stiffness);
        let rows = run(&loaded, 10.0, at);
        let off = rows[3000..].iter().map(|row| row.stiffness_n_m_rad / f64::from(stiffness) - 1.0);
        let off = off.map(f64::abs).fold(0.0, f64::max);
        assert!((0.01..0.035).contains(&off), "{angle_deg} deg: {off}");
    }
}

/// A supply below the muscles' limit: at its pressure no gas flows. The joint used to ask for more, and swung by 1 deg.
#[test]
fn a_low_supply_limits_the_stiffness() {
    let text = HOSED.replace("[joint]", "[supply]\npressure_pa = 500000\n[joint]");
    let rows = run(&loaded(&text), 12.0, |t| still(if t < 1.0 { 5.0 } else { 33.0 }, 20.0));
    assert!(rows[2000..].iter().all(|row| row.telemetry.limited));
    let late = &rows[6000..];
    let (low, high) = late.iter().fold((f64::MAX, f64::MIN), |(low, high), row| {
        let angle_deg = row.truth.angle_rad.to_degrees();
        (low.min(angle_deg), high.max(angle_deg))
    });
    assert!((1e-3..0.7).contains(&(high - low)), "{} deg", high - low);
    let shut = late.iter().filter(|row| row.shut()).count() as f64 / late.len() as f64;
    assert!(shut > 0.9, "shut for {shut} of the time");
}

/// With small pulses that wait, it swings by 1.2 deg at half of the angles.
#[test]
fn slow_valves_do_not_hunt_at_rest() {
    rests(&format!("{HOSED}[valve]\npwm_hz = 50\n"), &[-30.0, -20.0, 15.0, 25.0]);
}

/// More stiffness than both pressures give: the angle is held, and the telemetry reports the limit, until the joint
/// vents; while it does, and when it is driven again within the limits, there is none.
#[test]
fn torque_wins_over_stiffness() {
    let loaded = loaded("model = \"lumped\"\n[joint]\n");
    let vent = Inputs { set_point: JointSetPoint::Vent, ..still(10.0, 80.0) };
    let rows = run(&loaded, 2.4, |t| match t {
        ..2.0 => still(10.0, 80.0),
        ..2.203 => vent,
        _ => still(0.0, 10.0),
    });
    let (driven, vented) = rows.split_at(2000);
    assert!(vented[1..210].iter().all(|row| !row.telemetry.limited));
    let last = driven.last().unwrap();
    assert!(last.telemetry.limited && last.stiffness_n_m_rad < 60.0, "{last:?}");
    assert!((last.truth.angle_rad.to_degrees() - 10.0).abs() < 0.5, "{last:?}");
}

#[test]
fn a_torque_is_that_of_the_tendons() {
    let loaded = loaded(
        "model = \"lumped\"\n[joint]\n[joint.a.friction]\nforce_n = 0\n[joint.b.friction]\nforce_n = 0\n",
    );
    let set_point = JointSetPoint::Torque { torque_n_m: 3.0, stiffness_n_m_rad: 14.0 };
    // The arm pushes against its stop.
    let rows = run(&loaded, 2.0, |_| Inputs { set_point, ..still(0.0, 14.0) });
    let last = rows.last().unwrap();
    assert!((last.truth.torque_n_m / 3.0 - 1.0).abs() < 0.1, "{last:?}");
}

/// Tubes of a and b exchanged, by the signs of the mechanism: detected within 5 deg, and both vent.
#[test]
fn an_angle_that_goes_the_wrong_way_is_found_within_five_degrees() {
    let mut swapped = loaded("model = \"lumped\"\n[joint]\n");
    // A sensor that runs backwards looks the same to the core.
    let joint = &mut swapped.joint;
    (joint.sensor_minimum_rad, joint.sensor_maximum_rad) =
        (joint.sensor_maximum_rad, joint.sensor_minimum_rad);
    let rows = run(&swapped, 2.0, |t| still(if t < 0.5 { 0.0 } else { 15.0 }, 14.0));
    let found = rows.iter().find(|row| row.telemetry.faults.intersects(JointFaults::WRONG_WAY));
    let found = found.unwrap_or_else(|| panic!("{:?}", rows.last()));
    assert!(found.truth.angle_rad.abs() < 5.0_f64.to_radians(), "{found:?}");
    assert_eq!(found.telemetry.commands(), [Command::VENT; 2]);
}

/// The sensor's drift used to be injected into a channel that was then overwritten.
#[test]
fn an_angle_that_drifts_vents() {
    for sensor in ["", "sensor_kind = \"as5600\"\nsensor_minimum_rad = \"-180 deg\"\n"] {
        let loaded = loaded(&format!(
            "{HOSED}{sensor}[joint.a.faults]\nlength = \"drifting\"\nlength_drift_m_s = 0.05\nfrom_s = 1\n"
        ));
        let rows = run(&loaded, 4.0, |_| still(0.0, 14.0));
        let found = rows.iter().find(|row| row.telemetry.faults.intersects(JointFaults::TORQUE));
        assert!(found.is_some_and(|row| row.time_s > 1.1), "{found:?}");
    }
}

#[test]
fn a_torn_tendon_vents_both() {
    let loaded = loaded("model = \"lumped\"\n[joint]\n");
    let rows = run(&loaded, 2.0, |t| Inputs { torn: [t > 1.0, false], ..still(0.0, 14.0) });
    // An angle that has not moved before also goes the wrong way.
    let vented = rows.iter().find(|row| row.telemetry.faults != JointFaults::NONE);
    let vented = vented.unwrap_or_else(|| panic!("{:?}", rows.last()));
    assert!((1.0..1.2).contains(&vented.time_s), "{}", vented.time_s);
    assert_eq!(vented.telemetry.commands(), [Command::VENT; 2]);
}

/// A lost angle: without a lock the arm falls, with a lock it stays for that time. Another fault vents.
#[test]
fn a_lock_holds_the_arm_where_the_angle_is_lost() {
    let at_two_seconds = |lock_s: f64, fault: &str| {
        let loaded = loaded(&format!(
            "model = \"full\"\n[joint]\ngravity_n_m = 4.9\ngravity_angle_rad = 0.7\nlock_s = {lock_s}\n\
             [joint.a.faults]\n{fault}\nfrom_s = 1\n"
        ));
        let rows = run(&loaded, 4.0, |_| still(-20.0, 14.0));
        let moved =
            |row: &Row| (row.truth.angle_rad - rows[990].truth.angle_rad).to_degrees().abs();
        // Judged by the mode, since a loop may open both outlets too.
        let vents = rows.iter().position(|row| row.telemetry.mode == JointMode::Vent);
        assert!(
            rows[vents.unwrap()..].iter().all(|row| row.telemetry.commands() == [Command::VENT; 2])
        );
        (moved(&rows[2_400]), rows[vents.unwrap()].time_s)
    };
    let open = "length = \"open\"";
    let (moved_deg, vents_s) = at_two_seconds(1.5, open);
    assert!((0.01..1.0).contains(&moved_deg), "locked: {moved_deg} deg");
    assert!((2.5..2.502).contains(&vents_s), "{vents_s} s");
    let (moved_deg, vents_s) = at_two_seconds(0.0, open);
    assert!(moved_deg > 20.0 && vents_s < 1.002, "vented: {moved_deg} deg, {vents_s} s");
    let (_, vents_s) = at_two_seconds(1.5, "pressure = \"open\"");
    assert!(vents_s < 1.02, "{vents_s} s");
}

/// The arm used to fall by 26 deg within the lock, until its time was over.
#[test]
fn a_leak_ends_a_lock() {
    let loaded = loaded(
        "model = \"full\"\n[joint]\ngravity_n_m = 4.9\nlock_s = 10\n[faults]\nlink = \"lost\"\n\
         from_s = 1\n[joint.b.faults]\noutlet = \"leaking\"\noutlet_leak = 0.2\nfrom_s = 1\n",
    );
    let rows = run(&loaded, 4.0, |_| still(20.0, 14.0));
    let first = |mode| rows.iter().find(|row| row.telemetry.mode == mode).map(|row| row.time_s);
    let (locks_s, vents_s) = (first(JointMode::Locked), first(JointMode::Vent));
    assert!(locks_s.is_some_and(|locks_s| locks_s < 1.6), "{locks_s:?}");
    assert!(vents_s.is_some_and(|vents_s| (1.6..3.5).contains(&vents_s)), "{vents_s:?}");
}

/// A board that has restarted vents both muscles for any set point: the default stops are not this joint's. Returns the
/// time \[s\] from the lock until it vents, of a joint whose angle is lost at 1.5 s and that may lock for 8 s.
fn lock_s(text: &str, inputs: impl Fn(f64) -> Inputs) -> f64 {
    let lost = format!("{HOSED}lock_s = 8\n{text}");
    let rows = run(&loaded(&lost), 10.5, inputs);
    let first = |mode| rows.iter().find(|row| row.telemetry.mode == mode).map(|row| row.time_s);
    let locks_s = first(JointMode::Locked).unwrap();
    assert!((1.5..1.62).contains(&locks_s), "{locks_s} s");
    first(JointMode::Vent).unwrap() - locks_s
}

/// Without the angle there is no balance of the gas: the leak shows in both pressures.
#[test]
fn a_leak_ends_a_lock_without_an_angle() {
    let lost = "[joint.a.faults]\nlength = \"open\"\nfrom_s = 1.5\n";
    let leaking = "outlet = \"leaking\"\nfrom_s = 1.5\n";
    for (leak, within_s) in [(0.3, 0.1..3.0), (1.0, 0.02..0.6)] {
        let of_a =
            format!("{lost}{leaking}outlet_leak = {leak}\n").replacen("from_s = 1.5\n", "", 1);
        let of_b = format!("{lost}[joint.b.faults]\n{leaking}outlet_leak = {leak}\n");
        for text in [of_a, of_b] {
            let held_s = lock_s(&text, |_| still(20.0, 14.0));
            assert!(within_s.contains(&held_s), "{held_s} s: {text}");
        }
    }
}

/// Gas that a fast change has warmed, creeping muscles, and an arm that is pushed about.
#[test]
fn a_lock_of_tight_muscles_lasts() {
    let lost = "[joint.a.faults]\nlength = \"open\"\nfrom_s = 1.5\n";
    let load = |t: f64| if t < 1.7 { 0.0 } else { 5.0 * (3.0 * t).sin() };
    let fills = |t: f64| still(0.0, if t < 1.25 { 5.0 } else { 26.0 });
    let vents =
        |t: f64| still(if t < 1.3 { 30.0 } else { -30.0 }, if t < 1.3 { 26.0 } else { 6.0 });
    let (filled_s, vented_s) = (lock_s(lost, fills), lock_s(lost, vents));
    let pushed_s = lock_s(lost, |t| Inputs { load_n_m: load(t), ..still(20.0, 14.0) });
    for held_s in [filled_s, vented_s, pushed_s] {
        assert!((7.99..8.01).contains(&held_s), "{filled_s}, {vented_s}, {pushed_s} s");
    }
}

#[test]
fn a_board_that_restarts_is_not_configured() {
    for table in ["faults", "joint.b.faults"] {
        let loaded = loaded(&format!(
            "model = \"lumped\"\n[joint]\nmaximum_rad = 0.8\n[{table}]\nboard_restart = true\nfrom_s = 0.5\n"
        ));
        let rows = run(&loaded, 1.0, |t| still(if t < 0.7 { 0.0 } else { 45.5 }, 14.0));
        let vents = |row: &Row| row.telemetry.commands() == [Command::VENT; 2];
        assert!(rows[100..500].iter().all(|row| !vents(row)), "{table}");
        assert!(rows[500..].iter().all(vents), "{table}");
        let end = rows.last().unwrap();
        let missing = |i: usize| end.telemetry.muscles[i].faults.intersects(Faults::NOT_CONFIGURED);
        assert!(missing(0) && missing(1), "{table}: {end:?}");
        assert!(end.truth.muscles.iter().all(|muscle| muscle.pressure_pa < 1.2e5), "{end:?}");
    }
}

/// 12 bits per turn, one step late: the angle is held as with a potentiometer. Without magnet, wires or readings both
/// muscles vent, without a jump of the reading before.
#[test]
fn an_encoder_gives_the_angle_until_it_is_lost() {
    const ENCODER: &str = "model = \"full\"\n[joint]\ngravity_n_m = 4.9\nsensor_kind = \"as5600\"\n\
         sensor_minimum_rad = \"-180 deg\"\n";
    let rows = run(&loaded(ENCODER), 4.0, |t| still(if t < 0.5 { 0.0 } else { 20.0 }, 16.0));
    let off = |row: &Row| row.truth.angle_rad.to_degrees() - 20.0;
    let worst = rows[1500..].iter().map(|row| off(row).abs()).fold(0.0, f64::max);
    assert!((1e-3..0.5).contains(&worst), "{worst} deg");
    let square = |row: &Row| {
        let off_rad = f64::from(row.telemetry.angle_rad) - row.truth.angle_rad;
        off_rad * off_rad
    };
    let error = rows[1500..].iter().map(square).sum::<f64>() / 2500.0;
    // Half an LSB of truncation, noise and rounding: 0.067 deg.
    assert!((0.05..0.085).contains(&error.sqrt().to_degrees()), "{}", error.sqrt().to_degrees());

    for (fault, within_s) in [("open", 0.012), ("shorted", 0.012), ("frozen", 0.013)] {
        let text = format!("{ENCODER}[joint.a.faults]\nlength = \"{fault}\"\nfrom_s = 0.5\n");
        let rows = run(&loaded(&text), 1.0, |_| still(0.0, 16.0));
        let lost = rows.iter().find(|row| row.telemetry.faults != JointFaults::NONE);
        let lost = lost.unwrap_or_else(|| panic!("{fault}: {:?}", rows.last()));
        assert_eq!(lost.telemetry.faults, JointFaults::ANGLE_SENSOR, "{fault}");
        assert_eq!(lost.telemetry.commands(), [Command::VENT; 2], "{fault}");
        assert!((0.5..=0.5 + within_s).contains(&lost.time_s), "{fault}: {} s", lost.time_s);
    }
}
