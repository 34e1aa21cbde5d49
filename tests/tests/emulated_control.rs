//! The flashed image drives the muscle like the core in this process: the same cases of pressure and contraction
//! control. Mass flow and duty are in `emulated_parity`.

use thermyo_boards::emulated::EmulatedBoard;
use thermyo_evaluate::control::{full, pressure_step, pressure_step_between, rest};
use thermyo_evaluate::control_proportional::{FROM_10_TO_90_PA, proportional};

/// One core step takes a mean of 85 us for pressure, 89 us for contraction, and 190 us at worst.
fn assert_on_time(board: &mut EmulatedBoard) {
    let timing = board.timing().unwrap();
    println!("{timing:?}");
    assert_eq!((timing.missed_steps, timing.malformed_frames), (0, 0));
    assert!((80_000..=93_000).contains(&timing.step_mean_ns), "{timing:?}");
    assert!((170..=200).contains(&timing.step_worst_us), "{timing:?}");
}

#[test]
fn contraction_at_rest() {
    let loaded = full(&thermyo_evaluate::nominal().unwrap());
    let mut board = EmulatedBoard::new().unwrap();
    let held = rest::hold(&loaded, 0, &mut board).unwrap();
    println!("{held:?}");
    assert!((0.1..0.7).contains(&held.error_percent), "{held:?}");
    // Pulses against creep and relaxing gas.
    assert!((1e-9..0.6).contains(&held.ripple_percent), "{held:?}");
    assert_on_time(&mut board);
}

#[test]
fn pressure_as_fast_as_the_valve() {
    let loaded = full(&thermyo_evaluate::nominal().unwrap());
    let mut board = EmulatedBoard::new().unwrap();
    let step = pressure_step(&loaded, &mut board).unwrap();
    println!("{step:?}");
    assert!((1.0..1.3).contains(&step.times_open_valve), "{step:?}");
    assert!((0.0..2.0).contains(&step.overshoot_percent), "{step:?}");
    assert_on_time(&mut board);
}

/// The pins carry 25 kHz, whose mean is the command.
#[test]
fn proportional_valves_hold_a_pressure() {
    let loaded = proportional(&full(&thermyo_evaluate::nominal().unwrap()), 1.0);
    let mut board = EmulatedBoard::new().unwrap();
    let step = pressure_step_between(&loaded, FROM_10_TO_90_PA, &mut board).unwrap();
    println!("{step:?}");
    assert!((1.0..1.3).contains(&step.times_open_valve), "{step:?}");
    assert!((0.02..1.0).contains(&step.overshoot_percent), "{step:?}");
    assert_on_time(&mut board);
}
