"""The equations of muscle.rs by SciPy. Reads the case as JSON from stdin; writes name, time and samples of each run."""

import json
import sys
import time
from math import copysign, pi, sqrt

try:
    from scipy.integrate import solve_ivp
except ImportError:
    sys.exit(3)


class Muscle:
    def __init__(self, values):
        self.__dict__.update(values)
        self.per_turns = 1 / (4 * pi * self.turns**2)

    def volume(self, length):
        return length * (self.thread_m**2 - length**2) * self.per_turns + self.dead_m3

    def area(self, length):
        return (3 * length**2 - self.thread_m**2) * self.per_turns

    def pull(self, pressure, length):
        return (pressure - self.ambient_pa) * self.area(length) - self.bladder_n_m * (self.rest_m - length)

    def stiffness(self, pressure, length, e):
        gas = e * pressure * self.area(length) ** 2 / self.volume(length)
        return gas + (pressure - self.ambient_pa) * 6 * length * self.per_turns + self.bladder_n_m

    def flow(self, upstream_pa, upstream_k, downstream_pa):
        above = max(downstream_pa / upstream_pa - self.critical_ratio, 0.0)
        phi = sqrt(1 - (above / (1 - self.critical_ratio)) ** 2)
        return self.conductance * upstream_pa * 1e5 / (self.r * 293.15) * sqrt(293.15 / upstream_k) * phi

    def place(self, energy, held):
        """Length, way it may slide, pressure."""
        pressure = (self.k - 1) * energy / self.volume(held)
        excess = self.pull(pressure, held) - self.load_n
        edge = self.friction_n * (1 - 1e-9)
        if not (excess > edge or (excess < -edge and held < self.rest_m)):
            return held, 0, pressure
        force = self.load_n + copysign(self.friction_n, excess)
        length = self.guess
        for _ in range(20):
            pressure = (self.k - 1) * energy / self.volume(length)
            correction = (self.pull(pressure, length) - force) / self.stiffness(pressure, length, 1)
            length -= correction
            if abs(correction) < 1e-7:
                self.guess = length
                break
        way = -copysign(1, excess)
        if length >= self.rest_m:
            length, way = self.rest_m, 0
        return length, way, (self.k - 1) * energy / self.volume(length)

    def rates(self, _, y, inlet, outlet, held):
        mass, energy, wall = y.tolist()
        h0, h1, h2, h3 = self.heat
        length, way, pressure = self.place(energy, held)
        volume, area = self.volume(length), self.area(length)
        gas = energy * (self.k - 1) / (self.r * mass)
        inflow = inlet * self.flow(self.supply_pa, self.supply_k, pressure)
        outflow = outlet * self.flow(pressure, gas, self.ambient_pa)
        surface = length * sqrt(self.thread_m**2 - length**2) / self.turns
        heat = (h0 + h1 * inflow) * surface * (gas - wall)
        source = self.k * self.r / (self.k - 1) * (inflow * self.supply_k - outflow * gas) - heat
        free = -area * (self.k - 1) * source / volume / self.stiffness(pressure, length, self.k)
        speed = free if free * way > 0 else 0.0
        friction = self.friction_to_wall * self.friction_n * abs(speed)
        lost = (h2 + h3 * abs(speed)) * surface * (wall - self.ambient_k)
        return [inflow - outflow, source + pressure * area * speed, (heat + friction - lost) / self.wall_j_k]


def run(case, method, tolerance):
    muscle = Muscle(case["muscle"])
    y, held, samples = case["start"], case["held_m"], []
    start = time.perf_counter()
    for duration, inlet, outlet in case["drive"]:
        muscle.guess = held
        times = [(i + 1) * case["sample_s"] for i in range(round(duration / case["sample_s"]))]
        atol = case["least_kg"] * tolerance
        options = {"args": (inlet, outlet, held), "rtol": tolerance, "atol": atol}
        solved = solve_ivp(muscle.rates, (0, times[-1]), y, method, times, **options)
        muscle.guess = held
        for mass, energy, _ in solved.y.T.tolist():
            length, _, pressure = muscle.place(energy, held)
            samples.append([pressure, energy * (muscle.k - 1) / (muscle.r * mass), length])
        y, held = solved.y[:, -1], samples[-1][2]
    seconds = time.perf_counter() - start
    name = f"SciPy {method}, {tolerance:.0e}".replace("e-0", "e-")
    return {"name": name, "seconds": seconds, "samples": samples}


case = json.load(sys.stdin)
json.dump([run(case, method, tolerance) for method, tolerance in case["runs"]], sys.stdout)
