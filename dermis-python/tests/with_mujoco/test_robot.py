"""Kinematics against MuJoCo, which reads the same URDF: poses and Jacobians of four robots of `example-robot-data`.

Skipped where MuJoCo or the robots are missing: `pip install mujoco example-robot-data`.
"""

import re
import site
from pathlib import Path

import numpy as np
import pytest

import dermis

mujoco = pytest.importorskip("mujoco")

ROBOTS = {
    "ur5": ("ur_description/urdf/ur5_robot.urdf", "wrist_3_link"),
    "panda": ("panda_description/urdf/panda.urdf", "panda_leftfinger"),
    "talos": ("talos_data/robots/talos_full_v2.urdf", "gripper_left_fingertip_1_link"),
    "g1": ("g1_description/urdf/g1_29dof_with_hand_rev_1_0.urdf", "right_hand_thumb_2_link"),
}
POSES = 1000


def description(name):
    for folder in site.getsitepackages():
        path = Path(folder) / "cmeel.prefix" / "share" / "example-robot-data" / "robots" / ROBOTS[name][0]
        if path.exists():
            return path
    pytest.skip("example-robot-data is not installed")


def bare(text):
    """The URDF without shapes, whose meshes MuJoCo would read; every link has some mass, and none is merged into its parent."""
    text = re.sub(r"<!--.*?-->", "", text, flags=re.S)
    for tag in ("visual", "collision", "inertial", "mujoco", "transmission", "gazebo", "sensor"):
        text = re.sub(rf"<{tag}\b[^>]*?/>|<{tag}\b.*?</{tag}>", "", text, flags=re.S)
    mass = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    text = re.sub(r'<link name="([^"]*)"\s*/>', r'<link name="\1"></link>', text)
    text = re.sub(r'(<link name="[^"]*"\s*>)', rf"\1{mass}", text)
    option = '<mujoco><compiler fusestatic="false" balanceinertia="true"/></mujoco>'
    return re.sub(r"(<robot\b[^>]*>)", rf"\1{option}", text, count=1)


@pytest.mark.parametrize("name", ROBOTS)
def test_poses_and_jacobians_are_those_of_mujoco(name, tmp_path):
    path = description(name)
    (tmp_path / "robot.toml").write_text(
        f"name = 'x'\ndescription = '{path}'\n[[skin]]\nname = 's'\ndesign = 'skin16'\nlink = '{ROBOTS[name][1]}'\nsource = 'emulate'\n"
    )
    robot = dermis.Robot(tmp_path / "robot.toml")
    model = mujoco.MjModel.from_xml_string(bare(path.read_text()))
    data = mujoco.MjData(model)
    joints = {mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_JOINT, k): k for k in range(model.njnt)}
    moving = [joint for joint in robot.joint_names if joint in joints]
    assert moving == robot.joint_names
    # MuJoCo holds joints that mimic another by a force: here by their own equation.
    equations = [(model.eq_obj1id[k], model.eq_obj2id[k], model.eq_data[k]) for k in range(model.neq)]
    bodies = [link for link in robot.links if mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, link) > 0]
    assert ROBOTS[name][1] in bodies
    root = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, robot.base)
    random = np.random.default_rng(1)
    worst = 0.0
    for _ in range(POSES):
        positions = {joint: random.uniform(-3, 3) for joint in moving}
        for joint, position in positions.items():
            data.qpos[model.jnt_qposadr[joints[joint]]] = position
        for follower, source, polynomial in equations:
            leading = data.qpos[model.jnt_qposadr[source]]
            data.qpos[model.jnt_qposadr[follower]] = np.polyval(polynomial[4::-1], leading)
        mujoco.mj_forward(model, data)
        # The world is the frame of the root, which MuJoCo may leave out.
        base_rotation = data.xmat[root].reshape(3, 3) if root > 0 else np.eye(3)
        base = data.xpos[root] if root > 0 else np.zeros(3)
        link = bodies[random.integers(len(bodies))]
        body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, link)
        pose = robot.pose(link, positions)
        worst = max(worst, np.abs(pose[:3, :3] - base_rotation.T @ data.xmat[body].reshape(3, 3)).max())
        worst = max(worst, np.abs(pose[:3, 3] - base_rotation.T @ (data.xpos[body] - base)).max())
        point = random.uniform(-0.1, 0.1, 3)
        world = data.xpos[body] + data.xmat[body].reshape(3, 3) @ point
        linear, angular = np.zeros((3, model.nv)), np.zeros((3, model.nv))
        mujoco.mj_jac(model, data, linear, angular, world, body)
        full = np.vstack([base_rotation.T @ linear, base_rotation.T @ angular])
        # Columns of followers belong to what they follow, by the slope of their equation.
        for follower, source, polynomial in equations:
            full[:, model.jnt_dofadr[source]] += polynomial[1] * full[:, model.jnt_dofadr[follower]]
        expected = full[:, [model.jnt_dofadr[joints[joint]] for joint in robot.joint_names]]
        worst = max(worst, np.abs(robot.jacobian(link, positions, tuple(point)) - expected).max())
    assert worst < 1e-9, worst
