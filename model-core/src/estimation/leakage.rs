//! Gas that passes two shut valves: a leak that is not configured, or a valve that is not tight.
//!
//! While both valves are shut, the mass is taken to stay as it is. Gas that is lost then looks like gas that cools, and the
//! gas sensor seems to contradict it. The balance tells them apart much as the plausibility monitor does
//! (`safety/plausibility.rs`): what no heat transfer between none and twice the believed one explains has come or gone,
//!
//! ```text
//! lost'   = (1 - D/t) lost   - most_gained       over a window D without flow, 0 at least
//! gained' = (1 - D/t) gained + least_gained
//! ```
//!
//! Beyond [`EVIDENT`] the energy balance moves the mass with shut valves as it does with open ones.

use crate::math::{is_above, limit};

/// Time for which it is remembered \[s\]: longer than gas takes to its wall's temperature, so that a slow leak adds
/// up, and shorter than a wall takes to ambient. An assumption.
const REMEMBERED_S: f32 = 20.0;
/// Gas that is missing or too much before it is a leak, share of what is there \[-\]: mistaken heat transfer may
/// amount to as much, 1.5 K. An assumption. A leak of 0.04 % a second adds up to it in the end.
const EVIDENT: f32 = 0.005;
/// Most of it that is remembered: once the leak has ended, it counts for 14 s.
const MOST: f32 = 2.0 * EVIDENT;

/// More than that in a window is a burst, or a reading that jumps, and no leak to follow \[1/s\]. An assumption.
const FASTEST_PER_S: f32 = 0.3;

/// Way of gas through shut valves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Way {
    In,
    Out,
}

/// Gas that has passed two shut valves, as far as it is remembered, share of what is there \[-\].
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Leakage {
    lost: f32,
    gained: f32,
    /// Set once it is evident. Every step asks for it.
    pub way: Option<Way>,
}

impl Leakage {
    /// Takes the least and the most share of the gas that it can have gained in a window without flow.
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

    /// After so many windows of 20 ms, in each of which the gas gained between these shares a second.
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

    /// A pressure that is no number leaves sums that are.
    #[test]
    fn sums_stay_numbers() {
        for share in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            let Leakage { lost, gained, .. } = after(3, [share, share]);
            assert!((0.0..=MOST).contains(&lost) && (0.0..=MOST).contains(&gained));
        }
    }
}
