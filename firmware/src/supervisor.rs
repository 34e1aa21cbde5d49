//! Feeds the watchdog while control is alive and on time, and shows the board's state.
//!
//! | LED | state |
//! |---|---|
//! | on, off shortly every second | runs |
//! | off, on shortly every second | waits for its configuration |
//! | five flashes a second | a fault holds or is latched; the fault output is high |
//! | three flashes, a pause | the last restart came from watchdog, panic or hard fault |
//! | dark or frozen | no firmware, or it hangs: the watchdog restarts the board within 50 ms |

use crate::shared::Shared;
use core::sync::atomic::Ordering;
use embassy_time::{Duration, Ticker};
use embedded_hal::digital::OutputPin;
use model_core::Faults;
use thermyo_protocol::LastReset;

const LOOK: Duration = Duration::from_millis(20);

/// Length of an LED pattern, in ticks: one second.
const PATTERN: u32 = 50;

pub async fn run<O: OutputPin>(
    feed: fn(),
    [mut led, mut fault_output]: [O; 2],
    last_reset: LastReset,
    shared: &'static Shared,
) -> ! {
    let mut looks = Ticker::every(LOOK);
    let mut heartbeat = shared.heartbeat.load(Ordering::Relaxed);
    let mut missed_steps = 0;
    let mut look = 0_u32;
    loop {
        looks.next().await;
        let beat = shared.heartbeat.load(Ordering::Relaxed);
        let missed = shared.tally().missed_steps;
        if beat != heartbeat && missed == missed_steps {
            feed();
        }
        heartbeat = beat;
        missed_steps = missed;

        let waits = shared.faults().intersects(Faults::NOT_CONFIGURED);
        let fault = !matches!(shared.faults(), Faults::NONE | Faults::NOT_CONFIGURED);
        let lit = match (fault, last_reset) {
            (true, _) => look % 10 < 5,
            (false, LastReset::Power) => (look < PATTERN - 5) != waits,
            (false, _) => look < 30 && look % 10 < 5,
        };
        // A pin of this chip cannot fail.
        let _ = led.set_state(lit.into());
        let _ = fault_output.set_state(fault.into());
        look = (look + 1) % PATTERN;
    }
}
