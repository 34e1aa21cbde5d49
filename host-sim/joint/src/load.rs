//! From the scenario of a joint to the data of a run.

use crate::pair::Pair;
use crate::radii::{self, Off, Rows};
use model_core::ConfigError;
use model_core::joint::{JointConfig, Motion};
use std::path::{Path, PathBuf};
use thermyo_files::input::{InputError, Problem, quoted, read_text};
use thermyo_files::table::{Table, read_table};
use thermyo_plant::joint::Arm;
use thermyo_scenario::joint::{Joint, JointController, JointDocument, JointDrive, RADII, is_joint};
use thermyo_scenario::profile::Profile;
use thermyo_scenario::schema::Limits;
use thermyo_scenario::{ChannelFault, Document, Load, LoadKind, ShapePoint};
use thermyo_setup::core_config::core_config;
use thermyo_setup::{Loaded, assemble, no_file, profile_in, refuse_files, refuse_vessel};
use thermyo_simulation::board::in_f32_digits;

/// Shortest and longest interval on either side over which the motion of a profile is taken \[s\]: differences over
/// single rows of 10 ms would turn the last digit of an angle into an acceleration.
const DIFFERENCES_S: [f64; 2] = [0.02, 0.05];
/// Largest acceleration of a profile's motion, as a multiple of the accelerations that the reference's torque gives at
/// rest: an assumption, beyond what muscles achieve \[-\].
const MOST_TIMES: f64 = 3.0;
/// PWM period up to which a small pulse waits: longer periods give less than 100 pulses a second anyway \[s\].
const WAITS_UP_TO_S: f64 = 0.01;
/// Largest gain from the inertia: 35 rad/s, where a period and a half at 100 Hz is half a radian. On
/// `scenarios/joint.toml` with 4e-3 kg m2 the default gain, 55 rad/s, swings by 1.1 deg at rest \[1/s2\].
const GAIN_PER_S2: f64 = 1200.0;
/// Acceleration of the reference of a heavy arm: that of 2 kg at 0.27 m with the default torque of 2.5 N m \[rad/s2\].
const REFERENCE_RAD_S2: f64 = 17.0;
/// Share of the muscles' torque that it may take: the rest holds, stiffens and corrects (assumption) \[-\].
const REFERENCE_SHARE: f64 = 0.25;
/// Largest share of an error of the gas mass that a PWM period closes: as the default at 100 Hz \[-\].
const CLOSES: f64 = 0.7;
/// Time of sound through a metre of hose, at 343 m/s \[s/m\].
const SOUND_S_M: f64 = 0.0029;

/// Scenario of a joint, checked, with every default filled in.
#[derive(Debug, Clone, PartialEq)]
pub struct JointLoaded {
    pub muscles: [Loaded; 2],
    /// The plant's mechanism; with a table of radii it has the cubic through them.
    pub joint: Joint,
    /// The plant's radii over the angle, from `joint.radius_csv`.
    pub rows: Option<Rows>,
    /// The mechanism that the core is configured with.
    pub believed: Joint,
    /// Tuning of the core's controller.
    pub controller: JointController,
    /// The set point over time.
    pub drive: JointDrive,
    /// Angle \[rad\] and stiffness \[N m/rad\] over time, from `drive.profile_csv`.
    pub profile: Option<[Profile; 2]>,
    /// External torque over time \[N m\], from `drive.load_csv`.
    pub load: Option<Profile>,
}

impl JointLoaded {
    /// The core's configuration.
    pub fn config(&self) -> JointConfig {
        let [a, b] = &self.muscles;
        JointConfig {
            muscles: [core_config(&a.believed), core_config(&b.believed)],
            mechanism: self.believed.core(),
            tuning: self.controller.core(),
            angle_part: self.believed.sensor_kind.part(),
        }
    }

    /// The plant's mechanism.
    pub fn arm(&self) -> Arm {
        arm(&self.joint, self.rows.as_ref())
    }

    /// Deviation of the core's radii from the plant's table; `None` without a table, and if other radii are configured.
    pub fn radii_off(&self) -> Option<Off> {
        let rows = self.rows.as_ref().filter(|_| self.believed.radius_csv.is_some())?;
        Some(radii::off(&self.joint, rows, &self.believed))
    }

    pub fn motion(&self, time_s: f64) -> Motion {
        match &self.profile {
            Some([angle, stiffness]) => {
                let JointController { reference_torque_n_m, reference_speed_rad_s, .. } =
                    self.controller;
                let most_rad_s2 = reference_torque_n_m / self.believed.inertia_kg_m2;
                let limits = [reference_speed_rad_s, most_rad_s2];
                course(angle, stiffness.value(time_s), limits, time_s)
            }
            None => shaped(&self.drive, time_s, self.muscles[0].plant.run.duration_s),
        }
    }

    /// The key of a drive's angle beyond a joint's stops, and the message.
    pub fn beyond(&self, joint: &Joint) -> Option<(&'static str, Problem)> {
        let Joint { minimum_rad, maximum_rad, .. } = *joint;
        let JointDrive { angle_rad, amplitude_rad, .. } = self.drive;
        let ends: Vec<f64> = match &self.profile {
            Some([angle, _]) => angle.points().iter().map(|(_, angle_rad)| *angle_rad).collect(),
            None => self.drive.shape.ends().map(|share| angle_rad + amplitude_rad * share).into(),
        };
        let end_rad = ends.into_iter().find(|end| !(minimum_rad..=maximum_rad).contains(end))?;
        let (key, value_rad) = match &self.profile {
            Some(_) => ("drive.profile_csv", end_rad),
            None if end_rad == angle_rad => ("drive.angle_rad", angle_rad),
            None => ("drive.amplitude_rad", amplitude_rad),
        };
        let plants = [self.joint.minimum_rad, self.joint.maximum_rad];
        let stops =
            if plants == [minimum_rad, maximum_rad] { "stops" } else { "stops as configured" };
        let problem = Problem::NotAllowed {
            key: key.to_owned(),
            value: value_rad.to_string(),
            allowed: format!(
                "such that the angle, which reaches {end_rad:.4}, stays between the {stops}, {minimum_rad} to \
                 {maximum_rad} rad"
            ),
        };
        Some((key, problem))
    }

    pub fn load_n_m(&self, time_s: f64) -> f64 {
        self.drive.load_n_m + self.load.as_ref().map_or(0.0, |load| load.value(time_s))
    }
}

fn arm(joint: &Joint, rows: Option<&Rows>) -> Arm {
    Arm {
        pulley: radii::pulley(joint, rows),
        mid_length_m: [joint.mid_length_a_m, joint.mid_length_b_m],
        inertia_kg_m2: joint.inertia_kg_m2,
        gravity_n_m: joint.gravity_n_m,
        gravity_angle_rad: joint.gravity_angle_rad,
        viscous_n_m_s: joint.viscous_n_m_s,
        friction_n_m: joint.friction_n_m,
        stops_rad: [joint.minimum_rad, joint.maximum_rad],
    }
}

/// The set point of a profile at a time, with its derivatives over an interval as long as its rows are apart. A motion
/// faster than the reference may be \[rad/s\] is a step, which has no derivatives; the acceleration is limited
/// \[rad/s2\].
pub fn course(
    angle: &Profile,
    stiffness_n_m_rad: f64,
    [fastest_rad_s, most_rad_s2]: [f64; 2],
    time_s: f64,
) -> Motion {
    let [shortest_s, longest_s] = DIFFERENCES_S;
    let apart = |within_s: f64| {
        let points = angle.points();
        let first = points.partition_point(|point| point.0 <= time_s - within_s).max(1) - 1;
        let last = points.partition_point(|point| point.0 < time_s + within_s);
        points[first..(last + 1).min(points.len())].windows(2)
    };
    let rows_s = apart(longest_s).map(|pair| pair[1].0 - pair[0].0).fold(longest_s, f64::min);
    let over_s = rows_s.max(shortest_s);
    let [before, now, after] = [-over_s, 0.0, over_s].map(|later_s| angle.value(time_s + later_s));
    let jumps = apart(over_s)
        .any(|pair| (pair[1].1 - pair[0].1).abs() > fastest_rad_s * (pair[1].0 - pair[0].0));
    let still = Motion::still(now as f32, stiffness_n_m_rad as f32);
    if jumps {
        return still;
    }
    let most_rad_s2 = MOST_TIMES * most_rad_s2;
    let acceleration =
        ((after - 2.0 * now + before) / (over_s * over_s)).clamp(-most_rad_s2, most_rad_s2);
    Motion {
        speed_rad_s: ((after - before) / (2.0 * over_s)) as f32,
        acceleration_rad_s2: acceleration as f32,
        ..still
    }
}

fn shaped(drive: &JointDrive, time_s: f64, duration_s: f64) -> Motion {
    let JointDrive { angle_rad, stiffness_n_m_rad, amplitude_rad, period_s, .. } = *drive;
    let ShapePoint { share, speed_1_s, acceleration_1_s2 } =
        drive.shape.at(time_s, period_s, duration_s);
    Motion {
        angle_rad: (angle_rad + amplitude_rad * share) as f32,
        speed_rad_s: (amplitude_rad * speed_1_s) as f32,
        acceleration_rad_s2: (amplitude_rad * acceleration_1_s2) as f32,
        stiffness_n_m_rad: stiffness_n_m_rad as f32,
    }
}

/// Loads the scenario of a joint, if the file is one.
///
/// # Errors
/// In one line: file, line, key, the value and the allowed ones.
pub fn load(path: &Path) -> Result<Option<JointLoaded>, InputError> {
    let text = read_text(path)?;
    if is_joint(&text) { parse(&text, path).map(Some) } else { Ok(None) }
}

/// As [`load`], of a record that begins at this angle and has set points and load itself: their files are not read.
///
/// # Errors
/// As [`load`].
pub fn load_recorded(path: &Path, start_rad: f64) -> Result<Option<JointLoaded>, InputError> {
    let text = read_text(path)?;
    if !is_joint(&text) {
        return Ok(None);
    }
    let document = JointDocument::parse(&text, path)?;
    let profile =
        document.drive.profile_csv.as_ref().map(|_| [start_rad, 0.0].map(Profile::constant));
    assembled(&document, (profile, None)).map(Some)
}

/// Parses the scenario of a joint; `origin` is its name in messages.
///
/// # Errors
/// As [`load`].
pub fn parse(text: &str, origin: &Path) -> Result<JointLoaded, InputError> {
    joint(&JointDocument::parse(text, origin)?)
}

/// As [`parse`], for a text whose sender may not read this machine's files.
///
/// # Errors
/// As [`load`]; any key with a file's path is refused.
pub fn parse_alone(text: &str, origin: &Path) -> Result<JointLoaded, InputError> {
    let document = JointDocument::parse(text, origin)?;
    let JointDrive { profile_csv, load_csv, .. } = &document.drive;
    let radius_csv = &document.joint.radius_csv;
    let files = [
        ("joint.radius_csv", radius_csv),
        ("drive.profile_csv", profile_csv),
        ("drive.load_csv", load_csv),
    ];
    for (key, path) in files {
        if let Some(path) = path {
            return Err(document.blame(key, no_file(key.to_owned(), format!("{path:?}"))));
        }
    }
    document.muscles.iter().try_for_each(refuse_files)?;
    joint(&document)
}

/// The scenario of a joint from its document.
///
/// # Errors
/// As [`load`].
pub fn joint(document: &JointDocument) -> Result<JointLoaded, InputError> {
    assembled(document, profiles(document)?)
}

fn assembled(
    document: &JointDocument,
    (profile, load): Profiles,
) -> Result<JointLoaded, InputError> {
    let start_rad = match &profile {
        Some([angle, _]) => angle.value(0.0),
        None => document.drive.angle_rad,
    };
    let rows = rows(document)?;
    let [is, believed] =
        [&document.joint, &document.believed].map(|of| mechanism(document, of, rows.as_ref()));
    let [length_a_m, length_b_m] = arm(&is, rows.as_ref()).lengths_m(start_rad);
    let [a, b] = &document.muscles;
    let mut muscles = [muscle(document, a, length_a_m)?, muscle(document, b, length_b_m)?];
    // Muscle b has no length sensor that could break.
    for scenario in [&mut muscles[1].plant, &mut muscles[1].believed] {
        for window in scenario.faults.windows_mut() {
            (window.length, window.length_drift_m_s) = (ChannelFault::None, None);
        }
    }
    let mut controller = document.controller.clone();
    derive(&mut controller, document, &muscles);
    let mut loaded = JointLoaded {
        muscles,
        joint: is,
        rows,
        believed,
        controller,
        drive: absolute(document),
        profile,
        load,
    };
    if !document.has("joint.controller.reference_torque_n_m") {
        let torque_n_m = reference_torque_n_m(&loaded);
        let usual_n_m = &mut loaded.controller.reference_torque_n_m;
        *usual_n_m = usual_n_m.max(torque_n_m);
    }
    check(document, &loaded)?;
    Ok(loaded)
}

/// Torque that accelerates the reference of a heavy arm as that of a lighter one, in tenths \[N m\].
fn reference_torque_n_m(loaded: &JointLoaded) -> f64 {
    let [least_n_m, most_n_m] = Pair::at(&loaded.config(), 0.0).torques_n_m();
    let muscles_n_m = most_n_m.min(-least_n_m).max(0.0);
    let heavy_n_m = REFERENCE_RAD_S2 * loaded.believed.inertia_kg_m2;
    (10.0 * heavy_n_m.min(REFERENCE_SHARE * muscles_n_m)).floor() / 10.0
}

/// Derives the controller's timing and gain from the core's configuration if the scenario leaves them out.
fn derive(controller: &mut JointController, document: &JointDocument, muscles: &[Loaded; 2]) {
    let given = |key: &str| document.has(&format!("joint.controller.{key}"));
    let [a, _] = muscles;
    let period_s = a.believed.pwm_period_s();
    if !given("waits_n_m") && period_s > WAITS_UP_TO_S {
        controller.waits_n_m = 0.0;
    }
    if !given("mass_loop_s") {
        controller.mass_loop_s = controller.mass_loop_s.min(period_s / CLOSES);
    }
    if !given("gain_n_m_rad") {
        let inertia_kg_m2 = document.believed.inertia_kg_m2;
        controller.gain_n_m_rad = controller.gain_n_m_rad.min(GAIN_PER_S2 * inertia_kg_m2);
    }
    if !given("lead_s") {
        // A pulse waits for the next period or does not: 0.25 periods on average.
        let waits_s = if controller.waits_n_m > 0.0 { 0.25 * period_s } else { 0.0 };
        let [a_m, b_m] = muscles.each_ref().map(|Loaded { believed: s, .. }| {
            s.tube.line().filter(|_| s.moves_in_full()).map_or(0.0, |[length_m, _]| length_m)
        });
        controller.lead_s = waits_s + SOUND_S_M * a_m.max(b_m);
    }
}

/// The path of a file in the scenario, relative to the scenario's folder.
fn beside(document: &JointDocument, path: &Path) -> PathBuf {
    let folder = document.muscles[0].origin.parent();
    folder.unwrap_or(Path::new("")).join(path)
}

/// A mechanism with the cubic through its table of radii, whose path is absolute.
fn mechanism(document: &JointDocument, joint: &Joint, rows: Option<&Rows>) -> Joint {
    let (Some(path), Some(rows)) = (&joint.radius_csv, rows) else { return joint.clone() };
    let file = beside(document, path);
    let radius_csv = Some(std::path::absolute(&file).unwrap_or(file));
    Joint { radius_csv, ..radii::fitted(joint, rows) }
}

/// The drive with absolute paths, so that the scenario that `check` prints works in any folder.
fn absolute(document: &JointDocument) -> JointDrive {
    let mut drive = document.drive.clone();
    for path in [&mut drive.profile_csv, &mut drive.load_csv].into_iter().flatten() {
        let file = beside(document, path);
        *path = std::path::absolute(&file).unwrap_or(file);
    }
    drive
}

/// A muscle held at this length, without a drive of its own.
fn muscle(joint: &JointDocument, own: &Document, length_m: f64) -> Result<Loaded, InputError> {
    let mut document = own.clone();
    let wrong = |problem| joint.blame("joint.mid_length_a_m", problem);
    // The load has no force: the length is the mechanism's, and is checked with it.
    document.set("load.force_n", 0.0).map_err(wrong)?;
    document.set_word("drive.kind", "closed").map_err(wrong)?;
    let loaded = assemble(&document)?;
    refuse_vessel(own, &loaded, "in a joint")?;
    let mut held = loaded;
    for scenario in [&mut held.plant, &mut held.believed] {
        scenario.load = Load { kind: LoadKind::Isometric, length_m, ..Load::default() };
    }
    Ok(held)
}

/// Checks the mechanisms of plant and core by the core's rules, and the set points against the stops.
fn check(document: &JointDocument, loaded: &JointLoaded) -> Result<(), InputError> {
    let [a, b] = &loaded.muscles;
    let of_plant = JointConfig {
        muscles: [core_config(&a.plant), core_config(&b.plant)],
        mechanism: loaded.joint.core(),
        tuning: loaded.controller.core(),
        angle_part: loaded.joint.sensor_kind.part(),
    };
    let [kind, believed] = [&loaded.joint, &loaded.believed].map(|joint| joint.sensor_kind.word());
    if believed != kind {
        let problem = Problem::NotAllowed {
            key: "believed.joint.sensor_kind".to_owned(),
            value: quoted(&format!("{believed:?}")),
            allowed: format!("{kind:?}, as joint.sensor_kind, or left out"),
        };
        return Err(document.blame("believed.joint.sensor_kind", problem));
    }
    check_alike(document, loaded)?;
    let believed = loaded.config();
    for (prefix, config) in [("", &of_plant), ("believed.", &believed)] {
        config.check().map_err(|error| refused(document, prefix, &error))?;
        check_stiffness(document, prefix, config)?;
    }
    // Checked with the table itself, not with the cubic through it.
    let Joint { minimum_rad, maximum_rad, .. } = loaded.joint;
    let arm = loaded.arm();
    for stop_rad in [minimum_rad, maximum_rad] {
        let lengths_m = arm.lengths_m(stop_rad).map(|length_m| length_m as f32);
        of_plant.check_lengths(lengths_m).map_err(|error| refused(document, "", &error))?;
    }
    check_period(document, &loaded.drive, a.plant.run.step_s)?;
    // The cells of a profile have been checked, each with its line.
    let joints = [&loaded.joint, &loaded.believed].into_iter();
    match joints.filter(|_| loaded.profile.is_none()).find_map(|joint| loaded.beyond(joint)) {
        Some((key, problem)) => Err(document.blame(key, problem)),
        None => Ok(()),
    }
}

fn check_period(
    document: &JointDocument,
    drive: &JointDrive,
    step_s: f64,
) -> Result<(), InputError> {
    let (steps, why) = drive.shape.least_steps();
    if drive.profile_csv.is_some() || drive.period_s >= steps * step_s {
        return Ok(());
    }
    let problem = Problem::NotAllowed {
        key: "drive.period_s".to_owned(),
        value: format!("{:?}", drive.period_s),
        allowed: format!("{:?} s or more: {why}", steps * step_s),
    };
    Err(document.blame("drive.period_s", problem))
}

/// Checks that no radius varies faster than its muscle is stiff.
fn check_stiffness(
    document: &JointDocument,
    prefix: &str,
    config: &JointConfig,
) -> Result<(), InputError> {
    let Some(angle_rad) = radii::softens(config) else { return Ok(()) };
    let names = ["radius_csv"].into_iter().chain(RADII);
    let mut paths = names.flat_map(|name| [prefix, ""].map(|of| format!("{of}joint.{name}")));
    let given = paths.find_map(|path| document.given(&path));
    let (line, key, value) = given.unwrap_or_default();
    let file = document.joint.radius_csv.as_ref();
    let value = file.filter(|_| value.is_empty()).map_or(value, |path| format!("{path:?}"));
    let allowed = format!(
        "such that radii vary more slowly: at {angle_rad:.2} rad more pressure in both muscles makes the joint softer"
    );
    let problem = Box::new(Problem::NotAllowed { key, value, allowed });
    Err(InputError { file: document.muscles[0].origin.clone(), line, problem })
}

/// Checks that both muscles have the same kind of valve and the same period, since one loop drives them; the message
/// names the file's keys.
fn check_alike(document: &JointDocument, loaded: &JointLoaded) -> Result<(), InputError> {
    for prefix in ["", "believed."] {
        let scenarios = loaded
            .muscles
            .each_ref()
            .map(|muscle| if prefix.is_empty() { &muscle.plant } else { &muscle.believed });
        let [a, b] = scenarios.map(core_config);
        let kind = scenarios.map(|scenario| format!("{:?}", scenario.valve.kind.word()));
        let hz = scenarios.map(|scenario| format!("{:?} Hz", scenario.valve.pwm_hz));
        let keys = [
            ("valve.kind", a.valve_kind.is_switching() == b.valve_kind.is_switching(), kind),
            ("valve.pwm_hz", a.pwm_period_steps == b.pwm_period_steps, hz),
        ];
        let Some((key, _, texts)) = keys.into_iter().find(|(_, alike, _)| !alike) else { continue };
        let own = [format!("{prefix}{key}"), key.to_owned()];
        let found = own.into_iter().find_map(|path| Some((document.own(&path)?, path)));
        let ((i, line), path) = found.unwrap_or(((1, None), key.to_owned()));
        let names = ["a", "b"];
        let problem = Problem::NotAllowed {
            key: format!("joint.{}.{path}", names[i]),
            value: texts[i].clone(),
            allowed: format!(
                "{}, as of muscle {}: one loop drives both; or set {path} for both",
                texts[1 - i],
                names[1 - i]
            ),
        };
        let file = document.muscles[0].origin.clone();
        return Err(InputError { file, line, problem: Box::new(problem) });
    }
    Ok(())
}

/// Keys that limit another one, and that the file need not have.
const PARTNERS: [(&str, &[&str]); 8] = [
    ("joint.radius_m", &["joint.radius_csv"]),
    ("joint.radius_a_per_rad", &SHAPES),
    ("joint.radius_b_share", &SHAPES),
    ("joint.maximum_rad", &["joint.minimum_rad"]),
    ("joint.sensor_minimum_rad", &["joint.minimum_rad"]),
    ("joint.sensor_maximum_rad", &["joint.maximum_rad"]),
    ("joint.mid_length_a_m", &LENGTHS),
    ("joint.mid_length_b_m", &LENGTHS),
];
const SHAPES: [&str; 7] = [
    "joint.radius_csv",
    "joint.radius_a_per_rad2",
    "joint.radius_a_per_rad3",
    "joint.radius_b_per_rad",
    "joint.radius_b_per_rad2",
    "joint.radius_b_per_rad3",
    "joint.maximum_rad",
];
const LENGTHS: [&str; 8] = [
    "joint.radius_m",
    "joint.radius_csv",
    "joint.minimum_rad",
    "joint.maximum_rad",
    "muscle.rest_length_m",
    "muscle.slack_m",
    "muscle.braid_angle_deg",
    "plant.kind",
];

/// The core's refusal, in terms of the file.
fn refused(document: &JointDocument, prefix: &str, error: &ConfigError) -> InputError {
    let ConfigError { field, value, minimum, maximum } = *error;
    let (key, note) = field.split_once(' ').unwrap_or((field, ""));
    let note = if note.is_empty() { String::new() } else { format!(" {note}") };
    let partners = PARTNERS.iter().find(|(of, _)| *of == key).map_or(&[][..], |(_, keys)| *keys);
    // Without believed values, the core would have the plant's, which have been checked.
    let prefixes = [prefix, ""].into_iter();
    let paths = prefixes.flat_map(|prefix| {
        [key].into_iter().chain(partners.iter().copied()).map(move |key| format!("{prefix}{key}"))
    });
    let given = paths.into_iter().find_map(|path| document.given(&path));
    let full = format!("{prefix}{key}");
    let by = match &given {
        Some((_, given, _)) if *given != full => format!(", by {given}"),
        _ => String::new(),
    };
    let [value, minimum, maximum] =
        [value, minimum, maximum].map(|number| in_f32_digits(number.into()));
    let problem = Problem::NotAllowed {
        key: format!("{full}{note}"),
        value: value.to_string(),
        allowed: format!("from {minimum} to {maximum}{by}"),
    };
    let line = given.and_then(|(line, ..)| line);
    InputError { file: document.muscles[0].origin.clone(), line, problem: Box::new(problem) }
}

/// The columns of a profile: angle \[rad\], between the joint's stops, and stiffness \[N m/rad\].
///
/// # Errors
/// For a missing column, and a value that is not allowed.
pub fn angle_and_stiffness(table: &Table, joint: &Joint) -> Result<[Profile; 2], InputError> {
    let between_stops = Limits { min: joint.minimum_rad, max: joint.maximum_rad, unit: "rad" };
    let angle = profile_in(table, "angle_rad", (between_stops, ""))?;
    let stiffness = Limits { min: 0.0, max: 1.0e6, unit: "N m/rad" };
    Ok([angle, profile_in(table, "stiffness_n_m_rad", (stiffness, ""))?])
}

fn table_of(document: &JointDocument, key: &str, path: &Path) -> Result<Table, InputError> {
    read_table(&beside(document, path))
        .map_err(|file| document.blame(key, Problem::Reference { key: key.to_owned(), file }))
}

/// Radii over the angle, between the joint's stops.
fn rows(document: &JointDocument) -> Result<Option<Rows>, InputError> {
    let Some(path) = &document.joint.radius_csv else { return Ok(None) };
    let key = "joint.radius_csv";
    let table = table_of(document, key, path)?;
    let found = radii::rows(&table, &document.joint).map_err(|file| match file.line {
        Some(_) => file,
        // If the file as a whole is wrong, the path may be the mistake.
        None => document.blame(key, Problem::Reference { key: key.to_owned(), file }),
    });
    found.map(Some)
}

type Profiles = (Option<[Profile; 2]>, Option<Profile>);

fn profiles(document: &JointDocument) -> Result<Profiles, InputError> {
    let read = |key, path| table_of(document, key, path);
    let (is, believed) = (&document.joint, &document.believed);
    let crossed = [is, believed].iter().any(|joint| joint.minimum_rad >= joint.maximum_rad);
    let profile = match &document.drive.profile_csv {
        // The stops are refused later, not the angles between them.
        Some(path) if !crossed => {
            // Between the stops of both mechanisms.
            let joint = Joint {
                minimum_rad: is.minimum_rad.max(believed.minimum_rad),
                maximum_rad: is.maximum_rad.min(believed.maximum_rad),
                ..is.clone()
            };
            Some(angle_and_stiffness(&read("drive.profile_csv", path)?, &joint)?)
        }
        _ => None,
    };
    let load = match &document.drive.load_csv {
        Some(path) => {
            let table = read("drive.load_csv", path)?;
            let torque = Limits { min: -1.0e6, max: 1.0e6, unit: "N m" };
            Some(profile_in(&table, "torque_n_m", (torque, ""))?)
        }
        None => None,
    };
    Ok((profile, load))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;
    use thermyo_compute::math;
    use thermyo_scenario::joint::Setting;

    fn refusal(text: &str) -> String {
        parse(text, "joint.toml".as_ref()).unwrap_err().to_string()
    }

    #[test]
    fn what_no_joint_can_be_is_refused_at_its_line() {
        let radius = refusal("[joint]\nradius_m = 0.2\n");
        assert!(
            radius.contains("joint.mid_length_a_m (less the pulley's way to the stop)"),
            "{radius}"
        );
        let length = refusal("[joint]\nmid_length_a_m = 0.1\n");
        assert!(length.ends_with(" = 0.116: must be from 0.1884632 to 0.3"), "{length}");
        let middle = refusal("[joint]\nradius_m = 0.02\nmid_length_b_m = 0.32\n");
        assert!(middle.starts_with("joint.toml:3: joint.mid_length_b_m"), "{middle}");
        let drive = refusal("[joint]\n[drive]\nkind = \"joint\"\nangle_rad = 0.9\n");
        assert!(drive.starts_with("joint.toml:4: drive.angle_rad = 0.9"), "{drive}");
        let shape = "[joint]\n[drive]\nshape = \"sine\"\nangle_rad = 0.5\namplitude_rad = 0.4\n";
        assert!(refusal(shape).starts_with("joint.toml:5: drive.amplitude_rad = 0.4"));
        let vessel = refusal("[joint]\n[joint.b.plant]\nkind = \"vessel\"\n");
        assert!(vessel.starts_with("joint.toml:3: plant.kind"), "{vessel}");
        let encoder = "[joint]\nsensor_kind = \"as5600\"\nsensor_minimum_rad = ";
        let inside = refusal(&format!("{encoder}\"10 deg\"\n"));
        assert!(
            inside.starts_with("joint.toml:3: joint.sensor_minimum_rad (where an AS5600's turn"),
            "{inside}"
        );
        let wide = refusal(&format!("{encoder}-3.3\nminimum_rad = -3.2\nmaximum_rad = 3.2\n"));
        assert!(wide.starts_with("joint.toml:5: joint.maximum_rad (an AS5600 reads"), "{wide}");
        assert!(refusal("[joint]\nsensor_kind = \"as5601\"\n").starts_with(
            "joint.toml:2: joint.sensor_kind = \"as5601\": must be one of \"potentiometer\", "
        ));
        let other = refusal("[joint]\n[believed.joint]\nsensor_kind = \"as5600\"\n");
        assert!(other.starts_with("joint.toml:3: believed.joint.sensor_kind = "), "{other}");
        let reach =
            refusal("[joint]\nmid_length_a_m = 0.1\n[joint.a.muscle]\nrest_length_m = 0.1\n");
        assert!(reach.starts_with("joint.toml:2: joint.mid_length_a_m (less"), "{reach}");
        for (shape, least) in [("chirp", "0.064"), ("staircase", "0.08")] {
            let step_s = if shape == "chirp" { "0.001" } else { "0.01" };
            let text = format!(
                "[run]\nstep_s = {step_s}\n[joint]\n[drive]\nshape = \"{shape}\"\namplitude_rad = 0.1\n\
                 period_s = 0.05\n"
            );
            let start = format!("joint.toml:7: drive.period_s = 0.05: must be {least} s or more: ");
            assert!(refusal(&text).starts_with(&start), "{}", refusal(&text));
        }
        let profile = refusal("[joint]\n[drive]\nprofile_csv = \"no.csv\"\n");
        assert!(profile.starts_with("joint.toml:3: drive.profile_csv: no.csv"), "{profile}");
        let stops = refusal("[joint]\nminimum_rad = 0.9\n[drive]\nprofile_csv = \"no.csv\"\n");
        assert!(stops.starts_with("joint.toml:2: joint.m"), "{stops}");
    }

    #[test]
    fn what_is_refused_is_named_as_in_the_file() {
        let bearing = "[joint]\nmid_length_a_m = 0.27\nradius_m = 0.02\n[believed.joint]\n";
        for (text, start) in [
            (
                format!("{bearing}mid_length_a_m = 0.1\n"),
                "joint.toml:5: believed.joint.mid_length_a_m (less the pulley's way to the stop) = ",
            ),
            (
                format!("{bearing}\nradius_m = 0.2\n"),
                "joint.toml:6: believed.joint.mid_length_a_m (less the pulley's way to the stop) = ",
            ),
            (
                "[joint]\n[joint.a.valve]\npwm_hz = 50\n".to_owned(),
                "joint.toml:3: joint.a.valve.pwm_hz = 50.0 Hz: must be 100.0 Hz, as of muscle b: one loop drives \
                 both; or set valve.pwm_hz for both",
            ),
            (
                "[joint]\n[joint.b.believed.valve]\npwm_hz = 50\n".to_owned(),
                "joint.toml:3: joint.b.believed.valve.pwm_hz = 50.0 Hz: must be 100.0 Hz, as of muscle a: ",
            ),
            (
                "[joint]\n[joint.a.valve]\nkind = \"proportional\"\n".to_owned(),
                "joint.toml:3: joint.a.valve.kind = \"proportional\": must be \"switching\", as of muscle b: ",
            ),
            (
                "[joint]\n[believed.joint]\nmaximum_rad = 0.5\n[drive]\nangle_rad = 0.6\n"
                    .to_owned(),
                "joint.toml:5: drive.angle_rad = 0.6: must be such that the angle, which reaches 0.6000, stays \
                 between the stops as configured, -0.8 to 0.5 rad",
            ),
            // The message used to name the end of the way as the amplitude.
            (
                "[joint]\n[drive]\nshape = \"sine\"\nangle_rad = 0.1\namplitude_rad = 0.95\n"
                    .to_owned(),
                "joint.toml:5: drive.amplitude_rad = 0.95: must be such that the angle, which reaches 1.0500, stays \
                 between the stops, -0.8 to 0.8 rad",
            ),
        ] {
            let said = refusal(&text);
            assert!(said.starts_with(start), "{said}");
        }
    }

    #[test]
    fn a_profile_is_between_the_stops_of_joint_and_core() {
        let folder = tempfile::tempdir().unwrap();
        let rows = "time_s,angle_rad,stiffness_n_m_rad\n0,0,14\n1,0.6,14\n";
        std::fs::write(folder.path().join("course.csv"), rows).unwrap();
        let text =
            "[joint]\n[believed.joint]\nmaximum_rad = 0.5\n[drive]\nprofile_csv = \"course.csv\"\n";
        let said = parse(text, &folder.path().join("joint.toml")).unwrap_err().to_string();
        assert!(said.contains("course.csv:3: column angle_rad = 0.6: must be "), "{said}");
    }

    /// The length of a held load is the mechanism's, not the key of a single muscle.
    #[test]
    fn a_joint_may_be_smaller_than_the_default_load() {
        let small = parse(
            "[muscle]\nrest_length_m = 0.2\n[joint]\nradius_m = 0.01\nmid_length_a_m = 0.17\nmid_length_b_m = 0.17\n",
            "joint.toml".as_ref(),
        );
        assert_eq!(small.unwrap().muscles[0].plant.load.length_m, 0.17);
    }

    #[test]
    fn the_timing_follows_valves_and_hose_unless_the_file_states_it() {
        let timing = |text: &str| {
            let document = JointDocument::parse(text, "joint.toml".as_ref()).unwrap();
            let controller = joint(&document).unwrap().controller;
            [controller.lead_s, controller.waits_n_m, controller.mass_loop_s]
        };
        let valves = |pwm_hz: u32| timing(&format!("[valve]\npwm_hz = {pwm_hz}\n[joint]\n"));
        assert_eq!(valves(50), [0.0, 0.0, 0.014]);
        assert_eq!(valves(100), [0.0025, 0.2, 0.014]);
        assert_eq!(valves(200), [0.00125, 0.2, 0.005 / 0.7]);
        let gain = |inertia: &str| {
            let text = format!("[joint]\ninertia_kg_m2 = {inertia}\n");
            let document = JointDocument::parse(&text, "joint.toml".as_ref()).unwrap();
            joint(&document).unwrap().controller.gain_n_m_rad
        };
        assert_eq!([gain("0.001"), gain("0.02"), gain("0.2")], [1.2, 12.0, 12.0]);
        let hose = "[plant]\nmodel = \"full\"\n[tube]\nlength_m = 1\ndiameter_m = 0.004\n[joint]\n";
        let lead_s = |text: &str| timing(text)[0];
        assert_eq!(lead_s(hose), 0.0054);
        let longer = format!("{hose}[joint.b.tube]\nlength_m = 2\n");
        assert!((lead_s(&longer) - 0.0083).abs() < 1e-9);
        let stated = "[joint.controller]\nlead_s = 0.001\nwaits_n_m = 0.1\nmass_loop_s = 0.02\n";
        assert_eq!(timing(&format!("{hose}{stated}")), [0.001, 0.1, 0.02]);
        let mut document = JointDocument::parse(hose, "joint.toml".as_ref()).unwrap();
        document.set("joint.controller.lead_s", Setting::Number(0.002)).unwrap();
        assert_eq!(joint(&document).unwrap().controller.lead_s, 0.002);
    }

    /// Limits of the default joint: 4 rad/s, and 2.5 N m for 0.02 kg m2.
    const LIMITS: [f64; 2] = [4.0, 125.0];

    /// A sine of 20 deg at 1 Hz, in rows that are 10 to 50 ms apart, or rounded to the angle of an encoder's code: rows
    /// of 20 ms used to give twice the acceleration in every other sample, and none between them.
    #[test]
    fn a_table_of_a_motion_is_that_motion() {
        let (w, size) = (TAU, 0.349);
        for (apart_s, code_rad, most) in
            [(0.01, 0.0, 0.02), (0.02, 0.0, 0.02), (0.05, 0.0, 0.06), (0.01, 1.5e-3, 0.5)]
        {
            let rounded =
                |x: f64| if code_rad > 0.0 { (x / code_rad).round() * code_rad } else { x };
            let row = |i: i32| {
                let time_s = apart_s * f64::from(i);
                (time_s, rounded(size * math::sin(w * time_s)))
            };
            let table = Profile::new((0..300).map(row).collect()).unwrap();
            for i in 20..100 {
                let time_s = 0.007 * f64::from(i);
                let found = course(&table, 14.0, LIMITS, time_s);
                let speed = size * w * math::cos(w * time_s) - f64::from(found.speed_rad_s);
                let acceleration =
                    -size * w * w * math::sin(w * time_s) - f64::from(found.acceleration_rad_s2);
                assert!(speed.abs() < most * size * w, "{apart_s} s, {speed} rad/s at {time_s} s");
                assert!(
                    acceleration.abs() < most * size * w * w,
                    "{apart_s} s, {acceleration} rad/s2"
                );
            }
        }
    }

    #[test]
    fn a_jump_of_a_profile_is_a_step() {
        let jump = Profile::new(vec![(0.0, 0.0), (1.0, 0.0), (1.001, 0.5), (2.0, 0.5)]).unwrap();
        assert_eq!(course(&jump, 14.0, LIMITS, 0.995), Motion::still(0.0, 14.0));
        assert_eq!(course(&jump, 14.0, LIMITS, 1.002), Motion::still(0.5, 14.0));
        let ramp = Profile::new(vec![(0.0, 0.0), (1.0, 0.5)]).unwrap();
        assert!((course(&ramp, 14.0, LIMITS, 0.5).speed_rad_s - 0.5).abs() < 1e-6);
    }
}
