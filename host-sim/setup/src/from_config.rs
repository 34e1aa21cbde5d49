//! The inverse of [`core_config`]: finds a scenario for a configuration of the core, such as a board's. The plant is
//! `full`; keys that the core does not have are left out or at their defaults.

use super::core_config::{Effective, core_config};
use super::{Loaded, parse, render};
use model_core::Config;
use model_core::config::Load;
use model_core::physics::chamber::{ChamberConfig, Vessel};
use model_core::physics::valve;
use model_core::sensing::gas::{GasElement, Pt1000};
use model_core::sensing::pressure::PressurePart;
use std::f64::consts::PI;
use std::path::Path;
use thermyo_compute::math;
use thermyo_files::input::{InputError, Problem};
use thermyo_scenario::schema::{Limits, limits};
use thermyo_scenario::{
    GasElementKind, HeatModel, LoadKind, PlantKind, PlantModel, PressureKind, Scenario, ValveKind,
    ZonesSource, short,
};

#[derive(Debug, Clone, PartialEq)]
pub struct ConfigScenario {
    /// The scenario, as `thermyo check` prints it.
    pub scenario: Loaded,
    /// Whether the scenario gives exactly this configuration again.
    pub exact: bool,
}

/// The scenario that gives this configuration.
///
/// # Errors
/// For a configuration that no scenario can express.
pub fn to_scenario(config: &Config) -> Result<ConfigScenario, InputError> {
    let origin = Path::new("the board's configuration");
    let plant = scenario(config).map_err(|problem| InputError::file(origin, problem))?;
    let mut believed = plant.clone();
    believed.tube.volume_m3 = tubes_m3(&Scenario::default(), config)[1];
    let loaded = Loaded {
        believed: if plant.moves_in_full() { believed } else { plant.clone() },
        plant,
        volume_profile: None,
        drive_profile: None,
        shut_s: Vec::new(),
    };
    let scenario = parse(&render(&loaded), origin)?;
    let exact = core_config(&scenario.believed) == *config;
    Ok(ConfigScenario { scenario, exact })
}

fn scenario(config: &Config) -> Result<Scenario, Problem> {
    let mut s = Scenario::default();
    // From a plant `full` the core takes gas along the muscle, or at least the housing of the element.
    let housing_s = config.sensors.gas.housing_time_constant_s;
    let full = config.zones.layers_w_k > 0.0 || housing_s > 0.0;
    s.plant.model = if full { PlantModel::Full } else { PlantModel::Lumped };
    // An element that averages over the whole muscle senses the mean, as in the core's one zone.
    (s.sensor.gas.span, s.sensor.gas.position) = (1.0, 0.5);
    let [tube_m3, core_tube_m3] = tubes_m3(&s, config);
    s.tube.volume_m3 = tube_m3;
    // The core's conductance is the smaller one of valve and tube.
    let conductance_m3_s_pa = short(config.valve.conductance_m3_s_pa);
    s.tube.conductance_m3_s_pa = s.tube.conductance_m3_s_pa.max(conductance_m3_s_pa);
    s.heat.model = HeatModel::Constant;
    s.heat.scale = 1.0;
    s.zones.source = ZonesSource::Keys;
    set_chamber(&mut s, config, if full { core_tube_m3 } else { 0.0 })?;
    (s.load.kind, s.load.force_n, s.load.length_m) = match config.load {
        Load::Isotonic { force_n } => (LoadKind::Isotonic, short(force_n), s.load.length_m),
        Load::Isometric { length_m } => (LoadKind::Isometric, s.load.force_n, short(length_m)),
    };
    set_valve(&mut s, config);
    set_sensors(&mut s, config)?;
    set_numbers(&mut s, config);
    s.run.step_s = short(config.step_s);
    s.valve.pwm_hz = 1.0 / (f64::from(config.pwm_period_steps) * s.run.step_s);
    s.wall.heat_capacity_j_k = short(config.wall.heat_capacity_j_k) / Effective::of(&s).wall;
    Ok(s)
}

/// Volumes of the tube, in the plant and in the core \[m3\].
///
/// The core's dead volume contains its tube. A core that does not state it gets a tube that its valve fills as fast as
/// the default valve fills the default tube, which needs no shorter integration steps. If the dead volume is smaller
/// than that, all of it is the core's tube.
fn tubes_m3(defaults: &Scenario, config: &Config) -> [f64; 2] {
    let valve = f64::from(config.valve.conductance_m3_s_pa) / defaults.valve.conductance_m3_s_pa;
    let tube_m3 = match short(config.zones.tube_m3) {
        0.0 => defaults.tube.volume_m3 * valve.max(1.0),
        tube_m3 => tube_m3,
    };
    let Limits { min, max, .. } = limits("tube.volume_m3");
    let tube_m3 = tube_m3.clamp(min, max);
    let core_m3 = match config.chamber {
        ChamberConfig::Muscle(muscle) => tube_m3.min(short(muscle.dead_volume_m3)).max(min),
        _ => tube_m3,
    };
    [tube_m3, core_m3]
}

fn set_valve(s: &mut Scenario, config: &Config) {
    if let valve::ValveKind::Proportional(spool) = config.valve_kind {
        s.valve.kind = ValveKind::Proportional;
        s.valve.dead_band = short(spool.dead_band);
        s.valve.bandwidth_hz = short(spool.bandwidth_hz);
    }
}

/// The refusal of a kind that no scenario written here can have.
fn other_kind(key: &str, allowed: &str) -> Problem {
    Problem::NotAllowed {
        key: key.to_owned(),
        value: "another".to_owned(),
        allowed: format!("{allowed}, to be written as a scenario"),
    }
}

/// Sets kind and dimensions; refuses a chamber whose dimensions are in files.
fn set_chamber(s: &mut Scenario, config: &Config, tube_m3: f64) -> Result<(), Problem> {
    match config.chamber {
        ChamberConfig::Muscle(muscle) => {
            s.plant.kind = PlantKind::Muscle;
            let (thread_m, rest_m) =
                (short(muscle.braid.thread_length_m), short(muscle.rest_length_m));
            let turns = short(muscle.braid.turns);
            s.muscle.thread_length_m = thread_m;
            s.muscle.turns = turns;
            s.muscle.rest_length_m = rest_m;
            s.muscle.diameter_m = (thread_m * thread_m - rest_m * rest_m).sqrt() / (turns * PI);
            s.muscle.braid_angle_deg = math::acos(rest_m / thread_m).to_degrees();
            s.muscle.bladder_stiffness_n_m = short(muscle.bladder_stiffness_n_m);
            s.muscle.bladder_saturation_n = short(muscle.bladder_saturation_n);
            s.muscle.bladder_strain = short(muscle.bladder_strain);
            s.muscle.slack_m = short(muscle.slack_m);
            s.muscle.dead_volume_m3 = (short(muscle.dead_volume_m3) - tube_m3).max(0.0);
        }
        ChamberConfig::Vessel(Vessel { section_m2, surface_m2 }) => {
            s.plant.kind = PlantKind::Vessel;
            s.vessel.characteristic_length_m = (4.0 / PI * f64::from(section_m2)).sqrt();
            s.vessel.surface_m2 = short(surface_m2);
            s.vessel.wall_heat_capacity_j_k = short(config.wall.heat_capacity_j_k);
        }
        _ => return Err(other_kind("plant.kind", "\"muscle\" or \"vessel\"")),
    }
    Ok(())
}

/// Sets the types of the sensors.
fn set_sensors(s: &mut Scenario, config: &Config) -> Result<(), Problem> {
    let Pt1000 { range_min_k, range_max_k } = match config.sensors.gas_element {
        GasElement::Pt1000(is) => is,
        _ => Pt1000::default(),
    };
    (s.sensor.gas.range_min_k, s.sensor.gas.range_max_k) = (short(range_min_k), short(range_max_k));
    match config.sensors.gas_element {
        GasElement::Pt1000(_) => (),
        GasElement::Ntc(is) => (s.sensor.gas.kind, s.sensor.ntc) = (GasElementKind::Ntc, is),
        GasElement::Max31865(is) => {
            (s.sensor.gas.kind, s.sensor.max31865) = (GasElementKind::Max31865, is);
        }
        _ => return Err(other_kind("sensor.gas.kind", "\"pt1000\", \"ntc\" or \"max31865\"")),
    }
    match config.sensors.pressure_part {
        PressurePart::Ratiometric => (),
        PressurePart::Mpr(is) => {
            (s.sensor.pressure.kind, s.sensor.mpr) = (PressureKind::Mpr, is);
        }
        _ => return Err(other_kind("sensor.pressure.kind", "\"ratiometric\" or \"mpr\"")),
    }
    Ok(())
}

/// Sets the keys that the core has unchanged.
fn set_numbers(s: &mut Scenario, config: &Config) {
    let Config { sensors, .. } = config;
    s.gas.take(&config.gas);
    s.ambient.take(&config.ambient);
    s.supply.take(&config.supply);
    s.heat.take(&config.heat);
    s.zones.take(&config.zones);
    s.friction.take(&config.friction);
    s.muscle.take(&config.hysteresis);
    s.load.mass_kg = short(config.moving_mass_kg);
    s.valve.take(&config.valve);
    s.leak.take(&config.leak);
    s.adc.take(&sensors.adc);
    s.sensor.pressure.take(&sensors.pressure);
    s.sensor.length.take(&sensors.length);
    s.sensor.gas.take(&sensors.gas);
    s.link.take(&config.link);
    (s.estimator, s.controller) = (config.estimator, config.controller);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::load;

    /// Checks that the configuration of every shipped scenario with a muscle or a vessel becomes a file that loads,
    /// whose plant is built, and that gives the same configuration to the bit.
    #[test]
    fn every_shipped_scenario_comes_back_as_a_file_that_runs() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios");
        let files = std::fs::read_dir(folder).unwrap().map(|file| file.unwrap().path());
        let mut seen = 0;
        for path in files.filter(|path| path.extension().is_some_and(|end| end == "toml")) {
            // A joint has a table for each muscle.
            let Ok(loaded) = load(&path) else { continue };
            if loaded.plant.plant.kind == PlantKind::Table {
                continue;
            }
            for valve in [1.0, 30.0, 1000.0] {
                let mut config = core_config(&loaded.believed);
                config.valve.conductance_m3_s_pa *= valve;
                let said = to_scenario(&config).unwrap();
                let text = render(&said.scenario);
                let back = parse(&text, Path::new("scenario.toml")).unwrap();
                assert_eq!(core_config(&back.believed), config, "{}", path.display());
                assert_eq!(render(&back), text, "{}", path.display());
                assert!(said.exact);
                let built = thermyo_plant::build(&back.plant, back.volume_profile);
                assert!(built.is_ok(), "{} {valve}: {:?}", path.display(), built.err());
                seen += 1;
            }
        }
        assert!(seen >= 24, "{seen}");
    }

    /// A dead volume that leaves no room for a tube belongs to the core alone.
    #[test]
    fn a_small_dead_volume_comes_back_and_can_be_integrated() {
        for dead_m3 in [1.0e-7_f32, 3.0e-6] {
            let mut config = core_config(&Scenario::default());
            let ChamberConfig::Muscle(muscle) = &mut config.chamber else { panic!("no muscle") };
            muscle.dead_volume_m3 = dead_m3;
            let said = to_scenario(&config).unwrap();
            assert!(said.exact, "{dead_m3}");
            assert!(thermyo_plant::build(&said.scenario.plant, None).is_ok(), "{dead_m3}");
        }
    }

    /// A configuration from a scenario comes back unchanged.
    #[test]
    fn a_scenario_comes_back_from_its_configuration() {
        for text in [
            "",
            "[plant]\nmodel = \"lumped\"\n",
            "[sensor.pressure]\nrange_pa = 689_476.0\ngain = 1.013\noffset_pa = -312.7\ncorrection_25 = 0.0013\n\
             [sensor.length]\ncorrection_50 = -0.01\ncorrection_75 = 0.002\n\
             [load]\nkind = \"mass\"\nmass_kg = 7.3\n[heat]\nmodel = \"correlation\"\n",
            "[muscle]\nrest_length_m = 0.217\ndiameter_m = 0.0137\nbraid_angle_deg = 21.3\n\
             [valve]\npwm_hz = 62.5\n[leak]\nconductance_m3_s_pa = 3.7e-12\ncritical_ratio = 0.21\n[load]\nkind = \"isometric\"\nlength_m = 0.2\n",
            "[muscle]\nbladder_saturation_n = 41.3\nbladder_strain = 0.031\nslack_m = 0.0043\n\
             [estimator]\nfoil_sd_k = 0.15\n",
            "[valve]\nkind = \"proportional\"\ndead_band = 0.13\nbandwidth_hz = 31.7\n",
            "[sensor.gas]\nkind = \"ntc\"\n[sensor.ntc]\nbeta_k = 3435.0\n",
            "[sensor.gas]\nkind = \"max31865\"\n[sensor.max31865]\nreference_ohm = 402.0\n\
             [sensor.pressure]\nkind = \"mpr\"\nrange_pa = 250e3\n[sensor.mpr]\ntimeout_s = 0.03\n",
        ] {
            let config = core_config(&parse(text, Path::new("scenario")).unwrap().believed);
            let said = to_scenario(&config).unwrap();
            let back = core_config(&said.scenario.believed);
            assert_eq!(back, config, "{text}");
            assert!(said.exact);
        }
    }

    #[test]
    fn every_element_comes_back() {
        for element in GasElement::all() {
            let mut config = core_config(&Scenario::default());
            config.sensors.gas_element = element;
            let back = to_scenario(&config).unwrap();
            assert_eq!(core_config(&back.scenario.believed), config);
        }
    }
}
