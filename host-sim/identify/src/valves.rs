//! Whether the valves' columns of a record are those of inlet and outlet.
//!
//! Gas flows in while the inlet alone is open, so that P V rises; while the outlet alone is, it falls.

use model_core::Config;
use model_core::physics::chamber::{AnyChamber, Chamber, ChamberConfig};
use thermyo_files::input::InputError;
use thermyo_files::table::Table;

const INLET: &str = "duty_in";
const OUTLET: &str = "duty_out";
/// Sum of the changes of ln(P V) that heat and leak do not make \[-\]: gas that cools from 40 K above its wall loses an
/// eighth. Assumption.
const LEAST: f64 = 0.3;

/// Refuses swapped columns, with the rows that show it.
pub fn check(table: &Table, config: &Config) -> Result<(), InputError> {
    if matches!(config.chamber, ChamberConfig::Vessel(_)) {
        return Ok(());
    }
    let cells = |name: &str| table.column(name).ok();
    let any = |names: [&str; 2]| names.into_iter().find_map(cells);
    let (Some(inlet), Some(outlet)) = (cells(INLET), cells(OUTLET)) else { return Ok(()) };
    let pressures = any(["measured_pressure_pa", "pressure_pa"]);
    let lengths = any(["measured_length_m", "length_m"]);
    let (Some(pressures), Some(lengths)) = (pressures, lengths) else { return Ok(()) };
    let chamber = AnyChamber::new(&config.chamber);
    let gas = |row: usize| {
        let volume_m3 = f64::from(chamber.volume_m3(lengths[row]? as f32));
        Some((pressures[row]? * volume_m3).ln())
    };
    let alone = |open: &[Option<f64>], shut: &[Option<f64>], row: usize| {
        open[row].is_some_and(|duty| duty > 0.0) && shut[row] == Some(0.0)
    };
    // Times during which a valve alone is open: first and last row, and the change.
    let spans = |open: &[Option<f64>], shut: &[Option<f64>]| {
        let mut spans: Vec<(usize, usize, f64)> = Vec::new();
        for row in (1..table.rows()).filter(|row| alone(open, shut, row - 1)) {
            let Some(change) = gas(row).zip(gas(row - 1)).map(|(after, before)| after - before)
            else {
                continue;
            };
            match spans.last_mut().filter(|span| span.1 == row - 1) {
                Some(span) => (span.1, span.2) = (row, span.2 + change),
                None => spans.push((row - 1, row, change)),
            }
        }
        spans
    };
    let (filling, venting) = (spans(inlet, outlet), spans(outlet, inlet));
    let sum = |spans: &[(usize, usize, f64)]| spans.iter().map(|span| span.2).sum::<f64>();
    let most = filling.iter().min_by(|a, b| a.2.total_cmp(&b.2));
    match most.filter(|_| sum(&filling) < -LEAST && sum(&venting) > LEAST) {
        Some((from, to, change)) => {
            let allowed = format!(
                "the inlet's: to line {} it alone is open, and the gas loses {:.0} % of its pressure times volume. Are \
                 {INLET} and {OUTLET} swapped?",
                table.line(*to),
                100.0 * (1.0 - change.exp())
            );
            Err(table.cell_error(*from, INLET, &allowed))
        }
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn swapped_valves_are_refused_with_the_rows() {
        let config = Config::default();
        let text = |[inlet, outlet]: [&str; 2]| {
            let mut text = format!("time_s,pressure_pa,length_m,{inlet},{outlet}\n");
            for row in 0..60 {
                let fills = row < 30;
                let pressure_pa = 1.5e5 + 5e3 * f64::from(if fills { row } else { 60 - row });
                let duty = u8::from(fills);
                text +=
                    &format!("{},{pressure_pa},0.25,{duty},{}\n", 0.01 * f64::from(row), 1 - duty);
            }
            text
        };
        let checked = |columns| {
            let table = Table::parse(&text(columns), "r.csv".as_ref()).unwrap();
            check(&table, &config).map_err(|error| error.to_string())
        };
        assert_eq!(checked([INLET, OUTLET]), Ok(()));
        let message = checked([OUTLET, INLET]).unwrap_err();
        assert!(
            message.starts_with("r.csv:32: column duty_in = 1.0: must be the inlet's: to line 61 "),
            "{message}"
        );
        assert!(message.ends_with("Are duty_in and duty_out swapped?"), "{message}");
    }
}
