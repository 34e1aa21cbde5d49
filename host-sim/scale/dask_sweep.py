#!/usr/bin/env python3
"""A sweep on a Dask cluster, with the rows of `thermyo sweep`.

    python dask_sweep.py SCENARIO.toml --vary KEY=FROM:TO:COUNT ... [--lhs N] --out sweep.csv [--scheduler ADDRESS]

Without an address the cluster is this machine. The package `thermyo` has to be installed where the workers are; the
scenario is sent to them as its text, with tables that it names by path. Rows lie in OUT.part until all are there: the
same line again goes on. When a worker dies, its points are reported and go to others; points on which
workers die three times are given up, and the exit code is 1.
"""

import argparse
import functools
import os
import pathlib
import sys

import dask
import distributed
import thermyo
from distributed.diagnostics.plugin import SchedulerPlugin

DIED = "thermyo-died"


@functools.lru_cache(maxsize=1)
def sweep_of(study):
    """Once per worker."""
    scenario, vary, lhs, seed = study
    return thermyo.Sweep(scenario, list(vary), lhs, seed)


def rows(study, first, last):
    """The rows of some points, both ends included."""
    return [sweep_of(study).row(point) for point in range(first, last + 1)]


class Watch(SchedulerPlugin):
    """Logs the points of a worker that died."""

    idempotent = True

    def start(self, scheduler):
        self.scheduler = scheduler

    def transition(self, key, start, finish, *args, **kwargs):
        task = self.scheduler.tasks.get(key)
        if start == "processing" and finish in ("released", "erred") and task is not None and task.suspicious:
            self.scheduler.log_event(DIED, str(key))


def whole(least, most):
    """Reads a whole number of that range."""

    def read(text):
        if text.isascii() and text.isdecimal() and least <= int(text) <= most:
            return int(text)
        raise argparse.ArgumentTypeError(f"{text}: must be a whole number from {least} to {most}")

    return read


def merged(header, done):
    return "\n".join([header] + [done[point] for point in sorted(done)]) + "\n"


def say(text):
    print(text, file=sys.stderr)


def run(client, study, out, batch=5, progress=lambda done: None, tell=say):
    """Runs the points missing in OUT.part and writes OUT; returns the points that were given up."""
    sweep = sweep_of(study)
    part = pathlib.Path(f"{out}.part")
    part.parent.mkdir(parents=True, exist_ok=True)
    done = {}
    if part.exists():
        lines = part.read_text().split("\n")[:-1]
        if lines[:1] != [sweep.header]:
            raise SystemExit(f"{part}: is of another sweep: move it, or choose another --out")
        done = {int(line.split(",", 1)[0]): line for line in lines[1:]}
    missing = [point for point in range(1, len(sweep) + 1) if point not in done]
    # Batches of neighbouring points.
    batches = []
    for point in missing:
        if batches and batches[-1][1] == point - 1 and point - batches[-1][0] < batch:
            batches[-1][1] = point
        else:
            batches.append([point, point])
    asked = {f"points-{first}-{last}": (first, last) for first, last in batches}

    def report(event):
        first, last = asked[event[1]]
        some = "; ".join(sweep.values(point) for point in range(first, min(last, first + 2) + 1))
        tell(f"a worker died at points {first} to {last} ({some}{' ...' if last > first + 2 else ''})")

    client.register_plugin(Watch(), name="thermyo-watch")
    client.subscribe_topic(DIED, report)
    futures = {
        client.submit(rows, study, first, last, key=name, pure=False): name for name, (first, last) in asked.items()
    }
    lost = []
    with part.open("a") as file:
        if not done:
            file.write(sweep.header + "\n")
        for future in distributed.as_completed(list(futures)):
            first, last = asked[futures.pop(future)]
            if future.status == "error":
                lost += range(first, last + 1)
                tell(f"points {first} to {last} given up ({sweep.values(first)} ...): {future.exception()}")
                continue
            texts = future.result()
            # Otherwise the death of its worker would repeat this finished work.
            future.release()
            # Whole lines in a single write.
            file.write("".join(text + "\n" for text in texts))
            file.flush()
            done.update(zip(range(first, last + 1), texts))
            progress(len(done))
    if not lost:
        new = pathlib.Path(f"{out}.new")
        new.write_text(merged(sweep.header, done))
        os.replace(new, out)
        part.unlink()
    return lost


def main():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("scenario", type=pathlib.Path)
    arguments.add_argument("--vary", action="append", required=True)
    arguments.add_argument("--lhs", type=whole(1, 10_000_000))
    arguments.add_argument("--seed", type=whole(0, 2**64 - 1), default=1)
    arguments.add_argument("--out", required=True)
    arguments.add_argument("--scheduler", help="address of a cluster [default: this machine]")
    arguments.add_argument("--batch", type=whole(1, 10_000_000), default=5, help="points of a task")
    given = arguments.parse_args()
    try:
        if os.path.exists(given.out):
            raise FileExistsError(f"{given.out}: exists already, and is left as it is; give another name")
        # Its messages name the file, which the workers do not have.
        thermyo.Sweep(given.scenario, given.vary, given.lhs, given.seed)
        study = (given.scenario.read_text(), tuple(given.vary), given.lhs, given.seed)
        sweep_of(study)
    except (thermyo.ScenarioError, OSError) as error:
        print(f"dask_sweep.py: {error}", file=sys.stderr)
        return 2
    dask.config.set({"distributed.scheduler.allowed-failures": 2})
    local = {} if given.scheduler else {"threads_per_worker": 1, "dashboard_address": None}
    with distributed.Client(given.scheduler, **local) as client:
        lost = run(client, study, given.out, given.batch)
    return 1 if lost else 0


if __name__ == "__main__":
    sys.exit(main())
