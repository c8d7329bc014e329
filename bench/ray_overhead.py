"""The overhead of `dermis.ray.simulate` on this machine against `dermis simulate`; Ray's start is stated separately.

    python bench/ray_overhead.py [DESIGN] [--samples N] [--rounds N]

The rounds alternate between the two, on the same threads and with the same files; both include meshing and finishing. CPU time is
that of all processes, Ray's own included: it depends less on other programs of the machine. Linux only.
"""

import argparse
import os
import shutil
import statistics
import tempfile
import time
from pathlib import Path

import dermis
import dermis.ray
import ray

# As `dermis simulate` without options.
RECIPE = """
skins = "even"
[touch.gaussian]
most = 4
width_m = [0.005, 0.015]
amplitude = [0.1, 2.0]
"""


def seconds(work):
    """Elapsed time, and CPU time of this process and its descendants."""
    begun, used = time.perf_counter(), cpu_seconds()
    work()
    return time.perf_counter() - begun, cpu_seconds() - used


def cpu_seconds():
    parents, ticks = {}, {}
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = path.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        # Times of a process, and of its children that have ended.
        pid = int(path.parent.name)
        parents[pid], ticks[pid] = int(fields[1]), sum(map(int, fields[11:15]))
    family = {os.getpid()}
    while found := {pid for pid, parent in parents.items() if parent in family} - family:
        family |= found
    return sum(ticks.get(pid, 0) for pid in family) / os.sysconf("SC_CLK_TCK")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("design", nargs="?", default="cylinder30")
    parser.add_argument("--samples", type=int, default=131_072)
    parser.add_argument("--rounds", type=int, default=3)
    given = parser.parse_args()
    os.environ.pop("RAY_ADDRESS", None)
    # Ray's tasks give way to other programs (nice 15); the program does not.
    os.environ["RAY_worker_niceness"] = "0"
    folder = Path(tempfile.mkdtemp(prefix="dermis-"))
    recipe = folder / "recipe.toml"
    recipe.write_text(RECIPE)
    numbers = {"recipe": recipe, "seed": 1, "samples": given.samples}

    def program():
        dermis.command("simulate", given.design, output=folder / "program", **numbers)
        dermis.command("simulate", finish=folder / "program")

    def cluster():
        dermis.ray.simulate(given.design, folder / "ray", **numbers)

    try:
        start, _ = seconds(lambda: ray.init(address="local", include_dashboard=False, logging_level="warning"))
        times = {program: [], cluster: []}
        for number in range(given.rounds):
            # The order alternates: other load on the machine meets both.
            for work in (program, cluster) if number % 2 else (cluster, program):
                times[work].append(seconds(work))
                shutil.rmtree(folder / ("ray" if work is cluster else "program"))
        print(f"{given.design}, {given.samples} samples, {os.cpu_count()} CPUs, {given.rounds} rounds; start of Ray {start:.1f} s")
        for kind, name in enumerate(["elapsed", "CPU time"]):
            one, many = ([round(time[kind], 1) for time in times[work]] for work in (program, cluster))
            overhead = 100 * (statistics.median(many) / statistics.median(one) - 1)
            print(f"{name}: dermis simulate {one} s, dermis.ray.simulate {many} s; overhead of the medians {overhead:.1f} %")
    finally:
        shutil.rmtree(folder)


if __name__ == "__main__":
    main()
