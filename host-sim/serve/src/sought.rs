//! Identifications that the page offers: keys of the board's own configuration.

use model_core::Config;
use serde::{Deserialize, Serialize};
use std::path::Path;
use thermyo_files::input::InputError;
use thermyo_files::shipped;
use thermyo_identify::motion;
use thermyo_scenario::PlantKind;
use thermyo_setup::{Loaded, from_config};

/// Name of the configuration in messages.
pub const BOARDS: &str = "the board's configuration";
/// Keys that a record of the gas temperature can determine, the usual ones first.
const HEAT: [&str; 5] = [
    "heat.inner_w_m2_k",
    "sensor.gas.time_constant_s",
    "sensor.gas.housing_time_constant_s",
    "heat.inner_per_flow",
    "wall.heat_capacity_j_k",
];
/// Scenario whose muscle serves as a start for any other.
const USUAL_MUSCLE: &str = "static_map.toml";
/// Number of keys that are searched for unless the user chooses others.
const USUAL: usize = 3;
/// Number of keys that only a record of motion determines: slip and creep.
const OF_MOTION: usize = 7;

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Sought {
    /// Heat transfer and lags of the sensor, from stops or from motion.
    Heat,
    /// Dimensions and bladder, from static readings of the force.
    Force,
    /// Slip and creep, from a motion.
    Motion,
}

/// A kind of identification, with the keys that it may find.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Offer {
    pub kind: Sought,
    pub name: &'static str,
    /// Data that it needs.
    pub hint: &'static str,
    pub keys: Vec<&'static str>,
    /// Number of the keys that are proposed.
    pub usual: usize,
}

impl Sought {
    const ALL: [Self; 3] = [Self::Heat, Self::Force, Self::Motion];

    const fn words(self) -> [&'static str; 2] {
        match self {
            Self::Heat => [
                "Heat transfer and sensor",
                "A record with stops (Measure stops) determines them; motion alone rarely does.",
            ],
            Self::Force => [
                "Force of the muscle",
                "A table of static readings: rest_length_m, gauge_pressure_pa, length_m, force_n.",
            ],
            Self::Motion => [
                "Slip and creep",
                "A record of time_s, length_m, pressure_pa under a constant load, or with force_n.",
            ],
        }
    }

    fn keys(self) -> Vec<&'static str> {
        match self {
            Self::Heat => HEAT.to_vec(),
            Self::Force => Vec::new(),
            Self::Motion => motion::KEYS.iter().take(OF_MOTION).map(|(key, _)| *key).collect(),
        }
    }

    /// The scenario of a configuration that requests these keys.
    ///
    /// # Errors
    /// For a configuration that no scenario can express, and for a key that cannot be identified.
    pub fn scenario(self, config: &Config, keys: &[String]) -> Result<Loaded, InputError> {
        let mut loaded = from_config::to_scenario(config)?.scenario;
        if self == Self::Force {
            start_from_usual(&mut loaded);
        }
        let columns: &[&str] = if self == Self::Heat { &["sensor_gas_k"] } else { &[] };
        for scenario in [&mut loaded.plant, &mut loaded.believed] {
            scenario.identify.parameters = keys.to_vec();
            scenario.identify.columns = columns.iter().map(|name| (*name).to_owned()).collect();
        }
        thermyo_setup::parse(&thermyo_setup::render(&loaded), Path::new(BOARDS))
    }

    fn offer(self, config: &Config) -> Option<Offer> {
        let known = |key: &&str| self.scenario(config, &[(*key).to_owned()]).is_ok();
        let keys: Vec<&str> = self.keys().into_iter().filter(known).collect();
        let [name, hint] = self.words();
        let usual = if self == Self::Heat { USUAL } else { keys.len() };
        let scenario = from_config::to_scenario(config).ok()?.scenario;
        let muscle = scenario.plant.plant.kind == PlantKind::Muscle;
        let offered = if self == Self::Force { muscle } else { !keys.is_empty() };
        offered.then_some(Offer { kind: self, name, hint, keys, usual })
    }
}

/// Uses the bladder of a usual muscle, scaled by diameter, if the configuration has none that
/// saturates: the search needs a start.
fn start_from_usual(loaded: &mut Loaded) {
    let text = shipped::text(USUAL_MUSCLE);
    let Ok(usual) = thermyo_setup::parse(text, Path::new(USUAL_MUSCLE)) else { return };
    let usual = usual.plant.muscle;
    for scenario in [&mut loaded.plant, &mut loaded.believed] {
        let own = &mut scenario.muscle;
        if own.bladder_saturation_n <= 0.0 {
            let wider = own.diameter_m / usual.diameter_m;
            own.bladder_saturation_n = usual.bladder_saturation_n * wider;
            own.bladder_strain = usual.bladder_strain;
            own.bladder_stiffness_n_m = usual.bladder_stiffness_n_m;
        }
    }
}

/// Kinds of identification that suit a configuration.
pub fn offers(config: &Config) -> Vec<Offer> {
    Sought::ALL.into_iter().filter_map(|sought| sought.offer(config)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use thermyo_setup::core_config::core_config;

    fn config(text: &str) -> Config {
        core_config(&thermyo_setup::parse(text, Path::new("a.toml")).unwrap().believed)
    }

    #[test]
    fn only_keys_that_the_configuration_has_are_offered() {
        let keys = |text: &str, kind| {
            let found = offers(&config(text)).into_iter().find(|offer| offer.kind == kind);
            found.map(|offer| offer.keys)
        };
        assert_eq!(keys("", Sought::Heat).unwrap().len(), HEAT.len());
        let bare = "[sensor.gas]\nhousing_time_constant_s = 0.0\n";
        assert!(!keys(bare, Sought::Heat).unwrap().contains(&HEAT[2]));
        assert!(keys("", Sought::Motion).unwrap().contains(&"muscle.creep_slow_s"));
        let stiff = "[muscle]\nslip_force_n = 0.0\ncreep_fast_n_m = 0.0\ncreep_slow_n_m = 0.0\n";
        assert!(!keys(stiff, Sought::Motion).unwrap().contains(&"muscle.creep_slow_n_m"));
        let vessel = "[plant]\nkind = \"vessel\"\n[drive]\nkind = \"discharge\"\n";
        assert!(keys("", Sought::Force).is_some() && keys(vessel, Sought::Force).is_none());
    }

    #[test]
    fn a_key_that_cannot_be_identified_is_refused_in_one_line() {
        let asked = ["heat.inner_w_m2".to_owned()];
        let error = Sought::Heat.scenario(&config(""), &asked).unwrap_err().to_string();
        assert!(
            error.contains("did you mean heat.inner_w_m2_k?") && !error.contains('\n'),
            "{error}"
        );
    }
}
