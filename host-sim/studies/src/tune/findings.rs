//! Table of the values before and after, their errors, and the reasons for values that were kept.

use super::check::{Checked, Figures};
use super::experiment::Record;
use super::force::Force;
use super::gains::{Basis, LoopGains};
use super::regression::Measure;
use super::valve::Steps;
use serde::Serialize;
use thermyo_files::number::{quantity, significant};
use thermyo_plant::chamber::Tunable;
use thermyo_scenario::schema::limits;
use thermyo_scenario::{PlantModel, number};
use thermyo_setup::{Loaded, core_config::line_travel_s};

/// Relative difference up to which two errors on the check's sine count as equal \[-\].
const EQUAL: f64 = 0.1;

#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Parameter {
    pub path: &'static str,
    /// Value in the core's configuration before tuning \[unit\].
    pub before: f64,
    /// Value after tuning \[unit\].
    pub after: f64,
    /// Standard error \[unit\]; none if the value was kept or follows from a bound.
    pub standard_error: Option<f64>,
    pub unit: &'static str,
    /// Source of the value, or the reason why it was kept.
    pub remark: String,
}

pub(super) struct Parts<'a> {
    pub configured: &'a Loaded,
    pub force: &'a Force,
    pub tunable: Tunable,
    /// Steps of inlet and outlet.
    pub steps: [Steps; 2],
    pub switching: bool,
    pub switch_time_s: Option<Measure>,
    pub delay_s: Measure,
    pub gains: &'a LoopGains,
}

impl Parts<'_> {
    fn before(&self, path: &str) -> f64 {
        number(&self.configured.believed, path).expect("a number of the scenario")
    }

    fn measured(&self, path: &'static str, found: Measure, remark: &str) -> Parameter {
        let Measure { value, error } = found;
        self.bound(path, value, remark).with_error(error)
    }

    fn bound(&self, path: &'static str, after: f64, remark: &str) -> Parameter {
        Parameter {
            path,
            before: self.before(path),
            after,
            standard_error: None,
            unit: limits(path).unit,
            remark: remark.to_owned(),
        }
    }

    fn kept(&self, path: &'static str, why: &str) -> Parameter {
        self.bound(path, self.before(path), &format!("kept: {why}"))
    }

    /// Every value, in the order of the table.
    pub fn parameters(&self) -> Vec<Parameter> {
        let mut all = self.friction();
        all.extend(self.chamber());
        all.extend(self.valves());
        all.extend(self.controller());
        all
    }

    fn friction(&self) -> Vec<Parameter> {
        let force = self.force;
        let full = self.configured.believed.plant.model == PlantModel::Full;
        let mut all = vec![
            self.measured("friction.force_n", force.coulomb_n, "half of the hysteresis"),
            match force.softening_per_k {
                Some(found) => self.measured(
                    "friction.softening_per_k",
                    found,
                    "hysteresis over wall temperature",
                ),
                None => {
                    let [low, high] = force.wall_k;
                    let why = format!("the wall spanned {:.1} K only", high - low);
                    self.kept("friction.softening_per_k", &why)
                }
            },
        ];
        if full {
            all.push(match force.viscous_n_s_m {
                Some(found) => {
                    self.measured("friction.viscous_n_s_m", found, "fast ramps against slow ones")
                }
                None => self.kept("friction.viscous_n_s_m", "its error is more than half of it"),
            });
            let why = "friction builds up within a few steps of the length's code";
            all.push(self.kept("friction.presliding_stiffness_n_m", why));
        }
        all
    }

    fn chamber(&self) -> [Parameter; 2] {
        let area = self.force.area_scale;
        let (area_key, power) = self.tunable.area[0];
        let configured = self.before(area_key);
        [
            self.measured(
                area_key,
                Measure {
                    value: configured * area.value.powf(power),
                    error: configured * (power * area.value.powf(power - 1.0)).abs() * area.error,
                },
                &format!(
                    "force area and volume, {} of the configured ones; as wrong as the load",
                    significant(area.value, 4)
                ),
            ),
            self.measured(self.tunable.stiffness, self.force.stiffness_n_m, "force over the way"),
        ]
    }

    fn valves(&self) -> Vec<Parameter> {
        let [inlet, outlet] = &self.steps;
        // The conductance follows from the volume, whose error is that of the force area.
        let area = self.force.area_scale;
        let conductance = inlet.conductance.between(outlet.conductance);
        let by_volume = conductance.value * area.error / area.value;
        let mut all = vec![self.measured(
            "valve.conductance_m3_s_pa",
            Measure { error: conductance.error.hypot(by_volume), ..conductance },
            &format!(
                "inlet {}, outlet {}",
                significant(inlet.conductance.value, 4),
                significant(outlet.conductance.value, 4)
            ),
        )];
        if self.switching {
            // Tube and regulator lower the conductance of an open valve, but hardly that of a short pulse. Their part shows
            // in the difference between inlet and outlet.
            let apart = (inlet.conductance.value - outlet.conductance.value).abs();
            let relative = apart / conductance.value;
            let found = self
                .switch_time_s
                .map(|found| Measure { error: found.error.hypot(relative * found.value), ..found });
            let switch_s =
                found.unwrap_or(Measure { value: self.before("valve.switch_time_s"), error: 0.0 });
            all.push(match found {
                Some(found) => {
                    self.measured("valve.switch_time_s", found, "what short pulses move")
                }
                None => self.kept("valve.switch_time_s", "no ramp had pulses short enough"),
            });
            // The core adds the line's travel to the dead time.
            let travel_s = line_travel_s(&self.configured.believed);
            let dead_s = self.delay_s.less(switch_s.scaled(0.5, travel_s));
            let dead_s = Measure { value: dead_s.value.max(0.0), ..dead_s };
            let line = if travel_s > 0.0 { " and the line's travel" } else { "" };
            let remark = format!("delay less half of the switching{line}; with the sensor's lag");
            all.push(self.measured("valve.dead_time_s", dead_s, &remark));
        }
        all
    }

    fn controller(&self) -> [Parameter; 6] {
        let gains = self.gains;
        let twice = "2 (half a PWM period + delay)";
        [
            self.measured("controller.pressure_loop_s", gains.loop_s, twice),
            self.measured("controller.length_loop_s", gains.loop_s, twice),
            self.measured("controller.pressure_reset_s", gains.reset_s, "20 times the loop's"),
            self.measured(
                "controller.load_gain_n_m_s",
                gains.load_gain_n_m_s,
                "gas spring over the reset time",
            ),
            self.bound(
                "controller.pressure_dead_zone_pa",
                gains.pressure_dead_zone_pa,
                "as configured, at least 3 standard deviations of the noise",
            ),
            self.bound(
                "controller.contraction_dead_zone",
                gains.contraction_dead_zone,
                "as configured, at least 3 standard deviations of the noise",
            ),
        ]
    }
}

impl Parameter {
    fn with_error(self, error: f64) -> Self {
        Self { standard_error: Some(error), ..self }
    }
}

/// Tracking with the values before and after.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Check {
    pub before: Figures,
    pub after: Figures,
}

#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Findings {
    pub duration_s: f64,
    pub highest_pa: f64,
    pub parameters: Vec<Parameter>,
    /// Delay of the outlet, from the pin to half of the opening \[s\].
    pub delay_s: f64,
    pub pressure_noise_pa: f64,
    pub length_noise_m: f64,
    pub force_rms_n: f64,
    /// Friction over its standard error \[-\].
    pub signal_to_noise: f64,
    pub check: Check,
    /// Whether the error of the sine has fallen by at least a tenth.
    pub improved: bool,
    /// Whether the error of the sine has not grown by more than a tenth: the board then keeps the tuned values.
    pub adopted: bool,
}

/// Whether an error on the check's sine has fallen by at least a tenth, and whether it has not grown by more.
pub(crate) fn compared(before: f64, after: f64) -> (bool, bool) {
    (after < (1.0 - EQUAL) * before, after <= (1.0 + EQUAL) * before)
}

/// Rating of the check's sine: its error has fallen, or has not grown.
pub(crate) fn word(improved: bool, adopted: bool) -> &'static str {
    match (improved, adopted) {
        (true, _) => "closer than before",
        (_, true) => "as closely as before",
        _ => "less closely than before",
    }
}

impl Findings {
    pub(super) fn new(
        parameters: Vec<Parameter>,
        records: &[Record],
        force: &Force,
        basis: &Basis,
        [before, after]: [&Checked; 2],
    ) -> Self {
        let (before, after) = (before.figures, after.figures);
        let (improved, adopted) = compared(before.sine_rms_percent, after.sine_rms_percent);
        Self {
            duration_s: records.last().map_or(0.0, |record| record.time_s),
            highest_pa: records.iter().map(|record| record.pressure_pa).fold(0.0, f64::max),
            parameters,
            delay_s: basis.delay_s.value,
            pressure_noise_pa: basis.noise.pressure_pa,
            length_noise_m: basis.noise.length_m,
            force_rms_n: force.rms_n,
            signal_to_noise: force.signal,
            check: Check { before, after },
            improved,
            adopted,
        }
    }

    pub fn value(&self, path: &str) -> Option<&Parameter> {
        self.parameters.iter().find(|parameter| parameter.path == path)
    }

    /// Rating of the check's sine with the tuned values.
    pub fn word(&self) -> &'static str {
        word(self.improved, self.adopted)
    }

    pub fn headline(&self) -> String {
        let Check { before, after } = self.check;
        let [before, after] = [before, after].map(|figures| figures.sine_rms_percent);
        let kept = if self.adopted { "" } else { ": the former values are kept" };
        format!(
            "with the tuned values a sine is followed {} ({before:.2} -> {after:.2} % of the stroke, RMS){kept}",
            self.word()
        )
    }

    /// Result of the check in words.
    pub fn verdict(&self) -> String {
        let Check { before, after } = self.check;
        let figures = |f: &Figures| {
            format!(
                "sine {:.2} % RMS, at rest {:.2} %, settled in {:.2} s, overshoot {:.1} %",
                f.sine_rms_percent, f.rest_error_percent, f.settled_s, f.overshoot_percent
            )
        };
        let (before, after) = (figures(&before), figures(&after));
        format!("{}\n  before: {before}\n  after:  {after}", self.headline())
    }

    /// Path, value before and value after of each parameter, for a narrow table.
    pub fn rows(&self) -> Vec<[String; 3]> {
        let row = |parameter: &Parameter| {
            let text = |value| {
                let (value, unit) = quantity(value, parameter.unit);
                format!("{value} {unit}").trim_end().to_owned()
            };
            [parameter.path.to_owned(), text(parameter.before), text(parameter.after)]
        };
        self.parameters.iter().map(row).collect()
    }

    pub fn text(&self) -> String {
        self.verdict() + "\n" + &table(&self.parameters)
    }
}

/// The values as a table of text.
pub fn table(parameters: &[Parameter]) -> String {
    let width = parameters.iter().map(|p| p.path.len()).max().unwrap_or(0);
    let mut text = format!(
        "{:width$}  {:>10}  {:>10}  {:>10}  {:10}\n",
        "parameter", "before", "after", "std. error", "unit"
    );
    for parameter in parameters {
        let error = parameter.standard_error.map_or_else(String::new, plain);
        text += &format!(
            "{:width$}  {:>10}  {:>10}  {error:>10}  {:10}  {}\n",
            parameter.path,
            plain(parameter.before),
            plain(parameter.after),
            parameter.unit,
            parameter.remark
        );
    }
    text
}

/// Formats to four digits, in TOML's notation.
fn plain(value: f64) -> String {
    if value == 0.0 || (1e-3..1e6).contains(&value.abs()) {
        let digits = (3 - value.abs().max(1e-300).log10().floor() as i32).clamp(0, 9) as usize;
        format!("{value:.*}", if value == 0.0 { 0 } else { digits })
    } else {
        format!("{value:.3e}")
    }
}
