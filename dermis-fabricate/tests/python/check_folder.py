"""Checks a folder of `dermis fabricate` against the design's file, with other programs and with formulas of its own.

Usage: check_folder.py FOLDER DESIGN.toml
"""

import hashlib
import json
import math
import re
import shutil
import subprocess
import sys
import tomllib
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import ezdxf
import numpy as np
import trimesh

FOLDER, DESIGN = Path(sys.argv[1]), Path(sys.argv[2])
design = tomllib.loads(DESIGN.read_text())
given = design.get("fabrication", {})
WALL = 1e3 * given.get("wall_m", 0.005)
BORE = 1e3 * given.get("bore_m", 0.003)
DEPTH = 1e3 * given.get("channel_depth_m", 0.002)
FLANGE = 1e3 * given.get("flange_m", 0.0)
PITCH = 1e3 * given.get("patch_pitch_m", 0.010)
GAP = 1e3 * given.get("patch_gap_m", 0.001)
KERF = 1e3 * given.get("kerf_m", 0.0002)
SEAM = given.get("seam_theta_rad", 0.0)
OVERLAP = 1e3 * given.get("overlap_m", 0.0)
LAND = 1.0
EDGE = max(0.5 * BORE + LAND - FLANGE, 0.0)
KIND, BODY = next(iter(design["body"].items()))


def electrodes():
    """Centres of the electrodes, mm, from the layouts that the tested designs use."""
    layout = design["electrodes"]["layout"]
    if "rings" in layout:
        rings, radius = layout["rings"], 500.0 * BODY["diameter_m"]
        for ring in range(rings["rings"]):
            turn = rings.get("stagger", 0.0) if ring % 2 else 0.0
            for k in range(rings["per_ring"]):
                theta = rings.get("first_theta_rad", 0.0) + (k + turn) * math.tau / rings["per_ring"]
                z = 1e3 * (rings.get("first_z_m", 0.0) + ring * rings["spacing_m"])
                yield np.array([radius * math.cos(theta), radius * math.sin(theta), z])
    elif "rim" in layout:
        count, radius = layout["rim"]["count"], 500.0 * BODY["diameter_m"]
        for k in range(count):
            yield np.array([radius * math.cos(k * math.tau / count), radius * math.sin(k * math.tau / count), 0.0])
    elif "grid" in layout:
        grid, margin = layout["grid"], 1e3 * layout["grid"]["margin_m"]
        size = [1e3 * BODY["width_m"], 1e3 * BODY["height_m"]]
        for row in range(grid["rows"]):
            for column in range(grid["columns"]):
                x = margin + column * (size[0] - 2 * margin) / (grid["columns"] - 1)
                y = margin + row * (size[1] - 2 * margin) / (grid["rows"] - 1)
                yield np.array([x, y, 0.0])
    else:
        for place in layout["positions"]:
            yield 1e3 * np.array([place["x_m"], place["y_m"], place["z_m"]])


def bores():
    """Axis of each bore: a point of the surface and the outward normal."""
    surface = body_file() if KIND == "mesh" else None
    for centre in electrodes():
        if KIND == "cylinder":
            z = min(max(centre[2], EDGE), 1e3 * BODY["length_m"] - EDGE)
            yield np.array([centre[0], centre[1], z]), np.array([centre[0], centre[1], 0.0]) / np.hypot(*centre[:2])
        elif KIND == "disk":
            most, radius = 500.0 * BODY["diameter_m"] - EDGE, np.hypot(*centre[:2])
            yield centre * min(1.0, most / radius), np.array([0.0, 0.0, 1.0])
        elif KIND == "rectangle":
            high = np.array([1e3 * BODY["width_m"], 1e3 * BODY["height_m"]]) - EDGE
            yield np.array([*np.clip(centre[:2], EDGE, high), 0.0]), np.array([0.0, 0.0, 1.0])
        else:
            # Trimesh's nearest point needs a spatial index; the surface is small enough without.
            nearest = trimesh.triangles.closest_point(surface.triangles, np.tile(centre, (len(surface.triangles), 1)))
            face = np.argmin(np.linalg.norm(nearest - centre, axis=1))
            weights = trimesh.triangles.points_to_barycentric(surface.triangles[[face]], nearest[[face]])[0]
            normal = weights @ surface.vertex_normals[surface.faces[face]]
            yield nearest[face], normal / np.linalg.norm(normal)


def body_file():
    path = DESIGN.parent / BODY["path"]
    mesh = trimesh.load(path, force="mesh")
    mesh.apply_scale(1e3 * BODY["unit_m"])
    return mesh


def designed_genus():
    count = len(list(electrodes()))
    if KIND == "cylinder":
        return 1 + count
    if KIND in ("disk", "rectangle"):
        return count
    # The boundary of a thickened surface has twice its Euler characteristic, and each bore takes two off.
    return 1 - (2 * body_file().euler_number - 2 * count) // 2


def check_manifest():
    manifest = json.loads((FOLDER / "manifest.json").read_text())
    listed = {entry["path"] for entry in manifest["files"]}
    found = {str(path.relative_to(FOLDER)) for path in FOLDER.rglob("*") if path.is_file()} - {"manifest.json"}
    assert listed == found, (listed, found)
    for entry in manifest["files"]:
        content = (FOLDER / entry["path"]).read_bytes()
        assert hashlib.sha256(content).hexdigest() == entry["sha256"], entry
        assert len(content) == entry["bytes"] and entry["purpose"], entry
    print(f"manifest: {len(listed)} files, sizes and SHA-256 right")


def check_base():
    mesh = trimesh.load(FOLDER / "base.stl", force="mesh")
    genus = 1 - mesh.euler_number // 2
    assert mesh.is_watertight and mesh.is_winding_consistent and mesh.volume > 0.0
    parts = trimesh.graph.connected_components(mesh.face_adjacency, nodes=np.arange(len(mesh.faces)), engine="networkx")
    assert len(list(parts)) == 1
    assert genus == designed_genus(), (genus, designed_genus())
    other = trimesh.load(FOLDER / "base.3mf", force="mesh")
    assert other.units in ("mm", "millimeter", "millimeters"), other.units
    assert other.is_watertight and abs(other.volume / mesh.volume - 1.0) < 1e-6
    print(f"base: {len(mesh.faces)} triangles, {mesh.volume / 1e3:.3f} cm3, watertight, genus {genus} as designed")
    worst = max(bore_error(mesh, point, normal) for point, normal in bores())
    assert worst < 0.01, worst
    print(f"bores: {len(list(bores()))}, within {1e3 * worst:.1f} um")
    check_normals(mesh)


def bore_error(mesh, point, normal):
    """Largest difference of a bore's section from its circle, half-way between the surface and the channels' floor."""
    origin = point - 0.5 * (WALL - DEPTH) * normal
    lines = mesh.section(plane_origin=origin, plane_normal=normal).discrete
    nearest = min(lines, key=lambda line: np.linalg.norm(line.mean(axis=0) - origin))
    # Points of the outline between its corners, too.
    dense = np.concatenate([nearest[:-1] + t * np.diff(nearest, axis=0) for t in (0.0, 0.25, 0.5, 0.75)])
    return np.abs(np.linalg.norm(dense - origin, axis=1) - 0.5 * BORE).max()


def check_normals(mesh):
    raw = np.frombuffer((FOLDER / "base.stl").read_bytes()[84:], dtype=np.dtype([("f", "<f4", 12), ("n", "<u2")]))["f"]
    corners = raw[:, 3:].reshape(-1, 3, 3).astype(float)
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    cross /= np.linalg.norm(cross, axis=1, keepdims=True)
    error = np.linalg.norm(cross - raw[:, :3], axis=1).max()
    assert error < 1e-6, error
    if shutil.which("admesh") is None:
        print("admesh: skipped, it is not installed")
        return
    said = subprocess.run(["admesh", str(FOLDER / "base.stl")], capture_output=True, text=True, errors="replace", check=True).stdout
    for line in ("Number of parts", "Degenerate facets", "Edges fixed", "Facets removed", "Facets added",
                 "Facets reversed", "Backwards edges", "Normals fixed", "Total disconnected facets"):
        value = int(re.search(re.escape(line) + r"\s*:\s*(\d+)", said).group(1))
        assert value == (1 if line == "Number of parts" else 0), (line, value)
    print("admesh: one part, nothing mended, no normal fixed")


def outlines_of_dxf(path):
    document = ezdxf.readfile(path)
    auditor = document.audit()
    assert not auditor.errors and not auditor.fixes, (auditor.errors, auditor.fixes)
    assert document.dxfversion == "AC1015" and document.units == 4
    layers = {}
    for entity in document.modelspace():
        if entity.dxftype() == "TEXT":
            assert entity.dxf.layer == "LABELS"
            continue
        assert entity.dxftype() == "LWPOLYLINE" and entity.closed, entity
        assert entity.dxf.layer in document.layers, entity.dxf.layer
        layers.setdefault(entity.dxf.layer, []).append([(x, y, bulge) for x, y, bulge in entity.get_points("xyb")])
    return layers


def outlines_of_svg(path):
    root = ElementTree.parse(path).getroot()
    name = "{http://www.w3.org/2000/svg}"
    width, height = (float(root.get(key).removesuffix("mm")) for key in ("width", "height"))
    assert root.get("viewBox") == f"0 0 {root.get('width')[:-2]} {root.get('height')[:-2]}"
    layers = {}
    for group in root.findall(f"{name}g"):
        if group.get("id") == "LABELS":
            continue
        for path in group.findall(f"{name}path"):
            text = path.get("d")
            assert text.startswith("M") and text.endswith("Z"), text
            points = []
            if "A" in text:
                x0, y0, radius, x1, y1 = map(float, re.match(r"M(\S+),(\S+)A(\S+),\S+ 0 0 0 (\S+),(\S+)A", text).groups())
                assert abs(x1 - x0 - 2.0 * radius) < 1e-6 and y0 == y1
                points = [(x0, height - y0, 1.0), (x1, height - y1, 1.0)]
            else:
                for corner in text[1:-1].split("L"):
                    x, y = map(float, corner.split(","))
                    points.append((x, height - y, 0.0))
            layers.setdefault(group.get("id"), []).append(points)
    return layers, width, height


def area(points):
    """Area of a polyline with bulges: the polygon, and a circular segment for each bulge."""
    total = 0.0
    for (x0, y0, bulge), (x1, y1, _) in zip(points, points[1:] + points[:1]):
        total += 0.5 * (x0 * y1 - x1 * y0)
        if bulge:
            angle, chord = 4.0 * math.atan(bulge), math.hypot(x1 - x0, y1 - y0)
            radius = 0.5 * chord / math.sin(0.5 * angle)
            total += 0.5 * radius * radius * (angle - math.sin(angle))
    return total


def box(points):
    """Lower and upper corner of a polygon, or of a circle of two half circles."""
    if len(points) == 2:
        (x0, y, _), (x1, _, _) = points
        radius = 0.5 * (x1 - x0)
        return np.array([x0, y - radius]), np.array([x1, y + radius])
    corners = np.array(points)[:, :2]
    return corners.min(axis=0), corners.max(axis=0)


def read_sheet(name):
    dxf = outlines_of_dxf(FOLDER / f"patterns/{name}.dxf")
    svg, width, height = outlines_of_svg(FOLDER / f"patterns/{name}.svg")
    assert dxf.keys() == svg.keys(), (dxf.keys(), svg.keys())
    for layer in dxf:
        assert len(dxf[layer]) == len(svg[layer])
        for a, b in zip(dxf[layer], svg[layer]):
            assert np.abs(np.array(a) - np.array(b)).max() < 1e-6, (layer, a, b)
            assert abs(area(a) / area(b) - 1.0) < 1e-6 and area(a) > 0.0
            low, high = box(a)
            assert (low > 9.9).all() and high[0] < width - 9.9 and high[1] < height - 9.9
    low, high = box(dxf["SCALE"][0])
    assert abs(high[0] - low[0] - 100.0) < 1e-6
    piece, hole = (np.subtract(*box(points)[::-1]) for points in dxf["COUPON"])
    assert np.abs(piece - 20.0 - KERF).max() < 1e-6 and np.abs(hole - 10.0 + KERF).max() < 1e-6
    print(f"{name}: no error, no repair, SVG = DXF;", ", ".join(f"{len(v)} {k}" for k, v in dxf.items()))
    return dxf


def lines_along(length):
    count = max(1, round(length / PITCH))
    return count, length / count


def check_patterns():
    """Patches, foam, coat and bores at the places and sizes of the design."""
    sheets = {path.stem: read_sheet(path.stem) for path in sorted(FOLDER.glob("patterns/*.dxf"))}
    patches = sheets["patches"]["PATCHES"]
    if KIND == "mesh":
        nominal = math.pi * (0.5 * (PITCH - GAP + KERF)) ** 2
        assert all(abs(area(patch) / nominal - 1.0) < 1e-6 for patch in patches)
        return
    size = {
        "cylinder": lambda: [math.pi * 1e3 * BODY["diameter_m"], 1e3 * BODY["length_m"]],
        "disk": lambda: [1e3 * BODY["diameter_m"]] * 2,
        "rectangle": lambda: [1e3 * BODY["width_m"], 1e3 * BODY["height_m"]],
    }[KIND]()
    (columns, across), (rows, along) = (lines_along(length) for length in size)
    if KIND == "disk":
        check_disk(size, columns, across, patches, sheets)
        return
    assert len(patches) == rows * columns, (len(patches), rows, columns)
    nominal = (across - GAP + KERF) * (along - GAP + KERF)
    assert all(abs(area(patch) / nominal - 1.0) < 1e-6 for patch in patches)
    # The lower left patch begins half a gap, less half a kerf, from the corner of the coat.
    corner = box(patches[0])[0] - 0.5 * (GAP - KERF)
    for number, patch in enumerate(patches):
        row, column = divmod(number, columns)
        expected = corner + np.array([column * across, row * along]) + 0.5 * (GAP - KERF)
        assert np.abs(box(patch)[0] - expected).max() < 0.005
    foam = box(sheets["foam"]["FOAM"][0])
    assert np.abs(foam[1] - foam[0] - [size[0] + KERF + (OVERLAP if KIND == "cylinder" else 0.0), size[1] + KERF]).max() < 0.005
    coat = sheets["coat-mask"]["COAT"][0]
    assert abs(area(coat) / ((size[0] - KERF) * (size[1] - KERF)) - 1.0) < 1e-6
    check_drill(sheets["drill-template"], size)


def unrolled(point):
    if KIND != "cylinder":
        return point[:2]
    theta = (math.atan2(point[1], point[0]) - SEAM) % math.tau
    return np.array([500.0 * BODY["diameter_m"] * theta, point[2]])


def check_drill(sheet, size):
    """Centres of the bores on the unrolled base, to a nanometre."""
    low = box(sheet["TEMPLATE"][0])[0] + ([0.0, FLANGE] if KIND == "cylinder" else FLANGE)
    if KIND == "disk":
        low += 0.5 * np.array(size)
    drawn = [np.mean(box(points), axis=0) - low for points in sheet["DRILL"]]
    worst = 0.0
    for point, _ in bores():
        place = unrolled(point)
        nearest = min(drawn, key=lambda one: np.linalg.norm(one - place))
        worst = max(worst, np.linalg.norm(nearest - place))
    assert worst < 1e-6, worst
    assert all(abs(area(points) / (math.pi * (0.5 * BORE) ** 2) - 1.0) < 1e-6 for points in sheet["DRILL"])
    print(f"unrolled: bores within {1e6 * worst:.1f} nm of the formula")


def check_disk(size, columns, pitch, patches, sheets):
    radius = 0.5 * size[0]
    expected = []
    for row in range(columns):
        for column in range(columns):
            low = np.array([column, row]) * pitch - radius + 0.5 * GAP
            expected.append(disk_part(low, low + pitch - GAP, radius))
    expected = [one for one in expected if one > 1e-9]
    assert len(expected) == len(patches), (len(expected), len(patches))
    half = 0.5 * (pitch - GAP)
    whole = [patch for patch in patches if len(patch) == 4 and abs(area(patch) / (2 * half + KERF) ** 2 - 1.0) < 1e-6]
    exact = [one for one in expected if abs(one / (2 * half) ** 2 - 1.0) < 1e-9]
    assert len(whole) >= len(exact), (len(whole), len(exact))
    listed = np.genfromtxt(FOLDER / "patterns/patches.csv", delimiter=",", names=True, dtype=None, encoding=None)
    assert abs(listed["area_mm2"].sum() / sum(expected) - 1.0) < 1e-4
    [foam], [coat] = sheets["foam"]["FOAM"], sheets["coat-mask"]["COAT"]
    assert abs(area(foam) / (math.pi * (radius + 0.5 * KERF) ** 2) - 1.0) < 1e-6
    assert abs(area(coat) / (math.pi * (radius - 0.5 * KERF) ** 2) - 1.0) < 1e-6
    check_drill(sheets["drill-template"], size)


def disk_part(low, high, radius):
    """Area of a rectangle inside a circle: the integral of the height of the part over x, by Gauss' rule in pieces."""
    def height(x):
        half = np.sqrt(np.maximum(radius * radius - x * x, 0.0))
        return np.maximum(np.minimum(high[1], half) - np.maximum(low[1], -half), 0.0)

    breaks = {low[0], high[0]}
    for y in (low[1], high[1]):
        if abs(y) < radius:
            x = math.sqrt(radius * radius - y * y)
            breaks |= {value for value in (x, -x) if low[0] < value < high[0]}
    breaks |= {value for value in (-radius, radius) if low[0] < value < high[0]}
    places = sorted(breaks)
    points, weights = np.polynomial.legendre.leggauss(40)
    parts = zip(places, places[1:])
    return sum(0.5 * (b - a) * (weights * height(0.5 * (a + b) + 0.5 * (b - a) * points)).sum() for a, b in parts)


def table(name):
    return np.genfromtxt(FOLDER / name, delimiter=",", names=True, dtype=None, encoding=None)


def check_tables():
    """Electrodes at the places of the design; the readings by a network solver of its own, and by ngspice."""
    listed = table("tables/electrodes.csv")
    centres = list(electrodes())
    assert len(listed) == len(centres) == len(table("tables/wiring.csv"))
    if KIND != "mesh":
        for row, centre in zip(listed, centres):
            assert np.abs(np.array([row["x_mm"], row["y_mm"], row["z_mm"]]) - centre).max() < 1e-5
    for row, (point, normal) in zip(listed, bores()):
        assert np.abs(np.array([row["bore_x_mm"], row["bore_y_mm"], row["bore_z_mm"]]) - point).max() < 1e-5
    wiring = table("tables/wiring.csv")
    assert len({(row["multiplexer"], row["input"]) for row in wiring}) == len(wiring)
    netlist = (FOLDER / "tables/skin.cir").read_text()
    readings = table("tables/readings.csv")
    check_currents(netlist, len(centres), readings[readings["channel"] < 0])
    # Readings of the reference resistor have no channel.
    readings = readings[readings["channel"] >= 0]
    volts = solve(netlist, len(centres), readings)
    worst = np.abs(volts - readings["volt"]).max() / np.abs(readings["volt"]).max()
    assert worst < 1e-7, worst
    ohm = np.abs(readings["ohm"] - volts / currents(netlist, len(centres), readings)).max() / np.abs(readings["ohm"]).max()
    assert ohm < 1e-7, ohm
    print(f"readings: {len(readings)}, the netlist by its own solver within {worst:.1e} of the largest")
    check_ngspice(netlist, readings)


def check_currents(netlist, count, references):
    """The voltages across the reference resistor, one for each drive."""
    reference = float(re.search(r"^Rreference .* (\S+)$", netlist, re.M).group(1))
    assert np.abs(references["volt"] / (reference * currents(netlist, count, references)) - 1.0).max() < 1e-7


def solve(netlist, count, readings):
    """Voltages of the netlist between the measured electrodes."""
    potentials, _ = potentials_and_currents(netlist, count, readings)
    rows = np.arange(len(readings))
    volts = potentials[rows, readings["measure_plus"]] - potentials[rows, readings["measure_minus"]]
    return np.abs(volts) if design["protocol"].get("amplitude_only") else volts


def currents(netlist, count, readings):
    return potentials_and_currents(netlist, count, readings)[1]


def potentials_and_currents(netlist, count, readings):
    """Nodal analysis of each drive: the electrodes, the supply behind the reference resistor, ground."""
    value = lambda name: float(re.search(rf"^{name} .* (\S+)$", netlist, re.M).group(1))
    source_v, reference, on = value("V1"), value("Rreference"), float(re.search(r"alter Rsource\d+ (\S+)", netlist).group(1))
    skin = np.zeros((count, count))
    for a, b, ohm in re.findall(r"^Rskin(\d+)_(\d+) \S+ \S+ (\S+)$", netlist, re.M):
        a, b, siemens = int(a), int(b), 1.0 / float(ohm)
        skin[[a, b], [a, b]] += siemens
        skin[[a, b], [b, a]] -= siemens
    all_potentials, all_currents = np.empty((len(readings), count)), np.empty(len(readings))
    for index, row in enumerate(readings):
        system, currents = skin.copy(), np.zeros(count)
        system[row["drive_source"], row["drive_source"]] += 1.0 / (reference + on)
        currents[row["drive_source"]] = source_v / (reference + on)
        system[row["drive_sink"], row["drive_sink"]] += 1.0 / on
        all_potentials[index] = np.linalg.solve(system, currents)
        all_currents[index] = (source_v - all_potentials[index, row["drive_source"]]) / (reference + on)
    return all_potentials, all_currents


def check_ngspice(netlist, readings):
    if shutil.which("ngspice") is None:
        print("ngspice: skipped, it is not installed")
        return
    said = subprocess.run(["ngspice", "-b", str(FOLDER / "tables/skin.cir")], capture_output=True, text=True).stdout
    printed = np.array([float(value) for value in re.findall(r"^v\(e\d+\)-v\(e\d+\) = (\S+)$", said, re.M)])
    assert len(printed) == len(readings), (len(printed), said[-1000:])
    drives = list(dict.fromkeys((row["drive_source"], row["drive_sink"]) for row in readings))
    order = sorted(range(len(readings)), key=lambda i: (drives.index((readings[i]["drive_source"], readings[i]["drive_sink"])), i))
    volts = np.empty(len(readings))
    volts[order] = np.abs(printed) if design["protocol"].get("amplitude_only") else printed
    worst = np.abs(volts - readings["volt"]).max() / np.abs(readings["volt"]).max()
    assert worst < 1e-5, worst
    print(f"ngspice: all {len(readings)} readings within {worst:.1e} of the largest")


def check_robot():
    """The z axis of every electrode's frame is the outward normal."""
    root = ElementTree.parse(FOLDER / "robot/skin.urdf").getroot()
    listed = table("tables/electrodes.csv")
    joints = root.findall("joint")
    sites = ElementTree.parse(FOLDER / "robot/skin.xml").getroot().findall(".//site")
    assert len(joints) == len(sites) == len(listed)
    for row, joint, site in zip(listed, joints, sites):
        place = np.array([float(value) for value in joint.find("origin").get("xyz").split()])
        roll, pitch, yaw = (float(value) for value in joint.find("origin").get("rpy").split())
        axis = np.array([math.cos(yaw) * math.sin(pitch), math.sin(yaw) * math.sin(pitch), math.cos(pitch)])
        normal = np.array([row["normal_x"], row["normal_y"], row["normal_z"]])
        assert roll == 0.0 and np.abs(axis - normal).max() < 1e-5
        assert np.abs(1e3 * place - [row["x_mm"], row["y_mm"], row["z_mm"]]).max() < 1e-5
        assert np.abs(np.array([float(value) for value in site.get("zaxis").split()]) - normal).max() < 1e-5
    if shutil.which("check_urdf") is not None:
        said = subprocess.run(["check_urdf", str(FOLDER / "robot/skin.urdf")], capture_output=True, text=True, check=True)
        assert "Successfully Parsed XML" in said.stdout, said.stdout
        print("check_urdf: parsed")
    print(f"robot: {len(joints)} electrode frames along the normals")


check_manifest()
check_base()
check_patterns()
check_tables()
check_robot()
