//! Torque and stiffness of a pair of muscles, and the two pressures for them, in closed form.
//!
//! At a length L a muscle pulls F = P_g A - h, with A = -dV/dL (Chou and Hannaford 1994), and h the force with which
//! bladder, slip and creep hold back. Behind shut valves its gas is a spring: P V^k is constant (eq. 6), so
//!
//! ```text
//! dF/dL  = k P A^2/V + P_g dA/dL + k_b                  P = P_g + P_amb
//! torque = r (F_a - F_b)
//! K      = r^2 sum(P_g kappa + c)        kappa = k A^2/V + dA/dL,  c = k P_amb A^2/V + k_b
//! ```
//!
//! A muscle whose radius s r varies with the angle q acts like another muscle on r ([`Line::new`]):
//!
//! ```text
//! A -> s A    h -> s h    kappa -> s^2 kappa + t A    c -> s^2 c - t h    t = -s'/r (a), s'/r (b)
//! K = sum(r_i^2 dF_i/dL) - r_a' F_a + r_b' F_b
//! ```
//!
//! Both are linear in the two pressures, and their determinant r^3 (A_a kappa_b + A_b kappa_a) is positive, except for
//! a radius that varies faster than gas is stiff. If a pressure is at its limit, torque has priority: the pressures
//! move along the line of equal torque to the nearest possible stiffness.

use super::pulley::Lever;
use crate::config::Config;
use crate::math::limit;
use crate::physics::chamber::Chamber;

/// Smallest area that turns pressure into force \[m2\].
const LEAST_M2: f32 = 1.0e-6;

/// One muscle at a length: its force and stiffness as functions of its gauge pressure.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Line {
    /// Volume \[m3\].
    pub volume_m3: f32,
    /// Force per gauge pressure A \[m2\].
    pub area_m2: f32,
    /// Force that holds the muscle back h \[N\].
    pub held_n: f32,
    /// Stiffness behind shut valves per gauge pressure, kappa \[m\] ...
    pub stiffness_m: f32,
    /// ... and without pressure, c \[N/m\].
    pub stiffness_n_m: f32,
    /// Share of both that belongs to the gas itself, k A^2/V, per absolute pressure \[m\].
    pub gas_m: f32,
}

impl Line {
    /// Describes a muscle at a length \[m\] whose slip and creep hold back `held_n` \[N\], as it acts through its
    /// lever.
    pub fn new(
        config: &Config,
        chamber: &impl Chamber,
        length_m: f32,
        hysteresis_n: f32,
        lever: &Lever,
    ) -> Self {
        let volume_m3 = chamber.volume_m3(length_m);
        let area_m2 = limit(-chamber.volume_slope_m2(length_m), LEAST_M2, f32::MAX);
        let springs = chamber.springs(length_m);
        let gas_m = config.gas.heat_capacity_ratio * area_m2 * area_m2 / volume_m3;
        let mut line = Self {
            volume_m3,
            area_m2,
            held_n: hysteresis_n - springs.force_n,
            stiffness_m: gas_m + springs.stiffness_m,
            stiffness_n_m: gas_m * config.ambient.pressure_pa + springs.stiffness_n_m,
            gas_m,
        };
        if !lever.is_plain() {
            let Lever { share, turn_per_m } = *lever;
            let square = share * share;
            line.stiffness_m = square * line.stiffness_m + turn_per_m * area_m2;
            line.stiffness_n_m = square * line.stiffness_n_m - turn_per_m * line.held_n;
            line.gas_m *= square;
            line.area_m2 *= share;
            line.held_n *= share;
        }
        line
    }

    /// Force on the tendon \[N\], which cannot push.
    pub fn force_n(&self, gauge_pa: f32) -> f32 {
        limit(self.area_m2 * gauge_pa - self.held_n, 0.0, f32::MAX)
    }

    /// Stiffness of the muscle behind shut valves \[N/m\].
    pub fn spring_n_m(&self, gauge_pa: f32) -> f32 {
        self.stiffness_m * gauge_pa + self.stiffness_n_m
    }

    /// Stiffness at constant pressure, for the gauge and absolute pressure \[N/m\].
    pub fn isobaric_n_m(&self, gauge_pa: f32, pressure_pa: f32) -> f32 {
        self.spring_n_m(gauge_pa) - self.gas_m * pressure_pa
    }

    /// Smallest gauge pressure at which the tendon is taut \[Pa\].
    fn taut_pa(&self) -> f32 {
        limit(self.held_n / self.area_m2, 0.0, f32::MAX)
    }
}

/// Torque of a pair \[N m\] at two gauge pressures \[Pa\].
pub fn torque_n_m(radius_m: f32, [a, b]: &[Line; 2], [gauge_a, gauge_b]: [f32; 2]) -> f32 {
    radius_m * (a.force_n(gauge_a) - b.force_n(gauge_b))
}

/// Stiffness of a pair behind shut valves \[N m/rad\] at two gauge pressures \[Pa\].
pub fn stiffness_n_m_rad(radius_m: f32, [a, b]: &[Line; 2], [gauge_a, gauge_b]: [f32; 2]) -> f32 {
    radius_m * radius_m * (a.spring_n_m(gauge_a) + b.spring_n_m(gauge_b))
}

/// Pressures for a torque and a stiffness.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Allocation {
    /// Gauge pressures of a and b \[Pa\].
    pub gauge_pa: [f32; 2],
    /// Whether stiffness or torque had to yield to the limits of pressure.
    pub limited: bool,
}

/// Gauge pressures for a torque \[N m\] and a stiffness \[N m/rad\]; `most_pa`: the highest of each \[Pa\].
///
/// ```
/// use model_core::Config;
/// use model_core::joint::allocation::{Line, allocate, stiffness_n_m_rad, torque_n_m};
/// use model_core::joint::pulley::Lever;
/// use model_core::physics::chamber::AnyChamber;
///
/// let config = Config::default();
/// let line = Line::new(&config, &AnyChamber::new(&config.chamber), 0.27, 0.0, &Lever::PLAIN);
/// let found = allocate(0.02, &[line; 2], [2.0, 14.0], [5.0e5; 2]);
/// assert!((torque_n_m(0.02, &[line; 2], found.gauge_pa) - 2.0).abs() < 1e-3);
/// assert!((stiffness_n_m_rad(0.02, &[line; 2], found.gauge_pa) - 14.0).abs() < 1e-3);
/// ```
pub fn allocate(
    radius_m: f32,
    lines: &[Line; 2],
    [torque_n_m, stiffness_n_m_rad]: [f32; 2],
    [most_a, most_b]: [f32; 2],
) -> Allocation {
    let [a, b] = lines;
    let per_radius = 1.0 / radius_m;
    // A_a P_a - A_b P_b = pull,  kappa_a P_a + kappa_b P_b = spring.
    let pull_n = torque_n_m * per_radius + a.held_n - b.held_n;
    let spring_n_m =
        stiffness_n_m_rad * per_radius * per_radius - a.stiffness_n_m - b.stiffness_n_m;
    let determinant = a.area_m2 * b.stiffness_m + b.area_m2 * a.stiffness_m;
    let wanted_a = (b.stiffness_m * pull_n + b.area_m2 * spring_n_m) / determinant;
    let (least_a, least_b) = (a.taut_pa(), b.taut_pa());
    // Pressures of a at which b is at its limits with this torque.
    let at = |gauge_b: f32| (pull_n + b.area_m2 * gauge_b) / a.area_m2;
    let from = limit(at(least_b), least_a, f32::MAX);
    let to = limit(at(most_b), f32::MIN, most_a);
    if from > most_a {
        return Allocation { gauge_pa: [most_a, least_b], limited: true };
    }
    if to < least_a {
        return Allocation { gauge_pa: [least_a, most_b], limited: true };
    }
    let gauge_a = limit(wanted_a, from, to);
    let gauge_b = limit((a.area_m2 * gauge_a - pull_n) / b.area_m2, least_b, most_b);
    Allocation { gauge_pa: [gauge_a, gauge_b], limited: !(wanted_a >= from && wanted_a <= to) }
}

#[cfg(test)]
mod tests {
    use super::super::config::Mechanism;
    use super::*;
    use crate::physics::chamber::{AnyChamber, ChamberConfig};
    use proptest::prelude::*;

    const RADIUS_M: f32 = 0.02;
    const MOST_PA: [f32; 2] = [5.5e5; 2];

    fn lines(angle_rad: f32, hysteresis_n: [f32; 2]) -> [Line; 2] {
        let config = Config::default();
        let mut other = config;
        if let ChamberConfig::Muscle(muscle) = &mut other.chamber {
            muscle.braid.turns *= 1.1;
            muscle.bladder_saturation_n = 20.0;
        }
        let [of_a, of_b] = hysteresis_n;
        let line = |config: &Config, length_m, held_n| {
            Line::new(config, &AnyChamber::new(&config.chamber), length_m, held_n, &Lever::PLAIN)
        };
        let way_m = RADIUS_M * angle_rad;
        [line(&config, 0.27 - way_m, of_a), line(&other, 0.27 + way_m, of_b)]
    }

    /// The spring of the gas, against the force law with the pressure of an adiabatic change.
    #[test]
    fn stiffness_is_the_slope_of_the_torque_behind_shut_valves() {
        let config = Config::default();
        let chamber = AnyChamber::new(&config.chamber);
        let (length_m, gauge_pa) = (0.27_f32, 1.9e5_f32);
        let line = Line::new(&config, &chamber, length_m, 0.0, &Lever::PLAIN);
        let force_n = |way_m: f32| {
            let at_m = length_m + way_m;
            let ratio = f64::from(line.volume_m3) / f64::from(chamber.volume_m3(at_m));
            let pressure_pa = f64::from(gauge_pa + 101_325.0) * ratio.powf(1.4);
            f64::from(chamber.force_n((pressure_pa - 101_325.0) as f32, at_m))
        };
        let slope = (force_n(2.0e-3) - force_n(-2.0e-3)) / 4.0e-3;
        let spring = f64::from(line.spring_n_m(gauge_pa));
        assert!((spring / slope - 1.0).abs() < 2e-3, "{spring} {slope}");
    }

    /// At fixed pressures, without the spring of the gas: the slope of the torque over the angle.
    #[test]
    fn stiffness_has_the_slope_of_the_radius() {
        let mechanism = Mechanism {
            radius_a_per_rad: -0.2,
            radius_a_per_rad2: 0.05,
            radius_b_share: 1.1,
            radius_b_per_rad: 0.15,
            radius_b_per_rad3: -0.03,
            ..Mechanism::default()
        };
        let mut config = Config::default();
        config.gas.heat_capacity_ratio = 0.0;
        let chamber = AnyChamber::new(&config.chamber);
        let gauge_pa = [2.4e5, 1.7e5];
        let pair = |angle_rad: f32| {
            let [a_m, b_m] = mechanism.lengths_m(angle_rad);
            let [of_a, of_b] = mechanism.levers(angle_rad);
            let line = |length_m, lever| Line::new(&config, &chamber, length_m, 0.0, lever);
            [line(a_m, &of_a), line(b_m, &of_b)]
        };
        let torque = |angle_rad| f64::from(torque_n_m(RADIUS_M, &pair(angle_rad), gauge_pa));
        for angle_rad in [-0.5_f32, 0.0, 0.6] {
            let h = 0.01;
            let slope = (torque(angle_rad - h) - torque(angle_rad + h)) / (2.0 * f64::from(h));
            let stiffness = f64::from(stiffness_n_m_rad(RADIUS_M, &pair(angle_rad), gauge_pa));
            assert!((stiffness / slope - 1.0).abs() < 2e-3, "{stiffness} {slope} at {angle_rad}");
        }
    }

    proptest! {
        /// Within the limits both are met; beyond them torque is met as long as possible, and `limited` is set.
        #[test]
        fn torque_wins(
            angle in -0.7_f32..0.7, torque in -20.0_f32..20.0, stiffness in 0.0_f32..60.0,
            held in prop::array::uniform2(-20.0_f32..20.0),
        ) {
            let lines = lines(angle, held);
            let found = allocate(RADIUS_M, &lines, [torque, stiffness], MOST_PA);
            for (line, gauge_pa) in lines.iter().zip(found.gauge_pa) {
                prop_assert!((0.0..=5.5e5).contains(&gauge_pa), "{found:?}");
                prop_assert!(line.area_m2 * gauge_pa >= line.held_n - 0.5, "{found:?}");
            }
            let given = torque_n_m(RADIUS_M, &lines, found.gauge_pa);
            let spring = stiffness_n_m_rad(RADIUS_M, &lines, found.gauge_pa);
            if !found.limited {
                prop_assert!((given - torque).abs() < 2e-3 * (1.0 + torque.abs()), "{given}");
                prop_assert!((spring / stiffness - 1.0).abs() < 2e-3, "{spring}");
            }
            let [a, b] = &lines;
            let most = RADIUS_M * (a.force_n(5.5e5) - b.force_n(b.taut_pa()));
            let least = RADIUS_M * (a.force_n(a.taut_pa()) - b.force_n(5.5e5));
            let reached = torque.clamp(least, most);
            prop_assert!((given - reached).abs() < 5e-3 * (1.0 + torque.abs()), "{given} {reached}");
        }
    }
}
