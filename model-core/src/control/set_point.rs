//! Set points: which of them the core accepts, and its errors for the others.

use crate::config::{Config, Load};
use crate::math::{SMALLEST, absolute};
use crate::physics::chamber::Chamber;
use crate::sample::{Faults, SetPoint};

/// Fewest PWM periods in a working cycle: two per stroke, less a thousandth for rounding. With fewer there is no flow
/// to see.
const LEAST_PERIODS: f32 = 3.996;
/// Longest working cycle \[s\]: a day.
const LONGEST_CYCLE_S: f32 = 86_400.0;
/// Largest mass flow \[kg/s\]: hundreds of times what the valves of a muscle pass.
const LARGEST_FLOW_KG_S: f32 = 1.0;

/// A value of a set point.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub enum SetPointField {
    /// Share of the time for which the inlet is open.
    Inlet,
    /// Share of the time for which the outlet is open.
    Outlet,
    /// Mass flow.
    Flow,
    /// Period of the working cycle.
    Period,
    /// Pressure.
    Pressure,
    /// Contraction.
    Contraction,
    /// Highest pressure for which a core is armed.
    Armed,
}

impl SetPointField {
    /// Key of the value, including the unit.
    pub const fn key(self) -> &'static str {
        match self {
            Self::Inlet => "inlet",
            Self::Outlet => "outlet",
            Self::Flow => "flow_kg_s",
            Self::Period => "period_s",
            Self::Pressure => "pressure_pa",
            Self::Contraction => "contraction",
            Self::Armed => "armed_pa",
        }
    }
}

/// Reason why a set point is not accepted; the set point before then stays.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub enum SetPointError {
    /// A value is not a number, or out of its range.
    Range {
        /// The value that was refused.
        field: SetPointField,
        /// Its size, in the unit of its key.
        value: f32,
        /// Smallest permitted value.
        minimum: f32,
        /// Largest permitted value.
        maximum: f32,
    },
    /// Venting faults are present or latched.
    Faults(Faults),
    /// The core has not been armed since it started or since a fault last made it vent.
    NotArmed,
}

impl core::fmt::Display for SetPointError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Range { field: SetPointField::Contraction, value, minimum, maximum }
                if minimum >= maximum =>
            {
                write!(
                    f,
                    "contraction = {value}: this chamber does not move, it takes pressures and flows"
                )
            }
            Self::Range { field, value, minimum, maximum } => {
                write!(f, "{} = {value}: must be from {minimum} to {maximum}", field.key())
            }
            Self::Faults(faults) => write!(f, "vents until this is cleared: {faults}"),
            Self::NotArmed => write!(f, "the board is not armed: arm it first"),
        }
    }
}

impl core::error::Error for SetPointError {}

/// A set point that a core can act on: every value is a number within its range.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Target(SetPoint);

impl Target {
    /// The set point that vents.
    pub const VENT: Self = Self(SetPoint::Vent);

    /// Checks `set_point` for a core with this configuration and its chamber.
    ///
    /// ```
    /// use model_core::control::Target;
    /// use model_core::{Config, SetPoint};
    /// use model_core::physics::chamber::AnyChamber;
    ///
    /// let config = Config::default();
    /// let muscle = AnyChamber::new(&config.chamber);
    /// let contraction = |contraction| SetPoint::Contraction { contraction };
    /// assert!(Target::new(&contraction(0.1), &config, &muscle).is_ok());
    /// let error = Target::new(&contraction(0.6), &config, &muscle).unwrap_err();
    /// assert!(error.to_string().contains("must be from"));
    /// ```
    ///
    /// # Errors
    /// [`SetPointError::Range`] names the first value that is not permitted.
    pub fn new(
        set_point: &SetPoint,
        config: &Config,
        chamber: &impl Chamber,
    ) -> Result<Self, SetPointError> {
        use SetPointField::{Contraction, Flow, Inlet, Outlet, Period, Pressure};
        Ok(Self(match *set_point {
            SetPoint::Vent => SetPoint::Vent,
            SetPoint::Duty { inlet, outlet } => SetPoint::Duty {
                inlet: within(Inlet, inlet, 0.0, 1.0)?,
                outlet: within(Outlet, outlet, 0.0, 1.0)?,
            },
            SetPoint::MassFlow { flow_kg_s } => SetPoint::MassFlow {
                flow_kg_s: within(Flow, flow_kg_s, -LARGEST_FLOW_KG_S, LARGEST_FLOW_KG_S)?,
            },
            SetPoint::MassFlowCycle { flow_kg_s, period_s } => {
                let least_s = LEAST_PERIODS * f32::from(config.pwm_period_steps) * config.step_s;
                SetPoint::MassFlowCycle {
                    flow_kg_s: within(Flow, flow_kg_s, 0.0, LARGEST_FLOW_KG_S)?,
                    period_s: within(Period, period_s, least_s, LONGEST_CYCLE_S)?,
                }
            }
            SetPoint::Pressure { pressure_pa } => SetPoint::Pressure {
                pressure_pa: within(Pressure, pressure_pa, 0.0, config.pressure_limit_pa)?,
            },
            SetPoint::Contraction { contraction } => {
                let [least, most] = contractions(config, chamber);
                SetPoint::Contraction {
                    contraction: within(Contraction, contraction, least, most)?,
                }
            }
        }))
    }

    /// The set point.
    pub fn set_point(&self) -> SetPoint {
        self.0
    }
}

/// Smallest and largest contraction of the chamber, 0 for a chamber that does not move \[-\].
///
/// ```
/// use model_core::physics::chamber::AnyChamber;
/// use model_core::{Config, control};
///
/// let config = Config::default();
/// let [least, most] = control::contractions(&config, &AnyChamber::new(&config.chamber));
/// assert!(least <= 0.0 && 0.2 < most);
/// ```
pub fn contractions(config: &Config, chamber: &impl Chamber) -> [f32; 2] {
    match config.load {
        Load::Isotonic { .. } if chamber.moves() => {
            let rest_m = chamber.rest_length_m();
            [chamber.longest_m(), chamber.shortest_m()].map(|length_m| (rest_m - length_m) / rest_m)
        }
        _ => [0.0; 2],
    }
}

fn within(
    field: SetPointField,
    value: f32,
    minimum: f32,
    maximum: f32,
) -> Result<f32, SetPointError> {
    let value = if absolute(value) < SMALLEST { 0.0 } else { value };
    // NaN fails both.
    if value >= minimum && value <= maximum {
        Ok(value)
    } else {
        Err(SetPointError::Range { field, value, minimum, maximum })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::physics::chamber::{AnyChamber, ChamberConfig, Vessel};
    use proptest::prelude::*;

    fn target(set_point: &SetPoint, config: &Config) -> Result<Target, SetPointError> {
        Target::new(set_point, config, &AnyChamber::new(&config.chamber))
    }

    fn refused(set_point: SetPoint) -> (SetPointField, f32, f32) {
        match target(&set_point, &Config::default()) {
            Err(SetPointError::Range { field, minimum, maximum, .. }) => (field, minimum, maximum),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn nonsense_is_refused_by_name() {
        for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -0.01, 0.374] {
            let (field, minimum, maximum) = refused(SetPoint::Contraction { contraction: value });
            assert_eq!((field, minimum), (SetPointField::Contraction, 0.0));
            assert!((0.372..0.374).contains(&maximum), "{maximum}");
        }
        let limit_pa = Config::default().pressure_limit_pa;
        for pressure_pa in [f32::NAN, -1.0, limit_pa * 1.001] {
            let expected = (SetPointField::Pressure, 0.0, limit_pa);
            assert_eq!(refused(SetPoint::Pressure { pressure_pa }), expected);
        }
        for period_s in [f32::NAN, f32::NEG_INFINITY, -5.0, 0.0, 0.01, 0.0399, 1.0e6] {
            let cycle = SetPoint::MassFlowCycle { flow_kg_s: 1.0e-4, period_s };
            let (field, minimum, maximum) = refused(cycle);
            assert_eq!((field, maximum), (SetPointField::Period, 86_400.0));
            assert!((0.0399..0.04).contains(&minimum), "{minimum}");
        }
        assert_eq!(refused(SetPoint::MassFlow { flow_kg_s: f32::NAN }).0, SetPointField::Flow);
        assert_eq!(refused(SetPoint::Duty { inlet: 1.01, outlet: 0.0 }).0, SetPointField::Inlet);
        assert_eq!(refused(SetPoint::Duty { inlet: 0.0, outlet: -0.1 }).0, SetPointField::Outlet);
    }

    #[test]
    fn what_is_next_to_nothing_is_nothing() {
        let taken =
            |flow_kg_s| target(&SetPoint::MassFlow { flow_kg_s }, &Config::default()).unwrap();
        for flow_kg_s in [1.0e-40, -1.0e-40, f32::MIN_POSITIVE, -1.0e-21] {
            assert_eq!(taken(flow_kg_s), taken(0.0));
            let duty = SetPoint::Duty { inlet: flow_kg_s, outlet: 0.0 };
            assert!(target(&duty, &Config::default()).is_ok());
        }
        assert_ne!(taken(1.0e-19), taken(0.0));
    }

    #[test]
    fn what_does_not_move_takes_no_contraction() {
        let vessel = ChamberConfig::Vessel(Vessel { section_m2: 0.01, surface_m2: 0.1 });
        let held = Load::Isometric { length_m: 0.27 };
        for config in [
            Config { chamber: vessel, ..Config::default() },
            Config { load: held, ..Config::default() },
        ] {
            let contraction = SetPoint::Contraction { contraction: 0.1 };
            let error = target(&contraction, &config).unwrap_err();
            assert!(error.to_string().contains("does not move"), "{error}");
        }
    }

    /// The ends of a range belong to it.
    #[test]
    fn what_lies_at_the_end_of_its_range_is_taken() {
        let config = Config::default();
        for pressure_pa in [0.0, config.pressure_limit_pa] {
            let taken = target(&SetPoint::Pressure { pressure_pa }, &config).unwrap();
            assert_eq!(taken.set_point(), SetPoint::Pressure { pressure_pa });
        }
        // From 300 mm at rest to b/sqrt(3) = 188.2 mm.
        let [least, most] = contractions(&config, &AnyChamber::new(&config.chamber));
        assert!(least == 0.0 && (most - 0.3728).abs() < 1e-4);
        let key = |field: SetPointField| field.key();
        let keys =
            [SetPointField::Inlet, SetPointField::Period, SetPointField::Contraction].map(key);
        assert_eq!(keys, ["inlet", "period_s", "contraction"]);
    }

    #[test]
    fn a_refusal_says_what_is_allowed() {
        let set_point = SetPoint::Pressure { pressure_pa: 7.0e5 };
        let error = target(&set_point, &Config::default()).unwrap_err();
        let text = std::string::ToString::to_string(&error);
        assert_eq!(text, "pressure_pa = 700000: must be from 0 to 689500");
        let faults = Faults::EMERGENCY_STOP.with(Faults::LINK_LOST);
        let text = std::string::ToString::to_string(&SetPointError::Faults(faults));
        assert_eq!(text, "vents until this is cleared: emergency stop, link lost");
    }

    proptest! {
        /// Whatever the bits, an accepted value is within its range.
        #[test]
        fn what_is_taken_holds_no_nonsense(a in any::<u32>(), b in any::<u32>(), kind in 0..5) {
            let [a, b] = [a, b].map(f32::from_bits);
            let set_point = match kind {
                0 => SetPoint::Duty { inlet: a, outlet: b },
                1 => SetPoint::MassFlow { flow_kg_s: a },
                2 => SetPoint::MassFlowCycle { flow_kg_s: a, period_s: b },
                3 => SetPoint::Pressure { pressure_pa: a },
                _ => SetPoint::Contraction { contraction: a },
            };
            if let Ok(taken) = target(&set_point, &Config::default()) {
                let sound = match taken.set_point() {
                    SetPoint::Duty { inlet, outlet } => {
                        (0.0..=1.0).contains(&inlet) && (0.0..=1.0).contains(&outlet)
                    }
                    SetPoint::MassFlow { flow_kg_s } => flow_kg_s.abs() <= 1.0,
                    SetPoint::MassFlowCycle { flow_kg_s, period_s } => {
                        (0.0..=1.0).contains(&flow_kg_s) && (0.0399..=86_400.0).contains(&period_s)
                    }
                    SetPoint::Pressure { pressure_pa } => (0.0..=689_500.0).contains(&pressure_pa),
                    SetPoint::Contraction { contraction } => (0.0..0.374).contains(&contraction),
                    SetPoint::Vent => true,
                };
                prop_assert!(sound, "{taken:?}");
            }
        }
    }
}
