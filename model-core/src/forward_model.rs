//! The paper's simulation model, forward: mass flows in, pressure, length and temperatures out.
//!
//! One homogeneous gas volume under a quasi-static load, the full energy balance (3), heat to the wall and from there
//! to ambient, friction heat, and the lag of the sensor. It runs on mass flows alone, without a measurement to correct
//! it: the "model" of Fig. 5.

use crate::config::{Config, Load};
use crate::math::{absolute, limit};
use crate::parameter::ConfigError;
use crate::physics::balance::{Exchange, GasState};
use crate::physics::chamber::{AnyChamber, Chamber};
use crate::physics::heat::lag_step;
use crate::physics::hysteresis::{Held, Law};

/// State of the model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Model {
    config: Config,
    chamber: AnyChamber,
    gas: GasState,
    length_m: f32,
    hysteresis: Law,
    held: Held,
    wall_k: f32,
    sensor_k: f32,
}

impl Model {
    /// Creates a model at rest at an absolute pressure and one temperature everywhere.
    ///
    /// ```
    /// use model_core::Config;
    /// use model_core::forward_model::Model;
    ///
    /// let model = Model::new(&Config::default(), 2.0e5, 298.0, 0.28)?;
    /// assert!((model.pressure_pa() / 2.0e5 - 1.0).abs() < 1.0e-5);
    /// # Ok::<(), model_core::ConfigError>(())
    /// ```
    ///
    /// # Errors
    /// [`ConfigError`] as [`Config::check`].
    pub fn new(
        config: &Config,
        pressure_pa: f32,
        temperature_k: f32,
        length_m: f32,
    ) -> Result<Self, ConfigError> {
        config.check()?;
        let chamber = AnyChamber::new(&config.chamber);
        let length_m = chamber.limit_length_m(length_m);
        Ok(Self {
            config: *config,
            chamber,
            gas: GasState::new(
                &config.gas,
                pressure_pa,
                temperature_k,
                chamber.volume_m3(length_m),
            ),
            length_m,
            hysteresis: Law::new(&config.hysteresis, config.step_s),
            held: Held::default(),
            wall_k: temperature_k,
            sensor_k: temperature_k,
        })
    }

    /// Absolute pressure \[Pa\].
    pub fn pressure_pa(&self) -> f32 {
        self.gas.pressure_pa(&self.config.gas, self.chamber.volume_m3(self.length_m))
    }

    /// Gas temperature \[K\].
    pub fn gas_k(&self) -> f32 {
        self.gas.temperature_k(&self.config.gas)
    }

    /// Wall temperature \[K\].
    pub fn wall_k(&self) -> f32 {
        self.wall_k
    }

    /// Temperature of the lagging sensor \[K\].
    pub fn sensor_k(&self) -> f32 {
        self.sensor_k
    }

    /// Length \[m\].
    pub fn length_m(&self) -> f32 {
        self.length_m
    }

    /// Gas mass \[kg\].
    pub fn mass_kg(&self) -> f32 {
        self.gas.mass_kg()
    }

    /// Advances by one fixed step with mean mass flows \[kg/s\], both positive. `held_length_m` is the length at the
    /// end of the step if something other than the load sets it \[m\].
    pub fn step(&mut self, inflow_kg_s: f32, outflow_kg_s: f32, held_length_m: Option<f32>) {
        let step_s = self.config.step_s;
        let heat = &self.config.heat;
        let length_m = match held_length_m {
            Some(held_m) => self.chamber.limit_length_m(held_m),
            None => self.balance_length_m(),
        };
        let way_m = self.length_m - length_m;
        let speed_m_s = -way_m / step_s;
        let surface_m2 = self.chamber.surface_m2(length_m);
        // A change that would be over within a step takes a whole step, no more gas leaves than there is, and none
        // below half of ambient pressure: a wrong configuration makes the model wrong, but keeps it finite.
        let gas_j_k = self.gas.mass_kg() * self.config.gas.cv_j_kg_k();
        let wall_j_k = self.config.wall.heat_capacity_j_k;
        let at_most_w_k = limit(gas_j_k, 0.0, wall_j_k) / step_s;
        let exchange = Exchange {
            inflow_kg_s,
            inflow_temperature_k: self.config.supply.temperature_k,
            outflow_kg_s: limit(outflow_kg_s, 0.0, self.free_outflow_kg_s()),
            wall_w_k: limit(heat.inner_w_k(surface_m2, inflow_kg_s), 0.0, at_most_w_k),
            wall_temperature_k: self.wall_k,
            volume_start_m3: self.chamber.volume_m3(self.length_m),
            volume_end_m3: self.chamber.volume_m3(length_m),
        };
        let to_wall_j = self.gas.step(&self.config.gas, &exchange, step_s);
        self.length_m = length_m;
        let outer_w_k = limit(heat.outer_w_k(surface_m2, speed_m_s), 0.0, wall_j_k / step_s);
        let to_ambient_w = outer_w_k * (self.wall_k - self.config.ambient.temperature_k);
        let friction_j = self.rub(way_m);
        self.wall_k += (to_wall_j + friction_j - to_ambient_w * step_s) / wall_j_k;
        self.sensor_k =
            lag_step(self.sensor_k, self.gas_k(), self.config.sensors.gas.time_constant_s, step_s);
    }

    /// Highest flow that can leave within a step \[kg/s\]: half of the gas, and none below half of ambient pressure.
    /// Measured flows with errors may empty the model to a little less than ambient pressure.
    fn free_outflow_kg_s(&self) -> f32 {
        if self.pressure_pa() > 0.5 * self.config.ambient.pressure_pa {
            0.5 * self.gas.mass_kg() / self.config.step_s
        } else {
            0.0
        }
    }

    /// Moves slip and creep by a step's contraction; returns the heat that they and friction give to the wall \[J\].
    fn rub(&mut self, way_m: f32) -> f32 {
        let (config, hysteresis) = (&self.config, &self.hysteresis);
        let softening = config.friction.softening(self.wall_k);
        let gauge_pa = self.pressure_pa() - config.ambient.pressure_pa;
        let held = hysteresis.after(&self.held, way_m, gauge_pa, softening);
        let slip_j = hysteresis.heat_j(&self.held, &held, way_m);
        self.held = held;
        let friction_n =
            softening * config.friction.force_n * config.friction.at_pressure(gauge_pa);
        config.friction.heat_fraction * (slip_j + friction_n * absolute(way_m))
    }

    /// Length at which load and chamber balance, with Coulomb friction: the length stays while friction can hold it (a
    /// play operator).
    fn balance_length_m(&self) -> f32 {
        let chamber = &self.chamber;
        if !chamber.moves() {
            return self.length_m;
        }
        match self.config.load {
            Load::Isometric { length_m } => chamber.limit_length_m(length_m),
            Load::Isotonic { force_n } => {
                let pressure_pa = self.pressure_pa();
                let gauge_pa = pressure_pa - self.config.ambient.pressure_pa;
                let friction = &self.config.friction;
                let friction_n = friction.force_n(self.wall_k) * friction.at_pressure(gauge_pa);
                // As at the end of a step without motion.
                let softening = self.config.friction.softening(self.wall_k);
                let held = self.hysteresis.after(&self.held, 0.0, gauge_pa, softening);
                let excess_n = chamber.force_n(gauge_pa, self.length_m) - held.force_n() - force_n;
                let unbalanced_n = excess_n - limit(excess_n, -friction_n, friction_n);
                // One Newton step; the gas counts as an adiabatic spring meanwhile, or the length would overshoot what
                // the pressure can follow.
                let slope_m2 = chamber.volume_slope_m2(self.length_m);
                let gas_n_m =
                    self.config.gas.heat_capacity_ratio * pressure_pa * slope_m2 * slope_m2
                        / chamber.volume_m3(self.length_m);
                let stiffness_n_m = chamber.stiffness_n_m(gauge_pa, self.length_m)
                    + gas_n_m
                    + self.hysteresis.stiffness_n_m();
                chamber.limit_length_m(self.length_m - unbalanced_n / stiffness_n_m)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::physics::chamber::{ChamberConfig, Cylinder};

    #[test]
    fn working_cycle_swings_warms_and_closes() {
        let mut model = Model::new(&Config::default(), 120_000.0, 298.0, 0.3).unwrap();
        let mass = model.mass_kg();
        let (mut low, mut high) = (f32::MAX, f32::MIN);
        for step in 0..100_000 {
            let filling = step % 5000 < 2500;
            model.step(
                if filling { 3.6e-4 } else { 0.0 },
                if filling { 0.0 } else { 3.6e-4 },
                None,
            );
            low = low.min(model.gas_k());
            high = high.max(model.gas_k());
        }
        assert!((model.mass_kg() / mass - 1.0).abs() < 1e-4, "as much in as out");
        assert!((270.0..295.0).contains(&low) && (302.0..330.0).contains(&high), "{low} {high}");
        assert!((298.1..303.0).contains(&model.wall_k()), "{}", model.wall_k());
        // Except for friction and creep.
        assert!((0.28..0.295).contains(&model.length_m()), "near rest: {}", model.length_m());
    }

    /// More flows out than the configured gas weighs, as with a gas constant that is 15 times too high.
    #[test]
    fn a_flow_that_empties_the_model_leaves_it_finite() {
        let mut config = Config::default();
        config.gas.gas_constant_j_kg_k *= 15.0;
        let mut model = Model::new(&config, 1.2e5, 298.0, 0.3).unwrap();
        for _ in 0..1000 {
            model.step(0.0, 3.0e-4, None);
            assert!((200.0..400.0).contains(&model.gas_k()), "{}", model.gas_k());
            assert!((0.4e5..1.3e5).contains(&model.pressure_pa()), "{}", model.pressure_pa());
        }
    }

    /// A closed cylinder goes from 2 bar and 150 mm of gas to a third of it: P V^k is constant without heat, P V if the
    /// wall takes all of the heat.
    #[test]
    fn compression_of_a_cylinder_is_isentropic_or_isothermal() {
        for (inner_w_m2_k, exponent, bound) in [(0.0, 1.4, 2e-4), (1.0e5, 1.0, 2e-3)] {
            let mut config = Config {
                chamber: ChamberConfig::Cylinder(Cylinder::default()),
                load: Load::Isotonic { force_n: -100.0 },
                ..Config::default()
            };
            config.heat.inner_w_m2_k = inner_w_m2_k;
            config.wall.heat_capacity_j_k = 1.0e6;
            let mut model = Model::new(&config, 2.0e5, 298.0, 0.34).unwrap();
            for step in 1..=3000_u16 {
                model.step(0.0, 0.0, Some(0.34 - 0.08 / 3000.0 * f32::from(step)));
            }
            let volume_m3 = |way: f64| 2.0e-5 + 1.25e-3 * way;
            let expected_pa = 2.0e5 * (volume_m3(0.09) / volume_m3(0.01)).powf(exponent);
            let pressure_pa = f64::from(model.pressure_pa());
            assert!((pressure_pa / expected_pa - 1.0).abs() < bound, "{pressure_pa} {expected_pa}");
        }
    }
}
