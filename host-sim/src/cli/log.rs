//! Further outputs of recorded rows: `--log mcap`, `--stream udp:HOST:PORT`.

use clap::{Args, ValueEnum};
use thermyo_logs::Logs;
use thermyo_logs::stream::StreamTo;

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Format {
    /// trace.mcap, for PlotJuggler, Foxglove and Rerun
    Mcap,
}

#[derive(Debug, Args)]
pub(super) struct LogArgs {
    /// Record in this format in addition to trace.csv
    #[arg(long, value_name = "FORMAT")]
    log: Option<Format>,
    /// Send every recorded row as a JSON datagram, for live plots in PlotJuggler
    #[arg(long, value_name = "udp:HOST:PORT")]
    stream: Option<StreamTo>,
}

impl LogArgs {
    pub(super) fn wanted(&self) -> Logs {
        Logs { mcap: self.log == Some(Format::Mcap), stream: self.stream.clone() }
    }
}
