//! Values before and after, with their errors, and the reasons why some are left open.

use super::balance::{Altered, Balance, COUNT, Fitted, Term};
use super::check::{Checked, Figures};
use super::experiment::Record;
use super::{REST_MOTION_RAD, Refusal};
use crate::tune::regression::Measure;
use crate::tune::{Parameter, compared, word};
use serde::Serialize;
use thermyo_fit::assumed::{HYSTERESIS_OFF, PRESSURE_OFF_PA};
use thermyo_joint::JointLoaded;
use thermyo_scenario::joint::Joint;
use thermyo_scenario::key::Allowed;

/// Errors of the configured law for which the stated errors allow: force area of one muscle, elastic force of bladder
/// and creep of both, pressure of one muscle. Assumed, as in `thermyo evaluate joint` with everything wrong.
const LAWS: [Altered; 3] = [
    Altered { area: 1.03, ..Altered::NOT },
    Altered { elastic: HYSTERESIS_OFF, ..Altered::NOT },
    Altered { offset_pa: PRESSURE_OFF_PA, ..Altered::NOT },
];
/// Largest stated error of a value, relative: of inertia, of mid-lengths \[-\].
const INERTIA: f64 = 0.25;
const MID_LENGTH: f64 = 0.02;
/// The same of the other values, as torque over that of the muscles, both RMS \[-\].
const TORQUE: f64 = 0.2;
/// Mid-lengths from which the fit starts, over the configured ones: windows with a slack tendon are left out, and the
/// lengths determine which ones these are \[-\].
const STARTS: [f64; 5] = [1.0, 0.98, 1.02, 0.96, 1.04];
/// Terms of gravity. Together they give the weight and the angle at which it hangs; one alone gives neither.
const GRAVITY: [Term; 2] = [Term::GravitySine, Term::GravityCosine];
/// Number of its errors below which an arm's gravity does not determine where it hangs \[-\].
const HANGS: f64 = 3.0;

/// Values that the records determine.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Estimate {
    pub fitted: Fitted,
    /// Errors, including those of the configured law; none for a held value.
    pub(super) errors: [Option<f64>; COUNT],
    /// Error that a value would have had which is held because the data cannot determine it.
    pub(super) open: [Option<f64>; COUNT],
    /// Whether a value is held at 0 because it came out negative.
    zero: [bool; COUNT],
}

fn configured(loaded: &JointLoaded) -> [f64; COUNT] {
    let joint = &loaded.believed;
    let dry_n_m = joint.friction_n_m + muscles_n_m(loaded);
    [
        joint.inertia_kg_m2,
        joint.viscous_n_m_s + muscles_n_m_s(loaded),
        dry_n_m,
        joint.gravity_n_m * joint.gravity_angle_rad.cos(),
        -joint.gravity_n_m * joint.gravity_angle_rad.sin(),
        joint.mid_length_a_m,
        joint.mid_length_b_m,
        joint.radius_m,
    ]
}

/// Torque of both muscles' own dry friction as configured \[N m\].
fn muscles_n_m(loaded: &JointLoaded) -> f64 {
    let force_n = |i: usize| loaded.muscles[i].believed.friction.force_n;
    loaded.believed.radius_m * (force_n(0) + force_n(1))
}

/// Viscous friction of both muscles as configured \[N m s/rad\].
fn muscles_n_m_s(loaded: &JointLoaded) -> f64 {
    let viscous_n_s_m = |i: usize| loaded.muscles[i].believed.friction.viscous_n_s_m;
    loaded.believed.radius_m.powi(2) * (viscous_n_s_m(0) + viscous_n_s_m(1))
}

/// Largest stated error of each value.
fn largest(fitted: &Fitted) -> [f64; COUNT] {
    let torque = |term: Term| TORQUE * fitted.torque_n_m / fitted.columns[term as usize];
    let share = |term: Term, share: f64| share * fitted.values[term as usize].value.abs();
    Term::ALL.map(|term| match term {
        Term::Inertia => share(term, INERTIA),
        Term::MidA | Term::MidB => share(term, MID_LENGTH),
        // The radius is held.
        Term::Radius => f64::INFINITY,
        Term::Viscous | Term::Dry | Term::GravitySine | Term::GravityCosine => torque(term),
    })
}

/// Fits all values except the radius, and leaves open those whose errors are too large, the worst first.
pub(super) fn estimate(
    loaded: &JointLoaded,
    sliding_rad_s: f64,
    records: &[Record],
) -> Result<Estimate, Refusal> {
    let config = loaded.config();
    let balance = Balance::new(records, sliding_rad_s, &config);
    let configured = configured(loaded);
    let (mut held, mut open) = ([None; COUNT], [None; COUNT]);
    let mut zero = [false; COUNT];
    let radius = Term::Radius as usize;
    held[radius] = Some(configured[radius]);
    let mut start_m = start(&balance, &held, &configured);
    loop {
        let Some(fitted) = balance.fit(&held, Altered::NOT, start_m) else {
            return Err(Refusal::TooFew { windows: balance.windows() });
        };
        let value = |i: usize| fitted.values[i].value;
        start_m = [Term::MidA, Term::MidB].map(|term| value(term as usize));
        let negative = [Term::Viscous, Term::Dry].map(|term| term as usize);
        if let Some(i) = negative.into_iter().find(|i| value(*i) < 0.0) {
            (held[i], zero[i]) = (Some(0.0), true);
            continue;
        }
        let mut variance = fitted.values.map(|value| value.error * value.error);
        for law in LAWS {
            let other = balance.fit(&held, law, start_m);
            for i in (0..COUNT).filter(|i| held[*i].is_none()) {
                let off =
                    other.as_ref().map_or(f64::INFINITY, |one| one.values[i].value - value(i));
                variance[i] += off * off;
            }
        }
        let largest = largest(&fitted);
        let excess = |i: &usize| variance[*i].sqrt() / largest[*i];
        let free = (0..COUNT).filter(|i| held[*i].is_none());
        let worst = free.max_by(|i, j| excess(i).total_cmp(&excess(j)));
        match worst.filter(|i| excess(i) > 1.0) {
            Some(i) => (held[i], open[i]) = (Some(configured[i]), Some(variance[i].sqrt())),
            None => {
                let errors = std::array::from_fn(|i| held[i].is_none().then(|| variance[i].sqrt()));
                return Ok(Estimate { fitted, errors, open, zero });
            }
        }
    }
}

/// Mid-lengths of the fit with the smallest residual torque, over all [`STARTS`] \[m\].
fn start(
    balance: &Balance<'_>,
    held: &[Option<f64>; COUNT],
    configured: &[f64; COUNT],
) -> [f64; 2] {
    let mids_m = [Term::MidA, Term::MidB].map(|term| configured[term as usize]);
    let fits = STARTS
        .iter()
        .filter_map(|share| balance.fit(held, Altered::NOT, mids_m.map(|mid_m| share * mid_m)));
    let left = |fitted: &Fitted| fitted.rms_n_m / fitted.torque_n_m;
    let best = fits.min_by(|one, other| left(one).total_cmp(&left(other)));
    best.map_or(mids_m, |best| {
        [Term::MidA, Term::MidB].map(|term| best.values[term as usize].value)
    })
}

impl Estimate {
    fn value(&self, term: Term) -> f64 {
        self.fitted.values[term as usize].value
    }

    fn measure(&self, term: Term) -> Option<Measure> {
        let error = self.errors[term as usize]?;
        Some(Measure { value: self.value(term), error })
    }

    /// Largest torque of gravity, and the angle at which the arm hangs.
    fn gravity(&self) -> (Measure, Option<Measure>) {
        let (sine, cosine) = (self.value(Term::GravitySine), self.value(Term::GravityCosine));
        let of = |term: Term| self.errors[term as usize].unwrap_or(0.0);
        let (by_sine, by_cosine) = (of(Term::GravitySine), of(Term::GravityCosine));
        let size = sine.hypot(cosine);
        let error = (sine * by_sine).hypot(cosine * by_cosine) / size.max(f64::MIN_POSITIVE);
        let across = (cosine * by_sine).hypot(sine * by_cosine) / size.max(f64::MIN_POSITIVE);
        let angle = Measure { value: (-cosine).atan2(sine), error: across / size };
        (Measure { value: size, error }, (size > HANGS * error.max(across)).then_some(angle))
    }

    /// Every value, in the order of the table.
    pub fn parameters(&self, loaded: &JointLoaded) -> Vec<Parameter> {
        let joint = &loaded.believed;
        let mut all = vec![self.single(
            Term::Inertia,
            "joint.inertia_kg_m2",
            joint.inertia_kg_m2,
            "fast motion",
        )];
        all.extend(self.of_gravity(loaded));
        all.push(self.of_viscous(loaded));
        all.extend(self.of_friction(loaded));
        let middle = "pressures at equal torque, soft and stiff";
        for (term, path, before) in [
            (Term::MidA, "joint.mid_length_a_m", joint.mid_length_a_m),
            (Term::MidB, "joint.mid_length_b_m", joint.mid_length_b_m),
        ] {
            all.push(self.single(term, path, before, middle));
        }
        let (path, radius_m) = ("joint.radius_m", joint.radius_m);
        let remark = "kept: torques do not tell it, measure the pulley".to_owned();
        all.push(parameter(path, radius_m, radius_m, None, remark));
        all
    }

    fn single(&self, term: Term, path: &'static str, before: f64, from: &str) -> Parameter {
        let i = term as usize;
        let Some(found) = self.measure(term) else {
            let remark = match self.open[i] {
                Some(error) if error.is_finite() => {
                    format!("{OPEN}: its error would be {error:.2e}")
                }
                Some(_) => format!("{OPEN}: the data does not determine it"),
                None => "none was seen".to_owned(),
            };
            let after = if self.zero[i] { 0.0 } else { before };
            return parameter(path, before, after, None, remark);
        };
        parameter(path, before, found.value, Some(found.error), from.to_owned())
    }

    fn of_gravity(&self, loaded: &JointLoaded) -> [Parameter; 2] {
        let joint = &loaded.believed;
        let [weight, angle] = ["joint.gravity_n_m", "joint.gravity_angle_rad"];
        let (before, hangs_at) = (joint.gravity_n_m, joint.gravity_angle_rad);
        if GRAVITY.iter().any(|term| self.is_open(*term)) {
            let remark =
                || format!("{OPEN}: too little motion, or too little of the torque, to tell it");
            return [
                parameter(weight, before, before, None, remark()),
                parameter(angle, hangs_at, hangs_at, None, remark()),
            ];
        }
        let (size, at) = self.gravity();
        let from = "slow motion".to_owned();
        [
            parameter(weight, before, size.value, Some(size.error), from.clone()),
            match at {
                Some(at) => parameter(angle, hangs_at, at.value, Some(at.error), from),
                None => {
                    // The torque is within the errors of the weight, wherever the arm hangs.
                    let remark = "kept: too little gravity for it to matter".to_owned();
                    parameter(angle, hangs_at, hangs_at, None, remark)
                }
            },
        ]
    }

    /// The bearing has the part that the configured muscles do not; if there is less than theirs, the muscles have
    /// less.
    fn of_viscous(&self, loaded: &JointLoaded) -> Parameter {
        let path = "joint.viscous_n_m_s";
        let before = loaded.believed.viscous_n_m_s;
        let Some(Measure { value, error }) = self.measure(Term::Viscous) else {
            return self.single(Term::Viscous, path, before, "");
        };
        let muscles = muscles_n_m_s(loaded);
        let from =
            format!("viscous friction of {value:.3} N m s/rad, {muscles:.3} of it the muscles'");
        parameter(path, before, (value - muscles).max(0.0), Some(error), from)
    }

    fn of_friction(&self, loaded: &JointLoaded) -> Vec<Parameter> {
        let path = "joint.friction_n_m";
        let before = loaded.believed.friction_n_m;
        if self.is_open(Term::Dry) {
            return vec![self.single(Term::Dry, path, before, "")];
        }
        let dry = self.measure(Term::Dry);
        let Measure { value, error } = dry.unwrap_or(Measure { value: 0.0, error: 0.0 });
        let muscles = muscles_n_m(loaded);
        let bearing = (value - muscles).max(0.0);
        let error = dry.map(|_| error);
        let from = format!("dry friction of {value:.3} N m, {muscles:.3} of it the muscles'");
        let mut all = vec![parameter(path, before, bearing, error, from)];
        if value < muscles {
            let before = loaded.muscles[0].believed.friction.force_n;
            let share = value / muscles;
            let from = format!("of both muscles, {share:.2} of what was configured");
            let error = error.map(|error| before * error / muscles);
            all.push(parameter(FRICTION, before, share * before, error, from));
        }
        all
    }

    fn is_open(&self, term: Term) -> bool {
        self.open[term as usize].is_some()
    }

    /// Keys that are left open, in the order of the table.
    pub fn open(&self) -> Vec<&'static str> {
        let keys: [(&[Term], &str); 7] = [
            (&[Term::Inertia], "joint.inertia_kg_m2"),
            (&GRAVITY, "joint.gravity_n_m"),
            (&GRAVITY, "joint.gravity_angle_rad"),
            (&[Term::Viscous], "joint.viscous_n_m_s"),
            (&[Term::Dry], "joint.friction_n_m"),
            (&[Term::MidA], "joint.mid_length_a_m"),
            (&[Term::MidB], "joint.mid_length_b_m"),
        ];
        let open = |terms: &[Term]| terms.iter().any(|term| self.is_open(*term));
        keys.into_iter().filter(|(terms, _)| open(terms)).map(|(_, key)| key).collect()
    }
}

/// Beginning of the remark of a value that is left open.
const OPEN: &str = "open";
/// Key of the muscles' friction, in the scenario of either.
pub(super) const FRICTION: &str = "friction.force_n";

fn parameter(
    path: &'static str,
    before: f64,
    after: f64,
    standard_error: Option<f64>,
    remark: String,
) -> Parameter {
    Parameter { path, before, after, standard_error, unit: unit(path), remark }
}

/// Unit and range of a key.
pub(super) fn limits(path: &str) -> thermyo_scenario::schema::Limits {
    let name = path.strip_prefix("joint.");
    let key = Joint::TABLE.keys.iter().find(|key| Some(key.name) == name);
    match key.map(|key| key.allowed) {
        Some(Allowed::Real(limits)) => limits,
        _ => thermyo_scenario::schema::limits(path),
    }
}

fn unit(path: &str) -> &'static str {
    limits(path).unit
}

/// Tracking with the values before and after.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Check {
    pub before: Figures,
    pub after: Figures,
}

#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Values {
    pub duration_s: f64,
    pub highest_pa: f64,
    pub parameters: Vec<Parameter>,
    /// Keys that the data cannot determine, and that keep their values.
    pub open: Vec<&'static str>,
    /// RMS torque of the muscles, and RMS residual of the balance \[N m\].
    pub torque_rms_n_m: f64,
    pub residual_rms_n_m: f64,
}

impl Values {
    pub(super) fn new(loaded: &JointLoaded, estimate: &Estimate, records: &[Record]) -> Self {
        Self {
            duration_s: records.last().map_or(0.0, |record| record.time_s),
            highest_pa: records.iter().flat_map(|one| one.pressure_pa).fold(0.0, f64::max),
            parameters: estimate.parameters(loaded),
            open: estimate.open(),
            torque_rms_n_m: estimate.fitted.torque_n_m,
            residual_rms_n_m: estimate.fitted.rms_n_m,
        }
    }

    pub fn value(&self, path: &str) -> Option<&Parameter> {
        self.parameters.iter().find(|parameter| parameter.path == path)
    }

    pub fn table(&self) -> String {
        crate::tune::table(&self.parameters)
    }

    /// The message for values that are left open.
    pub fn failed(&self) -> Option<String> {
        let keys = self.open.join(", ");
        (!self.open.is_empty()).then(|| {
            format!("the data cannot tell {keys}: measured by other means, or left as configured")
        })
    }
}

/// Values of an experiment, and their check.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Findings {
    #[serde(flatten)]
    pub values: Values,
    pub check: Check,
    /// Whether the error of the sine has fallen by at least a tenth.
    pub improved: bool,
    /// Whether the error of the sine has not grown by more than a tenth, and the joint rests: the board then keeps the
    /// tuned values.
    pub adopted: bool,
}

impl Findings {
    pub(super) fn new(values: Values, [before, after]: [&Checked; 2]) -> Self {
        let (before, after) = (before.figures, after.figures);
        let (improved, followed) = compared(before.sine_rms_rad, after.sine_rms_rad);
        let calm = after.rest_motion_rad <= REST_MOTION_RAD.max(before.rest_motion_rad);
        Self { values, check: Check { before, after }, improved, adopted: calm && followed }
    }

    pub fn headline(&self) -> String {
        let Check { before, after } = self.check;
        let (_, followed) = compared(before.sine_rms_rad, after.sine_rms_rad);
        let kept = if self.adopted {
            String::new()
        } else if followed {
            let moves_deg = after.rest_motion_rad.to_degrees();
            format!(", and at rest it moves by {moves_deg:.2} deg: the former values are kept")
        } else {
            ": the former values are kept".to_owned()
        };
        let [before, after] = [before, after].map(|figures| figures.sine_rms_rad.to_degrees());
        let word = word(self.improved, followed);
        format!(
            "with the tuned values a sine of 1 Hz is followed {word} ({before:.2} -> {after:.2} deg, RMS){kept}"
        )
    }

    pub fn text(&self) -> String {
        let Check { before, after } = self.check;
        let figures = |f: &Figures| {
            format!(
                "sine {:.2} deg RMS, at rest {:.2} deg, moving by {:.2} deg",
                f.sine_rms_rad.to_degrees(),
                f.rest_error_rad.abs().to_degrees(),
                f.rest_motion_rad.to_degrees()
            )
        };
        let (before, after) = (figures(&before), figures(&after));
        let verdict = format!("{}\n  before: {before}\n  after:  {after}\n", self.headline());
        verdict + &self.values.table()
    }
}
