//! Inputs and outputs of a step: raw codes in, duties out.

/// Conversions of the 12-bit ADC that are added up into one code.
pub const OVERSAMPLING: u16 = 8;
/// Largest code: eight conversions of 4095.
pub const CODE_MAX: u16 = OVERSAMPLING * 4095;

/// Sum of [`OVERSAMPLING`] conversions of one channel, 0 to [`CODE_MAX`]; of a digital part the last reading, 15
/// bits, whose lowest bit marks whether it is [fresh](Self::is_fresh).
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
#[cfg_attr(feature = "link", derive(serde::Serialize, serde::Deserialize))]
pub struct AdcCode(pub u16);

impl AdcCode {
    /// The last reading of a digital part, 15 bits; 0 where the sensor reports a failure. It is fresh in the
    /// one step in which it came.
    ///
    /// ```
    /// use model_core::AdcCode;
    ///
    /// let code = AdcCode::of_part(0x4012, true);
    /// assert!(code.is_fresh() && code.stale() == AdcCode::of_part(0x4012, false));
    /// ```
    pub const fn of_part(reading: u16, fresh: bool) -> Self {
        Self(reading << 1 | fresh as u16)
    }

    /// Whether a digital part's reading has come in this step.
    pub const fn is_fresh(self) -> bool {
        self.0 & 1 != 0
    }

    /// The same reading, no longer fresh.
    pub const fn stale(self) -> Self {
        Self(self.0 & !1)
    }
}

/// Share of a PWM period, 0 to [`Duty::FULL`]; nothing else can be read from a frame either.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
#[cfg_attr(feature = "link", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "link", serde(try_from = "u16", into = "u16"))]
pub struct Duty(pub(crate) u16);

/// More than [`Duty::FULL`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NoDuty(pub u16);

impl core::fmt::Display for NoDuty {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "a duty of {}: must be from 0 to {}", self.0, Duty::FULL.0)
    }
}

impl core::error::Error for NoDuty {}

impl TryFrom<u16> for Duty {
    type Error = NoDuty;

    fn try_from(ticks: u16) -> Result<Self, NoDuty> {
        if ticks <= Self::FULL.0 { Ok(Self(ticks)) } else { Err(NoDuty(ticks)) }
    }
}

impl From<Duty> for u16 {
    fn from(duty: Duty) -> Self {
        duty.0
    }
}

impl Duty {
    /// Not at all.
    pub const ZERO: Self = Self(0);
    /// The whole period.
    pub const FULL: Self = Self(50_000);

    /// The duty nearest to `share`, which is limited to 0 ..= 1 (NaN: 0).
    ///
    /// ```
    /// use model_core::Duty;
    ///
    /// assert_eq!(Duty::from_share(0.5).ticks(), 25_000);
    /// assert_eq!(Duty::from_share(f32::NAN), Duty::ZERO);
    /// ```
    pub fn from_share(share: f32) -> Self {
        let limited = crate::math::limit(share, 0.0, 1.0);
        Self((limited * f32::from(Self::FULL.0) + 0.5) as u16)
    }

    /// The duty in ticks; a period has 50 000.
    pub const fn ticks(self) -> u16 {
        self.0
    }

    /// Share of the period, 0 to 1.
    pub fn share(self) -> f32 {
        f32::from(self.0) * (1.0 / 50_000.0)
    }

    /// The rest of the period.
    pub const fn complement(self) -> Self {
        Self(Self::FULL.0.saturating_sub(self.0))
    }
}

/// Everything that one step takes in: the same samples and set points give the same outputs, to the
/// bit, on every machine.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "link", derive(serde::Serialize, serde::Deserialize))]
pub struct Sample {
    /// ADC0: muscle pressure.
    pub pressure: AdcCode,
    /// ADC1: gas temperature.
    pub gas: AdcCode,
    /// ADC2: muscle length.
    pub length: AdcCode,
    /// The emergency stop line is open or low.
    pub emergency_stop: bool,
    /// A request of the host has come since the step before.
    pub heard: bool,
    /// The host asks more than is carried out.
    pub flooded: bool,
    /// Steps that were left out before this one.
    pub missed_steps: u8,
}

impl Sample {
    /// Codes from a board that has nothing else to tell: not stopped, in time, its host heard.
    ///
    /// ```
    /// use model_core::{AdcCode, Sample};
    ///
    /// let sample = Sample::new(AdcCode(7770), AdcCode(15_950), AdcCode(23_757));
    /// assert!(sample.heard && !sample.emergency_stop);
    /// ```
    pub const fn new(pressure: AdcCode, gas: AdcCode, length: AdcCode) -> Self {
        Self {
            pressure,
            gas,
            length,
            emergency_stop: false,
            heard: true,
            flooded: false,
            missed_steps: 0,
        }
    }
}

/// Valve openings of one step, as shares of the PWM period in which air passes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "link", derive(serde::Serialize, serde::Deserialize))]
pub struct Command {
    /// Inlet open.
    pub inlet: Duty,
    /// Outlet open.
    pub outlet: Duty,
}

impl Command {
    /// Inlet closed, outlet open: the muscle vents. What the board does without power.
    pub const VENT: Self = Self { inlet: Duty::ZERO, outlet: Duty::FULL };
    /// Both closed: the muscle holds its gas.
    pub const CLOSED: Self = Self { inlet: Duty::ZERO, outlet: Duty::ZERO };

    /// Share of the period in which each coil is powered: the inlet valve is normally closed, the
    /// outlet valve normally open, so that [`Command::VENT`] powers nothing.
    pub const fn coils(self) -> (Duty, Duty) {
        (self.inlet, self.outlet.complement())
    }

    /// Whether the flows are not those of the command before: openings changed by more than a fifth.
    pub fn turns(self, before: Self) -> bool {
        let jumps = |a: Duty, b: Duty| a.0.abs_diff(b.0) > a.0.max(b.0) / 5;
        jumps(before.inlet, self.inlet) || jumps(before.outlet, self.outlet)
    }
}

/// Faults, one bit each. [`crate::safety::supervisor`] lists what follows from each.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "link", derive(serde::Serialize, serde::Deserialize))]
pub struct Faults(pub u16);

impl Faults {
    /// Nothing.
    pub const NONE: Self = Self(0);
    /// The emergency stop line is open or low.
    pub const EMERGENCY_STOP: Self = Self(1 << 0);
    /// The pressure code lies at a rail or stands still: sensor open, shorted, frozen or out of its
    /// range; a digital part is silent.
    pub const PRESSURE_SENSOR: Self = Self(1 << 1);
    /// Pressure above the configured limit.
    pub const OVERPRESSURE: Self = Self(1 << 2);
    /// The gas sensor's code lies at a rail, or stands still; a digital sensor is silent or reports a failure.
    pub const GAS_SENSOR: Self = Self(1 << 3);
    /// The length code lies at a rail, stands still, moves as no muscle can, or is impossible for
    /// the muscle.
    pub const LENGTH_SENSOR: Self = Self(1 << 4);
    /// The host has been silent for longer than `link.timeout_s`.
    pub const LINK_LOST: Self = Self(1 << 5);
    /// The board leaves out steps.
    pub const MISSED_STEPS: Self = Self(1 << 6);
    /// The core runs on defaults: the board has not been configured since it started.
    pub const NOT_CONFIGURED: Self = Self(1 << 7);
    /// The host asks more than the board carries out.
    pub const LINK_FLOODED: Self = Self(1 << 8);

    /// Gas comes while both valves are shut, or as fast as the outlet lets it out: an inlet that leaks or
    /// stands open, or a pressure sensor that drifts.
    pub const GAS_GAINED: Self = Self(1 << 9);
    /// Gas is lost fast: a burst muscle, or an outlet that stands open.
    pub const BURST: Self = Self(1 << 10);
    /// Gas is lost slowly, while both valves are shut or as fast as the inlet makes up for it: muscle,
    /// fittings or outlet leak, or a pressure sensor drifts.
    pub const LEAK: Self = Self(1 << 11);
    /// The inlet is driven and the gas is not there: it is stuck shut, the supply is lost, or a hole takes
    /// all of it.
    pub const NO_INFLOW: Self = Self(1 << 12);
    /// The outlet is driven and the gas stays: it is stuck shut, or the inlet stands open.
    pub const NO_OUTFLOW: Self = Self(1 << 13);
    /// Pressure and length stand for a force that cannot be the load's: one of the two has drifted.
    pub const FORCE: Self = Self(1 << 14);
    /// The gas sensor is a digital part and is lost: it is silent, reports a failure, or reads what lies
    /// outside of its range.
    pub const GAS_LOST: Self = Self(1 << 15);

    /// Every fault and its name, in the order of the bits.
    pub const NAMES: [(Self, &'static str); 16] = [
        (Self::EMERGENCY_STOP, "emergency stop"),
        (Self::PRESSURE_SENSOR, "pressure sensor"),
        (Self::OVERPRESSURE, "overpressure"),
        (Self::GAS_SENSOR, "gas sensor"),
        (Self::LENGTH_SENSOR, "length sensor"),
        (Self::LINK_LOST, "link lost"),
        (Self::MISSED_STEPS, "missed steps"),
        (Self::NOT_CONFIGURED, "not configured"),
        (Self::LINK_FLOODED, "link flooded"),
        (Self::GAS_GAINED, "gas gained"),
        (Self::BURST, "burst"),
        (Self::LEAK, "leak"),
        (Self::NO_INFLOW, "no inflow"),
        (Self::NO_OUTFLOW, "no outflow"),
        (Self::FORCE, "force"),
        (Self::GAS_LOST, "gas sensor lost"),
    ];

    /// These where a condition holds, otherwise none.
    pub const fn when(self, condition: bool) -> Self {
        if condition { self } else { Self::NONE }
    }

    /// Both together.
    pub const fn with(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// The faults that are also in `other`.
    pub const fn of(self, other: Self) -> Self {
        Self(self.0 & other.0)
    }

    /// Their names, in the order of the bits.
    pub fn names(self) -> impl Iterator<Item = &'static str> {
        let held = Self::NAMES.iter().filter(move |(fault, _)| self.intersects(*fault));
        held.map(|(_, name)| *name)
    }

    /// Whether one of `other` is among them.
    pub const fn intersects(self, other: Self) -> bool {
        self.0 & other.0 != 0
    }
}

impl core::fmt::Display for Faults {
    /// Their names, by commas.
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        for (i, name) in self.names().enumerate() {
            write!(f, "{}{name}", if i > 0 { ", " } else { "" })?;
        }
        Ok(())
    }
}

/// The gas temperature and what goes with it, as the core believes it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[cfg_attr(feature = "link", derive(serde::Serialize, serde::Deserialize))]
pub struct Estimate {
    /// Gas temperature \[K\].
    pub gas_k: f32,
    /// Its standard deviation \[K\].
    pub gas_sd_k: f32,
    /// Whether it is to be relied on: its deviation is within `estimator.valid_sd_k`.
    pub valid: bool,
    /// Wall temperature \[K\].
    pub wall_k: f32,
    /// Predicted temperature of the sensor's element \[K\].
    pub sensor_k: f32,
    /// Gas mass \[kg\].
    pub mass_kg: f32,
    /// Factor on the configured heat transfer from gas to wall \[-\].
    pub heat_scale: f32,
    /// Lag of the gas sensor \[s\].
    pub sensor_lag_s: f32,
}

/// Mode of the core.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "link", derive(serde::Serialize, serde::Deserialize))]
pub enum Mode {
    /// Startup check: the core vents and tests the sensors.
    Judging,
    /// Inlet closed, outlet open.
    Vent,
    /// Fixed openings.
    Duty,
    /// A mass flow, constant or in the paper's cycle.
    MassFlow,
    /// The pressure loop acts.
    Pressure,
    /// The pressure is where it should be.
    PressureHeld,
    /// The contraction loop acts.
    Contraction,
    /// The muscle is where it should be.
    ContractionHeld,
}

impl Mode {
    /// Every mode and its name; a mode's index here is its number in a trace.
    pub const NAMES: [(Self, &'static str); 8] = [
        (Self::Judging, "judging the sensors"),
        (Self::Vent, "vent"),
        (Self::Duty, "duty"),
        (Self::MassFlow, "mass flow"),
        (Self::Pressure, "pressure"),
        (Self::PressureHeld, "pressure, held"),
        (Self::Contraction, "contraction"),
        (Self::ContractionHeld, "contraction, held"),
    ];
}

/// The quantity that the core is asked to reach; see [`crate::Core::set`].
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[cfg_attr(feature = "link", derive(serde::Serialize, serde::Deserialize))]
pub enum SetPoint {
    /// Inlet closed, outlet open.
    #[default]
    Vent,
    /// Fixed openings, as fractions of the PWM period.
    Duty {
        /// Inlet open, 0 to 1 \[-\].
        inlet: f32,
        /// Outlet open, 0 to 1 \[-\].
        outlet: f32,
    },
    /// A mass flow into the muscle, negative out of it \[kg/s\].
    MassFlow {
        /// Flow, -1 to 1 \[kg/s\].
        flow_kg_s: f32,
    },
    /// The paper's working cycle: half of the period in, half out.
    MassFlowCycle {
        /// Flow in either direction, 0 to 1 \[kg/s\].
        flow_kg_s: f32,
        /// Period, four PWM periods to a day \[s\].
        period_s: f32,
    },
    /// An absolute pressure \[Pa\].
    Pressure {
        /// Pressure, 0 to the configured limit \[Pa\].
        pressure_pa: f32,
    },
    /// A contraction, as a fraction of the rest length, negative beyond it \[-\].
    Contraction {
        /// Contraction, within what the chamber can have \[-\].
        contraction: f32,
    },
}

/// Everything that one step leaves behind.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "link", derive(serde::Serialize, serde::Deserialize))]
pub struct Telemetry {
    /// Number of the step, from 0 once the sensors are judged; wraps.
    pub step: u32,
    /// The inputs.
    pub sample: Sample,
    /// Measured absolute pressure \[Pa\].
    pub pressure_pa: f32,
    /// Measured length \[m\].
    pub length_m: f32,
    /// The estimate.
    pub estimate: Estimate,
    /// The openings for this step.
    pub command: Command,
    /// Mode of the core.
    pub mode: Mode,
    /// The set point asks for more than the core gives: it holds the pressure below its limit.
    pub limited: bool,
    /// The set point.
    pub set_point: SetPoint,
    /// Faults that hold now or are latched.
    pub faults: Faults,
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn vent_powers_no_coil() {
        assert_eq!(Command::VENT.coils(), (Duty::ZERO, Duty::ZERO));
        assert_eq!(Command::CLOSED.coils(), (Duty::ZERO, Duty::FULL));
    }

    proptest! {
        #[test]
        fn duty_is_a_share(bits in any::<u32>()) {
            let duty = Duty::from_share(f32::from_bits(bits));
            prop_assert!(duty <= Duty::FULL);
            prop_assert_eq!(Duty::from_share(duty.share()), duty);
            prop_assert_eq!(duty.complement().complement(), duty);
        }

        #[test]
        fn a_duty_is_never_more_than_full(ticks in any::<u16>()) {
            prop_assert_eq!(Duty::try_from(ticks).is_ok(), ticks <= 50_000);
        }
    }
}
