#!/usr/bin/env python3
"""Converts recordings of the tank of CBZ199671/PyEIDORS (MIT licence, see LICENSE here) to frames in ohm.

Usage: convert.py FOLDER, where FOLDER is the repository's `tank/2026-03-14_latest_tank_data`.

A recording has a row per value (drive d; measures (d+k, d+k+1), k = 2..14) and four columns: real and imaginary part of
the empty tank, then of the tank with its objects. The file's name states the current. The real part is divided by the
current and its sign turned: the recordings drive the other way round than this project's convention.
"""

import pathlib
import re
import sys

here = pathlib.Path(__file__).parent
objects = ["recording,electrode,material"]
for path in sorted(pathlib.Path(sys.argv[1]).glob("*/*.csv")):
    current = float(re.search(r"_(\d+)uA_", path.name).group(1)) * 1e-6
    found = re.findall(r"electrode(\d+)_(metal|plastic)", path.parent.name)
    name = "_".join(f"{kind}{int(electrode)}" for electrode, kind in found) + f"_{round(current * 1e6)}uA"
    rows = [[float(value) for value in line.split(",")] for line in path.read_text().split()]
    for part, column in (("empty", 0), ("objects", 2)):
        values = ",".join(f"{-row[column] / current:.6g}" for row in rows)
        (here / f"{name}_{part}.csv").write_text(values + "\n")
    objects += [f"{name},{int(electrode) - 1},{kind}" for electrode, kind in found]
(here / "objects.csv").write_text("\n".join(objects) + "\n")

channels = ["channel,drive_source,drive_sink,measure_plus,measure_minus"]
for d in range(16):
    for k in range(2, 15):
        channels.append(f"{len(channels) - 1},{d},{(d + 1) % 16},{(d + k) % 16},{(d + k + 1) % 16}")
(here / "channels.csv").write_text("\n".join(channels) + "\n")
