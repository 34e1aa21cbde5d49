//! Charts of `thermyo evaluate control --out DIR`: the figures of
//! `docs/background/control-trials.md`, each as a file, and a page with all of them.

use super::control::{
    self, Change, STEP_PA, ambient, for_the_room, load, pressure_step_traces, sine_trace,
};
use super::{CaseFigures, figures, opened, tune};
use thermyo_report::Colour;
use thermyo_report::chart::{Axis, Chart, Panel};
use thermyo_report::page::{Page, Section};
use thermyo_setup::Loaded;
use thermyo_simulation::board::CoreBoard;
use thermyo_studies::tune::{TuneError, check_chart};

/// A chart with the name of its file, its title and caption.
#[derive(Debug)]
pub struct Plot {
    pub file: &'static str,
    pub title: &'static str,
    caption: &'static str,
    chart: Chart,
}

impl Plot {
    pub fn svg(&self) -> String {
        self.chart.document(self.title)
    }
}

pub fn plots(nominal: &Loaded) -> Result<Vec<Plot>, TuneError> {
    let full = control::full(nominal);
    Ok(vec![
        pressure_step(&full)?,
        temperature(&full)?,
        frequency_response(&full)?,
        tuned(nominal)?,
    ])
}

pub fn page(nominal: &Loaded, lines: &[CaseFigures], plots: &[Plot]) -> String {
    let lead = "Where the muscle goes when it is asked to, on the plant with everything that the core \
                leaves out.";
    let drawn = plots.iter().fold(Section::new("Plots"), |section, plot| {
        section.figure(plot.chart.figure(plot.title, plot.caption))
    });
    let page =
        Page::new("Control, evaluated", lead, &thermyo_setup::render(&control::full(nominal)));
    opened(page, lines)
        .section(drawn)
        .section(Section::new("Figures").table(figures(lines)))
        .render()
}

fn pressure_step(full: &Loaded) -> Result<Plot, TuneError> {
    let loaded = load(full, 100.0);
    let (closed, open) = pressure_step_traces(&loaded, STEP_PA, &mut CoreBoard::default())?;
    let within = |points: &[(f64, f64)]| -> (Vec<f64>, Vec<f64>) {
        let shown = points.iter().filter(|(time_s, _)| (-0.02..=0.3).contains(time_s));
        shown.map(|(time_s, pa)| (1e3 * time_s, pa / 1e5)).unzip()
    };
    let (closed, open) = (within(&closed), within(&open));
    let panel = Panel::new(Axis::new("Pressure", "bar").range(1.9, 4.3))
        .line("pressure loop", Colour::Blue, &closed.0, &closed.1)
        .dashed("valve fully open", Colour::Vermillion, &open.0, &open.1)
        .reference(4.0, "set point");
    Ok(Plot {
        file: "control_pressure_step.svg",
        title: "Pressure, 2 to 4 bar at 100 N, against the fully open valve",
        caption: "The loop is as fast as the valve until it closes on the set point.",
        chart: Chart::new(Axis::new("Time", "ms").range(-20.0, 300.0)).panel(panel),
    })
}

fn temperature(full: &Loaded) -> Result<Plot, TuneError> {
    let mut chart = Chart::new(Axis::new("Time", "s"));
    for (celsius, name) in [(10.0, "10 °C"), (25.0, "25 °C"), (40.0, "40 °C")] {
        let loaded = ambient(full, 273.15 + celsius);
        let fixed = loaded.believing(|s| s.friction.softening_per_k = 0.0);
        let error = |loaded: &Loaded| -> Result<(Vec<f64>, Vec<f64>), TuneError> {
            let points = sine_trace(loaded, 0.5, 0.15, &mut CoreBoard::default())?;
            let share = |error: f64| 100.0 * error / control::STROKE;
            Ok(points.iter().map(|point| (point.time_s, share(point.error))).unzip())
        };
        let room = loaded.believing(for_the_room);
        let (with, without, room) = (error(&loaded)?, error(&fixed)?, error(&room)?);
        chart = chart.panel(
            Panel::new(Axis::new(&format!("{name}: error"), "% of stroke").range(-1.0, 1.0))
                .height(120.0)
                .line("friction fixed for 25 °C", Colour::Vermillion, &without.0, &without.1)
                .line("friction fixed for the room", Colour::Green, &room.0, &room.1)
                .line("friction at the estimated wall temperature", Colour::Blue, &with.0, &with.1)
                .reference(0.0, "0"),
        );
    }
    Ok(Plot {
        file: "control_temperature.svg",
        title: "Sine of 0.5 Hz over 30 % of the stroke, error with and without temperature compensation",
        caption: "Friction is configured at 25 °C. Without compensation the muscle leaves its turns late in the \
                  cold and early in the warmth; a thermometer in the room cures that as well as the \
                  estimated wall.",
        chart,
    })
}

fn frequency_response(full: &Loaded) -> Result<Plot, TuneError> {
    let mut gain = Panel::new(Axis::new("Gain", "").range(0.3, 1.6)).height(230.0);
    let mut phase = Panel::new(Axis::new("Phase", "°").range(-150.0, 10.0)).height(120.0);
    let mut open = Panel::new(Axis::new("A valve fully open", "% of the time")).height(120.0);
    for (force_n, colour) in
        [(50.0, Colour::Vermillion), (100.0, Colour::Blue), (200.0, Colour::Green)]
    {
        let loaded = load(full, force_n);
        let hz: Vec<f64> = (2..=20).map(|step| 0.5 * f64::from(step)).collect();
        let sines = hz
            .iter()
            .map(|hz| control::sine(&loaded, *hz, AMPLITUDE, &mut CoreBoard::default()))
            .collect::<Result<Vec<_>, _>>()?;
        let of = |f: fn(&control::Sine) -> f64| sines.iter().map(f).collect::<Vec<f64>>();
        gain = gain.line(&format!("{force_n} N"), colour, &hz, &of(|sine| sine.gain));
        phase = phase.line("", colour, &hz, &of(|sine| sine.phase_deg));
        open = open.line("", colour, &hz, &of(|sine| 100.0 * sine.open));
    }
    let chart = Chart::new(Axis::new("Frequency", "Hz").range(1.0, 10.0))
        .panel(gain.reference(0.5_f64.sqrt(), "−3 dB").reference(1.0, "1"))
        .panel(phase)
        .panel(open);
    Ok(Plot {
        file: "control_frequency_response.svg",
        title: "Frequency response, sines of 2.5 % of the stroke",
        caption: "Where a valve is fully open, no gain makes the muscle faster: the limit is the valve's.",
        chart,
    })
}

/// Amplitude of the frequency response, as a fraction of the stroke \[-\].
const AMPLITUDE: f64 = 0.025;

fn tuned(nominal: &Loaded) -> Result<Plot, TuneError> {
    let (_, change): (_, Change) = tune::ALL_WRONG;
    let tuned = tune::tuned(&tune::configured(nominal, change))?;
    Ok(Plot {
        file: "control_tuned.svg",
        title: "Before and after thermyo tune: configured friction −30 %, volume −20 %, conductance +30 %",
        caption: "The check of a tuning: a sine of 0.5 Hz, then two steps.",
        chart: check_chart(&tuned),
    })
}
