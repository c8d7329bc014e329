"""The other programs, each with `name` and `frame(conductivity)`: one new conductivity to the values of all channels."""

import numpy as np
from pyeit.eit.fem import EITForward
from pyeit.eit.protocol import PyEITProtocol
from pyeit.mesh import PyEITMesh
from scipy import sparse
from scipy.sparse.linalg import splu
from skfem import Basis, BilinearForm, ElementTriP0, ElementTriP1, FacetBasis, LinearForm, MeshTri
from skfem.mesh import MeshTri1DG
from sksparse.cholmod import analyze

from cem import System, unit_stiffness

# SuperLU's orders, pivots on the diagonal only: the system is positive definite.
SUPERLU_ORDERS = ("MMD_AT_PLUS_A", "COLAMD", "MMD_ATA")


def made(problem, recipe):
    """The program of a recipe: its class, then what sets it up."""
    kind, *way = recipe
    return kind(problem, *way)


class Cholmod:
    """One symbolic factor, many conductivities."""

    def __init__(self, problem, mode, ordering):
        self.system = system = System(problem, lower_only=True)
        self.factor = analyze(system.assemble(np.ones(system.plan.shape[1])), mode=mode, ordering_method=ordering)
        self.name = f"CHOLMOD ({mode}, {ordering})"

    def frame(self, conductivity):
        self.factor.cholesky_inplace(self.system.assemble(conductivity))
        return self.system.values(self.factor.solve_A(self.system.currents))


def factored(matrix, order):
    return splu(matrix, permc_spec=order, diag_pivot_thresh=0.0, options={"SymmetricMode": order == "MMD_AT_PLUS_A"})


class SciPy:
    """SciPy's SuperLU: assembly plan kept, one factorisation per conductivity, all drives at once."""

    def __init__(self, problem, order):
        self.system = System(problem, lower_only=False)
        self.order, self.name = order, f"SciPy (splu, {order})"

    def frame(self, conductivity):
        return self.system.values(factored(self.system.assemble(conductivity), self.order).solve(self.system.currents))


@BilinearForm
def conduction(u, v, w):
    return w.conductivity * (u.grad[0] * v.grad[0] + u.grad[1] * v.grad[1])


@BilinearForm
def contact(u, v, w):
    return u * v / w.impedance


@LinearForm
def contact_to_electrode(v, w):
    return v / w.impedance


class ScikitFem:
    """scikit-fem's assembly of stiffness and contacts, then SciPy's SuperLU.

    scikit-fem has no triangles in space, but meshes whose cells have places of their own: each triangle is laid flat.
    """

    def __init__(self, problem, order):
        # For the right-hand sides and channels.
        self.system = System(problem, lower_only=False)
        self.order, self.name = order, f"scikit-fem (splu, {order})"
        cells, on_edges = problem.cells, problem.electrode_parts.shape[1] == 3
        topology = np.ascontiguousarray(cells.T, np.int32)
        if on_edges:
            mesh = MeshTri(np.ascontiguousarray(problem.nodes[:, :2].T), topology)
        else:
            mesh = MeshTri1DG(doflocs=laid_flat(problem.nodes, cells).reshape(-1, 2).T.copy(), t=topology)
        self.basis = Basis(mesh, ElementTriP1(), intorder=1)
        self.cells = self.basis.with_element(ElementTriP0())
        count = self.basis.N
        self.size = count + len(problem.contact_impedances)
        self.fixed = self.contacts(problem, mesh, on_edges)

    def contacts(self, problem, mesh, on_edges):
        """What does not depend on the conductivity."""
        parts = problem.electrode_parts
        corners_of = mesh.facets if on_edges else np.sort(mesh.t, axis=0)
        index = {tuple(corners): number for number, corners in enumerate(corners_of.T)}
        blocks, couplings, sums = 0, [], []
        for electrode, impedance in enumerate(problem.contact_impedances):
            own = np.array([index[tuple(np.sort(corners))] for corners in parts[parts[:, 0] == electrode, 1:]])
            basis = FacetBasis(mesh, ElementTriP1(), facets=own) if on_edges else Basis(mesh, ElementTriP1(), elements=own)
            blocks = blocks + contact.assemble(basis, impedance=impedance)
            couplings.append(contact_to_electrode.assemble(basis, impedance=impedance))
            sums.append(couplings[-1].sum())
        coupling = sparse.csr_matrix(-np.array(couplings))
        return sparse.bmat([[blocks, coupling.T], [coupling, sparse.diags(sums)]], format="csr")

    def frame(self, conductivity):
        matrix = conduction.assemble(self.basis, conductivity=self.cells.interpolate(conductivity)).tocsr()
        matrix.resize((self.size, self.size))
        # The last electrode is grounded.
        matrix = (matrix + self.fixed)[:-1, :-1].tocsc()
        return self.system.values(factored(matrix, self.order).solve(self.system.currents))


def laid_flat(nodes, cells):
    """Each triangle in a plane of its own, its first corner at the origin, its second on the x axis."""
    a, b, c = (nodes[cells[:, k]] for k in range(3))
    along, length = b - a, np.linalg.norm(b - a, axis=1)
    along = along / length[:, None]
    x = np.einsum("ij,ij->i", c - a, along)
    y = np.linalg.norm(c - a - x[:, None] * along, axis=1)
    zero = np.zeros_like(x)
    return np.stack([zero, zero, length, zero, x, y], axis=1)


class PyEit:
    """pyEIT's forward solver; its stiffness matrices, which know flat triangles only, replaced by ours in space."""

    name = "pyEIT"

    def __init__(self, problem):
        points = problem.electrode_parts[np.argsort(problem.electrode_parts[:, 0]), 1]
        free = next(node for node in range(len(problem.nodes)) if node not in set(points))
        mesh = PyEITMesh(node=problem.nodes, element=problem.cells, perm=1.0, el_pos=points, ref_node=free)
        drives, drive_of_channel = np.unique(problem.channels[:, :2], axis=0, return_inverse=True)
        measures = [problem.channels[drive_of_channel == drive, 2:] for drive in range(len(drives))]
        keep = np.ones(len(problem.channels), bool)
        self.solver = EITForward(mesh, PyEITProtocol(drives, np.array(measures), keep))
        self.solver.se = unit_stiffness(problem.nodes, problem.cells)
        self.order = np.argsort(drive_of_channel, kind="stable")

    def frame(self, conductivity):
        values = np.empty(len(self.order))
        values[self.order] = self.solver.solve_eit(conductivity)
        return values
