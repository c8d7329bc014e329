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

from collections.abc import Callable, Iterator
from functools import partial
from os import PathLike
from typing import Any, NamedTuple
from xml.sax.saxutils import quoteattr

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from dermis._dermis import Frame, Pipeline, Robot, Skin, Twin
from dermis._errors import DermisError

__all__ = ["SimulatedRobot", "SimulatedSkin", "Touches", "Truth", "WornSkin", "describe", "wear"]

# Wall under a skin, m: that of `[fabrication] wall_m` of the designs of `dermis new link`.
_WALL_M = 0.005
# The farthest that a convex hull may stand off from its part of a skin, m: small against the errors of positions.
_HULL_M = 0.0005
# A contact point farther from the skin along the surface is beyond its edge, m: a flat triangle and a curved geom differ by less.
_BESIDE_M = 0.002
# A press has at least this part of its direction into the skin: 80 degrees from the normal.
_INWARD = 0.17


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
    point of the skin. Points farther from it than `reach_m` and the depth of the contact, beyond its edge, or pressed from
    behind belong to the rest of the geom and are left out. Several points of one body within `merge_m` of their mean are one
    press, as under a flat face.

    Args:
        skin: A `dermis.Skin`.
        model: The `mujoco.MjModel`.
        geom: Name or index of the geom that wears the skin. The pieces `NAME/1`, `NAME/2`, ... of `wear` belong to it.
        position: Origin of the skin's frame in the geom's, (3,), m; of a mesh in the frame of its file, which MuJoCo moves to
            the middle and the principal axes. Without it the middles of both coincide (the origin of a cylinder is its middle in
            MuJoCo, its lower end in Dermis), and on a mesh the frames.
        rotation: Axes of the skin's frame in the same one, (3, 3); the same axes without it.
        merge_m: Largest distance of the contact points of one press from their mean, m.
        reach_m: Largest distance of a contact point from the skin, m, where the geom has not its exact shape.

    Raises:
        DermisError: A geom that does not exist, a position that is not finite, a rotation that is none.
    """

    skin: Skin
    model: mujoco.MjModel
    merge_m: float
    reach_m: float
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
        reach_m: float = 0.02,
    ) -> None:
        for name, length in [("merge_m", merge_m), ("reach_m", reach_m)]:
            if not length >= 0:
                raise DermisError(f"`{name}` is {length}", hint="give a length, m")
        self.skin, self.model, self.merge_m, self.reach_m = skin, model, merge_m, reach_m
        self.geom = _geom(model, geom)
        name = model.geom(self.geom).name
        pieces = (index for index in range(model.ngeom) if name and model.geom(index).name.startswith(f"{name}/"))
        self._geoms = {self.geom, *pieces}
        mesh = skin.mesh
        self._nodes, self._cells = mesh.nodes, mesh.cells
        if self._cells.shape[1] != 3:
            raise DermisError("a worn skin is a surface", hint="give a design whose mesh is of triangles")
        middle = (self._nodes.min(axis=0) + self._nodes.max(axis=0)) / 2
        asset = model.geom_dataid[self.geom] if model.geom_type[self.geom] == mujoco.mjtGeom.mjGEOM_MESH else -1
        default = np.zeros(3) if asset >= 0 else -middle
        self.position = default if position is None else _of_shape(position, "position", (3,))
        self.rotation = np.eye(3) if rotation is None else _of_shape(rotation, "rotation", (3, 3))
        is_orthogonal = np.allclose(self.rotation @ self.rotation.T, np.eye(3), atol=1e-6)
        if not is_orthogonal or np.linalg.det(self.rotation) < 0:
            raise DermisError("`rotation` is no rotation", hint="give three orthogonal unit vectors, right-handed")
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
        for position, normal, wrench, other in self.contacts(data):
            force = wrench[:3] @ normal
            points.append((self.to_skin(data, position), self.direction_to_skin(data, normal), force))
            others.append(other)
        presses = [press for other in sorted(set(others)) for press in self._merged(points, others, other)]
        positions = np.array([self.nearest(position) for position, _, _ in presses]).reshape(-1, 3)
        normals = np.array([normal for _, normal, _ in presses]).reshape(-1, 3)
        return Touches(positions, normals, np.array([force for _, _, force in presses]))

    def contacts(self, data: mujoco.MjData) -> Iterator[tuple[Any, Any, Any, int]]:
        """The contact points of the simulator that press the skin, in the world's frame.

        Yields:
            The position, (3,), m; the direction into the skin, (3,); force and torque on the skin about the position,
            with friction, (6,), N and N m; the index of the other geom.
        """
        for index in range(data.ncon):
            contact = data.contact[index]
            is_first, is_second = (geom in self._geoms for geom in contact.geom)
            force = np.zeros(6)
            mujoco.mj_contactForce(self.model, data, index, force)
            if is_first == is_second or force[0] <= 0:
                continue
            # The frame's first axis points from the first geom to the second, and the force is that on the second.
            axes = contact.frame.reshape(3, 3) * (-1 if is_first else 1)
            wrench = np.concatenate([force[:3] @ axes, force[3:] @ axes])
            depth_m = max(0.0, -contact.dist)
            if not self._is_on_skin(self.to_skin(data, contact.pos), self.direction_to_skin(data, axes[0]), depth_m):
                continue
            yield contact.pos.copy(), axes[0], wrench, int(contact.geom[1 if is_first else 0])

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
        return self._nearest(point)[0]

    def _nearest(self, point: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The nearest point of the skin, m, and the outward unit normal there."""
        distances = np.linalg.norm(self._nodes - point, axis=1)
        cells = {cell for node in np.argsort(distances)[:4] for cell in self._cells_of_node[node]}
        candidates = [(_nearest_on_triangle(point, self._nodes[self._cells[cell]]), cell) for cell in cells]
        nearest, cell = min(candidates, key=lambda candidate: np.linalg.norm(candidate[0] - point))
        a, b, c = self._nodes[self._cells[cell]]
        normal = np.cross(b - a, c - a)
        return nearest, normal / np.linalg.norm(normal)

    def _is_on_skin(self, point: NDArray[np.float64], direction: NDArray[np.float64], depth_m: float) -> bool:
        """Whether a contact point of the geom presses the skin, not the geom beyond its edge or behind it; the geoms may overlap."""
        nearest, outward = self._nearest(point)
        off = point - nearest
        above_m = off @ outward
        beside_m = np.linalg.norm(off - above_m * outward)
        return bool(abs(above_m) <= self.reach_m + depth_m and beside_m <= _BESIDE_M and direction @ outward < -_INWARD)

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
        **pose: `position`, `rotation`, `merge_m` and `reach_m` of `WornSkin`.
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
        return self._process(self._measured(data)[0])

    def _measured(self, data: mujoco.MjData) -> NDArray[np.float64]:
        """The values of the next frame, (1, channels), ohm."""
        touches = self.worn.touches(data)
        if not len(touches.forces_n):
            return self.twin.untouched(1, first=self._next)
        return self.twin.press(
            touches.positions_m,
            force_n=touches.forces_n,
            tip_radius_m=self.tip_radius_m,
            frame=np.zeros(len(touches.forces_n)),
            first=self._next,
        )

    def _process(self, values: NDArray[np.float64], time_s: float | None = None) -> Frame:
        frame = self.pipeline.process(values, self._next_s if time_s is None else time_s)
        self._next += 1
        return frame

    @property
    def _next_s(self) -> float:
        """The time of the next frame of the twin, s since 1970."""
        return self._start_s + self._next / self.frame_rate_hz


class Truth(NamedTuple):
    """What presses the skins of a robot, as the simulator has it. A row is a contact point: a flat contact has several.

    Attributes:
        skins: The skin of each point.
        positions_m: Positions in the base's frame, (n, 3), m.
        normals: Outward unit normals in the base's frame, (n, 3).
        forces_n: Forces on the robot with friction, in the base's frame, (n, 3), N.
        wrenches: Force and torque on each link that wears a skin, about the origin of its frame, in that frame, (6,),
            N and N m.
        joint_torques: The torques `J' w` on each joint, N m, or N of one that slides.
    """

    skins: list[str]
    positions_m: NDArray[np.float64]
    normals: NDArray[np.float64]
    forces_n: NDArray[np.float64]
    wrenches: dict[str, NDArray[np.float64]]
    joint_torques: dict[str, float]


class SimulatedRobot:
    """The skins of a robot in a simulator: a `SimulatedSkin` for each, whose frames go into a `dermis.Robot`.

    Each skin is on the geom of its name, as `wear` makes it. Links are placed by these geoms: bodies may be merged or
    have other names.

    >>> import mujoco, pathlib, tempfile
    >>> from dermis.mujoco import SimulatedRobot, describe, wear
    >>> spec = mujoco.MjSpec.from_string('''
    ... <mujoco><worldbody><body name="arm" pos="0 0 0.5">
    ...   <joint name="lift" type="slide" axis="0 0 1" damping="100"/><geom size="0.02"/>
    ... </body></worldbody></mujoco>''')
    >>> folder = pathlib.Path(tempfile.mkdtemp())
    >>> _ = (folder / "arm.urdf").write_text(describe(spec.copy().compile()))
    >>> _ = (folder / "arm.toml").write_text('''
    ... name = "arm"
    ... description = "arm.urdf"
    ... [[skin]]
    ... name = "sleeve"
    ... design = "cylinder30"
    ... link = "arm"
    ... source = "emulate"''')
    >>> geoms = wear(spec, folder / "arm.toml")
    >>> model = spec.compile()
    >>> robot = SimulatedRobot(folder / "arm.toml", model, method="noser")
    >>> data = mujoco.MjData(model)
    >>> mujoco.mj_step(model, data)
    >>> snapshot, events = robot.sense(data)
    >>> snapshot["touched"], robot.truth(data).joint_torques
    (False, {'lift': 0.0})

    Args:
        path: File of the robot (TOML), with a `description`.
        model: The `mujoco.MjModel`, with the joints of the description under their names.
        method: Method of every skin, in place of those of the file.
        twin: `ideal`, `lab`, `lab-b`, `lab-c` or `harsh`, or the path of a twin file.
        seed: Seed of the twin of the first skin; the next ones follow.
        delay_s: Time from the measurement of a frame to its delivery, as of scan and transport, s.
        joints_delay_s: The same of joint states, s.
        **options: `tip_radius_m`, `tare_frames` and `merge_m` of `SimulatedSkin`.

    Raises:
        DermisError: A robot without description, a skin without its geom, a joint that the model lacks, a model and a
            description that place the skins differently.
    """

    robot: Robot
    model: mujoco.MjModel
    skins: dict[str, SimulatedSkin]

    def __init__(
        self,
        path: str | PathLike[str],
        model: mujoco.MjModel,
        *,
        method: str | PathLike[str] | None = None,
        twin: str | PathLike[str] = "lab",
        seed: int = 1,
        delay_s: float = 0.0,
        joints_delay_s: float = 0.0,
        **options: Any,
    ) -> None:
        self.robot, self._placed = _robot(path)
        self.model, self._delays_s = model, (delay_s, joints_delay_s)
        if not min(self._delays_s) >= 0:
            raise DermisError("a delay is negative", hint="give 0 or more seconds")
        for name in self._placed:
            _geom(model, name)
        loaded = {placed.design: Skin.load(placed.design) for placed in self._placed.values()}
        self._worn = {name: WornSkin(loaded[placed.design], model, name) for name, placed in self._placed.items()}
        joints = {model.joint(index).name: int(model.jnt_qposadr[index]) for index in range(model.njnt)}
        self._addresses = {name: joints[name] for name in self.robot.joint_names if name in joints}
        self._check()
        self.skins = {}
        for number, (name, placed) in enumerate(self._placed.items(), seed):
            skin, using = loaded[placed.design], method or placed.method
            self.skins[name] = SimulatedSkin(skin, model, name, method=using, twin=twin, seed=number, **options)
        # Deliveries that are on their way: when, in which order, and what.
        self._waiting: list[tuple[float, int, Callable[[], Any]]] = []
        self._due_s = dict.fromkeys(self.skins, -np.inf)
        self._count, self._start_s = 0, float("nan")

    def sense(self, data: mujoco.MjData) -> tuple[dict[str, Any], list[dict[str, Any]]]:
        """Measures the joints and every skin whose frame is due, and delivers what has arrived at that time.

        To be called in every step, or at least at the frame rate of the skins.

        Returns:
            The snapshot, as of `dermis.Robot.snapshot`, and the events of rules since the last call.

        Raises:
            DermisError: A time before that of the last call.
        """
        if np.isnan(self._start_s):
            # After the untouched frames of the start.
            self._start_s = max(skin._next_s for skin in self.skins.values()) - data.time
        now_s = self.time_s(data)
        delay_s, joints_delay_s = self._delays_s
        self._send(now_s + joints_delay_s, partial(self.robot.joints, self.positions(data), now_s))
        for name, skin in self.skins.items():
            # Steps of the simulator are no multiples of the interval.
            if data.time < self._due_s[name] - self.model.opt.timestep / 2:
                continue
            interval_s = 1 / skin.frame_rate_hz
            self._due_s[name] = max(self._due_s[name] + interval_s, data.time + interval_s / 2)
            frame, at_s = skin._process(skin._measured(data)[0], now_s), now_s + delay_s
            self._send(at_s, partial(self.robot.feed, name, frame, at_s))
        events: list[dict[str, Any]] = []
        while self._waiting and self._waiting[0][0] <= now_s:
            events += self._waiting.pop(0)[2]() or []
        events += self.robot.tick(now_s)
        return self.robot.snapshot(now_s), events

    def time_s(self, data: mujoco.MjData) -> float:
        """The time of the robot, s since 1970, at that of a simulator that starts at zero."""
        return self._start_s + float(data.time)

    def positions(self, data: mujoco.MjData) -> dict[str, float]:
        """The positions of the joints of the description, rad or m, by name."""
        return {name: float(data.qpos[address]) for name, address in self._addresses.items()}

    def base_pose(self, data: mujoco.MjData) -> NDArray[np.float64]:
        """The pose of the robot's base in the world, (4, 4), m, as the first skin's geom has it."""
        return self._base_pose(data, next(iter(self._worn)))

    def truth(self, data: mujoco.MjData) -> Truth:
        """What presses the skins at the state of a `mujoco.MjData`."""
        base, positions = np.linalg.inv(self.base_pose(data)), self.positions(data)
        skins: list[str] = []
        points, normals, forces = [], [], []
        wrenches = {placed.link: np.zeros(6) for placed in self._placed.values()}
        for name, skin in self.skins.items():
            link = np.linalg.inv(self.robot.pose(self._placed[name].link, positions)) @ base
            for position, inward, wrench, _ in skin.worn.contacts(data):
                skins.append(name)
                points.append(base[:3, :3] @ position + base[:3, 3])
                normals.append(base[:3, :3] @ -inward)
                forces.append(base[:3, :3] @ wrench[:3])
                force, torque = link[:3, :3] @ wrench[:3], link[:3, :3] @ wrench[3:]
                arm = link[:3, :3] @ position + link[:3, 3]
                wrenches[self._placed[name].link] += np.concatenate([force, torque + np.cross(arm, force)])
        torques = np.zeros(len(self.robot.joint_names))
        known = {name: positions.get(name, 0.0) for name in self.robot.joint_names}
        for link_name, of_link in wrenches.items():
            turn = self.robot.pose(link_name, known)[:3, :3]
            jacobian = self.robot.jacobian(link_name, known)
            torques += jacobian.T @ np.concatenate([turn @ of_link[:3], turn @ of_link[3:]])
        rows = (np.array(vectors).reshape(-1, 3) for vectors in (points, normals, forces))
        positions_m, of_points, forces_n = rows
        by_joint = dict(zip(self.robot.joint_names, torques.tolist()))
        return Truth(skins, positions_m, of_points, forces_n, wrenches, by_joint)

    def _send(self, at_s: float, deliver: Callable[[], Any]) -> None:
        self._waiting.append((at_s, self._count, deliver))
        self._count += 1
        self._waiting.sort(key=lambda waiting: waiting[:2])

    def _base_pose(self, data: mujoco.MjData, name: str) -> NDArray[np.float64]:
        worn, placed = self._worn[name], self._placed[name]
        skin = np.eye(4)
        skin[:3, :3] = data.geom_xmat[worn.geom].reshape(3, 3) @ worn.rotation
        skin[:3, 3] = worn.to_world(data, np.zeros(3))
        return skin @ np.linalg.inv(self.robot.pose(placed.link, self.positions(data)) @ placed.origin)

    def _check(self) -> None:
        """Refuses a model that lacks a joint, or places the skins otherwise than the description."""
        data, random = mujoco.MjData(self.model), np.random.default_rng(1)
        for address in self._addresses.values():
            data.qpos[address] += random.uniform(-1, 1)
        mujoco.mj_kinematics(self.model, data)
        lacking = [name for name in self.robot.joint_names if name not in self._addresses]
        for name, placed in self._placed.items():
            try:
                self.robot.pose(placed.link, self.positions(data))
            except DermisError as error:
                if not lacking:
                    raise
                what = f"the model lacks a joint between {self.robot.base!r} and {placed.link!r}"
                raise DermisError(what, hint=f"of the description it has no joint {', '.join(lacking)}") from error
            off = np.abs(self._base_pose(data, name) - self.base_pose(data)).max()
            if off > 1e-6:
                raise DermisError(
                    f"the model has the skin {name!r} {off:.2g} m or radians from where the description has it",
                    hint="make the description from the model with `describe`, and the geoms with `wear`",
                )


def wear(spec: mujoco.MjSpec, path: str | PathLike[str]) -> dict[str, list[Any]]:
    """Adds the skins of a robot to the bodies of their links, as colliding meshes without mass.

    MuJoCo collides the convex hull of a mesh, which would close slits and fill waists. So a skin is cut into pieces
    whose hulls are within 0.5 mm of it, each with a wall of 5 mm below: the geoms `NAME`, `NAME/1`, `NAME/2`, ...
    MuJoCo's contacts are soft, the more so the lighter what touches: what sinks in by more than a wall passes through.

    Args:
        spec: The `mujoco.MjSpec`, before it is compiled.
        path: File of the robot (TOML), with a `description`.

    Returns:
        The geoms of each skin, to set their friction or stiffness.

    Raises:
        DermisError: A robot without description, a link without a body.
    """
    robot, skins = _robot(path)
    geoms: dict[str, list[Any]] = {}
    loaded = {placed.design: Skin.load(placed.design).mesh for placed in skins.values()}
    for name, placed in skins.items():
        # MuJoCo makes the root of a URDF its world.
        body = spec.body(placed.link) or (spec.worldbody if placed.link == robot.base else None)
        if body is None:
            bodies = ", ".join(body.name for body in spec.bodies)
            raise DermisError(f"the model has no body {placed.link!r}", hint=f"one of {bodies}")
        mesh = loaded[placed.design]
        if mesh.cells.shape[1] != 3:
            raise DermisError("a worn skin is a surface", hint="give a design whose mesh is of triangles")
        quaternion = np.zeros(4)
        mujoco.mju_mat2Quat(quaternion, placed.origin[:3, :3].flatten())
        geoms[name] = []
        for index, points in enumerate(_convex_pieces(mesh.nodes, mesh.cells)):
            piece = f"{name}/{index}" if index else name
            # Links often have a mesh of the same name. A thin piece has no volume to speak of.
            asset = f"skin of {piece}"
            spec.add_mesh(name=asset, uservert=points.flatten(), inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL)
            shape = {"type": mujoco.mjtGeom.mjGEOM_MESH, "meshname": asset, "mass": 0.0}
            geoms[name].append(body.add_geom(name=piece, pos=placed.origin[:3, 3], quat=quaternion, **shape))
    return geoms


def describe(model: mujoco.MjModel) -> str:
    """The robot description (URDF) of a MuJoCo model: its kinematics, for the key `description` of the file of a robot.

    A body is a link, the world too. A body with several joints has links between them. Free and ball joints, and bodies
    moved by mocap, are `floating`: they begin another tree. What has no name is called `body_3` or `joint_2` by its
    index. Equalities of joints are not written.

    >>> import mujoco
    >>> from dermis.mujoco import describe
    >>> model = mujoco.MjModel.from_xml_string('''
    ... <mujoco><worldbody><body name="arm">
    ...   <joint name="lift" type="slide"/><geom size="0.1"/>
    ... </body></worldbody></mujoco>''')
    >>> '<joint name="lift" type="prismatic">' in describe(model)
    True

    Args:
        model: The `mujoco.MjModel`.
    """
    taken: set[str] = set()
    links = [_unused(model.body(index).name or f"body_{index}", taken) for index in range(model.nbody)]
    parts = [f"<link name={quoteattr(link)}/>" for link in links]
    kinds = {int(mujoco.mjtJoint.mjJNT_HINGE): "continuous", int(mujoco.mjtJoint.mjJNT_SLIDE): "prismatic"}
    names: set[str] = set()
    for body in range(1, model.nbody):
        parent, at = links[model.body_parentid[body]], _pose(model.body_pos[body], model.body_quat[body])
        first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
        for joint in range(first, first + count):
            kind = kinds.get(int(model.jnt_type[joint]), "floating")
            anchor, axis = model.jnt_pos[joint], model.jnt_axis[joint]
            at = at @ _pose(anchor)
            limit = ""
            if kind != "floating":
                # MuJoCo moves from the reference, URDF from zero.
                reference = -model.qpos0[model.jnt_qposadr[joint]]
                at = at @ (_pose(axis * reference) if kind == "prismatic" else _pose(quaternion=_turn(axis, reference)))
            if kind != "floating" and model.jnt_limited[joint]:
                kind = "revolute" if kind == "continuous" else kind
                low, high = model.jnt_range[joint].tolist()
                # URDF demands all four: effort and speed are not known.
                limit = f'<limit lower="{low!r}" upper="{high!r}" effort="0" velocity="0"/>'
            is_last = joint == first + count - 1 and not anchor.any()
            child = links[body] if is_last else _unused(f"{links[body]}_{joint - first}", taken)
            parts += [] if is_last else [f"<link name={quoteattr(child)}/>"]
            name = _unused(model.joint(joint).name or f"joint_{joint}", names)
            parts.append(_joint(name, kind, parent, child, at, f'<axis xyz="{_numbers(axis)}"/>{limit}'))
            parent, at = child, _pose(-anchor)
        if parent != links[body]:
            kind = "floating" if model.body_mocapid[body] >= 0 else "fixed"
            parts.append(_joint(_unused(f"{links[body]}_fixed", names), kind, parent, links[body], at))
    title = bytes(model.names).split(b"\0", 1)[0].decode() or "robot"
    return "\n  ".join([f"<robot name={quoteattr(title)}>", *parts]) + "\n</robot>\n"


class _Placed(NamedTuple):
    """A skin of a robot's file: its design, its link, the pose of its frame in the link's, (4, 4), and its method."""

    design: str
    link: str
    origin: NDArray[np.float64]
    method: str | None


def _robot(path: str | PathLike[str]) -> tuple[Robot, dict[str, _Placed]]:
    """The robot of a file, with its skins by name."""
    robot = Robot(path)
    if robot.base is None:
        fix = 'write description = "robot.urdf" in its file: `dermis.mujoco.describe` makes one of a model'
        raise DermisError("the robot has no description", hint=fix)
    methods, links = robot.skin_methods, robot.skin_links
    skins = {
        name: _Placed(design, links[name], robot.origin(name), methods[name]) for name, design in robot.skins.items()
    }
    return robot, skins


def _convex_pieces(nodes: NDArray[np.float64], cells: NDArray[np.int64]) -> Iterator[NDArray[np.float64]]:
    """The points of pieces of a surface that are nearly convex, each with its wall below."""
    corners = nodes[cells]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    of_nodes = np.zeros_like(nodes)
    np.add.at(of_nodes, cells, normals[:, None])
    of_nodes /= np.linalg.norm(of_nodes, axis=1, keepdims=True)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    # The edges of the surface: their middles, and the way out along the surface.
    sides = cells[:, [[0, 1], [1, 2], [2, 0]]]
    _, which, times = np.unique(np.sort(sides.reshape(-1, 2), axis=1), axis=0, return_inverse=True, return_counts=True)
    of_cell, of_side = np.nonzero((times[which] == 1).reshape(-1, 3))
    ends = nodes[sides[of_cell, of_side]]
    beyond = np.cross(ends[:, 1] - ends[:, 0], normals[of_cell])
    beyond /= np.linalg.norm(beyond, axis=1, keepdims=True)
    waiting = [np.arange(len(cells))]
    while waiting:
        part = waiting.pop()
        used = np.unique(cells[part])
        points, outward = nodes[used], of_nodes[used]
        has_edge = np.isin(of_cell, part)
        rise_m = max(_rise(points, points, outward), _rise(points, ends[has_edge, 0], beyond[has_edge]))
        # At a sharp fold even a single cell faces two sides, by the normals of its nodes.
        if len(part) == 1:
            yield np.concatenate([points, points - _WALL_M * outward])
        elif (outward @ outward.mean(axis=0)).min() < 0.5 * np.linalg.norm(outward.mean(axis=0)):
            # It faces more than one side.
            waiting += _halves(part, normals)
        elif rise_m > 2 * _HULL_M:
            waiting += _halves(part, corners.mean(axis=1))
        else:
            yield np.concatenate([points, points - _WALL_M * outward])


def _rise(points: NDArray[np.float64], origins: NDArray[np.float64], outward: NDArray[np.float64]) -> float:
    """The farthest that a point lies outside of a plane, m: of a fold twice its depth in its hull, of a bowl more."""
    return float(np.max(outward @ points.T - np.sum(outward * origins, axis=1)[:, None], initial=0))


def _halves(part: NDArray[np.int64], vectors: NDArray[np.float64]) -> list[NDArray[np.int64]]:
    """The cells of a part on both sides of its middle, in the direction in which their vectors differ most."""
    off = vectors[part] - vectors[part].mean(axis=0)
    along = off @ np.linalg.svd(off, full_matrices=False)[2][0]
    order = np.argsort(along, kind="stable")
    return [part[order[: len(part) // 2]], part[order[len(part) // 2 :]]]


def _unused(name: str, taken: set[str]) -> str:
    """A name that is not taken yet."""
    while name in taken:
        name += "_"
    taken.add(name)
    return name


def _pose(position: ArrayLike = (0, 0, 0), quaternion: ArrayLike = (1, 0, 0, 0)) -> NDArray[np.float64]:
    """A pose, (4, 4), of a position (m) and a quaternion (w, x, y, z)."""
    pose, axes = np.eye(4), np.zeros(9)
    mujoco.mju_quat2Mat(axes, np.asarray(quaternion, dtype=float))
    pose[:3, :3], pose[:3, 3] = axes.reshape(3, 3), position
    return pose


def _turn(axis: NDArray[np.float64], angle_rad: float) -> NDArray[np.float64]:
    """The quaternion (w, x, y, z) of a rotation."""
    quaternion = np.zeros(4)
    mujoco.mju_axisAngle2Quat(quaternion, axis, angle_rad)
    return quaternion


def _joint(name: str, kind: str, parent: str, child: str, at: NDArray[np.float64], more: str = "") -> str:
    """A joint of URDF."""
    yaw = np.arctan2(at[1, 0], at[0, 0])
    # The rest is turned about y and x alone: exact also where the first axis is vertical and yaw may be any.
    cos, sin = np.cos(yaw), np.sin(yaw)
    rest = np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]]) @ at[:3, :3]
    angles = [np.arctan2(-rest[1, 2], rest[1, 1]), np.arctan2(-rest[2, 0], rest[0, 0]), yaw]
    origin = f'<origin xyz="{_numbers(at[:3, 3])}" rpy="{_numbers(angles)}"/>'
    links = f"<parent link={quoteattr(parent)}/><child link={quoteattr(child)}/>"
    return f'<joint name={quoteattr(name)} type="{kind}">{origin}{links}{more}</joint>'


def _numbers(values: Any) -> str:
    return " ".join(repr(float(value)) for value in values)


def _of_shape(value: ArrayLike, name: str, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Finite numbers of a shape."""
    array = np.asarray(value, dtype=float)
    if array.shape != shape or not np.isfinite(array).all():
        raise DermisError(f"`{name}` is {array.tolist()}", hint=f"give finite numbers of the shape {shape}")
    return array


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
