"""Checks the robot descriptions and views of a folder of `dermis fabricate`: frames of the electrodes in URDF, xacro and
MuJoCo, the launch file, the configuration of RViz, the layout of Foxglove.

Usage: check_robot.py FOLDER

Programs that are not installed (xacro, MuJoCo, PyYAML) are left out, with a message. There is no ROS here: the launch file
runs with stand-ins for its modules.
"""

import json
import math
import subprocess
import shutil
import sys
import tempfile
import types
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np

FOLDER = Path(sys.argv[1]).resolve()
ROBOT = FOLDER / "robot"


def optional(name):
    try:
        return __import__(name)
    except ImportError:
        print(f"{name}: skipped, it is not installed")
        return None


def rotation(roll, pitch, yaw):
    """Fixed axes x, y, z, as in URDF."""
    (cr, sr), (cp, sp), (cy, sy) = ((math.cos(angle), math.sin(angle)) for angle in (roll, pitch, yaw))
    about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    about_z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    return about_z @ about_y @ about_x


def poses(root):
    """Pose of every link in the frame of the root link, by the chain of its joints."""
    joints = {joint.find("child").get("link"): joint for joint in root.findall("joint")}

    def pose(link):
        if link not in joints:
            return np.eye(3), np.zeros(3)
        turn, place = pose(joints[link].find("parent").get("link"))
        origin = joints[link].find("origin")
        own = rotation(*map(float, origin.get("rpy", "0 0 0").split()))
        return turn @ own, place + turn @ np.array([float(value) for value in origin.get("xyz", "0 0 0").split()])

    return {link.get("name"): pose(link.get("name")) for link in root.findall("link")}


def largest_difference(a, b):
    """Of places, m, and of z axes."""
    return max(np.abs(a[1] - b[1]).max(), np.abs(a[0][:, 2] - b[0][:, 2]).max())


urdf = ElementTree.parse(ROBOT / "skin.urdf").getroot()
SKIN = urdf.find("link").get("name")
OWN = poses(urdf)
ELECTRODES = [link for link in OWN if link != SKIN]
mesh = urdf.find(".//mesh").get("filename")
assert (ROBOT / mesh).is_file(), mesh


def check_xacro():
    xacro = optional("xacro")
    if xacro is None:
        return
    at = "0.1 -0.2 0.3", "0.4 0.5 0.6"
    robot = f"""<?xml version="1.0"?>
<robot name="two" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:include filename="{ROBOT}/skin.urdf.xacro"/>
  <link name="arm"/>
  <xacro:dermis_{SKIN} parent="arm" mesh="file://{FOLDER}/base.stl"><origin xyz="0 0 0"/></xacro:dermis_{SKIN}>
  <xacro:dermis_{SKIN} prefix="left_" parent="arm" mesh="file://{FOLDER}/base.stl">
    <origin xyz="{at[0]}" rpy="{at[1]}"/>
  </xacro:dermis_{SKIN}>
</robot>
"""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "robot.urdf.xacro")
        path.write_text(robot)
        expanded = xacro.process_file(str(path)).toxml()
        root = ElementTree.fromstring(expanded)
        if shutil.which("check_urdf") is not None:
            whole = Path(folder, "robot.urdf")
            whole.write_text(expanded)
            subprocess.run(["check_urdf", str(whole)], capture_output=True, check=True)
    found = poses(root)
    assert len(found) == 1 + 2 * len(OWN)
    turn, place = rotation(*map(float, at[1].split())), np.array([float(value) for value in at[0].split()])
    worst = 0.0
    for link, (own_turn, own_place) in OWN.items():
        worst = max(worst, largest_difference(found[link], (own_turn, own_place)))
        moved = turn @ own_turn, place + turn @ own_place
        worst = max(worst, largest_difference(found[f"left_{link}"], moved))
    assert worst < 1e-6, worst
    print(f"xacro: two skins on one robot, {2 * len(ELECTRODES)} electrode frames within {worst:.1e} of the URDF (m, axes)")


def stl_corners():
    raw = np.frombuffer((FOLDER / "base.stl").read_bytes()[84:], dtype=np.dtype([("f", "<f4", 12), ("n", "<u2")]))["f"]
    return raw[:, 3:].reshape(-1, 3)


def check_mujoco():
    mujoco = optional("mujoco")
    if mujoco is None:
        return
    model = mujoco.MjModel.from_xml_path(str(ROBOT / "skin.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert model.nsite == len(ELECTRODES) and model.body(SKIN).id == 1
    worst = 0.0
    for link in ELECTRODES:
        site = model.site(link).id
        worst = max(worst, largest_difference((data.site_xmat[site].reshape(3, 3), data.site_xpos[site]), OWN[link]))
    assert worst < 1e-6, worst
    # The mass is that of the wall, by the volume of the STL file and the density stated.
    density = float(ElementTree.parse(ROBOT / "skin.xml").find(".//geom").get("density"))
    triangles = 1e-3 * stl_corners().reshape(-1, 3, 3).astype(float)
    expected = density * np.einsum("ij,ij->i", triangles[:, 0], np.cross(triangles[:, 1], triangles[:, 2])).sum() / 6
    mass = model.body_mass[1]
    assert abs(mass / expected - 1) < 0.01, (mass, expected)
    # MuJoCo moves a mesh to its centre of mass; what it draws is where the file has it.
    geom = model.geom("base").id
    vertices = model.mesh_vert @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]
    corners = 1e-3 * stl_corners()
    off = max(np.abs(vertices.min(axis=0) - corners.min(axis=0)).max(), np.abs(vertices.max(axis=0) - corners.max(axis=0)).max())
    assert off < 1e-6, off
    print(f"MuJoCo: loads, {model.nsite} sites within {worst:.1e} of the URDF, the base within {1e6 * off:.2f} um, mass {mass:.4f} kg ({expected:.4f} by its volume)")


def check_launch():
    """What the launch file starts: the description with a mesh that exists, and RViz with a configuration that exists."""
    started = []

    class Any:
        def __init__(self, *given, **named):
            self.given, self.named = given, named
            started.append(self)

    for name, classes in {
        "launch": ["LaunchDescription"],
        "launch.actions": ["DeclareLaunchArgument", "ExecuteProcess"],
        "launch.conditions": ["IfCondition"],
        "launch.substitutions": ["LaunchConfiguration", "PythonExpression"],
        "launch_ros": [],
        "launch_ros.actions": ["Node"],
    }.items():
        module = types.ModuleType(name)
        for one in classes:
            setattr(module, one, type(one, (Any,), {}))
        sys.modules[name] = module
    path = ROBOT / "skin.launch.py"
    scope = {"__file__": str(path), "__name__": "launched"}
    exec(compile(path.read_text(), str(path), "exec"), scope)
    scope["generate_launch_description"]()
    nodes = {one.named["package"]: one.named for one in started if type(one).__name__ == "Node"}
    description = ElementTree.fromstring(nodes["robot_state_publisher"]["parameters"][0]["robot_description"])
    assert description.find(".//mesh").get("filename") == (FOLDER / "base.stl").as_uri()
    arguments = nodes["rviz2"]["arguments"]
    assert Path(arguments[arguments.index("-d") + 1]).is_file() and arguments[arguments.index("-f") + 1] == SKIN
    command = next(one.named["cmd"] for one in started if type(one).__name__ == "ExecuteProcess")
    assert command[command.index("--frame-id") + 1] == SKIN
    print("launch file: runs with stand-ins for ROS, its files exist")


def check_views():
    layout = json.loads((ROBOT / "foxglove.json").read_text())
    scene = layout["configById"]["3D!skin"]
    assert scene["followTf"] == SKIN and "/dermis/markers" in scene["topics"]
    panels = [layout["layout"]["first"], layout["layout"]["second"]]
    assert sorted(panels) == sorted(layout["configById"])
    yaml = optional("yaml")
    if yaml is not None:
        manager = yaml.safe_load((ROBOT / "skin.rviz").read_text())["Visualization Manager"]
        assert manager["Global Options"]["Fixed Frame"] == SKIN
        topics = [display["Topic"]["Value"] for display in manager["Displays"] if "Topic" in display]
        assert "/dermis/markers" in topics
    print("views: RViz and Foxglove show /dermis/markers in the frame of the URDF")


check_xacro()
check_mujoco()
check_launch()
check_views()
