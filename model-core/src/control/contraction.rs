//! Contraction, either way: a reference that the chamber can follow, the pressure that it needs, and the gas mass that
//! corresponds to this pressure and length.
//!
//! The loop closes on gas mass, not on pressure. At a held pressure the muscle is soft (800 N/m near its rest length,
//! where 15 N of friction are 18 mm); at a held mass it is a gas spring (12 000 N/m and more), and an error of length
//! counts as missing gas:
//!
//! ```text
//! F     = load + disturbance + slip and creep + friction + viscous v + mass a      along the reference
//! P_ref = P_amb + (F - elastic)/(-dV/dL)                          force and geometry
//! dm    = (V (P_ref - P)/k + P (V(L_ref) - V(L)))/(R T)           eq. (6), adiabatic
//! ```
//!
//! L_ref is the reference's length when the gas of the period has arrived: later than the period's end by the valve's
//! dead time and half of its stroke, or by its lag.
//!
//! Friction is a play: it grows with the way since the last turn, up to the Coulomb force at the estimated wall
//! temperature, so that it neither chatters at rest nor jumps at a change of mode. Load, Coulomb force and mass are
//! observed ([`LoadObserver`]). An integral of the length error covers the rest, which the balance of forces does not
//! show: valves that move more or less gas than they should.
//!
//! Pulses are spared. After a pulse that has ended, small masses wait for a period, and the next pulse looks that much
//! further ahead; a pulse that nearly fills its period is extended to all of it, so that the valve stays open. A mass
//! that takes back part of the last pulse waits only within the dead zone: if valves move twice the believed mass,
//! waiting would keep the muscle swinging at a quarter of the PWM frequency.

use super::chamber_port::{ChamberPort, Feedback};
use super::course::{Course, Pace, Target};
use super::load_observer::{Balance, LoadObserver};
use super::valve_drive::OpenFlow;
use crate::config::{Config, ControllerConfig};
use crate::math::{absolute, limit, rough_inverse_sqrt};
use crate::physics::chamber::Chamber;
use crate::physics::hysteresis::{Held, Law};

/// Periods within the dead zone before the valves rest.
const CALM_PERIODS: u8 = 5;
/// Multiple of its width at which the dead zone is left \[-\].
const HYSTERESIS: f32 = 1.5;
/// Distance from either end of its lengths within which the load may lie on a stop \[m\].
const STOP_M: f32 = 3.0e-4;
/// Way, as a share of the rest length, whose gas can wait for a period; a mass that waits is a ripple of 50 Hz, of
/// which a load on its gas spring of 10 to 15 Hz follows a twentieth.
const WAITS: f32 = 0.0043;
/// Way, as a share of the rest length, whose gas may come a period early to keep a valve open.
const EARLY: f32 = 0.0017;
/// Swing of the load on its gas spring that friction has to end, as a share of the rest length: assumed, as left by a
/// step or a blow.
const SWING: f32 = 0.01;
/// Highest frequency of the reference after a step, as a share of the frequency of the load on its gas spring: a load
/// that has to stop sooner is thrown, as its muscle cannot push. Simulated with 2 to 30 kg and a third to three times
/// the valves: steps overshoot by up to 13 % where 90 rad/s left 54 %, and 0.55 is slower and no better.
const FASTEST: f32 = 0.7;
/// Duration for which [`FASTEST`] applies after a step, in its phase \[rad\]: (1 + 8) exp(-8) of the step is left then.
/// A moving set point is followed faster, because the reference lags behind it by its acceleration over the frequency
/// squared.
const STEP_RAD: f32 = 8.0;
const FOUR_PER_PI: f32 = 4.0 / core::f32::consts::PI;
/// Factor by which the integral shrinks faster than it grows while the muscle sticks: it has grown before a new load
/// was observed, and friction holds the muscle off its goal until it has shrunk. Simulated: factors of 4 to 11 settle
/// 66 load steps of eleven muscles equally well; with 31 and without any of the believed friction it swings.
const SHRINKS: f32 = 6.0;
/// Share of the dead zone: a muscle that moves by no more than this in a period sticks, a few LSB of a 12-bit length.
const STICKS: f32 = 1.0 / 3.0;
/// Share of an open period's mass up to which the mass of two periods fits into one.
const FITS: f32 = 0.5;

/// Double pole of the reference, x'' = w^2 (target - x) - 2 w (x' - target'), by backward Euler over a period.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Pole {
    rad: f32,
    /// Share of its speed that remains \[-\], and the speed due to an error \[1/s\] and to the target's speed \[-\].
    keeps: f32,
    per_error: f32,
    per_target_speed: f32,
}

impl Pole {
    fn new(rad_s: f32, period_s: f32) -> Self {
        let rad = rad_s * period_s;
        let keeps = 1.0 / (1.0 + rad * (2.0 + rad));
        Self { rad, keeps, per_error: keeps * rad * rad_s, per_target_speed: keeps * 2.0 * rad }
    }
}

/// Coefficients of a period, computed once because divisions are slow without an FPU.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gains {
    /// Pole of a reference that follows a set point.
    follows: Pole,
    /// Share of an error of the gas mass that one period closes \[-\].
    closes: f32,
    /// Square of the frequency of the load on its gas spring up to which the lead damps it \[1/s2\]: its force lags the
    /// speed by w theta + atan(w tau), theta the delay and tau the loop's time, and reaches a quarter of a turn at w^2
    /// = 1/(theta (tau + theta/3)), cot y = 1/y - y/3 being within 1 % there.
    damped_per_s2: f32,
    /// Delay of a pulse by its valve \[s\].
    late_s: f32,
    /// Configured lead over the loop's time \[-\].
    lead_closes: f32,
    /// Way, as a share of the rest length, whose gas can wait if it takes back part of the last pulse.
    turn_waits: f32,
    /// Way of a sticking muscle in a period, as a share of the rest length.
    sticks: f32,
    /// Force that the integral learns from an error, and while it shrinks with a sticking muscle \[N/m\].
    learns_n_m: f32,
    shrinks_n_m: f32,
    /// Largest way of the reference in a period, as a share of the rest length.
    fastest: f32,
    pace: Pace,
    /// Law of slip and creep over a period.
    law: Law,
}

impl Gains {
    /// Computes the coefficients for a period of `period_steps`.
    pub fn new(config: &Config, period_steps: u16) -> Self {
        let period_s = f32::from(period_steps) * config.step_s;
        let tuning = &config.controller;
        let valve_s = config.valve_kind.late_s(&config.valve);
        // The speed of a difference is half a period late, and a pulse another half.
        let late_s = period_s + valve_s;
        Self {
            follows: Pole::new(tuning.reference_rad_s, period_s),
            closes: limit(period_s / tuning.length_loop_s, 0.0, 1.0),
            damped_per_s2: 1.0 / (late_s * (tuning.length_loop_s + late_s * (1.0 / 3.0))),
            late_s: valve_s,
            lead_closes: tuning.length_gain * tuning.length_lead_s / tuning.length_loop_s,
            sticks: STICKS * tuning.contraction_dead_zone,
            learns_n_m: tuning.load_gain_n_m_s * period_s,
            shrinks_n_m: SHRINKS * tuning.load_gain_n_m_s * period_s,
            fastest: tuning.contraction_rate_per_s * period_s,
            pace: Pace::new(period_steps, config.step_s),
            turn_waits: limit(HYSTERESIS * tuning.contraction_dead_zone, 0.0, WAITS),
            law: Law::new(&config.hysteresis, period_s),
        }
    }

    /// Share of the lead for a load on its gas spring \[-\]. Above that frequency the lead drives the swing, by up to
    /// the force of its gas for an amplitude of `swing_m`: as much of the lead is kept as friction absorbs, 4/pi of the
    /// Coulomb force. All of it is kept without a mass, which is then not configured.
    fn lead(&self, spring: &GasSpring, swing_m: f32, coulomb_n: f32) -> f32 {
        let late = 1.0 - self.damped_per_s2 * spring.inverse_s2;
        if spring.inverse_s2 <= 0.0 || late <= 0.0 {
            return 1.0;
        }
        let pushes_n = spring.gas_n_m * self.lead_closes * late * swing_m;
        let takes_n = FOUR_PER_PI * coulomb_n;
        if takes_n < pushes_n { takes_n / pushes_n } else { 1.0 }
    }
}

/// The load behind shut valves.
struct GasSpring {
    /// Stiffness of the gas, k P A^2/V \[N/m\].
    gas_n_m: f32,
    /// Mass over the stiffness of gas, braid and bladder, the inverse square of its frequency \[s2\]; 0 without a mass.
    inverse_s2: f32,
}

impl GasSpring {
    fn new(
        config: &Config,
        chamber: &impl Chamber,
        feedback: &Feedback,
        port: &ChamberPort,
        slope_m2: f32,
        mass_kg: f32,
    ) -> Self {
        let Feedback { pressure_pa, length_m, .. } = *feedback;
        let gas_n_m =
            config.gas.heat_capacity_ratio * pressure_pa * slope_m2 * slope_m2 / port.volume_m3;
        let gauge_pa = pressure_pa - config.ambient.pressure_pa;
        let stiffness_n_m = gas_n_m + chamber.stiffness_n_m(gauge_pa, length_m);
        Self { gas_n_m, inverse_s2: mass_kg / stiffness_n_m }
    }

    /// Pole of a step that the load can follow, no faster than `fastest`.
    fn pole(&self, fastest: &Pole, period_s: f32) -> Pole {
        let rad_s = FASTEST * rough_inverse_sqrt(self.inverse_s2);
        if rad_s > 0.0 && rad_s * period_s < fastest.rad {
            Pole::new(rad_s, period_s)
        } else {
            *fastest
        }
    }
}

/// A second-order reference, critically damped.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Reference {
    length_m: f32,
    speed_m_s: f32,
    acceleration_m_s2: f32,
    /// Remaining phase of a step \[rad\].
    step_rad: f32,
}

impl Reference {
    fn at(length_m: f32) -> Self {
        Self { length_m, speed_m_s: 0.0, acceleration_m_s2: 0.0, step_rad: 0.0 }
    }

    /// Length of the reference after `time_s` \[m\].
    fn after_m(&self, time_s: f32) -> f32 {
        self.length_m + time_s * (self.speed_m_s + 0.5 * time_s * self.acceleration_m_s2)
    }

    /// Moves the reference by one period towards a length. A target no faster than the rate limit is followed without
    /// lag, to its place at the period's end; a faster one is a step, and is followed no faster than the load on its
    /// spring.
    fn advance(
        &mut self,
        tuning: &ControllerConfig,
        (follows, spring): (&Pole, &GasSpring),
        chamber: &impl Chamber,
        target: &Target,
        port: &ChamberPort,
    ) {
        let period_s = port.period_s;
        let rest_m = chamber.rest_length_m();
        let fastest_m_s = tuning.contraction_rate_per_s * rest_m;
        if target.steps {
            self.step_rad = STEP_RAD;
        }
        let steps = self.step_rad > 0.0;
        let pole = if steps { spring.pole(follows, period_s) } else { *follows };
        let error_m = target.value + target.change - self.length_m;
        let target_m_s = target.change * port.pwm_hz;
        let wanted_m_s = pole.keeps * self.speed_m_s
            + pole.per_error * error_m
            + pole.per_target_speed * target_m_s;
        if steps && absolute(wanted_m_s) < fastest_m_s {
            self.step_rad -= pole.rad;
        }
        let wanted_m_s = limit(wanted_m_s, -fastest_m_s, fastest_m_s);
        let most_m_s = tuning.contraction_acceleration_per_s2 * rest_m * period_s;
        // Only gaining speed is limited, not braking: the reference must not run past its target.
        let gaining = absolute(wanted_m_s) > absolute(self.speed_m_s);
        let speed_m_s = if gaining {
            limit(wanted_m_s, self.speed_m_s - most_m_s, self.speed_m_s + most_m_s)
        } else {
            wanted_m_s
        };
        self.acceleration_m_s2 = (speed_m_s - self.speed_m_s) * port.pwm_hz;
        self.speed_m_s = speed_m_s;
        self.length_m += speed_m_s * period_s;
    }
}

/// State of the muscle when the gas of a period has arrived.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Arrival {
    length_m: f32,
    volume_m3: f32,
    pressure_pa: f32,
}

impl Arrival {
    fn new(chamber: &impl Chamber, length_m: f32, pressure_pa: f32) -> Self {
        Self { length_m, volume_m3: chamber.volume_m3(length_m), pressure_pa }
    }
}

/// State of the contraction loop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContractionLoop {
    gains: Gains,
    /// Requested length \[m\].
    course: Course,
    reference: Reference,
    arrival: Arrival,
    /// Pressure \[Pa\] and volume \[m3\] for which gas has been moved so far.
    given_pa: f32,
    given_m3: f32,
    /// Mass of a pulse that ended within the last period, or 0 \[kg\].
    pulsed_kg: f32,
    /// Friction that the reference must overcome, positive in contraction \[N\].
    friction_n: f32,
    /// Slip and creep along the reference.
    held: Held,
    observer: LoadObserver,
    /// Integral of the length error \[N\].
    effort_n: f32,
    /// Measured length in the period before \[m\].
    length_m: f32,
    calm_periods: u8,
    holding: bool,
    limited: bool,
}

/// Goal of the loop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contracting {
    /// Contraction, share of the rest length \[-\].
    pub contraction: f32,
    /// Steps since the goal changed.
    pub age_steps: u16,
    /// Configured load \[N\].
    pub load_n: f32,
    /// Factor of the estimated wall temperature on friction \[-\].
    pub softening: f32,
    /// Highest permitted pressure \[Pa\].
    pub most_pa: f32,
}

impl ContractionLoop {
    /// Creates a loop that starts at the measured length and pressure: nothing jumps.
    pub fn new(
        config: &Config,
        gains: &Gains,
        chamber: &impl Chamber,
        feedback: &Feedback,
        load_n: f32,
        softening: f32,
    ) -> Self {
        let mut fresh = Self {
            gains: *gains,
            course: Course::at(feedback.length_m, &gains.pace),
            reference: Reference::at(feedback.length_m),
            arrival: Arrival::new(chamber, feedback.length_m, feedback.pressure_pa),
            given_pa: feedback.pressure_pa,
            given_m3: 0.0,
            pulsed_kg: 0.0,
            friction_n: 0.0,
            held: Held::default(),
            observer: LoadObserver::default(),
            effort_n: 0.0,
            length_m: feedback.length_m,
            calm_periods: 0,
            holding: false,
            limited: false,
        };
        fresh.take_over(config, chamber, feedback, load_n, softening);
        fresh
    }

    /// Whether the load at the goal needs more pressure than permitted.
    pub fn limited(&self) -> bool {
        self.limited
    }

    /// Whether the muscle is at its goal and the valves rest.
    pub fn holding(&self) -> bool {
        self.holding
    }

    /// Length of the reference \[m\].
    pub fn reference_m(&self) -> f32 {
        self.reference.length_m
    }

    /// Takes the measured force as the reference's: friction explains as much of it as it can, the disturbance the
    /// rest. A load on its stop gives no information.
    fn take_over(
        &mut self,
        config: &Config,
        chamber: &impl Chamber,
        feedback: &Feedback,
        force_n: f32,
        softening: f32,
    ) {
        let most_n = self.observer.coulomb_n(configured_coulomb_n(config, softening));
        let pull_n = pull_n(config, chamber, feedback);
        let mut disturbance_n = self.observer.disturbance_n;
        let holds_n = pull_n - force_n - self.held.force_n() - self.effort_n - disturbance_n;
        self.friction_n = limit(holds_n, -most_n, most_n);
        if is_free(chamber, feedback.length_m) {
            let [least_n, most_n] = disturbances_n(config, chamber, force_n + self.held.force_n());
            disturbance_n = limit(disturbance_n + holds_n - self.friction_n, least_n, most_n);
        }
        self.observer.restart(disturbance_n);
        self.arrival.pressure_pa = feedback.pressure_pa;
        self.given_pa = feedback.pressure_pa;
        self.given_m3 = self.arrival.volume_m3;
    }

    /// Mass to move in the coming period \[kg\], positive into the muscle, and the open valve's flow; `None` if the
    /// valves rest.
    pub fn period(
        &mut self,
        config: &Config,
        chamber: &impl Chamber,
        feedback: &Feedback,
        port: &ChamberPort,
        wanted: &Contracting,
    ) -> Option<(f32, OpenFlow)> {
        let Contracting { contraction, age_steps, load_n, softening, .. } = *wanted;
        let rest_m = chamber.rest_length_m();
        let target_m = chamber.limit_length_m(rest_m - rest_m * contraction);
        let fastest_m = self.gains.fastest * rest_m;
        let target = self.course.advance::<false>(&self.gains.pace, target_m, age_steps, fastest_m);
        // Positive: the muscle must contract.
        let error_m = feedback.length_m - self.reference.length_m;
        let zone_m = config.controller.contraction_dead_zone * rest_m;
        let moved_m = feedback.length_m - self.length_m;
        self.length_m = feedback.length_m;
        if feedback.length_lost {
            // Only pressure is followed. A frozen reading may have taught the loop anything before it was found.
            self.holding = false;
            self.effort_n = 0.0;
            self.observer = LoadObserver::default();
        }
        if self.holding {
            // Creep goes on at rest.
            self.creep(config, feedback, 0.0, softening);
            if !target.moves && absolute(error_m) <= HYSTERESIS * zone_m {
                return None;
            }
            self.holding = false;
            self.take_over(config, chamber, feedback, load_n, softening);
        }
        let still = !target.moves
            && !feedback.length_lost
            && absolute(target_m - self.reference.length_m) <= zone_m
            && absolute(error_m) <= zone_m
            && absolute(moved_m) <= zone_m;
        self.calm_periods = if still { self.calm_periods.saturating_add(1) } else { 0 };
        if self.calm_periods >= CALM_PERIODS {
            self.holding = true;
            self.pulsed_kg = 0.0;
            self.reference = Reference::at(target_m);
            self.arrival = Arrival::new(chamber, target_m, self.arrival.pressure_pa);
            return None;
        }

        // Distance ahead of the reference when the pulse acts: it damps the load on its gas spring.
        let slope_m2 = chamber.volume_slope_m2(feedback.length_m);
        let configured_kg = config.moving_mass_kg;
        let mass_kg = if configured_kg > 0.0 { configured_kg + self.observer.mass_kg } else { 0.0 };
        let spring = GasSpring::new(config, chamber, feedback, port, slope_m2, mass_kg);
        let coulomb_n = self.observer.coulomb_n(configured_coulomb_n(config, softening));
        let lead = self.gains.lead(&spring, SWING * rest_m, coulomb_n);
        let lead_s = config.controller.length_lead_s * lead;
        let ahead_m = (moved_m * port.pwm_hz - self.reference.speed_m_s) * lead_s;
        // Volume and pressure missing from those for which gas has been moved so far.
        let missing_m3 = self.given_m3 - port.volume_m3 - slope_m2 * ahead_m;
        let missing_m3 = missing_m3 * config.controller.length_gain;
        let missing_pa = self.given_pa - feedback.pressure_pa;

        if !feedback.length_lost {
            self.learn(config, chamber, feedback, port, wanted, (error_m, moved_m));
        }
        let start_m3 = self.arrival.volume_m3;
        self.advance(config, chamber, feedback, port, wanted, (&target, &spring));
        let given = self.gains.closes;
        let change_pa = self.arrival.pressure_pa - self.given_pa + given * missing_pa;
        let change_m3 = self.arrival.volume_m3 - self.given_m3 + given * missing_m3;
        let wanted_kg = port.mass_kg(change_pa, change_m3) + port.leaked_kg - port.in_flight_kg;
        let open = OpenFlow::new(config, wanted_kg, feedback.muscle());
        let open_kg = port.period_s * open.kg_s;
        let per_rest_kg = absolute(port.mass_kg(0.0, slope_m2 * rest_m));
        let ahead_m3 = self.arrival.volume_m3 - start_m3;
        Some((self.spare(port, wanted_kg, open_kg, per_rest_kg, ahead_m3), open))
    }

    /// Runs one period of the observer and of the integral, for the error \[m\] and the way since the period before
    /// \[m\].
    fn learn(
        &mut self,
        config: &Config,
        chamber: &impl Chamber,
        feedback: &Feedback,
        port: &ChamberPort,
        wanted: &Contracting,
        (error_m, moved_m): (f32, f32),
    ) {
        let Contracting { load_n, softening, most_pa, .. } = *wanted;
        if is_free(chamber, feedback.length_m) {
            let coulomb_n = configured_coulomb_n(config, softening);
            let load_n = load_n + self.held.force_n();
            let balance = Balance {
                force_n: pull_n(config, chamber, feedback),
                load_n,
                friction_n: self.friction_n,
                coulomb_n: self.observer.coulomb_n(coulomb_n),
                reference_m_s: -self.reference.speed_m_s,
                speed_m_s: -moved_m * port.pwm_hz,
                mass_kg: config.moving_mass_kg,
                pwm_hz: port.pwm_hz,
            };
            self.observer.period(&balance, disturbances_n(config, chamber, load_n));
        }
        // Anti-windup: nothing is learnt while a valve is fully open, at the limits of pressure, or from large errors.
        let ends = if error_m > 0.0 {
            self.arrival.pressure_pa >= most_pa
        } else {
            self.arrival.pressure_pa <= config.ambient.pressure_pa
        };
        if !port.saturated && !ends {
            let tuning = &config.controller;
            let rest_m = chamber.rest_length_m();
            let most_m = tuning.learning_band * rest_m;
            let shrinks =
                self.effort_n * error_m < 0.0 && absolute(moved_m) <= self.gains.sticks * rest_m;
            let gain_n_m = if shrinks { self.gains.shrinks_n_m } else { self.gains.learns_n_m };
            let learns_n = gain_n_m * limit(error_m, -most_m, most_m);
            let most_n = tuning.load_limit_n;
            self.effort_n = limit(self.effort_n + learns_n, -most_n, most_n);
        }
    }

    /// Moves the reference by one period towards a length, with the load on its spring and the forces that hold it
    /// back.
    fn advance(
        &mut self,
        config: &Config,
        chamber: &impl Chamber,
        feedback: &Feedback,
        port: &ChamberPort,
        wanted: &Contracting,
        (target, spring): (&Target, &GasSpring),
    ) {
        let Contracting { load_n, softening, most_pa, .. } = *wanted;
        let (before, arrival) = (self.reference, self.arrival);
        let (friction_n, held) = (self.friction_n, self.held);
        let poles = (&self.gains.follows, spring);
        self.reference.advance(&config.controller, poles, chamber, target, port);
        let reference = self.reference;
        let length_m = chamber.limit_length_m(reference.after_m(self.gains.late_s));
        let way_m = arrival.length_m - length_m;
        let way_n = config.friction.presliding_stiffness_n_m * way_m;
        let coulomb_n = self.observer.coulomb_n(configured_coulomb_n(config, softening));
        self.friction_n = slide(self.friction_n, way_n, coulomb_n);
        self.creep(config, feedback, way_m, softening);
        let held_n = load_n + self.observer.disturbance_n + self.held.force_n() + self.effort_n;
        let wanted_n = held_n + self.friction_n
            - softening * config.friction.viscous_n_s_m * reference.speed_m_s
            - (config.moving_mass_kg + self.observer.mass_kg) * reference.acceleration_m_s2;
        let ambient_pa = config.ambient.pressure_pa;
        let gauge_pa = chamber.gauge_pressure_for_force_pa(wanted_n, length_m);
        self.limited = ambient_pa + gauge_pa > most_pa;
        let pressure_pa = limit(ambient_pa + gauge_pa, ambient_pa, most_pa);
        self.arrival = Arrival::new(chamber, length_m, pressure_pa);
        if self.limited && feedback.length_lost {
            // Only pressure shows where the muscle is: the reference goes no further than the pressure may.
            self.reference = Reference { speed_m_s: 0.0, acceleration_m_s2: 0.0, ..before };
            (self.friction_n, self.held) = (friction_n, held);
            self.arrival = Arrival { pressure_pa, ..arrival };
        }
    }

    /// Updates slip and creep after a period in which the reference contracted by `way_m`.
    fn creep(&mut self, config: &Config, feedback: &Feedback, way_m: f32, softening: f32) {
        let gauge_pa = feedback.pressure_pa - config.ambient.pressure_pa;
        self.held = self.gains.law.after(&self.held, way_m, gauge_pa, softening);
    }

    /// Returns the part of the requested mass to move now; none if it waits. `open_kg` is the mass of an open period,
    /// `per_rest_kg` the gas for a way of the rest length, `ahead_m3` the volume by which the reference grew in this
    /// period.
    fn spare(
        &mut self,
        port: &ChamberPort,
        wanted_kg: f32,
        open_kg: f32,
        per_rest_kg: f32,
        ahead_m3: f32,
    ) -> f32 {
        let size_kg = absolute(wanted_kg);
        let fits = size_kg < FITS * open_kg;
        let turns = (wanted_kg > 0.0) != (self.pulsed_kg > 0.0);
        let waits = if turns { self.gains.turn_waits } else { WAITS };
        if self.pulsed_kg != 0.0 && fits && size_kg < waits * per_rest_kg {
            self.pulsed_kg = 0.0;
            return 0.0;
        }
        self.given_pa = self.arrival.pressure_pa;
        self.given_m3 = self.arrival.volume_m3;
        let left_kg = open_kg - size_kg;
        let ends = left_kg > 0.0;
        if ends && !fits && left_kg < EARLY * per_rest_kg {
            self.pulsed_kg = 0.0;
            return if wanted_kg > 0.0 { open_kg } else { -open_kg };
        }
        self.pulsed_kg = if ends { wanted_kg } else { 0.0 };
        if !fits {
            return wanted_kg;
        }
        self.given_m3 += ahead_m3;
        wanted_kg + port.mass_kg(0.0, ahead_m3)
    }
}

/// Pull of the chamber at measured pressure and length \[N\].
fn pull_n(config: &Config, chamber: &impl Chamber, feedback: &Feedback) -> f32 {
    chamber.force_n(feedback.pressure_pa - config.ambient.pressure_pa, feedback.length_m)
}

/// Whether the load lies on neither stop: on a stop it is not what the muscle pulls.
fn is_free(chamber: &impl Chamber, length_m: f32) -> bool {
    length_m > chamber.shortest_m() + STOP_M && length_m < chamber.longest_m() - STOP_M
}

/// Configured Coulomb force at the wall's temperature \[N\].
fn configured_coulomb_n(config: &Config, softening: f32) -> f32 {
    config.controller.friction_gain * softening * config.friction.force_n
}

/// Smallest and largest disturbance \[N\]: together with the believed load, slip and creep, no less than the chamber
/// can hold. A muscle cannot push, so no load is lifted for it.
fn disturbances_n(config: &Config, chamber: &impl Chamber, believed_n: f32) -> [f32; 2] {
    let most_n = config.controller.load_limit_n;
    [limit(chamber.least_force_n() - believed_n, -most_n, 0.0), most_n]
}

/// Friction after a way, `way_n` being its stiffness times the way: it builds up along the way like the bristles of
/// LuGre (Canudas de Wit et al. 1995), f' = k (1 - f/F sgn x'), backward Euler.
fn slide(friction_n: f32, way_n: f32, coulomb_n: f32) -> f32 {
    let most_n = coulomb_n + absolute(way_n);
    if most_n > 0.0 { (friction_n + way_n) * coulomb_n / most_n } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::physics::chamber::{AnyChamber, ChamberConfig, Cylinder};
    use crate::physics::hysteresis::Hysteresis;
    use crate::sample::Estimate;

    const LENGTH_M: f32 = 0.27;
    const PERIOD_S: f32 = 0.01;
    const LOAD_N: f32 = 100.0;
    const AMBIENT_PA: f32 = 101_325.0;

    /// A muscle that neither slips nor creeps.
    fn plain() -> Config {
        Config { hysteresis: Hysteresis::NONE, ..Config::default() }
    }

    /// A muscle behind valves so narrow that no pulse can be spared.
    fn narrow() -> Config {
        let mut config = plain();
        config.valve.conductance_m3_s_pa = 1.0e-12;
        config
    }

    fn muscle() -> AnyChamber {
        AnyChamber::new(&plain().chamber)
    }

    fn feedback(pressure_pa: f32, length_m: f32) -> Feedback {
        Feedback {
            pressure_pa,
            length_m,
            length_wide_m: 0.0,
            length_lost: false,
            estimate: Estimate::default(),
        }
    }

    fn port(feedback: &Feedback) -> ChamberPort {
        ChamberPort::of_air(feedback.pressure_pa, muscle().volume_m3(feedback.length_m))
    }

    /// Absolute pressure at which the muscle pulls with this force at [`LENGTH_M`].
    fn pressure_pa(force_n: f32) -> f32 {
        AMBIENT_PA + muscle().gauge_pressure_for_force_pa(force_n, LENGTH_M)
    }

    fn started(config: &Config, feedback: &Feedback) -> ContractionLoop {
        let gains = Gains::new(config, 10);
        ContractionLoop::new(config, &gains, &muscle(), feedback, LOAD_N, 1.0)
    }

    fn wanted(length_m: f32) -> Contracting {
        let contraction = (0.3 - length_m) / 0.3;
        Contracting { contraction, age_steps: 0, load_n: LOAD_N, softening: 1.0, most_pa: 6.6e5 }
    }

    /// Nor does it learn anything: the reference takes the place of the length.
    #[test]
    fn without_a_length_the_reference_goes_no_further_than_pressure() {
        let config = plain();
        let start_pa = pressure_pa(LOAD_N);
        let mut contracting = started(&config, &feedback(start_pa, LENGTH_M));
        let beyond = Contracting { most_pa: start_pa + 3.0e4, ..wanted(0.2) };
        for _ in 0..300 {
            let reference_m = contracting.reference_m();
            let lost = Feedback { length_lost: true, ..feedback(start_pa, reference_m) };
            contracting.period(&config, &muscle(), &lost, &port(&lost), &beyond);
        }
        let gauge_pa = muscle().gauge_pressure_for_force_pa(LOAD_N, contracting.reference_m());
        let below_pa = beyond.most_pa - AMBIENT_PA - gauge_pa;
        assert!(contracting.limited() && !contracting.holding());
        assert!((0.0..2.5e4).contains(&below_pa), "{below_pa} Pa");
        assert!(contracting.reference_m() < LENGTH_M - 1.0e-3);
        assert_eq!(contracting.effort_n, 0.0);
    }

    /// A reference at rest at 0.25 m, and its following values for these targets.
    fn references(targets_m: impl Iterator<Item = f32>) -> Vec<Reference> {
        let config = plain();
        let gains = Gains::new(&config, 10);
        let mut course = Course::at(0.25, &gains.pace);
        let mut reference = Reference::at(0.25);
        let port = port(&feedback(3.0e5, 0.25));
        let fastest_m = gains.fastest * muscle().rest_length_m();
        targets_m
            .map(|target_m| {
                let poles = (&gains.follows, &GasSpring { gas_n_m: 1.0e4, inverse_s2: 0.0 });
                let target = course.advance::<false>(&gains.pace, target_m, 0, fastest_m);
                reference.advance(&config.controller, poles, &muscle(), &target, &port);
                reference
            })
            .collect()
    }

    /// Both poles of backward Euler lie at r = 1/(1 + w T): the error is (1 + n (1 - r)) r^n of the step.
    #[test]
    fn a_small_step_is_followed_critically_damped() {
        let r = 1.0 / (1.0 + 90.0 * PERIOD_S);
        for step_m in [-3.0e-3_f32, 3.0e-3] {
            for (n, reference) in (1..).zip(references([0.25 + step_m; 20].into_iter())) {
                let error = (0.25 + step_m - reference.length_m) / step_m;
                let expected = (1.0 + n as f32 * (1.0 - r)) * r.powi(n);
                assert!((error - expected).abs() < 1e-3, "{error} after {n} periods");
            }
        }
    }

    /// A set point slower than the rate limit is led to its value at the end of the period.
    #[test]
    fn a_ramp_is_followed_without_lag() {
        for speed_m_s in [-0.1_f32, 0.1] {
            let target_m = |period: u16| 0.25 + speed_m_s * PERIOD_S * f32::from(period);
            let references = references((1..=40).map(target_m));
            let last = references.last().unwrap();
            assert!((last.length_m - target_m(41)).abs() < 1e-5, "{} m", last.length_m);
            assert!((last.speed_m_s - speed_m_s).abs() < 1e-4);
            assert!(last.acceleration_m_s2.abs() < 1e-2);
        }
    }

    /// The lead ends where its force is a quarter of a turn behind the speed. Beyond, it is as much as friction
    /// absorbs: 4/pi of 15 N against 10 kN/m of gas, 10/14 of it led, half of that pushing, over 3 mm; without a mass
    /// it is whole.
    #[test]
    fn a_lead_that_comes_too_late_to_damp_is_left_to_friction() {
        let config = plain();
        let gains = Gains::new(&config, 10);
        let late_s = PERIOD_S + config.valve_kind.late_s(&config.valve);
        let swing = gains.damped_per_s2.sqrt();
        let behind = swing * late_s + (swing * config.controller.length_loop_s).atan();
        assert!((behind / core::f32::consts::FRAC_PI_2 - 1.0).abs() < 0.01, "{behind} rad");
        let lead = |share: f32, mass_kg: f32| {
            let inverse_s2 = mass_kg / (share * gains.damped_per_s2 * 2.0);
            gains.lead(&GasSpring { gas_n_m: 1.0e4, inverse_s2 }, 3.0e-3, 15.0)
        };
        assert_eq!([lead(1.0, 2.0), lead(100.0, 0.0)], [1.0; 2]);
        let half = 19.1 / (1.0e4 * 10.0 / 14.0 * 0.5 * 3.0e-3);
        assert!((lead(2.0, 2.0) - limit(half, 0.0, 1.0)).abs() < 1e-2);
        assert!(lead(50.0, 2.0) < 0.95, "{}", lead(50.0, 2.0));
    }

    /// 20 kg on 12 kN/m swing at 24.5 rad/s: the pole is at seven tenths of that, no higher than configured, and at the
    /// configured value without a mass.
    #[test]
    fn a_step_of_a_heavy_load_is_slower() {
        let rad_s = |mass_kg: f32, most_rad_s: f32| {
            let spring = GasSpring { gas_n_m: 1.0e4, inverse_s2: mass_kg / 1.2e4 };
            spring.pole(&Pole::new(most_rad_s, PERIOD_S), PERIOD_S).rad / PERIOD_S
        };
        assert!((rad_s(20.0, 90.0) / (0.7 * 24.495) - 1.0).abs() < 0.05);
        for (mass_kg, most_rad_s) in [(20.0, 10.0), (0.0, 90.0), (0.1, 90.0)] {
            assert!((rad_s(mass_kg, most_rad_s) / most_rad_s - 1.0).abs() < 1e-6);
        }
        // A third of a step is left after 2.2/w, a sixtieth after 6.2/w. A set point that then moves is followed at
        // once.
        let spring = GasSpring { gas_n_m: 1.0e4, inverse_s2: 20.0 / 1.2e4 };
        let config = plain();
        let (gains, port) = (Gains::new(&config, 10), port(&feedback(3.0e5, 0.25)));
        let mut course = Course::at(0.25, &gains.pace);
        let mut reference = Reference::at(0.25);
        let fastest_m = gains.fastest * muscle().rest_length_m();
        let mut advance = |target_m: f32| {
            let poles = (&gains.follows, &spring);
            let target = course.advance::<false>(&gains.pace, target_m, 0, fastest_m);
            reference.advance(&config.controller, poles, &muscle(), &target, &port);
            reference
        };
        let left = |reference: Reference| (reference.length_m - 0.24) / 0.01;
        let after: Vec<f32> = (0..70).map(|_| left(advance(0.24))).collect();
        assert!(
            (0.2..0.45).contains(&after[12]) && (0.005..0.03).contains(&after[35]),
            "{after:?}"
        );
        assert!(after[69].abs() < 1e-3);
        let moving = advance(0.2395);
        assert!((moving.length_m - 0.2395).abs() < 6e-4 && moving.step_rad <= 0.0, "{moving:?}");
    }

    /// 30/s2 and 0.7/s of 0.3 m: at most 9 m/s2 while it gains speed, at most 0.21 m/s, and not past its target.
    #[test]
    fn a_large_step_is_followed_at_the_limits_of_speed_and_acceleration() {
        for step_m in [-0.05_f32, 0.05] {
            let references = references([0.25 + step_m; 60].into_iter());
            let sign = step_m.signum();
            for (reference, (speed_m_s, acceleration_m_s2)) in
                references.iter().zip([(0.09, 9.0), (0.18, 9.0), (0.21, 3.0), (0.21, 0.0)])
            {
                assert!((sign * reference.speed_m_s - speed_m_s).abs() < 1e-4);
                assert!((sign * reference.acceleration_m_s2 - acceleration_m_s2).abs() < 1e-2);
            }
            let past_m = |reference: &Reference| sign * (reference.length_m - 0.25 - step_m);
            assert!(references.iter().all(|reference| past_m(reference) < 1e-5));
            assert!(past_m(references.last().unwrap()).abs() < 1e-5);
        }
    }

    /// Each way of a tenth of F/k leaves 1/1.1 of the difference between friction and the Coulomb force.
    #[test]
    fn friction_builds_up_along_the_way() {
        for way_n in [-1.5, 1.5_f32] {
            let mut friction_n = 0.0;
            for n in 1..60 {
                friction_n = slide(friction_n, way_n, 15.0);
                let expected_n = way_n.signum() * 15.0 * (1.0 - 1.1_f32.powi(-n));
                assert!((friction_n - expected_n).abs() < 1e-3, "{friction_n} N, {expected_n} N");
            }
            let turned_n = slide(friction_n, -way_n, 15.0);
            assert!((turned_n / friction_n - 0.9 / 1.1).abs() < 1e-2, "{turned_n} N after a turn");
        }
        assert_eq!([slide(0.0, 0.0, 0.0), slide(5.0, 1.0, 0.0)], [0.0; 2], "no friction at all");
    }

    /// Friction of 1.03 times 15 N explains the part of a measured force that the load does not; a learnt load, up to
    /// its limit, explains the rest. On the stop the load is unknown.
    #[test]
    fn a_start_takes_the_measured_force_for_the_one_wanted() {
        let mut config = plain();
        config.controller.load_limit_n = 30.0;
        for (force_n, friction_n, disturbance_n) in [
            (100.0, 0.0, 0.0),
            (110.0, 10.0, 0.0),
            (90.0, -10.0, 0.0),
            (140.0, 15.45, 24.55),
            (60.0, -15.45, -24.55),
            (200.0, 15.45, 30.0),
            (20.0, -15.45, -30.0),
        ] {
            let now = feedback(pressure_pa(force_n), LENGTH_M);
            let active = started(&config, &now);
            assert!((active.friction_n - friction_n).abs() < 0.05, "{force_n} N: {active:?}");
            assert!(
                (active.observer.disturbance_n - disturbance_n).abs() < 0.05,
                "{force_n} N: {active:?}"
            );
            assert_eq!(active.arrival.pressure_pa, now.pressure_pa);
        }
        let gains = Gains::new(&config, 10);
        let now = feedback(pressure_pa(140.0), LENGTH_M);
        let warm = ContractionLoop::new(&config, &gains, &muscle(), &now, LOAD_N, 0.5);
        assert!((warm.friction_n - 0.5 * 15.45).abs() < 0.05, "softened: {warm:?}");
        for (length_m, learns) in [(0.3, false), (0.2998, false), (0.2996, true)] {
            let active = started(&config, &feedback(AMBIENT_PA + 2.0e5, length_m));
            assert_eq!(active.observer.disturbance_n > 0.0, learns, "at {length_m} m");
        }
    }

    /// Mass \[kg\] for a change of pressure and of volume, eq. (6) in f64.
    fn mass_kg(now: &Feedback, change_pa: f32, change_m3: f32) -> f64 {
        let [volume_m3, change_pa, change_m3, pressure_pa] =
            [muscle().volume_m3(now.length_m), change_pa, change_m3, now.pressure_pa]
                .map(f64::from);
        (volume_m3 * change_pa / 1.4 + pressure_pa * change_m3) / (287.05 * 298.0)
    }

    fn close(kg: f32, expected_kg: f64) {
        let off_kg = f64::from(kg) - expected_kg;
        assert!(off_kg.abs() < 5e-3 * expected_kg.abs() + 2e-9, "{kg} kg, expected {expected_kg}");
    }

    /// On a muscle that follows at once, behind valves without delay: each period moves the mass by which the next
    /// state differs, until the muscle is at its goal and pulls its load and friction.
    #[test]
    fn the_gas_of_the_reference_is_what_is_moved() {
        let mut config = narrow();
        (config.valve.dead_time_s, config.valve.switch_time_s) = (0.0, 0.0);
        for (goal_m, friction_n) in [(0.25, 15.45), (0.28, -15.45)] {
            let mut now = feedback(pressure_pa(LOAD_N), LENGTH_M);
            let mut active = started(&config, &now);
            for _ in 0..60 {
                let asked = active.period(&config, &muscle(), &now, &port(&now), &wanted(goal_m));
                let Some((kg, _)) = asked else { break };
                let change_m3 = active.arrival.volume_m3 - muscle().volume_m3(now.length_m);
                // It leads the measurement where the speed changes: damping.
                let change_pa = active.arrival.pressure_pa - now.pressure_pa;
                if active.reference.acceleration_m_s2.abs() < 1e-3 {
                    close(kg, mass_kg(&now, change_pa, change_m3));
                }
                now = feedback(active.arrival.pressure_pa, active.arrival.length_m);
            }
            assert!(active.holding(), "{active:?}");
            assert!((now.length_m - goal_m).abs() < 5e-4, "{} m", now.length_m);
            let force_n = muscle().force_n(now.pressure_pa - AMBIENT_PA, now.length_m);
            assert!((force_n - LOAD_N - friction_n).abs() < 1.5, "{force_n} N");
        }
    }

    /// Pressure and length that are off at rest: 10 of 14 ms of the missing gas, for the length 10 ms later, counted as
    /// seven tenths, less the mass that the last pulse still moves.
    #[test]
    fn missing_gas_is_closed_by_its_share() {
        let mut config = narrow();
        config.controller.load_gain_n_m_s = 0.0;
        config.controller.load_limit_n = 0.0;
        config.controller.length_gain = 0.7;
        let balance = feedback(pressure_pa(LOAD_N), LENGTH_M);
        let gain = 0.01 / 0.014_f32;
        for (off_pa, off_m, in_flight_kg) in [
            (1.0e4, 0.0, 0.0),
            (-1.0e4, 0.0, 0.0),
            (0.0, 4.0e-4, 0.0),
            (0.0, -4.0e-4, 0.0),
            (-1.0e4, 0.0, 3.0e-6),
        ] {
            let mut active = started(&config, &balance);
            let now = feedback(balance.pressure_pa + off_pa, LENGTH_M + off_m);
            let port = ChamberPort { in_flight_kg, ..port(&now) };
            let asked = active.period(&config, &muscle(), &now, &port, &wanted(LENGTH_M));
            let (kg, _) = asked.unwrap();
            let missing_m3 = 0.7 * 2.0 * (muscle().volume_m3(LENGTH_M) - port.volume_m3);
            let expected_kg = mass_kg(&now, -gain * off_pa, gain * missing_m3);
            let off_kg = f64::from(kg + in_flight_kg) - expected_kg;
            assert!(off_kg.abs() < 0.02 * expected_kg.abs(), "{kg} kg, expected {expected_kg}");
        }
    }

    /// 40 kN/(m s) over 10 ms: 0.4 N for a millimetre, of which no more than 0.6 mm count.
    #[test]
    fn an_error_of_length_is_integrated_within_its_limits() {
        let config = plain();
        let learnt_n = |config: &Config, error_m: f32, saturated: bool| {
            let mut active = started(config, &feedback(pressure_pa(LOAD_N), LENGTH_M));
            let now = feedback(pressure_pa(LOAD_N), LENGTH_M + error_m);
            let port = ChamberPort { saturated, ..port(&now) };
            active.period(config, &muscle(), &now, &port, &wanted(LENGTH_M));
            active.effort_n
        };
        for sign in [-1.0, 1.0] {
            for (error_m, expected_n) in [(0.3e-3, 0.12), (0.5e-3, 0.2), (9.0e-3, 0.24)] {
                let effort_n = sign * learnt_n(&config, sign * error_m, false);
                assert!((effort_n - expected_n).abs() < 5e-3, "{error_m} m: {effort_n} N");
                assert_eq!(learnt_n(&config, sign * error_m, true), 0.0, "saturated");
            }
            let mut little = config;
            little.controller.load_limit_n = 0.1;
            let effort_n = sign * learnt_n(&little, sign * 9.0e-3, false);
            assert!((effort_n - 0.1).abs() < 1e-3, "{effort_n} N");
        }
    }

    /// Of 5 N, an error of 0.3 mm removes 0.12 N in 10 ms: six times that if the muscle moves by no more than a third
    /// of the dead zone, 0.06 mm.
    #[test]
    fn the_integral_shrinks_faster_while_the_muscle_sticks() {
        let config = plain();
        for (sign, moved_m, expected_n) in [
            (-1.0, 0.0, 5.0 - 0.72),
            (-1.0, 5.0e-5, 5.0 - 0.72),
            (-1.0, -5.0e-5, 5.0 - 0.72),
            (-1.0, 7.0e-5, 5.0 - 0.12),
            (1.0, 0.0, 5.0 + 0.12),
        ] {
            let now = feedback(pressure_pa(LOAD_N), LENGTH_M + sign * 3.0e-4);
            let mut active = started(&config, &feedback(pressure_pa(LOAD_N), LENGTH_M));
            active.effort_n = 5.0;
            active.length_m = now.length_m - moved_m;
            active.period(&config, &muscle(), &now, &port(&now), &wanted(LENGTH_M));
            let effort_n = active.effort_n;
            assert!((effort_n - expected_n).abs() < 2e-3, "{sign}, {moved_m} m: {effort_n} N");
        }
    }

    /// A load that needs more pressure than permitted stays too long, and one that ambient pressure pulls too far stays
    /// too short, for as long as that lasts: an integral of that error would be in the way on the way back.
    #[test]
    fn an_error_that_no_pressure_cures_is_not_integrated() {
        let config = plain();
        for (off_m, load_n, most_pa) in
            [(5.0e-3, LOAD_N, pressure_pa(0.8 * LOAD_N)), (-5.0e-3, -100.0, 6.6e5)]
        {
            let mut active = started(&config, &feedback(pressure_pa(load_n), LENGTH_M));
            let now = feedback(limit(pressure_pa(load_n), AMBIENT_PA, most_pa), LENGTH_M + off_m);
            for _ in 0..100 {
                let goal = Contracting { load_n, most_pa, ..wanted(LENGTH_M) };
                active.period(&config, &muscle(), &now, &port(&now), &goal);
            }
            assert!(active.effort_n.abs() < 1.0, "{} N after {off_m} m", active.effort_n);
        }
    }

    /// Slip and creep along the reference are overcome, and fade at rest.
    #[test]
    fn slip_and_creep_are_held() {
        let config = Config::default();
        let force_n = |active: &ContractionLoop| {
            let gauge_pa = active.arrival.pressure_pa - AMBIENT_PA;
            muscle().force_n(gauge_pa, active.reference.length_m)
        };
        let goal = wanted(0.25);
        let run = |config: &Config| {
            let mut now = feedback(pressure_pa(LOAD_N), LENGTH_M);
            let mut active = started(config, &now);
            for _ in 0..20 {
                active.period(config, &muscle(), &now, &port(&now), &goal);
                now = feedback(active.arrival.pressure_pa, active.arrival.length_m);
            }
            active
        };
        let creeps = run(&config);
        // 6.5 N of slip, and creep from 20 mm at 2.47 kN/m, which has begun to fade, and at 1.5 kN/m.
        let held_n = creeps.held.force_n();
        assert!((55.0..75.0).contains(&held_n), "{held_n} N");
        assert_eq!(run(&plain()).held, Held::default());
        let learnt_n = creeps.observer.disturbance_n + creeps.effort_n;
        let expected_n = LOAD_N + creeps.friction_n + held_n + learnt_n;
        assert!((force_n(&creeps) - expected_n).abs() < 0.5, "{} N", force_n(&creeps));
        let mut rests = creeps;
        for _ in 0..45 {
            rests.creep(&config, &feedback(creeps.arrival.pressure_pa, 0.25), 0.0, 1.0);
        }
        let left = rests.held.fast_n / creeps.held.fast_n;
        assert!((left - (-1.0_f32).exp()).abs() < 1e-3, "{left}");
    }

    /// A pulse that has ended lets a small mass wait, once; a pulse that nearly fills its period is extended to all of
    /// it.
    #[test]
    fn pulses_are_spared() {
        let now = feedback(pressure_pa(LOAD_N), LENGTH_M);
        let mut active = started(&plain(), &now);
        let port = port(&now);
        let mut give = |wanted_kg: f32| 1.0e6 * active.spare(&port, wanted_kg, 3.0e-5, 1.0e-3, 0.0);
        // An open period moves 30 mg; the gas for 0.0043 of the rest length is 4.3 mg.
        let given: [f32; 5] = [2.0e-6, 2.0e-6, -2.0e-6, -4.5e-6, -4.5e-6].map(&mut give);
        let expected = [2.0, 0.0, -2.0, -4.5, -4.5];
        assert!(given.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-3), "{given:?}");
        // A reversal does not wait, beyond the 0.9 mg of one and a half dead zones.
        let given: [f32; 4] = [1.0e-6, -1.0e-6, 0.8e-6, 0.8e-6].map(&mut give);
        let expected = [1.0, -1.0, 0.0, 0.8];
        assert!(given.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-3), "{given:?}");
        let given: [f32; 4] = [28.0e-6, 29.0e-6, -28.5e-6, 31.0e-6].map(&mut give);
        let expected = [28.0, 30.0, -30.0, 31.0];
        assert!(given.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-3), "{given:?}");
    }

    /// A muscle cannot push: the learnt disturbance leaves a load that pulls, or none.
    #[test]
    fn no_load_is_learnt_that_a_slack_muscle_would_have_to_push() {
        let config = plain();
        let least_n = |load_n: f32| disturbances_n(&config, &muscle(), load_n)[0];
        assert_eq!([0.0, 20.0, 100.0, 1.0e3].map(least_n), [0.0, -20.0, -100.0, -300.0]);
        assert_eq!(disturbances_n(&config, &muscle(), 20.0)[1], 300.0);
        let cylinder = AnyChamber::new(&ChamberConfig::Cylinder(Cylinder::default()));
        assert_eq!(disturbances_n(&config, &cylinder, -50.0), [-300.0, 300.0], "it can");
        // From the middle of its way, at ambient pressure, with 5 N to hold.
        let gains = Gains::new(&config, 10);
        let slack = feedback(AMBIENT_PA, 0.24);
        assert!(muscle().force_n(0.0, 0.24) < -30.0);
        let mut active = ContractionLoop::new(&config, &gains, &muscle(), &slack, 5.0, 1.0);
        assert_eq!(active.observer.disturbance_n, -5.0);
        // Believed creep that does not exist must not be overcome.
        active.held.fast_n = 60.0;
        let goal = Contracting { load_n: 5.0, ..wanted(0.23) };
        for _ in 0..10 {
            active.period(&config, &muscle(), &slack, &port(&slack), &goal);
        }
        let most_n = -6.0 - active.held.force_n();
        let learnt_n = active.observer.disturbance_n;
        assert!((most_n..-40.0).contains(&learnt_n), "{learnt_n} N of {most_n} N");
    }

    /// The gas is for the place of a moving reference 2 ms later, half of the stroke plus the dead time.
    #[test]
    fn the_gas_is_for_the_time_at_which_it_arrives() {
        let config = plain();
        assert_eq!(config.valve.dead_time_s + 0.5 * config.valve.switch_time_s, 2.0e-3);
        let mut active = started(&config, &feedback(pressure_pa(LOAD_N), LENGTH_M));
        for period in 0..10_u16 {
            let now = feedback(pressure_pa(LOAD_N), active.reference.length_m);
            let goal_m = LENGTH_M - 5.0e-4 * f32::from(period);
            active.period(&config, &muscle(), &now, &port(&now), &wanted(goal_m));
        }
        let ahead_m = active.arrival.length_m - active.reference.length_m;
        assert!((ahead_m + 2.0e-3 * 0.05).abs() < 5e-6, "{ahead_m} m at 50 mm/s");
    }

    /// Friction against the motion, softened; viscous friction with the speed; the mass with the acceleration: a muscle
    /// that starts to contract must pull more for each.
    #[test]
    fn the_pressure_is_that_of_load_friction_speed_and_acceleration() {
        let mut config = plain();
        config.friction.viscous_n_s_m = 100.0;
        config.moving_mass_kg = 2.0;
        for (goal_m, way) in [(0.22, 1.0), (0.29, -1.0)] {
            let now = feedback(pressure_pa(LOAD_N), LENGTH_M);
            let mut active = started(&config, &now);
            let goal = Contracting { softening: 0.5, ..wanted(goal_m) };
            active.period(&config, &muscle(), &now, &port(&now), &goal);
            let Arrival { length_m, pressure_pa, .. } = active.arrival;
            let force_n = muscle().force_n(pressure_pa - AMBIENT_PA, length_m);
            // 9 m/s2 for 10 ms are 0.09 m/s and 0.9 mm; 0.2 mm in the 2 ms of the valve: 110 N of 100 kN/m.
            let coulomb_n = 0.5 * 1.03 * 15.0;
            let friction_n = 110.0 * coulomb_n / (coulomb_n + 110.0);
            let expected_n = LOAD_N + way * (friction_n + 0.5 * 100.0 * 0.09 + 2.0 * 9.0);
            assert!((force_n - expected_n).abs() < 0.3, "{force_n} N, expected {expected_n} N");
        }
    }

    /// A loop that has come to rest `off_m` from its goal of 0.27 m, at the pressure for `force_n`.
    fn resting(config: &Config, off_m: f32, force_n: f32) -> ContractionLoop {
        let now = feedback(pressure_pa(force_n), LENGTH_M + off_m);
        let mut active = started(config, &now);
        for _ in 0..20 {
            active.period(config, &muscle(), &now, &port(&now), &wanted(LENGTH_M));
        }
        assert!(active.holding());
        active
    }

    /// Whether the loop rests within 30 periods, from 0.27 m on, at these lengths, with these goals.
    fn rests(config: &Config, length_and_goal_m: impl Fn(u16) -> (f32, f32)) -> bool {
        let mut active = started(config, &feedback(pressure_pa(LOAD_N), LENGTH_M));
        (1..30).any(|period| {
            let (length_m, goal_m) = length_and_goal_m(period);
            let now = feedback(pressure_pa(LOAD_N), length_m);
            active.period(config, &muscle(), &now, &port(&now), &wanted(goal_m)).is_none()
        })
    }

    /// Within the dead zone of 0.18 mm, moving by no more than that in a period, and with nothing left to follow.
    #[test]
    fn it_rests_only_where_it_is_to_be() {
        let config = plain();
        for (share, at_rest) in [(0.98, true), (1.02, false)] {
            let zone_m = share * 0.18e-3;
            for side_m in [-zone_m, zone_m] {
                let sticks = rests(&config, |_| (LENGTH_M + side_m, LENGTH_M));
                assert_eq!(sticks, at_rest, "sticks {side_m} m off");
            }
            let swings = |period| (LENGTH_M + zone_m * (f32::from(period % 2) - 0.5), LENGTH_M);
            assert_eq!(rests(&config, swings), at_rest, "swings by {zone_m} m");
        }
        let follows = |period| [LENGTH_M - 1.0e-5 * f32::from(period); 2].into();
        assert!(!rests(&config, follows), "the goal moves");
        let mut slow = config;
        slow.controller.contraction_rate_per_s = 0.01;
        let on_its_way = |period| (LENGTH_M - 3.0e-5 * f32::from(period), 0.26);
        assert!(!rests(&slow, on_its_way), "the goal is far");
    }

    /// A loop at rest stays at rest up to one and a half dead zones of 0.18 mm from its goal, whatever side it came
    /// from.
    #[test]
    fn a_muscle_at_rest_is_as_far_off_as_it_is_from_its_goal() {
        let config = plain();
        for came_from_m in [-1.5e-4, 1.5e-4] {
            for (off_m, rests) in
                [(-0.28e-3, false), (-0.26e-3, true), (0.26e-3, true), (0.28e-3, false)]
            {
                let mut active = resting(&config, came_from_m, LOAD_N);
                let now = feedback(pressure_pa(LOAD_N), LENGTH_M + off_m);
                active.period(&config, &muscle(), &now, &port(&now), &wanted(LENGTH_M));
                assert_eq!(active.holding(), rests, "{off_m} m, from {came_from_m} m");
            }
        }
    }

    /// The gas has cooled during the rest, or the load has changed: the loop continues from the new measurement. Of the
    /// force that the learnt load does not explain, 15.45 N are friction, as at a start.
    #[test]
    fn a_muscle_that_has_rested_goes_on_from_what_is_measured() {
        let config = narrow();
        for (rested_n, now_n, disturbance_n) in [
            (100.0, 60.0, -24.55),
            (100.0, 105.0, 0.0),
            (100.0, 140.0, 24.55),
            (140.0, 140.0, 24.55),
            (140.0, 105.0, 20.45),
            (140.0, 60.0, -24.55),
        ] {
            let mut active = resting(&config, 0.0, rested_n);
            let now = feedback(pressure_pa(now_n), LENGTH_M);
            let asked = active.period(&config, &muscle(), &now, &port(&now), &wanted(0.25));
            assert!(
                (active.observer.disturbance_n - disturbance_n).abs() < 0.05,
                "{rested_n}, {now_n} N: {active:?}"
            );
            let change_m3 = active.arrival.volume_m3 - muscle().volume_m3(LENGTH_M);
            close(
                asked.unwrap().0,
                mass_kg(&now, active.arrival.pressure_pa - now.pressure_pa, change_m3),
            );
        }
    }

    #[test]
    fn what_needs_more_pressure_than_there_may_be_is_limited() {
        let now = feedback(pressure_pa(LOAD_N), LENGTH_M);
        for (off_pa, limited) in [(-2000.0, true), (2000.0, false)] {
            let mut active = started(&plain(), &now);
            let most_pa = now.pressure_pa + off_pa;
            let goal = Contracting { most_pa, ..wanted(LENGTH_M) };
            active.period(&plain(), &muscle(), &now, &port(&now), &goal);
            assert_eq!(active.limited(), limited, "{off_pa} Pa");
            assert!((active.arrival.pressure_pa - now.pressure_pa.min(most_pa)).abs() < 50.0);
        }
    }
}
