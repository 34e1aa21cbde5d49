//! The configured muscles at an angle.

use model_core::joint::JointConfig;
use model_core::joint::allocation::{Line, torque_n_m};
use model_core::physics::chamber::AnyChamber;

pub struct Pair {
    pub angle_rad: f64,
    pub radius_m: f32,
    pub lines: [Line; 2],
    /// Highest gauge pressures \[Pa\].
    pub most_pa: [f32; 2],
}

impl Pair {
    pub fn at(config: &JointConfig, angle_rad: f64) -> Self {
        let angle_f32 = angle_rad as f32;
        let lengths_m = config.mechanism.lengths_m(angle_f32);
        let levers = config.mechanism.levers(angle_f32);
        let line = |i: usize| {
            let muscle = &config.muscles[i];
            let chamber = AnyChamber::new(&muscle.chamber);
            Line::new(muscle, &chamber, lengths_m[i], 0.0, &levers[i])
        };
        let most_pa = config.muscles.each_ref().map(|muscle| {
            muscle.working_limit_pa().min(muscle.supply.pressure_pa) - muscle.ambient.pressure_pa
        });
        Self { angle_rad, radius_m: config.mechanism.radius_m, lines: [line(0), line(1)], most_pa }
    }

    /// Smallest and largest torque \[N m\].
    pub fn torques_n_m(&self) -> [f64; 2] {
        let [a, b] = self.most_pa;
        [[0.0, b], [a, 0.0]]
            .map(|gauge_pa| f64::from(torque_n_m(self.radius_m, &self.lines, gauge_pa)))
    }

    pub fn reaches(&self, torque_n_m: f64) -> bool {
        let [least, most] = self.torques_n_m();
        (least..=most).contains(&torque_n_m)
    }
}
