"""The complete electrode model with linear elements, written independently of dermis, for other solvers to solve."""

import numpy as np
from scipy import sparse


class System:
    """The grounded system, or its lower triangle, as `fixed + plan @ conductivity`, in the order of a CSC matrix."""

    def __init__(self, problem, lower_only):
        nodes, cells, parts = problem.nodes, problem.cells, problem.electrode_parts
        electrodes = int(parts[:, 0].max()) + 1
        points = parts.shape[1] == 2
        size = len(nodes) + (0 if points else electrodes)
        self.unknown = parts[np.argsort(parts[:, 0]), 1] if points else len(nodes) + np.arange(electrodes)
        stiffness = unit_stiffness(nodes, cells)
        corners = cells.shape[1]
        i = np.repeat(cells, corners, axis=1).ravel()
        j = np.tile(cells, (1, corners)).ravel()
        cell = np.repeat(np.arange(len(cells)), corners * corners)
        fixed_i, fixed_j, fixed_v = contact_terms(problem, len(nodes)) if not points else (np.zeros(0, int),) * 2 + (np.zeros(0),)
        # The last electrode is grounded: its row and column are left out.
        ground = self.unknown[-1]
        rows, columns = np.concatenate([i, fixed_i]), np.concatenate([j, fixed_j])
        keep = ((rows >= columns) | (not lower_only)) & (rows != ground) & (columns != ground)
        renumber = np.arange(size) - (np.arange(size) > ground)
        rows, columns = renumber[rows[keep]], renumber[columns[keep]]
        self.size = size - 1
        keys, slot = np.unique(columns * np.int64(self.size) + rows, return_inverse=True)
        entry_count = len(i)
        from_cells, is_kept = slot[: keep[:entry_count].sum()], keep[:entry_count]
        self.plan = sparse.csr_matrix(
            (stiffness.ravel()[is_kept], (from_cells, cell[is_kept])), shape=(len(keys), len(cells))
        )
        self.fixed = np.zeros(len(keys))
        np.add.at(self.fixed, slot[len(from_cells):], fixed_v[keep[entry_count:]])
        indptr = np.searchsorted(keys // self.size, np.arange(self.size + 1))
        self.matrix = sparse.csc_matrix(
            (np.ones(len(keys)), (keys % self.size).astype(np.int32), indptr.astype(np.int32)),
            shape=(self.size, self.size),
        )
        drives, self.drive_of_channel = np.unique(problem.channels[:, :2], axis=0, return_inverse=True)
        self.currents = np.zeros((self.size, len(drives)), order="F")
        self.solved_unknown = np.where(self.unknown == ground, -1, renumber[self.unknown])
        for column, (source, sink) in enumerate(drives):
            for electrode, sign in ((source, 1.0), (sink, -1.0)):
                if self.solved_unknown[electrode] >= 0:
                    self.currents[self.solved_unknown[electrode], column] += sign
        self.measures = problem.channels[:, 2:]

    def assemble(self, conductivity):
        self.matrix.data = self.plan @ conductivity
        self.matrix.data += self.fixed
        return self.matrix

    def values(self, potentials):
        """The frame: each channel's voltage under its drive."""
        at_electrodes = np.zeros((len(self.solved_unknown), potentials.shape[1]))
        solved = self.solved_unknown >= 0
        at_electrodes[solved] = potentials[self.solved_unknown[solved]]
        return (
            at_electrodes[self.measures[:, 0], self.drive_of_channel]
            - at_electrodes[self.measures[:, 1], self.drive_of_channel]
        )


def unit_stiffness(nodes, cells):
    """Per cell the stiffness matrix at unit conductivity: (cells, 3, 3) of triangles, (cells, 4, 4) of tetrahedra.

    Triangles from their edges: K_ij = e_i . e_j / (4 area). Tetrahedra from the gradients of their shape functions, the
    inverse of the edges from the first corner: K_ij = volume grad_i . grad_j.
    """
    if cells.shape[1] == 4:
        edges = nodes[cells[:, 1:]] - nodes[cells[:, :1]]
        gradients = np.linalg.inv(edges).transpose(0, 2, 1)
        gradients = np.concatenate([-gradients.sum(axis=1, keepdims=True), gradients], axis=1)
        volume = np.abs(np.linalg.det(edges)) / 6.0
        return np.einsum("nik,njk->nij", gradients, gradients) * volume[:, None, None]
    a, b, c = (nodes[cells[:, k]] for k in range(3))
    edges = np.stack([c - b, a - c, b - a], axis=1)
    area = 0.5 * np.linalg.norm(np.cross(edges[:, 2], -edges[:, 1]), axis=1)
    return np.einsum("nik,njk->nij", edges, edges) / (4.0 * area)[:, None, None]


def contact_terms(problem, node_count):
    """Entries of `integral (u - U)^2 / z` over the electrodes, edges or triangles."""
    rows, columns, values = [], [], []
    for electrode, *corners in problem.electrode_parts:
        x = problem.nodes[corners]
        count = len(corners)
        measure = np.linalg.norm(x[1] - x[0]) if count == 2 else 0.5 * np.linalg.norm(np.cross(x[1] - x[0], x[2] - x[0]))
        measure /= problem.contact_impedances[electrode]
        unknown = node_count + electrode
        for i in range(count):
            for j in range(count):
                rows.append(corners[i]), columns.append(corners[j])
                values.append(measure * (2.0 if i == j else 1.0) / (count * (count + 1)))
            rows.extend([corners[i], unknown]), columns.extend([unknown, corners[i]])
            values.extend([-measure / count] * 2)
        rows.append(unknown), columns.append(unknown), values.append(measure)
    return np.array(rows), np.array(columns), np.array(values)
