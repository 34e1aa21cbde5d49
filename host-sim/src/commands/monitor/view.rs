//! One picture of a session. It fits a terminal of 80 by 24; in a narrower one lines fold, and the plot makes room.

use super::{Session, Status};
use model_core::control::Mode;
use model_core::link::LastReset;
use model_core::sensing::Sensing;
use model_core::{Faults, SetPoint, Telemetry};
use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Style};
use ratatui::symbols::Marker;
use ratatui::text::Line;
use ratatui::widgets::{Axis, Block, Chart, Dataset, Gauge, GraphType, Paragraph, Wrap};
use thermyo_record::board_trace::kind_and_values;

/// Draws the session.
pub fn draw(frame: &mut Frame, session: &Session) {
    let narrow = frame.area().width < 80;
    let (head_rows, plot_rows, key_rows) = if narrow { (9, 0, 2) } else { (6, 8, 1) };
    let [head, muscle, plot, keys] = Layout::vertical([
        Constraint::Length(head_rows),
        Constraint::Length(8),
        Constraint::Min(plot_rows),
        Constraint::Length(key_rows),
    ])
    .areas(frame.area());
    draw_head(frame, head, session);
    if let Some(telemetry) = session.history().back() {
        draw_muscle(frame, muscle, session, telemetry);
        draw_plot(frame, plot, session);
    }
    let help = "space vents   Ctrl-C vents and leaves   a arms   arrows move the pressure";
    let help = Paragraph::new(help).style(Style::new().fg(Color::DarkGray));
    frame.render_widget(help.wrap(Wrap { trim: true }), keys);
}

fn draw_head(frame: &mut Frame, area: Rect, session: &Session) {
    let (status, color) = match session.status() {
        Status::Connected => ("connected", Color::Green),
        Status::Silent => ("no telemetry: is the firmware flashed?", Color::Yellow),
        Status::Unplugged => ("unplugged: waiting for it to come back", Color::Red),
    };
    let board = session.version().map_or(String::new(), |version| {
        let [major, minor, patch] = version.firmware;
        format!(", {:?}, firmware {major}.{minor}.{patch}", version.chip)
    });
    let arming = session.last_status().map_or(String::new(), |status| {
        let armed = match status.armed_pa {
            Some(pa) => format!("armed up to {:.0} kPa", pa / 1e3),
            None => "not armed".to_owned(),
        };
        let name = match status.config_name.as_str() {
            "" => "without a name",
            name => name,
        };
        format!("{armed}; configuration {name} {:08x}", status.config_checksum)
    });
    let restart = match session.last_reset() {
        None | Some(LastReset::Power) => None,
        Some(reason) => Some(format!("last restart: {reason:?}")),
    };
    let first = session.first_failure().map(|first| {
        let bar = first.pressure_pa / 1.0e5;
        format!("first failure: {} at {bar:.2} bar, step {}", first.faults, first.step)
    });
    let refused = session.refused().map(|refusal| format!("refused: {refusal}"));
    let event = refused.or(first).or(restart).unwrap_or_default();
    let timing = session.timing().map_or(String::new(), |timing| {
        format!(
            "step {:.0}/{} us, start {} us late; {} missed, {} dropped, {} malformed",
            f64::from(timing.step_mean_ns) / 1000.0,
            timing.step_worst_us,
            timing.jitter_worst_us,
            timing.missed_steps,
            timing.dropped_telemetry,
            timing.malformed_frames,
        )
    });
    let title = format!(" thermyo monitor {} - {} rows ", session.port(), session.rows());
    let lines = vec![
        Line::styled(format!("{status}{board}"), color),
        Line::raw(arming),
        Line::styled(event, Color::Yellow),
        Line::raw(timing),
    ];
    let lines = Paragraph::new(lines).wrap(Wrap { trim: true });
    frame.render_widget(lines.block(Block::bordered().title(title)), area);
}

/// A quantity: its name, its share of the range, what is written beside it.
type Row = (&'static str, f32, String);

fn draw_muscle(frame: &mut Frame, area: Rect, session: &Session, telemetry: &Telemetry) {
    let sensors = session.config().sensors;
    let (pressure, length) = (telemetry.pressure_pa, telemetry.length_m);
    let (inlet, outlet) = (telemetry.command.inlet.share(), telemetry.command.outlet.share());
    let wanted = wanted(telemetry.set_point);
    let rows: [Row; 4] = [
        ("pressure", pressure / sensors.pressure.range_pa, format!("{:.1} kPa", pressure / 1e3)),
        ("length", length / sensors.length.range_m, format!("{:.1} mm", length * 1e3)),
        ("inlet", inlet, format!("{:.1} %", inlet * 100.0)),
        ("outlet", outlet, format!("{:.1} %", outlet * 100.0)),
    ];
    let areas = Layout::vertical([Constraint::Length(1); 8]).split(area);
    for ((name, ratio, label), &row) in rows.into_iter().zip(areas.iter()) {
        let [name_area, gauge_area, wanted_area] = Layout::horizontal([
            Constraint::Length(10),
            Constraint::Min(10),
            Constraint::Length(28),
        ])
        .areas(row);
        frame.render_widget(Paragraph::new(name), name_area);
        let gauge = Gauge::default()
            .ratio(f64::from(ratio).clamp(0.0, 1.0))
            .label(label)
            .gauge_style(Style::new().fg(Color::Cyan).bg(Color::DarkGray));
        frame.render_widget(gauge, gauge_area);
        if name == "pressure" {
            frame.render_widget(Paragraph::new(format!(" set point {wanted}")), wanted_area);
        }
    }
    let estimate = &telemetry.estimate;
    let reading_k = Sensing::new(&session.config()).gas_k(telemetry.sample.gas);
    let remark = if estimate.valid { "" } else { " (not to be relied on)" };
    let mode = Mode::NAMES.iter().find(|(mode, _)| *mode == telemetry.mode);
    let mode = mode.map_or("", |(_, name)| name);
    let limited = if telemetry.limited { ", limited" } else { "" };
    let (faults, color) = match telemetry.faults {
        Faults::NONE => ("no fault".to_owned(), Color::Green),
        faults => (faults.to_string(), Color::Red),
    };
    let lines = vec![
        Line::raw(format!(
            "gas {:.2} +- {:.2} K{remark}, sensor {reading_k:.2} K, wall {:.2} K",
            estimate.gas_k, estimate.gas_sd_k, estimate.wall_k,
        )),
        Line::styled(format!("{mode}{limited}: {faults}"), color),
    ];
    // Many faults take two lines.
    if let (Some(&from), Some(&to)) = (areas.get(4), areas.get(7)) {
        let rest = Rect { height: to.bottom() - from.y, ..from };
        frame.render_widget(Paragraph::new(lines).wrap(Wrap { trim: true }), rest);
    }
}

fn wanted(set_point: SetPoint) -> String {
    let (_, value, second) = kind_and_values(set_point);
    match set_point {
        SetPoint::Vent => "none: it vents".to_owned(),
        SetPoint::Pressure { .. } => format!("{:.1} kPa", value / 1e3),
        SetPoint::Contraction { .. } => format!("{:.1} %", value * 100.0),
        SetPoint::MassFlow { .. } => format!("{:.3} g/s", value * 1e3),
        SetPoint::MassFlowCycle { .. } => format!("{:.3} g/s, {second:.1} s", value * 1e3),
        SetPoint::Duty { .. } => format!("{:.0} %, {:.0} %", value * 100.0, second * 100.0),
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
