"""MuJoCo: contacts of a simulated robot press the digital twin of the skin that it wears.

>>> import dermis, mujoco
>>> from dermis.mujoco import SimulatedSkin
>>> model = mujoco.MjModel.from_xml_string('''
... <mujoco>
...   <worldbody>
...     <geom name="link" type="cylinder" size="0.05 0.15"/>
...     <body pos="0.06 0 0.02"><joint type="slide" axis="1 0 0"/><geom type="sphere" size="0.015" mass="0.05"/></body>
...   </worldbody>
... </mujoco>''')
>>> data = mujoco.MjData(model)
>>> skin = dermis.Skin.load("cylinder30")
>>> sensor = SimulatedSkin(skin, model, "link", method="noser", seed=1)
>>> data.qfrc_applied[0] = -3.0                       # N
>>> for step in range(400):
...     mujoco.mj_step(model, data)
>>> frames = [sensor.sense(data) for count in range(3)]  # a contact is confirmed by a second frame
>>> frames[-1].is_usable, len(frames[-1].contacts)
(True, 1)
"""

from collections.abc import Iterator
from os import PathLike
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from dermis._dermis import Frame, Pipeline, Skin, Twin
from dermis._errors import DermisError

__all__ = ["SimulatedSkin", "Touches", "WornSkin"]


class Touches(NamedTuple):
    """Presses in the skin's frame, a row each.

    Attributes:
        positions_m: Where the skin is touched, on its surface, (n, 3), m.
        normals: Directions of the forces on the skin, unit vectors, (n, 3).
        forces_n: Normal forces, (n,), N.
    """

    positions_m: NDArray[np.float64]
    normals: NDArray[np.float64]
    forces_n: NDArray[np.float64]


class WornSkin:
    """A skin on a geom of a MuJoCo model.

    MuJoCo's contact points lie between the surfaces, inside the skin where it is penetrated: they are moved to the nearest
    point of the skin. Several points of one body within `merge_m` of their mean are one press, as under a flat face.

    Args:
        skin: A `dermis.Skin`.
        model: The `mujoco.MjModel`.
        geom: Name or index of the geom that wears the skin.
        position: Origin of the skin's frame in the geom's, (3,), m; of a mesh in the frame of its file, which MuJoCo moves to
            the middle and the principal axes. Without it the middles of both coincide (the origin of a cylinder is its middle in
            MuJoCo, its lower end in Dermis), and on a mesh the frames.
        rotation: Axes of the skin's frame in the same one, (3, 3); the same axes without it.
        merge_m: Largest distance of the contact points of one press from their mean, m.

    Raises:
        DermisError: A geom that does not exist, a rotation that is none.
    """

    skin: Skin
    model: mujoco.MjModel
    merge_m: float
    geom: int
    position: NDArray[np.float64]
    rotation: NDArray[np.float64]

    def __init__(
        self,
        skin: Skin,
        model: mujoco.MjModel,
        geom: str | int,
        *,
        position: ArrayLike | None = None,
        rotation: ArrayLike | None = None,
        merge_m: float = 0.02,
    ) -> None:
        self.skin, self.model, self.merge_m = skin, model, merge_m
        self.geom = _geom(model, geom)
        mesh = skin.mesh
        self._nodes, self._cells = mesh.nodes, mesh.cells
        if self._cells.shape[1] != 3:
            raise DermisError("a worn skin is a surface", hint="give a design whose mesh is of triangles")
        middle = (self._nodes.min(axis=0) + self._nodes.max(axis=0)) / 2
        asset = model.geom_dataid[self.geom] if model.geom_type[self.geom] == mujoco.mjtGeom.mjGEOM_MESH else -1
        default = np.zeros(3) if asset >= 0 else -middle
        self.position = default if position is None else np.asarray(position, dtype=float).reshape(3)
        self.rotation = np.eye(3) if rotation is None else np.asarray(rotation, dtype=float).reshape(3, 3)
        if not np.allclose(self.rotation @ self.rotation.T, np.eye(3), atol=1e-6):
            raise DermisError("`rotation` is no rotation", hint="give three orthogonal unit vectors")
        if asset >= 0:
            axes = np.zeros(9)
            mujoco.mju_quat2Mat(axes, model.mesh_quat[asset])
            to_geom = axes.reshape(3, 3).T
            self.position = to_geom @ (self.position - model.mesh_pos[asset])
            self.rotation = to_geom @ self.rotation
        self._cells_of_node = [[] for _ in self._nodes]
        for cell, corners in enumerate(self._cells):
            for node in corners:
                self._cells_of_node[node].append(cell)

    def touches(self, data: mujoco.MjData) -> Touches:
        """The presses on the skin at the state of a `mujoco.MjData`."""
        points, others = [], []
        for index in range(data.ncon):
            contact = data.contact[index]
            if self.geom not in contact.geom:
                continue
            force = np.zeros(6)
            mujoco.mj_contactForce(self.model, data, index, force)
            if force[0] <= 0:
                continue
            is_first = contact.geom[0] == self.geom
            # The frame's first axis points from the first geom to the second.
            normal = contact.frame[:3] * (-1 if is_first else 1)
            points.append((self.to_skin(data, contact.pos), self.direction_to_skin(data, normal), force[0]))
            others.append(int(contact.geom[1 if is_first else 0]))
        presses = [press for other in sorted(set(others)) for press in self._merged(points, others, other)]
        positions = np.array([self.nearest(position) for position, _, _ in presses]).reshape(-1, 3)
        normals = np.array([normal for _, normal, _ in presses]).reshape(-1, 3)
        return Touches(positions, normals, np.array([force for _, _, force in presses]))

    def to_skin(self, data: mujoco.MjData, point: ArrayLike) -> NDArray[np.float64]:
        """A point of the world in the skin's frame, m."""
        in_geom = data.geom_xmat[self.geom].reshape(3, 3).T @ (np.asarray(point) - data.geom_xpos[self.geom])
        return self.rotation.T @ (in_geom - self.position)

    def direction_to_skin(self, data: mujoco.MjData, direction: ArrayLike) -> NDArray[np.float64]:
        """A direction of the world in the skin's frame."""
        return self.rotation.T @ (data.geom_xmat[self.geom].reshape(3, 3).T @ np.asarray(direction))

    def to_world(self, data: mujoco.MjData, point: ArrayLike) -> NDArray[np.float64]:
        """A point of the skin's frame in the world, m."""
        in_geom = self.rotation @ np.asarray(point) + self.position
        return data.geom_xpos[self.geom] + data.geom_xmat[self.geom].reshape(3, 3) @ in_geom

    def nearest(self, point: NDArray[np.float64]) -> NDArray[np.float64]:
        """The nearest point of the skin, m."""
        distances = np.linalg.norm(self._nodes - point, axis=1)
        cells = {cell for node in np.argsort(distances)[:4] for cell in self._cells_of_node[node]}
        candidates = [_nearest_on_triangle(point, self._nodes[self._cells[cell]]) for cell in cells]
        return min(candidates, key=lambda candidate: np.linalg.norm(candidate - point))

    def _merged(self, points: list[Any], others: list[int], other: int) -> Iterator[tuple[Any, Any, Any]]:
        """The presses of one geom: force-weighted means of points that are close together."""
        left = [point for point, owner in zip(points, others) if owner == other]
        while left:
            group = [left.pop(0)]
            while True:
                forces = np.array([force for _, _, force in group])
                mean = np.average([position for position, _, _ in group], axis=0, weights=forces)
                near = [point for point in left if np.linalg.norm(point[0] - mean) <= self.merge_m]
                if not near:
                    break
                group += near
                left = [point for point in left if not any(point is one for one in near)]
            normal = np.average([normal for _, normal, _ in group], axis=0, weights=forces)
            yield mean, normal / max(np.linalg.norm(normal), 1e-12), forces.sum()


class SimulatedSkin:
    """A worn skin with its instrument: contacts of the simulator press a digital twin, whose frames go through the pipeline.

    Args:
        skin: A `dermis.Skin`.
        model: The `mujoco.MjModel`.
        geom: Name or index of the geom that wears the skin.
        method: Name or folder of the method; the best one of the skin without it.
        twin: `ideal`, `lab`, `lab-b`, `lab-c` or `harsh`, or the path of a twin file.
        seed: Seed of the twin.
        tip_radius_m: Radius of the spherical tips that stand for what touches, m.
        tare_frames: Number of untouched frames for the baseline.
        **pose: `position`, `rotation` and `merge_m` of `WornSkin`.
    """

    worn: WornSkin
    twin: Twin
    pipeline: Pipeline
    tip_radius_m: float

    def __init__(
        self,
        skin: Skin,
        model: mujoco.MjModel,
        geom: str | int,
        *,
        method: str | PathLike[str] | None = None,
        twin: str | PathLike[str] = "lab",
        seed: int = 1,
        tip_radius_m: float = 0.005,
        tare_frames: int = 100,
        **pose: Any,
    ) -> None:
        self.worn = WornSkin(skin, model, geom, **pose)
        self.twin = skin.twin(twin, seed=seed)
        self.pipeline = Pipeline(skin, method, tare_frames=tare_frames)
        self.tip_radius_m = tip_radius_m
        # The time of the twin, s since 1970: that of a simulator starts at zero.
        self._next, self._start_s = 0, 1.0e9
        for values in self.twin.untouched(tare_frames + 1):
            self._process(values)

    @property
    def frame_rate_hz(self) -> float:
        """Frames per second of the instrument: `sense` once in this interval."""
        return self.twin.frame_rate_hz

    def sense(self, data: mujoco.MjData) -> Frame:
        """The next frame: the presses of a `mujoco.MjData`, measured by the twin, and the contacts found."""
        touches = self.worn.touches(data)
        if not len(touches.forces_n):
            return self._process(self.twin.untouched(1, first=self._next)[0])
        frames = self.twin.press(
            touches.positions_m,
            force_n=touches.forces_n,
            tip_radius_m=self.tip_radius_m,
            frame=np.zeros(len(touches.forces_n)),
            first=self._next,
        )
        return self._process(frames[0])

    def _process(self, values: NDArray[np.float64]) -> Frame:
        frame = self.pipeline.process(values, self._start_s + self._next / self.frame_rate_hz)
        self._next += 1
        return frame


def _geom(model: mujoco.MjModel, geom: str | int) -> int:
    """The index of a geom."""
    if isinstance(geom, str):
        index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, geom)
        if index < 0:
            names = [model.geom(index).name for index in range(model.ngeom)]
            raise DermisError(f"the model has no geom {geom!r}", hint=f"one of {', '.join(filter(None, names))}")
        return index
    if not 0 <= geom < model.ngeom:
        raise DermisError(f"the model has no geom {geom}", hint=f"it has {model.ngeom}, counted from 0")
    return int(geom)


def _nearest_on_triangle(point: Any, corners: Any) -> NDArray[np.float64]:
    """The nearest point of a triangle."""
    a, b, c = corners
    ab, ac, ap = b - a, c - a, point - a
    gram = np.array([[ab @ ab, ab @ ac], [ab @ ac, ac @ ac]])
    u, v = np.linalg.solve(gram, [ab @ ap, ac @ ap])
    if u >= 0 and v >= 0 and u + v <= 1:
        return a + u * ab + v * ac
    edges = [_nearest_on_segment(point, *edge) for edge in ((a, b), (b, c), (c, a))]
    return min(edges, key=lambda candidate: np.linalg.norm(candidate - point))


def _nearest_on_segment(point: Any, a: Any, b: Any) -> NDArray[np.float64]:
    share = np.clip((point - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
    return a + share * (b - a)
