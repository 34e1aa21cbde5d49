"""A sweep on a local Dask cluster, a worker killed in the middle: the bytes of one machine, and what a point costs.

Called by test.sh. Arguments: its folder, then the sweep's.
"""

import os
import pathlib
import signal
import subprocess
import sys
import time

import dask
import distributed
import dask_sweep


def refused(scenario, out, message):
    command = [sys.executable, dask_sweep.__file__, scenario, "--vary", "run.seed=1:2:2", "--out", out]
    said = subprocess.run(command, capture_output=True, text=True)
    assert (said.returncode, said.stderr) == (2, f"dask_sweep.py: {message}\n"), said


def main():
    folder, arguments = pathlib.Path(sys.argv[1]), list(zip(sys.argv[2::2], sys.argv[3::2]))
    options = dict(arguments)
    vary = tuple(value for option, value in arguments if option == "--vary")
    short, nothing = (
        ((folder / name).read_text(), vary, int(options["--lhs"]), int(options["--seed"]))
        for name in ("short.toml", "nothing.toml")
    )
    scenario, absent = folder / "short.toml", folder / "absent.toml"
    refused(absent, folder / "absent.csv", f"{absent}: no such file")
    refused(scenario, scenario, f"{scenario}: exists already, and is left as it is; give another name")
    # The first two were tracebacks.
    for option, value in (("--lhs", "-1"), ("--seed", str(2**64)), ("--batch", "0")):
        command = [sys.executable, dask_sweep.__file__, scenario, "--vary", "run.seed=1:2", "--out", "x.csv"]
        said = subprocess.run([*command, option, value], capture_output=True, text=True)
        assert said.returncode == 2 and f"{option}: {value}: must be a whole number from " in said.stderr, said
    dask.config.set({"distributed.scheduler.allowed-failures": 2})
    cores = os.cpu_count()
    with distributed.LocalCluster(n_workers=cores, threads_per_worker=1, dashboard_address=None) as cluster:
        with distributed.Client(cluster) as client:
            killed = []

            def kill(done):
                if done >= 300 and not killed:
                    killed.append(client.run(os.getpid).popitem()[1])
                    os.kill(killed[0], signal.SIGKILL)

            out = folder / "dask.csv"
            reported = []
            assert dask_sweep.run(client, short, out, progress=kill, tell=reported.append) == []
            assert killed, "no worker was killed"
            assert any(text.startswith("a worker died at points ") and " = " in text for text in reported), reported
            print(reported[0])
            assert out.read_bytes() == (folder / "one" / "sweep.csv").read_bytes(), "Dask: other bytes than one machine"
            begin = time.perf_counter()
            assert dask_sweep.run(client, nothing, folder / "nothing.csv") == []
            took = time.perf_counter() - begin
    points = short[2]
    print(
        f"Dask: {points} points, a worker killed at 300: the bytes of one machine; a point that costs nothing: "
        f"{took * cores / points * 1e3:.2f} ms of a core"
    )


if __name__ == "__main__":
    main()
