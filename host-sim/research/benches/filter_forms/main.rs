//! The estimator's covariance in the shipped form and in the common ones, on the same samples:
//! accuracy, rounding after 10^8 steps of f32, cost. `docs/background/estimator-trials.md`
//! discusses the table.
//!
//!     cargo bench -p research --bench filter_forms                  # the tables
//!     cargo bench -p research --bench filter_forms -- --plots       # and the plots of docs/background/estimator-trials.md

#[path = "../../../../model-core/src/estimation/covariance.rs"]
// As in the core: `!(x <= y)` catches a NaN.
#[allow(clippy::neg_cmp_op_on_partial_ord)]
mod covariance;
mod forms;
mod plots;
mod record;

use forms::{Counted, Dense, Form, Interval, Joseph, N, Named, Steady, Ud};
use model_core::{Config, math};
use nalgebra::Matrix5;
use record::Recording;
use thermyo_evaluate::estimator;
use thermyo_scenario::PlantModel;
use thermyo_setup::Loaded;

/// Start of the errors' evaluation \[s\].
const SETTLED_S: f64 = 10.0;
/// To the end of every run.
const END_S: f64 = f64::INFINITY;
/// Intervals in 10^8 steps.
const INTERVALS: usize = 5_000_000;
/// Intervals in one working cycle of 5 s.
const CYCLE: usize = 250;

fn main() {
    let nominal = thermyo_evaluate::nominal().expect("it is part of the program");
    let [lumped, full] =
        [PlantModel::Lumped, PlantModel::Full].map(|model| nominal.with_model(model));
    let recordings = [&lumped, &full].map(Recording::new);
    recordings.iter().for_each(check);
    let first = &recordings[0];
    let steady = steady(first);
    forms_table(&recordings, steady);
    println!();
    steady_table([&lumped, &full], steady);
    if std::env::args().any(|argument| argument == "--plots") {
        let mut believed_low = lumped.clone();
        believed_low.believed.heat.scale *= 0.7;
        let low = Recording::new(&believed_low);
        let errors = [errors_k(&low, &mut Named(low.first)), errors_k(&low, &mut steady.clone())];
        plots::write(&full, &recordings[1], &errors).expect("docs/ can be written to");
    }
}

/// Every form on the nominal cycle, and after 10^8 steps of it.
fn forms_table(recordings: &[Recording; 2], steady: Steady) {
    let first = &recordings[0];
    let start = Named(first.first).covariance();
    let cycle = &first.intervals[first.intervals.len() - 1 - CYCLE..][..CYCLE];
    let edge: Vec<Interval> = cycle.iter().map(at_the_edge).collect();
    let references = [Reference::new(&start, cycle), Reference::new(&start, &edge)];
    println!(
        "| form | operations | lumped, K | full, K | asymmetry | least eigenvalue | sd off f64 | \
         edge: asymmetry | least eigenvalue | sd off f64 |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|");
    let row = |name: &str, operations: u32, form: &dyn Fn(&Recording) -> Box<dyn Form>| {
        print!("| {name} | {operations} |");
        for recording in recordings {
            print!(" {:.4} |", rms_k(recording, (SETTLED_S, END_S), form(recording).as_mut()));
        }
        for reference in &references {
            if operations > 0 {
                let Wear { asymmetry, eigenvalue, deviation } =
                    reference.wear(form(first).as_mut());
                print!(" {asymmetry:.0e} | {eigenvalue:.1e} | {deviation:.0e} |");
            } else {
                print!(" - | - | - |");
            }
        }
        println!();
    };
    let interval = &first.intervals[1000];
    let counted = |form: &mut dyn Form| {
        Counted::operations(|| {
            step(form, interval);
        })
    };
    let at = |recording: &Recording| Named(recording.first).covariance();
    row("named entries, f32 (shipped)", Named::OPERATIONS, &|r| Box::new(Named(r.first)));
    row("dense, f32", counted(&mut Dense::<Counted>::new(&start)), &|r| {
        Box::new(Dense::<f32>::new(&at(r)))
    });
    row("Joseph, f32", counted(&mut Joseph(Dense::<Counted>::new(&start))), &|r| {
        Box::new(Joseph(Dense::<f32>::new(&at(r))))
    });
    row("UD, f32", counted(&mut Ud::<Counted>::new(&start)), &|r| Box::new(Ud::<f32>::new(&at(r))));
    row("steady gains", 0, &|_| Box::new(steady));
}

/// The shipped form and steady gains on every case of `thermyo evaluate estimator`.
fn steady_table(plants: [&Loaded; 2], steady: Steady) {
    println!("| case | lumped: shipped, K | steady, K | full: shipped, K | steady, K |");
    println!("|---|---|---|---|---|");
    let row = |name: &str, times: (f64, f64), change: fn(&mut Loaded)| {
        print!("| {name} |");
        for plant in plants {
            let mut loaded = plant.clone();
            change(&mut loaded);
            let recording = Recording::new(&loaded);
            for form in [&mut Named(recording.first) as &mut dyn Form, &mut steady.clone()] {
                print!(" {:.3} |", rms_k(&recording, times, form));
            }
        }
        println!();
    };
    for case in estimator::cases() {
        row(case.name, (case.from_s, END_S), case.change);
    }
    let wrong: fn(&mut Loaded) = |loaded| loaded.plant.plant.initial_temperature_k += 10.0;
    row("started 10 K wrong, the first 10 s", (0.0, SETTLED_S), wrong);
}

/// The extreme tuning that [`model_core::Config`] allows: no bias, no drift, next to no forgetting.
/// The covariance shrinks by orders of magnitude, where rounding is most harmful.
fn at_the_edge(interval: &Interval) -> Interval {
    const MEMORY_S: f32 = 1.0e6;
    const READING_K2: f32 = 0.05 * 0.05 / (8.0 * 20.0);
    let config = Config::default();
    let (mut matrix, mut drift) = (interval.matrix, interval.drift);
    let forget = 20.0 * config.step_s / MEMORY_S;
    let slower = MEMORY_S / config.estimator.memory_s;
    matrix[3][3] = 1.0 - forget;
    matrix[4][4] = 1.0 - forget;
    drift[0] = 0.0;
    drift[1] = 0.0;
    drift[3] /= slower;
    drift[4] /= slower;
    Interval { matrix, drift, keep: 1.0 - forget, reading_k2: READING_K2, ..*interval }
}

/// Errors of the estimator with the gains of another form, step by step \[K\].
fn errors_k(recording: &Recording, form: &mut dyn Form) -> Vec<f64> {
    let mut core = Named(recording.first);
    recording.errors_k(|interval| step(&mut core, interval), |interval| step(form, interval))
}

/// RMS of the errors over a part of the run \[s\].
fn rms_k(recording: &Recording, (from_s, to_s): (f64, f64), form: &mut dyn Form) -> f64 {
    let errors_k = errors_k(recording, form);
    let [from, to] = [from_s, to_s].map(|s| ((s * 1000.0) as usize).min(errors_k.len()));
    let part = &errors_k[from..to];
    (part.iter().map(|error_k| error_k * error_k).sum::<f64>() / part.len() as f64).sqrt()
}

/// Runs a form for one interval; returns the gain.
fn step(form: &mut dyn Form, interval: &Interval) -> [f64; N] {
    form.predict(interval);
    form.update(interval)
}

/// The shipped form must match the core bit by bit here, or the table would compare something else.
fn check(recording: &Recording) {
    let mut named = Named(recording.first);
    let (_, done) = recording.intervals.split_last().expect("the run has intervals");
    for interval in done {
        named.predict(interval);
        if interval.innovation_k.is_some() {
            named.update(interval);
        }
    }
    assert_eq!(named.0, recording.last, "the covariance driven here is not the core's");
}

/// Gains of the shipped form, averaged over the last cycle: while filled, and while not.
fn steady(recording: &Recording) -> Steady {
    let mut named = Named(recording.first);
    let count = recording.intervals.len();
    let (mut gains, mut counts) = ([[0.0; N]; 2], [0.0; 2]);
    for (i, interval) in recording.intervals.iter().enumerate() {
        let gain = step(&mut named, interval);
        if i + CYCLE >= count {
            let phase = usize::from(interval.charging);
            counts[phase] += 1.0;
            for (sum, gain) in gains[phase].iter_mut().zip(gain) {
                *sum += gain;
            }
        }
    }
    for (gains, count) in gains.iter_mut().zip(counts) {
        gains.iter_mut().for_each(|gain| *gain /= count);
    }
    Steady(gains)
}

/// Rounding errors of a covariance after 10^8 steps.
#[derive(Debug, Clone, Copy)]
struct Wear {
    /// Largest difference of two entries that should be equal, as a correlation \[-\].
    asymmetry: f64,
    /// Least eigenvalue as a correlation matrix \[-\].
    eigenvalue: f64,
    /// Largest relative difference of a standard deviation from the reference's \[-\].
    deviation: f64,
}

/// A repeated working cycle, and its covariances in f64.
struct Reference<'a> {
    cycle: &'a [Interval],
    /// Covariances in the last cycle, interval by interval.
    covariances: Vec<Matrix5<f64>>,
}

impl<'a> Reference<'a> {
    fn new(start: &Matrix5<f64>, cycle: &'a [Interval]) -> Self {
        let mut form = Ud::<f64>::new(start);
        let mut covariances = Vec::new();
        drive(&mut form, cycle, |covariance| covariances.push(covariance));
        Self { cycle, covariances }
    }

    fn wear(&self, form: &mut dyn Form) -> Wear {
        let mut wear = Wear { asymmetry: 0.0, eigenvalue: f64::INFINITY, deviation: 0.0 };
        let mut references = self.covariances.iter();
        drive(form, self.cycle, |covariance| {
            let reference = references.next().expect("one per interval of the cycle");
            let scale = |i: usize, j: usize| (reference[(i, i)] * reference[(j, j)]).sqrt();
            let scaled = Matrix5::from_fn(|i, j| covariance[(i, j)] / scale(i, j));
            let symmetric = 0.5 * (scaled + scaled.transpose());
            wear.asymmetry = wear.asymmetry.max((scaled - scaled.transpose()).amax());
            let finite = scaled.iter().all(|entry| entry.is_finite());
            let least =
                if finite { symmetric.symmetric_eigenvalues().min() } else { f64::NEG_INFINITY };
            wear.eigenvalue = wear.eigenvalue.min(least);
            for i in 0..N {
                let deviation = scaled[(i, i)].sqrt() - 1.0;
                // NaN counts as the worst.
                wear.deviation = if deviation.abs() <= wear.deviation {
                    wear.deviation
                } else {
                    deviation.abs()
                };
            }
        });
        wear
    }
}

/// Repeats a cycle for 10^8 steps; `each` is called with the covariance after every interval of the
/// last one.
fn drive(form: &mut dyn Form, cycle: &[Interval], mut each: impl FnMut(Matrix5<f64>)) {
    for (i, interval) in cycle.iter().cycle().take(INTERVALS).enumerate() {
        step(form, interval);
        if i + cycle.len() >= INTERVALS {
            each(form.covariance());
        }
    }
}
