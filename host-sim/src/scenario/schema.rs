//! Every key of a scenario: unit, what it may be, and what it means.
//!
//! Validation, suggestions and the comments of `thermyo check` all read this table. The values'
//! defaults are those of [`super::Scenario`]. No range is wider than what the core works with
//! (`model_core::config::Config::check`): a scenario that passes here, runs.

use model_core::config::{ControllerConfig, EstimatorConfig};
use model_core::parameter::Parameter;
use std::fmt;

/// A table of keys, such as `[sensor.gas]`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Table {
    /// Its path.
    pub name: &'static str,
    /// What it is about.
    pub meaning: &'static str,
    /// Whether `[believed]` may overlay it: the core has been told, and can have been told wrong.
    pub believed: bool,
    /// Its keys.
    pub keys: &'static [Key],
}

/// One key.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Key {
    /// Its name within the table.
    pub name: &'static str,
    /// What its value may be.
    pub allowed: Allowed,
    /// What it means.
    pub meaning: &'static str,
    /// It is the core's own, in f32.
    pub core: bool,
}

/// What a value may be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Allowed {
    /// A finite number; whole ones are taken too.
    Real(Limits),
    /// A whole number, both limits included.
    Whole {
        /// Smallest.
        min: i64,
        /// Largest.
        max: i64,
    },
    /// One of these words.
    Choice(&'static [&'static str]),
    /// Yes or no.
    Switch,
    /// A list of words; which ones, the rules say.
    List,
    /// The path of a CSV file with these two columns, relative to the scenario's folder.
    Csv {
        /// Its column of times and its column of values.
        columns: [&'static str; 2],
    },
}

/// A closed range, with its unit; no unit for a ratio.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Smallest.
    pub min: f64,
    /// Largest.
    pub max: f64,
    /// Unit, as the SI writes it.
    pub unit: &'static str,
}

impl Limits {
    /// Whether the value lies within; NaN does not.
    pub fn contains(&self, value: f64) -> bool {
        self.min <= value && value <= self.max
    }

    /// The same unit between other limits.
    pub fn between(&self, min: f64, max: f64) -> Self {
        Self { min, max, unit: self.unit }
    }

    /// "0.001 to 1e6". Limits that were computed are rounded inwards, so that what is printed is
    /// allowed.
    pub fn range(&self) -> String {
        format!("{} to {}", Rounded::up(self.min), Rounded::down(self.max))
    }
}

impl fmt::Display for Limits {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "a number from {}", self.range())?;
        if self.unit.is_empty() { Ok(()) } else { write!(f, " {}", self.unit) }
    }
}

impl fmt::Display for Allowed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Real(limits) => limits.fmt(f),
            Self::Whole { min, max } => write!(f, "a whole number from {min} to {max}"),
            Self::Choice(words) => write!(f, "one of {}", Words(words, ", ")),
            Self::Switch => f.write_str("true or false"),
            Self::List => f.write_str("a list of words, [\"...\", \"...\"]"),
            Self::Csv { columns: [time, value] } => {
                write!(f, "the path of a CSV file with the columns {time},{value}")
            }
        }
    }
}

impl Key {
    /// "s, 0.001 to 1e6: simulated time", the comment beside the key's value.
    pub fn comment(&self) -> String {
        let allowed = match self.allowed {
            Allowed::Real(limits) if limits.unit.is_empty() => limits.range(),
            Allowed::Real(limits) => format!("{}, {}", limits.unit, limits.range()),
            Allowed::Whole { min, max } => format!("{min} to {max}"),
            Allowed::Choice(words) => Words(words, " | ").to_string(),
            Allowed::Switch => "true | false".to_owned(),
            Allowed::List => "list of words".to_owned(),
            Allowed::Csv { columns: [time, value] } => format!("CSV file, {time},{value}"),
        };
        format!("{allowed}: {}", self.meaning)
    }
}

/// Quoted words and what stands between them.
struct Words<'a>(&'a [&'a str], &'a str);

impl fmt::Display for Words<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, word) in self.0.iter().enumerate() {
            if i > 0 {
                f.write_str(self.1)?;
            }
            write!(f, "\"{word}\"")?;
        }
        Ok(())
    }
}

/// A number of at most six significant digits.
struct Rounded(f64);

impl Rounded {
    fn up(value: f64) -> Self {
        Self(-Self::down(-value).0)
    }

    fn down(value: f64) -> Self {
        if value == 0.0 || !value.is_finite() {
            return Self(value);
        }
        let digits = |x: f64| format!("{x:.5e}").parse::<f64>().unwrap_or(x);
        let nearest = digits(value);
        if nearest <= value {
            return Self(nearest);
        }
        let last_digit = 10_f64.powi(value.abs().log10().floor() as i32 - 5);
        Self(digits(nearest - last_digit))
    }
}

impl fmt::Display for Rounded {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (plain, scientific) = (self.0.to_string(), format!("{:e}", self.0));
        let familiar = self.0 == 0.0 || (1e-3..1e5).contains(&self.0.abs());
        f.write_str(if familiar || plain.len() <= scientific.len() { &plain } else { &scientific })
    }
}

const fn real(
    name: &'static str,
    unit: &'static str,
    (min, max): (f64, f64),
    meaning: &'static str,
) -> Key {
    Key { name, allowed: Allowed::Real(Limits { min, max, unit }), meaning, core: false }
}

const fn whole(name: &'static str, (min, max): (i64, i64), meaning: &'static str) -> Key {
    Key { name, allowed: Allowed::Whole { min, max }, meaning, core: false }
}

const fn choice(name: &'static str, words: &'static [&'static str], meaning: &'static str) -> Key {
    Key { name, allowed: Allowed::Choice(words), meaning, core: false }
}

const fn switch(name: &'static str, meaning: &'static str) -> Key {
    Key { name, allowed: Allowed::Switch, meaning, core: false }
}

const fn list(name: &'static str, meaning: &'static str) -> Key {
    Key { name, allowed: Allowed::List, meaning, core: false }
}

const fn csv(name: &'static str, columns: [&'static str; 2], meaning: &'static str) -> Key {
    Key { name, allowed: Allowed::Csv { columns }, meaning, core: false }
}

/// The keys of a table that the core declares.
const fn declared<const N: usize>(parameters: &[Parameter]) -> [Key; N] {
    let mut keys = [switch("", ""); N];
    let mut i = 0;
    while i < N {
        let Parameter { name, unit, minimum, maximum, meaning, .. } = parameters[i];
        keys[i] = Key { core: true, ..real(name, unit, (minimum, maximum), meaning) };
        i += 1;
    }
    keys
}

const PRESSURE_PA: (f64, f64) = (1.0, 1.0e8);
const TEMPERATURE_K: (f64, f64) = (100.0, 1000.0);
const VOLUME_M3: (f64, f64) = (1.0e-9, 1.0e6);
const SHARE: (f64, f64) = (0.0, 1.0);
const FORCE_N: (f64, f64) = (0.0, 1.0e5);
const COEFFICIENT_W_M2_K: (f64, f64) = (0.0, 1.0e5);
const CONDUCTANCE_M3_S_PA: (f64, f64) = (1.0e-13, 1.0e-3);
const LAG_S: (f64, f64) = (0.0, 1000.0);
const CHANNEL: &[&str] = &["none", "open", "shorted", "frozen", "noisy", "drifting"];
const VALVE: &[&str] = &["none", "open", "shut", "leaking"];

/// Every table, in the order of [`super::Scenario`].
pub static TABLES: &[Table] = &[
    Table {
        name: "run",
        meaning: "length, step, seed",
        believed: false,
        keys: &[
            real("duration_s", "s", (0.001, 1.0e6), "simulated time"),
            real("step_s", "s", (1.0e-4, 0.1), "step of the core"),
            whole("seed", (0, i64::MAX), "seed of every random number"),
            whole("log_every", (1, 1_000_000_000), "one row of the trace per that many steps"),
        ],
    },
    Table {
        name: "gas",
        meaning: "the ideal gas",
        believed: true,
        keys: &[
            real("gas_constant_j_kg_k", "J/(kg K)", (50.0, 5000.0), "specific gas constant R"),
            real("heat_capacity_ratio", "", (1.01, 1.7), "ratio of specific heats k"),
        ],
    },
    Table {
        name: "ambient",
        meaning: "the surroundings",
        believed: true,
        keys: &[
            real("pressure_pa", "Pa", PRESSURE_PA, "absolute pressure"),
            real("temperature_k", "K", TEMPERATURE_K, "temperature"),
        ],
    },
    Table {
        name: "supply",
        meaning: "the compressed air behind the inlet valve",
        believed: true,
        keys: &[
            real("pressure_pa", "Pa", PRESSURE_PA, "absolute pressure at no flow"),
            real("temperature_k", "K", TEMPERATURE_K, "temperature of the gas that flows in"),
            real(
                "droop_pa_s_kg",
                "Pa s/kg",
                (0.0, 1.0e12),
                "pressure that the regulator loses per mass flow (full)",
            ),
        ],
    },
    Table {
        name: "plant",
        meaning: "what is simulated",
        believed: false,
        keys: &[
            choice("kind", &["muscle", "vessel"], "what holds the gas"),
            choice(
                "model",
                &["full", "lumped", "paper"],
                "zones, wall layers and real valves; one zone; the paper's eq. (12)",
            ),
            real("initial_pressure_pa", "Pa", PRESSURE_PA, "absolute pressure at the start"),
            real(
                "initial_temperature_k",
                "K",
                TEMPERATURE_K,
                "temperature of gas, wall and sensors at the start",
            ),
        ],
    },
    Table {
        name: "muscle",
        meaning: "the McKibben muscle: thread_length_m and turns, or diameter_m and \
                  braid_angle_deg, with rest_length_m; the others follow",
        believed: true,
        keys: &[
            real("thread_length_m", "m", (0.01, 10.0), "thread length b"),
            real("turns", "", (0.1, 1000.0), "thread turns n"),
            real("rest_length_m", "m", (0.005, 10.0), "length at rest, the longest"),
            real("diameter_m", "m", (1.0e-7, 30.0), "diameter at rest"),
            real("braid_angle_deg", "deg", (3.0, 54.0), "angle of the threads to the axis at rest"),
            whole("zones", (1, 64), "axial zones of gas and wall (full)"),
            real(
                "bladder_stiffness_n_m",
                "N/m",
                (0.0, 1.0e6),
                "stiffness of the bladder against contraction",
            ),
            real("dead_volume_m3", "m3", (0.0, 0.05), "volume of the end fittings"),
        ],
    },
    Table {
        name: "vessel",
        meaning: "the vessel",
        believed: true,
        keys: &[
            real("volume_m3", "m3", VOLUME_M3, "gas volume, where volume_csv does not say it"),
            real("surface_m2", "m2", (0.0, 1.0e3), "inner surface"),
            real("wall_heat_capacity_j_k", "J/K", (0.01, 1.0e9), "heat capacity of the wall"),
            csv("volume_csv", ["time_s", "volume_m3"], "volume over time, of a moving piston"),
            real("dead_volume_m3", "m3", (0.0, 1.0e6), "added to what volume_csv gives"),
            real(
                "characteristic_length_m",
                "m",
                (0.001, 300.0),
                "diameter, for the heat-transfer correlation and for the position of a piston",
            ),
        ],
    },
    Table {
        name: "paper",
        meaning: "coefficients of eq. (9) and (12), from 1 (isothermal) to k (adiabatic)",
        believed: false,
        keys: &[
            real("alpha_in", "", (1.0, 1.7), "charging"),
            real("alpha_out", "", (1.0, 1.7), "discharging"),
            real("alpha", "", (1.0, 1.7), "change of volume"),
        ],
    },
    Table {
        name: "heat",
        meaning: "heat transfer",
        believed: true,
        keys: &[
            choice(
                "model",
                &["adiabatic", "isothermal", "constant", "correlation"],
                "from gas to wall",
            ),
            real("scale", "", (1.0e-3, 1.0e3), "gas to wall: factor on what model gives"),
            real("inner_w_m2_k", "W/(m2 K)", COEFFICIENT_W_M2_K, "gas to wall, still gas"),
            real(
                "inner_per_flow",
                "W/(m2 K) per kg/s",
                (0.0, 1.0e9),
                "gas to wall, gained per inflow",
            ),
            real("outer_w_m2_k", "W/(m2 K)", COEFFICIENT_W_M2_K, "wall to ambient, at rest"),
            real(
                "outer_per_speed",
                "W/(m2 K) per m/s",
                (0.0, 1.0e6),
                "wall to ambient, gained per speed of contraction",
            ),
        ],
    },
    Table {
        name: "wall",
        meaning: "the muscle's wall",
        believed: true,
        keys: &[
            real("heat_capacity_j_k", "J/K", (0.01, 1.0e9), "heat capacity of bladder and braid"),
            real("outer_fraction", "", (0.01, 0.99), "part of it that is the braid (full)"),
            real(
                "conductance_w_k",
                "W/K",
                (0.0, 1.0e6),
                "from the inner to the outer layer (full)",
            ),
        ],
    },
    Table {
        name: "friction",
        meaning: "friction of braid and bladder",
        believed: true,
        keys: &[
            real("force_n", "N", FORCE_N, "Coulomb friction at the reference temperature"),
            real("reference_temperature_k", "K", TEMPERATURE_K, "reference temperature"),
            real(
                "softening_per_k",
                "1/K",
                (-0.2, 0.2),
                "beta in F = F_ref exp(-beta (T_wall - T_ref))",
            ),
            real("heat_fraction", "", SHARE, "share of the friction heat that the wall gets"),
            real("stribeck_force_n", "N", FORCE_N, "surplus at standstill (full)"),
            real(
                "stribeck_speed_m_s",
                "m/s",
                (1.0e-6, 10.0),
                "speed at which that surplus has fallen to 1/e (full)",
            ),
            real("viscous_n_s_m", "N s/m", (0.0, 1.0e6), "viscous part (full)"),
            real(
                "presliding_stiffness_n_m",
                "N/m",
                (0.0, 1.0e9),
                "stiffness of the presliding bristles (full)",
            ),
        ],
    },
    Table {
        name: "load",
        meaning: "what the muscle pulls",
        believed: true,
        keys: &[
            choice(
                "kind",
                &["isotonic", "isometric", "mass"],
                "a constant force, a fixed length, a hanging mass",
            ),
            real("force_n", "N", (0.0, 1.0e6), "the force (isotonic)"),
            real("length_m", "m", (0.001, 10.0), "the length held (isometric)"),
            real(
                "mass_kg",
                "kg",
                (0.0, 1.0e5),
                "the mass (mass); what moves with the muscle's end (isotonic, full)",
            ),
        ],
    },
    Table {
        name: "valve",
        meaning: "inlet and outlet valve (ISO 6358)",
        believed: true,
        keys: &[
            real("conductance_m3_s_pa", "m3/(s Pa)", CONDUCTANCE_M3_S_PA, "sonic conductance C"),
            real("critical_ratio", "", (0.01, 0.99), "critical pressure ratio b"),
            real("switch_time_s", "s", (0.0, 0.1), "from closed to open, and back"),
            real("dead_time_s", "s", (0.0, 0.1), "from the pin to the first movement"),
            real("pwm_hz", "Hz", (0.01, 1.0e5), "PWM frequency"),
        ],
    },
    Table {
        name: "tube",
        meaning: "the tube between valves and muscle (full)",
        believed: true,
        keys: &[
            real("volume_m3", "m3", (1.0e-9, 0.05), "volume"),
            real(
                "conductance_m3_s_pa",
                "m3/(s Pa)",
                CONDUCTANCE_M3_S_PA,
                "sonic conductance of tube and port",
            ),
        ],
    },
    Table {
        name: "orifice",
        meaning: "the nozzle of a vessel",
        believed: true,
        keys: &[
            real("diameter_m", "m", (1.0e-6, 10.0), "diameter"),
            real("discharge_coefficient", "", (0.01, 1.0), "discharge coefficient"),
        ],
    },
    Table {
        name: "drive",
        meaning: "what drives the run",
        believed: false,
        keys: &[
            choice(
                "kind",
                &["mass-flow", "duty", "pressure", "contraction", "discharge", "fill", "closed"],
                "what is given",
            ),
            real("period_s", "s", (1.0e-3, 86_400.0), "period of the cycle (mass-flow)"),
            real(
                "flow_kg_s",
                "kg/s",
                (0.0, 1.0),
                "flow, in for half of the period, then out (mass-flow)",
            ),
            real("pressure_pa", "Pa", PRESSURE_PA, "set point, absolute (pressure)"),
            real(
                "contraction",
                "",
                (0.0, 0.45),
                "set point, fraction of the rest length (contraction)",
            ),
            csv(
                "profile_csv",
                ["time_s", "value"],
                "flow (negative: out), duty (negative: outlet), pressure or contraction over time",
            ),
        ],
    },
    Table {
        name: "sensor.gas",
        meaning: "Pt1000 foil in the gas",
        believed: true,
        keys: &[
            real("time_constant_s", "s", LAG_S, "lag"),
            real("noise_k", "K", (0.0, 100.0), "noise of one conversion, standard deviation"),
            real("position", "", SHARE, "its middle, from port 0 to closed end 1 (full)"),
            real("span", "", SHARE, "part of the length that it averages over (full)"),
            real("range_min_k", "K", (73.0, 800.0), "lowest temperature resolved"),
            real("range_max_k", "K", (74.0, 1100.0), "highest temperature resolved"),
            real(
                "density_exponent",
                "",
                (0.0, 1.0),
                "n in lag ~ density^-n, time_constant_s at the start; 0.5 in free convection",
            ),
            real("housing_time_constant_s", "s", LAG_S, "lag of its housing, in series (full)"),
        ],
    },
    Table {
        name: "sensor.wall",
        meaning: "sensor in the braided wall",
        believed: true,
        keys: &[
            real("time_constant_s", "s", LAG_S, "lag"),
            real("noise_k", "K", (0.0, 100.0), "noise of one reading, standard deviation"),
            real("position", "", SHARE, "from port 0 to closed end 1 (full)"),
        ],
    },
    Table {
        name: "sensor.pressure",
        meaning: "absolute pressure sensor, 10 to 90 % of the reference over its range",
        believed: true,
        keys: &[
            real("time_constant_s", "s", LAG_S, "lag"),
            real("noise_pa", "Pa", (0.0, 1.0e8), "noise of one conversion, standard deviation"),
            real("range_pa", "Pa", (1000.0, 1.0e9), "full scale; the range starts at 0"),
        ],
    },
    Table {
        name: "sensor.length",
        meaning: "length potentiometer",
        believed: true,
        keys: &[
            real("time_constant_s", "s", LAG_S, "lag"),
            real("noise_m", "m", (0.0, 10.0), "noise of one conversion, standard deviation"),
            real("range_m", "m", (0.001, 100.0), "full scale; the range starts at 0"),
        ],
    },
    Table {
        name: "estimator",
        meaning: "estimator tuning; a drift is what a random walk gains in one second",
        believed: true,
        keys: &declared::<{ EstimatorConfig::PARAMETERS.len() }>(EstimatorConfig::PARAMETERS),
    },
    Table {
        name: "controller",
        meaning: "controller tuning",
        believed: true,
        keys: &declared::<{ ControllerConfig::PARAMETERS.len() }>(ControllerConfig::PARAMETERS),
    },
    Table {
        name: "link",
        meaning: "line between host and board",
        believed: false,
        keys: &[real(
            "timeout_s",
            "s",
            (0.0, 3600.0),
            "silence of the host after which the board vents; 0: it goes on alone",
        )],
    },
    Table {
        name: "faults",
        meaning: "faults that the run injects in one window of time; every [faults.NAME] is another",
        believed: false,
        keys: &[
            choice("pressure", CHANNEL, "fault of the pressure channel"),
            real(
                "pressure_drift_pa_s",
                "Pa/s",
                (-1.0e8, 1.0e8),
                "drift of its sensor from the start on (drifting)",
            ),
            choice("gas", CHANNEL, "fault of the gas sensor's channel"),
            real(
                "gas_drift_k_s",
                "K/s",
                (-1000.0, 1000.0),
                "drift of its sensor from the start on (drifting)",
            ),
            choice("length", CHANNEL, "fault of the length channel"),
            real(
                "length_drift_m_s",
                "m/s",
                (-10.0, 10.0),
                "drift of its sensor from the start on (drifting)",
            ),
            choice("inlet", VALVE, "fault of the inlet valve: stuck open, stuck shut, not tight"),
            real("inlet_leak", "", SHARE, "share of the conductance passed when shut (leaking)"),
            choice("outlet", VALVE, "fault of the outlet valve: stuck open, stuck shut, not tight"),
            real("outlet_leak", "", SHARE, "share of the conductance passed when shut (leaking)"),
            real(
                "leak_conductance_m3_s_pa",
                "m3/(s Pa)",
                (0.0, 1.0e-3),
                "sonic conductance of a hole from the gas to ambient, large for a burst; 0: none",
            ),
            real(
                "supply_pressure_pa",
                "Pa",
                PRESSURE_PA,
                "in place of the supply's own; below the gas's, gas flows back through an open inlet",
            ),
            switch("emergency_stop", "the emergency stop is pressed"),
            choice(
                "link",
                &["none", "lost", "flooded"],
                "fault of the line to the board: the host is silent, or sends too much",
            ),
            whole("missed_steps", (0, 200), "steps that the board leaves out together"),
            real(
                "missed_period_s",
                "s",
                (1.0e-3, 1.0e6),
                "they are left out again after that time",
            ),
            real("from_s", "s", (0.0, 1.0e6), "start of the window"),
            real("until_s", "s", (0.0, 1.0e6), "end of the window"),
        ],
    },
    Table {
        name: "identify",
        meaning: "what thermyo identify fits to measurements",
        believed: false,
        keys: &[
            list("parameters", "keys whose values are fitted, such as heat.inner_w_m2_k"),
            list("columns", "measured columns to compare with; empty: all that the data has"),
            whole("starts", (1, 100), "starts of the search, the scenario's own values first"),
            real("spread", "", (1.0, 100.0), "factor that the other starts lie within"),
        ],
    },
];

/// The table of that path. A further window of faults has the keys of `[faults]`.
pub fn table(path: &str) -> Option<&'static Table> {
    let name = if is_fault_window(path) { FAULTS } else { path };
    TABLES.iter().find(|table| table.name == name)
}

/// The table of the first window of faults.
pub const FAULTS: &str = "faults";
/// What the paths of the further ones start with.
pub const FAULT_WINDOWS: &str = "faults.";

/// Whether `path` is that of a further window of faults, `faults.NAME`. NAME is what TOML takes
/// without quotes, and no key of `[faults]`.
pub fn is_fault_window(path: &str) -> bool {
    let bare = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-';
    path.strip_prefix(FAULT_WINDOWS)
        .is_some_and(|name| !name.is_empty() && name.chars().all(bare) && key(path).is_none())
}

/// The key of that path, "muscle.zones", with its table.
pub fn key(path: &str) -> Option<(&'static Table, &'static Key)> {
    let (table_path, name) = path.rsplit_once('.')?;
    let table = table(table_path)?;
    Some((table, table.keys.iter().find(|key| key.name == name)?))
}

/// The limits of a number by its path.
///
/// # Panics
/// For a path that is no number: a slip in this program, not in a scenario.
pub fn limits(path: &str) -> Limits {
    match key(path).map(|(_, key)| key.allowed) {
        Some(Allowed::Real(limits)) => limits,
        _ => panic!("{path} is not a number of the schema"),
    }
}

/// Tables that describe the run, not the thing that is measured.
const NOT_PHYSICAL: [&str; 7] =
    ["run", "drive", "estimator", "controller", "link", "faults", "identify"];
/// Beginnings of the names of keys that say how a quantity is recorded.
const OF_RECORDING: [&str; 2] = ["noise_", "range_"];
/// Dimensions of the braid, which follow from each other.
const OF_BRAID: [&str; 5] =
    ["thread_length_m", "turns", "rest_length_m", "diameter_m", "braid_angle_deg"];

/// The limits of a number that measurements can be asked for, by its path.
pub fn fittable(path: &str) -> Option<Limits> {
    let (table, key) = key(path)?;
    let excluded = NOT_PHYSICAL.contains(&table.name)
        || OF_RECORDING.iter().any(|start| key.name.starts_with(start))
        || (table.name == "muscle" && OF_BRAID.contains(&key.name));
    match key.allowed {
        Allowed::Real(limits) if !excluded => Some(limits),
        _ => None,
    }
}

/// Every path that is [`fittable`].
pub fn fittable_paths() -> impl Iterator<Item = String> {
    TABLES
        .iter()
        .flat_map(|table| table.keys.iter().map(|key| format!("{}.{}", table.name, key.name)))
        .filter(|path| fittable(path).is_some())
}

/// Whether `path` is a table, or holds tables only, such as `sensor`.
pub fn is_table(path: &str) -> bool {
    TABLES.iter().any(|table| {
        table.name.strip_prefix(path).is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::Scenario;
    use std::collections::BTreeSet;
    use toml::Value;

    /// Every leaf of a tree of tables; tables without keys too.
    fn leaves(path: &str, value: &Value, found: &mut Vec<(String, Value)>) {
        match value.as_table() {
            Some(table) if !table.is_empty() => {
                for (name, value) in table {
                    let path =
                        if path.is_empty() { name.clone() } else { format!("{path}.{name}") };
                    leaves(&path, value, found);
                }
            }
            _ => found.push((path.to_owned(), value.clone())),
        }
    }

    fn complete() -> Value {
        let mut scenario = Scenario::default();
        let muscle = &mut scenario.muscle;
        for dimension in [
            &mut muscle.thread_length_m,
            &mut muscle.turns,
            &mut muscle.rest_length_m,
            &mut muscle.diameter_m,
            &mut muscle.braid_angle_deg,
        ] {
            *dimension = Some(1.0);
        }
        scenario.vessel.volume_csv = Some("a.csv".into());
        scenario.drive.profile_csv = Some("b.csv".into());
        let faults = &mut scenario.faults.own;
        for number in [
            &mut faults.pressure_drift_pa_s,
            &mut faults.gas_drift_k_s,
            &mut faults.length_drift_m_s,
            &mut faults.inlet_leak,
            &mut faults.outlet_leak,
            &mut faults.supply_pressure_pa,
        ] {
            *number = Some(1.0);
        }
        Value::try_from(scenario).unwrap()
    }

    #[test]
    fn the_table_and_the_structs_name_the_same_keys() {
        let mut found = Vec::new();
        leaves("", &complete(), &mut found);
        let structs: BTreeSet<String> = found.iter().map(|(path, _)| path.clone()).collect();
        let listed: Vec<String> = TABLES
            .iter()
            .flat_map(|table| {
                let keys = table.keys.iter().map(|key| format!("{}.{}", table.name, key.name));
                keys.chain(table.keys.is_empty().then(|| table.name.to_owned()))
            })
            .collect();
        assert_eq!(listed.iter().cloned().collect::<BTreeSet<_>>(), structs);
        assert_eq!(listed.len(), structs.len(), "a key is listed twice");
    }

    #[test]
    fn types_and_words_are_those_of_the_structs() {
        let complete = complete();
        for table in TABLES {
            for key in table.keys {
                let with = |value: Value| {
                    let mut tree = complete.clone();
                    let mut place = &mut tree;
                    for name in table.name.split('.') {
                        place = &mut place[name];
                    }
                    place[key.name] = value;
                    tree.try_into::<Scenario>().map_err(|error| error.message().to_owned())
                };
                let path = format!("{}.{}", table.name, key.name);
                match key.allowed {
                    Allowed::Real(limits) => {
                        assert!(limits.min < limits.max, "{path}");
                        with(Value::Float(limits.max)).expect(&path);
                    }
                    Allowed::Whole { min, max } => {
                        with(Value::Integer(min)).expect(&path);
                        with(Value::Integer(max)).expect(&path);
                        assert!(with(Value::Float(1.5)).is_err(), "{path}");
                    }
                    Allowed::Choice(words) => {
                        // serde lists the words it knows.
                        let message = with(Value::String("?".to_owned())).unwrap_err();
                        let known: BTreeSet<&str> = message.split('`').skip(3).step_by(2).collect();
                        assert_eq!(known, words.iter().copied().collect(), "{path}: {message}");
                    }
                    Allowed::Switch => {
                        with(Value::Boolean(true)).expect(&path);
                        assert!(with(Value::Integer(1)).is_err(), "{path}");
                    }
                    Allowed::List => {
                        with(Value::Array(vec![Value::String("word".to_owned())])).expect(&path);
                        assert!(with(Value::Array(vec![Value::Integer(1)])).is_err(), "{path}");
                    }
                    Allowed::Csv { .. } => {
                        with(Value::String("c.csv".to_owned())).expect(&path);
                    }
                }
            }
        }
    }

    #[test]
    fn printed_limits_are_allowed() {
        let limits = Limits { min: 0.188_163_41, max: 2.0 / 3.0, unit: "m" };
        assert_eq!(limits.to_string(), "a number from 0.188164 to 0.666666 m");
        let plain = Limits { min: -1.0e9, max: 0.001, unit: "" };
        assert_eq!(plain.to_string(), "a number from -1e9 to 0.001");
        for x in [1.0 / 3.0, 1e-9 / 7.0, 12_345.678_9, 99_999.999_9, 1e8 / 3.0, 1.0, 9.999_999_9] {
            let (up, down) = (Rounded::up(x).0, Rounded::down(x).0);
            assert!(down <= x && x <= up && (up - down) / x < 3e-5, "{down} {x} {up}");
        }
    }
}
