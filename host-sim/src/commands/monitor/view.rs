//! One picture of a session.

use super::{Session, Status};
use model_core::control::Mode;
use model_core::link::LastReset;
use model_core::sensing::Sensing;
use model_core::{Faults, Telemetry};
use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Style};
use ratatui::symbols::Marker;
use ratatui::text::Line;
use ratatui::widgets::{Axis, Block, Chart, Dataset, Gauge, GraphType, Paragraph};

/// Draws the session.
pub fn draw(frame: &mut Frame, session: &Session) {
    let [head, gauges, plot] =
        Layout::vertical([Constraint::Length(5), Constraint::Length(12), Constraint::Min(8)])
            .areas(frame.area());
    draw_head(frame, head, session);
    if let Some(telemetry) = session.history().back() {
        draw_gauges(frame, gauges, session, telemetry);
        draw_plot(frame, plot, session);
    }
}

fn draw_head(frame: &mut Frame, area: Rect, session: &Session) {
    let status = match session.status() {
        Status::Connected => Line::styled("connected", Color::Green),
        Status::Silent => Line::styled("no telemetry: is the firmware flashed?", Color::Yellow),
        Status::Unplugged => Line::styled("unplugged: waiting for it to come back", Color::Red),
    };
    let board = session.version().map_or(String::new(), |version| {
        let [major, minor, patch] = version.firmware;
        format!("{:?}, firmware {major}.{minor}.{patch}", version.chip)
    });
    let restart = match session.last_reset() {
        None | Some(LastReset::Power) => String::new(),
        Some(reason) => format!("last restart: {reason:?}"),
    };
    let first = session.first_failure().map_or(String::new(), |first| {
        let bar = first.pressure_pa / 1.0e5;
        format!("first failure: {} at {bar:.2} bar, step {}", first.faults, first.step)
    });
    let timing = session.timing().map_or(String::new(), |timing| {
        format!(
            "step {:.0} us mean, {} us worst; start {} us late at worst; {} missed, {} dropped, {} malformed, {} flooded",
            f64::from(timing.step_mean_ns) / 1000.0,
            timing.step_worst_us,
            timing.jitter_worst_us,
            timing.missed_steps,
            timing.dropped_telemetry,
            timing.malformed_frames,
            timing.dropped_requests,
        )
    });
    let title = format!(" thermyo monitor {} - {} rows - q quits ", session.port(), session.rows());
    let lines = vec![status, Line::raw(format!("{board}  {restart}  {first}")), Line::raw(timing)];
    frame.render_widget(Paragraph::new(lines).block(Block::bordered().title(title)), area);
}

fn draw_gauges(frame: &mut Frame, area: Rect, session: &Session, telemetry: &Telemetry) {
    let sensors = session.config().sensors;
    let mode = Mode::NAMES.iter().find(|(mode, _)| *mode == telemetry.mode);
    let mode = mode.map_or("", |(_, name)| name);
    let limited = if telemetry.limited { ", limited" } else { "" };
    let faults = if telemetry.faults == Faults::NONE {
        "no fault".to_owned()
    } else {
        telemetry.faults.to_string()
    };
    let faults = format!("{mode}{limited}: {faults}");
    let (pressure, length) = (telemetry.pressure_pa, telemetry.length_m);
    let (inlet, outlet) = (telemetry.command.inlet.share(), telemetry.command.outlet.share());
    let gauges = [
        ("pressure", pressure / sensors.pressure.range_pa, format!("{:.1} kPa", pressure / 1e3)),
        ("length", length / sensors.length.range_m, format!("{:.1} mm", length * 1e3)),
        ("inlet", inlet, format!("{:.1} %", inlet * 100.0)),
        ("outlet", outlet, format!("{:.1} %", outlet * 100.0)),
    ];
    let rows = Layout::vertical([Constraint::Length(2); 6]).split(area);
    for ((name, ratio, label), &row) in gauges.into_iter().zip(rows.iter()) {
        let [name_area, gauge_area] =
            Layout::horizontal([Constraint::Length(10), Constraint::Min(10)]).areas(row);
        frame.render_widget(Paragraph::new(name), name_area);
        let gauge = Gauge::default()
            .ratio(f64::from(ratio).clamp(0.0, 1.0))
            .label(label)
            .gauge_style(Style::new().fg(Color::Cyan).bg(Color::DarkGray));
        frame.render_widget(gauge, Rect { height: 1, ..gauge_area });
    }
    if let (Some(&estimate_row), Some(&fault_row)) = (rows.get(4), rows.get(5)) {
        let estimate = &telemetry.estimate;
        let text = format!(
            "gas {:.2} K +- {:.2}{}, wall {:.2} K, sensor {:.2} K, lag {:.2} s",
            estimate.gas_k,
            estimate.gas_sd_k,
            if estimate.valid { "" } else { " (not to be relied on)" },
            estimate.wall_k,
            estimate.sensor_k,
            estimate.sensor_lag_s
        );
        frame.render_widget(Paragraph::new(text), estimate_row);
        let color = if telemetry.faults == Faults::NONE { Color::Green } else { Color::Red };
        frame.render_widget(Paragraph::new(faults).style(color), fault_row);
    }
}

fn draw_plot(frame: &mut Frame, area: Rect, session: &Session) {
    let config = session.config();
    let sensing = Sensing::new(&config);
    let last = session.history().back().map_or(0, |telemetry| telemetry.step);
    let points = |value: &dyn Fn(&Telemetry) -> f32| -> Vec<(f64, f64)> {
        session
            .history()
            .iter()
            .filter(|telemetry| telemetry.step <= last)
            .map(|telemetry| {
                let age = f64::from(last - telemetry.step) * f64::from(config.step_s);
                (-age, f64::from(value(telemetry)))
            })
            .collect()
    };
    let estimate = points(&|telemetry| telemetry.estimate.gas_k);
    let sensor = points(&|telemetry| sensing.gas_k(telemetry.sample.gas));
    let all = || estimate.iter().chain(&sensor);
    let low = all().map(|point| point.1).fold(f64::INFINITY, f64::min) - 0.5;
    let high = all().map(|point| point.1).fold(f64::NEG_INFINITY, f64::max) + 0.5;
    let oldest = all().map(|point| point.0).fold(-1.0, f64::min);
    let line = |name, color, data| {
        Dataset::default()
            .name(name)
            .marker(Marker::Braille)
            .graph_type(GraphType::Line)
            .style(Style::new().fg(color))
            .data(data)
    };
    let chart = Chart::new(vec![
        line("estimate", Color::Red, &estimate),
        line("sensor", Color::Blue, &sensor),
    ])
    .block(Block::bordered().title(" gas temperature [K] over time [s] "))
    .x_axis(Axis::default().bounds([oldest, 0.0]).labels([format!("{oldest:.0}"), "0".to_owned()]))
    .y_axis(
        Axis::default().bounds([low, high]).labels([format!("{low:.1}"), format!("{high:.1}")]),
    );
    frame.render_widget(chart, area);
}
