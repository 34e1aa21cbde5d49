//! `report.html` of a joint's tuning: the values, the balance of torques, the check before and after.

use super::balance::Point;
use super::findings::Estimate;
use super::{Figures, Identified, Record, Tuned, Values};
use crate::tune::{self, FollowedBy, group};
use thermyo_report::Colour;
use thermyo_report::chart::{Axis, Chart, Panel};
use thermyo_report::page::{Page, Section, Tile};

pub fn page(tuned: &Tuned, title: &str) -> String {
    let findings = &tuned.findings;
    let lead = format!(
        "{:.0} s of slow sweeps and fast motion at two stiffnesses, up to {:.0} kPa: {}.",
        findings.values.duration_s,
        findings.values.highest_pa / 1e3,
        findings.headline()
    );
    let check = &findings.check;
    let title = format!("{title}, tuned");
    let figure = motion(&tuned.records)
        .figure("Angle and pressures", "Slow sweeps, a sine and steps, first soft, then stiff.");
    begun(&title, &lead, &thermyo_joint::render(&tuned.scenario), findings.values.failed())
        .tile(Tile::new("Sine of 1 Hz, RMS, before", check.before.sine_rms_rad.to_degrees(), "deg"))
        .tile(Tile::new("The same after", check.after.sine_rms_rad.to_degrees(), "deg"))
        .tile(Tile::new("Residual torque, RMS", findings.values.residual_rms_n_m, "N m"))
        .section(values(&findings.values))
        .section(torques(&tuned.estimate))
        .section(Section::new("Experiment").figure(figure))
        .section(followed(tuned))
        .render()
}

pub fn record_page(found: &Identified, title: &str) -> String {
    let values_of = &found.values;
    let lead = format!(
        "From {:.0} s of motion, up to {:.0} kPa: of the torque of the muscles, {:.2} N m (RMS), {:.3} N m is left.",
        values_of.duration_s,
        values_of.highest_pa / 1e3,
        values_of.torque_rms_n_m,
        values_of.residual_rms_n_m
    );
    let figure = motion(&found.records).figure("Angle and pressures", "The record.");
    let title = format!("{title}, identified");
    begun(&title, &lead, &thermyo_joint::render(&found.scenario), found.failed())
        .section(values(values_of))
        .section(torques(&found.estimate))
        .section(Section::new("Record").figure(figure))
        .render()
}

/// The balance of torques of a record as a separate drawing.
pub fn record_plot(found: &Identified, title: &str) -> String {
    torque_chart(&found.estimate).document(title)
}

fn begun(title: &str, lead: &str, scenario: &str, failed: Option<String>) -> Page {
    let page = Page::new(title, lead, scenario);
    match failed {
        Some(reason) => page.warning(&reason),
        None => page,
    }
}

fn values(values: &Values) -> Section {
    tune::values(&values.parameters, "Error").paragraph(
        "An error is the standard error of the scatter, correlated as it is, together with what the configured \
         muscles may be off: 3 % of one force area, 20 % of the elastic forces, 3 kPa of one pressure.",
    )
}

fn torque_chart(estimate: &Estimate) -> Chart {
    let mut torque = Panel::new(Axis::new("Torque of the muscles", "N m")).height(300.0);
    let mut rest = Panel::new(Axis::new("Measured less fitted", "N m")).height(150.0);
    let points = &estimate.fitted.points;
    for (up, fast, name, colour) in [
        (true, false, "growing, slow", Colour::Vermillion),
        (false, false, "falling, slow", Colour::Blue),
        (true, true, "growing, fast", Colour::Orange),
        (false, true, "falling, fast", Colour::Green),
    ] {
        let group = group(points, (up, fast, 0.4), |p| p.speed_rad_s, |p| p.angle_rad);
        let of = |f: fn(&Point) -> f64| group.iter().map(f).collect::<Vec<f64>>();
        let x = of(|p| p.angle_rad.to_degrees());
        torque = torque.dots(name, colour, &x, &of(|p| p.torque_n_m));
        rest = rest.dots("", colour, &x, &of(|p| p.residual_n_m));
    }
    Chart::new(Axis::new("Angle", "deg")).panel(torque).panel(rest.reference(0.0, "0"))
}

fn torques(estimate: &Estimate) -> Section {
    Section::new("Balance of torques").figure(torque_chart(estimate).figure(
        "Torque over the angle",
        "By pressures and the lengths found, in means over 0.1 s in which the joint slides one way. Half of the distance \
         between the slow branches is dry friction, their middle gravity; fast motion adds inertia and viscous \
         friction.",
    ))
}

fn motion(records: &[Record]) -> Chart {
    let of = |f: fn(&Record) -> f64| records.iter().map(f).collect::<Vec<f64>>();
    let time = of(|one| one.time_s);
    Chart::new(Axis::new("Time", "s"))
        .panel(
            Panel::new(Axis::new("Angle", "deg"))
                .dashed(
                    "reference",
                    Colour::SetPoint,
                    &time,
                    &of(|one| one.reference_rad.to_degrees()),
                )
                .line("angle", Colour::Measured, &time, &of(|one| one.angle_rad.to_degrees())),
        )
        .panel(
            Panel::new(Axis::new("Pressure", "kPa"))
                .line("a", Colour::Blue, &time, &of(|one| one.pressure_pa[0] / 1e3))
                .line("b", Colour::Vermillion, &time, &of(|one| one.pressure_pa[1] / 1e3)),
        )
}

fn followed(tuned: &Tuned) -> Section {
    let check = &tuned.findings.check;
    let cells = |f: &Figures| {
        [f.sine_rms_rad, f.rest_error_rad, f.rest_motion_rad].map(f64::to_degrees).to_vec()
    };
    FollowedBy {
        columns: &["Sine, RMS [deg]", "At rest [deg]", "Moving at rest [deg]"],
        caption: "A sine of 1 Hz, then a step and a rest; the error is measured less set point.",
    }
    .section(&check_chart(tuned), [&check.before, &check.after].map(cells))
}

pub fn check_chart(tuned: &Tuned) -> Chart {
    FollowedBy::chart([&tuned.before, &tuned.after], ("Angle", "deg", 3.0), f64::to_degrees)
}
