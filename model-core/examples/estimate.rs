//! The estimator alone: gas is let in for a tenth of a second, and cools. The Pt1000, told by its
//! codes, has not noticed yet.

use model_core::estimation::{Estimator, Measurement, Openings};
use model_core::{AdcCode, Config};

fn main() {
    let mut estimator = Estimator::new(&Config::default());
    for step in 0..2000_u16 {
        let filling = step < 100;
        let pressure_pa = 1.5e5 + 1.0e3 * f32::from(step.min(100));
        estimator.step(&Measurement {
            pressure_pa: Some(pressure_pa),
            length_m: 0.28,
            wide_pressure: false,
            wide_length: false,
            gas: Some(AdcCode(15_950 + step % 2)),
            openings: Openings {
                turned: step == 100,
                driven: filling,
                charging: filling,
                discharging: false,
            },
        });
        if step % 200 == 99 {
            let estimate = estimator.estimate();
            println!("{step:4} ms  {:.1} K +- {:.1} K", estimate.gas_k, estimate.gas_sd_k);
        }
    }
}
