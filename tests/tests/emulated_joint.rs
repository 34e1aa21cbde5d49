//! The core of a joint, compiled like the images, on the emulated RP2040: its results, and its time.

use model_core::Command;
use model_core::joint::{JointFaults, JointMode, JointSetPoint, Motion};
use std::f64::consts::TAU;
use std::ops::RangeInclusive;
use system_tests::joint_guest::{EmulatedJoint, decoded, encoded};
use thermyo_joint::{Inputs, Rig, parse};

const SCENARIO: &str = "[plant]\nmodel = \"lumped\"\ninitial_pressure_pa = 290000\n\
     [joint]\ngravity_n_m = 4.9\n";
const STEPS: u32 = 4000;

/// Cycles of the core's step, out of the 200 000 of a millisecond: 40 466 in the mean, 74 839 in the first step, in
/// which estimators and controller start, and 60 544 at worst later, while the controller works: 202, 374 and 303 us.
const MEAN: RangeInclusive<u64> = 39_000..=42_000;
const FIRST: RangeInclusive<u32> = 71_000..=78_000;
const WORST: RangeInclusive<u32> = 57_000..=63_000;

/// Memory of a joint, 12 512 bytes of the chip's 264 KiB.
const JOINT_BYTES: RangeInclusive<u64> = 11_000..=12_900;

/// Rests, makes a step of 20 deg, follows a sine, pushes with a torque, and loses a tendon.
fn inputs(time_s: f64) -> Inputs {
    let motion = match time_s {
        0.0..0.5 => Motion::still(0.0, 14.0),
        0.5..1.5 => Motion::still(0.349, 16.0),
        _ => {
            // The set point changes every 10 ms.
            let phase = TAU * ((time_s - 1.5) * 100.0).floor() * 0.01;
            let [speed, acceleration] = [TAU * phase.cos(), -TAU * TAU * phase.sin()];
            Motion {
                angle_rad: (0.349 + 0.2 * phase.sin()) as f32,
                speed_rad_s: 0.2 * speed as f32,
                acceleration_rad_s2: 0.2 * acceleration as f32,
                stiffness_n_m_rad: 12.0,
            }
        }
    };
    let set_point = match time_s {
        3.0..3.3 => JointSetPoint::Torque { torque_n_m: 1.0, stiffness_n_m_rad: 14.0 },
        3.3..3.5 => JointSetPoint::Pressures { pressure_pa: [2.5e5, 2.6e5] },
        _ => JointSetPoint::Angle(motion),
    };
    Inputs { set_point, torn: [time_s > 3.6, false], ..Inputs::of(motion) }
}

/// Varying radii, with which a step takes 326, 668 and 535 us.
const VARIES: &str = "radius_a_per_rad = 0.2\nradius_b_share = 1.05\nradius_b_per_rad = -0.2\n\
     radius_b_per_rad2 = 0.1\nradius_b_per_rad3 = 0.05\n";
const VARYING: [RangeInclusive<u32>; 3] = [40_500..=44_000, 78_000..=85_000, 62_000..=68_000];

/// The commands that drive the plant here equal those that the chip computes from the same samples: the chip would
/// drive it the same way.
#[test]
fn the_joints_core_is_equal_to_the_bit_and_in_time_on_the_rp2040() {
    let [mean, first, worst] = is_equal(SCENARIO);
    assert!(MEAN.contains(&u64::from(mean)), "{mean} cycles");
    assert!(FIRST.contains(&first) && WORST.contains(&worst), "{first}, {worst} cycles");
}

#[test]
fn a_pulley_that_varies_is_equal_to_the_bit_on_the_rp2040() {
    let cycles = is_equal(&format!("{SCENARIO}{VARIES}"));
    let in_time = VARYING.iter().zip(&cycles).all(|(range, cycles)| range.contains(cycles));
    assert!(in_time, "{cycles:?} cycles");
}

/// Runs a scenario on both; returns the cycles of a step: the mean, the first one, and the worst later one.
fn is_equal(scenario: &str) -> [u32; 3] {
    let loaded = parse(scenario, "joint.toml".as_ref()).unwrap();
    let mut rig = Rig::new(&loaded, inputs(0.0)).unwrap();
    let mut chip = EmulatedJoint::load();
    chip.configure(&loaded.config());
    let mut held = inputs(0.0).set_point;
    chip.set(held);
    let (mut cycles, mut arrived, mut vented) = (Vec::new(), false, None);
    for step in 0..STEPS {
        let row = rig.step(inputs(f64::from(step + 1) * 1e-3)).unwrap();
        let (mut telemetry, mut took) = chip.step(&row.telemetry.sample());
        while step == 0 && decoded(&telemetry).mode == JointMode::StartupCheck {
            (telemetry, took) = chip.step(&row.telemetry.sample());
        }
        cycles.push(took);
        let there = decoded(&telemetry);
        assert_eq!(telemetry, encoded(&row.telemetry), "{step}: {there:?}, {:?}", row.telemetry);
        let next = inputs(f64::from(step + 1) * 1e-3).set_point;
        if next != held {
            held = next;
            chip.set(held);
        }
        arrived |= step == 1400 && (row.truth.angle_rad - 0.349).abs() < 0.01;
        if there.faults != JointFaults::NONE && vented.is_none() {
            assert_eq!(there.commands(), [Command::VENT; 2], "in the same step");
            vented = Some(step);
        }
    }
    assert!(arrived);
    assert!(vented.is_some_and(|step| (3600..3900).contains(&step)), "{vented:?}");
    let mean = cycles.iter().map(|&cycles| u64::from(cycles)).sum::<u64>() / cycles.len() as u64;
    let (first, worst) = (cycles[0], *cycles[1..].iter().max().unwrap());
    let bytes = chip.joint_bytes;
    println!("{mean} cycles a step, {first} the first, {worst} at worst later; {bytes} bytes");
    assert!(JOINT_BYTES.contains(&bytes), "{bytes} bytes");
    [mean as u32, first, worst]
}
