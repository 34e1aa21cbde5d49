//! Core and plant for a web page: runs `thermyo run` in stretches, with adjustable parameters.
//!
//! The functions have the C interface of WebAssembly. Texts pass through one buffer: [`text`] makes
//! room for one and returns its address, [`text_length`] returns the length of the result. If a
//! function returns `false`, the result is the error, in one line.

mod joint;
mod kind;
mod live;
mod muscle;

use live::Running;
use std::cell::RefCell;

#[derive(Default)]
struct Playground {
    text: Vec<u8>,
    /// Name of the next started scenario's file, for messages.
    name: String,
    rows: Vec<f64>,
    live: Option<Box<dyn Running>>,
}

thread_local! {
    static PLAYGROUND: RefCell<Playground> = RefCell::default();
}

fn with<T>(what: impl FnOnce(&mut Playground) -> T) -> T {
    PLAYGROUND.with_borrow_mut(what)
}

impl Playground {
    /// Takes the text that the page has written.
    fn taken(&mut self) -> Result<String, String> {
        String::from_utf8(std::mem::take(&mut self.text))
            .map_err(|_| "the text is not UTF-8".into())
    }

    fn live(&mut self) -> Result<&mut Box<dyn Running>, String> {
        self.live.as_mut().ok_or_else(|| "nothing has been started".into())
    }

    /// Stores the result or the error for the page.
    fn say(&mut self, outcome: Result<Vec<u8>, String>) -> bool {
        let good = outcome.is_ok();
        self.text = outcome.unwrap_or_else(String::into_bytes);
        good
    }
}

/// Makes room for a text of this many bytes.
#[unsafe(no_mangle)]
pub extern "C" fn text(length: usize) -> *mut u8 {
    with(|playground| {
        playground.text = vec![0; length];
        playground.text.as_mut_ptr()
    })
}

/// Address of the result.
#[unsafe(no_mangle)]
pub extern "C" fn text_place() -> *const u8 {
    with(|playground| playground.text.as_ptr())
}

#[unsafe(no_mangle)]
pub extern "C" fn text_length() -> usize {
    with(|playground| playground.text.len())
}

/// Takes the text as the name of the scenario's file, for messages.
#[unsafe(no_mangle)]
pub extern "C" fn name() -> bool {
    with(|playground| {
        let outcome = playground.taken().map(|name| playground.name = name);
        playground.say(outcome.map(|()| Vec::new()))
    })
}

/// Starts the scenario of the text, without an end.
#[unsafe(no_mangle)]
pub extern "C" fn start() -> bool {
    with(|playground| {
        let started = playground.taken().and_then(|text| live::start(&text, &playground.name));
        let outcome = started.map(|live| {
            playground.live = Some(live);
            Vec::new()
        });
        playground.say(outcome)
    })
}

/// Sets the numbers of the text's lines, such as `supply.pressure_pa=600000`, together: of the plant
/// while it runs; or, if `configured`, of plant and core configuration, and starts again.
#[unsafe(no_mangle)]
pub extern "C" fn turn(configured: bool) -> bool {
    with(|playground| {
        let values = playground.taken().and_then(|text| numbers(&text));
        let outcome = values.and_then(|values| playground.live()?.turn(&values, configured));
        playground.say(outcome.map(|()| Vec::new()))
    })
}

fn numbers(text: &str) -> Result<Vec<(String, f64)>, String> {
    let number = |line: &str| {
        let (key, value) = line.split_once('=')?;
        Some((key.to_owned(), value.parse().ok()?))
    };
    text.lines().map(|line| number(line).ok_or_else(|| format!("{line}: is no number"))).collect()
}

/// Writes the present parameters of the plant, as JSON.
#[unsafe(no_mangle)]
pub extern "C" fn settings() -> bool {
    with(|playground| {
        let outcome = playground.live().map(|live| live.settings());
        playground.say(outcome)
    })
}

/// Runs `steps` steps; every `every`-th row is in [`rows`].
#[unsafe(no_mangle)]
pub extern "C" fn advance(steps: u32, every: u32) -> bool {
    with(|playground| {
        let mut rows = std::mem::take(&mut playground.rows);
        rows.clear();
        let outcome = playground.live().and_then(|live| live.advance(steps, every, &mut rows));
        playground.rows = rows;
        playground.say(outcome.map(|()| Vec::new()))
    })
}

/// Address of the rows, with a number for each of [`columns`].
#[unsafe(no_mangle)]
pub extern "C" fn rows() -> *const f64 {
    with(|playground| playground.rows.as_ptr())
}

/// Count of all numbers in the rows.
#[unsafe(no_mangle)]
pub extern "C" fn rows_length() -> usize {
    with(|playground| playground.rows.len())
}

/// Names of the columns of the trace, as its first line.
#[unsafe(no_mangle)]
pub extern "C" fn columns() -> bool {
    with(|playground| {
        let outcome = playground.live().map(|live| live.header().into_bytes());
        playground.say(outcome)
    })
}

/// State of the core: a line with its mode, a line with its faults.
#[unsafe(no_mangle)]
pub extern "C" fn state() -> bool {
    with(|playground| {
        let outcome = playground.live().map(|live| live.state().into_bytes());
        playground.say(outcome)
    })
}

/// Warnings of `thermyo run` about the started scenario, one per line.
#[unsafe(no_mangle)]
pub extern "C" fn warnings() -> bool {
    with(|playground| {
        let outcome = playground.live().map(|live| live.warnings().into_bytes());
        playground.say(outcome)
    })
}

/// The scenario with its present values, for `thermyo run`.
#[unsafe(no_mangle)]
pub extern "C" fn scenario() -> bool {
    with(|playground| {
        let outcome = playground.live().map(|live| live.scenario().into_bytes());
        playground.say(outcome)
    })
}

/// The `trace.csv` that `thermyo run` writes for the text's scenario, or the `joint_trace.csv`.
#[unsafe(no_mangle)]
pub extern "C" fn trace() -> bool {
    with(|playground| {
        let outcome = playground.taken().and_then(|scenario| live::trace(&scenario));
        playground.say(outcome)
    })
}
