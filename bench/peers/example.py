"""Runs the comparison that `example.sh` describes: agreement first, then the programs take turns, medians at the end."""

import argparse
import ast
import inspect
import os
import pathlib
import sys
import tempfile
import time

import meshio
import numpy as np
import pyeit.eit.jac as jac
import pyeit.eit.protocol as protocol
import pyeit.mesh as mesh
from pyeit.eit.fem import EITForward
from pyeit.eit.interp2d import sim2pts
from pyeit.mesh.shape import ball
from pyeit.mesh.wrapper import PyEITAnomaly_Ball, PyEITAnomaly_Circle

import dermis
from page import CORES, machine, write_page

MARK = "<!-- table: bench/peers/example.sh -->"
# Both solve the same equations: they differ by rounding.
AGREEMENT = 1e-10
ROUNDS = 7
# The packages that each example imports, one line each; NumPy and those of plots left out.
IMPORTS = {"pyEIT": 6, "dermis": 1}


def with_pyeit():
    """The steps of pyEIT's example, without its plots."""
    mesh_obj = mesh.create(16, h0=0.1)
    anomaly = PyEITAnomaly_Circle(center=[0.5, 0.5], r=0.1, perm=1000.0)
    mesh_new = mesh.set_perm(mesh_obj, anomaly=anomaly)
    protocol_obj = protocol.create(16, dist_exc=8, step_meas=1, parser_meas="std")
    forward = EITForward(mesh_obj, protocol_obj)
    v0 = forward.solve_eit()
    v1 = forward.solve_eit(perm=mesh_new.perm)
    eit = jac.JAC(mesh_obj, protocol_obj)
    eit.setup(p=0.5, lamb=0.01, method="kotre")
    change = eit.solve(v1, v0, normalize=True)
    image = sim2pts(mesh_obj.node, mesh_obj.element, np.real(change))
    return mesh_obj.element, mesh_obj.node[np.argmax(image)]


def with_dermis():
    """The same steps with dermis."""
    design = {
        "body": {"disk": {"diameter_m": 2.0}},
        "sheet": {"sheet_resistance_ohm": 1.0, "touch": "conductance_rises"},
        "electrodes": {"shape": "point", "layout": {"rim": {"count": 16}}},
        "protocol": {"pattern": "opposite", "measures_reversed": True},
        "mesh": {"max_edge_m": 0.12, "electrode_edge_m": 0.12},
    }
    skin = dermis.Skin.load(design)
    centres = skin.mesh.nodes[skin.mesh.cells].mean(axis=1)
    inside = np.linalg.norm(centres - [0.5, 0.5, 0.0], axis=1) < 0.1
    v0 = skin.forward()
    v1 = skin.forward(np.where(inside, 1000.0, skin.rest_conductivity))
    image = skin.method("noser").images(v1, v0)
    return skin.mesh.cells, skin.pixels[np.argmax(image[np.isfinite(image)])]


def code_lines(function):
    """Lines of a function's body with code: those of the user, without its docstring and its `return`."""
    (tree,) = ast.parse(inspect.getsource(function)).body
    return sum(statement.end_lineno - statement.lineno + 1 for statement in tree.body[1:-1])


def imported(mesh_obj, protocol_obj, folder):
    """A skin on pyEIT's mesh, electrodes at its points, channels in its order."""
    kind = "triangle" if mesh_obj.element.shape[1] == 3 else "tetra"
    points = mesh_obj.el_pos[:, None]
    groups = [np.full(len(mesh_obj.element), 100), np.arange(len(points)) + 1]
    path = pathlib.Path(folder) / "pyeit.msh"
    meshio.Mesh(
        mesh_obj.node,
        [(kind, mesh_obj.element), ("vertex", points)],
        cell_data={"gmsh:physical": groups, "gmsh:geometrical": groups},
        field_data={f"electrode_{number}": np.array([number + 1, 0]) for number in range(len(points))},
    ).write(path, file_format="gmsh22", binary=True)
    unit = {"sheet_resistance_ohm": 1.0} if kind == "triangle" else {"conductivity_s_per_m": 1.0}
    skin = dermis.Skin.load({
        "body": {"mesh": {"path": str(path), "unit_m": 1.0}},
        "sheet": {**unit, "touch": "conductance_rises"},
        # Points have no contact impedance: the value is not used.
        "electrodes": {"shape": "group", "layout": {"groups": {"count": len(points)}}, "contact_impedance_ohm_m2": 1.0},
        "protocol": {"pattern": "opposite", "measures_reversed": True},
    })
    channels = [(*drive, *pair) for drive, pairs in zip(protocol_obj.ex_mat, protocol_obj.meas_mat) for pair in pairs]
    assert np.array_equal(skin.channels, channels), "the channels are in another order"
    return skin


def difference(ours, theirs):
    return np.abs(ours - theirs).max() / np.abs(theirs).max()


def timed(function, count=1):
    """Times of some calls, ms."""
    times = []
    for _ in range(count):
        start = time.perf_counter()
        function()
        times.append(1e3 * (time.perf_counter() - start))
    return times


def compare(name, mesh_obj, anomaly, folder):
    """Agreement and times of the steps on one mesh."""
    protocol_obj = protocol.create(16, dist_exc=8, step_meas=1, parser_meas="std")
    skin, forward = imported(mesh_obj, protocol_obj, folder), EITForward(mesh_obj, protocol_obj)
    perm = mesh.set_perm(mesh_obj, anomaly=anomaly).perm
    v1 = skin.forward(perm)
    errors = [difference(skin.forward(), forward.solve_eit()), difference(v1, forward.solve_eit(perm=perm))]
    # The derivative of a frame is negative where its voltage is positive; pyEIT's has the other sign.
    jacobian = difference(-skin.jacobian(perm, per="cell"), forward.compute_jac(perm=perm)[0])
    print(f"{name}: frames differ by {errors[0]:.1e}, {errors[1]:.1e}, Jacobians by {jacobian:.1e}", flush=True)
    if not max(*errors, jacobian) <= AGREEMENT:
        sys.exit(f"{name}: they differ by more than {AGREEMENT:.0e}: nothing is timed")
    frames, jacobians = ([], []), ([], [])
    for _ in range(ROUNDS):
        frames[0].extend(timed(lambda: skin.forward(perm), 20))
        frames[1].extend(timed(lambda: forward.solve_eit(perm=perm)))
        jacobians[0].extend(timed(lambda: skin.jacobian(perm, per="cell"), 5))
        jacobians[1].extend(timed(lambda: forward.compute_jac(perm=perm)))
    size = f"{len(mesh_obj.node):,} nodes, {len(mesh_obj.element):,} {'triangles' if skin.mesh.cells.shape[1] == 3 else 'tetrahedra'}"
    return [
        row(f"one frame, {size}", *frames, f"{max(errors):.0e}"),
        row(f"Jacobian of every cell, {size}", *jacobians, f"{jacobian:.0e}"),
    ]


def row(step, ours, theirs, agreement="-"):
    shown = lambda times: f"{np.median(times):.3g} ({min(times):.3g}) ms"
    return f"| {step} | {shown(theirs)} | {shown(ours)} | {min(theirs) / min(ours):.3g} | {agreement} |"


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="put the tables into docs/benchmarks.md")
    arguments = parser.parse_args()
    os.sched_setaffinity(0, CORES[-1:])
    load = os.getloadavg()[0]
    whole = ([], [])
    for _ in range(ROUNDS):
        whole[0].extend(timed(with_dermis))
        whole[1].extend(timed(with_pyeit))
    (our_cells, ours), (their_cells, theirs) = with_dermis(), with_pyeit()
    off = [np.linalg.norm(place - [0.5, 0.5, 0.0]) for place in (ours, theirs)]
    lines = [MARK, "| step: median (fastest) | pyEIT | dermis | ratio of the fastest | largest difference, relative |", "|---|---|---|---|---|"]
    lines += [
        row("whole example: mesh, two frames, image", *whole),
        f"| its mesh, cells | {len(their_cells):,} | {len(our_cells):,} | | |",
        f"| maximum of its image from the centre of the anomaly, radius of the disk 1 | {off[1]:.2f} | {off[0]:.2f} | | |",
        f"| its lines of code, and of imports | {code_lines(with_pyeit)} + {IMPORTS['pyEIT']} "
        f"| {code_lines(with_dermis)} + {IMPORTS['dermis']} | | |",
    ]
    with tempfile.TemporaryDirectory() as folder:
        circle = PyEITAnomaly_Circle(center=[0.5, 0.5], r=0.1, perm=1000.0)
        lines += compare("disk", mesh.create(16, h0=0.1), circle, folder)
        box, sphere = [[-1, -1, -1], [1, 1, 1]], PyEITAnomaly_Ball(center=[0.3, 0.3, 0.3], r=0.3, perm=10.0)
        lines += compare("ball", mesh.create(16, h0=0.2, bbox=box, fd=ball), sphere, folder)
    about = f"{machine(['pyeit', 'numpy', 'scipy'])} One core, {ROUNDS} turns. Load average before the run {load:.1f}."
    text = "\n".join([about, "", *lines])
    print(text)
    if arguments.write:
        write_page(text, "example")


if __name__ == "__main__":
    main()
