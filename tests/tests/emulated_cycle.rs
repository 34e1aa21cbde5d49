//! The flashed image, in closed loop with the plant, against the core in this process.

use system_tests::{Finished, run_text, thermyo};

fn scenario(model: &str) -> String {
    format!("[run]\nduration_s = 20.0\nlog_every = 1\n[plant]\nmodel = \"{model}\"\n")
}

/// RMS difference of the estimates \[K\] and largest relative difference of the pressures.
fn distance(a: &Finished, b: &Finished) -> (f64, f64) {
    let estimates = a.column("estimate_k").into_iter().zip(b.column("estimate_k"));
    let squares: Vec<f64> = estimates.map(|(a, b)| (a - b).powi(2)).collect();
    let pressures = a.column("pressure_pa").into_iter().zip(b.column("pressure_pa"));
    let worst = pressures.map(|(a, b)| (a / b - 1.0).abs()).fold(0.0, f64::max);
    ((squares.iter().sum::<f64>() / squares.len() as f64).sqrt(), worst)
}

#[test]
#[cfg_attr(not(emulator), ignore = "THERMYO_SKIP_EMULATOR=1")]
fn the_papers_cycle_is_the_same_on_the_emulated_board() {
    let here = run_text(&scenario("full"), &[]);
    let there = run_text(&scenario("full"), &["--board", "emulated"]);
    assert_eq!(there.summary["board"], "emulated");
    assert_eq!(there.column("time_s").len(), 20_001);
    let (estimate_k, pressure) = distance(&here, &there);
    println!("estimate {estimate_k} K, pressure {pressure}");
    // The board's timer rounds the duties: equality to the bit would mean that nothing was
    // emulated.
    assert!((1e-9..0.05).contains(&estimate_k), "{estimate_k} K");
    assert!((1e-12..0.005).contains(&pressure), "{pressure}");
    // The core computes the same from the same samples.
    let trace = there.path("trace.csv").display().to_string();
    let place = there.path("replay").display().to_string();
    let outcome = thermyo(&["replay", &trace, "--json", "--out", &place]);
    assert_eq!(outcome.code, 0, "{}", outcome.err);
    assert!(outcome.out.contains("\"mismatches\": 0") && outcome.out.contains("20001"));
}

#[test]
fn a_changed_bit_of_a_record_is_found() {
    let run = run_text("[run]\nduration_s = 0.5\nlog_every = 1\n", &[]);
    let trace = run.path("trace.csv");
    let name = trace.display().to_string();
    let place = run.path("replay").display().to_string();
    let replay = || thermyo(&["replay", &name, "--out", &place]);
    assert_eq!(replay().code, 0);
    let text = run.text("trace.csv");
    let row = text.lines().nth(100).unwrap();
    let cells: Vec<&str> = row.split(',').collect();
    let estimate = cells[11].parse::<f64>().unwrap() as f32;
    let nudged = f64::from(f32::from_bits(estimate.to_bits() + 1)).to_string();
    std::fs::write(&trace, text.replace(row, &row.replace(cells[11], &nudged))).unwrap();
    let outcome = replay();
    assert_eq!(outcome.code, 1, "{}", outcome.out);
    assert!(outcome.err.contains("1 of 501 steps differ, the first is step 99"), "{}", outcome.err);
}

#[test]
fn a_record_with_gaps_is_refused() {
    let run = run_text("[run]\nduration_s = 0.5\n", &[]);
    let outcome = thermyo(&["replay", &run.path("trace.csv").display().to_string()]);
    assert_eq!(outcome.code, 2);
    for remedy in ["goes on 10 steps later", "log_every = 1", "thermyo monitor PORT --every 1"] {
        assert!(outcome.err.contains(remedy), "{}", outcome.err);
    }
}
