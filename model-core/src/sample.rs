//! Inputs and outputs of a step: raw codes in, duties out.

/// Conversions of the 12-bit ADC that are added up into one code.
pub const OVERSAMPLING: u16 = 8;
/// Largest code: eight conversions of 4095.
pub const CODE_MAX: u16 = OVERSAMPLING * 4095;

/// Two bytes, little end first: most codes would take three as a varint on the link.
#[cfg(feature = "serde")]
mod two_bytes {
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub fn serialize<S: Serializer>(number: &u16, serializer: S) -> Result<S::Ok, S::Error> {
        number.to_le_bytes().serialize(serializer)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<u16, D::Error> {
        <[u8; 2]>::deserialize(deserializer).map(u16::from_le_bytes)
    }
}

/// Sum of [`OVERSAMPLING`] conversions of one channel, 0 to [`CODE_MAX`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct AdcCode(#[cfg_attr(feature = "serde", serde(with = "two_bytes"))] pub u16);

/// Reading of a digital part, 15 bits of its own scale; 0 if the part reports a failure.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct PartCode(#[cfg_attr(feature = "serde", serde(with = "two_bytes"))] pub u16);

/// Raw code of one channel in one step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum RawCode {
    /// From the board's converter.
    Adc(AdcCode),
    /// Last reading of a digital part, in the one step in which it arrived.
    Fresh(PartCode),
    /// Last reading of a digital part, in every step after that one.
    Stale(PartCode),
}

impl Default for RawCode {
    fn default() -> Self {
        Self::Adc(AdcCode(0))
    }
}

impl From<AdcCode> for RawCode {
    fn from(code: AdcCode) -> Self {
        Self::Adc(code)
    }
}

impl RawCode {
    /// The last reading of a digital part.
    ///
    /// ```
    /// use model_core::RawCode;
    ///
    /// let code = RawCode::of_part(0x4012, true);
    /// assert!(code.is_fresh() && code.stale() == RawCode::of_part(0x4012, false));
    /// ```
    pub const fn of_part(reading: u16, fresh: bool) -> Self {
        if fresh { Self::Fresh(PartCode(reading)) } else { Self::Stale(PartCode(reading)) }
    }

    /// Whether a digital part's reading has arrived in this step.
    pub const fn is_fresh(self) -> bool {
        matches!(self, Self::Fresh(_))
    }

    /// The same reading, no longer fresh.
    pub const fn stale(self) -> Self {
        match self {
            Self::Fresh(code) => Self::Stale(code),
            Self::Adc(_) | Self::Stale(_) => self,
        }
    }

    /// The converter's code; for a digital part, the code of an open channel.
    pub const fn adc(self) -> AdcCode {
        match self {
            Self::Adc(code) => code,
            Self::Fresh(_) | Self::Stale(_) => AdcCode(0),
        }
    }

    /// One number for a file: the converter's code, or a part's reading followed by a bit that is 1 if it is fresh and
    /// 0 if it is stale.
    pub const fn to_bits(self) -> u16 {
        match self {
            Self::Adc(AdcCode(code)) => code,
            Self::Fresh(PartCode(code)) => code << 1 | 1,
            Self::Stale(PartCode(code)) => code << 1,
        }
    }

    /// Converts back from [`Self::to_bits`]; `digital`: the sensor is a digital part.
    pub const fn from_bits(bits: u16, digital: bool) -> Self {
        if digital { Self::of_part(bits >> 1, bits & 1 != 0) } else { Self::Adc(AdcCode(bits)) }
    }
}

/// Share of a PWM period, in parts of 65 535: every number is a valid duty.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Duty(#[cfg_attr(feature = "serde", serde(with = "two_bytes"))] pub u16);

impl Duty {
    /// Never open.
    pub const ZERO: Self = Self(0);
    /// The whole period.
    pub const FULL: Self = Self(u16::MAX);

    /// The duty nearest to `share`, which is limited to 0 ..= 1 (NaN: 0).
    ///
    /// ```
    /// use model_core::Duty;
    ///
    /// assert_eq!(Duty::from_share(1.0), Duty::FULL);
    /// assert_eq!(Duty::from_share(f32::NAN), Duty::ZERO);
    /// ```
    pub fn from_share(share: f32) -> Self {
        let limited = crate::math::limit(share, 0.0, 1.0);
        Self((limited * f32::from(Self::FULL.0) + 0.5) as u16)
    }

    /// The duty in ticks of a timer with `period` ticks per period, rounded to the nearest.
    ///
    /// ```
    /// use model_core::Duty;
    ///
    /// assert_eq!(Duty::from_share(0.25).ticks(50_000), 12_500);
    /// ```
    pub const fn ticks(self, period: u16) -> u16 {
        let full = Self::FULL.0 as u32;
        // At most 65 535 (65 535 + 1/2), which is below 2^32.
        ((self.0 as u32 * period as u32 + full / 2) / full) as u16
    }

    /// Share of the period, 0 to 1.
    pub fn share(self) -> f32 {
        f32::from(self.0) * (1.0 / 65_535.0)
    }

    /// The remainder of the period.
    pub const fn complement(self) -> Self {
        Self(!self.0)
    }
}

/// Inputs of one step: the same samples and set points give the same outputs, to the bit, on every machine.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[repr(align(4))]
pub struct Sample {
    /// Muscle pressure: ADC0, or a digital part.
    pub pressure: RawCode,
    /// Gas temperature: ADC1, or a digital part.
    pub gas: RawCode,
    /// ADC2: muscle length.
    pub length: AdcCode,
    /// Whether the run line is open or low.
    pub emergency_stop: bool,
    /// Whether a request of the host has come since the step before.
    pub heard: bool,
    /// Whether the host sends more requests than the board carries out.
    pub flooded: bool,
    /// Steps that were left out before this one.
    pub missed_steps: u8,
}

impl Sample {
    /// Creates a sample from codes of the converter only; the board is not stopped, is in time, and hears its host.
    ///
    /// ```
    /// use model_core::{AdcCode, Sample};
    ///
    /// let sample = Sample::new(AdcCode(7770), AdcCode(15_950), AdcCode(23_757));
    /// assert!(sample.heard && !sample.emergency_stop);
    /// ```
    pub const fn new(pressure: AdcCode, gas: AdcCode, length: AdcCode) -> Self {
        Self {
            pressure: RawCode::Adc(pressure),
            gas: RawCode::Adc(gas),
            length,
            emergency_stop: false,
            heard: true,
            flooded: false,
            missed_steps: 0,
        }
    }
}

/// Valve openings of one step, as shares of the PWM period.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[repr(align(4))]
pub struct Command {
    /// Share for which the inlet is open.
    pub inlet: Duty,
    /// Share for which the outlet is open.
    pub outlet: Duty,
}

impl Command {
    /// Inlet closed, outlet open: the muscle vents. Also the state of the valves without power.
    pub const VENT: Self = Self { inlet: Duty::ZERO, outlet: Duty::FULL };
    /// Both closed: the muscle holds its gas.
    pub const CLOSED: Self = Self { inlet: Duty::ZERO, outlet: Duty::ZERO };

    /// Share of the period in which each coil is powered: the inlet valve is normally closed, the
    /// outlet valve normally open, so that [`Command::VENT`] powers nothing.
    pub const fn coils(self) -> (Duty, Duty) {
        (self.inlet, self.outlet.complement())
    }

    /// Whether the flows differ from those of the command before: openings changed by more than a fifth.
    pub fn turns(self, before: Self) -> bool {
        let jumps = |a: Duty, b: Duty| a.0.abs_diff(b.0) > a.0.max(b.0) / 5;
        jumps(before.inlet, self.inlet) || jumps(before.outlet, self.outlet)
    }
}

/// Operations on a set of faults, one bit each: a type with `NONE`, and `NAMES` in the order of the bits.
macro_rules! fault_set {
    ($set:ty) => {
        impl $set {
            /// These faults if a condition holds, otherwise none.
            pub const fn when(self, condition: bool) -> Self {
                if condition { self } else { Self::NONE }
            }

            /// Union of both sets.
            pub const fn with(self, other: Self) -> Self {
                Self(self.0 | other.0)
            }

            /// Names of the faults, in the order of the bits.
            pub fn names(self) -> impl Iterator<Item = &'static str> {
                let held = Self::NAMES.iter().filter(move |(fault, _)| self.intersects(*fault));
                held.map(|(_, name)| *name)
            }

            /// Whether one of `other` is among them.
            pub const fn intersects(self, other: Self) -> bool {
                self.0 & other.0 != 0
            }
        }

        impl core::fmt::Display for $set {
            /// Names of the faults, separated by commas.
            fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
                for (i, name) in self.names().enumerate() {
                    write!(f, "{}{name}", if i > 0 { ", " } else { "" })?;
                }
                Ok(())
            }
        }
    };
}
pub(crate) use fault_set;

fault_set!(Faults);

/// Faults, one bit each. [`crate::safety::supervisor`] lists the consequence of each.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Faults(pub u32);

impl Faults {
    /// No fault.
    pub const NONE: Self = Self(0);
    /// The run line is open or low.
    pub const EMERGENCY_STOP: Self = Self(1 << 0);
    /// The pressure code lies at a rail or is frozen: sensor open, shorted, frozen or out of its range; a digital part
    /// is silent.
    pub const PRESSURE_SENSOR: Self = Self(1 << 1);
    /// Pressure above the configured limit.
    pub const OVERPRESSURE: Self = Self(1 << 2);
    /// The gas sensor's code lies at a rail or is frozen; a digital sensor is silent or reports a failure.
    pub const GAS_SENSOR: Self = Self(1 << 3);
    /// The length code lies at a rail, is frozen, moves as no muscle can, or is impossible for the muscle.
    pub const LENGTH_SENSOR: Self = Self(1 << 4);
    /// The host has been silent for longer than `link.timeout_s`.
    pub const LINK_LOST: Self = Self(1 << 5);
    /// The board leaves out steps.
    pub const MISSED_STEPS: Self = Self(1 << 6);
    /// The core runs on defaults: the board has not been configured since it started.
    pub const NOT_CONFIGURED: Self = Self(1 << 7);
    /// The host sends more requests than the board carries out.
    pub const LINK_FLOODED: Self = Self(1 << 8);

    /// Gas comes in while both valves are shut, or as fast as the outlet releases it: an inlet that leaks or stands
    /// open, or a pressure sensor that drifts.
    pub const GAS_GAINED: Self = Self(1 << 9);
    /// Gas is lost fast: a burst muscle, or an outlet that stands open.
    pub const BURST: Self = Self(1 << 10);
    /// Gas is lost slowly, while both valves are shut or as fast as the inlet replaces it: muscle, fittings or outlet
    /// leak, or a pressure sensor drifts.
    pub const LEAK: Self = Self(1 << 11);
    /// The inlet is driven and no gas arrives: it is stuck shut, the supply is lost, or a hole takes all of the gas.
    pub const NO_INFLOW: Self = Self(1 << 12);
    /// The outlet is driven and the gas stays: it is stuck shut, or the inlet stands open.
    pub const NO_OUTFLOW: Self = Self(1 << 13);
    /// Pressure and length imply a force that cannot be the load's: one of the two has drifted.
    pub const FORCE: Self = Self(1 << 14);
    /// The gas sensor is a digital part and is lost: it is silent, reports a failure, or reads outside its range.
    pub const GAS_LOST: Self = Self(1 << 15);

    /// A joint's angle is lost: [`JointFaults::ANGLE_SENSOR`](crate::joint::JointFaults::ANGLE_SENSOR). This fault and
    /// the next two appear only in the first failure of a joint, never in a step's telemetry.
    pub const JOINT_ANGLE: Self = Self(1 << 16);
    /// A joint's angle moves the wrong way: [`JointFaults::WRONG_WAY`](crate::joint::JointFaults::WRONG_WAY).
    pub const JOINT_WRONG_WAY: Self = Self(1 << 17);
    /// An unexplained torque on a joint: [`JointFaults::TORQUE`](crate::joint::JointFaults::TORQUE).
    pub const JOINT_TORQUE: Self = Self(1 << 18);

    /// Every fault and its name, in the order of the bits.
    pub const NAMES: [(Self, &'static str); 19] = [
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
        (Self::JOINT_ANGLE, "joint's angle sensor"),
        (Self::JOINT_WRONG_WAY, "joint goes the wrong way"),
        (Self::JOINT_TORQUE, "joint's torque"),
    ];

    /// The faults that are also in `other`.
    pub const fn of(self, other: Self) -> Self {
        Self(self.0 & other.0)
    }

    /// These faults, without those in `other`.
    pub const fn without(self, other: Self) -> Self {
        Self(self.0 & !other.0)
    }
}

/// The gas temperature and the quantities estimated with it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Estimate {
    /// Gas temperature \[K\].
    pub gas_k: f32,
    /// Its standard deviation \[K\].
    pub gas_sd_k: f32,
    /// Whether the estimate is reliable: its deviation is within `estimator.valid_sd_k`, and no leak was found.
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
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Mode {
    /// Startup check: the core vents and tests the sensors.
    StartupCheck,
    /// Inlet closed, outlet open.
    Vent,
    /// Fixed openings.
    Duty,
    /// A mass flow, constant or in the paper's cycle.
    MassFlow,
    /// The pressure loop acts.
    Pressure,
    /// The pressure is at its goal and the valves rest.
    PressureHeld,
    /// The contraction loop acts.
    Contraction,
    /// The muscle is at its goal and the valves rest.
    ContractionHeld,
}

impl Mode {
    /// Every mode and its name; a mode's index here is its number in a trace.
    pub const NAMES: [(Self, &'static str); 8] = [
        (Self::StartupCheck, "startup check"),
        (Self::Vent, "vent"),
        (Self::Duty, "duty"),
        (Self::MassFlow, "mass flow"),
        (Self::Pressure, "pressure"),
        (Self::PressureHeld, "pressure, held"),
        (Self::Contraction, "contraction"),
        (Self::ContractionHeld, "contraction, held"),
    ];

    /// Name of the mode, as in messages.
    pub fn name(self) -> &'static str {
        Self::NAMES.iter().find(|(mode, _)| *mode == self).map_or("", |(_, name)| name)
    }
}

/// The quantity that the core is asked to reach; see [`crate::Core::set`].
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
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
        /// Period, from four PWM periods to a day \[s\].
        period_s: f32,
    },
    /// An absolute pressure \[Pa\].
    Pressure {
        /// Pressure, 0 to the configured limit \[Pa\].
        pressure_pa: f32,
    },
    /// A contraction, as a fraction of the rest length, negative beyond it \[-\].
    Contraction {
        /// Contraction, within the chamber's range \[-\].
        contraction: f32,
    },
}

/// Outputs of one step.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Telemetry {
    /// Number of the step, from 0 after the startup check; wraps.
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
    /// Whether the set point needs more than the core gives: it holds the pressure below its limit.
    pub limited: bool,
    /// The set point.
    pub set_point: SetPoint,
    /// Faults that are present or latched.
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

        /// The timer gives the requested duty to half a tick; a timer with fewer ticks than a duty has parts may round
        /// a duty to none or all of them.
        #[test]
        fn a_timer_gives_the_nearest_ticks(parts in any::<u16>(), period in 1_u16..) {
            let ticks = f64::from(Duty(parts).ticks(period));
            let exact = f64::from(parts) / 65_535.0 * f64::from(period);
            prop_assert!((ticks - exact).abs() <= 0.5 + 1e-9, "{ticks} for {exact}");
            prop_assert_eq!(Duty::ZERO.ticks(period), 0);
            prop_assert_eq!(Duty::FULL.ticks(period), period);
        }
    }
}
