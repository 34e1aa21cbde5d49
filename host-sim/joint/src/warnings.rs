//! Warnings: scenarios of a joint that are valid and run, but are hardly meant so.

use crate::load::{JointLoaded, joint};
use crate::pair::Pair;
use model_core::joint::allocation::{allocate, stiffness_n_m_rad};
use model_core::joint::swing::FARTHEST_RAD;
use std::collections::BTreeSet;
use std::f64::consts::TAU;
use std::path::Path;
use thermyo_compute::math;
use thermyo_files::input::{InputError, Problem, read_text};
use thermyo_scenario::joint::{JointDocument, JointDrive, is_joint};
use thermyo_scenario::{Chirp, DriveKind, Shape};
use thermyo_setup::{Loaded, unused_in_joint, valves_and_line};

/// Largest factor by which a believed inertia may be wrong: on `scenarios/joint.toml` twice and half of it step well,
/// four times swings from stop to stop, a quarter overshoots by 39 % \[-\].
const WRONG_INERTIA: f64 = 3.0;
/// PWM frequency below which a joint swings: `scenarios/joint.toml` is followed within 0.35 deg at 40 Hz, within 1.2
/// deg at 37 Hz and not at all at 30 Hz \[Hz\].
const SLOW_PWM_HZ: f64 = 40.0;
/// Error below which a stiffness counts as met: the controller tolerates 2 % \[-\].
const STIFFNESS_MET: f64 = 0.05;

/// Deviation below which the core's radii count as those of the table \[-\].
const RADII_MET: f64 = 0.02;

/// Key, value, and the consequence.
type Warning = (String, String, String);

/// Loads the scenario of a joint with its warnings, if the file is one.
///
/// # Errors
/// As [`crate::load`].
pub fn load_with_warnings(
    path: &Path,
) -> Result<Option<(JointLoaded, Vec<InputError>)>, InputError> {
    let text = read_text(path)?;
    if !is_joint(&text) {
        return Ok(None);
    }
    let document = JointDocument::parse(&text, path)?;
    let loaded = joint(&document)?;
    let found = warnings(&document, &loaded);
    Ok(Some((loaded, found)))
}

/// All warnings of a valid scenario, by line.
pub fn warnings(document: &JointDocument, loaded: &JointLoaded) -> Vec<InputError> {
    let mut all: Vec<InputError> = Vec::new();
    let mut found: Vec<Warning> = Vec::new();
    for (document, muscle) in document.muscles.iter().zip(&loaded.muscles) {
        all.extend(thermyo_setup::warnings(document, &driven(muscle)));
        all.extend(unused_in_joint(document));
        let of_loops = valves_and_line(muscle, Some(SLOW_PWM_HZ)).into_iter();
        found.extend(of_loops.map(|(key, value, why)| (key.to_owned(), value, why)));
    }
    all.extend(unused_in_drive(document, &loaded.drive));
    found.extend(believed_inertia(loaded));
    found.extend(slow_step(loaded));
    found.extend(late_course(loaded));
    found.extend(rough_radii(loaded));
    // A stiffness that is not reached cannot cause a swing.
    let beyond = beyond_the_muscles(loaded);
    if beyond.is_empty() {
        found.extend(swings(loaded));
    }
    found.extend(beyond);
    all.extend(found.into_iter().map(|(key, value, why)| InputError {
        file: document.muscles[0].origin.clone(),
        line: document.given(&key).and_then(|(line, ..)| line),
        problem: Box::new(Problem::NoSense { key, value, why }),
    }));
    // Both muscles have most keys in common.
    let mut named = BTreeSet::new();
    all.retain(|warning| named.insert(warning.to_string()));
    all.sort_by_key(|warning| warning.line);
    all
}

/// A muscle that fills and vents; whether its own pressure would come to rest does not matter in a joint.
fn driven(muscle: &Loaded) -> Loaded {
    let mut muscle = muscle.clone();
    for scenario in [&mut muscle.plant, &mut muscle.believed] {
        scenario.drive.kind = DriveKind::MassFlow;
    }
    muscle
}

/// Changed keys of the drive without effect, and a shape that does not move.
fn unused_in_drive(document: &JointDocument, drive: &JointDrive) -> Vec<InputError> {
    let usual = JointDrive::default();
    let constant = drive.shape == Shape::Constant;
    let still = !constant && drive.amplitude_rad == 0.0;
    let by_table = drive.profile_csv.as_ref().map(|_| "not used: drive.profile_csv sets it");
    let by_shape = by_table.or(constant.then_some("not used: drive.shape is \"constant\""));
    let shape =
        by_table.or(still.then_some("drive.amplitude_rad is 0: the angle stays where it is"));
    let number = |key, value: f64, usual: f64, why: Option<&'static str>| {
        (key, format!("{value:?}"), why.filter(|_| value != usual))
    };
    let JointDrive { angle_rad, stiffness_n_m_rad, amplitude_rad, period_s, .. } = *drive;
    [
        number("drive.angle_rad", angle_rad, usual.angle_rad, by_table),
        number("drive.stiffness_n_m_rad", stiffness_n_m_rad, usual.stiffness_n_m_rad, by_table),
        ("drive.shape", format!("{:?}", drive.shape.word()), shape.filter(|_| !constant)),
        number("drive.amplitude_rad", amplitude_rad, usual.amplitude_rad, by_shape),
        number("drive.period_s", period_s, usual.period_s, by_shape),
    ]
    .into_iter()
    .filter_map(|(key, value, why)| {
        let problem = Problem::NoSense { key: key.to_owned(), value, why: why?.to_owned() };
        Some(document.blame(key, problem))
    })
    .collect()
}

fn believed_inertia(loaded: &JointLoaded) -> Option<Warning> {
    let (is, believed) = (loaded.joint.inertia_kg_m2, loaded.believed.inertia_kg_m2);
    let allowed = is / WRONG_INERTIA..=is * WRONG_INERTIA;
    (!allowed.contains(&believed)).then(|| {
        let why = format!(
            "the arm has joint.inertia_kg_m2 = {is:?}: beyond three times of it, or below a third, the joint swings or \
             overshoots; `thermyo tune` finds it"
        );
        ("believed.joint.inertia_kg_m2".to_owned(), format!("{believed:?}"), why)
    })
}

fn rough_radii(loaded: &JointLoaded) -> Option<Warning> {
    let off = loaded.radii_off().filter(|off| off.share > RADII_MET)?;
    let file = loaded.joint.radius_csv.as_ref()?;
    let why = format!(
        "the core has a cubic through the radii, which at {:.2} rad is {:.1} % off that of muscle {}",
        off.angle_rad,
        100.0 * off.share,
        off.muscle
    );
    Some(("joint.radius_csv".to_owned(), format!("{:?}", file.display().to_string()), why))
}

/// A step takes at least 2 sqrt(q I/torque), half of it to accelerate and half of it to brake.
fn slow_step(loaded: &JointLoaded) -> Option<Warning> {
    let drive = &loaded.drive;
    let (size, part, jump, hold) = match drive.shape {
        Shape::Step => (1.0, 0.5, "drive.amplitude_rad", "half"),
        Shape::Staircase => (0.5, 0.125, "half of drive.amplitude_rad", "an eighth"),
        Shape::Constant | Shape::Sine | Shape::Chirp => return None,
    };
    if loaded.profile.is_some() {
        return None;
    }
    let inertia = loaded.believed.inertia_kg_m2;
    let most_n_m = loaded.controller.reference_torque_n_m;
    let jump_rad = size * drive.amplitude_rad.abs();
    let least_s = 2.0 * (jump_rad * inertia / most_n_m).sqrt();
    (least_s > part * drive.period_s).then(|| {
        let why = format!(
            "a step of {jump} takes {least_s:.1} s with joint.controller.reference_torque_n_m = {most_n_m:?}, and the \
             set point jumps again before, after {hold} of drive.period_s"
        );
        ("joint.inertia_kg_m2".to_owned(), format!("{inertia:?}"), why)
    })
}

/// The course begins after the run, or has times in another unit.
fn late_course(loaded: &JointLoaded) -> Option<Warning> {
    let [angle, _] = loaded.profile.as_ref()?;
    let file = loaded.drive.profile_csv.as_ref()?;
    let why = thermyo_setup::late(angle, loaded.muscles[0].plant.run.duration_s)?;
    Some(("drive.profile_csv".to_owned(), format!("{:?}", file.display().to_string()), why))
}

/// An arm that swings on its gas faster than a torque responds: only friction damps it.
fn swings(loaded: &JointLoaded) -> Option<Warning> {
    let believed = &loaded.muscles[0].believed;
    // Longer periods have their own warning.
    if believed.valve.pwm_hz < SLOW_PWM_HZ {
        return None;
    }
    let [config, _] = loaded.config().muscles;
    let late_s = loaded.controller.lead_s + f64::from(config.valve_kind.late_s(&config.valve));
    let delay_s = late_s + believed.pwm_period_s();
    let stiffest = asked(loaded).iter().map(|asked| asked.stiffness_n_m_rad).fold(0.0, f64::max);
    let inertia = loaded.believed.inertia_kg_m2;
    let swing_rad_s = (stiffest / inertia).sqrt();
    let farthest = f64::from(FARTHEST_RAD);
    (swing_rad_s * delay_s > farthest).then(|| {
        let radian_s = delay_s / farthest;
        let least = stiffest * radian_s * radian_s;
        let why = format!(
            "at {stiffest:.1} N m/rad the arm swings at {:.0} Hz on its gas, and a torque that answers it comes {:.0} ms \
             late: friction alone damps it. {least:.2e} kg m2 or more, less stiffness, faster valves (valve.pwm_hz) or \
             shorter hoses would do",
            swing_rad_s / TAU,
            1e3 * delay_s
        );
        ("joint.inertia_kg_m2".to_owned(), format!("{inertia:?}"), why)
    })
}

/// A set point at one time.
struct Asked {
    angle_rad: f64,
    acceleration_rad_s2: f64,
    stiffness_n_m_rad: f64,
}

/// Set points at the ends of the way, or of a profile.
fn asked(loaded: &JointLoaded) -> Vec<Asked> {
    let drive = &loaded.drive;
    let still = |angle_rad, stiffness_n_m_rad| Asked {
        angle_rad,
        acceleration_rad_s2: 0.0,
        stiffness_n_m_rad,
    };
    if let Some([angle, stiffness]) = &loaded.profile {
        let points = angle.points().iter();
        return points.map(|(time_s, angle)| still(*angle, stiffness.value(*time_s))).collect();
    }
    let ends = drive.shape.ends().map(|share| drive.amplitude_rad * share);
    let rad_s = match drive.shape {
        Shape::Sine => TAU / drive.period_s,
        Shape::Chirp => {
            let duration_s = loaded.muscles[0].plant.run.duration_s;
            Chirp::new(drive.period_s, duration_s).rad_s(duration_s)
        }
        Shape::Constant | Shape::Step | Shape::Staircase => 0.0,
    };
    ends.map(|way_rad| Asked {
        acceleration_rad_s2: -way_rad * rad_s * rad_s,
        ..still(drive.angle_rad + way_rad, drive.stiffness_n_m_rad)
    })
    .into()
}

/// Torque and stiffness that the muscles do not reach, each at the first set point that requires it.
fn beyond_the_muscles(loaded: &JointLoaded) -> Vec<Warning> {
    let config = loaded.config();
    let (mut torque, mut stiffness) = (None, None);
    for asked in asked(loaded) {
        let pair = Pair::at(&config, asked.angle_rad);
        let held_n_m = held_n_m(loaded, asked.angle_rad);
        let moved_n_m = held_n_m + loaded.joint.inertia_kg_m2 * asked.acceleration_rad_s2;
        if !pair.reaches(moved_n_m) {
            torque = torque.or_else(|| Some(torque_missed(&pair, loaded, held_n_m, moved_n_m)));
        } else {
            stiffness = stiffness.or_else(|| stiffness_missed(&pair, loaded, held_n_m, &asked));
        }
    }
    [torque, stiffness].into_iter().flatten().collect()
}

/// Torque of the muscles that holds the arm at an angle \[N m\].
fn held_n_m(loaded: &JointLoaded, angle_rad: f64) -> f64 {
    let arm = &loaded.joint;
    let gravity_n_m = arm.gravity_n_m * math::sin(arm.gravity_angle_rad - angle_rad);
    -gravity_n_m - loaded.drive.load_n_m
}

fn torque_missed(pair: &Pair, loaded: &JointLoaded, held_n_m: f64, moved_n_m: f64) -> Warning {
    let [least, most] = pair.torques_n_m();
    let (arm, load_n_m) = (&loaded.joint, loaded.drive.load_n_m);
    let (key, value) = if pair.reaches(held_n_m) {
        ("joint.inertia_kg_m2", arm.inertia_kg_m2)
    } else if load_n_m.abs() > arm.gravity_n_m {
        ("drive.load_n_m", load_n_m)
    } else {
        ("joint.gravity_n_m", arm.gravity_n_m)
    };
    let why = format!(
        "at {:.2} rad the drive asks for a torque of {moved_n_m:.1} N m, and the muscles reach {least:.1} to {most:.1} \
             N m: the arm does not follow",
        pair.angle_rad
    );
    (key.to_owned(), format!("{value:?}"), why)
}

fn stiffness_missed(
    pair: &Pair,
    loaded: &JointLoaded,
    held_n_m: f64,
    asked: &Asked,
) -> Option<Warning> {
    let wanted_n_m_rad = asked.stiffness_n_m_rad;
    let wanted = [held_n_m as f32, wanted_n_m_rad as f32];
    let found = allocate(pair.radius_m, &pair.lines, wanted, pair.most_pa);
    let reached = f64::from(stiffness_n_m_rad(pair.radius_m, &pair.lines, found.gauge_pa));
    let off = (reached - wanted_n_m_rad).abs();
    (found.limited && off > STIFFNESS_MET * reached).then(|| {
            let most = if reached < wanted_n_m_rad { "most" } else { "least" };
            let why = format!(
                "at {:.2} rad the muscles have {reached:.1} N m/rad at {most} with the torque that the arm needs",
                pair.angle_rad
            );
            match &loaded.drive.profile_csv {
                Some(file) => {
                    let why = format!("it asks for {wanted_n_m_rad:?} N m/rad: {why}");
                    ("drive.profile_csv".to_owned(), format!("{:?}", file.display().to_string()), why)
                }
                None => ("drive.stiffness_n_m_rad".to_owned(), format!("{wanted_n_m_rad:?}"), why),
            }
        })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn warned(text: &str) -> Vec<String> {
        let document = JointDocument::parse(text, "joint.toml".as_ref()).unwrap();
        let loaded = joint(&document).unwrap();
        warnings(&document, &loaded).iter().map(ToString::to_string).collect()
    }

    #[test]
    fn a_joint_that_cannot_follow_is_named_by_its_key() {
        for (text, start, end) in [
            (
                "[joint]\n[believed.joint]\ninertia_kg_m2 = 20\n",
                "joint.toml:3: believed.joint.inertia_kg_m2 = 20.0: the arm has joint.inertia_kg_m2 = 0.02: ",
                "`thermyo tune` finds it",
            ),
            (
                "[joint]\n[drive]\nstiffness_n_m_rad = 1e6\n",
                "joint.toml:3: drive.stiffness_n_m_rad = 1000000.0: at 0.00 rad the muscles have ",
                " N m/rad at most with the torque that the arm needs",
            ),
            (
                "[joint]\n[drive]\nstiffness_n_m_rad = 0\n",
                "joint.toml:3: drive.stiffness_n_m_rad = 0.0: at 0.00 rad the muscles have ",
                " N m/rad at least with the torque that the arm needs",
            ),
            (
                "[joint]\ngravity_n_m = 500\n[drive]\nangle_rad = 0.3\n",
                "joint.toml:2: joint.gravity_n_m = 500.0: at 0.30 rad the drive asks for a torque of 147.8 N m, and the \
                 muscles reach -",
                ": the arm does not follow",
            ),
            (
                "[joint]\n[drive]\nload_n_m = 100\n",
                "joint.toml:3: drive.load_n_m = 100.0: at 0.00 rad the drive asks for a torque of -100.0 N m",
                ": the arm does not follow",
            ),
            (
                "[joint]\ninertia_kg_m2 = 50\n[drive]\nshape = \"sine\"\namplitude_rad = 0.3\nperiod_s = 2\n",
                "joint.toml:2: joint.inertia_kg_m2 = 50.0: at 0.30 rad the drive asks for a torque of -148.0 N m",
                ": the arm does not follow",
            ),
            (
                "[joint]\ninertia_kg_m2 = 50\n[drive]\nshape = \"step\"\namplitude_rad = 0.3\nperiod_s = 2\n",
                "joint.toml:2: joint.inertia_kg_m2 = 50.0: a step of drive.amplitude_rad takes 3.2 s",
                "after half of drive.period_s",
            ),
            (
                "[joint]\ninertia_kg_m2 = 50\n[drive]\nshape = \"staircase\"\namplitude_rad = 0.3\nperiod_s = 16\n",
                "joint.toml:2: joint.inertia_kg_m2 = 50.0: a step of half of drive.amplitude_rad takes 2.3 s",
                "after an eighth of drive.period_s",
            ),
            (
                "[joint]\n[drive]\nshape = \"chirp\"\namplitude_rad = 0.3\nperiod_s = 0.5\n",
                "joint.toml: joint.inertia_kg_m2 = 0.02: at 0.30 rad the drive asks for a torque of -242.6 N m",
                ": the arm does not follow",
            ),
            (
                "[joint]\n[joint.a.faults]\ngas = \"open\"\nfrom_s = 500\n",
                "joint.toml:4: faults.from_s = 500.0: not before the end of the run, run.duration_s = ",
                "",
            ),
            (
                "[joint]\n[vessel]\nvolume_m3 = 1e-3\n",
                "joint.toml:3: [vessel] is not used: plant.kind is another one",
                "",
            ),
            (
                "[joint]\n[drive]\namplitude_rad = 0.1\n",
                "joint.toml:3: drive.amplitude_rad = 0.1: not used: drive.shape is \"constant\"",
                "",
            ),
            (
                "[joint]\n[drive]\nperiod_s = 2\n",
                "joint.toml:3: drive.period_s = 2.0: not used: drive.shape is \"constant\"",
                "",
            ),
            (
                "[joint]\n[drive]\nshape = \"sine\"\n",
                "joint.toml:3: drive.shape = \"sine\": drive.amplitude_rad is 0: ",
                "the angle stays where it is",
            ),
            (
                "[joint]\n[controller]\nlength_gain = 2\nminimum_pulse_s = 0.002\n",
                "joint.toml:3: controller.length_gain = 2: not used: a joint has [joint.controller]; ",
                "it uses minimum_pulse_s alone",
            ),
            (
                "[joint]\n[joint.b.believed.controller]\nlength_gain = 2\n",
                "joint.toml:3: believed.controller.length_gain = 2: not used: ",
                "it uses minimum_pulse_s alone",
            ),
            (
                "[joint]\ninertia_kg_m2 = 0.001\n",
                "joint.toml:2: joint.inertia_kg_m2 = 0.001: at 14.0 N m/rad the arm swings at 19 Hz on its gas, and a \
                 torque that answers it comes 15 ms late: ",
                "shorter hoses would do",
            ),
            (
                "[joint]\n[valve]\npwm_hz = 5\n",
                "joint.toml:3: valve.pwm_hz = 5.0: the loops act once in 200 ms",
                "from 40 Hz on by less",
            ),
        ] {
            let found = warned(text);
            assert_eq!(found.len(), 1, "{text}: {found:?}");
            assert!(found[0].starts_with(start) && found[0].ends_with(end), "{found:?}");
        }
    }

    /// Warnings about a drive beside a profile, `course.csv`, which ends with this row.
    fn warned_beside_course(last_row: &str, drive: &str) -> Vec<InputError> {
        let folder = tempfile::tempdir().unwrap();
        let rows = format!("time_s,angle_rad,stiffness_n_m_rad\n0,0,14\n{last_row}\n");
        std::fs::write(folder.path().join("course.csv"), rows).unwrap();
        let path = folder.path().join("joint.toml");
        std::fs::write(&path, format!("[joint]\n[drive]\n{drive}")).unwrap();
        load_with_warnings(&path).unwrap().unwrap().1
    }

    #[test]
    fn a_profile_that_asks_for_too_much_is_named_by_its_key() {
        let found = warned_beside_course("1,0.3,1000", "profile_csv = \"course.csv\"\n");
        let said = found.iter().map(ToString::to_string).collect::<String>();
        assert!(said.contains("joint.toml:3: drive.profile_csv = "), "{said}");
        assert!(said.contains("course.csv\": it asks for 1000.0 N m/rad: at 0.30 rad"), "{said}");
    }

    #[test]
    fn a_course_in_ms_is_warned_of() {
        let rows = "1000,0.1,14\n2000,0.2,14";
        let found = warned_beside_course(rows, "profile_csv = \"course.csv\"\n");
        let said = found.iter().map(ToString::to_string).collect::<String>();
        assert!(said.contains("joint.toml:3: drive.profile_csv = "), "{said}");
        assert!(said.contains("only its first row is before the end of the run"), "{said}");
    }

    #[test]
    fn a_profile_stands_above_all_other_keys_of_the_drive() {
        let drive = "profile_csv = \"course.csv\"\nangle_rad = 0.1\nstiffness_n_m_rad = 12\nshape = \"sine\"\n\
                     amplitude_rad = 0.1\nperiod_s = 2\n";
        let found = warned_beside_course("1,0.1,14", drive);
        let lines: Vec<Option<u64>> = found.iter().map(|warning| warning.line).collect();
        assert_eq!(lines, [4, 5, 6, 7, 8].map(Some), "{found:?}");
        let by_table = |warning: &InputError| {
            warning.to_string().ends_with("not used: drive.profile_csv sets it")
        };
        assert!(found.iter().all(by_table), "{found:?}");
    }

    #[test]
    fn the_shipped_joints_have_no_warning() {
        for name in ["joint.toml", "joint_board.toml", "joint_pulley.toml"] {
            let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios").join(name);
            let (_, found) = load_with_warnings(&path).unwrap().unwrap();
            assert!(found.is_empty(), "{name}: {found:?}");
        }
        for inertia in ["0.007", "0.05"] {
            let text = format!("[joint]\n[believed.joint]\ninertia_kg_m2 = {inertia}\n");
            assert!(warned(&text).is_empty(), "{inertia}");
        }
    }
}
