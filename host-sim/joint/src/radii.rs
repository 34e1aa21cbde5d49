//! Radii of a joint's pulley from a table, and the core's cubic through them.

use model_core::joint::JointConfig;
use model_core::joint::allocation::Line;
use model_core::physics::chamber::{AnyChamber, Chamber};
use std::sync::Arc;
use thermyo_files::input::InputError;
use thermyo_files::table::Table;
use thermyo_plant::pulley::Pulley;
use thermyo_scenario::WrongCell;
use thermyo_scenario::joint::Joint;
use thermyo_setup::numbers_in;

/// Angle \[rad\], and the radii of muscles a and b \[m\].
pub type Rows = Arc<[[f64; 3]]>;

const COLUMNS: [&str; 3] = ["angle_rad", "radius_a_m", "radius_b_m"];
/// Allowed radii, as for `joint.radius_m` \[m\].
const ALLOWED_M: [f64; 2] = [1.0e-3, 10.0];
/// Share of a radius that counts as zero: the rounding of a fit \[-\].
const ROUNDING: f64 = 1.0e-9;
/// Number of intervals of the way at whose ends a cubic is compared, and the joint's stiffness checked.
const INTERVALS: u32 = 100;
/// Nodes and weights of Gauss and Legendre that are exact up to the fifth power.
const GAUSS: [(f64, f64); 3] = [
    (-0.774_596_669_241_483_4, 5.0 / 18.0),
    (0.0, 8.0 / 18.0),
    (0.774_596_669_241_483_4, 5.0 / 18.0),
];

/// Range in which lengths are known: between the stops, and at angle 0, where they are given \[rad\].
fn way_rad(joint: &Joint) -> [f64; 2] {
    [joint.minimum_rad.min(0.0), joint.maximum_rad.max(0.0)]
}

/// Angles of the way at equal intervals \[rad\].
fn along([least, most]: [f64; 2]) -> impl Iterator<Item = f64> {
    (0..=INTERVALS).map(move |i| least + f64::from(i) / f64::from(INTERVALS) * (most - least))
}

/// The rows of a table.
///
/// # Errors
/// For a missing column, and the first cell that is not allowed.
pub fn rows(table: &Table, joint: &Joint) -> Result<Rows, InputError> {
    let wrong = |rows: &[[f64; 3]]| wrong_cell(rows, way_rad(joint));
    numbers_in(table, COLUMNS, wrong).map(Rows::from)
}

fn wrong_cell(rows: &[[f64; 3]], [least, most]: [f64; 2]) -> Option<WrongCell> {
    let wrong = |row, column, allowed: String| Some(WrongCell { row, column, allowed });
    let last = rows.len() - 1;
    if last == 0 {
        return wrong(0, 0, "the first one of two rows or more".to_owned());
    }
    for (row, [angle_rad, radii_m @ ..]) in rows.iter().enumerate() {
        if row > 0 && *angle_rad <= rows[row - 1][0] {
            let allowed = format!("above {:?}, the angle of the row before", rows[row - 1][0]);
            return wrong(row, 0, allowed);
        }
        let none =
            radii_m.iter().position(|radius_m| !(ALLOWED_M[0]..=ALLOWED_M[1]).contains(radius_m));
        if let Some(muscle) = none {
            let [least_m, most_m] = ALLOWED_M;
            return wrong(row, 1 + muscle, format!("a number from {least_m} to {most_m} m"));
        }
    }
    let why = "lengths are given at angle 0";
    if rows[0][0] > least {
        let allowed = format!("{least:?} at most: rows cover joint.minimum_rad and 0, {why}");
        return wrong(0, 0, allowed);
    }
    if rows[last][0] < most {
        let allowed = format!("{most:?} at least: rows cover joint.maximum_rad and 0, {why}");
        return wrong(last, 0, allowed);
    }
    None
}

/// Coefficients, by rising powers, of the cubic with the smallest squared distance to a radius over the way: its
/// projection on Legendre's polynomials, exact for rows that are joined by lines \[m\].
fn cubic(rows: &[[f64; 3]], column: usize, [least, most]: [f64; 2]) -> [f64; 4] {
    let (middle, half) = (0.5 * (least + most), 0.5 * (most - least));
    let mut shares = [0.0; 4];
    for pair in rows.windows(2) {
        let (from, to) = (pair[0], pair[1]);
        let (low, high) = (from[0].max(least), to[0].min(most));
        if low >= high {
            continue;
        }
        for (node, weight) in GAUSS {
            let angle_rad = 0.5 * (low + high) + 0.5 * (high - low) * node;
            let share = (angle_rad - from[0]) / (to[0] - from[0]);
            let radius_m = from[column] + share * (to[column] - from[column]);
            let x = (angle_rad - middle) / half;
            let legendre = [1.0, x, 0.5 * (3.0 * x * x - 1.0), 0.5 * x * (5.0 * x * x - 3.0)];
            for ((share, value), twice) in shares.iter_mut().zip(legendre).zip([1.0, 3.0, 5.0, 7.0])
            {
                *share += 0.5 * twice * value * radius_m * weight * (high - low) / half;
            }
        }
    }
    let [p0, p1, p2, p3] = shares;
    // By powers of x = (q - middle)/half, and then of q, by Horner's scheme.
    let powers = [p0 - 0.5 * p2, p1 - 1.5 * p3, 1.5 * p2, 2.5 * p3];
    let mut of_angle = [0.0; 4];
    for power in powers.into_iter().rev() {
        let mut next = [0.0; 4];
        for i in 0..3 {
            next[i + 1] += of_angle[i] / half;
        }
        for i in 0..4 {
            next[i] -= of_angle[i] * middle / half;
        }
        next[0] += power;
        of_angle = next;
    }
    of_angle
}

/// The mechanism with the cubic through the rows in place of its radii.
pub fn fitted(joint: &Joint, rows: &[[f64; 3]]) -> Joint {
    let [least, most] = way_rad(joint);
    let way_rad = [least.max(rows[0][0]), most.min(rows[rows.len() - 1][0])];
    let [a, b] = [1, 2].map(|column| cubic(rows, column, way_rad));
    let radius_m = a[0];
    let largest_rad = way_rad[0].abs().max(way_rad[1]);
    // A power whose share at the largest angle is below the rounding does not count.
    let share = |of: [f64; 4], power: usize| {
        let share = of[power] / radius_m;
        let at_end: f64 = std::iter::repeat_n(largest_rad, power).product();
        if share.abs() * at_end < ROUNDING { 0.0 } else { share }
    };
    let is_same = (b[0] / radius_m - 1.0).abs() < ROUNDING;
    Joint {
        radius_m,
        radius_a_per_rad: share(a, 1),
        radius_a_per_rad2: share(a, 2),
        radius_a_per_rad3: share(a, 3),
        radius_b_share: if is_same { 1.0 } else { b[0] / radius_m },
        radius_b_per_rad: share(b, 1),
        radius_b_per_rad2: share(b, 2),
        radius_b_per_rad3: share(b, 3),
        ..joint.clone()
    }
}

/// The pulley of a mechanism: from its rows, or from its coefficients.
pub fn pulley(joint: &Joint, rows: Option<&Rows>) -> Pulley {
    if let Some(rows) = rows {
        return Pulley::rows(joint.radius_m, rows.clone());
    }
    let Joint { radius_a_per_rad, radius_a_per_rad2, radius_a_per_rad3, .. } = *joint;
    let Joint { radius_b_share, radius_b_per_rad, radius_b_per_rad2, radius_b_per_rad3, .. } =
        *joint;
    let of_a = [1.0, radius_a_per_rad, radius_a_per_rad2, radius_a_per_rad3];
    let of_b = [radius_b_share, radius_b_per_rad, radius_b_per_rad2, radius_b_per_rad3];
    Pulley::powers(joint.radius_m, [of_a, of_b])
}

/// Largest deviation of the core's radius from the plant's.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Off {
    /// Deviation as a share of the plant's radius \[-\].
    pub share: f64,
    pub angle_rad: f64,
    pub muscle: &'static str,
}

/// Deviation of a mechanism's cubic from the rows of another one.
pub fn off(is: &Joint, rows: &Rows, believed: &Joint) -> Off {
    let [plants, cubics] = [pulley(is, Some(rows)), pulley(believed, None)];
    let mut off = Off { share: 0.0, angle_rad: 0.0, muscle: "a" };
    let [least, most] = way_rad(is);
    let knots =
        rows.iter().map(|row| row[0]).filter(|angle_rad| (least..=most).contains(angle_rad));
    for angle_rad in along([least, most]).chain(knots) {
        let pairs = plants.shares(angle_rad).into_iter().zip(cubics.shares(angle_rad));
        for ((is_share, cubic), muscle) in pairs.zip(["a", "b"]) {
            let share = (cubic * believed.radius_m / (is_share * is.radius_m) - 1.0).abs();
            if share > off.share {
                off = Off { share, angle_rad, muscle };
            }
        }
    }
    off
}

/// An angle, if any, at which radii vary so fast that more pressure in both muscles makes the joint softer \[rad\].
pub fn softens(config: &JointConfig) -> Option<f64> {
    let chambers = config.muscles.each_ref().map(|muscle| AnyChamber::new(&muscle.chamber));
    let mechanism = &config.mechanism;
    along([mechanism.minimum_rad, mechanism.maximum_rad].map(f64::from)).find(|angle_rad| {
        let lengths_m = mechanism.lengths_m(*angle_rad as f32);
        let levers = mechanism.levers(*angle_rad as f32);
        let [a, b] = [0, 1].map(|i: usize| {
            let length_m = chambers[i].limit_length_m(lengths_m[i]);
            Line::new(&config.muscles[i], &chambers[i], length_m, 0.0, &levers[i])
        });
        // At the same torque the pressures rise as 1/A.
        let stiffens = a.area_m2 * b.stiffness_m + b.area_m2 * a.stiffness_m;
        levers.iter().any(|lever| !lever.is_plain()) && stiffens <= 0.0
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::load::{JointLoaded, parse};
    use crate::render::render;
    use crate::warnings::load_with_warnings;
    use std::fs;
    use thermyo_compute::math;

    const HEADER: &str = "angle_rad,radius_a_m,radius_b_m\n";
    const TABLE: &str = "[joint]\nradius_csv = \"radius.csv\"\n";

    /// Loads a scenario beside a table with these rows.
    fn loaded(rows: &str, text: &str) -> Result<JointLoaded, String> {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("radius.csv"), rows).unwrap();
        let found = parse(text, &folder.path().join("joint.toml"));
        found.map_err(|error| error.to_string().replace(&folder.path().display().to_string(), "."))
    }

    fn table(radii_m: impl Fn(f64) -> [f64; 2]) -> String {
        let row = |i: i32| {
            let angle_rad = 0.05 * f64::from(i);
            let [a_m, b_m] = radii_m(angle_rad);
            format!("{angle_rad},{a_m},{b_m}\n")
        };
        HEADER.to_owned() + &(-18..=18).map(row).collect::<String>()
    }

    fn coefficients(joint: &Joint) -> [f64; 8] {
        [
            joint.radius_m,
            joint.radius_a_per_rad,
            joint.radius_a_per_rad2,
            joint.radius_a_per_rad3,
            joint.radius_b_share,
            joint.radius_b_per_rad,
            joint.radius_b_per_rad2,
            joint.radius_b_per_rad3,
        ]
    }

    #[test]
    fn a_table_of_one_radius_is_that_radius() {
        let found = loaded(&table(|_| [0.021, 0.021]), TABLE).unwrap();
        let [radius_m, rest @ ..] = coefficients(&found.joint);
        assert!((radius_m / 0.021 - 1.0).abs() < 1e-12);
        assert_eq!(rest, [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]);
        assert!(found.config().mechanism.levers(0.5).iter().all(|lever| lever.is_plain()));
        let linear = |q: f64| [0.02 * (1.0 + 0.2 * q), 0.022 * (1.0 - 0.1 * q)];
        let found = loaded(&table(linear), TABLE).unwrap();
        let expected = [0.02, 0.2, 0.0, 0.0, 1.1, -0.11, 0.0, 0.0];
        for (found, expected) in coefficients(&found.joint).into_iter().zip(expected) {
            assert!((found - expected).abs() < 1e-8, "{found} {expected}");
        }
    }

    /// An eccentric wheel, whose radius is a sine: a parabola leaves 1.1 %.
    #[test]
    fn the_core_has_a_cubic_through_the_table() {
        let wheel =
            |q: f64| [0.02 * (1.0 + 0.23 * math::sin(q)), 0.02 * (1.0 - 0.23 * math::sin(q))];
        let found = loaded(&table(wheel), TABLE).unwrap();
        let off = found.radii_off().unwrap();
        assert!((1e-5..1e-3).contains(&off.share), "{off:?}");
        let arm = found.arm();
        for angle_rad in [-0.8, -0.3, 0.0, 0.5, 0.8] {
            let is = arm.lengths_m(angle_rad);
            let way_m = 0.02 * (angle_rad + 0.23 * (1.0 - math::cos(angle_rad)));
            assert!((is[0] - (0.27 - way_m)).abs() < 2e-6, "{is:?} at {angle_rad}");
            let believed = found.config().mechanism.lengths_m(angle_rad as f32);
            for (is, believed) in is.into_iter().zip(believed) {
                assert!((is - f64::from(believed)).abs() < 5e-6, "{is} {believed} at {angle_rad}");
            }
        }
        // Two lines that meet do not form a cubic.
        let folder = tempfile::tempdir().unwrap();
        let kinked = table(|q| [0.016 + 0.008 * q.abs(), 0.02]);
        fs::write(folder.path().join("radius.csv"), kinked).unwrap();
        let path = folder.path().join("joint.toml");
        fs::write(&path, TABLE).unwrap();
        let (_, warnings) = load_with_warnings(&path).unwrap().unwrap();
        let said = warnings.iter().map(ToString::to_string).collect::<String>();
        assert!(said.contains("joint.toml:2: joint.radius_csv = ") && said.lines().count() == 1);
        assert!(said.ends_with("at 0.00 rad is 7.5 % off that of muscle a"), "{said}");
    }

    #[test]
    fn what_is_no_table_of_radii_is_refused_by_its_cell() {
        let ends =
            |least: &str, most: &str| format!("{HEADER}{least},0.02,0.02\n{most},0.02,0.02\n");
        for (rows, text, expected) in [
            (
                ends("-0.7", "0.8"),
                "",
                "./radius.csv:2: column angle_rad = -0.7: must be -0.8 at most: rows cover joint.minimum_rad and 0, \
                 lengths are given at angle 0",
            ),
            (
                ends("-1", "0.5"),
                "",
                "./radius.csv:3: column angle_rad = 0.5: must be 0.8 at least: ",
            ),
            (
                ends("0.2", "0.9"),
                "minimum_rad = 0.3\n",
                "./radius.csv:2: column angle_rad = 0.2: must be 0.0 at most: ",
            ),
            (
                ends("-1", "-1"),
                "",
                "./radius.csv:3: column angle_rad = -1.0: must be above -1.0, the angle of the row before",
            ),
            (
                format!("{HEADER}-1,0.02,0.02\n1,0.02,0\n"),
                "",
                "./radius.csv:3: column radius_b_m = 0.0: must be a number from 0.001 to 10 m",
            ),
            (
                format!("{HEADER}-1,-0.02,0.02\n1,0.02,0.02\n"),
                "",
                "./radius.csv:2: column radius_a_m = -0.02: must be a number from 0.001 to 10 m",
            ),
            (
                format!("{HEADER}0,0.02,0.02\n"),
                "",
                "./radius.csv:2: column angle_rad = 0.0: must be the first one of two rows or more",
            ),
            (
                "angle_rad,radius_m\n-1,0.02\n1,0.02\n".to_owned(),
                "",
                "./joint.toml:2: joint.radius_csv: ./radius.csv: column radius_a_m is missing",
            ),
            (
                format!("{HEADER}-1,0.02,x\n"),
                "",
                "./joint.toml:2: joint.radius_csv: ./radius.csv:2: column radius_b_m = x: must be ",
            ),
            (
                ends("-1", "1"),
                "radius_m = 0.02\n",
                "./joint.toml:3: joint.radius_m = 0.02: must be left out",
            ),
            // 70 mm of a muscle that is 300 mm long.
            (
                format!("{HEADER}-1,0.09,0.09\n1,0.09,0.09\n"),
                "",
                "./joint.toml:2: joint.mid_length_a_m (less the pulley's way to the stop) = ",
            ),
        ] {
            let said = loaded(&rows, &format!("{TABLE}{text}")).unwrap_err();
            assert!(said.starts_with(expected) && said.lines().count() == 1, "{said}");
        }
        let missing = parse(TABLE, "joint.toml".as_ref()).unwrap_err().to_string();
        assert!(missing.starts_with("joint.toml:2: joint.radius_csv: radius.csv"), "{missing}");
    }

    #[test]
    fn a_radius_that_softens_the_joint_is_refused() {
        let steep = "[joint]\nradius_a_per_rad = 1.4\nradius_b_per_rad = -1.4\nmaximum_rad = 0.5\n\
                     minimum_rad = -0.5\n";
        let said = parse(steep, "joint.toml".as_ref()).unwrap_err().to_string();
        assert!(
            said.starts_with("joint.toml:2: joint.radius_a_per_rad = 1.4: must be such that radii vary more slowly: "),
            "{said}"
        );
    }

    #[test]
    fn a_printed_scenario_has_the_table() {
        let folder = tempfile::tempdir().unwrap();
        let wheel = |q: f64| [0.02 + 0.004 * math::sin(q), 0.02 - 0.003 * math::sin(q)];
        fs::write(folder.path().join("radius.csv"), table(wheel)).unwrap();
        let origin = folder.path().join("joint.toml");
        for believed in ["", "inertia_kg_m2 = 0.03\n", "radius_m = 0.02\n"] {
            let loaded = parse(&format!("{TABLE}[believed.joint]\n{believed}"), &origin).unwrap();
            let printed = render(&loaded);
            let again = parse(&printed, "elsewhere/joint.toml".as_ref()).unwrap();
            assert_eq!((&again.joint, &again.believed), (&loaded.joint, &loaded.believed));
            assert_eq!((&again.rows, again.config()), (&loaded.rows, loaded.config()));
            assert_eq!(render(&again), printed);
            assert_eq!(loaded.radii_off().is_none(), believed.starts_with("radius_m"));
        }
        let constant =
            parse(&format!("{TABLE}[believed.joint]\nradius_m = 0.02\n"), &origin).unwrap();
        assert!(constant.config().mechanism.levers(0.5).iter().all(|lever| lever.is_plain()));
    }
}
