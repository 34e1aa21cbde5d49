use super::log::LogArgs;
use super::{Console, Failure, OutputArgs, interrupt, joint_in, load, whole};
use clap::Args;
use std::ffi::OsString;
use std::io::ErrorKind;
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use thermyo_files::output::OutputDir;
use thermyo_logs::Logs;
use thermyo_serve::{Address, Ended, Opened, Operator, Served, Target, listen, serve};

#[derive(Debug, Args)]
pub(super) struct ServeArgs {
    /// Serial port, such as /dev/ttyACM0; "emulated": the firmware on an emulated Pico, with a simulated muscle or
    /// joint at its pins; or a scenario file (.toml): the same, with its muscle or joint
    #[arg(default_value = "emulated")]
    board: OsString,
    /// TCP port of the page on this machine [default: a free one]
    #[arg(long, value_name = "NUMBER", allow_negative_numbers = true, value_parser = |text: &str| whole(text, 1..=u16::MAX))]
    port: Option<u16>,
    #[command(flatten)]
    output: OutputArgs,
    #[command(flatten)]
    log: LogArgs,
}

pub(super) fn run(args: &ServeArgs, to: &mut Console<'_>) -> Result<(), Failure> {
    let to = to.as_asked(args.output.format);
    let logs = args.log.wanted();
    logs.check()?;
    let (listener, address) = listen(args.port).map_err(|error| {
        let port = args.port.unwrap_or_default();
        Failure::Usage(match error.kind() {
            ErrorKind::AddrInUse => {
                format!(
                    "--port {port}: another program has it: choose another one, or leave it out"
                )
            }
            _ => format!("--port {port}: {error}"),
        })
    })?;
    let folder = args.output.out.clone().unwrap_or_else(|| PathBuf::from("out/serve"));
    // Reports an unwritable folder at once, not when a recording is started.
    drop(OutputDir::open(&folder)?);
    let target = Target::new(&args.board);
    if let Target::Scenario(path) = &target
        && joint_in(path, to)?.is_none()
    {
        load(path, to)?;
    }
    let operate = Operate { target: &target, folder: &folder, logs };
    // Building firmware and starting a board take time.
    interrupt::watch();
    let opened = target.open();
    if interrupt::is_requested() {
        return Err(Failure::Interrupted);
    }
    match opened? {
        Opened::Muscle(board) => operate.run(*board, (listener, address), to),
        Opened::Joint(board) => operate.run(*board, (listener, address), to),
    }
}

/// A board to serve, and the folder for its recordings.
struct Operate<'a> {
    target: &'a Target,
    folder: &'a Path,
    logs: Logs,
}

impl Operate<'_> {
    fn run<S: Served>(
        self,
        board: S,
        (listener, address): (TcpListener, Address),
        to: &mut Console<'_>,
    ) -> Result<(), Failure> {
        let Self { target, folder, logs } = self;
        let operator = Operator::new(target.clone(), board, folder, logs)?;
        if to.format.json {
            let json = serde_json::json!({ "url": address.to_string(), "board": target.name() });
            to.print(&format!("{json}\n"))?;
        } else {
            to.print(&format!("{address}\n"))?;
            if !to.format.quiet {
                let name = target.name();
                to.print(&format!(
                    "{name}: open this address in a browser; Ctrl-C vents and ends\n"
                ))?;
            }
        }
        let Ended { vents, results } = serve(operator, listener, address, interrupt::is_requested)
            .map_err(|error| Failure::Usage(format!("the page cannot be served: {error}")))?;
        if !vents {
            to.say(format_args!(
                "there is no link to the board in the end: one that is driven vents by itself when its host is silent"
            ));
        }
        if to.is_read() {
            if vents {
                to.print("it vents\n")?;
            }
            for folder in results {
                to.print(&format!("report: {}\n", folder.join("report.html").display()))?;
            }
        }
        // Only Ctrl-C ends the server.
        Err(Failure::Interrupted)
    }
}
