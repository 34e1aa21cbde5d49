//! From the set point to the valve openings.
//!
//! ```text
//!            set(kind)                  set(another kind)
//! [Vent] -------------> [Duty | MassFlow | MassFlowCycle] <-------------+
//!   ^  ^                          |        ^                            |
//!   |  |        set(Pressure)     v        | set(another kind)          |
//!   |  |      +-------------> [Pressure: moving] <--> [holding]         |
//!   |  |      |                   |  ^   error within, or beyond,       |
//!   |  |      |  set(Contraction) v  |   the dead zone                  |
//!   |  +------+-------------> [Contraction: moving] <--> [holding] -----+
//!   |                                      five periods within, or a step out of, the dead zone
//!   +--- every fault that vents, clear, arm, disarm, set(Vent): from everywhere, at once
//! ```
//!
//! All of them enter *Vent* by [`Controller::set`], which forgets the openings of the period under way, the owed mass
//! and the loop's state. Only the phase of the period stays.
//!
//! Entering *Pressure* or *Contraction* starts the loop from the measured values (bumpless); another set point of the
//! same kind keeps what the loop has learnt. *Holding*: both valves closed, the gas locked in, friction keeping the
//! muscle in place. No set point is followed beyond the working limit, a little below the pressure at which the
//! supervisor vents; one that needs more is marked as limited.
//!
//! Work is done once per PWM period, at its start; the friction at the estimated wall temperature is computed in the
//! middle of the period before, because an exponential is expensive without an FPU.

pub(crate) mod chamber_port;
mod contraction;
pub(crate) mod course;
mod cycle;
mod load_observer;
mod pressure;
mod set_point;
pub mod valve_drive;

pub use self::chamber_port::Feedback;
pub use crate::sample::{Mode, SetPoint};

pub use self::set_point::{SetPointError, SetPointField, Target, contractions};

use self::chamber_port::ChamberPort;
use self::contraction::{Contracting, ContractionLoop, Gains};
use self::cycle::{Cycle, Strokes};
use self::pressure::PressureLoop;
use crate::config::{Config, Load};
use crate::control::valve_drive::{FlowDrive, OpenFlow};
use crate::math::limit;
use crate::physics::chamber::Chamber;
use crate::sample::{Command, Duty};

/// Shortest period of the contraction loop \[s\]: its speeds are differences of two readings, which are rounded to 0.12
/// mm, and within 5 ms a valve that takes 2 ms to close is not shut before the other one has to open. Simulated with
/// valves of 200 and 500 Hz, 20 kg on a sine of 15 mm were 0.9 and 3.7 mm off, at 100 Hz 0.2 mm.
const CONTRACTION_S: f32 = 0.008;

/// Multiple of the working limit beyond which a contraction lets gas out: a load that swings on its gas compresses it,
/// and would trip the limit at which the muscle vents \[-\].
const SPILLS: f32 = 1.01;

/// The active loop, if there is one.
#[expect(clippy::large_enum_variant, reason = "there is no allocator to box one with")]
#[derive(Debug, Clone, Copy, PartialEq)]
enum ActiveLoop {
    Open,
    Cycle(Cycle),
    Pressure(PressureLoop),
    Contraction(ContractionLoop),
}

/// State of the controller.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Controller {
    target: Target,
    drive: FlowDrive,
    gains: Gains,
    /// PWM periods that the contraction loop joins into one.
    contraction_periods: u8,
    per_k: f32,
    active: ActiveLoop,
    /// Openings of the PWM period under way, and of all periods that the loop has joined.
    command: Command,
    joined_command: Command,
    /// Number of the joined PWM periods that have begun.
    begun: u8,
    /// Highest pressure to which a set point is followed \[Pa\].
    working_limit_pa: f32,
    /// Whether the set point needs more than the working limit.
    limited: bool,
    /// Steps since the last PWM period began.
    elapsed_steps: u32,
    /// Steps until the PWM period ends.
    remaining_steps: u16,
    /// Steps since the set point changed.
    age_steps: u16,
    /// Factor of the estimated wall temperature on friction \[-\].
    softening: f32,
    /// Measured length at the start of the last period \[m\].
    length_m: f32,
}

impl Controller {
    /// Creates a controller that vents.
    ///
    /// ```
    /// use model_core::control::{Controller, Feedback, Target};
    /// use model_core::physics::chamber::AnyChamber;
    /// use model_core::{Config, Duty, Estimate, SetPoint};
    ///
    /// let config = Config::default();
    /// let muscle = AnyChamber::new(&config.chamber);
    /// let mut controller = Controller::new(&config);
    /// controller.set(Target::new(&SetPoint::Pressure { pressure_pa: 3.0e5 }, &config, &muscle)?);
    /// let estimate = Estimate { gas_k: 298.0, wall_k: 298.0, ..Estimate::default() };
    /// let (pressure_pa, length_m, length_wide_m) = (1.5e5, 0.28, 0.0);
    /// let feedback = Feedback { pressure_pa, length_m, length_wide_m, length_lost: false, estimate };
    /// assert!(controller.step(&config, &muscle, &feedback, 0).inlet > Duty::ZERO);
    /// # Ok::<(), model_core::SetPointError>(())
    /// ```
    pub fn new(config: &Config) -> Self {
        let drive = FlowDrive::new(config);
        let contraction_periods = contraction_periods(config);
        Self {
            target: Target::VENT,
            gains: Gains::new(
                config,
                config.pwm_period_steps.saturating_mul(u16::from(contraction_periods)),
            ),
            contraction_periods,
            drive,
            per_k: 1.0 / config.gas.heat_capacity_ratio,
            active: ActiveLoop::Open,
            command: Command::VENT,
            joined_command: Command::VENT,
            begun: 0,
            working_limit_pa: config.working_limit_pa(),
            limited: false,
            elapsed_steps: 0,
            remaining_steps: 0,
            age_steps: 0,
            softening: config.friction.softening(config.ambient.temperature_k),
            length_m: 0.0,
        }
    }

    /// Changes the set point from the next PWM period on; venting starts at once. A set point of the same kind keeps
    /// what its loop has learnt.
    pub fn set(&mut self, target: Target) {
        let kind = |target: &Target| core::mem::discriminant(&target.set_point());
        if kind(&target) != kind(&self.target) {
            self.drive.reset();
            self.active = ActiveLoop::Open;
            self.begun = 0;
        }
        if target != self.target {
            self.age_steps = 0;
        }
        self.target = target;
        // A start that is vented first has the same state as one that is not: its record then replays to the bit.
        if target == Target::VENT && self.command != Command::VENT {
            self.command = self.drive.direct(Command::VENT);
        }
    }

    /// The accepted set point.
    pub fn target(&self) -> Target {
        self.target
    }

    /// Follows no set point beyond this absolute pressure \[Pa\].
    pub fn limit_to(&mut self, working_limit_pa: f32) {
        self.working_limit_pa = working_limit_pa;
    }

    /// Whether the set point is anything but venting.
    pub fn driven(&self) -> bool {
        self.target != Target::VENT
    }

    /// Whether the last step began a PWM period, in which the controller works.
    pub fn worked(&self) -> bool {
        self.elapsed_steps == 1
    }

    /// Whether the next step begins a PWM period.
    pub fn ends_period(&self) -> bool {
        self.remaining_steps == 0
    }

    /// Whether the set point needs more than the working limit.
    pub fn limited(&self) -> bool {
        self.limited
    }

    /// Mode of the controller.
    pub fn mode(&self) -> Mode {
        match (self.target.set_point(), &self.active) {
            (SetPoint::Vent, _) => Mode::Vent,
            (SetPoint::Duty { .. }, _) => Mode::Duty,
            (SetPoint::MassFlow { .. } | SetPoint::MassFlowCycle { .. }, _) => Mode::MassFlow,
            (SetPoint::Pressure { .. }, ActiveLoop::Pressure(active)) if active.holding() => {
                Mode::PressureHeld
            }
            (SetPoint::Pressure { .. }, _) => Mode::Pressure,
            (SetPoint::Contraction { .. }, ActiveLoop::Contraction(active)) if active.holding() => {
                Mode::ContractionHeld
            }
            (SetPoint::Contraction { .. }, _) => Mode::Contraction,
        }
    }

    /// Returns the openings for this step, before which `missed_steps` were left out. Except for venting, they change
    /// only at the start of a PWM period: in between the hardware would not accept them.
    pub fn step(
        &mut self,
        config: &Config,
        chamber: &impl Chamber,
        feedback: &Feedback,
        missed_steps: u8,
    ) -> Command {
        let period_steps = config.pwm_period_steps;
        // The hardware's period continued meanwhile.
        for _ in 0..missed_steps {
            self.count(period_steps);
        }
        if self.remaining_steps == 0 {
            self.command = self.begin(config, chamber, feedback);
        }
        if self.remaining_steps == period_steps / 2 {
            self.softening = config.friction.softening(feedback.estimate.wall_k);
        }
        self.count(period_steps);
        self.command
    }

    /// Counts one step of the PWM period.
    fn count(&mut self, period_steps: u16) {
        let before = if self.remaining_steps == 0 { period_steps } else { self.remaining_steps };
        self.remaining_steps = before.saturating_sub(1);
        self.elapsed_steps = self.elapsed_steps.saturating_add(1);
        self.age_steps = self.age_steps.saturating_add(1);
    }

    /// Returns the openings of a PWM period that begins.
    fn begin(&mut self, config: &Config, chamber: &impl Chamber, feedback: &Feedback) -> Command {
        if self.begun >= self.drive.joined() {
            self.begun = 0;
        }
        if self.begun == 0 {
            let contracts = matches!(self.target.set_point(), SetPoint::Contraction { .. });
            self.drive.join(config, if contracts { self.contraction_periods } else { 1 });
            self.joined_command = self.period(config, chamber, feedback);
            self.length_m = feedback.length_m;
            self.elapsed_steps = 0;
        }
        let command = self.drive.part(self.joined_command, self.begun);
        self.begun = self.begun.saturating_add(1);
        command
    }

    fn period(&mut self, config: &Config, chamber: &impl Chamber, feedback: &Feedback) -> Command {
        let muscle = feedback.muscle();
        let near;
        let feedback = match self.reference_m() {
            Some(reference_m) if feedback.length_wide_m > 0.0 => {
                let zone_m = config.controller.contraction_dead_zone * chamber.rest_length_m();
                near = feedback.nearest_to(reference_m, zone_m);
                &near
            }
            _ => feedback,
        };
        self.limited = false;
        let port = self.port(config, chamber, feedback);
        let mass_kg = match self.target.set_point() {
            SetPoint::Vent => return self.drive.direct(Command::VENT),
            SetPoint::Duty { inlet, outlet } => {
                let [inlet, outlet] = [inlet, outlet].map(Duty::from_share);
                return self.drive.direct(Command { inlet, outlet });
            }
            SetPoint::MassFlow { flow_kg_s } => {
                let wanted_kg = self.drive.owing_kg(flow_kg_s);
                let given_kg = self.limited_kg(&port, wanted_kg);
                return self.drive.flow(config, given_kg, muscle);
            }
            SetPoint::MassFlowCycle { flow_kg_s, period_s } => {
                let strokes = Strokes { flow_kg_s, period_s, step_s: config.step_s };
                Some(self.cycle_mass_kg(config, &port, &strokes))
            }
            SetPoint::Pressure { pressure_pa } => {
                self.pressure_mass_kg(config, chamber, feedback, &port, pressure_pa)
            }
            SetPoint::Contraction { contraction } => match config.load {
                Load::Isotonic { force_n } if chamber.moves() => {
                    let wanted = Contracting {
                        contraction,
                        age_steps: self.age_steps,
                        load_n: force_n,
                        softening: self.softening,
                        most_pa: self.working_limit_pa,
                    };
                    return self.contract(config, chamber, feedback, &port, &wanted);
                }
                _ => return self.drive.direct(Command::VENT),
            },
        };
        match mass_kg {
            Some(mass_kg) => {
                let mass_kg = self.limited_kg(&port, mass_kg);
                self.drive.mass(config, mass_kg, muscle)
            }
            None => self.drive.closed(),
        }
    }

    /// Length of the contraction loop's reference \[m\]; `None` while another loop is active.
    pub fn reference_m(&self) -> Option<f32> {
        match &self.active {
            ActiveLoop::Contraction(active) => Some(active.reference_m()),
            _ => None,
        }
    }

    /// Mass that the working cycle moves in the coming period \[kg\].
    fn cycle_mass_kg(&mut self, config: &Config, port: &ChamberPort, strokes: &Strokes) -> f32 {
        let (mut active, elapsed_steps) = match self.active {
            ActiveLoop::Cycle(active) => (active, self.elapsed_steps),
            _ => (Cycle::new(port.gas_mass_kg()), 0),
        };
        let mass_kg = active.period(strokes, port, elapsed_steps, config.pwm_period_steps);
        self.active = ActiveLoop::Cycle(active);
        mass_kg
    }

    /// Mass that the pressure loop requests \[kg\]; `None` if the valves rest.
    fn pressure_mass_kg(
        &mut self,
        config: &Config,
        chamber: &impl Chamber,
        feedback: &Feedback,
        port: &ChamberPort,
        pressure_pa: f32,
    ) -> Option<f32> {
        self.limited = pressure_pa > self.working_limit_pa;
        let pressure_pa = limit(pressure_pa, 0.0, self.working_limit_pa);
        let mut active = match self.active {
            ActiveLoop::Pressure(active) => active,
            _ => PressureLoop::new(feedback),
        };
        let change_m3 = self.volume_change_m3(chamber, feedback);
        let mass_kg = active.period(config, feedback, port, change_m3, pressure_pa);
        self.active = ActiveLoop::Pressure(active);
        mass_kg
    }

    /// Openings that the contraction loop requests. If a load that swings on its gas compresses it beyond the limit,
    /// gas is let out, also at rest.
    fn contract(
        &mut self,
        config: &Config,
        chamber: &impl Chamber,
        feedback: &Feedback,
        port: &ChamberPort,
        wanted: &Contracting,
    ) -> Command {
        if !matches!(self.active, ActiveLoop::Contraction(_)) {
            let Contracting { load_n, softening, .. } = *wanted;
            let fresh =
                ContractionLoop::new(config, &self.gains, chamber, feedback, load_n, softening);
            self.active = ActiveLoop::Contraction(fresh);
        }
        let asked = match &mut self.active {
            ActiveLoop::Contraction(active) => {
                let asked = active.period(config, chamber, feedback, port, wanted);
                self.limited = active.limited();
                asked
            }
            _ => None,
        };
        let spills = port.pressure_pa > SPILLS * self.working_limit_pa;
        let rests = spills.then_some((0.0, OpenFlow::NONE));
        let Some((mass_kg, open)) = asked.or(rests) else { return self.drive.closed() };
        let mut mass_kg = self.limited_kg(port, mass_kg);
        if spills {
            let room_pa = self.working_limit_pa - port.pressure_pa;
            mass_kg = limit(mass_kg, f32::MIN, port.mass_kg(room_pa, 0.0));
        }
        self.drive.mass_through(config, mass_kg, feedback.muscle(), open)
    }

    /// Limits `wanted_kg` to the mass that brings the pressure to the working limit at the present volume \[kg\].
    fn limited_kg(&mut self, port: &ChamberPort, wanted_kg: f32) -> f32 {
        if !(wanted_kg > 0.0) {
            return wanted_kg;
        }
        let room_pa = self.working_limit_pa - port.pressure_pa;
        let most_kg = limit(port.mass_kg(room_pa, 0.0), 0.0, 1.0);
        self.limited |= wanted_kg > most_kg;
        limit(wanted_kg, 0.0, most_kg)
    }

    /// Change of the volume over the last period, eq. (11) \[m3\].
    fn volume_change_m3(&self, chamber: &impl Chamber, feedback: &Feedback) -> f32 {
        let moved_m = feedback.length_m - self.length_m;
        // A length derived from pressure would feed the pressure back. The first period after a start has no length to
        // compare with.
        if self.length_m > 0.0 && !feedback.length_lost {
            chamber.volume_slope_m2(feedback.length_m) * moved_m
        } else {
            0.0
        }
    }

    fn port(&self, config: &Config, chamber: &impl Chamber, feedback: &Feedback) -> ChamberPort {
        ChamberPort::new(config, chamber, feedback, &self.drive, self.per_k)
    }
}

/// PWM periods that the contraction loop joins: as many as its shortest period takes.
fn contraction_periods(config: &Config) -> u8 {
    // Casts saturate.
    let steps = (CONTRACTION_S / config.step_s + 0.5) as u16;
    let periods = steps.div_ceil(config.pwm_period_steps.max(1));
    u8::try_from(periods).unwrap_or(u8::MAX).max(1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::physics::chamber::{AnyChamber, ChamberConfig, Vessel};
    use crate::sample::Estimate;

    const LENGTH_M: f32 = 0.27;

    fn feedback(pressure_pa: f32, length_m: f32) -> Feedback {
        let estimate = Estimate { gas_k: 298.0, wall_k: 298.0, ..Estimate::default() };
        Feedback { pressure_pa, length_m, length_wide_m: 0.0, length_lost: false, estimate }
    }

    fn chamber(config: &Config) -> AnyChamber {
        AnyChamber::new(&config.chamber)
    }

    /// Runs for this many PWM periods; returns the last openings.
    fn periods(controller: &mut Controller, config: &Config, count: u16, now: Feedback) -> Command {
        let chamber = chamber(config);
        let mut command = Command::VENT;
        for _ in 0..count * config.pwm_period_steps {
            command = controller.step(config, &chamber, &now, 0);
        }
        command
    }

    /// A pressure at which the muscle holds its load at [`LENGTH_M`] without friction.
    fn balance_pa(config: &Config) -> f32 {
        let muscle = chamber(config);
        config.ambient.pressure_pa + muscle.gauge_pressure_for_force_pa(100.0, LENGTH_M)
    }

    fn every_set_point() -> [SetPoint; 6] {
        [
            SetPoint::Vent,
            SetPoint::Duty { inlet: 0.4, outlet: 0.0 },
            SetPoint::MassFlow { flow_kg_s: 1.0e-3 },
            SetPoint::MassFlowCycle { flow_kg_s: 1.0e-3, period_s: 2.0 },
            SetPoint::Pressure { pressure_pa: 4.0e5 },
            SetPoint::Contraction { contraction: 0.2 },
        ]
    }

    fn set(controller: &mut Controller, set_point: SetPoint) {
        let config = Config::default();
        controller.set(Target::new(&set_point, &config, &chamber(&config)).unwrap());
    }

    fn mode_of(set_point: &SetPoint) -> Mode {
        match set_point {
            SetPoint::Vent => Mode::Vent,
            SetPoint::Duty { .. } => Mode::Duty,
            SetPoint::MassFlow { .. } | SetPoint::MassFlowCycle { .. } => Mode::MassFlow,
            SetPoint::Pressure { .. } => Mode::Pressure,
            SetPoint::Contraction { .. } => Mode::Contraction,
        }
    }

    /// Every kind after every kind, and the valves that each drives. Pulses of 200 and 500 Hz are joined to periods of
    /// 10 and 8 ms, each to one pulse; longer periods stay as they are.
    #[test]
    fn short_periods_are_joined() {
        for (period_steps, joined) in [(1, 8), (2, 4), (5, 2), (7, 2), (8, 1), (10, 1), (1000, 1)] {
            let config = Config { pwm_period_steps: period_steps, ..Config::default() };
            assert_eq!(contraction_periods(&config), joined, "{period_steps} steps");
            let mut drive = FlowDrive::new(&config);
            drive.join(&config, joined);
            let whole_s = f32::from(joined) * f32::from(period_steps) * config.step_s;
            assert!((drive.period_s() - whole_s).abs() < 1e-6);
            for share in [0.0, 0.1, 0.45, 0.9, 1.0_f32] {
                let whole = Command { inlet: Duty::from_share(share), outlet: Duty::ZERO };
                let parts: Vec<f32> =
                    (0..joined).map(|begun| drive.part(whole, begun).inlet.share()).collect();
                let sum: f32 = parts.iter().sum();
                assert!((sum - share * f32::from(joined)).abs() < 1e-3, "{share}: {parts:?}");
                assert!(parts.windows(2).all(|pair| pair[0] == 1.0 || pair[1] == 0.0), "{parts:?}");
            }
        }
    }

    #[test]
    fn every_transition() {
        let config = Config::default();
        for from in every_set_point() {
            for to in every_set_point() {
                let mut controller = Controller::new(&config);
                set(&mut controller, from);
                periods(&mut controller, &config, 3, feedback(2.0e5, LENGTH_M));
                set(&mut controller, to);
                // Two periods: after the outlet was open to the period's end, the inlet waits for one.
                let command = periods(&mut controller, &config, 2, feedback(2.0e5, LENGTH_M));
                assert_eq!(controller.mode(), mode_of(&to), "{from:?} to {to:?}");
                let (inlet, outlet) = (command.inlet > Duty::ZERO, command.outlet > Duty::ZERO);
                let expected = if to == SetPoint::Vent { (false, true) } else { (true, false) };
                assert_eq!((inlet, outlet), expected, "{from:?} to {to:?}");
            }
        }
    }

    /// Another goal of the same kind continues from what the loop has learnt; after another kind it starts from
    /// scratch.
    #[test]
    fn what_a_loop_has_learnt_lasts_as_long_as_its_kind() {
        let config = Config::default();
        for (goal, other_goal) in [
            (SetPoint::Pressure { pressure_pa: 3.0e5 }, SetPoint::Pressure { pressure_pa: 3.1e5 }),
            (
                SetPoint::Contraction { contraction: 0.1 },
                SetPoint::Contraction { contraction: 0.2 },
            ),
            (
                SetPoint::MassFlowCycle { flow_kg_s: 1.0e-3, period_s: 2.0 },
                SetPoint::MassFlowCycle { flow_kg_s: 2.0e-3, period_s: 3.0 },
            ),
        ] {
            let mut controller = Controller::new(&config);
            set(&mut controller, goal);
            periods(&mut controller, &config, 5, feedback(2.9e5, LENGTH_M));
            let learnt = controller.active;
            assert_ne!(learnt, ActiveLoop::Open, "{goal:?}");
            set(&mut controller, other_goal);
            assert_eq!(controller.active, learnt, "{other_goal:?}");
            set(&mut controller, SetPoint::Duty { inlet: 0.0, outlet: 0.0 });
            set(&mut controller, goal);
            assert_eq!(controller.active, ActiveLoop::Open, "{goal:?}");
        }
    }

    /// The shortest period that leaves a share, the default, and the longest.
    #[test]
    fn venting_forgets_the_openings_of_the_period_and_keeps_its_phase() {
        for period_steps in [2, 10, 1000] {
            let config = Config { pwm_period_steps: period_steps, ..Config::default() };
            let now = feedback(2.0e5, LENGTH_M);
            let muscle = chamber(&config);
            for from in &every_set_point()[1..] {
                let mut controller = Controller::new(&config);
                set(&mut controller, *from);
                let mut step = || controller.step(&config, &muscle, &now, 0);
                // With a short period a loop takes several until its pulse is long enough.
                let fills = (0..100 * u32::from(period_steps)).find(|count| {
                    step().inlet > Duty::ZERO && count % u32::from(period_steps) == 0
                });
                assert!(fills.is_some(), "{from:?}");
                set(&mut controller, SetPoint::Vent);
                set(&mut controller, *from);
                for step in 1..period_steps {
                    let command = controller.step(&config, &muscle, &now, 0);
                    assert_eq!(command, Command::VENT, "{from:?}, step {step} of {period_steps}");
                }
                let next = controller.step(&config, &muscle, &now, 0);
                assert_ne!(next, Command::VENT, "{from:?}, the next period of {period_steps}");
            }
        }
    }

    #[test]
    fn venting_changes_nothing_in_a_controller_that_has_not_driven() {
        let config = Config::default();
        let fresh = Controller::new(&config);
        for from in every_set_point() {
            let mut controller = fresh;
            set(&mut controller, from);
            set(&mut controller, SetPoint::Vent);
            assert_eq!(controller, fresh, "{from:?}");
        }
    }

    /// Neither a stopped flow nor a reversed one moves the mass that the flow before it owed.
    #[test]
    fn what_a_flow_owes_is_forgotten_where_it_stops_or_turns() {
        let now = feedback(2.0e5, LENGTH_M);
        for period_steps in [1, 10, 100, 1000] {
            let config = Config { pwm_period_steps: period_steps, ..Config::default() };
            let flow = |controller: &mut Controller, flow_kg_s| {
                set(controller, SetPoint::MassFlow { flow_kg_s });
                periods(controller, &config, 1, now)
            };
            for first_kg_s in [0.5, -0.5] {
                for then_kg_s in [0.0, -1.0e-4 * first_kg_s] {
                    let mut controller = Controller::new(&config);
                    for _ in 0..3 {
                        flow(&mut controller, first_kg_s);
                    }
                    for _ in 0..4 {
                        let command = flow(&mut controller, then_kg_s);
                        let backwards =
                            if first_kg_s > 0.0 { command.inlet } else { command.outlet };
                        assert_eq!(backwards, Duty::ZERO, "{first_kg_s} then {then_kg_s} kg/s");
                    }
                }
            }
        }
    }

    /// Owed gas is limited to the room below the working limit, and the rest is not owed later either.
    #[test]
    fn what_a_flow_owes_does_not_pass_the_working_limit() {
        let config = Config::default();
        let limit_pa = config.working_limit_pa();
        let mut controller = Controller::new(&config);
        set(&mut controller, SetPoint::MassFlow { flow_kg_s: 0.5 });
        periods(&mut controller, &config, 3, feedback(2.0e5, LENGTH_M));
        set(&mut controller, SetPoint::MassFlow { flow_kg_s: 1.0e-5 });
        let below = feedback(limit_pa - 3000.0, LENGTH_M);
        let room_kg = {
            let port = controller.port(&config, &chamber(&config), &below);
            port.mass_kg(3000.0, 0.0)
        };
        let supply = config.supply.into();
        let full_kg_s = config.valve.mass_flow_kg_s(&config.gas, supply, below.pressure_pa);
        let inlet = periods(&mut controller, &config, 1, below).inlet;
        assert!(inlet > Duty::ZERO && controller.limited());
        assert!(full_kg_s * 0.01 * inlet.share() <= 1.001 * room_kg, "{inlet:?}");
        let above = feedback(limit_pa, LENGTH_M);
        assert_eq!(periods(&mut controller, &config, 1, above), Command::CLOSED);
        let inlet = periods(&mut controller, &config, 1, feedback(2.0e5, LENGTH_M)).inlet;
        assert_eq!(inlet, Duty::ZERO, "0.1 mg a period is too little for a pulse");
    }

    #[test]
    fn what_a_flow_owes_is_forgotten_with_its_kind() {
        let config = Config::default();
        let flow = |flow_kg_s| SetPoint::MassFlow { flow_kg_s };
        let now = feedback(2.0e5, LENGTH_M);
        let mut controller = Controller::new(&config);
        set(&mut controller, flow(5.0e-3));
        periods(&mut controller, &config, 3, now);
        set(&mut controller, flow(1.0e-9));
        assert!(periods(&mut controller, &config, 1, now).inlet > Duty::ZERO, "still owed");
        set(&mut controller, SetPoint::Duty { inlet: 0.0, outlet: 0.0 });
        set(&mut controller, flow(1.0e-9));
        assert_eq!(periods(&mut controller, &config, 1, now), Command::CLOSED);
    }

    #[test]
    fn pressure_rests_and_wakes() {
        let config = Config::default();
        let mut controller = Controller::new(&config);
        set(&mut controller, SetPoint::Pressure { pressure_pa: 3.0e5 });
        for (pressure_pa, mode) in [
            (2.9e5, Mode::Pressure),
            (2.992e5, Mode::Pressure),
            (2.993e5, Mode::PressureHeld),
            (2.986e5, Mode::PressureHeld),
            (2.984e5, Mode::Pressure),
            (3.006e5, Mode::PressureHeld),
        ] {
            // The second period has nothing in flight.
            let command = periods(&mut controller, &config, 2, feedback(pressure_pa, LENGTH_M));
            assert_eq!(controller.mode(), mode, "at {pressure_pa} Pa");
            assert!(mode != Mode::PressureHeld || command == Command::CLOSED);
        }
        set(&mut controller, SetPoint::Pressure { pressure_pa: 3.5e5 });
        periods(&mut controller, &config, 1, feedback(3.006e5, LENGTH_M));
        assert_eq!(controller.mode(), Mode::Pressure, "another set point of the same kind");
    }

    #[test]
    fn contraction_rests_and_wakes() {
        let config = Config::default();
        let held = feedback(balance_pa(&config), LENGTH_M);
        let mut controller = Controller::new(&config);
        set(&mut controller, SetPoint::Contraction { contraction: 0.1 });
        // Entered at its goal: nothing moves, and after five calm periods the loop rests.
        for _ in 0..5 {
            assert_eq!(periods(&mut controller, &config, 1, held), Command::CLOSED);
        }
        assert_eq!(periods(&mut controller, &config, 1, held), Command::CLOSED);
        assert_eq!(controller.mode(), Mode::ContractionHeld);
        let nudged = |by_m: f32| feedback(balance_pa(&config), LENGTH_M + by_m);
        periods(&mut controller, &config, 3, nudged(2.6e-4));
        assert_eq!(controller.mode(), Mode::ContractionHeld, "within one and a half dead zones");
        periods(&mut controller, &config, 1, nudged(2.8e-4));
        assert_eq!(controller.mode(), Mode::Contraction, "beyond it");
        periods(&mut controller, &config, 8, held);
        assert_eq!(controller.mode(), Mode::ContractionHeld);
        set(&mut controller, SetPoint::Contraction { contraction: 0.15 });
        let command = periods(&mut controller, &config, 1, held);
        assert_eq!(controller.mode(), Mode::Contraction);
        assert!(command.inlet > Duty::ZERO && command.outlet == Duty::ZERO);
    }

    /// A set point that needs more pressure than allowed stops a little below the limit, and is marked as limited.
    #[test]
    fn the_working_limit_is_not_passed() {
        let config = Config::default();
        let limit_pa = config.working_limit_pa();
        assert!((6.5e5..6.7e5).contains(&limit_pa) && limit_pa < config.pressure_limit_pa);
        let flow = SetPoint::MassFlow { flow_kg_s: 1.0e-3 };
        let cycle = SetPoint::MassFlowCycle { flow_kg_s: 1.0e-3, period_s: 2.0 };
        for filling in [flow, cycle, SetPoint::Pressure { pressure_pa: 6.8e5 }] {
            let mut controller = Controller::new(&config);
            set(&mut controller, filling);
            let above = feedback(limit_pa + 100.0, LENGTH_M);
            let command = periods(&mut controller, &config, 1, above);
            assert_eq!((command.inlet, controller.limited()), (Duty::ZERO, true), "{filling:?}");
            let mut controller = Controller::new(&config);
            set(&mut controller, filling);
            let below = feedback(limit_pa - 2.0e4, LENGTH_M);
            assert!(periods(&mut controller, &config, 2, below).inlet > Duty::ZERO, "{filling:?}");
        }
        let mut controller = Controller::new(&config);
        set(&mut controller, SetPoint::Contraction { contraction: 0.35 });
        for _ in 0..200 {
            periods(&mut controller, &config, 1, feedback(3.0e5, 0.22));
        }
        assert!(controller.limited());
        assert_eq!(
            periods(&mut controller, &config, 2, feedback(limit_pa, 0.22)).inlet,
            Duty::ZERO
        );
    }

    #[test]
    fn only_what_asks_for_too_much_is_marked_as_limited() {
        let config = Config::default();
        let mut controller = Controller::new(&config);
        let near = feedback(config.working_limit_pa() - 100.0, LENGTH_M);
        for (set_point, limited) in [
            (SetPoint::MassFlow { flow_kg_s: 1.0e-3 }, true),
            (SetPoint::MassFlow { flow_kg_s: -1.0e-3 }, false),
            (SetPoint::Pressure { pressure_pa: 6.8e5 }, true),
            (SetPoint::Pressure { pressure_pa: 5.0e5 }, false),
            (SetPoint::Pressure { pressure_pa: 6.8e5 }, true),
            (SetPoint::Vent, false),
        ] {
            set(&mut controller, set_point);
            periods(&mut controller, &config, 1, near);
            assert_eq!(controller.limited(), limited, "{set_point:?}");
        }
    }

    /// The PWM of the board continues while steps are left out.
    #[test]
    fn missed_steps_do_not_shift_the_period() {
        let config = Config::default();
        let now = feedback(2.0e5, LENGTH_M);
        let muscle = chamber(&config);
        let step = |controller: &mut Controller, missed_steps| {
            controller.step(&config, &muscle, &now, missed_steps)
        };
        let mut controller = Controller::new(&config);
        step(&mut controller, 0);
        set(&mut controller, SetPoint::Duty { inlet: 0.4, outlet: 0.0 });
        for _ in 1..5 {
            assert_eq!(step(&mut controller, 0), Command::VENT);
        }
        // Steps 5 to 8 and 9: the tenth begins a period.
        assert_eq!(step(&mut controller, 4), Command::VENT);
        assert_ne!(step(&mut controller, 0), Command::VENT);
        // Over a whole period and into the next one.
        assert_ne!(step(&mut controller, 13), Command::VENT);
        set(&mut controller, SetPoint::Duty { inlet: 0.0, outlet: 0.0 });
        for count in 25..30 {
            assert_ne!(step(&mut controller, 0), Command::CLOSED, "step {count}");
        }
        assert_eq!(step(&mut controller, 0), Command::CLOSED, "step 30");
    }

    /// Friction softens with the wall at every PWM period.
    #[test]
    fn softening_follows_the_wall_at_every_period() {
        for period_steps in [1, 2, 3, 10, 1000] {
            let config = Config { pwm_period_steps: period_steps, ..Config::default() };
            let mut controller = Controller::new(&config);
            let mut warm = feedback(2.0e5, LENGTH_M);
            warm.estimate.wall_k = 318.0;
            periods(&mut controller, &config, 2, warm);
            let expected = config.friction.softening(318.0);
            assert_eq!(controller.softening, expected, "{period_steps} steps");
        }
    }

    /// A change of mode at rest moves next to nothing, whatever the real load.
    #[test]
    fn a_change_of_mode_is_bumpless() {
        let config = Config::default();
        for off_pa in [-4.0e4, -1.0e4, 0.0, 1.0e4, 4.0e4] {
            let now = feedback(balance_pa(&config) + off_pa, LENGTH_M);
            let mut controller = Controller::new(&config);
            set(&mut controller, SetPoint::Pressure { pressure_pa: now.pressure_pa });
            periods(&mut controller, &config, 3, now);
            set(&mut controller, SetPoint::Contraction { contraction: 0.1 });
            for _ in 0..8 {
                let command = periods(&mut controller, &config, 1, now);
                assert_eq!(command, Command::CLOSED, "{off_pa} Pa from balance");
            }
        }
    }

    /// Eq. (6) backwards: dP/dt of the mass that [`ChamberPort::mass_kg`] returns is the requested one.
    #[test]
    fn mass_is_eq_6_solved_for_it() {
        let config = Config::default();
        let mut controller = Controller::new(&config);
        controller.length_m = LENGTH_M + 1.0e-3;
        let now = feedback(3.0e5, LENGTH_M);
        let muscle = chamber(&config);
        let port = controller.port(&config, &muscle, &now);
        let change_m3 = controller.volume_change_m3(&muscle, &now);
        let mass_kg = port.mass_kg(5_000.0, change_m3);
        let gas = crate::physics::gas::GasVolume {
            pressure_pa: 3.0e5,
            temperature_k: 298.0,
            volume_m3: port.volume_m3,
            volume_rate_m3_s: change_m3 / port.period_s,
            inflow_kg_s: mass_kg / port.period_s,
            outflow_kg_s: 0.0,
        };
        let rate = crate::physics::gas::pressure_rate_adiabatic(&config.gas, &gas);
        assert!(change_m3 > 1.0e-6, "it contracts");
        assert!((rate * port.period_s / 5_000.0 - 1.0).abs() < 1e-3, "{rate} Pa/s");
    }

    /// The cycle of 0.2 s turns every ten PWM periods, on a muscle whose gas follows it.
    #[test]
    fn a_cycle_turns_in_the_middle_and_at_the_end_of_its_period() {
        let config = Config::default();
        let mut controller = Controller::new(&config);
        set(&mut controller, SetPoint::MassFlowCycle { flow_kg_s: 1.0e-3, period_s: 0.2 });
        let volume_m3 = chamber(&config).volume_m3(LENGTH_M);
        for period in 0..60_u16 {
            let phase = period % 20;
            let moved_kg = 1.0e-5 * f32::from(phase.min(20 - phase));
            let pressure_pa = 3.0e5 + moved_kg * 287.05 * 298.0 / volume_m3;
            let command = periods(&mut controller, &config, 1, feedback(pressure_pa, LENGTH_M));
            let (fills, empties) = (command.inlet > Duty::ZERO, command.outlet > Duty::ZERO);
            assert_eq!((fills, empties), (phase < 10, phase >= 10), "period {period}");
        }
    }

    /// A piston in a cylinder of 0.01 m2 that yields by a millimetre takes 10 ml more.
    #[test]
    fn a_volume_that_grows_is_filled_up() {
        let vessel = ChamberConfig::Vessel(Vessel { section_m2: 0.01, surface_m2: 0.1 });
        let config = Config { chamber: vessel, ..Config::default() };
        let vessel = chamber(&config);
        let mut controller = Controller::new(&config);
        let at = |length_m| feedback(3.0e5, length_m);
        assert_eq!(controller.volume_change_m3(&vessel, &at(0.3)), 0.0, "nothing to compare with");
        periods(&mut controller, &config, 1, at(0.3));
        for (length_m, expected_m3) in [(0.301, 1.0e-5), (0.298, -2.0e-5)] {
            let change_m3 = controller.volume_change_m3(&vessel, &at(length_m));
            assert!((change_m3 / expected_m3 - 1.0).abs() < 1e-3, "{change_m3} m3");
        }
        let fresh = Controller::new(&config);
        assert_eq!(fresh.volume_change_m3(&vessel, &at(0.3)), 0.0);
    }

    /// Inflow has the temperature of the supply, outflow that of the gas: of warm gas, less mass is moved.
    #[test]
    fn gas_passes_the_port_at_its_own_temperature() {
        let mut config = Config::default();
        config.supply.temperature_k = 280.0;
        let controller = Controller::new(&config);
        let mut now = feedback(3.0e5, LENGTH_M);
        now.estimate.gas_k = 330.0;
        let port = controller.port(&config, &chamber(&config), &now);
        let energy_j = port.volume_m3 * 1.0e4 / 1.4;
        for (change_pa, port_k) in [(1.0e4, 280.0), (-1.0e4, 330.0)] {
            let expected_kg = (change_pa / 1.0e4) * energy_j / (287.05 * port_k);
            let mass_kg = port.mass_kg(change_pa, 0.0);
            assert!((mass_kg / expected_kg - 1.0).abs() < 1e-4, "{mass_kg} kg");
        }
        assert!((port.period_s * 100.0 - 1.0).abs() < 1e-6 && (port.pwm_hz - 100.0).abs() < 1e-3);
        let gas_kg = 3.0e5 * port.volume_m3 / (287.05 * 330.0);
        assert!((port.gas_mass_kg() / gas_kg - 1.0).abs() < 1e-4);
    }

    /// A load that swings on the gas of a muscle at the limit compresses it with both valves shut.
    #[test]
    fn a_contraction_spills_what_is_well_beyond_the_working_limit() {
        let config = Config::default();
        let limit_pa = config.working_limit_pa();
        for (share, spills) in [(1.005, false), (1.02, true)] {
            let mut controller = Controller::new(&config);
            set(&mut controller, SetPoint::Contraction { contraction: 0.35 });
            for _ in 0..200 {
                periods(&mut controller, &config, 1, feedback(3.0e5, 0.22));
            }
            let command = periods(&mut controller, &config, 2, feedback(share * limit_pa, 0.22));
            assert_eq!(
                (command.inlet, command.outlet > Duty::ZERO),
                (Duty::ZERO, spills),
                "{share}"
            );
        }
    }

    /// One period moves no more than reaches the working limit, and marks the set point as limited.
    #[test]
    fn a_period_brings_no_more_than_leads_to_the_working_limit() {
        let config = Config::default();
        let mut controller = Controller::new(&config);
        let muscle = chamber(&config);
        let port = controller.port(
            &config,
            &muscle,
            &feedback(config.working_limit_pa() - 5000.0, LENGTH_M),
        );
        let room_kg = port.mass_kg(5000.0, 0.0);
        for (wanted, brought, limited) in
            [(-2.0, -2.0, false), (0.5, 0.5, false), (1.5, 1.0, true), (0.5, 0.5, true)]
        {
            let kg = controller.limited_kg(&port, wanted * room_kg);
            assert!((kg / room_kg - brought).abs() < 1e-3, "{kg} kg");
            assert_eq!(controller.limited(), limited, "limited stays until the next period");
        }
    }
}
