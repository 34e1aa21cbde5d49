//! Checks whether the gas of a record follows its valves.
//!
//! While only the inlet is open, gas flows in and P V rises; while only the outlet is open, P V falls. It does not rise
//! faster than the open inlet admits gas.

use model_core::Config;
use model_core::physics::chamber::{AnyChamber, Chamber, ChamberConfig};
use model_core::physics::valve::REFERENCE_PRESSURE_PA;
use thermyo_files::input::InputError;
use thermyo_files::number::significant;
use thermyo_files::table::Table;
use thermyo_fit::stops::{LENGTHS, PRESSURES};
use thermyo_record::measured::TIME;

const INLET: &str = "duty_in";
const OUTLET: &str = "duty_out";
/// Sum of the changes of ln(P V) that heat and leak cannot cause \[-\]: gas that cools from 40 K above its wall loses
/// an eighth. Assumption.
const LEAST: f64 = 0.3;

/// Largest rise of P V, as a multiple of the open inlet's: an inlet configured smaller by less than this is no reason
/// to refuse a record. Assumption.
const MOST_PACE: f64 = 4.0;
/// Rise of P V that counts, so that noise does not \[-\]. Assumption.
const LEAST_RISE: f64 = 0.1;
/// Largest number of rows over which the rise may extend.
const RISE_ROWS: usize = 5;

/// P V of the gas at each row \[J\]; none for a record without pressure or length.
fn energies_j(table: &Table, config: &Config) -> Option<Vec<Option<f64>>> {
    let any = |names: [&str; 2]| names.into_iter().find_map(|name| table.column(name).ok());
    let pressures = any(PRESSURES)?;
    let lengths = any(LENGTHS)?;
    let chamber = AnyChamber::new(&config.chamber);
    let energy = |(pressure, length): (&Option<f64>, &Option<f64>)| {
        Some((*pressure)? * f64::from(chamber.volume_m3((*length)? as f32)))
    };
    Some(pressures.iter().zip(lengths).map(energy).collect())
}

/// Refuses a record in minutes: its gas comes in faster than through the open inlet.
pub fn check_pace(table: &Table, config: &Config) -> Result<(), InputError> {
    let (Ok(times), Some(energies)) = (table.filled(TIME), energies_j(table, config)) else {
        return Ok(());
    };
    // Choked, and into gas that loses no heat: d(P V)/dt = k R T m.
    let most_w = f64::from(config.gas.heat_capacity_ratio)
        * f64::from(config.valve.conductance_m3_s_pa)
        * f64::from(REFERENCE_PRESSURE_PA)
        * f64::from(config.supply.pressure_pa);
    let pace = |from: usize, to: usize| {
        let (before, after) = (energies.get(from).copied()??, energies.get(to).copied()??);
        let rises = after > (1.0 + LEAST_RISE) * before && times[to] > times[from];
        rises.then(|| (after - before) / (most_w * (times[to] - times[from])))
    };
    let fast = |row: &usize| {
        let later = (row + 1)..=(row + RISE_ROWS);
        later.filter_map(|to| pace(*row, to)).any(|pace| pace > MOST_PACE)
    };
    match (0..times.len()).find(fast) {
        Some(row) => {
            let allowed = format!(
                "a time from which on P V rises by no more than {} W, {MOST_PACE} times what the open inlet of \
                 valve.conductance_m3_s_pa = {:?} lets in: is this min or h, or is the valve larger?",
                significant(MOST_PACE * most_w, 3),
                config.valve.conductance_m3_s_pa
            );
            Err(table.cell_error(row, TIME, &allowed))
        }
        None => Ok(()),
    }
}

/// Refuses swapped columns, with the rows that show it.
pub fn check(table: &Table, config: &Config) -> Result<(), InputError> {
    if matches!(config.chamber, ChamberConfig::Vessel(_)) {
        return Ok(());
    }
    let cells = |name: &str| table.column(name).ok();
    let (Some(inlet), Some(outlet)) = (cells(INLET), cells(OUTLET)) else { return Ok(()) };
    let Some(energies) = energies_j(table, config) else { return Ok(()) };
    let gas = |row: usize| energies[row].map(f64::ln);
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

    /// Strokes of 5 s at one row per second, which are too slow for the pace of the length.
    #[test]
    fn gas_that_comes_faster_than_by_the_open_inlet_is_refused() {
        let config = Config::default();
        let checked = |unit: f64| {
            let mut text = format!("{TIME},pressure_pa,length_m\n");
            for row in 0..60 {
                let swing = (0.4 * std::f64::consts::PI * f64::from(row)).sin();
                let (pressure_pa, length_m) = (2.4e5 + 1.3e5 * swing, 0.26 - 0.03 * swing);
                text += &format!("{},{pressure_pa},{length_m}\n", unit * f64::from(row));
            }
            let table = Table::parse(&text, "r.csv".as_ref()).unwrap();
            check_pace(&table, &config).map_err(|error| error.to_string())
        };
        assert_eq!(checked(1.0), Ok(()));
        let message = checked(1.0 / 60.0).unwrap_err();
        assert!(
            message.starts_with("r.csv:2: column time_s = 0.0: must be a time from "),
            "{message}"
        );
        assert!(
            message.ends_with(
                "what the open inlet of valve.conductance_m3_s_pa = 4e-9 lets in: is this min or h, or is the valve larger?"
            ),
            "{message}"
        );
    }

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
