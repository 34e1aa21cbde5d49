//! Muscles, seals and vessels that others recorded in motion or at rest, and a user's own records: each is split before
//! anything is fitted.

use super::{CaseFigures, Figure};
use crate::pair::pair;
use std::f64::consts::PI;
use std::iter;
use std::path::{Path, PathBuf};
use thermyo_compute::math::ends;
use thermyo_compute::parallel;
use thermyo_files::input::{InputError, Problem};
use thermyo_files::shipped;
use thermyo_files::table::{Table, read_whole};
use thermyo_identify::motion::{LawLeft, laws};
use thermyo_record::measured::{check_distances, check_pressures, check_rising};

/// Smallest coefficient of determination of a pair's response to the commanded force alone.
const PAIR_R2: f64 = 0.97;
const BORE_M: f64 = 0.0257;
const AMBIENT_PA: f64 = 101_325.0;
/// Share of a stroke that is left out at either end, where it turns \[-\].
const ENDS: f64 = 0.25;
/// Seals, and the pressures of their records \[bar\]: the line through the outer two is compared at the
/// inner two.
const SEALS: [&str; 2] = ["o-ring257", "x-ring257"];
const BARS: [u32; 4] = [1, 3, 5, 7];
/// Largest error of the O-ring's friction at pressures between the fitted ones \[N\]. The X-ring's is not a straight
/// line.
const SEAL_N: f64 = 1.0;
/// Time for which a vessel is shut off, so that its gas takes the temperature of the wall \[s\].
const SHUT_S: f64 = 15.0;
/// Share of a vessel's record that is fitted \[-\].
const FITTED: f64 = 0.6;
const FEWEST: usize = 10;
/// Largest distance of the record's rows \[s\].
const MOST_S: f64 = 10.0;
/// Largest error of a vessel's pressure in the held-out part, relative to the pressure at the start \[%\].
const VESSEL_PERCENT: f64 = 1.0;

/// Every case below a folder in the layout of `docs/background/validation.md`.
pub fn evaluate(folder: &Path) -> Result<Vec<CaseFigures>, InputError> {
    let dynamic = folder.join("dynamic");
    let mut lines = Vec::new();
    let antagonists = dynamic.join("antagonist_5050.csv");
    if antagonists.exists() {
        lines.push(pair_of(&antagonists)?);
    }
    for seal in SEALS {
        let files = BARS.map(|bar| dynamic.join(format!("cylinder_{seal}_{bar}bar.csv")));
        if files.iter().any(|file| file.exists()) {
            lines.push(seal_of(seal, &files)?);
        }
    }
    let vessel = |file: &PathBuf| stem(file).starts_with("vessel_");
    for file in tables(&dynamic).into_iter().filter(vessel) {
        lines.push(vessel_of(&file)?);
    }
    for file in tables(&folder.join("motion")) {
        lines.extend(motion_of(&file)?);
    }
    Ok(lines)
}

/// Tables of a folder, by name.
pub fn tables(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let mut files: Vec<PathBuf> = entries.map(|entry| entry.path()).collect();
    files.retain(|file| file.extension().is_some_and(|own| own.eq_ignore_ascii_case("csv")));
    files.sort();
    files
}

fn stem(file: &Path) -> String {
    file.file_stem().unwrap_or_default().to_string_lossy().into()
}

fn pair_of(file: &Path) -> Result<CaseFigures, InputError> {
    let found = pair(&read_whole(file)?, AMBIENT_PA)?;
    let names = ["r2_way", "r2_pressure_1", "r2_pressure_2"];
    let mut figures: Vec<Figure> = names
        .into_iter()
        .zip(found.r2)
        .map(|(name, r2)| Figure::at_least(name, r2, PAIR_R2))
        .collect();
    let least = found.frictionless_r2.into_iter().fold(f64::INFINITY, f64::min);
    figures.push(Figure::shown("r2_without_friction", least));
    figures.push(Figure::shown("slip_n", found.slip_n));
    Ok(CaseFigures { case: "pair of 10 mm muscles, last 9 s".to_owned(), figures })
}

/// Half width of a seal's loop \[N\], and the mean gauge pressure \[Pa\].
fn half_width(table: &Table) -> Result<(f64, f64), InputError> {
    let [lengths, pressures, forces] =
        ["length_m", "pressure_pa", "force_n"].map(|name| table.filled(name));
    let (lengths, pressures, forces) = (lengths?, pressures?, forces?);
    check_pressures(table, "pressure_pa", AMBIENT_PA)?;
    let [least, most] = ends(lengths.iter().copied());
    let inside = (least + ENDS * (most - least))..(most - ENDS * (most - least));
    let area_m2 = PI / 4.0 * BORE_M * BORE_M;
    let mut sums = [(0.0, 0.0); 2];
    let mut pressure = 0.0;
    for i in 1..lengths.len().saturating_sub(1) {
        if inside.contains(&lengths[i]) {
            let way = usize::from(lengths[i + 1] > lengths[i - 1]);
            let gauge_pa = pressures[i] - AMBIENT_PA;
            sums[way] = (sums[way].0 + 1.0, sums[way].1 + forces[i] - gauge_pa * area_m2);
            pressure += gauge_pa;
        }
    }
    if sums.iter().any(|(count, _)| *count == 0.0) {
        let why = "half of a loop takes rows of a stroke in and of one out".to_owned();
        return Err(unusable(table, "length_m", why));
    }
    let [back, forth] = sums.map(|(count, sum)| sum / count);
    Ok((0.5 * (forth - back).abs(), pressure / (sums[0].0 + sums[1].0)))
}

fn unusable(table: &Table, column: &str, why: String) -> InputError {
    table.header_error(Problem::UnusableColumn { column: column.to_owned(), why })
}

fn seal_of(seal: &str, files: &[PathBuf; 4]) -> Result<CaseFigures, InputError> {
    let tables = files.iter().map(|file| read_whole(file)).collect::<Result<Vec<_>, _>>()?;
    let widths = tables.iter().map(half_width).collect::<Result<Vec<_>, _>>()?;
    let ((first_n, first_pa), (last_n, last_pa)) = (widths[0], widths[3]);
    if last_pa <= first_pa {
        let why = format!(
            "{last_pa:.0} Pa above ambient in the mean: must be above the {first_pa:.0} Pa of the file of 1 bar"
        );
        return Err(unusable(&tables[3], "pressure_pa", why));
    }
    let slope = (last_n - first_n) / (last_pa - first_pa);
    let at = |pressure_pa: f64| first_n + slope * (pressure_pa - first_pa);
    let mean_n = 0.5 * (first_n + last_n);
    let worst = |of: &dyn Fn(f64) -> f64| {
        let errors = widths[1..3].iter().map(|(width_n, pa)| (of(*pa) - width_n).abs());
        errors.fold(0.0, f64::max)
    };
    let at_four_bar_n = at(4.0e5);
    Ok(CaseFigures {
        case: format!("seal of a cylinder, {seal}, 3 and 5 bar by 1 and 7"),
        figures: vec![
            if seal.starts_with('o') {
                Figure::at_most("held_out_n", worst(&at), SEAL_N)
            } else {
                Figure::shown("held_out_n", worst(&at))
            },
            Figure::shown("constant_n", worst(&|_| mean_n)),
            Figure::shown("at_1_bar_n", first_n),
            Figure::shown("at_7_bar_n", last_n),
            Figure::shown("pressure_factor", slope * 4.0e5 / at_four_bar_n),
        ],
    })
}

/// Pressures of a vessel that leaks by ISO 6358, dP/dt = -k P f(P_amb/P), f falling from 1 at the critical
/// ratio b to 0.
fn leaked(times: &[f64], first_pa: f64, [per_s, critical]: [f64; 2]) -> Vec<f64> {
    let mut pressure = first_pa;
    let mut before = times[0];
    let mut after = |time: &f64| {
        let parts = (200.0 * per_s * (time - before)).ceil().max(1.0);
        for _ in 0..parts as u32 {
            let above = ((AMBIENT_PA / pressure - critical) / (1.0 - critical)).clamp(0.0, 1.0);
            pressure -= per_s * pressure * (1.0 - above * above).sqrt() * (time - before) / parts;
        }
        before = *time;
        pressure
    };
    times.iter().map(&mut after).collect()
}

/// The leak fitted to the first part of a record; errors over the pressure at the start.
fn vessel_of(file: &Path) -> Result<CaseFigures, InputError> {
    let table = read_whole(file)?;
    let (mut times, mut pressures) = (table.filled("time_s")?, table.filled("pressure_pa")?);
    check_rising(&table, &times)?;
    check_pressures(&table, "pressure_pa", AMBIENT_PA)?;
    check_distances(&table, &times, (MOST_S, "which shows a leak"))?;
    let begins = times.partition_point(|time| *time < SHUT_S);
    times.drain(..begins);
    pressures.drain(..begins);
    if times.len() < FEWEST {
        let why = format!("{} rows from {SHUT_S:?} s on: must be {FEWEST} or more", times.len());
        return Err(unusable(&table, "time_s", why));
    }
    let cut = (FITTED * times.len() as f64) as usize;
    let left = |found: &[f64], measured: &[f64]| {
        let squares = found.iter().zip(measured).map(|(found, is)| (found - is).powi(2));
        (squares.sum::<f64>() / measured.len() as f64).sqrt() / pressures[0]
    };
    let fitted =
        |leak: [f64; 2]| left(&leaked(&times[..cut], pressures[0], leak), &pressures[..cut]);
    // No leak, and from a hundred thousandth to a tenth of the gas per second, in steps of 1 %.
    let rates = iter::once(0.0).chain((0..926).map(|i| 1.0e-5 * 1.01_f64.powi(i)));
    let all: Vec<[f64; 2]> =
        rates.flat_map(|rate| [0.1, 0.2, 0.3, 0.4, 0.5].map(|critical| [rate, critical])).collect();
    let lefts = parallel::map(&all, |leak| fitted(*leak));
    let best = (0..all.len()).min_by(|a, b| lefts[*a].total_cmp(&lefts[*b])).unwrap_or(0);
    let found = leaked(&times, pressures[0], all[best]);
    let tight = vec![pressures[cut - 1]; times.len() - cut];
    Ok(CaseFigures {
        case: format!("vessel shut off, {}", stem(file).trim_start_matches("vessel_")),
        figures: vec![
            Figure::at_most(
                "held_out_percent",
                100.0 * left(&found[cut..], &pressures[cut..]),
                VESSEL_PERCENT,
            ),
            Figure::shown("fitted_percent", 100.0 * lefts[best]),
            Figure::shown("without_leak_percent", 100.0 * left(&tight, &pressures[cut..])),
            Figure::shown("leak_percent_per_s", 100.0 * all[best][0]),
        ],
    })
}

/// A record of motion, with the scenario beside it, or the scenario of a free DMSP-10.
fn motion_of(file: &Path) -> Result<Vec<CaseFigures>, InputError> {
    let own = file.with_extension("toml");
    let shipped_path = Path::new("scenarios/motion.toml");
    let (loaded, config) = if own.exists() {
        (thermyo_setup::load(&own)?, own.as_path())
    } else {
        (thermyo_setup::parse(shipped::text("motion.toml"), shipped_path)?, shipped_path)
    };
    let name = stem(file);
    let one = |left: LawLeft| {
        let LawLeft { name: law, fitted, held } = left;
        let mut figures = Vec::new();
        for (length, force, left) in
            [("fitted_mm", "fitted_n", fitted), ("held_out_mm", "held_out_n", held)]
        {
            figures.extend(left.length_m.map(|m| Figure::shown(length, 1000.0 * m)));
            figures.push(Figure::shown(force, left.force_n));
        }
        CaseFigures { case: format!("motion, {name}: {law}"), figures }
    };
    Ok(laws(&loaded, config, &read_whole(file)?)?.into_iter().map(one).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A piston of 25.7 mm at 2 bar, whose seal takes 5 N, and whose load cell is off by 3 N.
    #[test]
    fn a_seal_is_half_of_its_loop() {
        let mut text = "time_s,length_m,pressure_pa,force_n\n".to_owned();
        for i in 0..4000 {
            let up = (i / 500) % 2 == 0;
            let part = f64::from(i % 500) / 500.0;
            let length_m = 0.05 * if up { part } else { 1.0 - part };
            let force_n = 2.0e5 * PI / 4.0 * BORE_M * BORE_M + if up { 5.0 } else { -5.0 } + 3.0;
            text += &format!("{},{length_m},301325,{force_n}\n", 0.01 * f64::from(i));
        }
        let table = Table::parse(&text, "seal.csv".as_ref()).unwrap();
        let (half_n, pressure_pa) = half_width(&table).unwrap();
        let one_way =
            "time_s,length_m,pressure_pa,force_n\n0,0.1,3e5,1\n1,0.2,3e5,1\n2,0.3,3e5,1\n";
        let error = half_width(&Table::parse(one_way, "seal.csv".as_ref()).unwrap()).unwrap_err();
        assert!(error.to_string().contains("seal.csv: column length_m: "), "{error}");
        assert!((half_n - 5.0).abs() < 0.05 && (pressure_pa - 2.0e5).abs() < 1.0, "{half_n}");
    }
}
