"""A skin on a cylinder by a program of its own, for presses of any form: no code, mesh or constant of Dermis.

Linear triangles on a grid that does not follow the electrodes (Vauhkonen et al., 1999, DOI 10.1109/10.760671, complete
electrode model). The coat is uneven, the electrodes are displaced and their contact impedances differ. Patches float above
the coat: pressure connects a patch to the coat below it, by a conductance per area that rises with the pressure and
saturates. Without patches pressure raises the conductance of the coat itself. Lengths in m, angles in radians, forces in N.
"""

import numpy as np
import scipy.sparse as sparse
from scipy.sparse.linalg import splu

RADIUS, LENGTH = 0.05, 0.3
RINGS, PER_RING, ELECTRODE_RADIUS = 6, 5, 0.004
ELECTRODES = RINGS * PER_RING
SHEET_OHM, CONTACT_OHM_M2 = 1000.0, 2e-5
COAT_SD, COAT_SCALE, DISPLACEMENT, CONTACT_SD = 0.18, 0.03, 0.001, 0.3
PATCH_GAP = 0.001
PATCH_SIEMENS_PER_N, SATURATION_PA = 0.02, 4e4
COAT_RISE_PER_PA, COAT_SATURATION_PA = 3e-5, 1e5
ROWS, COLUMNS = 121, 126


class Skin:
    """A cylinder of 300 x 100 mm with 30 electrodes, and patches of the edge `pitch`, or none."""

    def __init__(self, seed, pitch):
        self.random = np.random.default_rng(seed)
        z, theta = np.meshgrid(np.linspace(0, LENGTH, ROWS), 2 * np.pi * np.arange(COLUMNS) / COLUMNS, indexing="ij")
        self.z, self.theta = z.ravel(), theta.ravel()
        self._triangles()
        self._coat()
        self._electrodes()
        self._patches(pitch)
        self.untouched = self.frame(None)

    def _triangles(self):
        row, column = (part.ravel() for part in np.meshgrid(np.arange(ROWS - 1), np.arange(COLUMNS), indexing="ij"))
        following = (column + 1) % COLUMNS
        a, b = row * COLUMNS + column, (row + 1) * COLUMNS + column
        c, d = (row + 1) * COLUMNS + following, row * COLUMNS + following
        even = ((row + column) % 2 == 0)[:, None]
        self.triangles = np.vstack(
            [np.where(even, np.c_[a, b, c], np.c_[a, b, d]), np.where(even, np.c_[a, c, d], np.c_[b, c, d])]
        )
        theta = self.theta[self.triangles]
        theta = np.where(theta < theta.max(axis=1, keepdims=True) - np.pi, theta + 2 * np.pi, theta)
        self.corners = np.stack([self.z[self.triangles], RADIUS * theta], axis=2)
        x, y = self.corners[..., 0], self.corners[..., 1]
        by_x = np.stack([y[:, 1] - y[:, 2], y[:, 2] - y[:, 0], y[:, 0] - y[:, 1]], axis=1)
        by_y = np.stack([x[:, 2] - x[:, 1], x[:, 0] - x[:, 2], x[:, 1] - x[:, 0]], axis=1)
        self.area = 0.5 * np.abs((x * by_x).sum(axis=1))
        products = by_x[:, :, None] * by_x[:, None, :] + by_y[:, :, None] * by_y[:, None, :]
        self.stiffness = products / (4 * self.area)[:, None, None]
        self.node_area = np.bincount(self.triangles.ravel(), np.repeat(self.area / 3, 3))

    def _coat(self):
        white = self.random.normal(size=(ROWS, COLUMNS))
        steps = [np.fft.fftfreq(2 * ROWS, LENGTH / (ROWS - 1))[:, None],
                 np.fft.fftfreq(COLUMNS, 2 * np.pi * RADIUS / COLUMNS)[None, :]]
        smooth = np.exp(-2 * (np.pi * COAT_SCALE) ** 2 * (steps[0] ** 2 + steps[1] ** 2))
        field = np.real(np.fft.ifft2(np.fft.fft2(np.vstack([white, white[::-1]])) * smooth))[:ROWS]
        of_cell = (field / field.std()).ravel()[self.triangles].mean(axis=1)
        self.sheet_siemens = np.exp(COAT_SD * of_cell) / SHEET_OHM

    def _electrodes(self):
        self.coverage, self.contact = [], []
        part = (np.arange(8) + 0.5) / 8
        points = np.array([(u, v, 1 - u - v) for u in part for v in part if u + v < 1])
        middle = self.corners.mean(axis=1)
        for electrode in range(ELECTRODES):
            ring, index = divmod(electrode, PER_RING)
            along, around = self.random.normal(0, DISPLACEMENT, 2)
            is_rim = ring in (0, RINGS - 1)
            centre = [LENGTH * ring / (RINGS - 1) + (0 if is_rim else along),
                      (index + 0.5 * (ring % 2)) * 2 * np.pi / PER_RING + around / RADIUS]
            impedance = CONTACT_OHM_M2 * np.exp(self.random.normal(0, CONTACT_SD))
            covered, mass = np.zeros(len(self.z)), sparse.lil_matrix((len(self.z), len(self.z)))
            distance = np.hypot(middle[:, 0] - centre[0], RADIUS * turn(middle[:, 1] / RADIUS - centre[1]))
            for cell in np.flatnonzero(distance < ELECTRODE_RADIUS + 0.005):
                at = points @ self.corners[cell]
                inside = np.hypot(at[:, 0] - centre[0], RADIUS * turn(at[:, 1] / RADIUS - centre[1])) < ELECTRODE_RADIUS
                share = self.area[cell] / len(points) / impedance
                nodes = self.triangles[cell]
                covered[nodes] += share * points[inside].sum(axis=0)
                mass[np.ix_(nodes, nodes)] += share * points[inside].T @ points[inside]
            self.coverage.append(covered)
            self.contact.append(mass.tocsr())
        self.contacts = sum(self.contact)

    def _patches(self, pitch):
        self.patch = None
        if pitch:
            count = round(2 * np.pi * RADIUS / pitch)
            sizes = np.array([pitch, 2 * np.pi * RADIUS / count])
            at = np.stack([self.z, RADIUS * self.theta]) + self.random.uniform(0, pitch, 2)[:, None]
            at = at / sizes[:, None]
            is_patch = (np.abs(at % 1 - 0.5) < 0.5 - 0.5 * PATCH_GAP / sizes[:, None]).all(axis=0)
            rows, columns = np.floor(at).astype(int)
            self.patch = np.where(is_patch, rows * count + columns % count, -1)

    def pressure(self, objects):
        """The pressure at the nodes, Pa, of objects: pairs of a force and its relative pressure at the nodes."""
        return sum(force * form / (form * self.node_area).sum() for force, form in objects)

    def frame(self, pressure, drift=(0, 0)):
        """The 870 voltages of adjacent drives for a current of 1 A. The conductance has drifted by parts that are linear along the axis
        and across it: at an end, and where the angle is 0."""
        along, across = 2 * self.z / LENGTH - 1, np.cos(self.theta)
        sheet = self.sheet_siemens * (1 + (drift[0] * along + drift[1] * across)[self.triangles].mean(axis=1))
        if pressure is not None and self.patch is None:
            of_cell = pressure[self.triangles].mean(axis=1)
            sheet = sheet * (1 + COAT_RISE_PER_PA * of_cell / (1 + of_cell / COAT_SATURATION_PA))
        values = (sheet[:, None, None] * self.stiffness).ravel()
        places = np.repeat(self.triangles, 3, axis=1).ravel(), np.tile(self.triangles, (1, 3)).ravel()
        matrix = sparse.coo_matrix((values, places)).tocsr() + self.contacts
        columns, diagonal = [sparse.csr_matrix(-np.array(self.coverage).T)], [one.sum() for one in self.coverage]
        if pressure is not None and self.patch is not None:
            siemens = PATCH_SIEMENS_PER_N * pressure / (1 + pressure / SATURATION_PA) * self.node_area
            siemens[self.patch < 0] = 0
            touched = np.flatnonzero(siemens > 1e-12 * siemens.max())
            matrix = matrix + sparse.diags(np.where(siemens > 1e-12 * siemens.max(), siemens, 0))
            patches, index = np.unique(self.patch[touched], return_inverse=True)
            columns.append(sparse.csr_matrix((-siemens[touched], (touched, index)), (len(self.z), len(patches))))
            diagonal += list(np.bincount(index, siemens[touched]))
        columns = sparse.hstack(columns)
        whole = sparse.bmat([[matrix, columns], [columns.T, sparse.diags(diagonal)]]).tocsc()
        # The first electrode is the ground.
        nodes, kept = len(self.z), np.delete(np.arange(whole.shape[0]), len(self.z))
        currents = np.zeros((whole.shape[0], ELECTRODES))
        drives = np.arange(ELECTRODES)
        currents[nodes + drives, drives] += 1
        currents[nodes + (drives + 1) % ELECTRODES, drives] -= 1
        options = {"SymmetricMode": True}
        factor = splu(whole[kept][:, kept], permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)
        potentials = np.zeros_like(currents)
        potentials[kept] = factor.solve(currents[kept])
        electrodes = potentials[nodes : nodes + ELECTRODES]
        voltages = electrodes - np.roll(electrodes, -1, axis=0)
        return np.array([voltages[m, d] for d in drives for m in drives if m != d])

    def offsets(self, z, theta):
        """From a place to the nodes: along the axis and around it, m."""
        return self.z - z, RADIUS * turn(self.theta - theta)


def turn(angle):
    """An angle between minus and plus half a turn."""
    return (angle + np.pi) % (2 * np.pi) - np.pi
