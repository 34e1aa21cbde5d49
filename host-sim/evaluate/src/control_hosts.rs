//! A heavy load that follows a sine with valves other than those of 100 Hz, and from hosts whose set points come rarely
//! or late.

use super::Figure;
use super::control::{Job, job, rms_mm, sine};
use model_core::{Config, Sample, SetPoint};
use thermyo_setup::Loaded;
use thermyo_simulation::board::{Board, BoardError, BoardStep, CoreBoard};

/// A board whose host sends one of `one_of` set points, each up to `latest_steps` steps late.
pub struct Host {
    board: CoreBoard,
    one_of: u64,
    latest_steps: u64,
    sent: u64,
    /// The next set point, and the number of steps after which it arrives.
    on_its_way: Option<(u64, SetPoint)>,
}

impl Host {
    /// Board of such a host. If every set point arrives and none is late, the board is the core alone.
    pub fn new(one_of: u64, latest_steps: u64) -> Self {
        Self { board: CoreBoard::default(), one_of, latest_steps, sent: 0, on_its_way: None }
    }
}

impl Board for Host {
    fn name(&self) -> &'static str {
        self.board.name()
    }

    fn start(&mut self, config: &Config, set_point: SetPoint) -> Result<(), BoardError> {
        self.board.start(config, set_point)
    }

    fn set(&mut self, set_point: SetPoint) -> Result<(), BoardError> {
        self.sent += 1;
        if self.sent.is_multiple_of(self.one_of) {
            // Neighbours differ, and every delay occurs equally often.
            let late_steps = self.sent / self.one_of * 7 % (self.latest_steps + 1);
            self.on_its_way = Some((late_steps, set_point));
        }
        Ok(())
    }

    fn step(&mut self, sample: &Sample) -> Result<BoardStep, BoardError> {
        self.on_its_way = match self.on_its_way.take() {
            Some((0, set_point)) => {
                self.board.set(set_point)?;
                None
            }
            Some((left, set_point)) => Some((left - 1, set_point)),
            None => None,
        };
        self.board.step(sample)
    }
}

/// The nominal muscle with 20 kg and valves of this frequency, all of it configured.
pub fn heavy(full: &Loaded, pwm_hz: f64) -> Loaded {
    full.with(|s| (s.load.mass_kg, s.valve.pwm_hz) = (20.0, pwm_hz))
}

pub(super) fn jobs(full: &Loaded) -> Vec<Job<'_>> {
    let cases = [
        ("valves at 50 Hz", 50.0, 1, 0, 0.4),
        ("valves at 125 Hz", 125.0, 1, 0, 0.4),
        ("valves at 200 Hz", 200.0, 1, 0, 0.4),
        ("valves at 500 Hz", 500.0, 1, 0, 0.4),
        ("50 set points a second", 100.0, 2, 0, 0.5),
        ("20 set points a second", 100.0, 5, 0, 0.5),
        ("set points up to 3 ms late", 100.0, 1, 3, 0.5),
        ("50 set points a second, up to 4 ms late", 100.0, 2, 4, 0.5),
        ("set points up to 8 ms late", 100.0, 1, 8, 1.0),
    ];
    let jobs = cases.into_iter().map(|(name, pwm_hz, one_of, latest_steps, most_mm)| {
        job(format!("0.5 Hz sine, 20 kg, {name}"), move || {
            let loaded = heavy(full, pwm_hz);
            let followed = sine(&loaded, 0.5, 0.15, &mut Host::new(one_of, latest_steps))?;
            Ok(vec![Figure::at_most("rms_mm", rms_mm(&loaded, &followed), most_mm)])
        })
    });
    jobs.collect()
}
