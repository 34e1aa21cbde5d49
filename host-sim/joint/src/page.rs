//! `report.html` of a joint.

use crate::load::JointLoaded;
use crate::rig::Row;
use crate::summary::{Figures, Summary};
use crate::trace::COLUMNS;
use thermyo_files::number::speed;
use thermyo_files::units::UnitSystem;
use thermyo_record::following::Followed;
use thermyo_report::Colour;
use thermyo_report::chart::{Axis, Chart, Panel};
use thermyo_report::page::{Page, Section, Tile};
use thermyo_report::series::Recorder;

/// Records the page's data in bounded memory during a run.
#[derive(Debug)]
pub struct PageRecorder {
    recorder: Recorder,
}

impl Default for PageRecorder {
    fn default() -> Self {
        Self { recorder: Recorder::new(&COLUMNS) }
    }
}

impl PageRecorder {
    pub fn add(&mut self, row: &Row) {
        self.recorder.push(&row.cells());
    }

    pub fn is_empty(&self) -> bool {
        self.time().is_empty()
    }

    pub fn page(&self, title: &str, loaded: &JointLoaded, summary: &Summary) -> String {
        let lead = summary.figures.lead(&format!(
            "{} s simulated at {} times real time.",
            summary.duration_s,
            speed(summary.real_time_factor)
        ));
        let [a, b] = summary.estimate_rmse_k;
        let own = [
            Tile::new("Estimate of muscle a, RMS error", a, "K"),
            Tile::new("Estimate of muscle b, RMS error", b, "K"),
            Tile::new("Balance of the arm's energy", summary.arm_balance_error, ""),
        ];
        self.render(title, loaded, &lead, summary.figures.tiles().into_iter().chain(own))
    }

    /// The page of a run on a board, which has no true gas temperature.
    pub fn of_board(
        &self,
        title: &str,
        driven: &JointLoaded,
        lead: &str,
        figures: &Figures,
    ) -> String {
        self.render(title, driven, lead, figures.tiles().into_iter())
    }

    fn render(
        &self,
        title: &str,
        loaded: &JointLoaded,
        lead: &str,
        tiles: impl Iterator<Item = Tile>,
    ) -> String {
        let page = Page::new(title, lead, &crate::render::render(loaded));
        let page = tiles.fold(page, Page::tile);
        let sections = [self.motion(), self.muscles(), self.temperature()];
        sections.into_iter().fold(page, Page::section).render()
    }

    fn column(&self, name: &str) -> &[f64] {
        self.recorder.column(name).unwrap_or_default()
    }

    fn scaled(&self, name: &str, factor: f64) -> Vec<f64> {
        self.column(name).iter().map(|value| value * factor).collect()
    }

    fn time(&self) -> &[f64] {
        self.column("time_s")
    }

    fn motion(&self) -> Section {
        let degrees = |name: &str| self.scaled(name, 1.0_f64.to_degrees());
        let (angle, reference) = (degrees("angle_rad"), degrees("angle_reference_rad"));
        let error: Vec<f64> =
            angle.iter().zip(&reference).map(|(is, wanted)| is - wanted).collect();
        let time = self.time();
        let chart = Chart::new(Axis::new("Time", "s"))
            .panel(
                Panel::new(Axis::new("Angle", "deg"))
                    .height(240.0)
                    .dashed("set point", Colour::SetPoint, time, &reference)
                    .line("angle", Colour::Measured, time, &angle),
            )
            .panel(
                Panel::new(Axis::new("Error of the angle", "deg"))
                    .height(120.0)
                    .reference(0.0, "")
                    .line("", Colour::Blue, time, &error),
            )
            .panel(
                Panel::new(Axis::new("Stiffness", "N m/rad"))
                    .height(160.0)
                    .dashed(
                        "set point",
                        Colour::SetPoint,
                        time,
                        self.column("stiffness_reference_n_m_rad"),
                    )
                    .line("stiffness", Colour::Measured, time, self.column("stiffness_n_m_rad")),
            )
            .panel(
                Panel::new(Axis::new("Torque", "N m"))
                    .height(140.0)
                    .line("muscles", Colour::Green, time, self.column("torque_n_m"))
                    .line("load", Colour::Orange, time, self.column("load_n_m"))
                    .line(
                        "disturbance (core)",
                        Colour::Purple,
                        time,
                        self.column("disturbance_n_m"),
                    ),
            );
        let caption = "Angle, stiffness of the gas behind shut valves, and their set points; torque \
                       of both tendons, of the load, and what the core finds unexplained.";
        Section::new("Joint").figure(chart.figure("Angle and stiffness", caption))
    }

    fn muscles(&self) -> Section {
        let time = self.time();
        let both = |panel: Panel, name: &str, factor: f64| {
            let [a, b] = ["a", "b"].map(|side| self.scaled(&format!("{side}_{name}"), factor));
            panel.line("a", Colour::Blue, time, &a).line("b", Colour::Vermillion, time, &b)
        };
        let panel = |label: &str, unit: &str| Panel::new(Axis::new(label, unit)).height(150.0);
        let chart = Chart::new(Axis::new("Time", "s"))
            .panel(both(panel("Pressure", "kPa"), "pressure_pa", 1e-3))
            .panel(both(panel("Tension", "N"), "tension_n", 1.0))
            .panel(both(panel("Inlet duty", "%"), "duty_in", 100.0))
            .panel(both(panel("Outlet duty", "%"), "duty_out", 100.0));
        let caption = "Muscle a shortens as the angle grows, muscle b as it falls.";
        Section::new("Muscles").figure(chart.figure("Pressures and valves", caption))
    }

    fn temperature(&self) -> Section {
        let time = self.time();
        let panel = |side: &str| {
            let column = |name: &str| self.column(&format!("{side}_{name}"));
            Panel::new(Axis::new(&format!("Gas of muscle {side}"), "K"))
                .height(180.0)
                .line("gas (plant)", Colour::Truth, time, column("gas_temperature_k"))
                .line("estimate", Colour::Estimate, time, column("estimate_k"))
                .line("sensor in the gas", Colour::Sensor, time, column("sensor_gas_k"))
                .line("wall (plant)", Colour::Wall, time, column("wall_temperature_k"))
        };
        let chart = Chart::new(Axis::new("Time", "s")).panel(panel("a")).panel(panel("b"));
        let caption = "The core's estimate and the bare sensor; of a simulated joint also the \
                       mass-weighted mean of the gas, and the wall.";
        Section::new("Temperature").figure(chart.figure("Gas temperatures", caption))
    }
}

impl Figures {
    /// Faults, a sentence about the run, and errors.
    pub fn lead(&self, run: &str) -> String {
        let faults: Vec<String> = ["muscle a", "muscle b", "joint"]
            .iter()
            .zip(&self.faults)
            .filter(|(_, names)| !names.is_empty())
            .map(|(name, names)| format!("{name}: {}", names.join(", ")))
            .collect();
        let vented = match self.vented_s {
            Some(time_s) => format!("Both muscles vented at {time_s} s. "),
            None => String::new(),
        };
        let found = match faults.join("; ") {
            none if none.is_empty() => String::new(),
            some => format!("Faults: {some}. "),
        };
        let swings = match self.unrest(UnitSystem::Practical) {
            Some(warning) => format!(" Warning: {warning}."),
            None => String::new(),
        };
        format!(
            "{vented}{found}{run} The angle misses its set point by {:.2} deg (RMS), the stiffness by {:.1} %.{swings}",
            self.rms_error_rad.to_degrees(),
            100.0 * self.rms_stiffness_error
        )
    }

    fn tiles(&self) -> Vec<Tile> {
        let mut tiles = vec![
            Tile::new("Angle, RMS error", self.rms_error_rad.to_degrees(), "deg"),
            Tile::new("Angle, error at the end", self.end_error_rad.to_degrees(), "deg"),
            Tile::new("Stiffness, RMS error", 100.0 * self.rms_stiffness_error, "%"),
            Tile::new("Pulses of all valves", self.pulses_per_s, "1/s"),
        ];
        let of_shape = self.control.iter().flat_map(Followed::shape_figures);
        tiles.extend(of_shape.map(|(name, value, unit)| Tile::new(name, value, unit)));
        tiles
    }
}
