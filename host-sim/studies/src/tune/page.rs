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
/// Part of the fastest speed above which sliding counts as fast.
const FAST: f64 = 0.5;

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
    let kind = kind(points, share, speed);
    let mut group: Vec<P> = points.iter().filter(|p| kind(p) == (up, fast)).copied().collect();
    group.sort_by(|a, b| place(a).total_cmp(&place(b)));
    group
}

/// Direction of a point, and whether it is fast.
fn kind<P>(points: &[P], share: f64, speed: fn(&P) -> f64) -> impl Fn(&P) -> (bool, bool) {
    let middle = share * points.iter().map(|p| speed(p).abs()).fold(0.0, f64::max);
    move |p| (speed(p) > 0.0, speed(p).abs() > middle)
}

/// Points of one direction and speed that follow each other, each pass by rising contraction. A
/// line through several passes would join them at every point.
fn passes(points: &[Point], (up, fast): (bool, bool)) -> Vec<Vec<Point>> {
    let kind = kind(points, FAST, |p| p.speed_m_s);
    let on = |a: &Point, b: &Point| {
        kind(a) == kind(b) && (b.contraction > a.contraction) == (b.speed_m_s > 0.0)
    };
    let passes = points.chunk_by(on).filter(|pass| kind(&pass[0]) == (up, fast));
    let rising = |pass: &[Point]| {
        let mut pass = pass.to_vec();
        pass.sort_by(|a, b| a.contraction.total_cmp(&b.contraction));
        pass
    };
    passes.map(rising).collect()
}

fn column(points: &[Point], of: impl Fn(&Point) -> f64) -> Vec<f64> {
    points.iter().map(of).collect()
}

fn forces(tuned: &Tuned) -> Section {
    let mut pull = Panel::new(Axis::new("Pull of the gas", "N")).height(300.0);
    let mut rest = Panel::new(Axis::new("Measured less fitted", "N")).height(150.0);
    for (up, fast) in [(true, false), (true, true), (false, false), (false, true)] {
        let all = &tuned.force.points;
        let points = group(all, (up, fast, FAST), |p| p.speed_m_s, |p| p.contraction);
        let percent = |points: &[Point]| column(points, |p| 100.0 * p.contraction);
        let x = percent(&points);
        let colour = if up { Colour::Vermillion } else { Colour::Blue };
        let name = match (up, fast) {
            (true, false) => "contracting",
            (false, false) => "lengthening",
            _ => "",
        };
        pull = pull.dots(name, colour, &x, &column(&points, |p| p.pull_n));
        for pass in passes(all, (up, fast)) {
            let (x, fitted) = (percent(&pass), column(&pass, |p| p.pull_n - p.residual_n));
            pull = match fast {
                true => pull.dashed("fitted, fast", Colour::Ink, &x, &fitted),
                false => pull.line("fitted, slow", Colour::Ink, &x, &fitted),
            };
        }
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

#[cfg(test)]
mod tests {
    use super::*;

    /// One line through two passes over the same way went back and forth between them.
    #[test]
    fn each_pass_has_a_line_of_its_own() {
        let point = |(time_s, contraction, speed_m_s)| Point {
            time_s,
            contraction,
            speed_m_s,
            pull_n: 100.0,
            residual_n: 0.0,
        };
        let points = [
            (0.0, 0.1, 0.01),
            (0.1, 0.12, 0.01),
            (0.2, 0.12, -0.01),
            (0.3, 0.11, -0.01),
            (0.4, 0.11, 0.01),
            (0.5, 0.13, 0.01),
            // The load fell back between two passes in one direction.
            (0.9, 0.105, 0.01),
            (1.0, 0.2, 0.04),
        ]
        .map(point);
        let contractions = |kind| -> Vec<Vec<f64>> {
            passes(&points, kind).iter().map(|pass| column(pass, |p| p.contraction)).collect()
        };
        let slow = [vec![0.1, 0.12], vec![0.11, 0.13], vec![0.105]];
        assert_eq!(contractions((true, false)), slow);
        assert_eq!(contractions((false, false)), [vec![0.11, 0.12]]);
        assert_eq!(contractions((true, true)), [vec![0.2]]);
    }
}
