//! The emulated board as a separate process: it runs the firmware with a simulated muscle or joint at
//! its pins, in real time if the machine is fast enough, for every program that opens the port
//! "emulated".
//!
//! A file in the folder for temporary files holds its local port. The first program that opens the port plugs the board
//! in; removing the file unplugs it. Without a client the board's time stops, once it has had time to notice that its
//! host is gone; if unused for long, the process ends. A second file beside the first holds the content of its flash,
//! which survives the loss of power, a third one describes the hardware at its pins.

use super::checkout;
use super::emulated::{EmulatedBoard, Exchange, Port, STEP_NS};
use super::image::{self, Variant};
use super::serial_port::READ;
use std::fs::File;
use std::io::{ErrorKind, Read, Write};
use std::net::{Ipv4Addr, TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};
use std::{env, fs, io, thread};
use thermyo_protocol::PROTOCOL;
use thermyo_setup::{Loaded, hardware};
use thermyo_simulation::board::BoardError;
use thermyo_simulation::rig::Rig;

/// The hidden command that runs the service.
pub const TASK: &str = "emulated-board";

const STEP: Duration = Duration::from_nanos(STEP_NS as u64);
/// Steps to run after the last client has left.
const STEPS_ALONE: u32 = 2_000;
/// Time without a client after which the process ends.
const LONGEST_IDLE: Duration = Duration::from_secs(600);
/// Time after which a second client is refused: the first one may be leaving.
const LONGEST_WAIT: Duration = Duration::from_millis(300);
/// Polling interval for clients.
const LOOK: Duration = Duration::from_millis(20);
/// Steps between two checks that the board is still plugged in.
const PLUGGED_STEPS: u32 = 500;
/// Delay beyond which a board does not catch up.
const FURTHEST_BEHIND: Duration = Duration::from_millis(50);
/// Time after which the start fails; it is long because machines may be slow.
const LONGEST_START: Duration = Duration::from_secs(900);

/// Extension of the file beside it that describes the hardware at the board's pins.
const AT_PINS: &str = "pins";

/// The file that holds the port, one for each user. Only on Unix do users share the folder.
fn file() -> PathBuf {
    #[cfg(unix)]
    let name = format!("thermyo-emulated-{}", rustix::process::getuid().as_raw());
    #[cfg(not(unix))]
    let name = "thermyo-emulated";
    env::temp_dir().join(name)
}

/// Identifies this build: another build does not use its board.
fn build() -> String {
    let built = env::current_exe().and_then(fs::metadata).and_then(|exe| exe.modified());
    let built = built.ok().and_then(|time| time.duration_since(std::time::UNIX_EPOCH).ok());
    format!("{PROTOCOL} {}", built.unwrap_or_default().as_nanos())
}

/// Connects to the board, plugging it in if necessary.
pub fn connect() -> Result<TcpStream, BoardError> {
    if let Some(stream) = plugged_in() {
        return Ok(stream);
    }
    let _alone = alone()?;
    match plugged_in() {
        Some(stream) => Ok(stream),
        None => plug(Variant::Standard, None),
    }
}

/// Waits until no other program plugs in a board. Programs that start at the same time would each replace the board of
/// the one before.
pub(super) fn alone() -> io::Result<File> {
    checkout::alone(&file().with_extension("lock"), "plugging in the emulated board")
}

/// Local port of the board that is plugged in.
fn address() -> Option<u16> {
    let text = fs::read_to_string(file()).ok()?;
    let (port, by) = text.trim().split_once(' ')?;
    if by == build() { port.parse().ok() } else { None }
}

pub(super) fn plugged_in() -> Option<TcpStream> {
    let stream = TcpStream::connect((Ipv4Addr::LOCALHOST, address()?)).ok()?;
    stream.set_read_timeout(Some(READ)).ok()?;
    stream.set_nodelay(true).ok()?;
    Some(stream)
}

/// Plugs in a board with an image and the muscle or joint of a scenario file, replacing an earlier one. The caller is
/// [`alone`].
pub(super) fn plug(image: Variant, scenario: Option<&Path>) -> Result<TcpStream, BoardError> {
    // Prepared here, so that the caller gets the errors.
    let (scripts, image) = (image::prepare_emulator()?, image::firmware(image)?);
    unplug();
    let mut command = Command::new(env::current_exe()?);
    command.arg(TASK).args([&scripts, &image, &file()]).args(scenario);
    command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped());
    // The board does not read what the user types.
    #[cfg(unix)]
    std::os::unix::process::CommandExt::process_group(&mut command, 0);
    #[cfg(windows)]
    std::os::windows::process::CommandExt::creation_flags(&mut command, 0x200);
    let mut process = command.spawn()?;
    let start = Instant::now();
    while start.elapsed() < LONGEST_START {
        if let Some(stream) = plugged_in() {
            return Ok(stream);
        }
        if process.try_wait()?.is_some() {
            return Err(BoardError::Emulator { message: last_words(&mut process) });
        }
        thread::sleep(LOOK);
    }
    let _ = process.kill();
    Err(BoardError::Silent { asked: "a connection" })
}

pub fn is_plugged_in() -> bool {
    plugged_in().is_some()
}

/// Plugs in a board that runs in a thread of this process, with the muscle of a scenario, replacing
/// an earlier one: for programs that cannot be started again as the board's process. The caller is [`alone`].
pub(super) fn plug_into_this_process(loaded: Loaded) -> Result<(), BoardError> {
    let (scripts, image) = (image::prepare_emulator()?, image::firmware(Variant::Standard)?);
    unplug();
    let board = thread::spawn(move || serve_muscle([&scripts, &image, &file()], &loaded));
    while !is_plugged_in() {
        if board.is_finished() {
            let silent = Err(BoardError::Silent { asked: "a connection" });
            return board.join().unwrap_or(silent);
        }
        thread::sleep(LOOK);
    }
    Ok(())
}

fn last_words(process: &mut Child) -> String {
    let mut message = String::new();
    if let Some(mut errors) = process.stderr.take() {
        // The process has ended: this does not block.
        let _ = errors.read_to_string(&mut message);
    }
    message.trim().trim_start_matches("thermyo: ").to_owned()
}

/// Unplugs the board; returns whether there was one.
pub fn unplug() -> bool {
    fs::remove_file(file()).is_ok()
}

/// The muscle of a scenario at a board's pins: each call runs a millisecond of both.
pub fn muscle(
    loaded: &Loaded,
) -> Result<impl FnMut(&mut EmulatedBoard) -> Result<Exchange, BoardError> + use<>, BoardError> {
    let emulator = |message: String| BoardError::Emulator { message };
    let mut rig = Rig::behind_pins(loaded).map_err(|error| emulator(error.to_string()))?;
    Ok(move |board: &mut EmulatedBoard| {
        let exchange = board.run(&rig.sample(), STEP_NS)?;
        rig.advance(exchange.actuation()).map_err(|error| emulator(error.to_string()))?;
        Ok(exchange)
    })
}

/// Hardware at the pins of the board that is plugged in, in the form of [`hardware`]; empty for a joint.
pub fn at_pins() -> Option<String> {
    address()?;
    fs::read_to_string(file().with_extension(AT_PINS)).ok()
}

/// Runs the board with the muscle of a scenario, as [`serve`].
pub fn serve_muscle(files: [&Path; 3], loaded: &Loaded) -> Result<(), BoardError> {
    serve(files, (Port::Uart, &hardware(loaded)), muscle(loaded)?)
}

/// Runs the board, with the emulator's scripts and an image of the firmware, until it is unplugged or has been idle for
/// long. Clients connect to its `port`, and read its hardware by [`at_pins`]. Each call of `run` runs a millisecond of
/// the board and of the plant at its pins.
pub fn serve<R>(
    [scripts, image, file]: [&Path; 3],
    (port, at_pins): (Port, &str),
    mut run: R,
) -> Result<(), BoardError>
where
    R: FnMut(&mut EmulatedBoard) -> Result<Exchange, BoardError>,
{
    let mut board = EmulatedBoard::with_flash(scripts, image, &file.with_extension("flash"))?;
    if port == Port::Usb {
        board.connect_usb_while(&mut run)?;
    }
    let mut board = Emulated { board, run, to_client: Vec::new() };
    let (listener, card) = announced(file, at_pins)?;
    let plugged = || fs::read_to_string(file).is_ok_and(|text| text == card);

    let mut client: Option<TcpStream> = None;
    let mut next: Option<(TcpStream, Instant)> = None;
    let mut left = Instant::now();
    let mut steps_alone = STEPS_ALONE;
    let mut due = Instant::now();
    for step in 0_u32.. {
        if let Ok((stream, _)) = listener.accept() {
            next = Some((stream, Instant::now()));
        }
        if client.is_none()
            && let Some((stream, _)) = next.take()
        {
            stream.set_nonblocking(true)?;
            stream.set_nodelay(true)?;
            client = Some(stream);
        }
        next = next.filter(|(_, since)| since.elapsed() < LONGEST_WAIT);
        if (step.is_multiple_of(PLUGGED_STEPS) || client.is_none()) && !plugged() {
            return Ok(());
        }
        if client.is_some() {
            (steps_alone, left) = (0, Instant::now());
        } else if steps_alone < STEPS_ALONE {
            steps_alone += 1;
        } else if left.elapsed() < LONGEST_IDLE {
            thread::sleep(LOOK);
            continue;
        } else {
            let _ = fs::remove_file(file);
            return Ok(());
        }
        if !board.step(client.as_mut())? {
            client = None;
        }
        due += STEP;
        let now = Instant::now();
        if due > now + 2 * STEP {
            thread::sleep(due - now);
        } else if due + FURTHEST_BEHIND < now {
            due = now;
        }
    }
    Ok(())
}

/// Listens at a port, which the file states from now on, beside the file of the hardware at the pins; also returns the
/// content of the first file.
fn announced(file: &Path, at_pins: &str) -> io::Result<(TcpListener, String)> {
    fs::write(file.with_extension(AT_PINS), at_pins)?;
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0))?;
    listener.set_nonblocking(true)?;
    let card = format!("{} {}", listener.local_addr()?.port(), build());
    // Renamed once it is complete.
    let part = file.with_extension(std::process::id().to_string());
    fs::write(&part, &card)?;
    fs::rename(&part, file)?;
    Ok((listener, card))
}

/// The board and the plant at its pins.
struct Emulated<R> {
    board: EmulatedBoard,
    run: R,
    /// Bytes that the client has not accepted yet.
    to_client: Vec<u8>,
}

impl<R: FnMut(&mut EmulatedBoard) -> Result<Exchange, BoardError>> Emulated<R> {
    /// Runs one millisecond; returns whether the client is still connected.
    fn step(&mut self, client: Option<&mut TcpStream>) -> Result<bool, BoardError> {
        let mut connected = client.is_some();
        if let Some(client) = client {
            let mut buffer = [0; 1024];
            match client.read(&mut buffer) {
                Ok(0) => connected = false,
                Ok(count) => self.board.write(&buffer[..count]),
                Err(error) => connected = waits(&error),
            }
            match client.write(&self.to_client) {
                Ok(count) => drop(self.to_client.drain(..count)),
                Err(error) => connected &= waits(&error),
            }
        }
        if !connected {
            self.to_client.clear();
        }
        (self.run)(&mut self.board)?;
        self.to_client.extend(self.board.read());
        self.board.take_telemetry();
        self.board.take_joint_telemetry();
        Ok(connected)
    }
}

/// Whether the error only means that the operation has to wait.
fn waits(error: &io::Error) -> bool {
    matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted)
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use std::os::unix::fs::MetadataExt;

    /// Two names that differ after a dot used to share one flash, and all users whose name is unset shared one board.
    #[test]
    fn every_user_has_a_board_and_a_flash_of_their_own() {
        let mine = tempfile::NamedTempFile::new().unwrap();
        let user = mine.as_file().metadata().unwrap().uid();
        assert_eq!(file(), env::temp_dir().join(format!("thermyo-emulated-{user}")));
        let flash = env::temp_dir().join(format!("thermyo-emulated-{user}.flash"));
        assert_eq!(file().with_extension("flash"), flash);
    }
}
