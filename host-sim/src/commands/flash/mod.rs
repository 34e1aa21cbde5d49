//! `thermyo flash`: flashes the firmware of this program or its checkout through the chip's
//! built-in boot loader.

mod drive;
mod uf2;

pub use drive::{Drive, find, mounts};

use crate::commands::usb;
use clap::ValueEnum;
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use std::{fmt, fs, thread};
use thermyo_boards::image;
use thermyo_boards::image::Variant;
use thermyo_boards::line::Line;
use thermyo_boards::port::EMULATED;
use thermyo_files::input::InputError;
use thermyo_protocol::{Chip, HostCommand, Image, Version};
use thermyo_simulation::board::BoardError;

/// A drive or a board that has not appeared after this time is reported as missing.
const PATIENCE: Duration = Duration::from_secs(20);
/// Polling interval.
const LOOK: Duration = Duration::from_millis(200);

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Model {
    /// Raspberry Pi Pico
    Pico,
    /// Raspberry Pi Pico 2
    Pico2,
}

impl Model {
    const ALL: [Self; 2] = [Self::Pico, Self::Pico2];

    fn of_chip(chip: Chip) -> Option<Self> {
        match chip {
            Chip::Rp2040 => Some(Self::Pico),
            Chip::Rp2350 => Some(Self::Pico2),
            _ => None,
        }
    }

    /// Name of the board in its boot loader.
    fn board_id(self) -> &'static str {
        match self {
            Self::Pico => "RPI-RP2",
            Self::Pico2 => "RP2350",
        }
    }

    fn variant(self, joint: bool) -> Variant {
        match (self, joint) {
            (Self::Pico, false) => Variant::Standard,
            (Self::Pico, true) => Variant::Joint,
            (Self::Pico2, false) => Variant::Pico2,
            (Self::Pico2, true) => Variant::JointPico2,
        }
    }

    /// Family of UF2 files; for the RP2350 that of Arm cores in secure state, where the firmware
    /// runs.
    fn family(self) -> u32 {
        match self {
            Self::Pico => 0xe48b_ff56,
            Self::Pico2 => 0xe48b_ff59,
        }
    }
}

impl fmt::Display for Model {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Pico => "pico",
            Self::Pico2 => "pico2",
        })
    }
}

#[derive(Debug, Serialize)]
pub struct Flashed {
    /// The port or the drive that was named or found.
    target: String,
    chip: String,
    bytes: usize,
    /// False in a dry run.
    written: bool,
    /// Port of the restarted board; none if no board has restarted.
    port: Option<String>,
}

#[derive(Debug, thiserror::Error)]
pub enum FlashError {
    /// There is no board, and the request names none.
    #[error(
        "no board was found: plug one in, holding its BOOTSEL button where it does not run this \
         firmware yet, or name its port or its drive"
    )]
    NothingFound,
    /// There is more than one board, and the request names none.
    #[error("several boards were found: name one of {}", .0.join(", "))]
    Several(Vec<String>),
    #[error(
        "{}: has no INFO_UF2.TXT: it is not the drive of a board in its boot loader; plug the board in with \
         BOOTSEL held, and name the drive that appears",
        path.display()
    )]
    NoDrive { path: PathBuf },
    #[error(
        "{}: there is no such drive: plug the board in with BOOTSEL held, and name the drive that appears",
        path.display()
    )]
    NoSuchDrive { path: PathBuf },
    /// There is no firmware for this chip.
    #[error(
        "{}: its INFO_UF2.TXT has Board-ID {id:?}: must be RPI-RP2 (Pico) or RP2350 (Pico 2)",
        path.display()
    )]
    UnknownBoard { path: PathBuf, id: String },
    /// The board differs from `--chip`.
    #[error("{target} is a {found}: leave --chip {wanted} out, or name another board")]
    OtherChip { target: String, found: Model, wanted: Model },
    /// The device at the port is not a Thermyo board.
    #[error(
        "{port}: nothing answers as Thermyo: plug the board in with BOOTSEL held, and name the drive that \
         appears"
    )]
    NotThermyo { port: String },
    /// The board has no boot loader.
    #[error("{port}: this board is flashed through its probe: docs/reference/nucleo.md")]
    Probe { port: String },
    /// The emulated board has no drive, and would wait in its boot loader.
    #[error(
        "emulated: has no drive to write to: `thermyo board emulated plug` begins again with this program's firmware, \
         or with a joint's scenario with that of a joint"
    )]
    Emulated,
    /// The board does not answer or refuses, or the firmware does not build.
    #[error(transparent)]
    Board(#[from] BoardError),
    /// The image cannot be converted.
    #[error("{}: {problem}", path.display())]
    Image { path: PathBuf, problem: String },
    /// The board is in its boot loader, and this machine does not show its drive.
    #[error(
        "{port} is in its boot loader, and no {} drive has appeared in {} s: connect its USB, mount the drive, and \
         name it",
        model.board_id(),
        PATIENCE.as_secs()
    )]
    NoDriveCame { port: String, model: Model },
    /// The drive cannot be written.
    #[error(transparent)]
    Input(#[from] InputError),
    /// The board was flashed and does not answer.
    #[error(
        "the firmware is written, and no board has answered in {} s: its LED shows why (docs/reference/board.md)",
        PATIENCE.as_secs()
    )]
    NotBack,
    /// The board was flashed and runs another firmware.
    #[error("the firmware is written, and {port} runs {}: it was not taken", version_text(.found))]
    OtherFirmware { port: String, found: Version },
}

#[derive(Debug, Default)]
pub struct Request {
    /// A port or a drive; `None` takes the only board that is found.
    pub target: Option<String>,
    pub model: Option<Model>,
    /// Flashes the image for a joint of two muscles instead of one muscle.
    pub joint: bool,
    /// Writes nothing and restarts no board.
    pub dry_run: bool,
}

#[allow(clippy::large_enum_variant)] // Only one exists at a time.
enum Target {
    Drive(Drive),
    Port { name: String, line: Line, model: Model },
}

impl Target {
    fn model(&self) -> Model {
        match self {
            Self::Drive(drive) => drive.model,
            Self::Port { model, .. } => *model,
        }
    }

    fn name(&self) -> String {
        match self {
            Self::Drive(drive) => drive.path.display().to_string(),
            Self::Port { name, .. } => name.clone(),
        }
    }
}

/// Flashes a board. `mounts` returns the folders where its drive may appear; `say` gets progress
/// messages.
pub fn run(
    request: &Request,
    mounts: &dyn Fn() -> Vec<PathBuf>,
    say: &mut dyn FnMut(&str),
) -> Result<Flashed, FlashError> {
    let target = match &request.target {
        Some(name) => named(name)?,
        None => only(mounts)?,
    };
    let model = target.model();
    if let Some(wanted) = request.model.filter(|wanted| *wanted != model) {
        return Err(FlashError::OtherChip { target: target.name(), found: model, wanted });
    }
    let of_joint = if request.joint { " and a joint of two muscles" } else { "" };
    say(&format!("preparing the firmware for {model}{of_joint}"));
    let image = image::firmware(model.variant(request.joint))?;
    let damaged = |problem: String| FlashError::Image { path: image.clone(), problem };
    let elf = fs::read(&image).map_err(|error| damaged(error.to_string()))?;
    let content = uf2::of_elf(&elf, model.family()).map_err(damaged)?;
    let size = format!("{} KiB as UF2", content.len() / 1024);
    let flashed = Flashed {
        target: target.name(),
        chip: model.to_string(),
        bytes: content.len(),
        written: true,
        port: None,
    };
    if request.dry_run {
        say(&format!("would write {size} to {} ({model})", target.name()));
        return Ok(Flashed { written: false, ..flashed });
    }
    let before = usb::boards();
    let (drive, port) = match target {
        Target::Drive(drive) => (drive, None),
        Target::Port { name, line, model } => {
            (through_boot_loader(&name, line, model, mounts, say)?, Some(name))
        }
    };
    say(&format!("writing {size} to {}", drive.path.display()));
    drive.write(&content)?;
    if port.is_none() && !drive.is_mounted() {
        say("a folder, and no drive: no board restarts");
        return Ok(flashed);
    }
    let (port, version) = wait_for(|| back(port.as_deref(), &before)).ok_or(FlashError::NotBack)?;
    let other = (version.image == Image::Joint) != request.joint;
    if Model::of_chip(version.chip) != Some(model) || version.firmware != OURS || other {
        return Err(FlashError::OtherFirmware { port, found: version });
    }
    say(&format!("{port} runs {}", version_text(&version)));
    Ok(Flashed { port: Some(port), ..flashed })
}

/// Version of this program, which is also the firmware's.
const OURS: [u16; 3] = [
    number(env!("CARGO_PKG_VERSION_MAJOR")),
    number(env!("CARGO_PKG_VERSION_MINOR")),
    number(env!("CARGO_PKG_VERSION_PATCH")),
];

const fn number(text: &str) -> u16 {
    match u16::from_str_radix(text, 10) {
        Ok(number) => number,
        Err(_) => panic!("cargo gives whole numbers"),
    }
}

pub fn version_text(version: &Version) -> String {
    let Version { firmware: [major, minor, patch], chip, protocol, image } = version;
    let image = match image {
        Image::Hil => ", samples from the host",
        Image::Joint => ", a joint",
        _ => "",
    };
    format!("firmware {major}.{minor}.{patch} ({chip}, protocol {protocol}{image})")
}

fn named(name: &str) -> Result<Target, FlashError> {
    if Path::new(name).is_dir() {
        return Drive::at(Path::new(name)).map(Target::Drive);
    }
    if name == EMULATED {
        return Err(FlashError::Emulated);
    }
    if is_drive_name(name) {
        return Err(FlashError::NoSuchDrive { path: name.into() });
    }
    let (line, version) = Line::meet(name).map_err(|error| match error {
        BoardError::Silent { .. } => FlashError::NotThermyo { port: name.to_owned() },
        other => other.into(),
    })?;
    let model = Model::of_chip(version.chip);
    let model = model.ok_or_else(|| FlashError::Probe { port: name.to_owned() })?;
    Ok(Target::Port { name: name.to_owned(), line, model })
}

/// Whether a name without a folder is meant as a drive: it has a separator and is not that of a
/// device, or it is what a boot loader calls its drive.
fn is_drive_name(name: &str) -> bool {
    let is_device = ["/dev/", r"\\.\"].iter().any(|start| name.starts_with(start));
    let is_path = name.contains(std::path::is_separator) && !is_device;
    let is_board_id = Model::ALL.iter().any(|model| model.board_id() == name);
    (is_path || is_board_id) && !Path::new(name).exists()
}

/// The only board that is found: a board that waits for an image takes precedence over one that
/// runs an image.
fn only(mounts: &dyn Fn() -> Vec<PathBuf>) -> Result<Target, FlashError> {
    let drives: Vec<String> =
        find(&mounts()).iter().map(|drive| drive.path.display().to_string()).collect();
    let mut names = if drives.is_empty() { usb::boards() } else { drives };
    match (names.pop(), names.is_empty()) {
        (None, _) => Err(FlashError::NothingFound),
        (Some(name), true) => named(&name),
        (Some(name), false) => {
            names.push(name);
            Err(FlashError::Several(names))
        }
    }
}

/// Puts a running board into its boot loader; returns its drive.
fn through_boot_loader(
    port: &str,
    mut line: Line,
    model: Model,
    mounts: &dyn Fn() -> Vec<PathBuf>,
    say: &mut dyn FnMut(&str),
) -> Result<Drive, FlashError> {
    let before = find(&mounts());
    line.ask(HostCommand::BootLoader, "to start its boot loader")?;
    drop(line);
    say(&format!("{port} restarts into its boot loader"));
    let came = || {
        let drives = find(&mounts()).into_iter();
        drives.filter(|drive| drive.model == model).find(|drive| !before.contains(drive))
    };
    wait_for(came).ok_or_else(|| FlashError::NoDriveCame { port: port.to_owned(), model })
}

/// The board that answers at its former port, or at a new one.
fn back(port: Option<&str>, before: &[String]) -> Option<(String, Version)> {
    let new = usb::boards().into_iter().filter(|name| !before.contains(name));
    let mut names = port.map(str::to_owned).into_iter().chain(new);
    names.find_map(|name| Some((name.clone(), Line::meet(&name).ok()?.1)))
}

fn wait_for<T>(mut look: impl FnMut() -> Option<T>) -> Option<T> {
    let start = Instant::now();
    loop {
        let found = look();
        if found.is_some() || start.elapsed() > PATIENCE {
            return found;
        }
        thread::sleep(LOOK);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The emulated board used to be sent to its boot loader, in which it no longer answered.
    #[test]
    fn the_emulated_board_is_not_flashed() {
        let request =
            Request { target: Some(EMULATED.to_owned()), model: None, joint: false, dry_run: true };
        let error = run(&request, &Vec::new, &mut |_| {}).unwrap_err().to_string();
        assert!(error.starts_with("emulated: has no drive to write to: "), "{error}");
    }

    /// It used to be taken for a serial port.
    #[test]
    fn a_drive_that_does_not_exist_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let missing = folder.path().join("RPI-RP2").display().to_string();
        for (name, is_drive) in
            [(&*missing, true), ("RP2350", true), ("/dev/ttyACM7", false), ("COM7", false)]
        {
            assert_eq!(is_drive_name(name), is_drive, "{name}");
        }
        let target = Some(missing.clone());
        let request = Request { target, ..Request::default() };
        let error = run(&request, &Vec::new, &mut |_| {}).unwrap_err().to_string();
        assert!(error.starts_with(&format!("{missing}: there is no such drive: plug")), "{error}");
    }
}
