//! Movements of the zones and the end of an interval. Each leaves work for later steps, so that no step does more than
//! one of: the controller's period, a movement, the heat transfer after it, the update of sums and element, a part of
//! the covariance. At the end of an interval the sums become linearised error dynamics.

use super::covariance::{ElementRow, Errors, GasRow, HousingRow, Product, Transition};
use super::element::Response;
use super::per_zone::{PerZone, ZONES, minus, plus, scaled, times, total};
use super::profile::corrected;
use super::zones::{Faces, Flow, Moved, Place, Zones};
use super::{Balance, Coefficients, Estimator, LengthSource, Measurement};
use crate::config::EstimatorConfig;
use crate::math::{CompensatedSum, absolute, limit, small_exp, sqrt};
use crate::physics::chamber::Chamber;
use crate::sensing::GasReading;

/// Rows that an interval moves.
const ROWS: u8 = 7;
/// Steps after a movement of the zones for which all its follow-up work may wait.
const LATE_STEPS: u16 = 2;
/// Work with no more steps to spare than this waits no longer.
const SPARE_STEPS: u16 = 4;
/// Variance that a leak adds per second, in squares of its rate: configured wrong by 10 % for five seconds \[s\].
const LEAK_UNCERTAINTY_S: f32 = 0.1;
/// Drift of the gas temperature's error without a length \[K\], in a second: the length derived from pressure and load
/// errs by what friction holds, 18 mm at 800 N/m, a sixteenth of the volume, and (k-1) T/16 is 7 K. An assumption, for
/// one turn a second.
const LENGTHLESS_DRIFT_K: f32 = 7.0;
/// Deviation that a movement which replaces a zone's gas adds to the mass \[-\]: the temperature at the port then errs
/// by 10 % (`zones.rs`), and 10 % of the gas leaves before zones and readings have followed. An assumption.
const REPLACED_SD: f32 = 0.01;
/// Innovations beyond this many of their deviations correct nothing.
const UNLIKELY: f32 = 5.0;
/// Range of the factors on heat transfer and stirring.
const FACTORS: [f32; 2] = [1.0 / 12.0, 12.0];

/// Sums over one interval.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Interval {
    pub steps: u16,
    /// Enthalpy that leaked \[J\].
    pub leaked_j: f32,
    /// Whether its reading is left out: the interval began before the estimator, or a step of it had no pressure or a
    /// length from another source.
    pub void: bool,
    /// Flow since the zones last moved.
    pub flow: Flow,
}

/// An interval that has ended, and whose sums wait for its last movement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Ended {
    steps: u16,
    leaked_j: f32,
    /// Mean reading of the gas sensor over it.
    gas: Option<GasReading>,
}

/// Sums over the movements of the zones in an interval.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Movements {
    count: u8,
    steps: u16,
    flowing_steps: u16,
    /// Masses at the start \[kg\].
    mass_kg: PerZone,
    inflow_kg: f32,
    outflow_kg: f32,
    energy_j: f32,
    heat_j: PerZone,
    stirred_j: PerZone,
    conductance_j_k: PerZone,
    gas_k: PerZone,
    faces: Faces,
    /// Movements that replaced a zone's gas.
    replacements: u8,
    response: Response,
}

impl Default for Movements {
    fn default() -> Self {
        Self {
            count: 0,
            steps: 0,
            flowing_steps: 0,
            mass_kg: [0.0; ZONES],
            inflow_kg: 0.0,
            outflow_kg: 0.0,
            energy_j: 0.0,
            heat_j: [0.0; ZONES],
            stirred_j: [0.0; ZONES],
            conductance_j_k: [0.0; ZONES],
            gas_k: [0.0; ZONES],
            faces: Faces::default(),
            replacements: 0,
            response: Response::NONE,
        }
    }
}

/// Sums over one balance.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Window {
    pub steps: u16,
    pub heat_j: f32,
    /// Work of the gas, and its measured internal energy at the start \[J\].
    pub work_j: f32,
    pub start_j: f32,
    /// Enthalpy that leaked \[J\].
    pub leaked_j: f32,
    /// Whether a step of it had no pressure.
    pub void: bool,
    /// Whether a valve was open in a step of it.
    pub flowed: bool,
}

/// Work that the end of an interval leaves for the next steps, one part each.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) enum Work {
    #[default]
    Done,
    Transition,
    /// A row of M = F P.
    Row(u8),
    /// A row of P' = M F^T.
    Column(u8),
    Drift,
    Correction,
    Reduction,
    Deviation,
}

impl Work {
    /// Number of parts that are left.
    fn parts(self) -> u16 {
        let rows = u16::from(ROWS);
        match self {
            Self::Done => 0,
            Self::Deviation => 1,
            Self::Reduction => 2,
            Self::Correction => 3,
            Self::Drift => 4,
            Self::Column(row) => 4 + rows - u16::from(row),
            Self::Row(row) => 4 + 2 * rows - u16::from(row),
            Self::Transition => 5 + 2 * rows,
        }
    }
}

/// Inputs of the remaining work, and results that its parts pass on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Pending {
    pub work: Work,
    pub moved: Movements,
    /// Masses at the end of the interval, before any correction \[kg\].
    pub mass_kg: PerZone,
    pub transition: Transition,
    pub product: Product,
    pub innovation_k: Option<f32>,
    /// Variance of the mean of the interval's readings of the gas sensor \[K2\].
    pub reading_k2: f32,
    /// Share of the gas that leaked in the interval \[-\].
    pub leaked: f32,
    pub gains: Errors<f32>,
    pub left: f32,
}

impl Pending {
    pub(super) fn none() -> Self {
        Self {
            work: Work::Done,
            moved: Movements::default(),
            mass_kg: [1.0; ZONES],
            transition: Transition::default(),
            product: [[0.0; super::covariance::ERRORS]; ROWS as usize],
            innovation_k: None,
            reading_k2: 0.0,
            leaked: 0.0,
            gains: Errors::default(),
            left: 1.0,
        }
    }
}

impl GasRow {
    fn plus(&self, other: &Self) -> Self {
        Self {
            zones: plus(&self.zones, &other.zones),
            wall: self.wall + other.wall,
            scale: self.scale + other.scale,
            stirring: self.stirring + other.stirring,
        }
    }

    fn minus(&self, other: &Self) -> Self {
        Self {
            zones: minus(&self.zones, &other.zones),
            wall: self.wall - other.wall,
            scale: self.scale - other.scale,
            stirring: self.stirring - other.stirring,
        }
    }

    fn times(&self, by: f32) -> Self {
        Self {
            zones: scaled(&self.zones, by),
            wall: self.wall * by,
            scale: self.scale * by,
            stirring: self.stirring * by,
        }
    }

    fn on(mut self, zone: usize, by: f32) -> Self {
        if let Some(entry) = self.zones.get_mut(zone) {
            *entry += by;
        }
        self
    }
}

impl Movements {
    /// Adds the flow of a movement, before the zones move by it.
    fn add_flow(&mut self, flow: &Flow, zones: &Zones) {
        if self.count == 0 {
            self.mass_kg = zones.mass_kg;
        }
        self.count += 1;
        self.steps += flow.steps;
        self.flowing_steps += flow.flowing_steps;
        self.inflow_kg += flow.inflow_kg;
        self.outflow_kg += flow.outflow_kg;
    }

    /// Scales masses and energy to those of another volume.
    pub(super) fn scale(&mut self, by: f32) {
        self.mass_kg = scaled(&self.mass_kg, by);
        for sum in [&mut self.inflow_kg, &mut self.outflow_kg, &mut self.energy_j] {
            *sum *= by;
        }
    }

    fn add(&mut self, moved: &Moved, conductance_j_k: &PerZone) {
        let steps = f32::from(moved.steps);
        self.energy_j += moved.energy_j;
        self.heat_j = plus(&self.heat_j, &moved.heat_j);
        self.stirred_j = plus(&self.stirred_j, &moved.stirred_j);
        self.conductance_j_k = plus(&self.conductance_j_k, &scaled(conductance_j_k, steps));
        self.gas_k = plus(&self.gas_k, &scaled(&moved.gas_k, steps));
        self.replacements += u8::from(moved.faces.replace_a_zone());
        let add = |sum: &mut [f32; 3], more: &[f32; 3]| {
            sum.iter_mut().zip(more).for_each(|(sum, more)| *sum += more);
        };
        add(&mut self.faces.up, &moved.faces.up);
        add(&mut self.faces.down, &moved.faces.down);
    }

    /// Returns the rows of the heat that each zone gives to the wall, and of their sum. An error decays by that heat
    /// during the interval: an error at its start counts with its mean, 1/(1 + x/2) for x = G/(cp m).
    fn heat_rows(&self, gas_k: &PerZone, per_cp: f32) -> ([GasRow; ZONES], GasRow) {
        let mut rows = [GasRow::default(); ZONES];
        let mut sum = GasRow::default();
        let heat = self.heat_j.iter().zip(&self.stirred_j);
        let zones = self.conductance_j_k.iter().zip(&self.mass_kg).zip(gas_k).zip(heat).enumerate();
        for (row, (i, (((conductance, mass_kg), gas_k), (heat, stirred)))) in
            rows.iter_mut().zip(zones)
        {
            let mean = mass_kg / (mass_kg + 0.5 * per_cp * conductance);
            let own = GasRow {
                zones: [0.0; ZONES],
                wall: -conductance * mean,
                scale: heat * mean,
                stirring: stirred * mean,
            };
            *row = own.on(i, -conductance * gas_k * mean);
            sum = sum.plus(row);
        }
        (rows, sum)
    }
}

impl Estimator {
    /// Moves the zones when they are due, and does the follow-up work and the work of an interval, one part per step.
    /// While other steps are left, it avoids those in which the controller works.
    pub(super) fn advance_covariance(&mut self, chamber: &impl Chamber, measurement: &Measurement) {
        let counts = self.coefficients.counts;
        let left = counts.update_steps.saturating_sub(self.interval.steps);
        let moves = left == 0 || self.interval.flow.steps == counts.move_steps;
        let late = moves || self.interval.flow.steps > LATE_STEPS;
        let mut idle = !(measurement.busy || moves);
        // One part per step, but no movement before the follow-up work of the previous one is done.
        while (idle || late) && self.follow_movement() {
            idle = false;
            if !moves {
                break;
            }
        }
        if moves {
            self.move_zones(chamber, measurement);
        }
        if left == 0 {
            self.end_interval(measurement);
            return;
        }
        let parts = counts.parts_per_step;
        // A product, not a quotient: the optimiser cannot see that `parts` is never 0.
        let spared = left.saturating_sub(SPARE_STEPS);
        if idle || spared.saturating_mul(parts) <= self.pending.work.parts() {
            for _ in 0..parts {
                self.work();
            }
        }
    }

    /// Does the next follow-up part of a movement: the heat transfer, sums and element, or the interval's end. Returns
    /// whether there was one.
    fn follow_movement(&mut self) -> bool {
        if self.exchange_due {
            self.keep_exchange();
            self.set_exchange();
        } else if let Some((moved, conductance_j_k)) = self.moved.take() {
            let conductance_j_k = conductance_j_k.unwrap_or_else(|| self.exchange.settled_j_k());
            self.add_movement(&moved, &conductance_j_k);
        } else {
            return false;
        }
        true
    }

    /// Does the next part of the remaining work.
    fn work(&mut self) {
        let Pending { work, .. } = self.pending;
        self.pending.work = match work {
            Work::Done => return,
            Work::Transition => {
                self.pending.transition = self.transition();
                Work::Row(0)
            }
            Work::Row(row) => {
                let Pending { transition, product, .. } = &mut self.pending;
                self.covariance.row(transition, row.into(), product);
                if row + 1 < ROWS { Work::Row(row + 1) } else { Work::Column(0) }
            }
            Work::Column(row) => {
                let Pending { transition, product, .. } = &self.pending;
                self.covariance.column(transition, row.into(), product, &self.coefficients.keep);
                if row + 1 < ROWS { Work::Column(row + 1) } else { Work::Drift }
            }
            Work::Drift => {
                self.add_drift();
                Work::Correction
            }
            Work::Correction => {
                if self.take_innovation() {
                    Work::Reduction
                } else {
                    Work::Deviation
                }
            }
            Work::Reduction => {
                self.covariance.reduce(&self.pending.gains, self.pending.left);
                self.covariance.mirror();
                Work::Deviation
            }
            Work::Deviation => {
                self.update_deviation();
                Work::Done
            }
        };
    }

    /// Moves zones, walls, housing and element by the flow since they last moved.
    fn move_zones(&mut self, chamber: &impl Chamber, measurement: &Measurement) {
        let flow = core::mem::take(&mut self.interval.flow);
        if flow.steps == 0 {
            return;
        }
        let length_m = measurement.length.value;
        let place = Place {
            energy_j: self.energy.energy_j(),
            pressure_pa: self.pressure_pa,
            length_m,
            rest_length_m: chamber.rest_length_m(),
            volume_m3: self.volume_m3,
            surface_m2: chamber.surface_m2(length_m),
            way_m: length_m - self.length_m,
            friction_j: self.place.friction_j,
            mass_kg: self.mass_kg.value(),
        };
        self.length_m = length_m;
        self.movements.add_flow(&flow, &self.zones);
        self.exchange.add_jet(&flow);
        let moved = self.zones.advance(&self.coefficients, &flow, &self.exchange, &place);
        self.moved = Some((moved, None));
        self.place = place;
        self.exchange_due = true;
        self.set_leak(self.pressure_pa);
    }

    /// Keeps the part of the present heat transfer that the last movement needs, before another one replaces it.
    fn keep_exchange(&mut self) {
        let Some((moved, conductance_j_k @ None)) = &mut self.moved else { return };
        *conductance_j_k = Some(self.exchange.settled_j_k());
        let c = &self.coefficients;
        if c.profile.exists {
            let excess_k = minus(&moved.gas_k, &self.zones.wall_k);
            self.element.conduct(c, &self.exchange, &excess_k);
        }
    }

    /// Updates sums and element by the last movement of the zones, and ends an interval that ended with it. The wall
    /// gets the heat of friction with the next movement.
    fn add_movement(&mut self, moved: &Moved, conductance_j_k: &PerZone) {
        self.place.friction_j = self.rub(-self.place.way_m);
        let c = &self.coefficients;
        let sums = &mut self.movements;
        sums.add(moved, conductance_j_k);
        let steps = (f32::from(moved.steps), c.step_s);
        self.element.follow(&moved.gas_k, steps, &mut sums.response);
        if let Some(ended) = self.ended.take() {
            self.close_interval(&ended);
        }
    }

    /// Moves slip and creep by a contraction; returns the heat that they and friction give to the wall \[J\].
    fn rub(&mut self, way_m: f32) -> f32 {
        let Coefficients { hysteresis, friction, ambient, .. } = &self.coefficients;
        let softening = friction.softening(self.zones.mean_wall_k());
        let gauge_pa = self.pressure_pa - ambient.pressure_pa;
        let held = hysteresis.after(&self.held, way_m, gauge_pa, softening);
        let heat_j = hysteresis.heat_j(&self.held, &held, way_m)
            + softening * friction.force_n * friction.at_pressure(gauge_pa) * absolute(way_m);
        self.held = held;
        friction.heat_fraction * heat_j
    }

    fn end_interval(&mut self, measurement: &Measurement) {
        let Interval { steps, leaked_j, void, .. } = core::mem::take(&mut self.interval);
        self.ended = Some(Ended { steps, leaked_j, gas: measurement.gas.filter(|_| !void) });
    }

    /// Forgets the movements since the last interval.
    pub(super) fn forget_movements(&mut self) {
        self.moved = None;
        self.movements = Movements::default();
        self.ended = None;
    }

    /// Starts the work of an interval whose sums are complete.
    fn close_interval(&mut self, ended: &Ended) {
        let moved = core::mem::take(&mut self.movements);
        let c = self.coefficients;
        if c.leaks {
            // Not a number if almost no gas is left.
            self.pending.leaked = limit(ended.leaked_j * self.per_enthalpy(), -1.0, 1.0);
        }
        let swing_k = self.gas_k - self.zones.mean_wall_k();
        self.swing_k2 += c.swing_window * (swing_k * swing_k - self.swing_k2);
        self.pending.moved = moved;
        self.pending.mass_kg = self.zones.mass_kg;
        self.pending.work = Work::Transition;
        self.scale += c.forget * (1.0 - self.scale);
        self.stirring += c.forget * (1.0 - self.stirring);
        self.read_element(ended, &moved.response);
        self.element.fade(&self.coefficients);
    }

    /// Compares the element with its reading.
    fn read_element(&mut self, ended: &Ended, response: &Response) {
        let share = 1.0 - response.element_left;
        let reading = self.element.judge(&self.coefficients, ended.gas, share, self.gas_sd_k);
        // The mean of the readings belongs to the mean of the element. Ten milliseconds seem little beside a lag of
        // seconds, but at a stroke's frequency so small a delay looks like 0.1 s of additional lag. A digital part's
        // readings carry their own age.
        let age_steps = ended.gas.and_then(|gas| gas.age_steps);
        let steps = f32::from(ended.steps);
        let expected_k = match age_steps {
            Some(age_steps) => self.element.sensor_k - age_steps / steps * response.element_k,
            None => response.mean_k / steps,
        };
        if let Some(gas) = reading {
            let own_k = self.coefficients.tuning.reading_sd_k;
            self.element.reading_k = gas.value_k;
            self.pending.reading_k2 = gas.noise_k2 + own_k * own_k;
        }
        self.pending.innovation_k = reading.map(|gas| gas.value_k - expected_k);
    }

    /// Records the balance of a window, for any heat transfer and leak between none and the configured ones.
    pub(super) fn end_window(&mut self) {
        if self.window.steps < self.coefficients.counts.interval_steps {
            return;
        }
        let window = core::mem::take(&mut self.window);
        if window.void {
            return;
        }
        let adiabatic_j = self.measured_j - window.start_j + window.work_j;
        let per_j = self.per_enthalpy();
        let share = |enthalpy_j: f32| enthalpy_j * per_j;
        let Window { heat_j, leaked_j, flowed, .. } = window;
        let (taken_j, given_j) = (limit(heat_j, f32::MIN, 0.0), limit(heat_j, 0.0, f32::MAX));
        // A leak outwards was supplied by the valves; a leak inwards was not.
        let least_j = adiabatic_j + taken_j + limit(leaked_j, f32::MIN, 0.0);
        let most_j = adiabatic_j + given_j + limit(leaked_j, 0.0, f32::MAX);
        if !flowed && self.length_source == LengthSource::Sensor {
            let gained = [least_j + taken_j, most_j + given_j].map(share);
            // Two windows make an interval.
            self.leakage.add(gained, 0.5 * self.coefficients.interval_s);
        }
        self.balance = Some(Balance {
            least_gained: share(least_j),
            most_gained: share(most_j),
            pressure_pa: self.pressure_pa,
            mass_kg: self.mass_kg.value(),
            held_n: self.held.force_n(),
        });
    }

    /// Share of the gas that corresponds to an enthalpy \[1/J\].
    fn per_enthalpy(&self) -> f32 {
        self.coefficients.per_cp / (self.mass_kg.value() * self.gas_k)
    }

    /// Computes the linearised error dynamics of an interval: see the head of the module.
    fn transition(&self) -> Transition {
        let Pending { moved, mass_kg, .. } = &self.pending;
        let steps = f32::from(moved.steps);
        let gas_k = scaled(&moved.gas_k, 1.0 / steps);
        let (heat, all) = moved.heat_rows(&gas_k, self.coefficients.per_cp);
        let [port_k, ..] = gas_k;
        let [port_kg, ..] = moved.mass_kg;
        let closed = 1.0 - f32::from(moved.flowing_steps) / steps;
        let c = &self.coefficients;
        // Less than the mass resolves counts as no inflow: its sign would be that of a subnormal number.
        let net_kg = moved.inflow_kg - moved.outflow_kg;
        let through_k = if net_kg > f32::EPSILON * port_kg { c.supply_k } else { port_k };
        let out_kg = limit(-net_kg, 0.0, 0.5 * port_kg);
        let port = all.times((1.0 - closed) * c.per_cp / through_k).on(0, -out_kg);
        let per_j =
            ZONES as f32 * f32::from(moved.count) / (c.gas.heat_capacity_ratio * moved.energy_j);
        let [_, second, third, last] = heat;
        let third = last.plus(&third);
        let second = third.plus(&second);
        let face =
            |face: usize, beyond: &GasRow, (up, down): (f32, f32), behind: f32, ahead: f32| {
                let damped = 1.0 / (1.0 + up + down);
                let upwind_kg = if up > down { behind } else { ahead };
                let shut = closed * (ZONES - face) as f32 * (1.0 / ZONES as f32);
                let enthalpy = beyond.plus(&all.times(-shut));
                let flux = enthalpy.times(per_j * upwind_kg * damped);
                flux.on(face - 1, up * damped * behind).on(face, -down * damped * ahead)
            };
        let [m0, m1, m2, m3] = moved.mass_kg;
        let Faces { up: [p1, p2, p3], down: [q1, q2, q3] } = moved.faces;
        let first = face(1, &second, (p1, q1), m0, m1);
        let middle = face(2, &third, (p2, q2), m1, m2);
        let farthest = face(3, &last, (p3, q3), m2, m3);
        let [n0, n1, n2, n3] = mass_kg.map(|kg| 1.0 / kg);
        let zone = |into: &GasRow, out: &GasRow, i: usize, before: f32, per_kg: f32| {
            into.minus(out).on(i, before).times(per_kg)
        };
        let zones = [
            zone(&port, &first, 0, m0, n0),
            zone(&first, &middle, 1, m1, n1),
            zone(&middle, &farthest, 2, m2, n2),
            farthest.on(3, m3).times(n3),
        ];
        let mut wall = all.times(1.0 / c.wall_j_k);
        let lost = if c.layers_w_k > 0.0 { c.layers_w_k * c.interval_s / c.wall_j_k } else { 0.0 };
        wall.wall += limit(1.0 - lost, 0.0, 1.0);
        let (housing, element) = self.element_rows(&moved.response, &gas_k, steps);
        Transition { zones, wall, housing, element }
    }

    fn element_rows(
        &self,
        response: &Response,
        gas_k: &PerZone,
        steps: f32,
    ) -> (HousingRow, ElementRow) {
        let share = 1.0 - response.housing_left;
        let housing = HousingRow {
            zones: scaled(&response.zones_k, -share / steps),
            wall: share / steps * response.wall,
            housing: response.housing_left,
            foil: share,
            housing_lag: -response.housing_k * response.housing_left,
            place: share * self.element.slope_k(gas_k),
        };
        let half = 0.5 * (1.0 - response.element_left);
        (housing, ElementRow { half, lag: -response.element_k })
    }

    fn add_drift(&mut self) {
        let c = &self.coefficients;
        let tuning = &c.tuning;
        let duration_s = c.interval_s;
        let square = |x: f32| x * x;
        self.covariance.fade(&c.keep);
        self.covariance.mirror();
        let per_gas = 1.0 / self.gas_k;
        let alone = (square(tuning.zone_drift) * self.swing_k2) * per_gas * per_gas;
        let drift_k = match self.length_source {
            LengthSource::Sensor => tuning.gas_drift_k,
            LengthSource::Reference | LengthSource::Balance => LENGTHLESS_DRIFT_K,
        };
        let mut common = square(drift_k * per_gas) * duration_s;
        if c.leaks {
            common += LEAK_UNCERTAINTY_S * square(self.pending.leaked) / duration_s;
        }
        let replacements = core::mem::take(&mut self.pending.moved.replacements);
        common += square(REPLACED_SD) * f32::from(replacements);
        self.covariance.add_common(common);
        // First-order Gauss-Markov: an error that is not observed again returns to the configured value.
        let returned = 2.0 * c.forget;
        let foil_k2 = self.foil_k2();
        let parameters = c.parameters();
        self.covariance.add_variances(&Errors {
            zones: [alone * duration_s; ZONES],
            wall: square(tuning.wall_drift_k) * duration_s,
            // Rounding must not reduce them to zero.
            housing: 1.0e-6,
            element: 1.0e-7,
            foil: (1.0 - square(c.keep.foil)) * foil_k2,
            scale: returned * parameters.scale,
            stirring: returned * parameters.stirring,
            lag: returned * parameters.lag,
            housing_lag: returned * parameters.housing_lag,
            place: returned * parameters.place,
        });
        let sound = self.covariance.limit(&Errors {
            zones: [1.0e-9; ZONES],
            wall: 1.0e-5,
            housing: 1.0e-6,
            element: 1.0e-7,
            ..Errors::default()
        });
        if !sound {
            self.covariance = c.initial_covariance();
        }
    }

    /// Variance of what the foil sees beyond its zone's temperature \[K2\].
    fn foil_k2(&self) -> f32 {
        let EstimatorConfig { foil_sd_k, foil_swing, .. } = self.coefficients.tuning;
        foil_sd_k * foil_sd_k + foil_swing * foil_swing * self.swing_k2
    }

    /// Applies the interval's innovation; returns whether it corrected anything.
    fn take_innovation(&mut self) -> bool {
        let Some(innovation_k) = self.pending.innovation_k.take() else { return false };
        let reading_k2 = self.pending.reading_k2;
        let variance_k2 = self.covariance.element_k2() + reading_k2;
        if self.element.compare(&self.coefficients, innovation_k, variance_k2) {
            self.give_up();
            return false;
        }
        let unlikely = innovation_k * innovation_k > UNLIKELY * UNLIKELY * variance_k2;
        if self.element.distrusted() || unlikely {
            return false;
        }
        (self.pending.gains, self.pending.left) = self.covariance.gains(reading_k2);
        self.correct(innovation_k);
        if self.length_source == LengthSource::Sensor {
            let innovation = (innovation_k, variance_k2);
            self.element.watch(&self.coefficients, innovation, self.pending.gains.housing);
        }
        true
    }

    /// Corrects the state by a Kalman update.
    fn correct(&mut self, innovation_k: f32) {
        let gains = self.pending.gains;
        let learns = !self.element.stands_still();
        let wall_k = if learns { gains.wall * innovation_k } else { 0.0 };
        let factors = gains.zones.map(|gain| 1.0 + limit(gain * innovation_k, -0.05, 0.05));
        // Gas may have come or gone since the zones last moved: their correction is a factor on the present mass.
        let before_kg = total(&self.zones.mass_kg);
        self.zones.mass_kg = times(&self.zones.mass_kg, &factors);
        let factor = total(&self.zones.mass_kg) / before_kg;
        self.mass_kg = CompensatedSum::new(self.mass_kg.value() * factor);
        self.zones.set_mass(before_kg * factor);
        let wrong_k = self.gas_k;
        self.update_temperature();
        let excess_k = self.gas_k - wrong_k - wall_k;
        self.zones.profile_k = self.zones.profile_k.map(|modes_k| corrected(&modes_k, excess_k));
        self.element.profile.correct(excess_k);
        let wall_k = [wall_k; ZONES];
        let Zones { wall_k: inner_k, outer_k, .. } = &self.zones;
        let (inner_k, outer_k) = (plus(inner_k, &wall_k), plus(outer_k, &wall_k));
        self.zones.set_walls(&inner_k, &outer_k);
        let element = &mut self.element;
        element.housing_k += gains.housing * innovation_k;
        element.sensor_k += gains.element * innovation_k;
        element.foil_k += gains.foil * innovation_k;
        // The interval under way must compare with its reading as if it had begun corrected.
        let moved = &mut self.movements;
        moved.response.mean_k += gains.element * innovation_k * f32::from(moved.steps);
        if learns {
            let by = |factor: f32, gain: f32| {
                let [least, most] = FACTORS;
                limit(factor * small_exp(gain * innovation_k), least, most)
            };
            self.scale = by(self.scale, gains.scale);
            self.stirring = by(self.stirring, gains.stirring);
            let [lag, housing_lag, place] = [gains.lag, gains.housing_lag, gains.place];
            let [lag, housing_lag, place] =
                [lag, housing_lag, place].map(|gain| gain * innovation_k);
            self.element.correct(&self.coefficients, lag, housing_lag, place);
        }
        self.exchange_due = true;
    }

    fn update_deviation(&mut self) {
        let noise = self.coefficients.pressure_sd_pa / self.pressure_pa;
        let shares = scaled(&self.zones.mass_kg, 1.0 / total(&self.zones.mass_kg));
        // Uniform within a wide code.
        let unseen = self.wide_volume * self.wide_volume * (1.0 / 3.0);
        let variance =
            self.covariance.gas(&shares) + self.energy.noise_left() * noise * noise + unseen;
        self.gas_sd_k = self.gas_k * limit(sqrt(variance), 1.0e-6, 1.0);
        self.wall_sd_k = sqrt(self.covariance.wall_k2());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// However well gas and wall exchange heat, an error of the gas does not grow over an interval.
    #[test]
    fn heat_to_the_wall_lets_no_error_grow() {
        let (cp_j_kg_k, gas_k, mass_kg) = (1005.0, 300.0, 1.0e-4);
        for exchanged in [0.0, 0.1, 1.0, 3.0, 30.0, 1.0e4_f32] {
            let moved = Movements {
                mass_kg: [mass_kg; ZONES],
                conductance_j_k: [exchanged * cp_j_kg_k * mass_kg; ZONES],
                ..Movements::default()
            };
            let ([row, ..], _) = moved.heat_rows(&[gas_k; ZONES], 1.0 / cp_j_kg_k);
            let [own, ..] = row.zones;
            let left = 1.0 + own / (cp_j_kg_k * gas_k * mass_kg);
            assert!((-1.0..=1.0).contains(&left), "{exchanged}: {left}");
            // The exact decay, if it is slow.
            let exact = (-exchanged).exp();
            assert!(exchanged > 1.0 || (left - exact).abs() < 0.04, "{exchanged}: {left}");
        }
    }
}
