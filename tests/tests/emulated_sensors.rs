//! Digital sensors at the pins of the emulated Pico: a MAX31865 on its SPI, an MPR on its I2C.

use model_core::sample::Sample;
use model_core::{Command, Faults, RawCode, SetPoint, Telemetry};
use system_tests::rig::Rig;
use system_tests::run_text;
use thermyo_boards::emulated::{Injection, PartFault};

const MAX31865: &str = "[sensor.gas]\nkind = \"max31865\"\nnoise_k = 0.01\n";
const MPR: &str = "[sensor.pressure]\nkind = \"mpr\"\nrange_pa = 250e3\n";
/// Scenario below 2.5 bar, the range of an MPR.
const LOW: &str = "[supply]\npressure_pa = 240e3\n[load]\nforce_n = 20.0\n";

/// RMS error of the estimate \[K\] on a board.
fn error_k(sensor: &str, board: &[&str]) -> f64 {
    let text = format!("[run]\nduration_s = 20.0\n[plant]\nmodel = \"lumped\"\n{sensor}");
    let run = run_text(&text, board);
    run.summary["rmse_k"]["estimate"].as_f64().expect("a number")
}

#[test]
fn the_estimate_is_as_good_from_a_max31865() {
    // On the board the result is equal to the bit: see `emulated_parity`.
    let analog = error_k("", &[]);
    let digital = error_k(MAX31865, &["--board", "emulated"]);
    let here = error_k(MAX31865, &[]);
    let times = digital / analog;
    println!("{digital} K, {times:.2} times that of the converter, {here} K in this process");
    // The errors are 0.07, 0.06 and 0.08 K: a bare sensor is off by 11 K.
    assert!((0.7..1.4).contains(&times) && digital < 0.15, "{digital} K, {analog} K");
    assert!((0.7..2.5).contains(&(digital / here)), "{digital} K, {here} K");
}

/// Milliseconds from a fault until the coils are without power, and the telemetry at that time.
fn vents_after(scenario: &str, fault: impl Fn(&mut Rig, Sample) -> Sample) -> (u32, Telemetry) {
    let mut rig = Rig::new(&format!("[plant]\nmodel = \"lumped\"\n{scenario}"));
    rig.start(SetPoint::Pressure { pressure_pa: 1.5e5 });
    rig.pass(1000);
    let healthy = rig.board.take_telemetry().pop().expect("telemetry comes");
    assert_eq!(healthy.faults, Faults::NONE);
    for ms in 0..1000 {
        let sample = rig.muscle.sample();
        let sample = fault(&mut rig, sample);
        let exchange = rig.exchange_with(|_| sample);
        let telemetry = rig.board.take_telemetry().pop().expect("telemetry comes");
        if telemetry.faults.intersects(Faults::GAS_LOST.with(Faults::PRESSURE_SENSOR)) {
            assert_eq!(telemetry.command, Command::VENT);
            assert_eq!((exchange.inlet_duty, exchange.outlet_duty), (0.0, 0.0));
            let timing = rig.board.timing().expect("it answers");
            println!("{ms} ms, {timing:?}");
            assert_eq!(timing.missed_steps, 0);
            assert!((0..=1).contains(&timing.jitter_worst_us), "{timing:?}");
            return (ms, telemetry);
        }
    }
    panic!("it does not vent");
}

fn inject(fault: PartFault) -> impl Fn(&mut Rig, Sample) -> Sample {
    move |rig, sample| {
        rig.board.inject(Injection::Part(fault));
        sample
    }
}

/// Faults that the chip itself detects: a reading at the end of its scale.
fn gas_reads(reading: u16) -> impl Fn(&mut Rig, Sample) -> Sample {
    move |_, sample| Sample { gas: RawCode::of_part(reading, sample.gas.is_fresh()), ..sample }
}

#[test]
fn a_max31865_that_is_lost_vents() {
    // One conversion more than in the core, since one may have just begun, plus the transfer over
    // the bus.
    let within_ms = 40 + 20 + 3;
    for reading in [0, 0x7fff, 20_000] {
        let (ms, telemetry) = vents_after(MAX31865, gas_reads(reading));
        assert!((20..=within_ms).contains(&ms), "{reading}: {ms} ms");
        assert!(telemetry.faults.intersects(Faults::GAS_SENSOR), "{}", telemetry.faults);
    }
    for fault in [PartFault::GasUnplugged, PartFault::GasSilent, PartFault::GasReadyStuck] {
        let (ms, telemetry) = vents_after(MAX31865, inject(fault));
        assert!((78..=103).contains(&ms), "{fault:?}: {ms} ms");
        assert!(telemetry.faults.intersects(Faults::GAS_LOST), "{}", telemetry.faults);
    }
}

#[test]
fn an_mpr_that_is_lost_vents() {
    let scenario = format!("{LOW}{MPR}");
    let shorted = |_: &mut Rig, sample: Sample| Sample {
        pressure: RawCode::of_part(0, sample.pressure.is_fresh()),
        ..sample
    };
    let (ms, _) = vents_after(&scenario, shorted);
    assert!((6..=24).contains(&ms), "{ms} ms");
    for fault in [PartFault::PressureUnplugged, PartFault::PressureSilent] {
        let (ms, telemetry) = vents_after(&scenario, inject(fault));
        assert!((40..=55).contains(&ms), "{fault:?}: {ms} ms");
        assert_eq!(telemetry.faults.of(Faults::PRESSURE_SENSOR), Faults::PRESSURE_SENSOR);
    }
}
