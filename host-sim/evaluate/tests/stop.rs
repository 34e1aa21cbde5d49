//! Partial results of long work that is stopped.

use std::io;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use thermyo_compute::parallel::Watch;
use thermyo_evaluate::estimator;
use thermyo_identify::{IdentifyError, identify};
use thermyo_record::measured::{Column, Measured};
use thermyo_record::trace::Row;
use thermyo_simulation::board::CoreBoard;
use thermyo_simulation::run;
use thermyo_simulation::run::RunError;

/// Stops after this number of parts.
struct After {
    parts: usize,
    done: AtomicUsize,
}

impl After {
    fn new(parts: usize) -> Self {
        Self { parts, done: AtomicUsize::new(0) }
    }
}

impl Watch for After {
    fn done(&self) {
        self.done.fetch_add(1, Ordering::Relaxed);
    }

    fn stopped(&self) -> bool {
        self.done.load(Ordering::Relaxed) >= self.parts
    }
}

/// Steps after which a simulation is stopped.
const STEPS: usize = 10_000;

/// Stops after this number of questions.
#[derive(Default)]
struct AtQuestion(AtomicUsize);

impl Watch for AtQuestion {
    fn stopped(&self) -> bool {
        self.0.fetch_add(1, Ordering::Relaxed) + 1 >= STEPS
    }
}

#[test]
fn a_stopped_evaluation_returns_the_lines_of_the_finished_cases() {
    let lines = estimator::random(1, 30, &After::new(3)).unwrap();
    let [muscles @ .., known, all] = &lines[..] else { panic!("{lines:?}") };
    assert!((3..30).contains(&muscles.len()), "{lines:?}");
    assert_eq!(known.case, format!("{} muscles of seed 1, known", muscles.len()));
    assert_eq!(all.case, "all of seed 1");
    assert_eq!(thermyo_evaluate::missed(muscles).1, 2 * muscles.len());
}

#[test]
fn an_observer_stops_a_run() {
    let loaded =
        thermyo_setup::parse("[plant]\nmodel = \"lumped\"\n", Path::new("a.toml")).unwrap();
    let mut rows = 0;
    let mut third = |_: &Row| {
        rows += 1;
        if rows == 3 { Err(io::ErrorKind::Interrupted.into()) } else { Ok(()) }
    };
    let ended = run::run(&loaded, &mut CoreBoard::default(), None, &mut third);
    assert!(matches!(ended, Err(RunError::Stopped)), "{ended:?}");
    assert_eq!(rows, 3);
}

#[test]
fn a_stopped_identification_returns_its_finished_searches() {
    let text = "[run]\nduration_s = 3.0\n[plant]\nmodel = \"lumped\"\n[identify]\nstarts = 40\n\
                parameters = [\"heat.scale\", \"friction.force_n\"]\n";
    let name = Path::new("scenario.toml");
    let loaded = thermyo_setup::parse(text, name).unwrap();
    let names = ["flow_in_kg_s", "flow_out_kg_s", "pressure_pa"];
    let mut columns =
        names.map(|name| Column { name: name.to_owned(), points: Vec::new(), lines: Vec::new() });
    run::on_core(&loaded, |row| {
        let truth = &row.truth;
        let values = [truth.flow_in_kg_s, truth.flow_out_kg_s, truth.pressure_pa];
        columns.iter_mut().zip(values).for_each(|(c, v)| c.points.push((truth.time_s, v)));
    })
    .unwrap();

    let measured = Measured { columns: columns.to_vec() };
    let ended = identify(&loaded, name, &measured, Path::new("data.csv"), &After::new(5));
    let Err(IdentifyError::Stopped { finished, starts: 40, csv }) = ended else {
        panic!("{ended:?}");
    };
    assert!((5..40).contains(&finished), "{finished}");
    assert!(csv.starts_with("cost,converged,heat.scale,friction.force_n\n"), "{csv}");
    assert_eq!(csv.lines().count(), 1 + finished);
    let numbers = csv.lines().nth(1).unwrap().split(',').map(|cell| cell.parse::<f64>());
    assert_eq!(
        numbers.filter(|number| number.as_ref().is_ok_and(|n| *n > 0.0)).count(),
        4,
        "{csv}"
    );
}

#[test]
fn one_long_simulation_is_stopped_at_its_next_step() {
    let text = "[plant]\nmodel = \"lumped\"\n[drive]\nkind = \"closed\"\n[identify]\nstarts = 1\n\
                parameters = [\"heat.scale\"]\n";
    let loaded = thermyo_setup::parse(text, Path::new("scenario.toml")).unwrap();
    let points = (0..10).map(|row| (1.0e5 * f64::from(row), 1.2e5)).collect();
    let columns = vec![Column { name: "pressure_pa".to_owned(), points, lines: Vec::new() }];
    let (measured, data, watch) =
        (Measured { columns }, Path::new("data.csv"), AtQuestion::default());
    let ended = identify(&loaded, data, &measured, data, &watch);
    assert!(matches!(ended, Err(IdentifyError::Stopped { finished: 0, .. })), "{ended:?}");
    // A whole simulation asks a billion times.
    let asked = watch.0.load(Ordering::Relaxed);
    assert!((STEPS..STEPS + 10).contains(&asked), "{asked}");
}
