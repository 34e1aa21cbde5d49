//! Sinks for the rows of a trace in addition to `trace.csv`: a record in another format, a live
//! plot.

use std::io;

/// A sink for rows. A row has its cells in the order of
/// [`every_column`](super::board_trace::every_column), the time first. Unknown cells are NaN.
pub trait Sink: Send {
    fn row(&mut self, cells: &[f64]) -> io::Result<()>;

    /// Writes rows that have waited long enough; for callers that wait for the next row.
    fn hand_over_in_time(&mut self) -> io::Result<()> {
        Ok(())
    }

    fn hand_over(&mut self) -> io::Result<()> {
        Ok(())
    }

    fn finish(self: Box<Self>) -> io::Result<()> {
        Ok(())
    }
}

#[derive(Default)]
pub struct Sinks(Vec<Box<dyn Sink>>);

impl Sinks {
    pub fn add(&mut self, sink: impl Sink + 'static) {
        self.0.push(Box::new(sink));
    }

    /// Passes a row to all sinks.
    pub fn row(&mut self, cells: &[f64]) -> io::Result<()> {
        self.0.iter_mut().try_for_each(|sink| sink.row(cells))
    }

    /// Writes rows that have waited long enough.
    pub fn hand_over_in_time(&mut self) -> io::Result<()> {
        self.0.iter_mut().try_for_each(|sink| sink.hand_over_in_time())
    }

    pub fn hand_over(&mut self) -> io::Result<()> {
        self.0.iter_mut().try_for_each(|sink| sink.hand_over())
    }

    pub fn finish(self) -> io::Result<()> {
        self.0.into_iter().try_for_each(|sink| sink.finish())
    }
}
