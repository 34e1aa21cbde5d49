//! The estimator alone: gas flows in for a tenth of a second, and cools. The sensor does not show
//! it yet.

use model_core::Config;
use model_core::estimation::{Estimator, LengthSource, Measurement, Openings};
use model_core::physics::chamber::AnyChamber;
use model_core::sensing::{GasReading, Reading};

fn main() {
    let config = Config::default();
    let muscle = AnyChamber::new(&config.chamber);
    let mut estimator = Estimator::new(&config);
    for step in 0..2000_u16 {
        let filling = step < 100;
        let pressure_pa = 1.5e5 + 1.0e3 * f32::from(step.min(100));
        estimator.step(
            &muscle,
            &Measurement {
                pressure: Some(Reading::exact(pressure_pa)),
                length: Reading::exact(0.28),
                gas: Some(GasReading {
                    value_k: 298.0,
                    noise_k2: 1.0e-4,
                    moved: true,
                    age_steps: None,
                }),
                openings: Openings {
                    turned: step == 100,
                    driven: filling,
                    charging: filling,
                    discharging: false,
                },
                length_source: LengthSource::Sensor,
                busy: false,
            },
        );
        if step % 200 == 99 {
            let estimate = estimator.estimate();
            println!("{step:4} ms  {:.1} K +- {:.1} K", estimate.gas_k, estimate.gas_sd_k);
        }
    }
}
