//! Telemetry for the pages: thinned, in small parcels.

use model_core::control::Mode;
use model_core::{Config, SetPoint, Telemetry};
use serde::Serialize;
use std::time::{Duration, Instant};

/// Steps from one row to the next: 100 rows per second.
const EVERY: u32 = 10;
const PARCEL: Duration = Duration::from_millis(33);

/// A parcel: measurements over time, and the core's state at the end.
#[derive(Debug, Serialize)]
struct Parcel<'a> {
    kind: &'static str,
    mode: &'static str,
    limited: bool,
    valid: bool,
    set_point: SetPoint,
    rows: &'a [Row],
}

/// One step. The page gets an array in this order: `page.js` has the names.
#[derive(Debug, Serialize)]
struct Row(f64, f32, f32, f32, f32, f32, f32, f32, f32, Option<f32>, Option<f32>);

#[derive(Debug)]
pub struct Frames {
    sent: Instant,
    rows: Vec<Row>,
    /// Time \[s\] and number of the last step.
    last: Option<(f64, u32)>,
    /// When the link was lost.
    interrupted: Option<Instant>,
    /// The last step that became a row.
    shown: Option<u32>,
    mode: Option<Mode>,
}

impl Frames {
    /// Time counts from the first step.
    pub fn new() -> Self {
        Self {
            sent: Instant::now(),
            rows: Vec::new(),
            last: None,
            interrupted: None,
            shown: None,
            mode: None,
        }
    }

    /// The link was lost: until it is back, time follows the clock of this machine.
    pub fn interrupted(&mut self) {
        self.interrupted.get_or_insert_with(Instant::now);
    }

    /// Adds a step; returns the parcel if one is due.
    pub fn add(&mut self, config: &Config, telemetry: &Telemetry) -> Option<String> {
        let step_s = f64::from(config.step_s);
        let away_s = self.interrupted.take().map(|since| since.elapsed().as_secs_f64());
        let time_s = match (self.last, away_s) {
            (Some((last_s, last)), None) if telemetry.step > last => {
                last_s + f64::from(telemetry.step - last) * step_s
            }
            // A restarted board does not report how long it was away.
            (Some((last_s, _)), away_s) => {
                self.shown = None;
                last_s + away_s.unwrap_or(0.0).max(step_s)
            }
            (None, _) => 0.0,
        };
        self.last = Some((time_s, telemetry.step));
        let turned = self.mode.replace(telemetry.mode) != Some(telemetry.mode);
        let due = self.shown.is_none_or(|shown| telemetry.step - shown >= EVERY);
        if turned || due {
            self.shown = Some(telemetry.step);
            self.rows.push(row(time_s, config, telemetry));
        }
        // A change of mode is sent at once: the user may be waiting for it.
        if !turned && self.sent.elapsed() < PARCEL || self.rows.is_empty() {
            return None;
        }
        self.sent = Instant::now();
        let mode = Mode::NAMES.iter().find(|(mode, _)| *mode == telemetry.mode);
        let parcel = Parcel {
            kind: "frame",
            mode: mode.map_or("", |(_, name)| name),
            limited: telemetry.limited,
            valid: telemetry.estimate.valid,
            set_point: telemetry.set_point,
            rows: &self.rows,
        };
        let json = serde_json::to_string(&parcel).expect("plain data");
        self.rows.clear();
        Some(json)
    }
}

fn row(time_s: f64, config: &Config, telemetry: &Telemetry) -> Row {
    let Telemetry { pressure_pa, length_m, estimate, command, set_point, sample, .. } = telemetry;
    let [mut pressure_set_pa, mut contraction_set] = [None; 2];
    match set_point {
        SetPoint::Pressure { pressure_pa } => pressure_set_pa = Some(*pressure_pa),
        SetPoint::Contraction { contraction } => contraction_set = Some(*contraction),
        _ => (),
    }
    Row(
        (time_s * 1e4).round() / 1e4,
        *pressure_pa,
        *length_m,
        config.sensing().gas_k(sample.gas),
        estimate.gas_k,
        estimate.gas_sd_k,
        estimate.wall_k,
        command.inlet.share(),
        command.outlet.share(),
        pressure_set_pa,
        contraction_set,
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use model_core::{AdcCode, Core, Sample};

    /// Times of the rows of these steps; a negative step stands for a link that is lost for 30 ms.
    fn times_s(steps: &[i64]) -> Vec<f64> {
        let config = Config::default();
        let sample = Sample::new(AdcCode(7770), AdcCode(15_950), AdcCode(23_757));
        let mut telemetry = Core::new(&config).unwrap().step(&sample);
        let mut frames = Frames::new();
        let mut times = Vec::new();
        for &step in steps {
            let Ok(step) = u32::try_from(step) else {
                frames.interrupted();
                std::thread::sleep(Duration::from_millis(30));
                continue;
            };
            telemetry.step = step;
            // A slow machine may have sent a parcel already.
            if let Some(parcel) = frames.add(&config, &telemetry) {
                let parcel: serde_json::Value = serde_json::from_str(&parcel).unwrap();
                let rows = parcel["rows"].as_array().unwrap();
                times.extend(rows.iter().map(|row| row[0].as_f64().unwrap()));
            }
            times.extend(frames.rows.drain(..).map(|row| row.0));
        }
        times
    }

    #[test]
    fn time_rises_by_steps_and_over_a_gap_by_the_clock() {
        assert_eq!(times_s(&[5000, 5004, 5010, 5019, 5020]), [0.0, 0.01, 0.02], "every tenth step");
        assert_eq!(times_s(&[5000, 5010, 0, 10]), [0.0, 0.01, 0.011, 0.021]);
        let gap = times_s(&[5000, 5010, -1, 0]);
        assert!(gap.len() == 3 && (0.04..10.0).contains(&gap[2]), "{gap:?}");
    }
}
