//! Parts with public figures, by name: a muscle that was measured, valves and pressure sensors by
//! their data sheets. A key in the file stands above its preset's value.

use super::declare::choice;
use toml::Value;

#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PresetValue {
    Number(f64),
    Word(&'static str),
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Preset {
    /// Table of its key `preset`.
    pub table: &'static str,
    pub word: &'static str,
    pub values: &'static [(&'static str, PresetValue)],
    /// Source, and what the values leave of it.
    pub source: &'static str,
    /// Keys that no source has for it.
    pub unknown: &'static [&'static str],
}

choice! {
    MusclePreset {
        None = "none",
        Dmsp10 = "dmsp-10",
        Dmsp20 = "dmsp-20",
    }
}

choice! {
    ValvePreset {
        None = "none",
        Mhe2 = "mhe2-class",
        Mhe3 = "mhe3-class",
        Mhe4 = "mhe4-class",
        Mhj10 = "mhj10-class",
    }
}

choice! {
    PressurePreset {
        None = "none",
        Hsc100 = "hsc-100psi-a",
        Hsc150 = "hsc-150psi-a",
        Mpr25 = "mpr-25psi-a",
    }
}

const fn number(value: f64) -> PresetValue {
    PresetValue::Number(value)
}

/// By the nominal flow q of a data sheet, 6 to 5 bar gauge: q = C 7 bar sqrt(1 - ((6/7 - b)/(1 - b))^2)
/// with b = 0.3, which they do not state: 100 l/min are 3.93e-9 m3/(s Pa).
const fn valve(litres_per_min: f64, switch_time_s: f64) -> [(&'static str, PresetValue); 5] {
    [
        ("valve.kind", PresetValue::Word("switching")),
        ("valve.conductance_m3_s_pa", number(3.93e-11 * litres_per_min)),
        ("valve.critical_ratio", number(0.3)),
        ("valve.switch_time_s", number(switch_time_s)),
        ("valve.dead_time_s", number(0.0)),
    ]
}

const MHE2: [(&str, PresetValue); 5] = valve(100.0, 0.002);
const MHE3: [(&str, PresetValue); 5] = valve(200.0, 0.0028);
const MHE4: [(&str, PresetValue); 5] = valve(400.0, 0.0035);
const MHJ10: [(&str, PresetValue); 5] = valve(100.0, 0.001);

const fn valve_preset(
    word: &'static str,
    values: &'static [(&'static str, PresetValue)],
    source: &'static str,
) -> Preset {
    let unknown = &["valve.critical_ratio", "valve.dead_time_s"];
    Preset { table: "valve", word, values, source, unknown }
}

/// A ratiometric sensor of 10 to 90 %, with that range \[Pa\]: 0.03 % of it resolved, 1 ms.
const fn ratiometric(range_pa: f64) -> [(&'static str, PresetValue); 4] {
    [
        ("sensor.pressure.kind", PresetValue::Word("ratiometric")),
        ("sensor.pressure.range_pa", number(range_pa)),
        ("sensor.pressure.noise_pa", number(3.0e-4 * range_pa)),
        ("sensor.pressure.time_constant_s", number(0.001)),
    ]
}

const HSC100: [(&str, PresetValue); 4] = ratiometric(689_476.0);
const HSC150: [(&str, PresetValue); 4] = ratiometric(1_034_214.0);

const fn sensor_preset(
    word: &'static str,
    values: &'static [(&'static str, PresetValue)],
    source: &'static str,
) -> Preset {
    let unknown = &["sensor.pressure.gain", "sensor.pressure.offset_pa"];
    Preset { table: "sensor.pressure", word, values, source, unknown }
}

pub static PRESETS: [Preset; 9] = [
    Preset {
        table: "muscle",
        word: "dmsp-10",
        values: &[
            ("muscle.rest_length_m", number(0.25)),
            ("muscle.diameter_m", number(0.013_87)),
            ("muscle.braid_angle_deg", number(28.06)),
            ("muscle.bladder_stiffness_n_m", number(0.0)),
            ("muscle.bladder_saturation_n", number(236.0)),
            ("muscle.bladder_strain", number(0.026)),
            ("muscle.slack_m", number(0.001_38)),
            ("muscle.slip_force_n", number(6.5)),
            ("muscle.slip_stiffness_n_m", number(3100.0)),
            ("muscle.slip_pressure_factor", number(0.0)),
            ("muscle.creep_fast_n_m", number(2470.0)),
            ("muscle.creep_fast_s", number(0.45)),
            ("muscle.creep_slow_n_m", number(1500.0)),
            ("muscle.creep_slow_s", number(26.0)),
            ("friction.force_n", number(0.0)),
            ("friction.stribeck_force_n", number(0.0)),
        ],
        source: "Festo DMSP-10-250: braid and slack by its published static map, the rest by its stroke over \
                 pressure as others recorded it, of which 0.3 mm are left in unseen holds",
        unknown: &["muscle.dead_volume_m3", "wall.heat_capacity_j_k", "friction.softening_per_k"],
    },
    Preset {
        table: "muscle",
        word: "dmsp-20",
        values: &[
            ("muscle.rest_length_m", number(0.296)),
            ("muscle.diameter_m", number(0.028_57)),
            ("muscle.braid_angle_deg", number(31.84)),
            ("muscle.bladder_stiffness_n_m", number(0.0)),
            ("muscle.bladder_saturation_n", number(302.4)),
            ("muscle.bladder_strain", number(0.0126)),
            ("muscle.slack_m", number(0.001_75)),
            ("muscle.slip_force_n", number(0.0)),
            ("muscle.creep_fast_n_m", number(0.0)),
            ("muscle.creep_slow_n_m", number(0.0)),
        ],
        source: "Festo DMSP-20-300: its published static map, of which 7.8 N of 1654 N are left; slip and \
                 creep have no values, and are off",
        unknown: &[
            "muscle.slip_force_n",
            "muscle.creep_fast_n_m",
            "muscle.creep_slow_n_m",
            "friction.force_n",
            "muscle.dead_volume_m3",
            "wall.heat_capacity_j_k",
        ],
    },
    valve_preset(
        "mhe2-class",
        &MHE2,
        "fast 3/2 valve of 2 mm: 100 l/min nominal, 2 ms by its data sheet",
    ),
    valve_preset(
        "mhe3-class",
        &MHE3,
        "fast 3/2 valve of 3 mm: 200 l/min nominal, 2.8 ms by its data sheet",
    ),
    valve_preset(
        "mhe4-class",
        &MHE4,
        "fast 3/2 valve of 4 mm: 400 l/min nominal, 3.5 ms by its data sheet",
    ),
    valve_preset(
        "mhj10-class",
        &MHJ10,
        "fast 2/2 valve with electronics: 100 l/min nominal, up to 1000 switches a second by its data \
                 sheet; types of 50 to 160 l/min exist",
    ),
    sensor_preset(
        "hsc-100psi-a",
        &HSC100,
        "Honeywell HSC, analogue, 0 to 100 psi absolute: 10 to 90 % of the supply, 1 ms, 0.03 % \
                 resolved, 1 % in all by its data sheet",
    ),
    sensor_preset(
        "hsc-150psi-a",
        &HSC150,
        "Honeywell HSC, analogue, 0 to 150 psi absolute: 10 to 90 % of the supply, 1 ms, 0.03 % \
                 resolved, 1 % in all by its data sheet",
    ),
    sensor_preset(
        "mpr-25psi-a",
        &[
            ("sensor.pressure.kind", PresetValue::Word("mpr")),
            ("sensor.pressure.range_pa", number(172_369.0)),
        ],
        "Honeywell MPR, digital, 0 to 25 psi absolute: 10 to 90 % of its counts, 5 ms by its data sheet",
    ),
];

impl Preset {
    /// The preset of a table's word; none for "none".
    pub fn of(table: &str, word: &str) -> Option<&'static Self> {
        PRESETS.iter().find(|preset| preset.table == table && preset.word == word)
    }
}

impl PresetValue {
    /// As a file has it.
    pub fn toml(self) -> Value {
        match self {
            Self::Number(number) => Value::Float(number),
            Self::Word(word) => Value::String(word.to_owned()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::key::Allowed;
    use crate::schema;

    #[test]
    fn every_preset_is_a_word_with_values_that_are_allowed() {
        for preset in &PRESETS {
            let (_, key) = schema::key(&format!("{}.preset", preset.table)).unwrap();
            let Allowed::Choice(words) = key.allowed else { panic!("{preset:?}") };
            assert!(words.contains(&preset.word), "{preset:?}");
            for (path, value) in preset.values {
                let (_, key) = schema::key(path).unwrap();
                let allowed = match (key.allowed, value) {
                    (Allowed::Real(limits), PresetValue::Number(number)) => {
                        limits.contains(*number)
                    }
                    (Allowed::Choice(words), PresetValue::Word(word)) => words.contains(word),
                    _ => false,
                };
                assert!(allowed, "{path} = {value:?}");
            }
            assert!(preset.unknown.iter().all(|path| schema::key(path).is_some()), "{preset:?}");
        }
        for (table, words) in [
            ("muscle", MusclePreset::WORDS),
            ("valve", ValvePreset::WORDS),
            ("sensor.pressure", PressurePreset::WORDS),
        ] {
            let found = words.iter().filter(|word| Preset::of(table, word).is_some());
            assert_eq!(found.count(), words.len() - 1, "{table}");
        }
    }
}
