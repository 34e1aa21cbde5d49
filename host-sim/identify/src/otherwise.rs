//! Mistakes of a record that a fit to the gas sensor alone takes for other values: gauge pressures, and a sensor that is
//! recorded later than the pressure. Each is tried: where the fit then misses far less, the values are wrong.

use super::data::Input;
use super::fit::{End, Problem};
use thermyo_files::number::{of_column, significant};
use thermyo_fit::search::LeastSquares;

/// Ratio of the residuals from which on the mistake counts: the laws of air leave as much with either.
const BETTER: f64 = 2.0;
/// Step of the difference in the delay \[s\].
const DIFFERENCE_S: f64 = 0.01;
/// Linear searches for the delay, and the longest one \[s\].
const SEARCHES: usize = 3;
const LONGEST_S: f64 = 1.0;

/// The mistake without which the fit misses far less than at its end `best`.
pub fn found(problem: &Problem, best: &End) -> Option<String> {
    if !matches!(problem.data.input, Input::Given(_)) {
        return None;
    }
    let with = |raised_pa: f64, delay_s: f64| {
        let experiment = problem.experiment.clone().recorded_otherwise(raised_pa, delay_s);
        Problem { experiment, ..problem.clone() }
    };
    let observed = &problem.data.observed[0];
    let misses = |end: &End| {
        let rms_k = observed.deviation * (end.cost / observed.points.len() as f64).sqrt();
        of_column(rms_k, observed.quantity.column())
    };
    let better = |end: &End| BETTER * BETTER * end.cost < best.cost;
    let instead = |end: &End| format!("misses {} instead of {}", misses(end), misses(best));

    let absolute = with(problem.scenario.ambient.pressure_pa, 0.0).minimize(&best.place)?;
    if better(&absolute) {
        return Some(format!(
            "pressure_pa is gauge pressure: with the ambient pressure added the fit {}",
            instead(&absolute)
        ));
    }

    let (mut delay_s, mut end) = (0.0, best.clone());
    for _ in 0..SEARCHES {
        let now = with(0.0, delay_s);
        let residuals = now.weighted(&end.place);
        let later = with(0.0, delay_s + DIFFERENCE_S).weighted(&end.place);
        let change = (later - &residuals) / DIFFERENCE_S;
        let slopes = now.sensitivities(&end.place);
        let values = slopes.clone().svd(true, true).solve(&change, f64::EPSILON).ok()?;
        let own = &change - slopes * values;
        delay_s = (delay_s - own.dot(&residuals) / own.dot(&change)).clamp(-LONGEST_S, LONGEST_S);
        end = with(0.0, delay_s).minimize(&end.place)?;
    }
    better(&end).then(|| {
        let [late, early] = ["sensor_gas_k", "pressure_pa"];
        let [late, early] = if delay_s > 0.0 { [late, early] } else { [early, late] };
        format!(
            "{late} is {} ms later than {early}: without that the fit {}; a housing of the sensor that is not \
             configured delays it too",
            significant(1e3 * delay_s.abs(), 2),
            instead(&end)
        )
    })
}

#[cfg(test)]
pub(crate) mod tests {
    use crate::record::known_columns;
    use crate::{Findings, identify};
    use std::path::Path;
    use thermyo_files::table::Table;
    use thermyo_record::measured::Measured;
    use thermyo_record::trace::Row;
    use thermyo_setup::Loaded;
    use thermyo_simulation::board::CoreBoard;
    use thermyo_simulation::run;

    /// Findings of a run's rows of 10 ms: time, pressure, length, gas sensor, duties; after a change.
    pub(crate) fn identified(
        loaded: &Loaded,
        fitted: &Loaded,
        mut change: impl FnMut([f64; 6]) -> [f64; 6],
    ) -> Findings {
        let mut rows = "time_s,pressure_pa,length_m,sensor_gas_k,duty_in,duty_out\n".to_owned();
        let mut observer = |row: &Row| {
            let (truth, command) = (&row.truth, &row.telemetry.command);
            if row.telemetry.step.is_multiple_of(10) {
                let duties = [command.inlet.share(), command.outlet.share()].map(f64::from);
                let [time_s, pressure_pa] = [truth.time_s, truth.pressure_pa];
                let cells = [time_s, pressure_pa, truth.length_m, row.sensor_gas_k];
                let cells = change([cells[0], cells[1], cells[2], cells[3], duties[0], duties[1]]);
                rows += &(cells.map(|cell| cell.to_string()).join(",") + "\n");
            }
            Ok(())
        };
        run::run(loaded, &mut CoreBoard::default(), None, &mut observer).unwrap();
        let data = Path::new("d.csv");
        let table = Table::parse(&rows, data).unwrap();
        let measured = Measured::since_first(&table, &known_columns()).unwrap();
        identify(fitted, "c.toml".as_ref(), &measured, data, &()).unwrap().findings
    }

    /// Heat transfer and lag were 25 and 45 stated errors off, with exit code 0.
    #[test]
    fn gauge_pressures_and_a_late_sensor_are_found() {
        let scenario = |heat: f64, lag_s: f64| {
            let text = format!(
                "[run]\nduration_s = 30\n[plant]\nmodel = \"lumped\"\ninitial_pressure_pa = 250000\n\
                 [load]\nforce_n = 100\n[drive]\nkind = \"pressure\"\nshape = \"sine\"\noffset = 300000\n\
                 amplitude = 100000\nperiod_s = 5\n[heat]\nmodel = \"constant\"\ninner_w_m2_k = {heat}\n\
                 [sensor.gas]\ntime_constant_s = {lag_s}\n[identify]\nparameters = [\"heat.inner_w_m2_k\", \
                 \"sensor.gas.time_constant_s\"]\ncolumns = [\"sensor_gas_k\"]\nstarts = 2\n"
            );
            thermyo_setup::parse(&text, "c.toml".as_ref()).unwrap()
        };
        let found = |change: &mut dyn FnMut([f64; 6]) -> [f64; 6]| {
            identified(&scenario(15.0, 2.0), &scenario(20.0, 3.0), change).failed()
        };
        assert_eq!(found(&mut |cells| cells), None);
        let gauge = found(&mut |[time, pressure, rest @ ..]| {
            let [length, gas, inlet, outlet] = rest;
            [time, pressure - 101_325.0, length, gas, inlet, outlet]
        });
        assert!(gauge.unwrap().starts_with("pressure_pa is gauge pressure: "));
        // 20 rows are 200 ms.
        let mut gases = Vec::new();
        let late = found(&mut |mut cells| {
            gases.push(cells[3]);
            cells[3] = gases[gases.len().saturating_sub(21)];
            cells
        });
        let late = late.unwrap();
        let delay_ms = late.strip_prefix("sensor_gas_k is ").unwrap().split(' ').next().unwrap();
        assert!((190.0..210.0).contains(&delay_ms.parse::<f64>().unwrap()), "{late}");
        assert!(
            late.contains(" ms later than pressure_pa: without that the fit misses "),
            "{late}"
        );
    }
}
