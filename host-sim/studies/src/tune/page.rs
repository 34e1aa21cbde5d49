//! `report.html` of a tuning: hysteresis and fit, a step of the pressure, the check before and
//! after.

use super::check::Checked;
use super::experiment::during;
use super::force::Point;
use super::{Figures, Parameter, Tuned};
use thermyo_files::number::significant;
use thermyo_report::Colour;
use thermyo_report::chart::{Axis, Chart, Panel};
use thermyo_report::figure::Figure;
use thermyo_report::page::{Page, Section, Table, Tile};

/// Time that a chart shows before and after a step of the pressure \[s\].
const STEP_BEFORE_S: f64 = 0.05;
const STEP_AFTER_S: f64 = 0.3;

pub fn page(tuned: &Tuned, title: &str) -> String {
    let findings = &tuned.findings;
    let lead = format!(
        "{:.0} s of ramps and steps of the pressure, up to {:.0} kPa: {}.",
        findings.duration_s,
        findings.highest_pa / 1e3,
        findings.headline()
    );
    let check = &findings.check;
    Page::new(&format!("{title}, tuned"), &lead, &thermyo_setup::render(&tuned.scenario))
        .tile(Tile::new(
            "Sine of 0.5 Hz, RMS of the stroke, before",
            check.before.sine_rms_percent,
            "%",
        ))
        .tile(Tile::new("The same after", check.after.sine_rms_percent, "%"))
        .tile(Tile::new("Residual force, RMS", findings.force_rms_n, "N"))
        .section(values(&findings.parameters, "Standard error").paragraph(
            "Standard errors are of the scatter, correlated as it is. Those of friction, force area and stiffness \
             allow for a load that is 1 % off, slip and creep that are 20 % off, and a pressure that is 3 kPa off. \
             The conductance is an effective one, with tube and regulator; heat transfer that is configured 30 % \
             wrong makes it 3 % wrong.",
        ))
        .section(forces(tuned))
        .section(valves(tuned))
        .section(followed(tuned))
        .render()
}

/// Values before and after; `error` is the head of the column of their errors.
pub fn values(parameters: &[Parameter], error: &str) -> Section {
    let columns = ["Parameter", "After", error, "Unit", "Before", "From"];
    let rows = parameters.iter().map(|parameter| {
        vec![
            parameter.path.to_owned(),
            significant(parameter.after, 4),
            significant(parameter.standard_error.unwrap_or(f64::NAN), 2),
            parameter.unit.to_owned(),
            significant(parameter.before, 4),
            parameter.remark.clone(),
        ]
    });
    Section::new("Values").table(Table::new("The core's configuration, in SI", &columns, rows))
}

/// Points of one direction and speed, ordered by place; those above this share of the fastest speed count as fast.
pub fn group<P: Copy>(
    points: &[P],
    (up, fast, share): (bool, bool, f64),
    speed: fn(&P) -> f64,
    place: fn(&P) -> f64,
) -> Vec<P> {
    let middle = share * points.iter().map(|p| speed(p).abs()).fold(0.0, f64::max);
    let within = |p: &&P| (speed(p) > 0.0) == up && (speed(p).abs() > middle) == fast;
    let mut group: Vec<P> = points.iter().filter(within).copied().collect();
    group.sort_by(|a, b| place(a).total_cmp(&place(b)));
    group
}

fn column(points: &[Point], of: impl Fn(&Point) -> f64) -> Vec<f64> {
    points.iter().map(of).collect()
}

fn forces(tuned: &Tuned) -> Section {
    let mut pull = Panel::new(Axis::new("Pull of the gas", "N")).height(300.0);
    let mut rest = Panel::new(Axis::new("Measured less fitted", "N")).height(150.0);
    for (up, fast) in [(true, false), (true, true), (false, false), (false, true)] {
        let points =
            group(&tuned.force.points, (up, fast, 0.5), |p| p.speed_m_s, |p| p.contraction);
        let x = column(&points, |p| 100.0 * p.contraction);
        let colour = if up { Colour::Vermillion } else { Colour::Blue };
        let fitted = column(&points, |p| p.pull_n - p.residual_n);
        let name = match (up, fast) {
            (true, false) => "contracting",
            (false, false) => "lengthening",
            _ => "",
        };
        pull = pull.dots(name, colour, &x, &column(&points, |p| p.pull_n));
        pull = if fast {
            pull.dashed(if up { "fitted, fast" } else { "" }, Colour::Ink, &x, &fitted)
        } else {
            pull.line(if up { "fitted, slow" } else { "" }, Colour::Ink, &x, &fitted)
        };
        rest = rest.dots("", colour, &x, &column(&points, |p| p.residual_n));
    }
    let chart =
        Chart::new(Axis::new("Contraction", "%")).panel(pull).panel(rest.reference(0.0, "0"));
    Section::new("Friction").figure(chart.figure(
        "Hysteresis",
        "Gauge pressure times force area while the muscle slides evenly. Half of the distance between \
         the branches is friction, their middle load and bladder.",
    ))
}

fn valves(tuned: &Tuned) -> Section {
    let steps = during(&tuned.records, &tuned.plan.steps_s);
    let jumps: Vec<f64> = steps
        .windows(2)
        .filter(|pair| (pair[1].set_point - pair[0].set_point).abs() > 1e3)
        .map(|pair| pair[1].time_s)
        .collect();
    // The last step in either direction, when the muscle has warmed up.
    let last = &jumps[jumps.len().saturating_sub(2)..];
    let figures = last.iter().map(|jump_s| step(tuned, *jump_s)).collect();
    Section::new("Valves").figures(figures)
}

fn step(tuned: &Tuned, jump_s: f64) -> Figure {
    let shown = during(&tuned.records, &(jump_s - STEP_BEFORE_S..jump_s + STEP_AFTER_S));
    let time: Vec<f64> = shown.iter().map(|record| 1e3 * (record.time_s - jump_s)).collect();
    let of = |f: fn(&super::Record) -> f64| shown.iter().map(f).collect::<Vec<f64>>();
    let chart = Chart::new(Axis::new("Time", "ms"))
        .half()
        .panel(
            Panel::new(Axis::new("Pressure", "kPa"))
                .dashed("set point", Colour::SetPoint, &time, &of(|r| r.set_point / 1e3))
                .line("measured", Colour::Measured, &time, &of(|r| r.pressure_pa / 1e3)),
        )
        .panel(
            Panel::new(Axis::new("Duty", "%").range(-5.0, 105.0))
                .height(90.0)
                .line("inlet", Colour::Inlet, &time, &of(|r| 100.0 * r.inlet))
                .line("outlet", Colour::Outlet, &time, &of(|r| 100.0 * r.outlet)),
        );
    chart.figure(
        "A step of the pressure",
        "While a duty is 100 %, the valve's conductance and delay are read off the gas mass.",
    )
}

fn followed(tuned: &Tuned) -> Section {
    let check = &tuned.findings.check;
    let cells = |f: &Figures| {
        vec![f.sine_rms_percent, f.rest_error_percent, f.settled_s, f.overshoot_percent]
    };
    FollowedBy {
        columns: &["Sine, RMS [% of stroke]", "At rest [% of stroke]", "Settled [s]", "Overshoot [%]"],
        caption: "A sine of 0.5 Hz, then two steps; of steps the error below shows where they come to rest.",
    }
    .section(&check_chart(tuned), [&check.before, &check.after].map(cells))
}

pub fn check_chart(tuned: &Tuned) -> Chart {
    let quantity = ("Contraction", "%", 1.5);
    FollowedBy::chart([&tuned.before, &tuned.after], quantity, |value| 100.0 * value)
}

/// A motion followed before and after tuning, on a page.
pub struct FollowedBy<'a> {
    /// Heads of the figures' columns.
    pub columns: &'a [&'a str],
    pub caption: &'a str,
}

impl FollowedBy<'_> {
    pub fn section(&self, chart: &Chart, cells: [Vec<f64>; 2]) -> Section {
        let columns = [&[""], self.columns].concat();
        let rows = ["before", "after"].into_iter().zip(cells).map(|(name, cells)| {
            let cells = cells.into_iter().map(|value| significant(value, 3));
            [name.to_owned()].into_iter().chain(cells).collect()
        });
        Section::new("Check")
            .figure(chart.figure("Check, before and after", self.caption))
            .table(Table::new("The same motion with both", &columns, rows))
    }

    /// Charts set point and values, and the errors within a range, in a unit to which `shown` converts.
    pub fn chart<F>(
        checked: [&Checked<F>; 2],
        (quantity, unit, range): (&str, &str, f64),
        shown: fn(f64) -> f64,
    ) -> Chart {
        type Of = fn(&(f64, f64, f64)) -> f64;
        let column = |of: Of| checked.map(|one| one.points.iter().map(of).collect::<Vec<f64>>());
        let shown = |of: Of| column(of).map(|values| values.into_iter().map(shown).collect());
        let [time_before, time] = column(|point| point.0);
        let [_, wanted]: [Vec<f64>; 2] = shown(|point| point.1);
        let [before, after]: [Vec<f64>; 2] = shown(|point| point.2);
        let [error_before, error]: [Vec<f64>; 2] = shown(|point| point.2 - point.1);
        let less = format!("{quantity} less set point");
        Chart::new(Axis::new("Time", "s"))
            .panel(
                Panel::new(Axis::new(quantity, unit))
                    .wide("set point", Colour::Grey, &time, &wanted)
                    .line("before", Colour::Vermillion, &time_before, &before)
                    .line("after", Colour::Blue, &time, &after),
            )
            .panel(
                Panel::new(Axis::new(&less, unit).range(-range, range))
                    .height(150.0)
                    .line("before", Colour::Vermillion, &time_before, &error_before)
                    .line("after", Colour::Blue, &time, &error),
            )
    }
}
