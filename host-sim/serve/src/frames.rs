//! Telemetry for the pages: thinned, in small parcels.

use model_core::Config;
use serde::Serialize;
use std::time::{Duration, Instant};
use thermyo_boards::subject::Subject;

/// Steps between two rows: 100 rows per second.
const EVERY: u32 = 10;
const PARCEL: Duration = Duration::from_millis(33);

/// A board whose steps a page receives.
pub trait Shown: Subject<SetPoint: Serialize> {
    /// A step as the page receives it.
    type Row: Serialize + Send;
    /// Whether the estimate of each gas temperature is reliable.
    type Valid: Serialize;

    fn muscles(config: &Self::Config) -> &[Config];

    fn mode(telemetry: &Self::Telemetry) -> &'static str;

    fn is_limited(telemetry: &Self::Telemetry) -> bool;

    fn valid(telemetry: &Self::Telemetry) -> Self::Valid;

    /// The row of a step at a time \[s\].
    fn row(time_s: f64, config: &Self::Config, telemetry: &Self::Telemetry) -> Self::Row;
}

/// A parcel: measurements over time, and the core's state at the end.
#[derive(Serialize)]
#[serde(bound = "")]
struct Parcel<'a, S: Shown> {
    kind: &'static str,
    mode: &'static str,
    limited: bool,
    valid: S::Valid,
    set_point: S::SetPoint,
    rows: &'a [S::Row],
}

pub struct Frames<S: Shown> {
    sent: Instant,
    rows: Vec<S::Row>,
    /// Time \[s\] and number of the last step.
    last: Option<(f64, u32)>,
    /// Time at which the link was lost.
    interrupted: Option<Instant>,
    /// The last step that became a row.
    shown: Option<u32>,
    mode: Option<&'static str>,
}

impl<S: Shown> Frames<S> {
    /// Empty frames; time counts from the first step.
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

    /// Marks the link as lost: until it is back, time follows the clock of this machine.
    pub fn interrupted(&mut self) {
        self.interrupted.get_or_insert_with(Instant::now);
    }

    /// Adds a step; returns the parcel if one is due.
    pub fn add(&mut self, config: &S::Config, telemetry: &S::Telemetry) -> Option<String> {
        let (step, mode) = (S::step(telemetry), S::mode(telemetry));
        let step_s = S::muscles(config).first().map_or(0.0, |muscle| f64::from(muscle.step_s));
        let away_s = self.interrupted.take().map(|since| since.elapsed().as_secs_f64());
        let time_s = match (self.last, away_s) {
            (Some((last_s, last)), None) if step > last => last_s + f64::from(step - last) * step_s,
            // A restarted board does not report how long it was away.
            (Some((last_s, _)), away_s) => {
                self.shown = None;
                last_s + away_s.unwrap_or(0.0).max(step_s)
            }
            (None, _) => 0.0,
        };
        self.last = Some((time_s, step));
        let turned = self.mode.replace(mode) != Some(mode);
        let due = self.shown.is_none_or(|shown| step - shown >= EVERY);
        if turned || due {
            self.shown = Some(step);
            self.rows.push(S::row(time_s, config, telemetry));
        }
        // A change of mode is sent at once: the user may be waiting for it.
        if !turned && self.sent.elapsed() < PARCEL || self.rows.is_empty() {
            return None;
        }
        self.sent = Instant::now();
        let parcel = Parcel::<S> {
            kind: "frame",
            mode,
            limited: S::is_limited(telemetry),
            valid: S::valid(telemetry),
            set_point: S::set_point(telemetry),
            rows: &self.rows,
        };
        let json = serde_json::to_string(&parcel).expect("plain data");
        self.rows.clear();
        Some(json)
    }
}

/// A time as in a row \[s\].
pub fn rounded(time_s: f64) -> f64 {
    (time_s * 1e4).round() / 1e4
}

#[cfg(test)]
mod tests {
    use super::*;
    use model_core::{AdcCode, Core, Sample};
    use serde_json::{Value, json};
    use thermyo_boards::live::LiveBoard;

    /// Times of the rows of these steps; a negative step stands for a link that is lost for 30 ms.
    fn times_s(steps: &[i64]) -> Vec<f64> {
        let config = Config::default();
        let sample = Sample::new(AdcCode(7770), AdcCode(15_950), AdcCode(23_757));
        let mut telemetry = Core::new(&config).unwrap().step(&sample);
        let mut frames = Frames::<LiveBoard>::new();
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
                let parcel: Value = serde_json::from_str(&parcel).unwrap();
                let rows = parcel["rows"].as_array().unwrap();
                times.extend(rows.iter().map(|row| row[0].as_f64().unwrap()));
            }
            let left: Vec<Value> = frames.rows.drain(..).map(|row| json!(row)).collect();
            times.extend(left.iter().filter_map(|row| row[0].as_f64()));
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
