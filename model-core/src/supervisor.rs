//! What may run and what must vent.
//!
//! | fault | detected | consequence |
//! |---|---|---|
//! | emergency stop | at once | vent, latched |
//! | pressure sensor at a rail | for [`PATIENCE_STEPS`] steps | vent, latched |
//! | pressure sensor noisier than gas can be | ten jerks within forty steps | vent, latched |
//! | pressure sensor's code stands still while the inlet is driven | for [`FROZEN_STEPS`] such steps | vent, latched |
//! | overpressure | for [`PATIENCE_STEPS`] steps | vent, latched |
//! | gas sensor at a rail | at once | shown while it lasts; the estimator goes on without it |
//! | gas sensor's code stands still | when its element must have moved | the same |
//! | length sensor at a rail | at once | shown while it lasts; length from pressure and load |
//! | length sensor noisier than a muscle can move | ten jerks within forty steps | the same |
//! | length sensor's code stands still while the inlet is driven | for [`FROZEN_STEPS`] such steps | the same |
//!
//! While the pressure is not to be trusted there is no estimate.
//!
//! A latched fault ends with [`Supervisor::clear`], and only when its cause is gone. Another
//! configuration or another start of the core is no way round: the supervisor outlives both, and
//! after each of them the muscle vents for the [`JUDGING_STEPS`] that it takes to judge the sensors.

use crate::front_end::{at_rail, is_wide};
use crate::sample::{AdcCode, CODE_MAX, Faults, Sample};

/// Steps for which a fault of the pressure channel must last before the muscle is vented: one
/// disturbed conversion is no fault, ten milliseconds of them are.
pub const PATIENCE_STEPS: u16 = 10;

/// Steps after a start for which the muscle vents, whatever is asked: a line that is shorted, beyond
/// the limit or noisy shows by then.
pub const JUDGING_STEPS: u16 = 50;

/// Steps with a driven inlet for which a code may stand still. The noise of eight summed conversions
/// moves it at almost every step, and so does gas that flows; only in a code of erratum RP2040-E11
/// neither is seen.
pub const FROZEN_STEPS: u16 = 60;

/// A change of the change from step to step beyond this is a jerk: 2 % of the range. The gas of a
/// muscle behind a fast valve makes a fifth of it.
const JERK: i32 = (CODE_MAX / 50) as i32;
/// What a jerk adds to the count of a noisy line; a step without one takes 1 away.
const JERK_WEIGHT: u16 = 4;
/// Count from which a line is noisy, ten jerks, and the most that is counted.
const NOISY: u16 = 40;
const MOST_NOISY: u16 = 60;

/// Faults that vent.
const VENTING: Faults =
    Faults::EMERGENCY_STOP.with(Faults::PRESSURE_SENSOR).with(Faults::OVERPRESSURE);

/// The last codes of a channel, and how much they jerked.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Line {
    last: u16,
    before: u16,
    jerks: u16,
    still_steps: u16,
}

impl Line {
    /// Takes the next code.
    fn add(&mut self, code: AdcCode, filling: bool) {
        let [now, last, before] = [code.0, self.last, self.before].map(i32::from);
        self.jerks = if (now - 2 * last + before).abs() > JERK {
            (self.jerks + JERK_WEIGHT).min(MOST_NOISY)
        } else {
            self.jerks.saturating_sub(1)
        };
        if now != last || is_wide(code) {
            self.still_steps = 0;
        } else if filling {
            self.still_steps = self.still_steps.saturating_add(1);
        }
        self.before = self.last;
        self.last = code.0;
    }

    fn frozen(&self) -> bool {
        self.still_steps >= FROZEN_STEPS
    }

    fn noisy(&self) -> bool {
        self.jerks >= NOISY
    }
}

/// Watches the inputs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Supervisor {
    latched: Faults,
    present: Faults,
    judging_steps: u16,
    pressure_sensor_steps: u16,
    overpressure_steps: u16,
    pressure: Line,
    length: Line,
}

impl Default for Supervisor {
    fn default() -> Self {
        Self {
            latched: Faults::NONE,
            present: Faults::NONE,
            judging_steps: JUDGING_STEPS,
            pressure_sensor_steps: 0,
            overpressure_steps: 0,
            pressure: Line::default(),
            length: Line::default(),
        }
    }
}

impl Supervisor {
    /// What it goes on with after the core was started anew: everything that it has counted and
    /// latched, and the sensors are judged again.
    pub fn after_restart(&self) -> Self {
        Self { judging_steps: JUDGING_STEPS, ..*self }
    }

    /// Whether the sensors are still being judged, after the last step.
    pub fn judging(&self) -> bool {
        self.judging_steps > 0
    }

    /// Looks at the inputs of one step; returns the faults that hold. `filling`: the inlet has
    /// been open since the last step.
    pub fn step(
        &mut self,
        sample: &Sample,
        pressure_pa: f32,
        limit_pa: f32,
        filling: bool,
    ) -> Faults {
        self.judging_steps = self.judging_steps.saturating_sub(1);
        let count =
            |condition: bool, steps: u16| if condition { steps.saturating_add(1) } else { 0 };
        self.pressure_sensor_steps = count(at_rail(sample.pressure), self.pressure_sensor_steps);
        self.overpressure_steps = count(pressure_pa > limit_pa, self.overpressure_steps);
        self.pressure.add(sample.pressure, filling);
        self.length.add(sample.length, filling);
        let pressure_lost = self.pressure_sensor_steps >= PATIENCE_STEPS
            || self.pressure.frozen()
            || self.pressure.noisy();
        let length_lost = at_rail(sample.length) || self.length.frozen() || self.length.noisy();
        let mut present = Faults::NONE;
        for (condition, fault) in [
            (sample.emergency_stop, Faults::EMERGENCY_STOP),
            (pressure_lost, Faults::PRESSURE_SENSOR),
            (self.overpressure_steps >= PATIENCE_STEPS, Faults::OVERPRESSURE),
            (at_rail(sample.gas), Faults::GAS_SENSOR),
            (length_lost, Faults::LENGTH_SENSOR),
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

    /// Whether the pressure of the last step is to be trusted.
    pub fn pressure_trusted(&self) -> bool {
        self.pressure_sensor_steps == 0 && !self.present.intersects(Faults::PRESSURE_SENSOR)
    }

    /// Whether the muscle must vent.
    pub fn must_vent(&self) -> bool {
        self.judging() || self.faults().intersects(VENTING)
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

    /// One that has judged its healthy sensors.
    fn judged() -> Supervisor {
        let mut supervisor = Supervisor::default();
        for _ in 0..JUDGING_STEPS {
            supervisor.step(&HEALTHY, 2.0e5, 6.9e5, false);
        }
        supervisor
    }

    #[test]
    fn emergency_stop_latches_until_cleared() {
        let mut supervisor = judged();
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
        let mut supervisor = judged();
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
        let mut supervisor = judged();
        let sample = Sample { gas: AdcCode(0), length: AdcCode(32_760), ..HEALTHY };
        let faults = supervisor.step(&sample, 2.0e5, 6.9e5, false);
        assert_eq!(faults, Faults::GAS_SENSOR.with(Faults::LENGTH_SENSOR));
        assert!(!supervisor.must_vent());
        assert_eq!(supervisor.step(&HEALTHY, 2.0e5, 6.9e5, false), Faults::NONE);
    }

    /// So many steps with a driven inlet, or without; the faults after them.
    fn stand(supervisor: &mut Supervisor, sample: &Sample, steps: u16, filling: bool) -> Faults {
        for _ in 0..steps {
            supervisor.step(sample, 2.0e5, 6.9e5, filling);
        }
        supervisor.faults()
    }

    #[test]
    fn a_frozen_pressure_vents_while_the_muscle_fills() {
        let mut supervisor = judged();
        let moved = |by: u16| Sample {
            pressure: AdcCode(10_000 + by),
            length: AdcCode(20_000 + by),
            ..HEALTHY
        };
        assert_eq!(stand(&mut supervisor, &HEALTHY, 200, false), Faults::NONE, "at rest");
        assert_eq!(stand(&mut supervisor, &HEALTHY, FROZEN_STEPS - 1, true), Faults::NONE);
        assert_eq!(stand(&mut supervisor, &moved(1), FROZEN_STEPS, true), Faults::NONE, "it moved");
        assert_eq!(stand(&mut supervisor, &moved(1), 200, false), Faults::NONE, "nothing flows");
        let both = Faults::PRESSURE_SENSOR.with(Faults::LENGTH_SENSOR);
        assert_eq!(stand(&mut supervisor, &moved(1), 1, true), both);
        assert!(supervisor.must_vent());
        stand(&mut supervisor, &moved(1), 1, false);
        assert!(!supervisor.pressure_trusted(), "while it stands still");
        assert_eq!(stand(&mut supervisor, &moved(2), 1, false), Faults::PRESSURE_SENSOR, "latched");
        assert!(supervisor.pressure_trusted() && supervisor.must_vent());
    }

    /// A large muscle fills so slowly that it takes longer through a code of nine steps.
    #[test]
    fn a_wide_code_is_not_a_frozen_line() {
        let mut supervisor = Supervisor::default();
        for step in 0..500 {
            let sample = Sample { pressure: AdcCode(12_288), ..HEALTHY };
            let sample = Sample { length: AdcCode(20_000 + step % 2), ..sample };
            assert_eq!(stand(&mut supervisor, &sample, 1, true), Faults::NONE);
        }
    }

    #[test]
    fn noise_is_told_from_motion() {
        let mut supervisor = Supervisor::default();
        let mut code = 5000_u16;
        for step in 0..500_u16 {
            // A fast fill and a fast vent, with the noise of a healthy line.
            code = if step % 100 < 50 { code + 180 } else { code - 180 };
            let sample = Sample {
                pressure: AdcCode(code + step % 7),
                length: AdcCode(30_000 - code),
                ..HEALTHY
            };
            assert_eq!(supervisor.step(&sample, 2.0e5, 6.9e5, true), Faults::NONE);
        }
        for step in 0..40_u32 {
            let noise = (step * 7919 % 3000) as u16;
            let sample = Sample { length: AdcCode(20_000 + noise), ..HEALTHY };
            supervisor.step(&sample, 2.0e5, 6.9e5, false);
        }
        assert_eq!(supervisor.faults(), Faults::LENGTH_SENSOR);
        for step in 0..40_u32 {
            let noise = (step * 7919 % 3000) as u16;
            let sample = Sample { pressure: AdcCode(20_000 + noise), ..HEALTHY };
            supervisor.step(&sample, 2.0e5, 6.9e5, false);
        }
        assert_eq!(supervisor.faults(), Faults::PRESSURE_SENSOR);
        assert!(!supervisor.pressure_trusted());
        for _ in 0..MOST_NOISY {
            supervisor.step(&HEALTHY, 2.0e5, 6.9e5, false);
        }
        assert!(supervisor.pressure_trusted() && supervisor.must_vent());
    }
}
