//! Windows of faults: allowed scenarios, and their effect over time.

use crate::run_support::rows;
use model_core::control::Mode;
use model_core::{AdcCode, Command, Faults, RawCode};
use std::path::Path;
use thermyo_plant::{Travel, Truth};
use thermyo_record::trace::Row;
use thermyo_scenario::{ChannelFault, Document};
use thermyo_setup::Loaded;
use thermyo_simulation::adc::{Codes, VirtualAdc};
use thermyo_simulation::board::BoardError;
use thermyo_simulation::faults::InjectedFaults;

fn parse(text: &str) -> Result<Loaded, String> {
    thermyo_setup::parse(text, Path::new("scenario.toml")).map_err(|error| error.to_string())
}

fn valid(text: &str) -> Loaded {
    parse(text).unwrap_or_else(|message| panic!("{message}\n{text}"))
}

#[test]
fn windows_are_read_and_printed() {
    let text = "[faults]\nlength = \"frozen\"\nuntil_s = 4\n\
                [faults.cold-start_2]\ngas = \"drifting\"\ngas_drift_k_s = -0.5\nfrom_s = 2\n\
                [faults.burst]\nleak_conductance_m3_s_pa = 1e-7\nlink = \"lost\"\n";
    let loaded = valid(text);
    let faults = &loaded.plant.faults;
    assert_eq!((faults.own.length, faults.own.until_s), (ChannelFault::Frozen, 4.0));
    let paths: Vec<String> = faults.windows().map(|(path, _)| path).collect();
    assert_eq!(paths, ["faults", "faults.burst", "faults.cold-start_2"]);
    let cold = &faults.named["cold-start_2"];
    assert_eq!((cold.gas, cold.gas_drift_k_s), (ChannelFault::Drifting, Some(-0.5)));
    assert_eq!(faults.largest_leak_m3_s_pa(), 1e-7);
    let printed = thermyo_setup::render(&loaded);
    assert_eq!(parse(&printed), Ok(loaded), "{printed}");
    let inline = "faults = { gas = \"open\", until_s = 1, later = { gas = \"open\", from_s = 1 } }";
    assert_eq!(valid(inline).plant.faults.named["later"].gas, ChannelFault::Open);
}

#[test]
fn what_is_no_window_is_refused() {
    for (text, message) in [
        (
            "[faults]\nfrom_s = 3\nuntil_s = 2",
            "3: faults.until_s = 2: must be a number from 3 to 1e6 s, not before faults.from_s",
        ),
        (
            "[faults.late]\nfrom_s = 3\nuntil_s = 2",
            "3: faults.late.until_s = 2: must be a number from 3 to 1e6 s, \
             not before faults.late.from_s",
        ),
        (
            "[faults]\npresure = \"open\"",
            "2: unknown key faults.presure; did you mean faults.pressure?",
        ),
        (
            "[faults.a]\npresure = \"open\"",
            "2: unknown key faults.a.presure; did you mean faults.a.pressure?",
        ),
        (
            "[faults.pressure]\nfrom_s = 1",
            "1: faults.pressure = [faults.pressure]: must be one of \
             \"none\", \"open\", \"shorted\", \"frozen\", \"noisy\", \"drifting\"",
        ),
        (
            "[faults.a.b]\n",
            "1: unknown table [faults.a.b]; known here: [faults], \
             [faults.NAME], NAME made of letters, digits, - and _",
        ),
        (
            "[faults.\"a b\"]\n",
            "1: unknown table [faults.a b]; known here: [faults], \
             [faults.NAME], NAME made of letters, digits, - and _",
        ),
        (
            "[believed.faults.a]\n",
            "1: believed.faults: the core does not know of it, so that it cannot believe otherwise",
        ),
        ("[faults]\nemergency_stop = 1", "2: faults.emergency_stop = 1: must be true or false"),
        (
            "[faults]\nlink = true",
            "2: faults.link = true: must be one of \"none\", \"lost\", \"flooded\"",
        ),
        (
            "[faults]\ninlet = \"frozen\"",
            "2: faults.inlet = \"frozen\": must be one of \"none\", \"open\", \"shut\", \"leaking\"",
        ),
        (
            "[faults]\noutlet_leak = 1.5",
            "2: faults.outlet_leak = 1.5: must be a number from 0 to 1",
        ),
        (
            "[faults]\nleak_conductance_m3_s_pa = -1e-9",
            "2: faults.leak_conductance_m3_s_pa = -1e-9: must be a number from 0 to 0.001 m3/(s Pa)",
        ),
    ] {
        assert_eq!(parse(text), Err(format!("scenario.toml:{message}")), "{text}");
    }
}

#[test]
fn a_fault_needs_its_size() {
    for (line, fault, needed) in [
        ("pressure", "drifting", "pressure_drift_pa_s"),
        ("gas", "drifting", "gas_drift_k_s"),
        ("length", "drifting", "length_drift_m_s"),
        ("inlet", "leaking", "inlet_leak"),
        ("outlet", "leaking", "outlet_leak"),
    ] {
        for table in ["faults", "faults.a"] {
            let text = format!("[{table}]\nfrom_s = 1\n{line} = \"{fault}\"\n");
            let message = format!(
                "scenario.toml:3: {table}.{needed} is missing: {table}.{line} = \"{fault}\" needs it"
            );
            assert_eq!(parse(&text), Err(message));
            valid(&format!("{text}{needed} = 0.01\n"));
        }
    }
}

#[test]
fn the_same_line_cannot_break_twice_at_a_time() {
    for (key, value) in [
        ("pressure", "\"open\""),
        ("gas", "\"noisy\""),
        ("length", "\"frozen\""),
        ("inlet", "\"open\""),
        ("outlet", "\"shut\""),
        ("leak_conductance_m3_s_pa", "1e-9"),
        ("supply_pressure_pa", "2e5"),
        ("emergency_stop", "true"),
        ("link", "\"lost\""),
        ("missed_steps", "3"),
        ("board_restart", "true"),
    ] {
        let windows = |a: (f64, f64), b: (f64, f64)| {
            let window = |(from_s, until_s): (f64, f64)| {
                format!("from_s = {from_s:?}\nuntil_s = {until_s:?}\n{key} = {value}\n")
            };
            format!("[faults.a]\n{}[faults.b]\n{}", window(a), window(b))
        };
        let message = format!(
            "scenario.toml:8: faults.b.{key} = {value}: must be left out from 3 to 4 s: \
             faults.a.{key} is a fault there already"
        );
        assert_eq!(parse(&windows((1.0, 4.0), (3.0, 5.0))), Err(message.clone()));
        assert_eq!(parse(&windows((3.0, 9.0), (1.0, 4.0))), Err(message));
        valid(&windows((1.0, 3.0), (3.0, 5.0)));
        valid(&windows((3.0, 5.0), (1.0, 3.0)));
    }
    // Other channels may have faults, and "none" is not a fault.
    valid("[faults]\ngas = \"open\"\n[faults.a]\npressure = \"open\"\ngas = \"none\"\n");
    assert_eq!(
        parse("[faults.a]\ngas = \"open\"\n\n[faults]\ngas = \"open\"\nuntil_s = 0.5"),
        Err("scenario.toml:2: faults.a.gas = \"open\": must be left out from 0 to 0.5 s: \
             faults.gas is a fault there already"
            .to_owned())
    );
}

#[test]
fn a_plant_breaks_only_what_it_has() {
    for (kind, key, value, what) in [
        ("fill", "inlet", "\"open\"", "valves"),
        ("discharge", "outlet", "\"shut\"", "valves"),
        ("closed", "outlet", "\"open\"", "valves"),
        ("discharge", "supply_pressure_pa", "1e5", "supply"),
        ("closed", "supply_pressure_pa", "1e5", "supply"),
    ] {
        let text = |plant: &str| {
            format!("drive.kind = \"{kind}\"\n[faults.a]\n{key} = {value}\n[plant]\n{plant}\n")
        };
        let message = format!(
            "scenario.toml:3: faults.a.{key} = {value}: must be left out: \
             a vessel with drive.kind = \"{kind}\" has no {what}"
        );
        assert_eq!(parse(&text("kind = \"vessel\"")), Err(message));
        for model in ["full", "lumped", "paper"] {
            valid(&text(&format!("model = \"{model}\"")));
        }
    }
    let vessel = "[plant]\nkind = \"vessel\"\n";
    valid(&format!("{vessel}[drive]\nkind = \"fill\"\n[faults]\nsupply_pressure_pa = 2e5\n"));
    valid(&format!("{vessel}[drive]\nkind = \"pressure\"\n[faults]\ninlet = \"open\"\n"));
}

#[test]
fn a_sweep_changes_windows_that_there_are() {
    let text = "[faults.burst]\nleak_conductance_m3_s_pa = 1e-9\n";
    let mut document = Document::parse(text, Path::new("scenario.toml")).unwrap();
    document.set("faults.burst.leak_conductance_m3_s_pa", 2e-9).unwrap();
    document.set("faults.burst.from_s", 1.0).unwrap();
    let burst = &thermyo_setup::assemble(&document).unwrap().plant.faults.named["burst"];
    assert_eq!((burst.leak_conductance_m3_s_pa, burst.from_s), (2e-9, 1.0));
    let error = document.set("faults.brust.from_s", 1.0).unwrap_err().to_string();
    assert_eq!(
        error,
        "unknown table [faults.brust]; known here: [faults], [faults.NAME], NAME one that the file has"
    );
}

const CODES: Codes = Codes {
    pressure: RawCode::Adc(AdcCode(10_000)),
    gas: RawCode::Adc(AdcCode(11_000)),
    length: AdcCode(12_000),
};

#[test]
fn every_window_acts_in_its_own_time() {
    let loaded = valid(
        "[faults]\npressure = \"open\"\nfrom_s = 1\nuntil_s = 2\n\
         [faults.a]\ngas = \"shorted\"\nemergency_stop = true\nfrom_s = 1.5\nuntil_s = 3\n\
         [faults.b]\npressure = \"frozen\"\nfrom_s = 2\nuntil_s = 4\n\
         [faults.c]\ninlet = \"leaking\"\ninlet_leak = 0.2\noutlet = \"shut\"\nfrom_s = 1\nuntil_s = 4\n\
         [faults.d]\nleak_conductance_m3_s_pa = 3e-9\nsupply_pressure_pa = 2e5\n\
         link = \"lost\"\nfrom_s = 2\nuntil_s = 3\n",
    );
    let mut faults = InjectedFaults::new(&loaded.plant);
    for (time_s, pressure, gas, stopped, shut, leak, supply, lost) in [
        (0.999, 10_000, 11_000, false, 0.0, 0.0, None, false),
        (1.0, 32_760, 11_000, false, 0.2, 0.0, None, false),
        (1.5, 32_760, 0, true, 0.2, 0.0, None, false),
        // Frozen at its value when the fault began.
        (2.0, 32_760, 0, true, 0.2, 3e-9, Some(2e5), true),
        (3.0, 32_760, 11_000, false, 0.2, 0.0, None, false),
        (4.0, 10_000, 11_000, false, 0.0, 0.0, None, false),
    ] {
        let sample = faults.apply(time_s, CODES);
        let codes = [sample.pressure.to_bits(), sample.gas.to_bits(), sample.length.0];
        assert_eq!(codes, [pressure, gas, 12_000]);
        assert_eq!((sample.emergency_stop, sample.heard), (stopped, !lost), "{time_s}");
        let disturbance = faults.disturbance(time_s);
        assert_eq!(disturbance.inlet, Travel { shut, open: 1.0 }, "{time_s}");
        let outlet = if shut > 0.0 { Travel { shut: 0.0, open: 0.0 } } else { Travel::default() };
        assert_eq!(disturbance.outlet, outlet, "{time_s}");
        assert_eq!((disturbance.leak_m3_s_pa, disturbance.supply_pa), (leak, supply), "{time_s}");
    }
}

/// Times of a run, off by a rounding error.
#[test]
fn steps_are_left_out_and_a_link_is_flooded() {
    let loaded = valid(
        "[faults]\nmissed_steps = 7\nfrom_s = 0.1\nuntil_s = 0.45\nmissed_period_s = 0.1\n\
         [faults.once]\nmissed_steps = 9\nfrom_s = 0.7\nlink = \"flooded\"\n\
         missed_period_s = 1e6\n",
    );
    for off_s in [-1e-12, 0.0, 1e-12] {
        let mut faults = InjectedFaults::new(&loaded.plant);
        let mut missed = Vec::new();
        for step in 0..1000_u16 {
            let sample = faults.apply(f64::from(step) * 0.001 + off_s, CODES);
            if sample.missed_steps > 0 {
                missed.push((step, sample.missed_steps));
            }
            if step != 700 {
                assert_eq!(sample.flooded, step > 700, "step {step}");
            }
        }
        let expected = [(100, 7), (200, 7), (300, 7), (400, 7), (700, 9)];
        assert_eq!(missed.len(), expected.len(), "{missed:?}");
        for ((step, count), (due, expected)) in missed.into_iter().zip(expected) {
            assert!(step - due <= 1 && count == expected, "step {step}: {count}");
        }
    }
}

#[test]
fn a_drifting_sensor_runs_away_from_the_start_of_its_window() {
    let loaded = valid(
        "[faults.a]\npressure = \"drifting\"\npressure_drift_pa_s = -1e4\nfrom_s = 2\nuntil_s = 5\n\
         [faults.b]\ngas = \"drifting\"\ngas_drift_k_s = 0.5\nfrom_s = 3\n\
         [faults.c]\nlength = \"drifting\"\nlength_drift_m_s = 0.01\nfrom_s = 4\n",
    );
    let faults = InjectedFaults::new(&loaded.plant);
    let truth = Truth {
        sensor_pressure_pa: 3e5,
        sensor_gas_k: 300.0,
        sensor_length_m: 0.25,
        ..Truth::default()
    };
    for (time_s, pressure_pa, gas_k, length_m) in [
        (1.9, 3e5, 300.0, 0.25),
        (2.0, 3e5, 300.0, 0.25),
        (4.0, 2.8e5, 300.5, 0.25),
        (4.5, 2.75e5, 300.75, 0.255),
        (6.0, 3e5, 301.5, 0.27),
    ] {
        let truth = Truth { time_s, ..truth };
        let expected = Truth {
            sensor_pressure_pa: pressure_pa,
            sensor_gas_k: gas_k,
            sensor_length_m: length_m,
            ..truth
        };
        assert_eq!(faults.sensed(&truth), expected);
    }
    // It passes through the front end, to the end of the range.
    let late = Truth { time_s: 1000.0, ..truth };
    let codes = VirtualAdc::new(&loaded.plant).convert(&faults.sensed(&late));
    assert_eq!((codes.gas, codes.length), (AdcCode(32_760).into(), AdcCode(32_760)));
}

#[test]
fn a_run_with_several_windows() {
    let healthy = "run = { duration_s = 5, log_every = 1 }\nplant.model = \"lumped\"\n\
                   drive = { kind = \"pressure\", pressure_pa = 2.5e5 }\n";
    let rows_of = |windows: &str| rows(&format!("{healthy}{windows}"));
    let (good, bad) = (
        rows(healthy),
        rows_of(
            "[faults]\ngas = \"drifting\"\ngas_drift_k_s = 2.0\nfrom_s = 1\n\
             [faults.stuck]\ninlet = \"open\"\nfrom_s = 2\nuntil_s = 2.5\n\
             [faults.button]\nemergency_stop = true\nfrom_s = 3\nuntil_s = 3.1\n\
             [faults.burst]\nleak_conductance_m3_s_pa = 1e-7\nfrom_s = 2.4\nuntil_s = 2.9\n",
        ),
    );
    let differs = good.iter().zip(&bad).position(|(good, bad)| good != bad).unwrap();
    assert!((1000..1050).contains(&differs), "{differs}");
    let drift = |i: usize| bad[i].sensor_gas_k - good[i].sensor_gas_k;
    assert!((drift(1900) - 1.8).abs() < 0.1, "{}", drift(1900));
    let pressure = |i: usize| bad[i].truth.pressure_pa;
    assert!((pressure(1999) / 2.5e5 - 1.0).abs() < 0.03, "{}", pressure(1999));
    // Stuck open against a controller that vents: above the set point, but no more than the supply.
    assert!((3.0e5..7.0e5).contains(&pressure(2399)), "{}", pressure(2399));
    // Through a hole of 25 valves the pressure falls below 1.2 bar, once the inlet is no longer
    // stuck.
    assert!(pressure(2899) < 1.2e5, "{}", pressure(2899));
    let stopped = |row: &Row| row.telemetry.sample.emergency_stop;
    let pressed: Vec<usize> = (0..bad.len()).filter(|i| stopped(&bad[*i])).collect();
    assert_eq!((pressed[0], pressed.len()), (3000, 100));
    assert!(bad[3000].telemetry.faults.intersects(Faults::EMERGENCY_STOP));
    assert!(bad[4999].telemetry.faults.intersects(Faults::EMERGENCY_STOP), "latched");
    assert!(!bad[2999].telemetry.faults.intersects(Faults::EMERGENCY_STOP));
}

/// The board vents at once, is not configured, and rows continue at their own times.
#[test]
fn a_board_that_restarts_vents_and_counts_anew() {
    let text = |windows: &str| {
        format!(
            "run = {{ duration_s = 2, log_every = 1 }}\nplant.model = \"lumped\"\n\
             drive = {{ kind = \"pressure\", pressure_pa = 2.5e5 }}\n{windows}"
        )
    };
    let rows = rows(&text(
        "[faults]\nboard_restart = true\nfrom_s = 1.2\n\
         [faults.before]\nemergency_stop = true\nfrom_s = 1\nuntil_s = 1.01\n",
    ));
    assert_eq!(rows.len(), 2001);
    for (step, row) in rows.iter().enumerate() {
        let telemetry = row.telemetry;
        assert!((row.truth.time_s - 0.001 * step as f64).abs() < 1e-9);
        let restarted = step >= 1200;
        assert_eq!(telemetry.mode == Mode::StartupCheck, (1200..1249).contains(&step), "{step}");
        assert_eq!(
            telemetry.step as usize,
            if restarted { step.saturating_sub(1249) } else { step }
        );
        assert_eq!(telemetry.faults.intersects(Faults::NOT_CONFIGURED), restarted, "{step}");
        assert_eq!(
            telemetry.faults.intersects(Faults::EMERGENCY_STOP),
            step >= 1000,
            "{step}: latched"
        );
        assert!(step < 1000 || telemetry.command == Command::VENT, "{step}");
    }
    // A board behind a link cannot be restarted.
    let message = BoardError::NoRestart.to_string();
    assert!(message.starts_with("faults.board_restart: "), "{message}");
}
