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

/// Leaves the result or the error for the page.
fn answer<T: Into<Vec<u8>>>(what: impl FnOnce(&mut Playground) -> Result<T, String>) -> bool {
    with(|playground| {
        let outcome = what(playground);
        let good = outcome.is_ok();
        playground.text = outcome.map_or_else(String::into_bytes, Into::into);
        good
    })
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
    answer(|playground| {
        playground.name = playground.taken()?;
        Ok("")
    })
}

/// Starts the scenario of the text, without an end.
#[unsafe(no_mangle)]
pub extern "C" fn start() -> bool {
    answer(|playground| {
        let text = playground.taken()?;
        playground.live = Some(live::start(&text, &playground.name)?);
        Ok("")
    })
}

/// Sets the numbers of the text's lines, such as `supply.pressure_pa=600000`, together: of the plant
/// while it runs; or, if `configured`, of plant and core configuration, and starts again.
#[unsafe(no_mangle)]
pub extern "C" fn turn(configured: bool) -> bool {
    answer(|playground| {
        let values = numbers(&playground.taken()?)?;
        playground.live()?.turn(&values, configured).map(|()| "")
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
    answer(|playground| Ok(playground.live()?.settings()))
}

/// Runs `steps` steps; every `every`-th row is in [`rows`].
#[unsafe(no_mangle)]
pub extern "C" fn advance(steps: u32, every: u32) -> bool {
    answer(|playground| {
        let mut rows = std::mem::take(&mut playground.rows);
        rows.clear();
        let outcome = playground.live().and_then(|live| live.advance(steps, every, &mut rows));
        playground.rows = rows;
        outcome.map(|()| "")
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
    answer(|playground| Ok(playground.live()?.header()))
}

/// State of the core: a line with its mode, a line with its faults.
#[unsafe(no_mangle)]
pub extern "C" fn state() -> bool {
    answer(|playground| Ok(playground.live()?.state()))
}

/// Warnings of `thermyo run` about the started scenario, one per line.
#[unsafe(no_mangle)]
pub extern "C" fn warnings() -> bool {
    answer(|playground| Ok(playground.live()?.warnings()))
}

/// The scenario with its present values, for `thermyo run`.
#[unsafe(no_mangle)]
pub extern "C" fn scenario() -> bool {
    answer(|playground| Ok(playground.live()?.scenario()))
}

/// The `trace.csv` that `thermyo run` writes for the text's scenario, or the `joint_trace.csv`.
#[unsafe(no_mangle)]
pub extern "C" fn trace() -> bool {
    answer(|playground| live::trace(&playground.taken()?))
}
