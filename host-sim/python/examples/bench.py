"""Speed of `run` against the command, and plant and core step by step. It prints times and has no limits."""

import json
import subprocess
import sys
import time

import thermyo

STEPS = 100_000


def taken_s(work):
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def stepped(scenario):
    muscle, core = thermyo.Muscle(scenario), thermyo.Core(scenario)
    readings = muscle.readings
    for _ in range(STEPS):
        readings = muscle.step(*core.step(readings).duties)


def command_s(scenario):
    """Time by the command's own clock, without its start and its report."""
    arguments = [sys.argv[1], "run", scenario, "--quiet", "--json", "--out", sys.argv[2]]
    summary = json.loads(subprocess.run(arguments, capture_output=True, check=True).stdout)
    return summary["duration_s"] / summary["real_time_factor"]


for scenario in sys.argv[3:]:
    # Alternating, and the shortest of each: other load on the machine only lengthens them.
    turns = [(command_s(scenario), taken_s(lambda: thermyo.run(scenario))) for _ in range(7)]
    command, run = (min(times) for times in zip(*turns))
    rate = STEPS / min(taken_s(lambda: stepped(scenario)) for _ in range(3))
    print(f"{scenario}: run {run:.3f} s, {run / command:.2f} of the command's; plant and core stepped: {rate:.0f} steps/s")
