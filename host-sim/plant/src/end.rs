//! The moving end of a chamber: its load, or, where a muscle is slack, the end alone while the load falls.

use super::bristle::Bristle;
use thermyo_scenario::{Load, LoadKind, Scenario};

#[derive(Debug, Clone, Copy, PartialEq)]
pub enum EndMotion {
    Free,
    /// Held: no force on it counts.
    Fixed,
    /// Moved by a mechanism, at a rate of change of the length \[m/s\].
    Driven(f64),
}

impl EndMotion {
    pub fn of(scenario: &Scenario) -> Self {
        if scenario.load.kind == LoadKind::Isometric { Self::Fixed } else { Self::Free }
    }
}

/// Mass of the fitting and half of the muscle: it moves even where the load does not \[kg\].
const OWN_MASS_KG: f64 = 0.05;

/// A mass, the force that pulls it out, and its friction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct End {
    /// Force that pulls the end out \[N\].
    pub load_n: f64,
    pub bristle: Bristle,
    mass_kg: f64,
    /// 1 over the mass \[1/kg\].
    pub per_mass_kg: f64,
}

impl End {
    fn new(scenario: &Scenario, load_n: f64, mass_kg: f64) -> Self {
        let bristle = Bristle::new(&scenario.friction, mass_kg);
        Self { load_n, bristle, mass_kg, per_mass_kg: 1.0 / mass_kg }
    }

    fn fastest_rate(&self, softening: f64) -> f64 {
        self.bristle.fastest_rate(self.mass_kg, softening)
    }

    fn swing(&self, spring_n_m: f64) -> f64 {
        (spring_n_m * self.per_mass_kg).sqrt()
    }
}

/// The end with its load and, for a chamber that cannot push, without it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ends {
    taut: End,
    slack: Option<End>,
}

/// A load that its muscle does not hold: the length at which the muscle would be taut \[m\], and the load's speed,
/// positive in contraction \[m/s\].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Falling {
    length: f64,
    speed: f64,
}

impl Ends {
    /// Ends for a scenario's load \[N\], on a chamber that can push it or cannot.
    pub fn new(scenario: &Scenario, load_n: f64, pushes: bool) -> Self {
        let Load { mass_kg, .. } = scenario.load;
        Self {
            taut: End::new(scenario, load_n, mass_kg.max(OWN_MASS_KG)),
            // A slack end without mass of its own follows at once.
            slack: (!pushes && mass_kg > OWN_MASS_KG).then(|| End::new(scenario, 0.0, OWN_MASS_KG)),
        }
    }

    /// Fastest rate of friction and mass \[1/s\], for the largest factor on friction.
    pub fn fastest_rate(&self, softening: f64) -> f64 {
        let slack = self.slack.map_or(0.0, |end| end.fastest_rate(softening));
        self.taut.fastest_rate(softening).max(slack)
    }

    /// Largest angular frequency of the moving bodies, on a spring \[N/m\] \[1/s\].
    pub fn fastest_swing(&self, spring_n_m: f64) -> f64 {
        let Self { taut, slack } = self;
        slack.unwrap_or(*taut).swing(spring_n_m).max(taut.swing(spring_n_m))
    }

    /// The body in motion: the slack end while the load falls, else both together.
    pub fn moving(&self, falling: Option<Falling>) -> &End {
        self.slack.as_ref().filter(|_| falling.is_some()).unwrap_or(&self.taut)
    }

    /// Moves the load after a step \[s\] that took the end to this length and speed, with this acceleration in the end.
    /// The load leaves the end where only a push would keep it there, and falls until it is caught. Once caught, both
    /// go on with the momentum of both: nothing springs back. Returns where the load then is, and the speed of the end.
    pub fn hang(
        &self,
        falling: Option<Falling>,
        step: f64,
        (length, speed): (f64, f64),
        acceleration: f64,
    ) -> (Option<Falling>, f64) {
        let Self { taut, slack: Some(slack) } = self else { return (None, speed) };
        let fall = taut.load_n * taut.per_mass_kg;
        let Some(before) = falling else {
            return ((acceleration < -fall).then_some(Falling { length, speed }), speed);
        };
        let now = Falling {
            length: before.length - step * (before.speed - 0.5 * step * fall),
            speed: before.speed - step * fall,
        };
        if now.length < length {
            return (Some(now), speed);
        }
        let momentum = taut.mass_kg * now.speed + slack.mass_kg * speed;
        (None, momentum / (taut.mass_kg + slack.mass_kg))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_thrown_up_comes_back_as_fast() {
        let mut scenario = Scenario::default();
        scenario.load.mass_kg = 0.45;
        let ends = Ends::new(&scenario, 0.45 * 10.0, false);
        assert_eq!(ends.hang(None, 1e-4, (0.2, 1.0), -9.999), (None, 1.0));
        let (mut falling, _) = ends.hang(None, 1e-4, (0.2, 1.0), -10.001);
        assert_eq!(ends.moving(falling).load_n, 0.0);
        // The end stands still where it was left.
        let (mut steps, mut speed) = (0, 0.0);
        while falling.is_some() {
            (falling, speed) = ends.hang(falling, 1e-4, (0.2, 0.0), 0.0);
            steps += 1;
        }
        assert!((2000..=2001).contains(&steps), "{steps}");
        // 0.45 kg fall at 1 m/s on 0.05 kg.
        assert!((speed + 0.9).abs() < 1e-3, "{speed} m/s");
        assert_eq!(ends.moving(None).load_n, 4.5);
    }

    #[test]
    fn what_pushes_keeps_its_load() {
        let ends = Ends::new(&Scenario::default(), 19.6, true);
        assert_eq!(ends.hang(None, 1e-4, (0.2, 1.0), -1e6), (None, 1.0));
    }
}
