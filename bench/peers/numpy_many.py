"""Runs the comparison that `numpy.sh` describes: agreement first, then both take turns, medians at the end."""

import argparse
import os
import pathlib
import sys
import tempfile
import time

import numpy as np

import dermis
from page import CORES, Program, machine, write_page

MARK = "<!-- table: bench/peers/numpy.sh -->"
MAPS, ROUNDS, BAR = 1000, 15, 1.05


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="put the table into docs/benchmarks.md")
    arguments = parser.parse_args()
    os.sched_setaffinity(0, CORES[-1:])
    load = os.getloadavg()[0]
    skin = dermis.Skin.load("cylinder30")
    with tempfile.TemporaryDirectory() as folder:
        program = Program(["serve", "cylinder30", folder])
        few, voltages = (np.load(pathlib.Path(folder) / f"{name}.npy") for name in ("conductivities", "voltages"))
        rows = np.arange(MAPS) % len(few)
        conductivities, ours, theirs = few[rows], [], []
        # The benchmark's model has no resistances in series with discs, which are constant: differences agree.
        frames, expected = (values - values[0] for values in (skin.forward(conductivities), voltages[rows]))
        error = np.abs(frames - expected).max() / np.abs(expected).max()
        if not error < 1e-9:
            sys.exit(f"the frames differ by {error:.0e}")
        for _ in range(ROUNDS):
            theirs += program.times(f"many {MAPS} 1")
            start = time.perf_counter()
            skin.forward(conductivities)
            ours.append(time.perf_counter() - start)
        program.close()
    row = lambda name, times: f"| {name} | {1e3 * np.median(times):.0f} | {1e3 * min(times):.0f} |"
    # Other work on the machine delays single turns.
    ratio = min(ours) / min(theirs)
    lines = [MARK, f"| {MAPS:,} conductivities of `cylinder30` | median, ms | fastest, ms |", "|---|---|---|"]
    lines += [row("Rust", theirs), row("Python, NumPy", ours), f"| ratio | | {ratio:.3f} |"]
    text = "\n".join([f"{machine(['numpy'])} Load average before the run {load:.1f}.", "", *lines])
    print(text)
    if arguments.write:
        write_page(text, "numpy")
    if ratio > BAR:
        sys.exit(f"Python takes {ratio:.3f} times as long, more than {BAR}")


if __name__ == "__main__":
    main()
