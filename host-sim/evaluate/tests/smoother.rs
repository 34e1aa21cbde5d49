//! The smoother as yardstick of the estimator.

use model_core::{AdcCode, Estimate, Telemetry};
use thermyo_evaluate::smoother;
use thermyo_evaluate::smoother::Best;
use thermyo_setup::Loaded;
use thermyo_setup::core_config::core_config;
use thermyo_simulation::run;

struct Recorded {
    loaded: Loaded,
    telemetry: Vec<Telemetry>,
    truth_k: Vec<f64>,
}

impl Recorded {
    /// 20 s of the nominal cycle on `lumped` with a constant coefficient, as the smoother has it; the core's heat
    /// transfer is wrong by the factor `heat`.
    fn new(heat: f64) -> Self {
        let text = "[run]\nduration_s = 20.0\nlog_every = 1\n[plant]\nmodel = \"lumped\"\n\
                    [heat]\nmodel = \"constant\"\n";
        let mut loaded = thermyo_setup::parse(text, "test".as_ref()).unwrap();
        loaded.believed.heat.scale *= heat;
        let (mut telemetry, mut truth_k) = (Vec::new(), Vec::new());
        run::on_core(&loaded, |row| {
            telemetry.push(row.telemetry);
            truth_k.push(row.truth.gas_temperature_k);
        })
        .unwrap();
        Self { loaded, telemetry, truth_k }
    }

    fn best(&self) -> Best {
        smoother::smooth(&core_config(&self.loaded.believed), &self.telemetry)
    }

    fn smooth(&self) -> Vec<f64> {
        self.best().smoothed_k
    }

    /// RMS error of temperatures \[K\] in a part of the run \[s\].
    fn rms_k(&self, temperatures: &[f64], from_s: usize, to_s: usize) -> f64 {
        let steps = from_s * 1000..to_s * 1000;
        let pairs = temperatures[steps.clone()].iter().zip(&self.truth_k[steps.clone()]);
        (pairs.map(|(a, b)| (a - b).powi(2)).sum::<f64>() / steps.len() as f64).sqrt()
    }

    fn online_k(&self) -> Vec<f64> {
        self.telemetry.iter().map(|telemetry| f64::from(telemetry.estimate.gas_k)).collect()
    }
}

/// Configured correctly, the estimator is as good as a filter that uses the future.
#[test]
fn it_is_as_good_as_the_estimator_where_the_model_holds() {
    let recorded = Recorded::new(1.0);
    let smoothed = recorded.smooth();
    assert_eq!(smoothed.len(), 20_001);
    let error_k = recorded.rms_k(&smoothed, 5, 20);
    let times = recorded.rms_k(&recorded.online_k(), 5, 20) / error_k;
    assert!((0.005..0.05).contains(&error_k), "{error_k} K");
    assert!((0.9..2.0).contains(&times), "the estimator's error is {times} times that");
}

#[test]
fn later_readings_improve_earlier_estimates() {
    let recorded = Recorded::new(0.7);
    let best = recorded.best();
    let [online_k, forward_k, smoothed_k] =
        [&recorded.online_k(), &best.forward_k, &best.smoothed_k]
            .map(|temperatures| recorded.rms_k(temperatures, 2, 10));
    assert!((0.01..0.3).contains(&smoothed_k), "{smoothed_k} K");
    assert!((1.2..20.0).contains(&(online_k / smoothed_k)), "{online_k} K before the fact");
    let times = forward_k / smoothed_k;
    assert!((4.0..16.0).contains(&times), "{times} times that without the pass back");
}

#[test]
fn it_sees_samples_and_duties_only() {
    let mut recorded = Recorded::new(1.0);
    let smoothed = recorded.smooth();
    for telemetry in &mut recorded.telemetry {
        telemetry.estimate = Estimate::default();
    }
    assert_eq!(recorded.smooth(), smoothed);
    // 250 of 29 491 codes over 60 K: an element that reads 0.5 K too high, without any contradiction.
    for telemetry in &mut recorded.telemetry {
        telemetry.sample.gas = AdcCode(telemetry.sample.gas.adc().0 + 250).into();
    }
    let warmer_k = recorded.rms_k(&recorded.smooth(), 5, 20);
    assert!((0.3..0.7).contains(&warmer_k), "{warmer_k} K");
}

#[test]
fn short_runs_have_an_answer() {
    let mut recorded = Recorded::new(1.0);
    for steps in [0, 1, 2, 20, 21, 22, 50] {
        recorded.telemetry.truncate(50);
        let part = &recorded.telemetry[..steps];
        let best = smoother::smooth(&core_config(&recorded.loaded.believed), part);
        for best_k in [best.forward_k, best.smoothed_k] {
            assert_eq!(best_k.len(), steps);
            assert!(best_k.iter().all(|k| (290.0..306.0).contains(k)), "{best_k:?}");
        }
    }
}
