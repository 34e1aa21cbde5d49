//! What may run and what must vent.
//!
//! | fault | detected | consequence |
//! |---|---|---|
//! | emergency stop | at once | vent, latched |
//! | pressure sensor at a rail | for [`PATIENCE_STEPS`] steps | vent, latched |
//! | pressure code stands still while a valve is driven | for [`FROZEN_STEPS`] steps | vent, latched |
//! | overpressure | for [`PATIENCE_STEPS`] steps | vent, latched |
//! | gas sensor at a rail, or frozen | at once; when it should have moved | shown while it lasts; the estimator goes on without it |
//! | length sensor at a rail | at once | shown while it lasts; length from pressure and load |
//!
//! A latched fault ends with [`Supervisor::clear`], and only when its cause is gone.

use crate::front_end::at_rail;
use crate::sample::{AdcCode, Faults, Sample};

/// Steps for which a fault of the pressure channel must last before the muscle is vented: one
/// disturbed conversion is no fault, ten milliseconds of them are.
pub const PATIENCE_STEPS: u16 = 10;

/// Steps for which the pressure's code may stand still while a valve is driven. The noise of eight
/// summed conversions moves it at almost every step, and gas that flows does.
pub const FROZEN_STEPS: u16 = 100;

/// Faults that vent.
const VENTING: Faults =
    Faults::EMERGENCY_STOP.with(Faults::PRESSURE_SENSOR).with(Faults::OVERPRESSURE);

/// Watches the inputs.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Supervisor {
    latched: Faults,
    present: Faults,
    pressure_sensor_steps: u16,
    overpressure_steps: u16,
    pressure_code: AdcCode,
    frozen_steps: u16,
}

impl Supervisor {
    /// Looks at the inputs of one step; returns the faults that hold. `driven`: a valve has been
    /// open since the last step.
    pub fn step(
        &mut self,
        sample: &Sample,
        pressure_pa: f32,
        limit_pa: f32,
        driven: bool,
    ) -> Faults {
        let count =
            |condition: bool, steps: u16| if condition { steps.saturating_add(1) } else { 0 };
        self.pressure_sensor_steps = count(at_rail(sample.pressure), self.pressure_sensor_steps);
        self.overpressure_steps = count(pressure_pa > limit_pa, self.overpressure_steps);
        let standing = driven && sample.pressure == self.pressure_code;
        self.pressure_code = sample.pressure;
        self.frozen_steps = count(standing, self.frozen_steps);
        let pressure_lost =
            self.pressure_sensor_steps >= PATIENCE_STEPS || self.frozen_steps >= FROZEN_STEPS;
        let mut present = Faults::NONE;
        for (condition, fault) in [
            (sample.emergency_stop, Faults::EMERGENCY_STOP),
            (pressure_lost, Faults::PRESSURE_SENSOR),
            (self.overpressure_steps >= PATIENCE_STEPS, Faults::OVERPRESSURE),
            (at_rail(sample.gas), Faults::GAS_SENSOR),
            (at_rail(sample.length), Faults::LENGTH_SENSOR),
        ] {
            if condition {
                present = present.with(fault);
            }
        }
        self.present = present;
        self.latched = self.latched.with(Faults(present.0 & VENTING.0));
        self.faults()
    }

    /// Faults that hold now or are latched.
    pub fn faults(&self) -> Faults {
        self.latched.with(self.present)
    }

    /// Whether the muscle must vent.
    pub fn must_vent(&self) -> bool {
        self.faults().intersects(VENTING)
    }

    /// Forgets the latched faults whose cause is gone.
    pub fn clear(&mut self) {
        self.latched = Faults(self.present.0 & VENTING.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEALTHY: Sample = Sample {
        pressure: AdcCode(10_000),
        gas: AdcCode(16_000),
        length: AdcCode(20_000),
        emergency_stop: false,
    };

    #[test]
    fn emergency_stop_latches_until_cleared() {
        let mut supervisor = Supervisor::default();
        assert_eq!(supervisor.step(&HEALTHY, 2.0e5, 6.9e5, false), Faults::NONE);
        supervisor.step(&Sample { emergency_stop: true, ..HEALTHY }, 2.0e5, 6.9e5, false);
        assert!(supervisor.must_vent());
        supervisor.clear();
        assert!(supervisor.must_vent(), "the line is still open");
        supervisor.step(&HEALTHY, 2.0e5, 6.9e5, false);
        assert!(supervisor.must_vent(), "latched");
        supervisor.clear();
        assert!(!supervisor.must_vent());
    }

    #[test]
    fn pressure_faults_need_patience() {
        let mut supervisor = Supervisor::default();
        let shorted = Sample { pressure: AdcCode(0), ..HEALTHY };
        for _ in 1..PATIENCE_STEPS {
            supervisor.step(&shorted, 0.0, 6.9e5, false);
            assert!(!supervisor.must_vent());
        }
        supervisor.step(&HEALTHY, 7.5e5, 6.9e5, false);
        assert!(!supervisor.must_vent(), "both counters start anew");
        for _ in 1..PATIENCE_STEPS {
            supervisor.step(&HEALTHY, 7.5e5, 6.9e5, false);
        }
        assert_eq!(supervisor.faults(), Faults::OVERPRESSURE);
        assert!(supervisor.must_vent());
    }

    #[test]
    fn temperature_and_length_faults_only_show() {
        let mut supervisor = Supervisor::default();
        let sample = Sample { gas: AdcCode(0), length: AdcCode(32_760), ..HEALTHY };
        let faults = supervisor.step(&sample, 2.0e5, 6.9e5, false);
        assert_eq!(faults, Faults::GAS_SENSOR.with(Faults::LENGTH_SENSOR));
        assert!(!supervisor.must_vent());
        assert_eq!(supervisor.step(&HEALTHY, 2.0e5, 6.9e5, false), Faults::NONE);
    }

    #[test]
    fn a_frozen_pressure_vents_while_a_valve_is_driven() {
        let mut supervisor = Supervisor::default();
        for _ in 0..2 * FROZEN_STEPS {
            assert_eq!(supervisor.step(&HEALTHY, 2.0e5, 6.9e5, false), Faults::NONE, "at rest");
        }
        for _ in 1..FROZEN_STEPS {
            assert_eq!(supervisor.step(&HEALTHY, 2.0e5, 6.9e5, true), Faults::NONE);
        }
        let moved = Sample { pressure: AdcCode(10_001), ..HEALTHY };
        assert_eq!(supervisor.step(&moved, 2.0e5, 6.9e5, true), Faults::NONE, "it moves");
        for _ in 0..FROZEN_STEPS {
            supervisor.step(&moved, 2.0e5, 6.9e5, true);
        }
        assert_eq!(supervisor.faults(), Faults::PRESSURE_SENSOR);
        assert!(supervisor.must_vent());
    }
}
