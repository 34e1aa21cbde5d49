//! `thermyo flash`: puts the firmware of this program or its checkout on a board, through the boot loader that its chip is
//! born with.

mod drive;
mod uf2;

pub use drive::{Drive, find, mounts};

use crate::commands::usb;
use clap::ValueEnum;
use model_core::link::{Chip, HostCommand, Version};
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use std::{fmt, fs, thread};
use thermyo_boards::image;
use thermyo_boards::image::Variant;
use thermyo_boards::line::Line;
use thermyo_files::input::InputError;
use thermyo_simulation::board::BoardError;

/// A board that has not come as a drive, or back from it, after this time will not.
const PATIENCE: Duration = Duration::from_secs(20);
/// Time between two looks.
const LOOK: Duration = Duration::from_millis(200);

/// A board with a boot loader.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Model {
    /// Raspberry Pi Pico.
    Pico,
    /// Raspberry Pi Pico 2.
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

    /// What its boot loader calls it.
    fn board_id(self) -> &'static str {
        match self {
            Self::Pico => "RPI-RP2",
            Self::Pico2 => "RP2350",
        }
    }

    fn variant(self) -> Variant {
        match self {
            Self::Pico => Variant::Standard,
            Self::Pico2 => Variant::Pico2,
        }
    }

    /// Of UF2 files; the RP2350's is that of its Arm cores in secure state, in which the firmware runs.
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

/// What was done.
#[derive(Debug, Serialize)]
pub struct Flashed {
    /// The port or the drive that was named or found.
    target: String,
    /// What it is.
    chip: String,
    /// Size of the UF2.
    bytes: usize,
    /// Not in a dry run.
    written: bool,
    /// Where the board runs it; none where no board has restarted.
    port: Option<String>,
}

/// Why nothing was flashed, or not what should be.
#[derive(Debug, thiserror::Error)]
pub enum FlashError {
    /// No board, and none was named.
    #[error(
        "no board was found: plug one in, holding its BOOTSEL button where it does not run this \
         firmware yet, or name its port or its drive"
    )]
    NothingFound,
    /// More than one, and none was named.
    #[error("several boards were found: name one of {}", .0.join(", "))]
    Several(Vec<String>),
    /// A folder that is none of a boot loader.
    #[error(
        "{}: has no INFO_UF2.TXT: it is not the drive of a board in its boot loader; plug the board in with \
         BOOTSEL held, and name the drive that appears",
        path.display()
    )]
    NoDrive {
        /// The folder.
        path: PathBuf,
    },
    /// A boot loader of a chip that there is no firmware for.
    #[error(
        "{}: its INFO_UF2.TXT says Board-ID {id:?}: must be RPI-RP2 (Pico) or RP2350 (Pico 2)",
        path.display()
    )]
    UnknownBoard {
        /// Its drive.
        path: PathBuf,
        /// What it says.
        id: String,
    },
    /// `--chip` says otherwise.
    #[error("{target} is a {found}: leave --chip {wanted} out, or name another board")]
    OtherChip {
        /// The board.
        target: String,
        /// What it is.
        found: Model,
        /// What it was taken for.
        wanted: Model,
    },
    /// Something else at a port.
    #[error(
        "{port}: nothing answers as Thermyo: plug the board in with BOOTSEL held, and name the drive that \
         appears"
    )]
    NotThermyo {
        /// The port.
        port: String,
    },
    /// A board without a boot loader.
    #[error("{port}: this board is flashed through its probe: docs/reference/nucleo.md")]
    Probe {
        /// The port.
        port: String,
    },
    /// The board does not do as it is told, or the firmware does not build.
    #[error(transparent)]
    Board(#[from] BoardError),
    /// The image is none.
    #[error("{}: {problem}", path.display())]
    Image {
        /// The image.
        path: PathBuf,
        /// What is wrong with it.
        problem: String,
    },
    /// The board is in its boot loader, and this machine does not show its drive.
    #[error(
        "{port} is in its boot loader, and no {} drive has appeared in {} s: connect its USB, mount the drive, and \
         name it",
        model.board_id(),
        PATIENCE.as_secs()
    )]
    NoDriveCame {
        /// Where the board was.
        port: String,
        /// What it is.
        model: Model,
    },
    /// The drive cannot be written.
    #[error(transparent)]
    Input(#[from] InputError),
    /// It was flashed, and does not answer.
    #[error(
        "the firmware is written, and no board has answered in {} s: its LED tells why (docs/reference/board.md)",
        PATIENCE.as_secs()
    )]
    NotBack,
    /// It was flashed, and runs another firmware.
    #[error("the firmware is written, and {port} runs {}: it was not taken", version_text(.found))]
    OtherFirmware {
        /// Where it answers.
        port: String,
        /// What it says.
        found: Version,
    },
}

/// What is asked for.
#[derive(Debug, Default)]
pub struct Request {
    /// A port or a drive; nothing: the only board that is found.
    pub target: Option<String>,
    /// What it must be.
    pub model: Option<Model>,
    /// Nothing is written, and no board restarted.
    pub dry_run: bool,
}

/// Where the board is.
#[allow(clippy::large_enum_variant)] // One at a time.
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

/// Flashes a board. `mounts` are the folders where its drive may appear; `say` is told what happens.
///
/// # Errors
/// [`FlashError`]
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
    say(&format!("preparing the firmware for {model}"));
    let image = image::firmware(model.variant())?;
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
    if Model::of_chip(version.chip) != Some(model) || version.firmware != OURS {
        return Err(FlashError::OtherFirmware { port, found: version });
    }
    say(&format!("{port} runs {}", version_text(&version)));
    Ok(Flashed { port: Some(port), ..flashed })
}

/// The firmware and this program have one version.
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

/// What a board says that it is.
pub fn version_text(version: &Version) -> String {
    let Version { firmware: [major, minor, patch], chip, protocol, hil } = version;
    let hil = if *hil { ", samples from the host" } else { "" };
    format!("firmware {major}.{minor}.{patch} ({chip:?}, protocol {protocol}{hil})")
}

fn named(name: &str) -> Result<Target, FlashError> {
    if Path::new(name).is_dir() {
        return Drive::at(Path::new(name)).map(Target::Drive);
    }
    let (line, version) = Line::meet(name).map_err(|error| match error {
        BoardError::Silent { .. } => FlashError::NotThermyo { port: name.to_owned() },
        other => other.into(),
    })?;
    let model = Model::of_chip(version.chip);
    let model = model.ok_or_else(|| FlashError::Probe { port: name.to_owned() })?;
    Ok(Target::Port { name: name.to_owned(), line, model })
}

/// The only board that is found: what waits for an image comes before what runs one.
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

/// Puts a running board into its boot loader; its drive.
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

/// The board that answers where it was, or where none was.
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
