"""Cross-checks the tables of a folder of `dermis fabricate` with each other, and shows that exchanged rows are caught.

Usage: check_tables.py FOLDER

Every file is read by code of its own here: electrodes, wiring, scan table (CSV and C header, the latter by a C compiler,
too, where there is one), expected readings, netlist, robot descriptions (URDF, xacro, MJCF), parts and manifest. Then the
contents of every pair of rows (all columns but the number in the first) are exchanged, one pair at a time, and the same
checks must find each.
"""

import csv
import json
import math
import re
import shutil
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ElementTree
from itertools import combinations
from pathlib import Path

import numpy as np

FOLDER = Path(sys.argv[1])
INPUTS, NONE = 32, 0xFFFF
REFERENCE = INPUTS - 1
LINES = ("source", "sink", "plus", "minus")


def rows(name):
    with (FOLDER / name).open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def numbers(table, columns, kind=float):
    return np.array([[kind(row[column]) for column in columns] for row in table])


def slots(table):
    """Source, sink, plus, minus and channel of each row; `NONE` where there is none."""
    columns = ("drive_source", "drive_sink", "measure_plus", "measure_minus", "channel")
    return np.array([[int(row[column]) if row[column] else NONE for column in columns] for row in table])


def header_arrays(text):
    """The arrays of the C header, by their text."""
    def array(name):
        body = re.search(rf"{name}\[DERMIS_SLOT_COUNT\]\[4\] = \{{\n(.*?)\n\}};", text, re.S).group(1)
        values = [line.strip(" {},").replace("DERMIS_ON_REFERENCE", str(NONE)).split(", ") for line in body.split("\n")]
        return np.array(values, dtype=int)

    sha256 = "".join(re.findall(r"0x([0-9a-f]{2})\b", text.split("dermis_design_sha256[32]")[1].split("}")[0]))
    count = int(re.search(r"#define DERMIS_SLOT_COUNT (\d+)", text).group(1))
    return count, array("dermis_scan_table"), array("dermis_scan_places"), sha256


def compiled_arrays():
    """The arrays as a C compiler understands the header."""
    program = """#include <stdio.h>
#include "scan_table.h"
int main(void) {
    for (int k = 0; k < DERMIS_SLOT_COUNT; k++)
        for (int line = 0; line < 4; line++) printf("%d %d ", dermis_scan_table[k][line], dermis_scan_places[k][line]);
    return dermis_design_sha256[0] < 0;
}
"""
    with tempfile.TemporaryDirectory() as at:
        source, binary = Path(at, "main.c"), Path(at, "main")
        source.write_text(program)
        command = ["cc", "-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-Wno-type-limits", f"-I{FOLDER}/tables"]
        subprocess.run([*command, str(source), "-o", str(binary)], check=True)
        said = subprocess.run([str(binary)], capture_output=True, text=True, check=True).stdout
    both = np.array(said.split(), dtype=int).reshape(-1, 4, 2)
    return both[:, :, 0], both[:, :, 1]


def netlist_reads(text):
    """Source, sink, plus and minus of each voltage that the netlist prints, in its order."""
    drive, reads = {}, []
    for line in text.splitlines():
        if found := re.match(r"alter R(source|sink)(\d+) (\S+)$", line):
            side, electrode, ohm = found.groups()
            if float(ohm) < 1e6:
                drive[side] = int(electrode)
        elif found := re.match(r"print v\(e(\d+)\)-v\(e(\d+)\)$", line):
            reads.append((drive["source"], drive["sink"], int(found.group(1)), int(found.group(2))))
    return np.array(reads)


def netlist_ohm(text):
    """Resistance between each two electrodes of the netlist's skin alone."""
    admittance = np.zeros((COUNT, COUNT))
    for a, b, ohm in re.findall(r"^Rskin(\d+)_(\d+) e\d+ e\d+ (\S+)$", text, re.M):
        a, b, siemens = int(a), int(b), 1 / float(ohm)
        admittance[[a, b, a, b], [a, b, b, a]] += [siemens, siemens, -siemens, -siemens]
    inverse = np.linalg.pinv(admittance, rcond=1e-10)
    own = np.diag(inverse)
    return own[:, None] + own[None, :] - 2 * inverse


def urdf_frames(root):
    """Place (mm) and z axis of the frame of each electrode, by its name's number."""
    frames = {}
    for joint in root.findall("joint"):
        if found := re.search(r"_electrode_(\d+)$", joint.find("child").get("link")):
            place = [1e3 * float(value) for value in joint.find("origin").get("xyz").split()]
            _, pitch, yaw = (float(value) for value in joint.find("origin").get("rpy").split())
            axis = [math.cos(yaw) * math.sin(pitch), math.sin(yaw) * math.sin(pitch), math.cos(pitch)]
            frames[int(found.group(1))] = place + axis
    return np.array([frames[electrode] for electrode in range(len(frames))])


def mjcf_frames(root):
    frames = {}
    for site in root.findall(".//site"):
        place = [1e3 * float(value) for value in site.get("pos").split()]
        axis = [float(value) for value in site.get("zaxis").split()]
        frames[int(site.get("name").rsplit("_", 1)[1])] = place + axis
    return np.array([frames[electrode] for electrode in range(len(frames))])


electrodes, wiring, scan = (rows(f"tables/{name}.csv") for name in ("electrodes", "wiring", "scan-table"))
readings, parts = rows("tables/readings.csv"), rows("tables/parts.csv")
manifest = json.loads((FOLDER / "manifest.json").read_text())
urdf = ElementTree.parse(FOLDER / "robot/skin.urdf").getroot()
# The prefix is a literal text to this parser: links and joints of the macro are read as those of a robot.
macro = ElementTree.parse(FOLDER / "robot/skin.urdf.xacro").getroot().find("{http://www.ros.org/wiki/xacro}macro")
mjcf = ElementTree.parse(FOLDER / "robot/skin.xml").getroot()
HEADER = header_arrays((FOLDER / "tables/scan_table.h").read_text())
FRAMES = [urdf_frames(urdf), urdf_frames(macro), mjcf_frames(mjcf)]
READS = netlist_reads((FOLDER / "tables/skin.cir").read_text())
COUNT = len(FRAMES[0])


def electrodes_agree(number, label, place, bore):
    """The table of electrodes against the robot descriptions and the labels; bores are beside their electrodes."""
    return (
        (number == np.arange(COUNT)).all()
        and (label == LABELS).all()
        and all(np.abs(place - frames).max() < 2e-5 for frames in FRAMES)
        and (np.abs(np.linalg.norm(bore[:, :3] - place[:, :3], axis=1) - bore[:, 4]) < 1e-3).all()
    )


def wiring_agrees(number, label, place):
    """The wiring against the places that the scan table gives the electrodes, and no place twice."""
    return (
        (number == np.arange(COUNT)).all()
        and (label == LABELS).all()
        and (place == PLACES_OF_SCAN).all()
        and len(np.unique(place)) == COUNT
        and not (place == REFERENCE).any()
    )


def scan_agrees(slot, connected, places):
    """The scan table against the C header, the readings and the wiring."""
    return (
        (slot == np.arange(len(slot))).all()
        and np.array_equal(connected[:, :4], HEADER[1])
        and np.array_equal(connected, READ_SLOTS)
        and np.array_equal(places, HEADER[2])
        and np.array_equal(places, WIRED[connected[:, :4]])
    )


LABELS = np.array([f"E{k:0{len(str(COUNT - 1))}d}" for k in range(COUNT)])
READ_SLOTS = slots(readings)
ELECTRODES = (
    numbers(electrodes, ["electrode"], int)[:, 0],
    np.array([row["label"] for row in electrodes]),
    numbers(electrodes, ["x_mm", "y_mm", "z_mm", "normal_x", "normal_y", "normal_z"]),
    numbers(electrodes, ["bore_x_mm", "bore_y_mm", "bore_z_mm", "bore_mm", "moved_mm"]),
)
WIRING = (
    numbers(wiring, ["electrode"], int)[:, 0],
    np.array([row["label"] for row in wiring]),
    numbers(wiring, ["multiplexer", "input"], int) @ [INPUTS, 1],
)
SCAN = (
    numbers(scan, ["slot"], int)[:, 0],
    slots(scan),
    np.stack([numbers(scan, [f"{line}_multiplexer", f"{line}_input"], int) @ [INPUTS, 1] for line in LINES], axis=1),
)
# The place of each electrode by the wiring (that of the reference resistor for `NONE`), and by the scan table.
WIRED = np.full(NONE + 1, -1)
WIRED[: len(WIRING[2])], WIRED[NONE] = WIRING[2], REFERENCE
PLACES_OF_SCAN = np.full(COUNT, -1)
for line in range(4):
    used = SCAN[1][:, line] != NONE
    PLACES_OF_SCAN[SCAN[1][used, line]] = SCAN[2][used, line]


def check_agreement():
    assert len(electrodes) == len(wiring) == COUNT == len(FRAMES[1]) == len(FRAMES[2])
    assert electrodes_agree(*ELECTRODES) and wiring_agrees(*WIRING) and scan_agrees(*SCAN)
    assert HEADER[0] == len(HEADER[1]) == len(HEADER[2]) == len(scan) == len(readings)
    assert HEADER[3] == manifest["skin_sha256"]
    measured = SCAN[1][SCAN[1][:, 4] != NONE]
    assert np.array_equal(READS, measured[:, :4]), "netlist"
    assert sorted(measured[:, 4]) == list(range(len(measured)))
    # A drive's current is read once, before its voltages.
    currents = SCAN[1][:, 4] == NONE
    begins = np.r_[True, (SCAN[1][1:, :2] != SCAN[1][:-1, :2]).any(axis=1)]
    assert (currents == begins).all()
    assert {row["part"]: row["quantity"] for row in parts}["electrode"] == str(COUNT)
    multiplexers = int({row["part"]: row["quantity"] for row in parts}["multiplexer"])
    assert multiplexers >= 4 * (WIRING[2].max() // INPUTS + 1) and multiplexers % 4 == 0
    frame = urdf.find("link").get("name")
    assert mjcf.find(".//body").get("name") == frame and macro.get("name") == f"dermis_{frame}"
    for view in ("skin.rviz", "foxglove.json", "skin.launch.py"):
        assert frame in (FOLDER / "robot" / view).read_text(), view
    for row in readings:
        for what in ("ohm", "volt"):
            if row[what]:
                low, value, high = (float(row[what + part]) for part in ("_low", "", "_high"))
                assert low < value < high, row
    print(f"tables: {COUNT} electrodes, {len(scan)} slots, {len(READS)} netlist voltages, 3 robot descriptions agree")
    if shutil.which("cc") is None:
        print("C header: by its text alone, no compiler is installed")
    else:
        table, places = compiled_arrays()
        assert np.array_equal(table, HEADER[1]) and np.array_equal(places, HEADER[2])
        print("C header: compiled without a warning, its arrays agree")


def check_neighbours():
    """The ohmmeter's values against the netlist; every electrode is measured twice."""
    table = rows("tables/neighbours.csv")
    expected = netlist_ohm((FOLDER / "tables/skin.cir").read_text())
    worst = 0.0
    for row in table:
        a, b = int(row["electrode_a"]), int(row["electrode_b"])
        assert (row["label_a"], row["label_b"]) == (LABELS[a], LABELS[b])
        low, ohm, high = (float(row["ohm" + part]) for part in ("_low", "", "_high"))
        assert low < ohm < high
        worst = max(worst, abs(ohm / expected[a, b] - 1))
    ends = [int(row[key]) for row in table for key in ("electrode_a", "electrode_b")]
    assert np.bincount(ends, minlength=COUNT).min() >= 2
    assert worst < 1e-5, worst
    print(f"neighbours.csv: {len(table)} resistances within {worst:.1e} of the netlist's")


def exchanged(columns, i, j):
    """Some columns with rows i and j exchanged, but the numbers in the first."""
    changed = [column.copy() for column in columns]
    for column in changed[1:]:
        column[[i, j]] = column[[j, i]]
    return changed


def check_exchanges(name, columns, agrees):
    pairs = list(combinations(range(len(columns[0])), 2))
    missed = [(i, j) for i, j in pairs if agrees(*exchanged(columns, i, j))]
    assert not missed, (name, missed[:10])
    # Whole rows, which leaves the contents right and the order wrong.
    for i in range(len(columns[0]) - 1):
        changed = [column.copy() for column in columns]
        for column in changed:
            column[[i, i + 1]] = column[[i + 1, i]]
        assert not agrees(*changed), (name, i)
    print(f"{name}: {len(pairs)} of {len(pairs)} exchanged pairs of rows caught")


check_agreement()
check_neighbours()
check_exchanges("electrodes.csv", ELECTRODES, electrodes_agree)
check_exchanges("wiring.csv", WIRING, wiring_agrees)
check_exchanges("scan-table.csv", SCAN, scan_agrees)
