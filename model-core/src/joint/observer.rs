//! Speed and disturbance of the joint, from its angle and the torque of its muscles.
//!
//! ```text
//! J q'' = torque - gravity - viscous q' - friction + d
//! ```
//!
//! A Luenberger observer of angle, speed and d. The pole of d is slower than the other two: with an inertia believed
//! twice too large, d follows the acceleration, and its compensation comes late. Dry friction is part of the model, as
//! a play: it grows with the way since the last turn, up to its Coulomb value, so that d contains none of it at a turn.

use super::config::{JointTuning, Mechanism};
use crate::math::limit;

/// Largest share of the speed by which a step of the play changes it \[-\].
const STIFFEST: f32 = 0.05;
/// Largest share of the speed that viscous friction takes in a step: above 2 the speed would grow from step to step; it
/// is what nothing explains then that contains the rest \[-\].
const MOST_DAMPED: f32 = 0.5;

/// Friction of the whole joint, with presliding.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Friction {
    /// Coulomb torque \[N m\].
    pub coulomb_n_m: f32,
    /// Torque per way after a turn \[N m/rad\].
    pub presliding_n_m_rad: f32,
    /// Viscous torque in addition, per speed \[N m s/rad\].
    pub viscous_n_m_s: f32,
}

impl Friction {
    /// Torque after a way \[rad\] from `before_n_m` \[N m\], positive against growing angles.
    pub fn after(&self, before_n_m: f32, way_rad: f32) -> f32 {
        let torque_n_m = before_n_m + self.presliding_n_m_rad * way_rad;
        limit(torque_n_m, -self.coulomb_n_m, self.coulomb_n_m)
    }
}

/// State of the observer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Observer {
    step_s: f32,
    per_inertia: f32,
    /// Stiffest play that a step resolves \[N m/rad\].
    stiffest_n_m_rad: f32,
    /// Gains of angle \[1/s\], speed \[1/s2\] and disturbance \[N m/(rad s)\].
    gains: [f32; 3],
    angle_rad: f32,
    /// Speed \[rad/s\].
    pub speed_rad_s: f32,
    /// Torque that nothing configured explains, positive towards growing angles \[N m\].
    pub disturbance_n_m: f32,
    /// Friction along the observed motion \[N m\].
    friction_n_m: f32,
}

impl Observer {
    /// An observer at rest.
    pub fn new(mechanism: &Mechanism, tuning: &JointTuning, step_s: f32) -> Self {
        let JointTuning { observer_rad_s: p, disturbance_rad_s: slow, .. } = *tuning;
        let inertia_kg_m2 = mechanism.inertia_kg_m2;
        Self {
            step_s,
            per_inertia: 1.0 / inertia_kg_m2,
            stiffest_n_m_rad: STIFFEST * inertia_kg_m2 / (step_s * step_s),
            // (s + p)^2 (s + slow).
            gains: [2.0 * p + slow, p * (p + 2.0 * slow), inertia_kg_m2 * p * p * slow],
            angle_rad: 0.0,
            speed_rad_s: 0.0,
            disturbance_n_m: 0.0,
            friction_n_m: 0.0,
        }
    }

    /// Restarts at rest at this angle \[rad\].
    pub fn restart(&mut self, angle_rad: f32) {
        *self =
            Self { angle_rad, speed_rad_s: 0.0, disturbance_n_m: 0.0, friction_n_m: 0.0, ..*self };
    }

    /// The part of a viscous friction that a step resolves \[N m s/rad\].
    pub fn resolved(&self, viscous_n_m_s: f32) -> f32 {
        let most_n_m_s = MOST_DAMPED / STIFFEST * self.stiffest_n_m_rad * self.step_s;
        if viscous_n_m_s > most_n_m_s { most_n_m_s } else { viscous_n_m_s }
    }

    /// Runs one step with the measured angle \[rad\] and the torque of muscles and gravity \[N m\]; viscous friction is
    /// [resolved](Self::resolved).
    pub fn step(&mut self, angle_rad: f32, torque_n_m: f32, friction: &Friction) {
        let [of_angle, of_speed, of_disturbance] = self.gains;
        let error_rad = angle_rad - self.angle_rad;
        let presliding_n_m_rad = limit(friction.presliding_n_m_rad, 0.0, self.stiffest_n_m_rad);
        let play = Friction { presliding_n_m_rad, ..*friction };
        let way_rad = self.step_s * (self.speed_rad_s + of_angle * error_rad);
        self.friction_n_m = play.after(self.friction_n_m, way_rad);
        let viscous_n_m = friction.viscous_n_m_s * self.speed_rad_s;
        let net_n_m = torque_n_m - viscous_n_m - self.friction_n_m + self.disturbance_n_m;
        self.angle_rad += way_rad;
        self.speed_rad_s += self.step_s * (self.per_inertia * net_n_m + of_speed * error_rad);
        self.disturbance_n_m += self.step_s * of_disturbance * error_rad;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An arm on a spring of 20 N m/rad that carries 1.5 N m more than believed, against dry friction.
    #[test]
    fn it_finds_the_speed_and_what_nothing_explains() {
        let mechanism = Mechanism::default();
        let mut observer = Observer::new(&mechanism, &JointTuning::default(), 1.0e-3);
        let friction = Friction { coulomb_n_m: 0.4, presliding_n_m_rad: 60.0, viscous_n_m_s: 0.05 };
        let (mut angle, mut speed, mut held) = (0.1_f64, 0.0_f64, 0.0_f32);
        observer.restart(angle as f32);
        let mut worst = 0.0_f64;
        for step in 0..3000 {
            let t = f64::from(step) * 1.0e-3;
            let torque = -20.0 * angle + 3.0 * (6.0 * t).sin() - 1.5;
            observer.step(angle as f32, torque as f32, &friction);
            let way = speed * 1.0e-3;
            held = friction.after(held, way as f32);
            let net = torque + 1.5 - 0.05 * speed - f64::from(held);
            angle += way;
            speed += 1.0e-3 * net / 0.02;
            if step > 500 {
                worst = worst.max((f64::from(observer.speed_rad_s) - speed).abs());
                assert!((observer.disturbance_n_m - 1.5).abs() < 0.2, "{observer:?} at {t}");
            }
        }
        assert!((1e-7..0.01).contains(&worst), "{worst} rad/s");
    }

    /// Viscous friction that is large for a light arm made the observed speed and disturbance grow without bound.
    #[test]
    fn it_is_stable_for_every_inertia_and_friction() {
        for inertia_kg_m2 in [1e-6, 2e-5, 1e-3, 0.02, 10.0] {
            for viscous_n_m_s in [0.0, 1e-3, 0.05, 1.0, 100.0] {
                let mechanism = Mechanism { inertia_kg_m2, ..Mechanism::default() };
                let mut observer = Observer::new(&mechanism, &JointTuning::default(), 1.0e-3);
                let viscous_n_m_s = observer.resolved(viscous_n_m_s);
                let friction = Friction { viscous_n_m_s, ..Friction::default() };
                observer.restart(0.1);
                // An arm that stands, on which 0.1 N m act that something holds.
                let mut last = 0.0;
                for _ in 0..5000 {
                    observer.step(0.1, 0.1, &friction);
                    last = observer.disturbance_n_m;
                    assert!(last.abs() < 1.0, "{inertia_kg_m2}, {viscous_n_m_s}: {last} N m");
                }
                assert!((last + 0.1).abs() < 1e-3, "{inertia_kg_m2}, {viscous_n_m_s}: {last} N m");
                // Rounding of the torque, in a step of 1 ms, and of the angle.
                let rounding_rad_s = 1.0e-6 / inertia_kg_m2 + 1.0e-5;
                assert!(observer.speed_rad_s.abs() < rounding_rad_s, "{observer:?}");
            }
        }
    }
}
