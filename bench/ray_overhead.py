"""The overhead of `dermis.ray.simulate` on this machine against `dermis simulate`; Ray's start is stated separately.

    python bench/ray_overhead.py [DESIGN] [--samples N] [--rounds N]

The rounds alternate between the two, on the same threads and with the same files; both include meshing and finishing.
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
    begun = time.perf_counter()
    work()
    return time.perf_counter() - begun


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
        start = seconds(lambda: ray.init(address="local", include_dashboard=False, logging_level="warning"))
        times = {program: [], cluster: []}
        for number in range(given.rounds):
            # The order alternates: other load on the machine meets both.
            for work in (program, cluster) if number % 2 else (cluster, program):
                times[work].append(seconds(work))
                shutil.rmtree(folder / ("ray" if work is cluster else "program"))
        one, many = (statistics.median(times[work]) for work in (program, cluster))
        print(f"{given.design}, {given.samples} samples, {os.cpu_count()} CPUs, medians of {given.rounds}")
        print(f"dermis simulate: {one:.1f} s ({', '.join(f'{value:.1f}' for value in times[program])})")
        print(f"dermis.ray.simulate: {many:.1f} s ({', '.join(f'{value:.1f}' for value in times[cluster])})")
        print(f"overhead {100 * (many / one - 1):.1f} %; start of Ray {start:.1f} s")
    finally:
        shutil.rmtree(folder)


if __name__ == "__main__":
    main()
