//! Whole lives of a core: any configuration, any samples, any requests at any time.

use crate::any::{self, Choices, byte};
use crate::config;
use crate::flush::flushed;
use crate::signal::Signal;
use arbitrary::Unstructured;
use model_core::control::Mode;
use model_core::{
    Command, Config, Core, Duty, Estimate, Faults, RawCode, Sample, SetPoint, Telemetry,
};
use rand_xoshiro::Xoshiro128PlusPlus;
use rand_xoshiro::rand_core::{Rng, SeedableRng};
use thermyo_runs::replay::identical;

/// Venting faults, as in the table of `model_core::safety::supervisor`.
const VENTING: Faults = Faults::EMERGENCY_STOP
    .with(Faults::PRESSURE_SENSOR)
    .with(Faults::OVERPRESSURE)
    .with(Faults::LINK_LOST)
    .with(Faults::MISSED_STEPS)
    .with(Faults::NOT_CONFIGURED)
    .with(Faults::GAS_GAINED)
    .with(Faults::BURST)
    .with(Faults::NO_INFLOW)
    .with(Faults::NO_OUTFLOW)
    .with(Faults::FORCE)
    .with(Faults::GAS_LOST);

/// Limits of gas and wall temperature \[K\].
const POSSIBLE_K: std::ops::RangeInclusive<f32> = 100.0..=1000.0;

/// Largest number of requests of a case.
const MOST_REQUESTS: usize = 100;

/// Steps between two requests. Long pauses are rare, so that a case takes milliseconds.
const STEPS: [u16; 16] = [1, 2, 5, 9, 10, 11, 20, 30, 49, 50, 70, 100, 200, 400, 1000, 3000];

/// Runs one life; returns its steps.
pub fn run(bytes: &[u8]) -> u64 {
    let mut bytes = Unstructured::new(bytes);
    let mut life = Life::new(&mut bytes);
    for _ in 0..MOST_REQUESTS {
        life.request(&mut bytes);
        life.steps(&mut bytes);
        if bytes.is_empty() {
            break;
        }
    }
    life.step
}

struct Life {
    core: Core,
    /// The same core, run with subnormal numbers as zeros.
    flushed: Core,
    /// The last set point since the core vented for any cause.
    set_point: SetPoint,
    /// The set point behind the duties of this PWM period.
    held: SetPoint,
    armed: bool,
    /// Steps since the PWM period began, without the coming one.
    elapsed_steps: u16,
    latched: Faults,
    command: Command,
    pressure: Signal,
    gas: Signal,
    length: Signal,
    random: Xoshiro128PlusPlus,
    step: u64,
}

impl Life {
    fn new(bytes: &mut Unstructured) -> Self {
        let (core, other) = match byte(bytes) % 8 {
            7 => (
                Core::unconfigured().expect("it holds"),
                flushed(|| Core::unconfigured().expect("it holds")),
            ),
            _ => started(&config::from_bytes(bytes)),
        };
        Self {
            armed: core.armed_pa().is_some(),
            core,
            flushed: other,
            set_point: SetPoint::Vent,
            held: SetPoint::Vent,
            elapsed_steps: 0,
            latched: Faults::NONE,
            command: Command::VENT,
            pressure: Signal::usual(7770),
            gas: Signal::usual(15_950),
            length: Signal::usual(23_757),
            random: Xoshiro128PlusPlus::seed_from_u64(u64::from(byte(bytes))),
            step: 0,
        }
    }

    /// Requests between two steps.
    fn request(&mut self, bytes: &mut Unstructured) {
        match byte(bytes) % 16 {
            0 => {}
            1 => {
                self.core.vent();
                flushed(|| self.flushed.vent());
                self.let_go();
            }
            2 | 3 => {
                self.core.clear_faults();
                flushed(|| self.flushed.clear_faults());
                self.let_go();
                self.latched = self.core.supervisor().latched();
            }
            6 => self.arm(None),
            14 => {
                let most_pa = self.core.config().pressure_limit_pa * config::share(bytes);
                self.arm(Some(most_pa));
            }
            15 => {
                self.core.disarm();
                flushed(|| self.flushed.disarm());
                self.let_go();
                self.armed = false;
            }
            4 => {
                let config = config::from_bytes(bytes);
                self.restart(&config, set_point(bytes, &config));
            }
            5 => {
                let config = *self.core.config();
                self.restart(&config, set_point(bytes, &config));
            }
            _ => {
                let set_point = set_point(bytes, self.core.config());
                self.set(set_point);
            }
        }
        self.keeps_latched_faults();
        match byte(bytes) % 4 {
            0 => {}
            1 => self.pressure.change(bytes),
            2 => self.length.change(bytes),
            _ => self.gas.change(bytes),
        }
    }

    fn restart(&mut self, config: &Config, set_point: SetPoint) {
        let (mut core, mut other) = started(config);
        let taken = core.set(set_point).is_ok();
        self.same(taken == flushed(|| other.set(set_point)).is_ok());
        self.core.restart_as(&core);
        flushed(|| self.flushed.restart_as(&other));
        self.let_go();
        if taken && self.armed {
            self.set_point = set_point;
        }
        self.elapsed_steps = 0;
    }

    fn arm(&mut self, most_pa: Option<f32>) {
        let armed = self.core.arm(most_pa).is_ok();
        let other = flushed(|| self.flushed.arm(most_pa)).is_ok();
        self.same(armed == other);
        if armed {
            self.let_go();
            self.armed = true;
        }
        self.latched = self.core.supervisor().latched();
    }

    fn set(&mut self, set_point: SetPoint) {
        let before = self.core.clone();
        let taken = self.core.set(set_point).is_ok();
        let other = flushed(|| self.flushed.set(set_point)).is_ok();
        self.same(taken == other);
        if taken && set_point == SetPoint::Vent {
            self.let_go();
        } else if taken {
            self.set_point = set_point;
        } else {
            self.holds(self.core == before, "a refused set point changes nothing", None);
        }
    }

    /// Lets go: from now on it vents, without grace, until another set point arrives.
    fn let_go(&mut self) {
        self.set_point = SetPoint::Vent;
        self.held = SetPoint::Vent;
    }

    /// Whether a PWM period begins in a step, before which `missed_steps` were missed.
    fn begins_period(&mut self, missed_steps: u8) -> bool {
        let period_steps = self.core.config().pwm_period_steps;
        let elapsed_steps = (self.elapsed_steps + u16::from(missed_steps)) % period_steps;
        self.elapsed_steps = (elapsed_steps + 1) % period_steps;
        elapsed_steps == 0
    }

    fn steps(&mut self, bytes: &mut Unstructured) {
        let steps = *any::one_of(bytes, &STEPS);
        let flags = byte(bytes);
        for step in 0..steps {
            // The first step of sixteen, if at all.
            let now = |flag: u8| flags & flag == flag && step % 16 == 0;
            let [pressure, gas] = [&mut self.pressure, &mut self.gas]
                .map(|signal| signal.next(self.command, &mut self.random).0);
            let sensors = &self.core.config().sensors;
            let sample = Sample {
                pressure: RawCode::from_bits(pressure, sensors.pressure_part.is_digital()),
                gas: RawCode::from_bits(gas, sensors.gas_element.is_digital()),
                length: self.length.next(self.command, &mut self.random),
                emergency_stop: now(0b0000_0111),
                heard: flags & 0b0001_1000 != 0b0001_1000,
                flooded: now(0b0010_0000),
                missed_steps: if now(0b1100_0000) { self.random.next_u32() as u8 } else { 0 },
            };
            self.one_step(&sample);
        }
    }

    fn one_step(&mut self, sample: &Sample) {
        let telemetry = self.core.step(sample);
        let other = flushed(|| self.flushed.step(sample));
        let about = Some(&telemetry);
        if !identical(&telemetry, &other) {
            self.violated("subnormal numbers do not matter", &[about, Some(&other)]);
        }

        let Telemetry { pressure_pa, length_m, estimate, command, mode, faults, .. } = telemetry;
        let Estimate {
            gas_k, gas_sd_k, wall_k, sensor_k, mass_kg, heat_scale, sensor_lag_s, ..
        } = estimate;
        let finite = [pressure_pa, length_m, gas_sd_k, sensor_k, mass_kg, heat_scale, sensor_lag_s]
            .iter()
            .all(|number| number.is_finite());
        self.holds(finite, "every number is finite", about);
        self.holds(POSSIBLE_K.contains(&gas_k), "a possible gas temperature", about);
        self.holds(POSSIBLE_K.contains(&wall_k), "a possible wall temperature", about);
        self.holds(gas_sd_k > 0.0, "a deviation above zero", about);
        self.holds(mass_kg > 0.0, "a mass above zero", about);

        let checking = mode == Mode::StartupCheck;
        let faulty = faults.intersects(VENTING);
        if faulty {
            self.let_go();
            self.armed = false;
        }
        let begins = !checking && self.begins_period(sample.missed_steps);
        if begins {
            self.held = self.set_point;
        }
        let vents = command == Command::VENT;
        self.holds(vents || !faulty, "faults vent", about);
        self.holds(vents || !checking, "it vents in the startup check", about);
        self.holds(self.core.armed_pa().is_some() == self.armed, "what vents disarms", about);
        let inlet = command.inlet > Duty::ZERO;
        let shut = sample.emergency_stop || !self.armed;
        self.holds(!(inlet && shut), "who is stopped or unarmed has a closed inlet", about);
        if self.held == SetPoint::Vent {
            self.holds(vents, "it vents until a set point is given", about);
        } else if begins {
            self.asked_for(&telemetry);
        } else {
            let same = command == self.command;
            self.holds(same, "openings change where a period begins", about);
        }
        self.keeps_latched_faults();
        self.holds(faults.of(self.latched) == self.latched, "what is latched shows", about);

        self.latched = self.core.supervisor().latched();
        self.command = command;
        self.step += 1;
    }

    /// Checks that the set point allows the duties at the beginning of a period.
    fn asked_for(&self, telemetry: &Telemetry) {
        let about = Some(telemetry);
        let Command { inlet, outlet } = telemetry.command;
        let (fills, empties) = (inlet > Duty::ZERO, outlet > Duty::ZERO);
        if let SetPoint::Duty { inlet: asked_inlet, outlet: asked_outlet } = self.held {
            let asked = (Duty::from_share(asked_inlet), Duty::from_share(asked_outlet));
            self.holds((inlet, outlet) == asked, "a duty is the one asked for", about);
            return;
        }
        self.holds(!(fills && empties), "one valve is open at a time", about);
        if let SetPoint::MassFlow { flow_kg_s } = self.held {
            let backwards = fills && flow_kg_s <= 0.0 || empties && flow_kg_s >= 0.0;
            self.holds(!backwards, "a mass flow has pulses of its own direction", about);
        }
        let limit_pa = self.core.config().working_limit_pa();
        let limit_pa = self.core.armed_pa().map_or(limit_pa, |armed_pa| armed_pa.min(limit_pa));
        let above = fills && telemetry.pressure_pa >= limit_pa;
        self.holds(!above, "no pulse of the inlet begins above the working limit", about);
    }

    fn keeps_latched_faults(&self) {
        let latched = self.core.supervisor().latched();
        self.holds(latched.of(self.latched) == self.latched, "what is latched stays", None);
    }

    /// `same`: both cores have accepted a set point, or refused it.
    fn same(&self, same: bool) {
        self.holds(same, "subnormal numbers do not matter to what is taken", None);
    }

    #[track_caller]
    fn holds(&self, holds: bool, what: &str, telemetry: Option<&Telemetry>) {
        if !holds {
            self.violated(what, &[telemetry]);
        }
    }

    #[cold]
    #[track_caller]
    fn violated(&self, what: &str, telemetry: &[Option<&Telemetry>]) {
        panic!(
            "does not hold: {what}\nstep {}, {:?}\n{}\n{telemetry:#?}",
            self.step,
            self.set_point,
            config::differences(self.core.config()),
        );
    }
}

/// A core, and the same core for subnormal numbers as zeros.
fn started(config: &Config) -> (Core, Core) {
    let new = || Core::new(config).expect("every configuration that is checked is taken");
    (new(), flushed(new))
}

/// A set point, mostly one that is accepted.
fn set_point(bytes: &mut Unstructured, config: &Config) -> SetPoint {
    let kind = byte(bytes) % 16;
    if kind >= 12 {
        return any::value(bytes).unwrap_or_default();
    }
    let mut share = || bytes.whole(16) as f32 / 65_535.0;
    match kind {
        0 => SetPoint::Vent,
        1 => SetPoint::Duty { inlet: share(), outlet: share() },
        2 => SetPoint::Duty { inlet: share(), outlet: 0.0 },
        3 => SetPoint::MassFlow { flow_kg_s: 2.0 * share() - 1.0 },
        4 => SetPoint::MassFlow { flow_kg_s: (2.0 * share() - 1.0) * 1.0e-3 },
        5 => SetPoint::MassFlowCycle { flow_kg_s: 1.0e-3 * share(), period_s: 10.0 * share() },
        6 => SetPoint::MassFlowCycle { flow_kg_s: share(), period_s: 86_400.0 * share() },
        7..=9 => SetPoint::Pressure { pressure_pa: config.pressure_limit_pa * share() },
        _ => SetPoint::Contraction { contraction: 0.45 * share() },
    }
}
