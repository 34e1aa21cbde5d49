//! Partial results of long work that is stopped. The stop request is global to the process: this
//! must stay the only test.

use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};
use thermyo_compute::parallel::Watch;
use thermyo_compute::stop;
use thermyo_evaluate::estimator;
use thermyo_identify::{IdentifyError, identify};
use thermyo_record::measured::{Column, Measured};
use thermyo_record::trace::Row;
use thermyo_simulation::board::CoreBoard;
use thermyo_simulation::run;
use thermyo_simulation::run::RunError;

/// Requests a stop after so many parts.
struct After(AtomicUsize);

impl Watch for After {
    fn done(&self) {
        if self.0.fetch_sub(1, Ordering::Relaxed) == 1 {
            stop::request();
        }
    }
}

fn after(parts: usize) -> After {
    stop::reset();
    After(AtomicUsize::new(parts))
}

#[test]
fn finished_parts_are_kept() {
    // Only the lines of the finished cases.
    let lines = estimator::random(1, 30, &after(3)).unwrap();
    let (total, muscles) = lines.split_last().unwrap();
    assert!((3..30).contains(&muscles.len()), "{lines:?}");
    assert_eq!(total.case, format!("{} muscles of seed 1", muscles.len()));
    assert_eq!(thermyo_evaluate::missed(muscles).1, 2 * muscles.len());

    // A run reports that it was stopped, in any phase.
    let text = "[run]\nduration_s = 3.0\n[plant]\nmodel = \"lumped\"\n[identify]\nstarts = 40\n\
                parameters = [\"heat.inner_w_m2_k\", \"friction.force_n\"]\n";
    let name = Path::new("scenario.toml");
    let loaded = thermyo_setup::parse(text, name).unwrap();
    let mut ignored = |_: &Row| Ok(());
    let ended = run::run(&loaded, &mut CoreBoard::default(), None, &mut ignored);
    assert!(matches!(ended, Err(RunError::Stopped)), "{ended:?}");
    stop::reset();
    let names = ["flow_in_kg_s", "flow_out_kg_s", "pressure_pa"];
    let mut columns =
        names.map(|name| Column { name: name.to_owned(), points: Vec::new(), lines: Vec::new() });
    let mut each = |row: &Row| {
        let truth = &row.truth;
        let values = [truth.flow_in_kg_s, truth.flow_out_kg_s, truth.pressure_pa];
        columns.iter_mut().zip(values).for_each(|(c, v)| c.points.push((truth.time_s, v)));
        Ok(())
    };
    run::run(&loaded, &mut CoreBoard::default(), None, &mut each).unwrap();

    // One row per finished search.
    let measured = Measured { columns: columns.to_vec() };
    let ended = identify(&loaded, name, &measured, Path::new("data.csv"), &after(5));
    let Err(IdentifyError::Stopped { finished, starts: 40, csv }) = ended else {
        panic!("{ended:?}");
    };
    assert!((5..40).contains(&finished), "{finished}");
    assert!(csv.starts_with("cost,converged,heat.inner_w_m2_k,friction.force_n\n"), "{csv}");
    assert_eq!(csv.lines().count(), 1 + finished);
    let numbers = csv.lines().nth(1).unwrap().split(',').map(|cell| cell.parse::<f64>());
    assert_eq!(
        numbers.filter(|number| number.as_ref().is_ok_and(|n| *n > 0.0)).count(),
        4,
        "{csv}"
    );
    stop::reset();

    // Stopped in the middle of one long simulation.
    let text = "[plant]\nmodel = \"lumped\"\n[drive]\nkind = \"closed\"\n[identify]\nstarts = 1\n\
                parameters = [\"heat.inner_w_m2_k\"]\n";
    let loaded = thermyo_setup::parse(text, name).unwrap();
    let points = (0..10).map(|row| (1.0e5 * f64::from(row), 1.2e5)).collect();
    let columns = vec![Column { name: "pressure_pa".to_owned(), points, lines: Vec::new() }];
    let presser = std::thread::spawn(|| {
        std::thread::sleep(Duration::from_millis(300));
        stop::request();
        Instant::now()
    });
    let ended = identify(&loaded, name, &Measured { columns }, Path::new("data.csv"), &());
    let waited = presser.join().unwrap().elapsed();
    assert!(matches!(ended, Err(IdentifyError::Stopped { finished: 0, .. })), "{ended:?}");
    assert!(waited < Duration::from_secs(1), "{waited:?}");
    stop::reset();
}
