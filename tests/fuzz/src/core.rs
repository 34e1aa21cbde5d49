//! Whole lives of a core: any configuration, any samples, whatever the host asks and whenever.

use crate::any::{self, Choices, byte};
use crate::config;
use crate::flush::flushed;
use crate::signal::Signal;
use arbitrary::Unstructured;
use model_core::control::Mode;
use model_core::{Command, Config, Core, Duty, Estimate, Faults, Sample, SetPoint, Telemetry};
use rand_xoshiro::Xoshiro128PlusPlus;
use rand_xoshiro::rand_core::{Rng, SeedableRng};
use thermyo_runs::replay::identical;

/// Faults that vent, as the table of `model_core::safety::supervisor` has them.
const VENTING: Faults = Faults::EMERGENCY_STOP
    .with(Faults::PRESSURE_SENSOR)
    .with(Faults::OVERPRESSURE)
    .with(Faults::LINK_LOST)
    .with(Faults::MISSED_STEPS)
    .with(Faults::NOT_CONFIGURED);

/// Temperatures beyond which neither gas nor wall lies \[K\].
const POSSIBLE_K: std::ops::RangeInclusive<f32> = 100.0..=1000.0;

/// Requests of one case.
const MOST_REQUESTS: usize = 100;

/// The steps between two requests. Long ones are rare, so that a case takes milliseconds.
const STEPS: [u16; 16] = [1, 2, 5, 9, 10, 11, 20, 30, 49, 50, 70, 100, 200, 400, 1000, 3000];

/// Lives one life; returns its steps.
///
/// # Panics
/// Where something does not hold.
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
    /// The same core where subnormal numbers are zeros.
    flushed: Core,
    set_point: SetPoint,
    /// Steps for which a set point that opened both valves may still do so.
    both_steps: u32,
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
            core,
            flushed: other,
            set_point: SetPoint::Vent,
            both_steps: 0,
            latched: Faults::NONE,
            command: Command::VENT,
            pressure: Signal::usual(7770),
            gas: Signal::usual(15_950),
            length: Signal::usual(23_757),
            random: Xoshiro128PlusPlus::seed_from_u64(u64::from(byte(bytes))),
            step: 0,
        }
    }

    /// What the host asks between two steps.
    fn request(&mut self, bytes: &mut Unstructured) {
        match byte(bytes) % 16 {
            0 => {}
            1 => {
                self.core.vent();
                flushed(|| self.flushed.vent());
                self.set_point = SetPoint::Vent;
                self.both_steps = 0;
            }
            2 | 3 => {
                self.core.clear_faults();
                flushed(|| self.flushed.clear_faults());
                self.let_go();
                self.set_point = SetPoint::Vent;
                self.latched = self.core.supervisor().latched();
            }
            6 => {
                let armed = self.core.arm(None).is_ok();
                let flushed_armed = flushed(|| self.flushed.arm(None)).is_ok();
                self.same(armed == flushed_armed);
                if armed {
                    self.let_go();
                    self.set_point = SetPoint::Vent;
                }
                self.latched = self.core.supervisor().latched();
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
        self.keeps_what_is_latched();
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
        self.core.restart_as(core);
        flushed(|| self.flushed.restart_as(other));
        let driven = taken && self.core.armed_pa().is_some();
        self.set_point = if driven { set_point } else { SetPoint::Vent };
        self.both_steps = 0;
    }

    fn set(&mut self, set_point: SetPoint) {
        let before = self.core.clone();
        let taken = self.core.set(set_point).is_ok();
        let other = flushed(|| self.flushed.set(set_point)).is_ok();
        self.same(taken == other);
        if taken {
            self.let_go();
            self.set_point = set_point;
        } else {
            self.holds(self.core == before, "a refused set point changes nothing", None);
        }
    }

    /// Another set point holds from the next period on.
    fn let_go(&mut self) {
        if opens_both(self.set_point) {
            self.both_steps = u32::from(self.core.config().pwm_period_steps);
        }
    }

    fn steps(&mut self, bytes: &mut Unstructured) {
        let steps = *any::one_of(bytes, &STEPS);
        let flags = byte(bytes);
        for step in 0..steps {
            // The first step of sixteen, where at all.
            let now = |flag: u8| flags & flag == flag && step % 16 == 0;
            let sample = Sample {
                pressure: self.pressure.next(self.command, &mut self.random),
                gas: self.gas.next(self.command, &mut self.random),
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

        let vents = command == Command::VENT;
        self.holds(vents || !faults.intersects(VENTING), "faults vent", about);
        self.holds(vents || mode != Mode::Judging, "it vents while it judges", about);
        let inlet = command.inlet > Duty::ZERO;
        self.holds(!(inlet && sample.emergency_stop), "the emergency stop closes the inlet", about);
        let both = inlet && command.outlet > Duty::ZERO;
        let asked = opens_both(self.set_point) || self.both_steps > 0;
        self.holds(!both || asked, "both valves are open only where both are asked for", about);
        self.keeps_what_is_latched();
        self.holds(faults.of(self.latched) == self.latched, "what is latched shows", about);

        self.latched = self.core.supervisor().latched();
        if faults.intersects(VENTING) {
            self.let_go();
            self.set_point = SetPoint::Vent;
        }
        self.both_steps = self.both_steps.saturating_sub(1);
        self.command = command;
        self.step += 1;
    }

    fn keeps_what_is_latched(&self) {
        let latched = self.core.supervisor().latched();
        self.holds(latched.of(self.latched) == self.latched, "what is latched stays", None);
    }

    /// `same`: both cores have taken a set point, or refused it.
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

/// A core and the same one where subnormal numbers are zeros.
fn started(config: &Config) -> (Core, Core) {
    let new = || Core::new(config).expect("every configuration that is checked is taken");
    (new(), flushed(new))
}

fn opens_both(set_point: SetPoint) -> bool {
    matches!(set_point, SetPoint::Duty { inlet, outlet } if inlet > 0.0 && outlet > 0.0)
}

/// A set point, mostly one that is taken.
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
