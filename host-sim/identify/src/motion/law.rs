//! The law of a muscle in motion along a record: lengths from pressures, or forces from lengths.

use super::record::Row;
use thermyo_plant::chamber::{Chamber, braid};
use thermyo_plant::hysteresis::{ARMS, Elapsed, Hysteresis};
use thermyo_scenario::Scenario;

/// Limit on Newton steps, with bisection where they leave the bracket.
const STEPS: usize = 40;
/// Time after which all creep is over \[s\].
const CREPT_S: f64 = 1.0e9;
/// Correction at which a length is found \[m\].
const CLOSE_M: f64 = 1.0e-9;

/// State of slip and creep at the start: force of the slip, and of the slow arm \[N\].
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Start {
    pub slip_n: f64,
    pub slow_n: f64,
}

#[derive(Debug, Clone)]
pub struct Law {
    muscle: braid::Muscle,
    hysteresis: Hysteresis,
    slip_n_m: f64,
    /// Viscous friction, which only a plant with zones has.
    viscous_n_s_m: f64,
    ambient_pa: f64,
    rest_m: f64,
    /// Whether a load cell holds its ends. Closer together than the muscle's length without force, it is slack: it
    /// cannot push, and has a length of its own.
    by_cell: bool,
}

/// Time between two rows, and its effect on the law's states.
struct Interval {
    duration_s: f64,
    elapsed: Elapsed,
    /// Viscous force per way within the interval.
    viscous_n_m: f64,
}

impl Interval {
    const NONE: Self = Self { duration_s: 0.0, elapsed: Elapsed::NONE, viscous_n_m: 0.0 };
}

/// State along a record.
struct Memory {
    slider: f64,
    stretches: [f64; ARMS],
    length: f64,
}

impl Law {
    pub fn of(scenario: &Scenario, by_cell: bool) -> Self {
        Self {
            muscle: braid::Muscle::of(&scenario.muscle),
            hysteresis: Hysteresis::of(scenario),
            slip_n_m: scenario.muscle.slip_stiffness_n_m,
            viscous_n_s_m: if scenario.moves_in_full() {
                scenario.friction.viscous_n_s_m
            } else {
                0.0
            },
            ambient_pa: scenario.ambient.pressure_pa,
            rest_m: scenario.muscle.rest_length_m,
            by_cell,
        }
    }

    fn pull(&self, pressure: f64, length: f64) -> f64 {
        (pressure - self.ambient_pa) * self.muscle.force_area(length) + self.muscle.elastic(length)
    }

    fn begin(&self, start: &Start, first: &Row) -> Memory {
        let [_, slow] = &self.hysteresis.creep;
        let over =
            |force: f64, stiffness: f64| if stiffness > 0.0 { force / stiffness } else { 0.0 };
        let at = |length: f64| Memory {
            slider: length + over(start.slip_n, self.slip_n_m),
            stretches: [0.0, over(start.slow_n, slow.stiffness_n_m)],
            length,
        };
        let mut memory = at(first.length_m);
        if self.by_cell {
            // A muscle that was slack before the record has crept to its own length.
            self.force(first, &mut memory, &self.interval(CREPT_S));
        }
        at(memory.length)
    }

    /// Lengths at which the muscle holds the forces of the rows, limited to the longest recorded length and to the rest
    /// length: there its load lies on a stop \[m\].
    pub fn lengths(&self, rows: &[Row], start: &Start) -> Vec<f64> {
        let longest_m = rows.iter().map(|row| row.length_m).fold(self.rest_m, f64::max);
        let mut memory: Option<Memory> = None;
        let mut before_s = 0.0;
        let mut interval = Interval::NONE;
        let mut found = Vec::with_capacity(rows.len());
        for row in rows {
            let memory = memory.get_or_insert_with(|| {
                before_s = row.time_s;
                self.begin(start, row)
            });
            self.pass(&mut interval, row.time_s - before_s);
            before_s = row.time_s;
            let limit = self.hysteresis.slip.limit(row.pressure_pa - self.ambient_pa, 1.0);
            let length = self.solve(row, memory, &interval, (limit, longest_m));
            self.move_to(memory, &interval.elapsed, length, limit);
            found.push(length);
        }
        found
    }

    /// Forces at the lengths of the rows \[N\].
    pub fn forces(&self, rows: &[Row], start: &Start) -> Vec<f64> {
        let Some(first) = rows.first() else { return Vec::new() };
        let mut interval = Interval::NONE;
        let mut memory = self.begin(start, first);
        let mut before_s = first.time_s;
        let force = |row: &Row| {
            self.pass(&mut interval, row.time_s - before_s);
            before_s = row.time_s;
            self.force(row, &mut memory, &interval)
        };
        rows.iter().map(force).collect()
    }

    /// Force of a row to which the muscle moves.
    fn force(&self, row: &Row, memory: &mut Memory, interval: &Interval) -> f64 {
        let limit = self.hysteresis.slip.limit(row.pressure_pa - self.ambient_pa, 1.0);
        let held_n = self.held_n(memory, interval, row.length_m, limit);
        let force_n = self.pull(row.pressure_pa, row.length_m) - held_n;
        let is_slack = self.by_cell && force_n < 0.0;
        let length = if is_slack {
            let free = Row { force_n: 0.0, ..*row };
            self.solve(&free, memory, interval, (limit, self.rest_m.max(row.length_m)))
        } else {
            row.length_m
        };
        self.move_to(memory, &interval.elapsed, length, limit);
        if is_slack { 0.0 } else { force_n }
    }

    /// Force of slip, creep and viscous friction against a motion to a length.
    fn held_n(&self, memory: &Memory, interval: &Interval, length: f64, limit: f64) -> f64 {
        let way = memory.length - length;
        let stretches = interval.elapsed.stretches(&memory.stretches, way);
        self.hysteresis.slip.force(memory.slider, length, limit)
            + self.hysteresis.creep_n(&stretches)
            + interval.viscous_n_m * way
    }

    fn interval(&self, duration_s: f64) -> Interval {
        Interval {
            duration_s,
            elapsed: Elapsed::new(&self.hysteresis, duration_s),
            viscous_n_m: self.viscous_n_s_m / duration_s,
        }
    }

    /// Computes the interval if the time has changed.
    fn pass(&self, interval: &mut Interval, duration_s: f64) {
        if duration_s != interval.duration_s {
            *interval = if duration_s > 0.0 { self.interval(duration_s) } else { Interval::NONE };
        }
    }

    fn move_to(&self, memory: &mut Memory, elapsed: &Elapsed, length: f64, limit: f64) {
        memory.stretches = elapsed.stretches(&memory.stretches, memory.length - length);
        memory.slider = self.hysteresis.slip.settle(memory.slider, length, limit).0;
        memory.length = length;
    }

    /// The length of a row, for the slip's limit and the longest length: the force rises with the length.
    fn solve(
        &self,
        row: &Row,
        memory: &Memory,
        interval: &Interval,
        (limit, longest_m): (f64, f64),
    ) -> f64 {
        let Self { hysteresis, muscle, .. } = self;
        let excess = |length: f64| {
            self.pull(row.pressure_pa, length)
                - self.held_n(memory, interval, length, limit)
                - row.force_n
        };
        let held_n_m = interval.elapsed.slope(hysteresis) + interval.viscous_n_m;
        let slope = |length: f64| {
            (row.pressure_pa - self.ambient_pa) * muscle.force_area_slope(length)
                + muscle.elastic_slope(length)
                + hysteresis.slip.slope(memory.slider, length, limit)
                + held_n_m
        };
        // A search may try a muscle that cannot be as short as the longest row.
        let (mut low, mut high) = (muscle.lengths()[0].min(longest_m), longest_m);
        if excess(longest_m) <= 0.0 {
            return longest_m;
        }
        let mut length = memory.length.clamp(low, high);
        for _ in 0..STEPS {
            let excess_n = excess(length);
            if excess_n > 0.0 {
                high = length
            } else {
                low = length
            }
            let slope_n_m = slope(length);
            let newton = length - excess_n / slope_n_m;
            let next = if newton > low && newton < high { newton } else { 0.5 * (low + high) };
            let change = (next - length).abs();
            length = next;
            if change < CLOSE_M {
                break;
            }
        }
        length
    }
}
