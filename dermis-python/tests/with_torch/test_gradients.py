"""Gradients of `dermis.torch.forward` against central differences of an independent assembly in NumPy and SciPy.

The assembly is that of the benchmarks (`bench/peers/cem.py`). `pytest -s` prints the differences.
"""

import itertools
import sys
import tomllib
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import dermis

torch = pytest.importorskip("torch")
meshio = pytest.importorskip("meshio")
splu = pytest.importorskip("scipy.sparse.linalg").splu
from dermis.torch import ElectrodeMotion, forward  # noqa: E402

ROOT = Path(__file__).parents[3]
sys.path.append(str(ROOT / "bench" / "peers"))
from cem import System  # noqa: E402

# Two assemblies of the same equations differ by rounding, amplified by the system's condition (about 1e5).
FRAMES_AGREE = 1e-9
GRADIENTS_AGREE = 1e-6
# Differences of the fourth order: error of the step 1e-12, of rounding 1e-12 / 1e-3.
STEP = 1e-3
STENCIL = ((-2, 1 / 12), (-1, -2 / 3), (1, 2 / 3), (2, -1 / 12))

DOME = """
[body.mesh]
path = "dome.stl"
[sheet]
sheet_resistance_ohm = 1000
touch = "conductance_rises"
[electrodes]
shape.disc.radius_m = 0.006
contact_impedance_ohm_m2 = 5e-5
[electrodes.layout]
positions = []
[protocol]
pattern = "adjacent"
[mesh]
max_edge_m = 0.008
electrode_edge_m = 0.003
"""
BLOCK = """
[body.mesh]
path = "block.msh"
[sheet]
conductivity_s_per_m = 2.0
touch = "conductance_rises"
[electrodes]
shape = "group"
contact_impedance_ohm_m2 = 1e-4
layout.groups.count = 8
[protocol]
pattern = "adjacent"
"""


def cylinder(_folder):
    return dermis.Skin.load("cylinder30")


def dome(folder):
    """A spherical cap of radius 60 mm to 70 degrees from its pole, from an STL file, with 12 discs in two rings."""
    rings, sectors, radius = 24, 72, 0.06
    polar, azimuth = np.radians(70) * np.arange(1, rings + 1) / rings, 2 * np.pi * np.arange(sectors) / sectors
    place = lambda a, b: radius * np.stack([np.sin(a) * np.cos(b), np.sin(a) * np.sin(b), np.cos(a) + 0 * b], axis=-1)
    nodes = np.concatenate([[[0, 0, radius]], place(polar[:, None], azimuth).reshape(-1, 3)])
    cells = []
    for ring, sector in itertools.product(range(rings), range(sectors)):
        outer = [1 + ring * sectors + (sector + k) % sectors for k in (0, 1)]
        inner = [1 + (ring - 1) * sectors + (sector + k) % sectors for k in (0, 1)] if ring else [0, 0]
        cells.append([inner[0], *outer])
        if ring:
            cells.append([inner[0], outer[1], inner[1]])
    meshio.Mesh(nodes, [("triangle", np.array(cells))]).write(folder / "dome.stl", binary=True)
    design = tomllib.loads(DOME)
    design["body"]["mesh"].update(path=str(folder / "dome.stl"), unit_m=1.0)
    centres = [place(np.radians(a), 2 * np.pi * (k + s) / 6) for a, s in ((25, 0), (52, 0.5)) for k in range(6)]
    design["electrodes"]["layout"]["positions"] = [dict(zip(("x_m", "y_m", "z_m"), map(float, x))) for x in centres]
    return dermis.Skin.load(design)


def block(folder):
    """A block of 80 x 40 x 20 mm of tetrahedra, from a Gmsh file, with 8 square faces as electrodes, four on top and bottom."""
    counts = np.array([12, 6, 4])
    shape = counts + 1
    nodes = np.stack(np.meshgrid(*(np.arange(n) for n in shape), indexing="ij"), axis=-1).reshape(-1, 3)
    number = lambda corner: int(np.ravel_multi_index(tuple(corner), shape))
    # Each cube is divided into the six tetrahedra along its diagonal.
    tetrahedra = []
    for cube, order in itertools.product(itertools.product(*map(range, counts)), itertools.permutations(range(3))):
        corners = np.array([cube] * 4)
        for step, axis in enumerate(order):
            corners[step + 1 :, axis] += 1
        tetrahedra.append([number(corner) for corner in corners])
    faces, electrode_of_face = [], []
    for electrode, (z, x) in enumerate(itertools.product((0, counts[2]), (1, 4, 7, 10))):
        for middle in ((1, 0, 0), (0, 1, 0)):
            faces.append([number(np.add((x, 2, z), step)) for step in ((0, 0, 0), middle, (1, 1, 0))])
            electrode_of_face.append(electrode)
    # Uneven, so that no gradient vanishes by symmetry.
    nodes = nodes * np.array([80, 40, 20]) / counts / 1000 + np.random.default_rng(3).normal(0, 2e-4, nodes.shape)
    kinds = [("tetra", np.array(tetrahedra)), ("triangle", np.array(faces))]
    groups = [np.full(len(tetrahedra), 100), np.array(electrode_of_face) + 1]
    names = {f"electrode_{k}": np.array([k + 1, 2]) for k in range(8)} | {"body": np.array([100, 3])}
    data = {"gmsh:physical": groups, "gmsh:geometrical": groups}
    mesh = meshio.Mesh(nodes, kinds, cell_data=data, field_data=names)
    mesh.write(folder / "block.msh", file_format="gmsh22", binary=False)
    design = tomllib.loads(BLOCK)
    design["body"]["mesh"].update(path=str(folder / "block.msh"), unit_m=1.0)
    return dermis.Skin.load(design)


def electrode_parts(mesh):
    """The triangles of each electrode: electrode, then three nodes. Electrodes are convex, so their nodes name them."""
    cells, parts = mesh.cells, []
    faces = cells if cells.shape[1] == 3 else np.concatenate([np.delete(cells, k, axis=1) for k in range(4)])
    for electrode, own in enumerate(mesh.electrode_nodes):
        found = np.unique(np.sort(faces[np.isin(faces, own).all(axis=1)], axis=1), axis=0)
        parts.append(np.column_stack([np.full(len(found), electrode), found]))
    return np.concatenate(parts)


class Independent:
    """Frames by the independent assembly: (cells,), (electrodes,) and (nodes, 3) to (channels,), ohm."""

    def __init__(self, skin):
        self.cells, self.parts, self.channels = skin.mesh.cells, electrode_parts(skin.mesh), skin.channels

    def frame(self, conductivity, contact_impedance, nodes):
        problem = SimpleNamespace(
            nodes=nodes,
            cells=self.cells,
            electrode_parts=self.parts,
            channels=self.channels,
            contact_impedances=contact_impedance,
        )
        system = System(problem, lower_only=False)
        return system.values(splu(system.assemble(conductivity)).solve(system.currents))


def probes(shape, rng):
    """Directions: four random ones, and four single components where there are few."""
    size = int(np.prod(shape))
    single = np.eye(size)[rng.choice(size, 4, replace=False)] if size < 1000 else np.zeros((0, size))
    return np.concatenate([single, rng.normal(size=(4, size))]).reshape(-1, *shape)


@pytest.mark.parametrize("make", [cylinder, dome, block])
def test_gradients_are_those_of_an_independent_assembly(make, tmp_path):
    skin = make(tmp_path)
    mesh, rng = skin.mesh, np.random.default_rng(1)
    rest, nominal = skin.rest_conductivity, skin.contact_impedance
    is_surface = mesh.cells.shape[1] == 3
    motion = ElectrodeMotion(skin) if is_surface else None
    # In place of electrodes, nodes of volumes are moved; lengths in mm.
    places = skin.electrodes if is_surface else mesh.nodes
    moved = lambda mm: motion(1e-3 * mm) if is_surface else torch.tensor(mesh.nodes) + 1e-3 * mm
    # Relative to the design, away from it: conductivities, contact impedances, displacements in mm.
    at = {
        "conductivity": rng.uniform(0.7, 1.4, rest.shape),
        "contact impedance": rng.uniform(0.5, 2.0, nominal.shape),
        "electrode position" if is_surface else "node position": rng.normal(0, 0.1, places.shape),
    }
    tensors = [torch.tensor(values, requires_grad=True) for values in at.values()]
    factors, contacts, displacement_mm = tensors
    frame = forward(skin, factors * torch.tensor(rest), contacts * torch.tensor(nominal), moved(displacement_mm))
    weights = rng.normal(size=len(frame))
    (frame * torch.tensor(weights)).sum().backward()

    independent = Independent(skin)

    def frame_at(factors, contacts, displacement_mm):
        with torch.no_grad():
            nodes = moved(torch.tensor(displacement_mm)).numpy()
        return independent.frame(factors * rest, contacts * nominal, nodes)

    # Dermis adds constant resistances in series with discs (docs/theory.md): the frames differ by those of the design.
    series = skin.forward() - independent.frame(rest, nominal, mesh.nodes)
    expected = frame_at(*at.values()) + series
    error = np.linalg.norm(frame.detach().numpy() - expected) / np.linalg.norm(expected)
    print(f"\n{make.__name__}, {len(mesh.cells)} cells: frame {error:.1e}", end="")
    assert error < FRAMES_AGREE
    for index, (name, tensor) in enumerate(zip(at, tensors)):
        ours, differences = [], []
        for direction in probes(tensor.shape, rng):
            values = [weights @ frame_at(*shifted(at, index, step * STEP * direction)) for step, _ in STENCIL]
            differences.append(sum(factor * value for (_, factor), value in zip(STENCIL, values)) / STEP)
            ours.append((tensor.grad.numpy() * direction).sum())
        error = np.linalg.norm(np.subtract(ours, differences)) / np.linalg.norm(differences)
        print(f", {name} {error:.1e}", end="")
        assert error < GRADIENTS_AGREE, name


def shifted(at, index, shift):
    """The arguments, one of them shifted."""
    return [values + shift if number == index else values for number, values in enumerate(at.values())]
