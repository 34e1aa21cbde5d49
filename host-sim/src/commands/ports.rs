//! `thermyo ports`: devices that are boards, or may be.

use crate::commands::flash::{Drive, find, version_text};
use crate::commands::usb::usb;
use serde::Serialize;
use serialport::UsbPortInfo;
use std::fmt;
use std::path::PathBuf;
use std::thread;
use thermyo_boards::line::Line;
use thermyo_protocol::{USB_ID, Version};

#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Found {
    pub port: String,
    /// The system's description.
    pub device: String,
    /// Whether it answers as Thermyo.
    pub thermyo: bool,
    /// Its answer, or the reason why there is none.
    pub state: String,
}

impl fmt::Display for Found {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}  {}  [{}]", self.port, self.state, self.device)
    }
}

/// Everything at the serial ports of USB, with its version, and the drives of boards in their boot
/// loader.
pub fn list(mounts: &[PathBuf]) -> Vec<Found> {
    let asked: Vec<_> =
        usb().into_iter().map(|(port, info)| thread::spawn(move || ask(port, &info))).collect();
    let answers = asked.into_iter().filter_map(|thread| thread.join().ok());
    answers.chain(find(mounts).into_iter().map(waiting)).collect()
}

fn ask(port: String, info: &UsbPortInfo) -> Found {
    let answer = Line::meet(&port).map(|(_, version)| version).map_err(|error| error.to_string());
    Found::new(port, info, &answer)
}

impl Found {
    fn new(port: String, info: &UsbPortInfo, answer: &Result<Version, String>) -> Self {
        let UsbPortInfo { vid, pid, .. } = info;
        let text = |text: &Option<String>| text.iter().map(|text| format!(" {text}")).collect();
        let [manufacturer, product, number]: [String; 3] =
            [text(&info.manufacturer), text(&info.product), text(&info.serial_number)];
        let state = match answer {
            Ok(version) => format!("Thermyo {}", version_text(version)),
            Err(reason) if (*vid, *pid) == USB_ID => {
                format!("has a board's USB identity and does not answer: {reason}")
            }
            Err(reason) => format!("does not answer as Thermyo: {reason}"),
        };
        Self {
            port,
            device: format!("{vid:04x}:{pid:04x}{manufacturer}{product}{number}"),
            thermyo: answer.is_ok(),
            state,
        }
    }
}

fn waiting(drive: Drive) -> Found {
    let port = drive.path.display().to_string();
    Found {
        state: format!("waits for its firmware: thermyo flash {port}"),
        port,
        device: format!("{} in its boot loader", drive.model),
        thermyo: false,
    }
}
