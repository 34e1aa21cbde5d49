//! Gas that passes two shut valves: a leak that is not configured, or a valve that leaks.
//!
//! While both valves are shut, the mass is assumed constant. Lost gas then looks like gas that cools, and the gas
//! sensor seems to contradict it. The balance distinguishes the two much as the plausibility monitor does
//! (`safety/plausibility.rs`): a change that no heat transfer between none and twice the believed one explains is gas
//! that has come or gone,
//!
//! ```text
//! lost'   = (1 - D/t) lost   - most_gained       over a window D without flow, 0 at least
//! gained' = (1 - D/t) gained + least_gained
//! ```
//!
//! Beyond [`EVIDENT`] the energy balance moves the mass with shut valves as it does with open ones.

use crate::math::{is_above, limit};

/// Time for which the leak is remembered \[s\]: longer than gas takes to reach its wall's temperature, so that a slow
/// leak adds up, and shorter than a wall takes to reach ambient. An assumption.
const REMEMBERED_S: f32 = 20.0;
/// Missing or excess gas that counts as a leak, share of the gas in the chamber \[-\]: wrong heat transfer may amount
/// to as much, 1.5 K. An assumption. A leak of 0.04 % a second adds up to it in the end.
const EVIDENT: f32 = 0.005;
/// Largest share that is remembered: after the leak has ended, it counts for another 14 s.
const MOST: f32 = 2.0 * EVIDENT;

/// A faster change within a window is a burst or a jump of the reading, not a leak to follow \[1/s\]. An assumption.
const FASTEST_PER_S: f32 = 0.3;

/// Direction of gas through shut valves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Way {
    In,
    Out,
}

/// Remembered gas that has passed two shut valves, share of the gas in the chamber \[-\].
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Leakage {
    lost: f32,
    gained: f32,
    /// Set once the leak is evident. Read in every step.
    pub way: Option<Way>,
}

impl Leakage {
    /// Adds the smallest and the largest share of the gas that may have come in during a window without flow.
    pub fn add(&mut self, [least_gained, most_gained]: [f32; 2], window_s: f32) {
        let forgotten = window_s * (1.0 / REMEMBERED_S);
        let add = |sum: f32, more: f32| {
            let more = if is_above(more, FASTEST_PER_S * window_s) { 0.0 } else { more };
            limit(sum - forgotten * sum + more, 0.0, MOST)
        };
        self.lost = add(self.lost, -most_gained);
        self.gained = add(self.gained, least_gained);
        let (most, way) =
            if self.gained > self.lost { (self.gained, Way::In) } else { (self.lost, Way::Out) };
        self.way = is_above(most, EVIDENT).then_some(way);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// State after this many windows of 20 ms, in each of which the gas gained between these shares per second.
    fn after(windows: u16, [least, most]: [f32; 2]) -> Leakage {
        let mut leakage = Leakage::default();
        (0..windows).for_each(|_| leakage.add([0.02 * least, 0.02 * most], 0.02));
        leakage
    }

    #[test]
    fn a_leak_of_a_share_a_second_is_evident_within_a_second_either_way() {
        let lost = after(50, [-0.014, -0.01]);
        assert_eq!(lost.way, Some(Way::Out));
        let gained = after(50, [0.01, 0.014]);
        assert_eq!(gained.way, Some(Way::In));
        assert_eq!(after(20, [-0.014, -0.01]).way, None);
    }

    #[test]
    fn what_heat_explains_and_a_leak_too_slow_never_are() {
        assert_eq!(after(u16::MAX, [-0.01, 0.01]).way, None);
        assert_eq!(after(u16::MAX, [-0.0003, -0.0002]).way, None);
        assert_eq!(after(u16::MAX, [-0.0004, -0.0003]).way, Some(Way::Out));
    }

    /// A pressure that is not a number leaves finite sums.
    #[test]
    fn sums_stay_numbers() {
        for share in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            let Leakage { lost, gained, .. } = after(3, [share, share]);
            assert!((0.0..=MOST).contains(&lost) && (0.0..=MOST).contains(&gained));
        }
    }
}
