//! Where the rows of a trace go besides `trace.csv`: a record in another format, a plot that is watched.

use std::io;

/// One such place. A row is its cells in the order of [`every_column`](super::board_trace::every_column), the time
/// first; a run knows fewer of them. What nobody knows is NaN.
pub trait Sink: Send {
    /// Takes one row.
    fn row(&mut self, cells: &[f64]) -> io::Result<()>;

    /// Hands over what has waited for long enough; for those who wait for the next row.
    fn hand_over_in_time(&mut self) -> io::Result<()> {
        Ok(())
    }

    fn hand_over(&mut self) -> io::Result<()> {
        Ok(())
    }

    /// No row follows.
    fn finish(self: Box<Self>) -> io::Result<()> {
        Ok(())
    }
}

#[derive(Default)]
pub struct Sinks(Vec<Box<dyn Sink>>);

impl Sinks {
    /// One more.
    pub fn add(&mut self, sink: impl Sink + 'static) {
        self.0.push(Box::new(sink));
    }

    /// Shows all of them a row.
    pub fn row(&mut self, cells: &[f64]) -> io::Result<()> {
        self.0.iter_mut().try_for_each(|sink| sink.row(cells))
    }

    /// Hands over what has waited for long enough.
    pub fn hand_over_in_time(&mut self) -> io::Result<()> {
        self.0.iter_mut().try_for_each(|sink| sink.hand_over_in_time())
    }

    pub fn hand_over(&mut self) -> io::Result<()> {
        self.0.iter_mut().try_for_each(|sink| sink.hand_over())
    }

    /// No row follows.
    pub fn finish(self) -> io::Result<()> {
        self.0.into_iter().try_for_each(|sink| sink.finish())
    }
}
