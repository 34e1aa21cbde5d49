//! From the set point of a joint to the openings of its four valves, once per PWM period.
//!
//! ```text
//! torque = J q_r'' + viscous q_r' + gravity(q_r) + friction(q_r) + kp e + kd J e' + ki int(e) - share d
//! (torque, K) -> P_a, P_b         closed form, with slip and creep along the reference
//! dm     = (V dP/k + P dV)/(R T)  each muscle: eq. (6), adiabatic, towards pressure and volume of the reference
//! ```
//!
//! q_r is the reference at the time when the gas of the period has arrived: valve, hose and a pulse that waits for the
//! next period delay it. The error e is measured now and predicted for that time, and over the period after it, as a
//! [`swing`](super::swing) on the present gas: its torque acts with that delay, and would otherwise drive the swing of
//! a small arm. Both terms together are limited to the torque that the open valves give in half a radian of the swing:
//! what they cannot follow also comes late.
//!
//! As for a single muscle the loops close on gas mass: at held masses the pair is a spring of the requested stiffness
//! about the reference, without any delay. At rest all four valves are shut, by one decision for both muscles.
//!
//! At rest creep continues for minutes, and the gas takes the temperature of its wall. Both are known, and so is the
//! way by which they will turn the joint. The loop leads the joint so that the set point lies in the middle of that
//! way. The integral acts on the error at rest, which friction holds; in motion the observer covers the unexplained
//! torque.

use super::allocation::{Allocation, Line, allocate, stiffness_n_m_rad, torque_n_m};
use super::config::{JointConfig, JointTuning, Mechanism};
use super::gravity::Gravity;
use super::observer::{Friction, Observer};
use super::pulley::Lever;
use super::reference::{Motion, Reference};
use super::set_point::JointSetPoint;
use super::swing::Swing;
use crate::config::Config;
use crate::control::chamber_port::{ChamberPort, Feedback};
use crate::control::course::{Course, Pace};
use crate::control::valve_drive::{FlowDrive, OpenFlow};
use crate::math::{absolute, limit};
use crate::physics::chamber::{AnyChamber, Chamber};
use crate::physics::hysteresis::{Held, Law};
use crate::sample::{Command, Duty};

/// Periods within the dead zones before the valves rest.
const CALM_PERIODS: u8 = 5;
/// Multiple of their width at which the dead zones are left \[-\].
const HYSTERESIS: f32 = 1.5;
/// Periods by which a small pulse looks ahead of its own \[-\].
const AHEAD: f32 = 0.5;
/// Share of an open period's gas up to which the gas of two periods fits into one \[-\].
const FITS: f32 = 0.5;
/// Share of the supply's pressure to which a muscle is filled: there 20 % of the valve's full flow is left \[-\].
const FILLED: f32 = 0.98;
/// Way over which dry friction of a bearing builds up: assumed \[rad\].
const BEARING_RAD: f32 = 0.005;
/// Part of a swing within which the open valves must give the torque that answers it: assumed \[rad\].
const FOLLOWS_RAD: f32 = 0.5;
/// Fastest rate at which the integral closes an error, by the spring of gas and gain: a faster one drives a swing
/// (assumption) \[1/s\].
const LEARNS_PER_S: f32 = 6.5;
/// Way about the reference over which slip and creep are a spring, before the braid slides: assumed \[rad\].
const SPRINGS_RAD: f32 = 0.1;

/// One muscle in the joint's controller.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Side {
    drive: FlowDrive,
    per_k: f32,
    law: Law,
    /// Slip and creep along the reference.
    held: Held,
    /// Pressure \[Pa\] and volume \[m3\] for which gas has been moved so far.
    given_pa: f32,
    given_m3: f32,
    /// Pressure and volume of the reference at the end of the period before.
    reference_pa: f32,
    reference_m3: f32,
    /// Whether the last period had a pulse.
    pulsed: bool,
    /// Pressure change of a period with an open valve, in the direction of the last one \[Pa\].
    open_pa: f32,
}

impl Side {
    #[cold] // Once for each muscle at a start: as small as can be.
    #[inline(never)]
    fn new(config: &Config) -> Self {
        let drive = FlowDrive::new(config);
        Self {
            per_k: 1.0 / config.gas.heat_capacity_ratio,
            law: Law::new(&config.hysteresis, drive.period_s()),
            drive,
            held: Held::default(),
            given_pa: 0.0,
            given_m3: 0.0,
            reference_pa: 0.0,
            reference_m3: 0.0,
            pulsed: false,
            open_pa: 0.0,
        }
    }

    /// Starts from gas moved for this pressure \[Pa\] and volume \[m3\].
    fn start(&mut self, pressure_pa: f32, volume_m3: f32) {
        (self.given_pa, self.given_m3) = (pressure_pa, volume_m3);
        (self.reference_pa, self.reference_m3) = (pressure_pa, volume_m3);
        self.pulsed = false;
    }

    /// Openings of a period that leads to this pressure \[Pa\] and volume \[m3\]. The share `closes` of the gas missing
    /// from earlier periods is added.
    fn period(
        &mut self,
        muscle: &Measured<'_>,
        (next_pa, next_m3): (f32, f32),
        closes: f32,
        [quiet_pa, waits_pa]: [f32; 2],
    ) -> Command {
        let Measured { config, chamber, feedback, most_pa } = muscle;
        let port = ChamberPort::new(config, *chamber, feedback, &self.drive, self.per_k);
        let way_pa = next_pa - core::mem::replace(&mut self.reference_pa, next_pa);
        let way_m3 = next_m3 - core::mem::replace(&mut self.reference_m3, next_m3);
        let missing_pa = closes * (self.given_pa - feedback.pressure_pa);
        let missing_m3 = closes * (self.given_m3 - port.volume_m3);
        let asked_kg = |to_pa: f32, to_m3: f32| {
            let change_pa = to_pa - self.given_pa + missing_pa;
            let change_m3 = to_m3 - self.given_m3 + missing_m3;
            port.mass_kg(change_pa, change_m3) + port.leaked_kg - port.in_flight_kg
        };
        let first_kg = asked_kg(next_pa, next_m3);
        let size_kg = absolute(first_kg);
        let per_pa_kg = port.mass_kg(1.0, 0.0);
        let waits_kg = waits_pa * per_pa_kg;
        let open = OpenFlow::new(config, first_kg, feedback.muscle());
        let open_kg = port.period_s * open.kg_s;
        self.open_pa = open_kg / per_pa_kg;
        // The gas of two periods fits into one.
        let fits = size_kg < FITS * open_kg;
        let waits = self.pulsed && fits && size_kg < waits_kg;
        if waits || size_kg < quiet_pa * per_pa_kg {
            self.pulsed = false;
            return self.drive.closed();
        }
        self.pulsed = true;
        // A small pulse serves the period after it too, in its mean; one that nearly fills its period is extended to
        // all of it.
        let ahead = if fits && size_kg < 2.0 * waits_kg { AHEAD } else { 0.0 };
        let (to_pa, to_m3) = (next_pa + ahead * way_pa, next_m3 + ahead * way_m3);
        let mut asked_kg = asked_kg(to_pa, to_m3);
        (self.given_pa, self.given_m3) = (to_pa, to_m3);
        let early_kg = open_kg - size_kg;
        if !fits && early_kg > 0.0 && early_kg < waits_kg {
            let sign = if asked_kg > 0.0 { 1.0 } else { -1.0 };
            asked_kg = sign * open_kg;
            self.given_pa += sign * waits_pa * early_kg / waits_kg;
        }
        let room_kg = port.mass_kg(most_pa - port.pressure_pa, 0.0);
        let mass_kg = limit(asked_kg, f32::MIN, limit(room_kg, 0.0, 1.0));
        self.drive.mass_through(config, mass_kg, feedback.muscle(), open)
    }
}

/// Inputs of one muscle for a period.
#[derive(Debug, Clone, Copy)]
pub struct Measured<'a> {
    /// Its configuration.
    pub config: &'a Config,
    /// Its chamber.
    pub chamber: &'a AnyChamber,
    /// Pressure, length and estimate.
    pub feedback: Feedback,
    /// Highest permitted absolute pressure \[Pa\].
    pub most_pa: f32,
}

impl Measured<'_> {
    fn gauge_pa(&self) -> f32 {
        self.feedback.pressure_pa - self.config.ambient.pressure_pa
    }
}

/// State of the joint's controller.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointController {
    radius_m: f32,
    tuning: JointTuning,
    period_s: f32,
    sides: [Side; 2],
    /// The muscles at their lengths in the last step of a period, and their levers there.
    lines: [Line; 2],
    levers: [Lever; 2],
    /// Angle of that measurement \[rad\], and torque per way from there at constant pressures \[N m/rad\].
    measured_rad: f32,
    isobaric_n_m_rad: f32,
    /// Spring of slip and creep while nothing slides \[N m/rad\].
    hysteresis_n_m_rad: f32,
    /// Torque of the muscles, from these and the pressures of the step \[N m\].
    torque_n_m: f32,
    gravity: Gravity,
    /// Whether gravity has been computed in this period.
    weighed: bool,
    /// Whether the reference has arrived at a set point at rest.
    arrived: bool,
    /// Way that the joint will still turn then \[rad\].
    to_come_rad: f32,
    friction: Friction,
    reference: Reference,
    /// Angles from a host that sends no derivatives.
    pace: Pace,
    course: Course,
    /// Angle of the reference for which the pressures were set \[rad\].
    led_rad: f32,
    /// Friction along the reference \[N m\].
    friction_n_m: f32,
    integral_n_m: f32,
    observer: Observer,
    /// Error of the angle in the period before \[rad\].
    before_rad: f32,
    calm_periods: u8,
    holding: bool,
    limited: bool,
}

impl JointController {
    /// A controller at rest at angle 0.
    pub fn new(config: &JointConfig) -> Self {
        let JointConfig { muscles, mechanism, tuning, .. } = config;
        let [a, _] = muscles;
        let most_rad_s2 = tuning.reference_torque_n_m / mechanism.inertia_kg_m2;
        let pace = Pace::bending(a.pwm_period_steps, a.step_s, most_rad_s2);
        Self {
            radius_m: mechanism.radius_m,
            tuning: *tuning,
            period_s: f32::from(a.pwm_period_steps) * a.step_s,
            sides: [Side::new(&muscles[0]), Side::new(&muscles[1])],
            lines: [Line::default(); 2],
            levers: [Lever::PLAIN; 2],
            measured_rad: 0.0,
            isobaric_n_m_rad: 0.0,
            hysteresis_n_m_rad: 0.0,
            torque_n_m: 0.0,
            gravity: Gravity::UNKNOWN,
            weighed: false,
            arrived: false,
            to_come_rad: 0.0,
            friction: Friction::default(),
            reference: Reference::still(0.0, 0.0),
            pace,
            course: Course::at(0.0, &pace),
            led_rad: 0.0,
            friction_n_m: 0.0,
            integral_n_m: 0.0,
            observer: Observer::new(mechanism, tuning, a.step_s),
            before_rad: 0.0,
            calm_periods: 0,
            holding: false,
            limited: false,
        }
    }

    /// Angle of the reference at the end of the period under way \[rad\].
    pub fn reference_rad(&self) -> f32 {
        self.reference.motion.angle_rad
    }

    /// The observed speed \[rad/s\].
    pub fn speed_rad_s(&self) -> f32 {
        self.observer.speed_rad_s
    }

    /// Torque that nothing configured explains \[N m\].
    pub fn disturbance_n_m(&self) -> f32 {
        self.observer.disturbance_n_m
    }

    /// Largest dry friction of the joint \[N m\].
    pub fn coulomb_n_m(&self) -> f32 {
        self.friction.coulomb_n_m
    }

    /// Whether the set point needs more than the pressures give.
    pub fn limited(&self) -> bool {
        self.limited
    }

    /// Whether the joint is at its goal and the valves rest.
    pub fn holding(&self) -> bool {
        self.holding
    }

    /// Ways of the muscles for a small way of the joint \[m\].
    pub fn ways_m(&self, way_rad: f32) -> [f32; 2] {
        let way_m = self.radius_m * way_rad;
        self.levers.map(|lever| lever.scaled(way_m))
    }

    /// Updates the torque from the gauge pressures of a step.
    pub fn press(&mut self, gauge_pa: [f32; 2], angle_rad: f32) {
        let way_rad = angle_rad - self.measured_rad;
        self.torque_n_m =
            torque_n_m(self.radius_m, &self.lines, gauge_pa) - self.isobaric_n_m_rad * way_rad;
    }

    /// Torque of the muscles \[N m\].
    pub fn torque_n_m(&self) -> f32 {
        self.torque_n_m
    }

    /// Stiffness behind shut valves at these gauge pressures \[N m/rad\].
    pub fn stiffness_n_m_rad(&self, gauge_pa: [f32; 2]) -> f32 {
        stiffness_n_m_rad(self.radius_m, &self.lines, gauge_pa)
    }

    /// Runs one step of the observer; returns the torque of muscles and gravity \[N m\].
    pub fn observe(&mut self, mechanism: &Mechanism, angle_rad: f32) -> f32 {
        let torque_n_m = self.torque_n_m + self.gravity.torque_n_m(mechanism, angle_rad);
        // The lines contain slip and creep of the reference: about it they act on a swinging arm as a spring.
        let way_rad = limit(angle_rad - self.led_rad, -SPRINGS_RAD, SPRINGS_RAD);
        let net_n_m = torque_n_m - self.hysteresis_n_m_rad * way_rad;
        self.observer.step(angle_rad, net_n_m, &self.friction);
        torque_n_m
    }

    /// Starts from the measured values: nothing jumps.
    pub fn restart(&mut self, mechanism: &Mechanism, angle_rad: f32, muscles: &[Measured<'_>; 2]) {
        let [line_a, _] = &self.lines;
        // There was no step before this one.
        if line_a.volume_m3.to_bits() == 0 {
            self.measure(mechanism, angle_rad, muscles);
        }
        let sides = self.sides.iter_mut().zip(&mut self.lines).zip(&self.levers);
        for ((side, line), lever) in sides {
            line.held_n -= lever.scaled(core::mem::take(&mut side.held).force_n());
        }
        let gauge_pa = muscles.map(|muscle| muscle.gauge_pa());
        let stiffness_n_m_rad = self.stiffness_n_m_rad(gauge_pa);
        self.stand(angle_rad, stiffness_n_m_rad);
        self.leave_course(angle_rad);
        self.friction_n_m = 0.0;
        self.integral_n_m = 0.0;
        self.calm_periods = 0;
        self.holding = false;
        self.arrived = false;
        self.limited = false;
        self.observer.restart(angle_rad);
        for ((side, line), muscle) in self.sides.iter_mut().zip(&self.lines).zip(muscles) {
            side.drive.reset();
            side.start(muscle.feedback.pressure_pa, line.volume_m3);
        }
    }

    /// The openings of a period in which both muscles vent.
    pub fn vent(&mut self) -> [Command; 2] {
        let [a, b] = &mut self.sides;
        [a.drive.direct(Command::VENT), b.drive.direct(Command::VENT)]
    }

    /// The openings of a period in which both muscles are shut.
    pub fn lock(&mut self) -> [Command; 2] {
        let [a, b] = &mut self.sides;
        [a.drive.direct(Command::CLOSED), b.drive.direct(Command::CLOSED)]
    }

    /// Computes gravity, and the way still to come at rest, once per period.
    pub fn weigh(&mut self, mechanism: &Mechanism, angle_rad: f32, muscles: &[Measured<'_>; 2]) {
        if !self.weighed {
            self.gravity = Gravity::about(mechanism, angle_rad);
            if self.arrived {
                self.to_come_rad = self.way_to_come_rad(muscles);
            }
            self.weighed = true;
        }
    }

    /// Way of the joint behind shut valves until creep has ended and the gas has the temperature of its wall, against
    /// the spring of dry friction before it slides; limited to the way permitted at rest \[rad\].
    fn way_to_come_rad(&self, muscles: &[Measured<'_>; 2]) -> f32 {
        let mut torque_n_m = 0.0;
        let spring_n_m_rad = self.friction.presliding_n_m_rad
            + self.hysteresis_n_m_rad
            + self.stiffness_n_m_rad(muscles.map(|muscle| muscle.gauge_pa()));
        let pair = self.sides.iter().zip(&self.lines).zip(&self.levers);
        for ((((side, line), lever), muscle), sign) in pair.zip(muscles).zip([1.0, -1.0]) {
            let Held { fast_n, slow_n, .. } = side.held;
            let Feedback { pressure_pa, estimate, .. } = muscle.feedback;
            let warms_pa = pressure_pa * (estimate.wall_k / estimate.gas_k - 1.0);
            // The line's area already includes its lever.
            let gains_n = lever.scaled(fast_n + slow_n) + line.area_m2 * warms_pa;
            torque_n_m += sign * self.radius_m * gains_n;
        }
        let most_rad = HYSTERESIS * self.tuning.dead_zone_rad;
        limit(torque_n_m / spring_n_m_rad, -most_rad, most_rad)
    }

    /// Measures the muscles at their lengths, and the friction of all moving parts.
    pub fn measure(&mut self, mechanism: &Mechanism, angle_rad: f32, muscles: &[Measured<'_>; 2]) {
        self.levers = mechanism.levers(angle_rad);
        self.weighed = false;
        let bearing_n_m = mechanism.friction_n_m;
        let mut friction = Friction {
            coulomb_n_m: bearing_n_m,
            presliding_n_m_rad: bearing_n_m * (1.0 / BEARING_RAD),
            viscous_n_m_s: mechanism.viscous_n_m_s,
        };
        let (mut isobaric_n_m, mut hysteresis_n_m_rad) = (0.0, 0.0);
        let pair = self.lines.iter_mut().zip(&self.sides).zip(muscles);
        for (((line, side), muscle), lever) in pair.zip(&self.levers) {
            let Measured { config, chamber, feedback, .. } = muscle;
            *line = Line::new(config, *chamber, feedback.length_m, side.held.force_n(), lever);
            let gauge_pa = muscle.gauge_pa();
            isobaric_n_m += line.isobaric_n_m(gauge_pa, feedback.pressure_pa);
            let r = lever.scaled(self.radius_m);
            let square_m2 = r * r;
            hysteresis_n_m_rad += square_m2 * side.law.stiffness_n_m();
            let of_muscle = &config.friction;
            let softening = of_muscle.softening(feedback.estimate.wall_k);
            let friction_n = of_muscle.force_n * softening * of_muscle.at_pressure(gauge_pa);
            friction.coulomb_n_m += r * friction_n;
            friction.viscous_n_m_s += square_m2 * of_muscle.viscous_n_s_m * softening;
            if friction_n > 0.0 {
                friction.presliding_n_m_rad += square_m2 * of_muscle.presliding_stiffness_n_m;
            }
        }
        friction.viscous_n_m_s = self.observer.resolved(friction.viscous_n_m_s);
        self.friction = friction;
        self.hysteresis_n_m_rad = hysteresis_n_m_rad;
        self.isobaric_n_m_rad = self.radius_m * self.radius_m * isobaric_n_m;
        self.measured_rad = angle_rad;
        self.press(muscles.map(|muscle| muscle.gauge_pa()), angle_rad);
    }

    /// The openings of a period, at its start; [`measure`](Self::measure) was called in the step before, or
    /// [`restart`](Self::restart).
    pub fn period(
        &mut self,
        mechanism: &Mechanism,
        set_point: &JointSetPoint,
        angle_rad: f32,
        muscles: &[Measured<'_>; 2],
    ) -> [Command; 2] {
        // At most the pressure that the supply fills within periods.
        let most_pa = muscles.map(|Measured { config, most_pa, .. }| {
            limit(FILLED * config.supply.pressure_pa, 0.0, most_pa) - config.ambient.pressure_pa
        });
        let torque = |stiffness_n_m_rad, torque_n_m| [torque_n_m, stiffness_n_m_rad];
        match *set_point {
            JointSetPoint::Vent => self.vent(),
            JointSetPoint::Lock => self.lock(),
            JointSetPoint::Duty { inlet: [inlet_a, inlet_b], outlet: [outlet_a, outlet_b] } => {
                let [a, b] = &mut self.sides;
                let command = |inlet, outlet| Command {
                    inlet: Duty::from_share(inlet),
                    outlet: Duty::from_share(outlet),
                };
                let (of_a, of_b) = (command(inlet_a, outlet_a), command(inlet_b, outlet_b));
                [a.drive.direct(of_a), b.drive.direct(of_b)]
            }
            JointSetPoint::Pressures { pressure_pa: [a, b] } => {
                let [of_a, of_b] = muscles;
                let gauge_a = a - of_a.config.ambient.pressure_pa;
                let gauge_b = b - of_b.config.ambient.pressure_pa;
                let [most_a, most_b] = most_pa;
                let limited = gauge_a > most_a || gauge_b > most_b;
                let gauge_pa = [limit(gauge_a, 0.0, most_a), limit(gauge_b, 0.0, most_b)];
                self.follow_measured(angle_rad);
                let lines = self.lines;
                self.give(&lines, Allocation { gauge_pa, limited }, muscles)
            }
            JointSetPoint::Torque { torque_n_m, stiffness_n_m_rad } => {
                self.follow_measured(angle_rad);
                let lines = self.lines;
                let wanted = torque(stiffness_n_m_rad, torque_n_m);
                let given = allocate(self.radius_m, &lines, wanted, most_pa);
                self.give(&lines, given, muscles)
            }
            JointSetPoint::Angle(wanted) => {
                self.angle(mechanism, &wanted, angle_rad, muscles, most_pa)
            }
        }
    }

    /// Starts the course again: the next angle without derivatives does not continue a motion.
    pub fn leave_course(&mut self, angle_rad: f32) {
        self.course = Course::at(angle_rad, &self.pace);
    }

    /// Motion of an angle that came without derivatives `age_steps` ago, derived from it and the values before it.
    pub fn course(&mut self, mechanism: &Mechanism, given: Motion, age_steps: u32) -> Motion {
        let age_steps = u16::try_from(age_steps).unwrap_or(u16::MAX);
        let fastest_rad = self.tuning.reference_speed_rad_s * self.period_s;
        let target =
            self.course.advance::<true>(&self.pace, given.angle_rad, age_steps, fastest_rad);
        let angle_rad = limit(target.value, mechanism.minimum_rad, mechanism.maximum_rad);
        if target.change == 0.0 || angle_rad != target.value {
            return Motion::still(angle_rad, given.stiffness_n_m_rad);
        }
        let per_s = 1.0 / self.period_s;
        Motion {
            angle_rad,
            speed_rad_s: target.change * per_s,
            acceleration_rad_s2: target.bend * per_s * per_s,
            ..given
        }
    }

    /// Sets the reference at rest at this angle.
    fn stand(&mut self, angle_rad: f32, stiffness_n_m_rad: f32) {
        self.reference = Reference::still(angle_rad, stiffness_n_m_rad);
        self.led_rad = angle_rad;
    }

    /// Takes the measured angle as the reference if there is none.
    fn follow_measured(&mut self, angle_rad: f32) {
        let way_rad = angle_rad - self.led_rad;
        let levers = self.levers;
        self.creep(way_rad, &levers);
        self.stand(angle_rad, self.reference.motion.stiffness_n_m_rad);
        self.holding = false;
        self.arrived = false;
        self.calm_periods = 0;
        self.integral_n_m = 0.0;
    }

    /// Updates slip and creep over a way of the reference \[rad\].
    fn creep(&mut self, way_rad: f32, [of_a, of_b]: &[Lever; 2]) {
        let way_m = self.radius_m * way_rad;
        let [a, b] = &mut self.sides;
        // Muscle a contracts as the angle grows. Slip at 4 bar is the configured one.
        for (side, way_m) in [(a, of_a.scaled(way_m)), (b, -of_b.scaled(way_m))] {
            side.held = side.law.after(&side.held, way_m, 4.0e5, 1.0);
        }
    }

    /// Controls angle and stiffness.
    fn angle(
        &mut self,
        mechanism: &Mechanism,
        wanted: &Motion,
        angle_rad: f32,
        muscles: &[Measured<'_>; 2],
        most_pa: [f32; 2],
    ) -> [Command; 2] {
        let JointTuning { observer_share, lead_s, .. } = self.tuning;
        let gauge_pa = muscles.map(|muscle| muscle.gauge_pa());
        let stiffness_n_m_rad = self.stiffness_n_m_rad(gauge_pa);
        let mut error_rad = self.reference.motion.angle_rad - angle_rad;
        let held = self.holding;
        self.arrive(wanted);
        if self.rests(wanted, error_rad, gauge_pa, most_pa) {
            self.creep(0.0, &[Lever::PLAIN; 2]);
            let [a, b] = &mut self.sides;
            return [a.drive.closed(), b.drive.closed()];
        }
        if self.arrived {
            // The set point lies in the middle of the way still to come.
            error_rad -= 0.5 * self.to_come_rad;
            self.learn(error_rad, stiffness_n_m_rad);
        }
        let error = [error_rad, self.reference.motion.speed_rad_s - self.observer.speed_rad_s];
        // A fully open valve is late, and the other muscle's would turn the arm meanwhile.
        let stiffens = !self.saturated();
        let Self { reference, tuning, period_s, .. } = self;
        reference.advance(mechanism, tuning, wanted, *period_s, stiffens);
        let [Measured { config, .. }, _] = muscles;
        let late_s = lead_s + config.valve_kind.late_s(&config.valve);
        let next = self.reference.ahead(late_s, self.period_s);
        let way_rad = next.angle_rad - core::mem::replace(&mut self.led_rad, next.angle_rad);
        self.friction_n_m = self.friction.after(self.friction_n_m, way_rad);
        let lengths_m = mechanism.lengths_m(next.angle_rad);
        let levers = mechanism.levers(next.angle_rad);
        self.creep(way_rad, &levers);
        let inertia_kg_m2 = mechanism.inertia_kg_m2;
        let led_n_m = inertia_kg_m2 * next.acceleration_rad_s2
            + self.friction.viscous_n_m_s * next.speed_rad_s
            - self.gravity.torque_n_m(mechanism, next.angle_rad)
            + self.friction_n_m
            - observer_share * self.observer.disturbance_n_m;
        if held && self.arrived && self.sticks(inertia_kg_m2) {
            self.leave_rest(led_n_m, muscles);
        }
        let answer_n_m = self.answer_n_m(inertia_kg_m2, stiffness_n_m_rad, error, late_s);
        let torque_n_m = led_n_m + answer_n_m + self.integral_n_m;
        let mut lines = self.lines;
        let pair = lines.iter_mut().zip(&self.sides).zip(muscles);
        for (((line, side), muscle), (length_m, lever)) in
            pair.zip(lengths_m.into_iter().zip(&levers))
        {
            let length_m = muscle.chamber.limit_length_m(length_m);
            let held_n = side.held.force_n();
            *line = Line::new(muscle.config, muscle.chamber, length_m, held_n, lever);
        }
        let asked = [torque_n_m, next.stiffness_n_m_rad];
        self.give(&lines, allocate(self.radius_m, &lines, asked, most_pa), muscles)
    }

    /// Torque that answers an error \[rad\] and its rate \[rad/s\] when it acts, limited to what the open valves can
    /// follow \[N m\].
    fn answer_n_m(
        &self,
        inertia_kg_m2: f32,
        stiffness_n_m_rad: f32,
        error: [f32; 2],
        late_s: f32,
    ) -> f32 {
        let spring_rad2_s2 = stiffness_n_m_rad / inertia_kg_m2;
        let swing = Swing::after(error, spring_rad2_s2, late_s + self.period_s);
        let JointTuning { gain_n_m_rad, damping_per_s, .. } = self.tuning;
        let mut open_n = 0.0;
        for (side, line) in self.sides.iter().zip(&self.lines) {
            open_n += side.open_pa * line.area_m2;
        }
        let [a, _] = &self.sides;
        let open_n_m_s = self.radius_m * open_n * a.drive.pwm_hz();
        let most_n_m = FOLLOWS_RAD * swing.radian_s * open_n_m_s;
        let asked_n_m =
            gain_n_m_rad * swing.error_rad + inertia_kg_m2 * damping_per_s * swing.rate_rad_s;
        limit(asked_n_m, -most_n_m, most_n_m)
    }

    /// Checks whether the reference has arrived. Torque that friction held at one rest does not belong to a motion: the
    /// integral starts again at the next rest.
    fn arrive(&mut self, wanted: &Motion) {
        let arrived = self.reference.arrives_at(wanted, self.tuning.dead_zone_rad);
        if !arrived {
            self.integral_n_m = 0.0;
            self.to_come_rad = 0.0;
        }
        self.arrived = arrived;
    }

    /// Whether the valves rest in this period.
    fn rests(
        &mut self,
        wanted: &Motion,
        error_rad: f32,
        gauge_pa: [f32; 2],
        most_pa: [f32; 2],
    ) -> bool {
        let zone_rad = self.tuning.dead_zone_rad;
        let width = if self.holding { HYSTERESIS } else { 1.0 };
        // A rest begins if half of the way to come leads to the middle of the zone, up to half of the zone: near an
        // end, noise or a swing would soon end it. Pulses that turn the arm to and fro are no reason for more pulses.
        let mean_rad = 0.5 * (error_rad + core::mem::replace(&mut self.before_rad, error_rad));
        let off_rad = absolute(mean_rad - 0.5 * self.to_come_rad);
        let ends = self.holding || off_rad <= 0.5 * zone_rad;
        let calm = self.arrived
            && wanted.stiffness_n_m_rad == self.reference.motion.stiffness_n_m_rad
            && absolute(error_rad) <= HYSTERESIS * zone_rad
            && ends
            && self.is_as_stiff(wanted.stiffness_n_m_rad, width, gauge_pa, most_pa);
        self.calm_periods = if calm { self.calm_periods.saturating_add(1) } else { 0 };
        let rests = self.calm_periods >= CALM_PERIODS || (self.holding && calm);
        if rests && !self.holding {
            self.reference.motion = *wanted;
        }
        self.holding = rests;
        rests
    }

    /// Whether the stiffness is within its dead zone of this width about the requested stiffness \[N m/rad\].
    fn is_as_stiff(
        &self,
        wanted_n_m_rad: f32,
        width: f32,
        gauge_pa: [f32; 2],
        most_pa: [f32; 2],
    ) -> bool {
        let mut stiffest = wanted_n_m_rad;
        if self.limited {
            // A stiffness that no pressure gives is not waited for. The last period's torque may have belonged to a
            // motion.
            let asked = [self.torque_n_m, wanted_n_m_rad];
            let given = allocate(self.radius_m, &self.lines, asked, most_pa);
            stiffest = self.stiffness_n_m_rad(given.gauge_pa);
        }
        let off = absolute(self.stiffness_n_m_rad(gauge_pa) - stiffest);
        off <= width * self.tuning.dead_zone_stiffness * wanted_n_m_rad
    }

    /// Whether a valve could not pass the requested mass in the last period.
    fn saturated(&self) -> bool {
        self.sides.iter().any(|side| side.drive.saturated())
    }

    /// Whether dry friction stops the arm within the dead zone. A load that pushes the arm out of it has made it fast
    /// by then.
    fn sticks(&self, inertia_kg_m2: f32) -> bool {
        let speed_rad_s = self.observer.speed_rad_s;
        let energy_j = 0.5 * inertia_kg_m2 * speed_rad_s * speed_rad_s;
        energy_j < self.friction.coulomb_n_m * self.tuning.dead_zone_rad
    }

    /// A correction begins with the torque at which the arm rests, less the led torque \[N m\], and with the present
    /// gas. Friction held the changes of gas and creep since then, which the observer has as a disturbance and the
    /// friction along the reference includes too: both together, in one pulse, would throw the arm.
    #[cold]
    fn leave_rest(&mut self, led_n_m: f32, muscles: &[Measured<'_>; 2]) {
        self.integrate(self.torque_n_m - led_n_m);
        for ((side, line), muscle) in self.sides.iter_mut().zip(&self.lines).zip(muscles) {
            side.start(muscle.feedback.pressure_pa, line.volume_m3);
        }
    }

    /// Runs one period of the integral.
    fn learn(&mut self, error_rad: f32, stiffness_n_m_rad: f32) {
        if !self.saturated() {
            let JointTuning { integral_n_m_rad_s, gain_n_m_rad, .. } = self.tuning;
            let fastest_n_m_rad_s = LEARNS_PER_S * (gain_n_m_rad + stiffness_n_m_rad);
            let rate_n_m_rad_s = limit(integral_n_m_rad_s, 0.0, fastest_n_m_rad_s);
            let gained_n_m = rate_n_m_rad_s * self.period_s * error_rad;
            self.integrate(self.integral_n_m + gained_n_m);
        }
    }

    /// Takes a torque as the integral, up to its limit. An arm that friction holds beyond its goal turns back once the
    /// friction along the reference is released and overcome in the other direction.
    fn integrate(&mut self, torque_n_m: f32) {
        let most_n_m = self.tuning.integral_limit_n_m + 2.0 * self.friction.coulomb_n_m;
        self.integral_n_m = limit(torque_n_m, -most_n_m, most_n_m);
    }

    /// Openings for these pressures at these volumes.
    fn give(
        &mut self,
        lines: &[Line; 2],
        allocation: Allocation,
        muscles: &[Measured<'_>; 2],
    ) -> [Command; 2] {
        self.limited = allocation.limited;
        let closes = limit(self.period_s / self.tuning.mass_loop_s, 0.0, 1.0);
        let per_radius = 1.0 / self.radius_m;
        let spared_n =
            [self.tuning.quiet_n_m, self.tuning.waits_n_m].map(|torque| torque * per_radius);
        let mut commands = [Command::CLOSED; 2];
        let sides = self.sides.iter_mut().zip(&mut commands).zip(muscles);
        let wanted = lines.iter().zip(allocation.gauge_pa);
        for (((side, command), muscle), (line, gauge_pa)) in sides.zip(wanted) {
            let to = (muscle.config.ambient.pressure_pa + gauge_pa, line.volume_m3);
            let spared_pa = spared_n.map(|force_n| force_n / line.area_m2);
            *command = side.period(muscle, to, closes, spared_pa);
        }
        commands
    }
}
