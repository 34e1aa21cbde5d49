//! The core's configuration: a scenario (with `[believed]` applied) in the core's own terms.

use model_core::config::{Config, Load, Supply, Zones};
use model_core::physics::chamber::{ChamberConfig, Vessel};
use model_core::physics::friction::Friction;
use model_core::physics::heat::{Heat, Wall};
use model_core::physics::hysteresis::Hysteresis;
use model_core::physics::valve::{Spool, Valve, ValveKind};
use model_core::sensing::Sensors;
use model_core::sensing::gas::GasSensor;
use thermyo_plant::chamber::{self, Chamber};
use thermyo_plant::gas::IdealGas;
use thermyo_plant::heat::InnerHeat;
use thermyo_plant::line::Bore;
use thermyo_plant::load_n;
use thermyo_plant::zones::{BACKGROUND_DIFFUSIVITY, JET_REACH_DIAMETERS, RECIRCULATION};
use thermyo_scenario::schema::limits;
use thermyo_scenario::{HeatModel, LoadKind, PlantKind, PlantModel, Scenario, ZonesSource};

/// Heat transfer coefficient that stands for "isothermal" \[W/(m2 K)\]: about a hundred times that
/// of still air.
const ISOTHERMAL_W_M2_K: f64 = 2_000.0;
/// Range of sensor lags for which the core's filter works \[s\]. A sensor without lag gets the shortest.
const SHORTEST_LAG_S: f32 = 1.0e-3;
const LONGEST_LAG_S: f32 = 1.0e3;
/// Stiffness that represents friction without presliding \[N/m\].
const LUMPED_PRESLIDING_N_M: f32 = 1.0e5;
/// Smallest heat capacity of a wall for which the core works \[J/K\].
const LEAST_WALL_J_K: f64 = 0.01;
/// Working point at which a heat transfer correlation is evaluated for the core: pressure \[Pa\], gas above wall \[K\],
/// inflow \[kg/s\]. The values are from the middle of the nominal cycle.
pub const WORKING_PRESSURE_PA: f64 = 2.0e5;
pub const WORKING_SWING_K: f64 = 20.0;
const WORKING_FLOW_KG_S: f64 = 3.6e-4;

/// Pressure change, in its standard deviations, beyond which gas behind a hose counts as flowing against the open
/// valve. Noise alone, normally distributed, then adds a quarter of a deviation in a step; a change of two deviations
/// counts almost in full \[-\].
const HOSE_REVERSAL_SD: f32 = 1.0;

/// Zones of the core's estimate.
const CORE_ZONES: f64 = 4.0;
/// Nominal conductance of a valve \[m3/(s Pa)\], to which the working flow is proportional.
const NOMINAL_VALVE: f64 = 4.0e-9;

/// Properties of the plant `full` that reach the core only as effective values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Effective {
    /// Volume of the tube \[m3\], which fills and empties with the muscle: part of the core's chamber. The controller
    /// leaves out the volume of a line, which counts the muscle's gain at the port; the estimator has both
    /// (`zones.tube_m3`, `hose_m3`).
    pub tube_m3: f64,
    /// Fraction of the wall that follows a stroke: the inner layer.
    pub wall: f64,
    /// Lag of the element's housing \[s\].
    pub housing_s: f64,
}

impl Effective {
    pub fn of(s: &Scenario) -> Self {
        if s.moves_in_full() {
            Self {
                tube_m3: s.tube.volume_m3,
                wall: 1.0 - s.wall.outer_fraction,
                housing_s: s.sensor.gas.housing_time_constant_s,
            }
        } else {
            Self { tube_m3: 0.0, wall: 1.0, housing_s: 0.0 }
        }
    }
}

/// The core's configuration for `believed`, whose `plant` only selects the kind of plant. Fields that are not set here
/// have the scenario's values.
pub fn core_config(believed: &Scenario) -> Config {
    let s = believed;
    let effective = Effective::of(s);
    let moving = chamber::of(s);
    let (chamber, wall_j_k) = chamber_and_wall(s, moving.as_deref(), &effective);
    let full = s.plant.model == PlantModel::Full;
    let inner = inner_heat(s);
    Config {
        step_s: s.run.step_s as f32,
        gas: s.gas.core(),
        ambient: s.ambient.core(),
        supply: Supply { temperature_k: port_k(s) as f32, ..s.supply.core() },
        chamber,
        leak: s.leak.core(),
        heat: Heat {
            inner_w_m2_k: inner.still_w_m2_k as f32,
            inner_per_flow: inner.per_inflow as f32,
            ..s.heat.core()
        },
        zones: zones(s, moving.as_deref(), &inner),
        wall: Wall { heat_capacity_j_k: wall_j_k.max(LEAST_WALL_J_K) as f32 },
        friction: friction(s),
        hysteresis: hysteresis(s),
        load: match (s.load.kind, &moving) {
            (LoadKind::Isometric, _) => Load::Isometric { length_m: s.load.length_m as f32 },
            (_, Some(chamber)) => Load::Isotonic { force_n: load_n(s, chamber.as_ref()) as f32 },
            (_, None) => Load::Isotonic { force_n: 0.0 },
        },
        moving_mass_kg: if full { s.load.mass_kg as f32 } else { 0.0 },
        valve: valve(s),
        valve_kind: valve_kind(s),
        pwm_period_steps: s.pwm_period_steps(),
        sensors: Sensors {
            adc: s.adc.core(),
            pressure: s.sensor.pressure.core(),
            length: s.sensor.length.core(),
            gas: gas_sensor(s, &effective),
            gas_element: s.sensor.gas_element(),
            pressure_part: s.sensor.pressure_part(),
        },
        estimator: s.estimator,
        controller: s.controller,
        pressure_limit_pa: pressure_limit_pa(s) as f32,
        link: s.link.core(),
    }
}

/// Temperature at which gas from the supply reaches the chamber \[K\]: in `full` a tube brings it near that of its
/// wall, ambient. A configuration's own keys contain this already.
fn port_k(s: &Scenario) -> f64 {
    if !s.moves_in_full() || s.zones.source == ZonesSource::Keys {
        return s.supply.temperature_k;
    }
    let (gas, bore, line_m) = path(s);
    let kept = bore.kept(&gas, s.tube.volume_m3, line_m, working_flow_kg_s(s));
    s.ambient.temperature_k + kept * (s.supply.temperature_k - s.ambient.temperature_k)
}

/// The gas, the bore of tube and line, and the line's length \[m\].
fn path(s: &Scenario) -> (IdealGas, Bore, f64) {
    let gas = IdealGas::new(&s.gas);
    (gas, Bore::of_tube(s, &gas), s.tube.line().map_or(0.0, |[length_m, _]| length_m))
}

/// Flow into the chamber in the middle of the nominal cycle, in proportion to the valve \[kg/s\].
fn working_flow_kg_s(s: &Scenario) -> f64 {
    WORKING_FLOW_KG_S * s.valve.conductance_m3_s_pa / NOMINAL_VALVE
}

fn hysteresis(s: &Scenario) -> Hysteresis {
    if s.plant.kind == PlantKind::Muscle { s.muscle.core() } else { Hysteresis::NONE }
}

/// The chamber, and the heat capacity of its wall \[J/K\].
fn chamber_and_wall(
    s: &Scenario,
    moving: Option<&dyn Chamber>,
    effective: &Effective,
) -> (ChamberConfig, f64) {
    match moving {
        Some(chamber) => {
            (chamber.configured(effective.tube_m3), effective.wall * s.wall.heat_capacity_j_k)
        }
        None => {
            let vessel = Vessel {
                section_m2: s.vessel.section_m2() as f32,
                surface_m2: s.vessel.surface_m2 as f32,
            };
            (ChamberConfig::Vessel(vessel), s.vessel.wall_heat_capacity_j_k)
        }
    }
}

fn friction(s: &Scenario) -> Friction {
    if s.plant.model == PlantModel::Full {
        return s.friction.core();
    }
    Friction {
        presliding_stiffness_n_m: LUMPED_PRESLIDING_N_M,
        viscous_n_s_m: 0.0,
        ..s.friction.core()
    }
}

fn valve(s: &Scenario) -> Valve {
    if !s.moves_in_full() {
        // All other plants have ideal valves.
        return Valve { switch_time_s: 0.0, dead_time_s: 0.0, ..s.valve.core() };
    }
    // In series both pass no more than the smaller one.
    let conductance_m3_s_pa = s.valve.conductance_m3_s_pa.min(s.tube.conductance_m3_s_pa) as f32;
    let valve = Valve { dead_time_s: dead_time_s(s) as f32, conductance_m3_s_pa, ..s.valve.core() };
    match s.valve.kind {
        thermyo_scenario::ValveKind::Switching => valve,
        thermyo_scenario::ValveKind::Proportional => Valve { switch_time_s: 0.0, ..valve },
    }
}

fn valve_kind(s: &Scenario) -> ValveKind {
    if !s.moves_in_full() || s.valve.kind == thermyo_scenario::ValveKind::Switching {
        return ValveKind::Switching;
    }
    ValveKind::Proportional(Spool {
        dead_band: s.valve.dead_band as f32,
        bandwidth_hz: s.valve.bandwidth_hz as f32,
    })
}

fn gas_sensor(s: &Scenario, effective: &Effective) -> GasSensor {
    GasSensor {
        time_constant_s: (s.sensor.gas.time_constant_s as f32).clamp(SHORTEST_LAG_S, LONGEST_LAG_S),
        housing_time_constant_s: effective.housing_s as f32,
        ..s.sensor.gas.core()
    }
}

/// Heat transfer from gas to wall, in the core's terms.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Inner {
    still_w_m2_k: f64,
    per_inflow: f64,
    per_outflow: f64,
    /// Part by buoyancy at 2 bar and 20 K.
    buoyancy_w_m2_k: f64,
    decay_s: f64,
    /// Flow at which both gains are evaluated \[kg/s\].
    forced_flow_kg_s: f64,
}

fn inner_heat(s: &Scenario) -> Inner {
    let most = limits("heat.inner_w_m2_k").max;
    let most_per_flow = limits("heat.inner_per_flow").max;
    let inner = unlimited_heat(s);
    Inner {
        still_w_m2_k: inner.still_w_m2_k.min(most),
        per_inflow: inner.per_inflow.min(most_per_flow),
        per_outflow: inner.per_outflow.min(most_per_flow),
        buoyancy_w_m2_k: inner.buoyancy_w_m2_k.min(most),
        ..inner
    }
}

fn unlimited_heat(s: &Scenario) -> Inner {
    match s.heat.model {
        HeatModel::Adiabatic => Inner::default(),
        HeatModel::Isothermal => Inner { still_w_m2_k: ISOTHERMAL_W_M2_K, ..Inner::default() },
        HeatModel::Constant => Inner {
            still_w_m2_k: s.heat.scale * s.heat.inner_w_m2_k,
            per_inflow: s.heat.scale * s.heat.inner_per_flow,
            ..Inner::default()
        },
        HeatModel::Correlation => laws_of_air(s),
    }
}

/// Linearises the laws of air about a working point.
fn laws_of_air(s: &Scenario) -> Inner {
    /// Pressure so low that there is no buoyancy.
    const THIN_PA: f64 = 1.0;
    let heat = match chamber::of(s) {
        Some(chamber) => {
            let rest_m = chamber.rest_length();
            let (diameter_m, length_m) = (chamber.diameter(rest_m), chamber.gas_length(rest_m));
            InnerHeat::of_chamber(s, diameter_m, length_m)
        }
        None => InnerHeat::of_vessel(s),
    };
    let wall_k = s.ambient.temperature_k;
    let gas_k = wall_k + WORKING_SWING_K;
    let flow_kg_s = working_flow_kg_s(s);
    let at = |pressure| heat.linearised(pressure, gas_k, wall_k, flow_kg_s);
    let (thin, working) = (at(THIN_PA), at(WORKING_PRESSURE_PA));
    let fourth = |h: f64| (h * h) * (h * h);
    let buoyancy4 = fourth(working.still_w_m2_k) - fourth(thin.still_w_m2_k);
    Inner {
        still_w_m2_k: thin.still_w_m2_k,
        per_inflow: working.per_inflow,
        per_outflow: working.per_outflow,
        buoyancy_w_m2_k: buoyancy4.max(0.0).sqrt().sqrt(),
        decay_s: s.heat.stirring_decay_s,
        forced_flow_kg_s: flow_kg_s,
    }
}

/// Gas along the muscle, as in the plant `full`, in four zones. Other plants have one.
fn zones(s: &Scenario, moving: Option<&dyn Chamber>, inner: &Inner) -> Zones {
    if s.zones.source == ZonesSource::Keys {
        return s.zones.core();
    }
    let laws = Zones {
        buoyancy_w_m2_k: inner.buoyancy_w_m2_k as f32,
        per_outflow: inner.per_outflow as f32,
        stirring_decay_s: inner.decay_s as f32,
        forced_flow_kg_s: inner.forced_flow_kg_s as f32,
        ..Zones::default()
    };
    let Some(chamber) = moving.filter(|_| s.moves_in_full()) else { return laws };
    let diameter_m = chamber.diameter(chamber.rest_length());
    let foil = &s.sensor.gas;
    let (gas, bore, line_m) = path(s);
    Zones {
        // In the plant, exchange between neighbours acts over the distance of its zones.
        recirculation: (RECIRCULATION * CORE_ZONES / chamber.zones().max(1) as f64) as f32,
        jet_reach_m: (JET_REACH_DIAMETERS * diameter_m).max(limits("zones.jet_reach_m").min) as f32,
        diffusivity_m2_s: BACKGROUND_DIFFUSIVITY as f32,
        foil_position: foil.position as f32,
        foil_span: foil.span as f32,
        // A constant coefficient has no profile.
        bore_m: if s.heat.model == HeatModel::Correlation { diameter_m as f32 } else { 0.0 },
        foil_radius: foil.radius as f32,
        outer_wall_j_k: (s.wall.outer_fraction * s.wall.heat_capacity_j_k).max(LEAST_WALL_J_K)
            as f32,
        reversal_sd: s.tube.line().map_or(laws.reversal_sd, |_| HOSE_REVERSAL_SD),
        tube_m3: s.tube.volume_m3 as f32,
        hose_m3: bore.volume_m3(line_m) as f32,
        warming_m3: bore.warming_m3(&gas, s.tube.volume_m3, line_m, working_flow_kg_s(s)) as f32,
        layers_w_k: s.wall.conductance_w_k as f32,
        ..laws
    }
}

/// Dead time of a valve at the muscle's end of a line \[s\], with the travel time of sound.
fn dead_time_s(s: &Scenario) -> f64 {
    let [late_s, compensated_s] = flow_late_s(s);
    late_s.min(compensated_s)
}

/// Delay of a flow at the muscle's end of a line, and the longest delay that the core compensates \[s\]: a dead time
/// that ends within a period.
pub(super) fn flow_late_s(s: &Scenario) -> [f64; 2] {
    let valve = &s.valve;
    if s.tube.line().is_none() {
        return [valve.dead_time_s; 2];
    }
    let period_s = s.pwm_period_s();
    let stroke_s = match valve.kind {
        thermyo_scenario::ValveKind::Switching => valve.switch_time_s,
        thermyo_scenario::ValveKind::Proportional => 0.0,
    };
    let longest_s = (period_s - stroke_s).min(limits("valve.dead_time_s").max);
    [valve.dead_time_s + line_travel_s(s), longest_s.max(valve.dead_time_s)]
}

/// Travel time of sound through the line, 0 without one \[s\].
pub fn line_travel_s(s: &Scenario) -> f64 {
    let gas = IdealGas::new(&s.gas);
    let sound_m_s = (gas.k * gas.r * s.ambient.temperature_k).sqrt();
    s.tube.line().map_or(0.0, |[length_m, _]| length_m / sound_m_s)
}

/// Absolute pressure above which the board vents \[Pa\]: slightly below full scale, so that it
/// acts before the sensor saturates.
pub fn pressure_limit_pa(s: &Scenario) -> f64 {
    0.985 * s.sensor.pressure.range_pa
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_dead_time_within_a_period() {
        let dead_time_s = |tube: &str| {
            let text = format!("[tube]\nvolume_m3 = 1e-6\n{tube}");
            let config = core_config(&crate::parse(&text, "test".as_ref()).unwrap().believed);
            let ChamberConfig::Muscle(muscle) = config.chamber else { panic!("it is a muscle") };
            assert!((muscle.dead_volume_m3 - 6.0e-6).abs() < 1e-9, "a line's gas is not counted");
            config.valve.dead_time_s
        };
        assert_eq!(dead_time_s(""), 0.001);
        let line =
            |length_m: f64| dead_time_s(&format!("length_m = {length_m:?}\ndiameter_m = 0.004\n"));
        // 346 m/s at 298 K; 10 ms less 2 ms of closing.
        assert!((line(1.0) - 0.001 - 1.0 / 346.1).abs() < 1e-6, "{}", line(1.0));
        assert_eq!(line(8.0), 0.008);
    }

    /// Scenario and core define the same nominal muscle independently.
    #[test]
    fn the_defaults_agree() {
        let default = Config::default();
        let configured = |model| {
            let loaded = crate::parse("", "test".as_ref()).unwrap().with_model(model);
            core_config(&loaded.believed)
        };
        let (lumped, full) = (configured(PlantModel::Lumped), configured(PlantModel::Full));
        let (ChamberConfig::Muscle(a), ChamberConfig::Muscle(b)) =
            (lumped.chamber, default.chamber)
        else {
            panic!("both are muscles");
        };
        assert!((a.braid.thread_length_m / b.braid.thread_length_m - 1.0).abs() < 1e-6);
        assert!((a.braid.turns / b.braid.turns - 1.0).abs() < 1e-5);
        // The board's valves switch like those of the full plant, and its sensor has a housing; its lag is the
        // element's own.
        assert_eq!(full.valve, default.valve);
        let lag_s = |config: &Config| config.sensors.gas.time_constant_s;
        let mut sensors = full.sensors;
        sensors.gas.time_constant_s = lag_s(&lumped);
        assert_eq!(sensors, default.sensors);
        let Config { chamber, valve, sensors, heat, zones, .. } = lumped;
        assert_eq!(Config { chamber, valve, sensors, heat, zones, ..default }, lumped);
        // The laws of air at the working point, where the core's own defaults are constants.
        assert!((7.0..8.0).contains(&heat.inner_w_m2_k), "{heat:?}");
        assert!((5.0..11.0).contains(&zones.buoyancy_w_m2_k), "{zones:?}");
        assert!((1.0e5..2.0e5).contains(&heat.inner_per_flow), "{heat:?}");
    }
}
