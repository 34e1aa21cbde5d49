//! Load, friction and mass, from the balance of forces of all that moves.
//!
//! ```text
//! F(P, L) = load + held + friction + d + m a      the chamber's pull and what it works against
//! d       = Q (F - load - held - friction) - m Q a        Q = 1/(tau s + 1),  Q a = (v - Q v)/tau
//! ```
//!
//! d is the force that the configuration does not explain, measured and not integrated: it does not wind up while a
//! valve is fully open. Load and friction separate at a turn: before it only their sum is known, so least squares give
//! each of them half of the change of d after it. Later changes are the load's. The part of d that correlates with the
//! acceleration is mass.

use crate::math::{absolute, limit};

/// tau, in PWM periods. A mass that is believed too small by dm takes dm w/tau from the damping of the load on its gas
/// spring, while the lead adds some 100 N s/m: 8 kg at 5 Hz leave some of it. Twice the periods take twice the time to
/// follow a turn.
const PERIODS: f32 = 5.0;
const GAIN: f32 = 1.0 / (PERIODS + 1.0);
/// Share of the Coulomb force beyond which the muscle slides.
const SLIDES: f32 = 0.8;
/// Share of a change of d that is assigned to friction right after a turn (least squares of two unknowns).
const HALF: f32 = 0.5;
/// Fraction of that share that remains after a period: load and friction are separated after some 20 periods, four tau.
const FADES: f32 = 0.95;
/// A high pass of ten periods keeps slow changes, a load or a wrong stiffness, out of the mass.
const SLOWLY: f32 = 0.1;
/// Share of the weight of earlier accelerations that remains after a period: 200 periods.
const FORGETS: f32 = 0.995;
/// Weight of the configured mass, in squared accelerations \[m2/s4\]: ten times the noise of a speed from two readings
/// that are 0.02 mm off, over 200 periods (0.06 m/s2 behind Q).
const CONFIGURED: f32 = 10.0;
/// Largest mass beyond the configured one \[kg\].
const MOST_KG: f32 = 50.0;

/// Balance of forces over one period. Forces are positive if they oppose the contraction.
#[derive(Debug, Clone, Copy)]
pub struct Balance {
    /// Pull of the chamber at measured pressure and length \[N\].
    pub force_n: f32,
    /// Configured load, slip and creep \[N\].
    pub load_n: f32,
    /// Friction along the reference \[N\].
    pub friction_n: f32,
    /// Largest possible friction \[N\].
    pub coulomb_n: f32,
    /// Speed of the reference's contraction \[m/s\].
    pub reference_m_s: f32,
    /// Mean speed of the contraction since the period before \[m/s\].
    pub speed_m_s: f32,
    /// Configured mass \[kg\].
    pub mass_kg: f32,
    /// PWM frequency \[Hz\].
    pub pwm_hz: f32,
}

/// State of the observer; at rest, with nothing learnt, by default.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct LoadObserver {
    /// Force that nothing configured explains, d \[N\].
    pub disturbance_n: f32,
    /// Coulomb friction beyond the configured one \[N\].
    pub friction_n: f32,
    /// Mass beyond the configured one \[kg\].
    pub mass_kg: f32,
    /// Pull less load and friction in the period before \[N\].
    before_n: f32,
    /// Filtered by Q: force \[N\] and speed \[m/s\].
    filtered_n: f32,
    filtered_m_s: f32,
    /// Filtered by the low pass of the mass: d \[N\] and acceleration \[m/s2\].
    slow_n: f32,
    slow_m_s2: f32,
    /// Sum of squared accelerations \[m2/s4\].
    weight: f32,
    /// Direction in which the muscle last slid.
    side: f32,
    /// Share of a change that is assigned to friction.
    share: f32,
}

impl LoadObserver {
    /// Coulomb friction, for this configured friction \[N\].
    pub fn coulomb_n(&self, configured_n: f32) -> f32 {
        limit(configured_n + self.friction_n, 0.0, f32::MAX)
    }

    /// Continues from rest with this disturbance \[N\]; the learnt friction and mass stay.
    pub fn restart(&mut self, disturbance_n: f32) {
        *self = Self {
            disturbance_n,
            friction_n: self.friction_n,
            mass_kg: self.mass_kg,
            before_n: disturbance_n,
            filtered_n: disturbance_n,
            slow_n: disturbance_n,
            weight: self.weight,
            side: self.side,
            ..Self::default()
        };
    }

    /// Runs one PWM period; the disturbance stays within `least_n` and `most_n`.
    pub fn period(&mut self, balance: &Balance, [least_n, most_n]: [f32; 2]) {
        let Balance { force_n, load_n, friction_n, speed_m_s, mass_kg, pwm_hz, .. } = *balance;
        // The speed is the mean over the period, and so is the force: both have the same delay.
        let left_n = force_n - load_n - friction_n;
        self.filtered_n += GAIN * (0.5 * (left_n + self.before_n) - self.filtered_n);
        self.before_n = left_n;
        self.filtered_m_s += GAIN * (speed_m_s - self.filtered_m_s);
        let acceleration_m_s2 = (speed_m_s - self.filtered_m_s) * (pwm_hz * (1.0 / PERIODS));
        self.learn_mass(mass_kg, acceleration_m_s2);
        let before_n = self.disturbance_n;
        let disturbance_n = self.filtered_n - (mass_kg + self.mass_kg) * acceleration_m_s2;
        self.disturbance_n = limit(disturbance_n, least_n, most_n);
        if absolute(friction_n) >= SLIDES * balance.coulomb_n {
            self.learn_friction(balance, before_n, most_n);
        }
    }

    /// Recursive least squares of the mass, from changes within ten periods.
    fn learn_mass(&mut self, configured_kg: f32, acceleration_m_s2: f32) {
        let unexplained_n =
            self.filtered_n - (configured_kg + self.mass_kg) * acceleration_m_s2 - self.slow_n;
        let excited_m_s2 = acceleration_m_s2 - self.slow_m_s2;
        self.slow_n += SLOWLY * unexplained_n;
        self.slow_m_s2 += SLOWLY * excited_m_s2;
        self.weight = FORGETS * self.weight + excited_m_s2 * excited_m_s2;
        let more_kg = excited_m_s2 * unexplained_n / (self.weight + CONFIGURED);
        self.mass_kg = limit(self.mass_kg + more_kg, -configured_kg, MOST_KG);
    }

    /// Assigns to friction its share of the change of the disturbance; their sum stays.
    fn learn_friction(&mut self, balance: &Balance, before_n: f32, most_n: f32) {
        let way = balance.reference_m_s;
        if way == 0.0 {
            return;
        }
        let side = if way > 0.0 { 1.0 } else { -1.0 };
        if side * self.side < 0.0 {
            self.share = HALF;
        }
        self.side = side;
        let more_n = side * self.share * (self.disturbance_n - before_n);
        let more_n =
            limit(more_n, -balance.coulomb_n, limit(most_n - self.friction_n, 0.0, most_n));
        self.friction_n += more_n;
        self.filtered_n -= side * more_n;
        self.disturbance_n -= side * more_n;
        self.share *= FADES;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const PWM_HZ: f32 = 100.0;
    const MOST_N: [f32; 2] = [-300.0, 300.0];

    /// At rest, with friction of 15 N in contraction.
    const AT_REST: Balance = Balance {
        force_n: 115.0,
        load_n: 100.0,
        friction_n: 15.0,
        coulomb_n: 15.0,
        reference_m_s: 0.0,
        speed_m_s: 0.0,
        mass_kg: 2.0,
        pwm_hz: PWM_HZ,
    };

    /// A load step is seen at half its size at once, then through Q: a sixth of the rest per period.
    #[test]
    fn a_load_is_seen_within_its_time() {
        for step_n in [-50.0, 50.0_f32] {
            let mut observer = LoadObserver::default();
            let stepped = Balance { force_n: AT_REST.force_n + step_n, ..AT_REST };
            for n in 1..30 {
                observer.period(&stepped, MOST_N);
                let left = (5.0_f32 / 6.0).powi(n);
                let expected_n = step_n * (1.0 - left - 0.5 * left / 5.0);
                let is_n = observer.disturbance_n;
                assert!((is_n - expected_n).abs() < 0.01 * step_n.abs(), "{is_n}, {expected_n} N");
            }
            assert_eq!(observer.friction_n, 0.0, "nothing has turned");
            let little = if step_n > 0.0 { [-300.0, 20.0] } else { [-20.0, 300.0] };
            observer.period(&stepped, little);
            assert_eq!(observer.disturbance_n.abs(), 20.0, "within its limits");
        }
    }

    /// Strokes to and fro at `hz`, with this load beside 100 N, and with friction and mass that differ from the
    /// configured ones. Returns the observer and the largest difference between disturbance and load after four strokes
    /// \[N\].
    fn strokes(load_n: f32, friction_n: f32, mass_kg: f32, hz: f32) -> (LoadObserver, f32) {
        let mut observer = LoadObserver::default();
        let (mut before_n, mut off_n) = (0.0, 0.0_f32);
        let way = |time_s: f32| 4.5e-3 * (core::f32::consts::TAU * hz * time_s).sin();
        for period in 1..(4.0 * PWM_HZ / hz) as u16 {
            let time_s = f32::from(period) / PWM_HZ;
            let step_s = 1.0 / PWM_HZ;
            let speed_m_s = (way(time_s) - way(time_s - step_s)) / step_s;
            let rate = core::f32::consts::TAU * hz;
            let inertia_n = -mass_kg * rate * rate * way(time_s);
            let side = speed_m_s.signum();
            let balance = Balance {
                force_n: 100.0 + load_n + side * friction_n + inertia_n,
                friction_n: side * observer.coulomb_n(15.0),
                coulomb_n: observer.coulomb_n(15.0),
                reference_m_s: speed_m_s,
                speed_m_s,
                ..AT_REST
            };
            observer.period(&balance, MOST_N);
            // After half a stroke.
            if side == before_n && period > (3.0 * PWM_HZ / hz) as u16 && way(time_s).abs() < 2e-3 {
                off_n = off_n.max((observer.disturbance_n - load_n).abs());
            }
            before_n = side;
        }
        (observer, off_n)
    }

    proptest! {
        /// Load and friction are separated by the turns, whatever their values.
        #[test]
        fn load_and_friction_come_apart(load_n in -80.0_f32..80.0, friction_n in 0.5_f32..60.0) {
            let (observer, off_n) = strokes(load_n, friction_n, 2.0, 0.5);
            let found_n = 15.0 + observer.friction_n;
            prop_assert!((found_n - friction_n).abs() < 1.0 + 0.1 * (friction_n - 15.0).abs(), "{found_n} N");
            prop_assert!(off_n < 1.0 + 0.1 * (friction_n - 15.0).abs(), "{off_n} N");
        }

        /// A mass shows where it is accelerated: a third of it, give or take a kilogram, within four strokes; slow
        /// strokes show nothing.
        #[test]
        fn a_mass_shows_in_its_acceleration(mass_kg in 0.5_f32..20.0) {
            let (observer, _) = strokes(0.0, 15.0, mass_kg, 2.0);
            let found_kg = 2.0 + observer.mass_kg;
            prop_assert!((found_kg - mass_kg).abs() < 0.65 * (mass_kg - 2.0).abs() + 1.0, "{found_kg} kg");
            let (slow, _) = strokes(0.0, 15.0, mass_kg, 0.2);
            prop_assert!(slow.mass_kg.abs() < 0.5, "{} kg", slow.mass_kg);
        }

        #[test]
        fn whatever_comes_it_stays_within_its_limits(
            bits in prop::collection::vec((-1.0e3_f32..1.0e3, -2.0_f32..2.0), 100),
        ) {
            let mut observer = LoadObserver::default();
            for (force_n, speed_m_s) in bits {
                let reference_m_s = speed_m_s;
                let coulomb_n = observer.coulomb_n(15.0);
                let balance = Balance { force_n, speed_m_s, reference_m_s, coulomb_n, ..AT_REST };
                observer.period(&balance, MOST_N);
                let LoadObserver { disturbance_n, friction_n, mass_kg, .. } = observer;
                prop_assert!((-15.001..=300.0).contains(&friction_n), "{friction_n} N");
                prop_assert!(disturbance_n.abs() <= 600.0 && (-2.0..=50.0).contains(&mass_kg));
            }
        }
    }
}
