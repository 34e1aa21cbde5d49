//! A flashed board in the loop, through a pseudo-terminal and the emulated UART.
#![cfg(unix)]

use model_core::{AdcCode, Sample, SetPoint};
use std::time::Duration;
use std::{fs, thread};
use system_tests::rig::Muscle;
use system_tests::thermyo;
use thermyo_boards::emulated::EmulatedBoard;
use thermyo_boards::image::{Variant, firmware, prepare_emulator};
use thermyo_boards::pty::PtyBoard;
use thermyo_boards::serial::SerialBoard;
use thermyo_runs::replay::{Row, replay};
use thermyo_simulation::board::{Board, BoardError, CoreBoard};

const HEALTHY: Sample = Sample::new(AdcCode(7770), AdcCode(15_950), AdcCode(23_757));

#[test]
#[cfg_attr(not(emulator), ignore = "THERMYO_SKIP_EMULATOR=1")]
fn every_step_of_the_hil_firmware_is_the_hosts_to_the_bit() {
    prepare_emulator().unwrap();
    let image = firmware(Variant::Hil).unwrap();
    let pty = PtyBoard::new(EmulatedBoard::with_image(&image).unwrap(), HEALTHY).unwrap();
    let mut board = SerialBoard::open(pty.port()).unwrap();
    let mut muscle = Muscle::new("[plant]\nmodel = \"lumped\"\n");
    let config = *muscle.config();
    let set_point = SetPoint::Pressure { pressure_pa: 2.0e5 };
    board.start(&config, set_point).unwrap();
    let other = SetPoint::MassFlow { flow_kg_s: -1.0e-4 };
    let mut rows = Vec::new();
    let mut opened = 0.0;
    for step in 0..500_u16 {
        let set_point = match step {
            0 => Some(set_point),
            300 => {
                board.set(other).unwrap();
                Some(other)
            }
            _ => None,
        };
        let sample = muscle.sample();
        let outcome = board.step(&sample).unwrap();
        let telemetry = outcome.telemetry.unwrap();
        assert_eq!((telemetry.step, telemetry.sample), (u32::from(step), sample));
        muscle.advance(outcome.actuation);
        opened += outcome.actuation.inlet;
        rows.push(Row { set_point, telemetry });
    }
    let outcome = replay(&mut CoreBoard::default(), &config, &rows, &mut |_, _| true).unwrap();
    assert_eq!((outcome.steps, outcome.mismatches), (500, 0));
    assert!((10.0..300.0).contains(&opened), "the inlet was open for {opened} steps");
}

#[test]
#[cfg_attr(not(emulator), ignore = "THERMYO_SKIP_EMULATOR=1")]
fn telemetry_before_a_broken_line_is_kept() {
    prepare_emulator().unwrap();
    let image = firmware(Variant::Hil).unwrap();
    let pty = PtyBoard::new(EmulatedBoard::with_image(&image).unwrap(), HEALTHY).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let long = "[run]\nduration_s = 1000.0\nlog_every = 1\n[plant]\nmodel = \"lumped\"\n";
    fs::write(path("long.toml"), long).unwrap();
    let [scenario, out] = [path("long.toml"), path("out")].map(|path| path.display().to_string());
    let board = format!("serial:{}", pty.port());
    let arguments = ["run", &scenario, "--quiet", "--out", &out, "--board", &board];
    let trace = path("out/unfinished-1/trace.csv");
    let outcome = thread::scope(|scope| {
        let run = scope.spawn(|| thermyo(&arguments));
        while !run.is_finished() && fs::metadata(&trace).map_or(0, |found| found.len()) < 50_000 {
            thread::sleep(Duration::from_millis(10));
        }
        drop(pty);
        run.join().unwrap()
    });
    assert_eq!(outcome.code, 2, "{}", outcome.err);
    assert!(outcome.err.contains("the record so far is in "), "{}", outcome.err);
    let replayed = thermyo(&[
        "replay",
        &trace.display().to_string(),
        "--out",
        &path("replay").display().to_string(),
    ]);
    assert_eq!((replayed.code, replayed.err.as_str()), (0, ""), "{}", replayed.out);
}

#[test]
#[cfg_attr(not(emulator), ignore = "THERMYO_SKIP_EMULATOR=1")]
fn firmware_that_samples_for_itself_is_named() {
    let pty = PtyBoard::new(EmulatedBoard::new().unwrap(), HEALTHY).unwrap();
    let error = SerialBoard::open(pty.port()).err().unwrap();
    assert!(matches!(error, BoardError::NotHil { .. }), "{error}");
    assert!(error.to_string().contains("--features hil"), "{error}");
}

#[test]
fn a_port_that_is_not_there_is_named() {
    let error = SerialBoard::open("/dev/thermyo-nowhere").err().unwrap();
    assert!(error.to_string().starts_with("/dev/thermyo-nowhere: "), "{error}");
}
