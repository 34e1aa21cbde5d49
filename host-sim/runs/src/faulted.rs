//! Parts of a report on a run in which the core found faults, on a board or in this process.

use super::run_report::{SummaryRow, capitalised};
use thermyo_files::units::UnitSystem;
use thermyo_record::summary::{CoreFigures, Found};
use thermyo_record::tracking::Control;
use thermyo_report::page::Tile;

#[derive(Debug, Clone, Copy)]
pub struct Faulted<'a>(pub &'a CoreFigures);

impl Faulted<'_> {
    /// First sentence of the page; empty without a fault.
    pub fn lead(self) -> String {
        self.0.fault_text().map_or_else(String::new, |text| format!("The core {text}. "))
    }

    /// Sentence on the tracking of the set point.
    pub fn control(self, control: &Control) -> String {
        let what = control.quantity.name().to_lowercase();
        let error = control.quantity.text(control.followed.rms_error, UnitSystem::Practical);
        if self.0.vented_s.is_some() {
            format!("The {what} misses its set point by {error} (RMS), the vented time included. ")
        } else {
            let why = &control.diagnosis;
            format!("The {what} follows its set point with an error of {error} (RMS); {why}. ")
        }
    }

    pub fn tiles(self) -> impl Iterator<Item = Tile> {
        self.0
            .found()
            .map(|found| Tile::new(&label(&found), found.from_s, "s").target("none", false))
    }

    /// Tile of the tracking error, which is not reliable if the muscle vented.
    pub fn tracking(self, control: &Control) -> Tile {
        let unit = control.quantity.unit();
        let tile =
            Tile::new("Tracking error, RMS", control.followed.rms_error * unit.factor, unit.symbol);
        if self.0.vented_s.is_some() { tile.target("not vented", false) } else { tile }
    }

    pub fn rows(self) -> impl Iterator<Item = SummaryRow> {
        self.0.found().map(|found| SummaryRow {
            label: label(&found),
            value: found.from_s,
            unit: "s".to_owned(),
        })
    }
}

fn label(Found { what, faults, .. }: &Found) -> String {
    format!("{} from: {faults}", capitalised(what))
}
