//! The pull of a chamber, and its length where it balances a quasi-static load.

use super::chamber::Chamber;
use thermyo_compute::math;
use thermyo_scenario::{Friction, Load, LoadKind, Scenario};

/// Standard gravity \[m/s2\].
const STANDARD_GRAVITY: f64 = 9.80665;

/// The static balance of forces: chamber and load.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pull<C> {
    pub chamber: C,
    /// Lengths at which stops carry the load \[m\].
    pub stops: [f64; 2],
    pub ambient_pa: f64,
    pub load_n: f64,
}

impl<C: Chamber> Pull<C> {
    pub fn new(scenario: &Scenario, chamber: C) -> Self {
        Self {
            stops: chamber.stops(),
            load_n: load_n(scenario, &chamber),
            chamber,
            ambient_pa: scenario.ambient.pressure_pa,
        }
    }

    /// Pull of gas and elastic parts \[N\], at an absolute pressure \[Pa\] and length \[m\].
    pub fn force(&self, pressure: f64, length: f64) -> f64 {
        (pressure - self.ambient_pa) * self.chamber.force_area(length)
            + self.chamber.elastic(length)
    }

    /// Slope of the pull over length \[N/m\], while the pressure changes by `pressure_slope` \[Pa/m\].
    pub fn stiffness(&self, pressure: f64, pressure_slope: f64, length: f64) -> f64 {
        let chamber = &self.chamber;
        pressure_slope * chamber.force_area(length)
            + (pressure - self.ambient_pa) * chamber.force_area_slope(length)
            + chamber.elastic_slope(length)
    }

    /// Length \[m\] where the pull equals `force` \[N\] plus the force that holds the chamber back: Newton from
    /// `guess`. `pressure` returns the pressure and its slope over length, `held` the holding force and its slope over
    /// contraction. NaN when there is no such length.
    pub fn balance(
        &self,
        force: f64,
        guess: f64,
        mut pressure: impl FnMut(f64) -> (f64, f64),
        held: impl Fn(f64) -> (f64, f64),
    ) -> f64 {
        let mut length = guess;
        for _ in 0..50 {
            let (p, slope) = pressure(length);
            let (held_n, held_n_m) = held(length);
            let correction = (self.force(p, length) - held_n - force)
                / (self.stiffness(p, slope, length) + held_n_m);
            length -= correction;
            // Newton squares the error: this correction leaves less than 1e-12 m.
            if correction.abs() < 1e-7 {
                return length;
            }
        }
        f64::NAN
    }

    /// `length` \[m\], limited to the stops.
    pub fn stopped(&self, length: f64) -> f64 {
        let [shortest, longest] = self.stops;
        length.min(longest).max(shortest)
    }

    /// Length \[m\] under load, from rest, at constant pressure.
    pub fn start_length(&self, pressure: f64, friction: f64) -> f64 {
        let rest = self.chamber.rest_length();
        let at_rest = self.force(pressure, rest);
        let [shortest, longest] = self.stops;
        let (wanted, stop) = if at_rest > self.load_n + friction {
            (self.load_n + friction, shortest)
        } else if at_rest < self.load_n - friction {
            (self.load_n - friction, longest)
        } else {
            return rest;
        };
        // A force that does not fall below the load on the way ends at the stop.
        let beyond = self.force(pressure, stop) - wanted;
        if stop == rest || (stop.is_finite() && beyond * (at_rest - wanted) >= 0.0) {
            return stop;
        }
        self.balance(wanted, rest, |_| (pressure, 0.0), |_| (0.0, 0.0))
    }
}

/// Force of a scenario's load \[N\]: a mass is lifted in the direction in which pressure moves the
/// chamber.
pub fn load_n(scenario: &Scenario, chamber: &(impl Chamber + ?Sized)) -> f64 {
    let Load { kind, force_n, mass_kg, .. } = scenario.load;
    match kind {
        LoadKind::Isotonic | LoadKind::Isometric => force_n,
        LoadKind::Mass => chamber.direction() * mass_kg * STANDARD_GRAVITY,
    }
}

/// Gauge pressure at which friction and slip have their configured values \[Pa\].
const CONFIGURED_AT_PA: f64 = 4.0e5;

/// A force, part of which follows gauge pressure.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pressed {
    /// Factor without pressure \[-\], and its slope \[1/Pa\].
    without: f64,
    per_pa: f64,
}

impl Pressed {
    pub fn new(share: f64) -> Self {
        Self { without: 1.0 - share, per_pa: share / CONFIGURED_AT_PA }
    }

    pub fn factor(&self, gauge_pa: f64) -> f64 {
        (self.without + self.per_pa * gauge_pa).max(0.0)
    }
}

/// Fall of friction as the wall warms: exp(-beta (T_w - T_ref)).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Softening {
    per_k: f64,
    reference_k: f64,
}

impl Softening {
    /// Softening of `[friction]`.
    pub fn new(friction: &Friction) -> Self {
        Self { per_k: friction.softening_per_k, reference_k: friction.reference_temperature_k }
    }

    /// Factor on every friction force \[-\] at this wall temperature \[K\].
    pub fn factor(&self, wall_k: f64) -> f64 {
        math::exp(-self.per_k * (wall_k - self.reference_k))
    }

    /// The factor around this wall temperature \[K\].
    pub fn around(&self, wall_k: f64) -> LocalSoftening {
        let factor = self.factor(wall_k);
        LocalSoftening { factor, slope: -self.per_k * factor, wall_k }
    }
}

/// [`Softening::factor`] without the exponential, for the small excursions within one step: over
/// 1e-3 K the linear form is exact to 1e-10.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LocalSoftening {
    factor: f64,
    slope: f64,
    wall_k: f64,
}

impl LocalSoftening {
    /// Factor on every friction force \[-\] at this wall temperature \[K\].
    pub fn factor(&self, wall_k: f64) -> f64 {
        self.factor + self.slope * (wall_k - self.wall_k)
    }
}
// x
