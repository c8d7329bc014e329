"""A UR5 with skins on upper arm and forearm in MuJoCo: contacts, wrenches and joint torques, a collision, hand guiding.

python dermis-python/studies/robot.py contacts        (pip install './dermis-python[mujoco]' example-robot-data)
python dermis-python/studies/robot.py collision
python dermis-python/studies/robot.py guiding

The twin of a skin and its method share the model of touch: figures of real skins are another matter.
"""

import argparse
import json
import re
import site
import sys
import tempfile
from pathlib import Path

import mujoco
import numpy as np

import dermis
from dermis import commands
from dermis.mujoco import SimulatedRobot, wear

LINKS = {"upper_arm": "upper_arm_link", "forearm": "forearm_link"}
# Of the tip of a finger, and of the twin's presses, m.
TIP_M = 0.005
# Positions of the joints about which the arm moves, rad: stretched out forward, the elbow bent.
REST = np.array([0.0, -1.0, 1.2, -0.5, 0.5, 0.0])
# 95 % quantile of chi-square by degrees of freedom.
CHI_SQUARE = {1: 3.841, 2: 5.991, 3: 7.815, 4: 9.488, 5: 11.070, 6: 12.592}


def note(text):
    print(text, file=sys.stderr, flush=True)


def ur5():
    """The path of the description."""
    for folder in site.getsitepackages():
        path = Path(folder) / "cmeel.prefix/share/example-robot-data/robots/ur_description/urdf/ur5_robot.urdf"
        if path.exists():
            return path
    sys.exit("the UR5 is not there: pip install example-robot-data")


def arm_spec():
    """The UR5 as MuJoCo reads it: without the meshes for pictures, whose format it does not read."""
    path = ur5()
    text = re.sub(r"<!--.*?-->|<visual\b.*?</visual>", "", path.read_text(), flags=re.DOTALL)
    text = text.replace("package://example-robot-data/", f"{path.parents[3]}/")
    compiler = '<mujoco><compiler strippath="false"/></mujoco>'
    spec = mujoco.MjSpec.from_string(re.sub(r"(<robot\b[^>]*>)", rf"\1{compiler}", text, count=1))
    for body in spec.bodies:
        # The skins touch, not the links below: their meshes overlap at the joints.
        for geom in body.geoms:
            geom.contype = geom.conaffinity = 0
    spec.option.timestep = 0.0005
    # Sliding friction is a circle, and holds a finger that does not slide.
    spec.option.cone, spec.option.impratio = mujoco.mjtCone.mjCONE_ELLIPTIC, 20
    return spec


def add_finger(spec, mass_kg):
    """A sphere that moves freely and brings its own friction; gravity does not act on it."""
    finger = spec.worldbody.add_body(name="finger", pos=[2, 2, 2], gravcomp=1)
    for axis in np.eye(3):
        finger.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
    # MuJoCo's contacts yield in proportion to the force over the mass: by default 8 N press 20 g 7 mm deep, here
    # 0.1 mm.
    finger.add_geom(name="tip", size=[TIP_M, 0, 0], mass=mass_kg, priority=1, solref=[0.002, 1])


def designed(folder, given, rules=""):
    """Designs of the skins, calibrated with presses if wanted, and the file of the robot; returns its path."""
    text = f'name = "ur5"\ndescription = "{ur5()}"\nbase = "base_link"\n'
    for number, (name, link) in enumerate(LINKS.items()):
        design = folder / f"{name}.toml"
        around = {"around": given.around} if given.around else {}
        commands.new("link", ur5(), link, output=design, **around)
        method = given.method
        if given.calibrate:
            method = folder / f"{name}-calibration"
            calibrate(dermis.Skin.load(design), method, given, given.seed + number)
        line = f'method = "{method}"\n' if method else ""
        text += f'\n[[skin]]\nname = "{name}"\ndesign = "{name}.toml"\nlink = "{link}"\nsource = "emulate"\n{line}'
    path = folder / "ur5.toml"
    path.write_text(text + rules)
    return path


def calibrate(skin, folder, given, seed):
    """Learns the forces of a skin from presses at known places, as `dermis calibrate --method`."""
    random = np.random.default_rng(seed + 1000)
    places, _, _ = drawn(skin, random, given.calibrate)
    forces = random.uniform(1, 10, given.calibrate)
    twin = skin.twin(given.twin, seed=seed)
    # Hours before the robot works with it: noise and drift are others.
    frames, untouched = (
        twin.press(places, force_n=forces, tip_radius_m=TIP_M, first=10**6),
        twin.untouched(100, first=10**6 - 100),
    )
    method = given.method or skin.methods[0]
    calibration = skin.calibrate(frames, places, untouched, force_n=forces, method=method)
    calibration.save(folder)
    note(f"{skin.name} calibrated ({calibration.name}): {json.dumps(calibration.quality)}")


def drawn(skin, random, count, is_wanted=lambda edge_m: edge_m >= 0):
    """Random places on a skin: positions (m), outward normals, distances from its edges (m)."""
    nodes, cells = skin.mesh.nodes, skin.mesh.cells
    sides = np.sort(cells[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    sides, times = np.unique(sides, axis=0, return_counts=True)
    a, b = nodes[sides[times == 1].T]
    places, normals, distances = [], [], []
    while len(places) < count:
        corners = nodes[cells[random.choice(len(cells), p=skin.mesh.measures / skin.mesh.measures.sum())]]
        place = random.dirichlet(np.ones(3)) @ corners
        along = np.clip(np.sum((place - a) * (b - a), axis=1) / np.sum((b - a) ** 2, axis=1), 0, 1)
        edge_m = np.linalg.norm(a + along[:, None] * (b - a) - place, axis=1).min() if len(a) else np.inf
        if is_wanted(edge_m):
            normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
            places.append(place)
            normals.append(normal / np.linalg.norm(normal))
            distances.append(edge_m)
    return np.array(places), np.array(normals), np.array(distances)


class MovingArm:
    """The arm on a path, whatever presses it, and a finger that presses places of its skins."""

    def __init__(self, path, given, **delays):
        spec = arm_spec()
        for joint in spec.joints:
            # So heavy that a press does not move the joints: they follow the path exactly.
            joint.armature = 1e4
        wear(spec, path)
        # Light: moved at 1 m/s2 it adds 0.02 N to its force.
        add_finger(spec, 0.02)
        spec.option.gravity = [0, 0, 0]
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self.robot = SimulatedRobot(path, self.model, twin=given.twin, seed=given.seed, **delays)
        random = np.random.default_rng(given.seed)
        # Sines of 0.25 to 0.4 Hz with a mean square speed of (1 rad/s)^2.
        self.rate, self.phase = random.uniform(1.6, 2.5, 6), random.uniform(0, 2 * np.pi, 6)
        self.first = int(self.model.jnt_qposadr[self.model.body("finger").jntadr[0]])
        self.finger, self.tip = self.model.body("finger").id, self.model.geom("tip").id
        # When each skin was last touched, and the frames of a press with a contact on a skin that was not for long.
        self.touched_s, self.on_other = {}, 0
        self.step()
        mujoco.mj_forward(self.model, self.data)

    def step(self, worn=None, place=None, normal=None, force=None):
        """A step of the simulator, in which the finger is pressed on the skin with a force in the skin's frame."""
        model, data = self.model, self.data
        angle = self.rate * data.time + self.phase
        data.qpos[:6], data.qvel[:6] = REST + np.sqrt(2) / self.rate * np.sin(angle), np.sqrt(2) * np.cos(angle)
        if worn is not None:
            axes = data.geom_xmat[worn.geom].reshape(3, 3) @ worn.rotation
            velocity = self.velocity(worn, place)
            # The hand holds the finger over its place, by 1000 N/m along the skin, and damps it, so that it does not
            # bounce: 9 N s/m is critical for 20 g.
            off = worn.to_world(data, place) - data.geom_xpos[self.tip]
            inward = axes @ normal
            off -= (off @ inward) * inward
            moving = velocity - data.qvel[self.first : self.first + 3]
            data.xfrc_applied[self.finger, :3] = axes @ force + 1000.0 * off + 9.0 * moving
        else:
            data.xfrc_applied[self.finger] = 0
        mujoco.mj_step(model, data)

    def velocity(self, worn, place):
        """The velocity of a point of a skin in the world, m/s."""
        jacobian = np.zeros((3, self.model.nv))
        mujoco.mj_jac(
            self.model, self.data, jacobian, None, worn.to_world(self.data, place), self.model.geom_bodyid[worn.geom]
        )
        return jacobian[:, :6] @ self.data.qvel[:6]

    def frame(self, skin, *press):
        """Steps to the next frame, and senses; returns the snapshot and the truth."""
        end_s = self.data.time + 1 / self.robot.skins[skin].frame_rate_hz
        while self.data.time < end_s - self.model.opt.timestep / 2:
            self.step(*press)
        # Contacts are those of the state at the end of the step.
        mujoco.mj_forward(self.model, self.data)
        snapshot, _ = self.robot.sense(self.data)
        truth = self.robot.truth(self.data)
        self.touched_s |= dict.fromkeys(truth.skins, self.data.time)
        # Near the elbow the finger can touch both, and a contact that is not seen any more is kept for five frames.
        is_long_clear = {name: self.data.time - self.touched_s.get(name, -1.0) > 0.1 for name in LINKS}
        self.on_other += any(is_long_clear[contact["skin"]] for contact in snapshot["contacts"])
        pose = self.robot.robot.pose(LINKS[skin], self.robot.positions(self.data))
        return snapshot, (truth, pose), self.data.time

    def press(self, skin, place, normal, force, friction):
        """Presses a place for 24 frames (0.2 s); returns the last snapshot with the truth of the time of its frame."""
        self.on_other = 0
        worn, data = self.robot.skins[skin].worn, self.data
        self.model.geom_friction[self.tip, 0] = friction
        at = worn.to_world(data, place + (TIP_M + 0.0002) * normal)
        data.qpos[self.first : self.first + 3] = at - self.model.body_pos[self.finger]
        data.qvel[self.first : self.first + 3] = self.velocity(worn, place)
        mujoco.mj_kinematics(self.model, data)
        seen = [self.frame(skin, worn, place, normal, force) for _ in range(24)]
        # The finger leaves, and the skin is untouched for 12 frames.
        data.qpos[self.first : self.first + 3], data.qvel[self.first :] = 0, 0
        for _ in range(12):
            self.frame(skin)
        snapshot, _, now_s = seen[-1]
        measured_s = now_s - next(one["age_s"] for one in snapshot["skins"] if one["skin"] == skin)
        return snapshot, min(seen, key=lambda one: abs(one[2] - measured_s))[1]


def presses(arm, count, is_wanted, random):
    """Presses of 2 to 8 N with friction of 0 to 1; a row of figures for each."""
    rows = []
    while len(rows) < count:
        skin = list(LINKS)[len(rows) % 2]
        worn = arm.robot.skins[skin].worn
        (place,), (normal,), (edge_m,) = drawn(worn.skin, random, 1, is_wanted)
        force_n, friction = random.uniform(2, 8), random.uniform(0, 1)
        # Any force that does not make the finger slide: uniform in the disc of 0.9 of the friction, across the normal.
        across = np.linalg.svd(normal[None])[2][1:]
        turn, share = random.uniform(0, 2 * np.pi), 0.9 * friction * np.sqrt(random.uniform())
        force = force_n * (share * (np.cos(turn) * across[0] + np.sin(turn) * across[1]) - normal)
        snapshot, truth = arm.press(skin, place, normal, force, friction)
        if set(truth[0].skins) != {skin}:
            # Near the elbow the other skin is in the way.
            continue
        rows.append(row(skin, edge_m, friction, snapshot, *truth) | {"frames_on_other": arm.on_other})
        if len(rows) % 20 == 0:
            note(f"{len(rows)} of {count} presses")
    return rows


def row(skin, edge_m, friction, snapshot, truth, pose):
    """The figures of a press; `pose` is that of the link in the base's frame."""
    known = np.array([name == skin for name in truth.skins], dtype=bool)
    result = {"skin": skin, "edge_m": float(edge_m), "friction": friction, "found": False}
    normal_n = -np.sum(truth.normals * truth.forces_n, axis=1)[known]
    position = np.average(truth.positions_m[known], axis=0, weights=normal_n)
    result["force_n"] = float(normal_n.sum())
    near = [contact for contact in snapshot["contacts"] if contact["skin"] == skin and contact["position_base_m"]]
    off = [float(np.linalg.norm(np.array(contact["position_base_m"]) - position)) for contact in near]
    result["contacts"] = len(near)
    if not off or min(off) > 0.03:
        return result
    contact = near[int(np.argmin(off))]
    result |= {"found": True, "error_m": min(off), "sd_m": contact["sd_base_m"]}
    result |= {"position_link_m": contact["position_link_m"], "normal_link": contact["normal_link"]}
    normal = np.average(truth.normals[known], axis=0, weights=normal_n)
    cosine = np.clip(normal @ contact["normal_base"] / np.linalg.norm(normal), -1, 1)
    result |= {
        "tilt_rad": float(np.arccos(cosine)),
        "force_found_n": contact["force_n"],
        "force_sd_n": contact["force_sd_n"],
    }
    wrench = next(wrench for wrench in snapshot["wrenches"] if wrench["link"] == LINKS[skin])
    true = truth.wrenches[LINKS[skin]]
    # That of the normal forces alone: friction is not seen by a skin.
    normals, points = truth.normals[known] @ pose[:3, :3], (truth.positions_m[known] - pose[:3, 3]) @ pose[:3, :3]
    forces = np.sum(truth.normals[known] * truth.forces_n[known], axis=1)[:, None] * normals
    pressed = np.concatenate([forces.sum(axis=0), np.cross(points, forces).sum(axis=0)])
    result |= {"wrench": true.tolist(), "pressed": pressed.tolist(), "complete": wrench["complete"]}
    if wrench["complete"]:
        stated = np.concatenate([wrench["force_n"], wrench["torque_n_m"]])
        covariance = np.array(wrench["covariance"])
        result |= {"wrench_error": (stated - true).tolist(), "pressed_error": (stated - pressed).tolist()}
        result |= {"covariance": covariance.tolist(), **ellipsoid(stated - true, covariance)}
    if snapshot["joint_torques"]:
        names = list(truth.joint_torques)
        result["torques"] = [truth.joint_torques[name] for name in names]
        result["torques_found"] = [snapshot["joint_torques"][name]["torque_n_m"] for name in names]
        result["torques_sd"] = [snapshot["joint_torques"][name]["sd_n_m"] for name in names]
    return result


def ellipsoid(error, covariance):
    """The squared distance of an error in its ellipsoid, and the degrees of freedom.

    The covariance of one contact has rank 5: a force at the contact has no torque about the normal there. Directions
    whose variance is below 1e-6 of the largest (torques in units of 1 N at 0.1 m) are left out; the error in them is
    given.
    """
    units = np.array([1, 1, 1, 0.1, 0.1, 0.1])
    values, vectors = np.linalg.eigh(covariance / np.outer(units, units))
    along, is_kept = vectors.T @ (error / units), values > 1e-6 * values.max()
    squares = along[is_kept] ** 2 / values[is_kept]
    return {
        "distance": float(squares.sum()),
        "freedom": int(is_kept.sum()),
        "outside_n": float(np.abs(along[~is_kept]).max(initial=0)),
    }


def column(name, rows):
    return np.array([row[name] for row in rows], dtype=float)


def position_figures(rows):
    """How well all presses were located."""
    found = [row for row in rows if row["found"]]
    error, sd = column("error_m", found), column("sd_m", found)
    return {
        "presses": len(rows),
        "found": len(found),
        "with a second contact": sum(row.get("contacts", 0) > 1 for row in rows),
        "with a contact on a skin that is not touched": sum(row["frames_on_other"] > 0 for row in rows),
        "position error mean, mm": 1e3 * error.mean(),
        "95th percentile, mm": 1e3 * np.percentile(error, 95),
        "positions within 2 sd, %": 100 * np.mean(error <= 2 * sd),
        "within 2.448 sd (95 % if Gaussian), %": 100 * np.mean(error <= 2.448 * sd),
        "normal off, degrees rms": np.degrees(rms(column("tilt_rad", found))),
    }


def force_figures(rows):
    """How well forces, wrenches and joint torques were estimated."""
    forces = [row for row in rows if row["found"] and row["force_found_n"] is not None]
    if not forces:
        return {"forces": "unknown: the method is not calibrated"}
    true, estimate = column("force_n", forces), column("force_found_n", forces)
    force_sd = column("force_sd_n", forces)
    off = (estimate - true) / force_sd
    result = {
        "force error, relative rms, %": 100 * rms(estimate - true) / rms(true),
        "force bias, %": 100 * np.mean(estimate / true - 1),
        "force sd stated, % of force": 100 * np.mean(force_sd / estimate),
        "forces within 2 sd, %": 100 * np.mean(np.abs(off) <= 2),
    }
    whole = [row for row in forces if "wrench_error" in row]
    for link in LINKS:
        of_link = [row for row in whole if row["skin"] == link]
        for name, part in (("force", slice(0, 3)), ("torque", slice(3, 6))):
            relative = [
                100 * rms(column(error, of_link)[:, part]) / rms(column(of, of_link)[:, part])
                for error, of in (("wrench_error", "wrench"), ("pressed_error", "pressed"))
            ]
            result[f"wrench of {link}: {name}, relative rms, %"] = relative[0]
            result[f"wrench of {link}: {name}, of the normal forces alone, %"] = relative[1]
    inside = np.array([row["distance"] <= CHI_SQUARE[row["freedom"]] for row in whole])
    friction, freedom = column("friction", whole), column("freedom", whole)
    result |= {
        "wrenches in the 95 % ellipsoid, %": 100 * inside.mean(),
        "of friction below 0.5, %": 100 * inside[friction < 0.5].mean(),
        "of friction above 0.5, %": 100 * inside[friction >= 0.5].mean(),
        "its degrees of freedom, mean": freedom.mean(),
        "error in the direction left out, N m at most": 0.1 * column("outside_n", whole).max(),
    }
    torques = [row for row in whole if "torques" in row]
    off = column("torques_found", torques) - column("torques", torques)
    result["joint torques, relative rms, %"] = 100 * rms(off) / rms(column("torques", torques))
    moved = column("torques_sd", torques) > 1e-6
    result["joint torques within 2 sd, %"] = 100 * np.mean(
        np.abs(off[moved]) <= 2 * column("torques_sd", torques)[moved]
    )
    return result


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


def contacts(given, folder):
    path = designed(folder, given)
    arm = MovingArm(path, given)
    random = np.random.default_rng(given.seed)
    result, rows = {}, {}
    for name, is_wanted in (
        ("30 mm from edges", lambda edge_m: edge_m >= 0.03),
        ("15 mm from an edge", lambda edge_m: edge_m <= 0.015),
    ):
        rows[name] = presses(arm, given.presses, is_wanted, random)
        result[name] = position_figures(rows[name]) | force_figures(rows[name])
    for name, delays in (
        ("joints 20 ms late", {"joints_delay_s": 0.02}),
        ("joints and frames 20 ms late", {"joints_delay_s": 0.02, "delay_s": 0.02}),
        ("joints 20 ms, frames 10 ms late", {"joints_delay_s": 0.02, "delay_s": 0.01}),
    ):
        late = presses(
            MovingArm(path, given, **delays),
            given.late,
            lambda edge_m: edge_m >= 0.03,
            np.random.default_rng(given.seed),
        )
        result[name] = figures = position_figures(late)
        same = [one["error_m"] for one in rows["30 mm from edges"][: given.late] if one["found"]]
        result[name]["added to the mean, mm"] = figures["position error mean, mm"] - 1e3 * float(np.mean(same))
    if given.rows:
        Path(given.rows).write_text(json.dumps(rows))
    return result


# Servos of the UR5e in MuJoCo Menagerie: N m/rad, N m s/rad, N m for the three large joints and the three small ones;
# reflected inertia of a rotor, kg m2.
GAIN, DAMPING = np.repeat([2000.0, 500.0], 3), np.repeat([400.0, 100.0], 3)
TORQUE, ROTOR = np.repeat([150.0, 28.0], 3), 0.1
# Scan of a frame at 120 Hz, and its transfer, s.
FRAME_DELAY_S = 1 / 120 + 0.001
# The UR5 takes commands 125 times a second.
CYCLE_S = 0.008
RULES = """
[[rule]]
name = "touched"
on = ["*"]
when = "touched"
unknown = "ignore"
[[rule]]
name = "contact"
on = ["*"]
when = "contact"
unknown = "ignore"
"""


class ServoArm:
    """The arm with its masses and servos, which compensate gravity; commands are positions and speeds of the joints."""

    def __init__(self, path, given, add):
        spec = arm_spec()
        for joint in spec.joints:
            joint.armature = ROTOR
        for body in spec.bodies:
            body.gravcomp = 1
        wear(spec, path)
        add(spec)
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self.robot = SimulatedRobot(path, self.model, twin=given.twin, seed=given.seed, delay_s=FRAME_DELAY_S)
        self.position, self.speed = REST.copy(), np.zeros(6)

    def start(self, position):
        """Puts the arm at rest, two seconds later, so that no joint jumps, until all rules have ended."""
        self.position, self.speed = np.array(position), np.zeros(6)
        self.data.qpos[:], self.data.qvel[:], self.data.xfrc_applied[:] = 0, 0, 0
        self.data.qpos[:6] = position
        self.data.time += 2
        for _ in range(800):
            self.step()
            self.sense()
        mujoco.mj_forward(self.model, self.data)

    def sense(self):
        """The snapshot, every millisecond, which is often enough for the delay of frames; else nothing."""
        if round(self.data.time / self.model.opt.timestep) % 2 == 0:
            return self.robot.sense(self.data)[0]
        return None

    def step(self):
        self.position += self.speed * self.model.opt.timestep
        torque = GAIN * (self.position - self.data.qpos[:6]) + DAMPING * (self.speed - self.data.qvel[:6])
        self.data.qfrc_applied[:6] = np.clip(torque, -TORQUE, TORQUE)
        mujoco.mj_step(self.model, self.data)


def collision(given, folder):
    """The forearm swings against a post on a spring, whose deflection measures the force, as in ISO/TS 15066."""
    given.calibrate = 0
    path = designed(folder, given, RULES)

    def add(spec):
        # A light post, 40 mm thick, that gives way along y.
        post = spec.worldbody.add_body(name="post", pos=[0, 0, 0.3], gravcomp=1)
        post.add_joint(name="spring", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0, 1, 0])
        size = {"size": [0.02, 0.3, 0], "mass": 0.1, "solref": [0.002, 1]}
        post.add_geom(name="post", type=mujoco.mjtGeom.mjGEOM_CAPSULE, priority=1, **size)

    arm = ServoArm(path, given, add)
    spring = arm.model.joint("spring")
    result = {}
    for stiffness in given.stiffness:
        arm.model.jnt_stiffness[spring.id] = stiffness
        # Damped as a post that does not ring.
        arm.model.dof_damping[spring.dofadr[0]] = 2 * np.sqrt(0.1 * stiffness)
        for speed in (0.14, 0.27):
            random = np.random.default_rng(given.seed)
            starts = random.uniform(0.03, 0.05, given.runs)
            without = [swing(arm, speed, gap_m, None)[0] for gap_m in starts]
            figures = {"without reaction: peak force, N": float(np.mean(without))}
            for rule in ("touched", "contact"):
                forces, after_s, early = zip(*(swing(arm, speed, gap_m, rule) for gap_m in starts))
                figures |= {
                    f"{rule}: peak force, N": float(np.mean(forces)),
                    f"{rule}: highest of {given.runs}, N": max(forces),
                    f"{rule}: with over without": float(np.mean(forces) / np.mean(without)),
                    f"{rule}: from touch to command, ms": 1e3 * float(np.mean(after_s)),
                    f"{rule}: before the touch": sum(early),
                }
            result[f"{speed} m/s, {stiffness / 1000:g} N/mm"] = figures
            note(f"{speed} m/s, {stiffness / 1000:g} N/mm done")
    return result


def swing(arm, speed, gap_m, rule):
    """Swings the forearm against the post.

    Returns the peak force, N, the time from touch to command, s, and whether the command came before the touch.
    """
    model, data, post = arm.model, arm.data, arm.model.body("post").id
    worn = arm.robot.skins["forearm"].worn
    model.body_pos[post] = [2, 2, 0]
    arm.start(REST)
    # The middle of the forearm, its distance from the axis of the shoulder, and the post on its way, to the left.
    middle = worn.to_world(data, worn.skin.mesh.nodes.mean(axis=0))
    side = max(
        point[1]
        for point in (worn.to_world(data, node) for node in worn.skin.mesh.nodes)
        if abs(point[0] - middle[0]) < 0.02
    )
    model.body_pos[post] = [middle[0], side + 0.02 + gap_m, middle[2]]
    data.qpos[model.joint("spring").qposadr[0]] = 0
    mujoco.mj_forward(model, data)
    rate = speed / np.hypot(*middle[:2])
    # Up to this speed in 0.1 s, and on until 80 mm behind the place of the touch.
    begin_s, peak_n, touched_s, commanded_s, next_s = data.time, 0.0, None, None, 0.0
    end_s = begin_s + 0.05 + (gap_m + 0.08) / speed
    while data.time < end_s + 0.2:
        if commanded_s is None:
            since_s = data.time - begin_s
            arm.speed[0] = 0 if data.time > end_s else rate * min(since_s / 0.1, 1)
        arm.step()
        peak_n = max(
            peak_n, model.jnt_stiffness[model.joint("spring").id] * data.qpos[model.joint("spring").qposadr[0]]
        )
        if touched_s is None and any(True for _ in worn.contacts(data)):
            touched_s = data.time
        if rule and commanded_s is None:
            snapshot = arm.sense()
            holds = snapshot and rule in snapshot["rules"]
            next_s = data.time - (data.time % CYCLE_S) + CYCLE_S if holds and not next_s else next_s
            if next_s and data.time >= next_s:
                # Hold the position.
                commanded_s, arm.position, arm.speed = data.time, data.qpos[:6].copy(), np.zeros(6)
    touched_s = touched_s or np.nan
    after_s = np.nan if commanded_s is None else commanded_s - touched_s
    return peak_n, after_s, bool(after_s < 0)


def guiding(given, folder):
    """A hand pushes the forearm, whose joints yield to the torques of the push: by the skin, and by the true force."""
    path = designed(folder, given)
    # A hand, of the mass of a hand.
    arm = ServoArm(path, given, lambda spec: add_finger(spec, 0.4))
    worn = arm.robot.skins["forearm"].worn
    random = np.random.default_rng(given.seed)
    places, normals, _ = drawn(worn.skin, random, given.runs, lambda edge_m: edge_m >= 0.05)
    rows = []
    for place, normal in zip(places, normals):
        rows.append([guided(arm, worn, place, normal, torques) for torques in (by_skin, by_pressure, by_force)])
        note(f"{len(rows)} of {given.runs} pushes")
    skin, pressure, truth = np.array(rows).transpose(1, 0, 2)
    return {
        f"push of 10 N for 1.5 s, {given.runs} places": {
            "along the push by the skin, mm": 1e3 * skin[:, 0].mean(),
            "by the true normal force, mm": 1e3 * pressure[:, 0].mean(),
            "by the true force, mm": 1e3 * truth[:, 0].mean(),
            "skin over truth, median": float(np.median(skin[:, 0] / truth[:, 0])),
            "skin over truth, least": float(np.min(skin[:, 0] / truth[:, 0])),
            "skin over truth, most": float(np.max(skin[:, 0] / truth[:, 0])),
            "across the push by the skin, mm": 1e3 * skin[:, 1].mean(),
            "by the true force, across, mm": 1e3 * truth[:, 1].mean(),
            "until the finger slid, s, by the skin": skin[:, 2].mean(),
            "by the true force, s": truth[:, 2].mean(),
        }
    }


def by_skin(arm, snapshot):
    """The torques that the skins state, N m."""
    stated = snapshot["joint_torques"] or {}
    return [stated[name]["torque_n_m"] if stated else 0.0 for name in arm.robot.robot.joint_names]


def by_pressure(arm, _):
    """Those of the true normal forces: a skin does not see friction."""
    truth, robot, positions = arm.robot.truth(arm.data), arm.robot.robot, arm.robot.positions(arm.data)
    into_link = np.linalg.inv(robot.pose("forearm_link", positions))
    torques = np.zeros(6)
    for point, normal, force in zip(truth.positions_m, truth.normals, truth.forces_n):
        in_link = into_link[:3, :3] @ point + into_link[:3, 3]
        torques += robot.jacobian("forearm_link", positions, tuple(in_link))[:3].T @ ((force @ normal) * normal)
    return torques


def by_force(arm, _):
    """Those of the true forces."""
    return list(arm.robot.truth(arm.data).joint_torques.values())


def guided(arm, worn, place, normal, torques):
    """Pushes a place with 10 N for 1.5 s, or until the finger slid by 15 mm.

    Returns the way along and across the push, m, and how long it took, s.
    """
    model, data = arm.model, arm.data
    arm.start(REST)
    first, body = int(model.jnt_qposadr[model.body("finger").jntadr[0]]), model.body("finger").id
    begin = worn.to_world(data, place)
    push = data.geom_xmat[worn.geom].reshape(3, 3) @ worn.rotation @ -normal
    data.qpos[first : first + 3] = begin - (TIP_M + 0.0002) * push - model.body_pos[body]
    model.geom_friction[model.geom("tip").id, 0] = 0.8
    begin_s = data.time
    while data.time < begin_s + 1.5:
        # Muscles damp the hand: 10 N s/m.
        data.xfrc_applied[body, :3] = 10 * push - 10 * data.qvel[first : first + 3]
        arm.step()
        if snapshot := arm.sense():
            # Joints yield at 0.05 rad/s for 1 N m: 5 N at 0.5 m move a point by 60 mm/s.
            arm.speed = 0.05 * np.array(torques(arm, snapshot))
        tip = worn.to_skin(data, data.geom_xpos[model.geom("tip").id])
        if np.linalg.norm((tip - place) - ((tip - place) @ normal) * normal) > 0.015:
            break
    way = worn.to_world(data, place) - begin
    return way @ push, np.linalg.norm(way - (way @ push) * push), data.time - begin_s


def table(result):
    for name, figures in result.items():
        print(name)
        for key, value in figures.items():
            print(f"  {key:<50} {value if isinstance(value, (str, int)) else format(value, '.2f')}")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("study", choices=["contacts", "collision", "guiding"])
    parser.add_argument(
        "--method", help="reconstruction method, as of `dermis live` [default: the best one of each skin]"
    )
    parser.add_argument(
        "--calibrate",
        type=int,
        default=250,
        metavar="N",
        help="simulated presses of a calibration; 0: none, and no forces",
    )
    parser.add_argument("--around", help="as of `dermis new link`: 10..350 leaves a slit")
    parser.add_argument("--twin", default="lab")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--presses", type=int, default=200)
    parser.add_argument("--late", type=int, default=60, help="presses with late joint states")
    parser.add_argument("--runs", type=int, default=10, help="collisions, pushes")
    # ISO/TS 15066, table A.3, has 75 N/mm for hands and 150 for the skull; a steel post is stiffer than the arm.
    parser.add_argument("--stiffness", type=float, nargs="+", default=[75e3, 150e3, 1e6], help="of the post, N/m")
    parser.add_argument("--rows", metavar="FILE", help="write the figures of each press (JSON)")
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        result = globals()[given.study](given, Path(folder))
    print(json.dumps(result, indent=1)) if given.json else table(result)


if __name__ == "__main__":
    main()
