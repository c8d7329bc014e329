"""A robot with skins in MuJoCo: description, geoms, truth, delays. Skipped where MuJoCo is missing."""

import numpy as np
import pytest

import dermis

mujoco = pytest.importorskip("mujoco")
from dermis.mujoco import SimulatedRobot, _convex_pieces, describe, wear  # noqa: E402

# Two joints in a body, joints off the origin, references, a slanted axis, a slide, turned bodies, bodies and joints
# without names, a ball, a free body.
KINEMATICS = """
<mujoco model="arms &amp; legs">
  <compiler angle="radian"/>
  <worldbody>
    <body name="base" pos="0.1 0.2 0.3" euler="0.3 -0.4 0.5">
      <joint name="turn" axis="1 2 3" pos="0.05 -0.02 0.01" ref="0.4"/>
      <joint name="lift" type="slide" axis="0 1 1" ref="-0.1" range="-1 1"/>
      <geom size="0.02"/>
      <body pos="0 0 0.3" euler="0 1.5707963267948966 0">
        <joint axis="0 1 0" range="-2 2"/>
        <geom size="0.02"/>
        <body name="hand" pos="0.2 0 0"><geom size="0.02"/></body>
      </body>
      <body name="ball" pos="0.1 0 0"><joint type="ball"/><geom size="0.02"/>
        <body name="flap" pos="0.1 0 0"><joint name="hinge" axis="1 0 0" pos="0 0.1 0"/><geom size="0.02"/></body>
      </body>
    </body>
    <body name="free" pos="1 0 0"><freejoint/><geom size="0.02"/>
      <body name="fin" pos="0 0.3 0"><joint name="fin" axis="0 0 1"/><geom size="0.02"/></body>
    </body>
  </worldbody>
</mujoco>"""

# Two links, so heavy in their joints that a press does not move them, with a cuff that MuJoCo merges into the lower
# one, and a finger that can be put on their skins.
ARM = """
<mujoco>
  <compiler fusestatic="true"/>
  <option timestep="0.001" cone="elliptic" impratio="50"/>
  <worldbody>
    <body name="upper" pos="0.2 0.1 0.5" euler="0 0 90">
      <joint name="shoulder" axis="0 1 0" armature="1e5"/><geom size="0.02" mass="1"/>
      <body name="lower" pos="0 0 0.4">
        <joint name="elbow" axis="1 0 0" pos="0 0 -0.05" armature="1e5"/><geom size="0.02" mass="1"/>
        <body name="cuff" pos="0.01 0 0.05" euler="20 10 0"/>
      </body>
    </body>
    <body name="finger" pos="2 2 2" gravcomp="1">
      <joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/><joint type="slide" axis="0 0 1"/>
      <geom name="tip" size="0.005" mass="0.02" priority="1" friction="0.8" solref="0.003 1"/>
    </body>
  </worldbody>
</mujoco>"""
ORIGIN = "origin = { xyz_m = [0.01, -0.02, -0.1], rpy_rad = [0.1, 0.2, 0.3] }"
SKIN = '\n[[skin]]\nname = "{0}"\ndesign = "cylinder30"\nlink = "{0}"\nsource = "emulate"\n'


def written(folder, text, description):
    (folder / "robot.urdf").write_text(description)
    (folder / "robot.toml").write_text('name = "x"\ndescription = "robot.urdf"\n' + text)
    return folder / "robot.toml"


def placed(data, body):
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = data.body(body).xmat.reshape(3, 3), data.body(body).xpos
    return pose


def test_a_description_has_the_poses_of_the_model(tmp_path):
    model = mujoco.MjModel.from_xml_string(KINEMATICS)
    text = describe(model)
    assert 'name="arms &amp; legs"' in text
    data, random = mujoco.MjData(model), np.random.default_rng(1)
    # Each tree with a root of its own, which the free and the ball joint begin.
    for base, links, joints in (
        ("world", {"base", "hand", "body_2"}, {"turn", "lift", "joint_2"}),
        ("ball", {"flap"}, {"hinge"}),
        ("free", {"fin"}, {"fin"}),
    ):
        path = written(tmp_path, f'base = "{base}"\n' + SKIN.format(min(links)), text)
        robot = dermis.Robot(path)
        assert robot.joint_names == ["turn", "lift", "joint_2", "hinge", "fin"]
        for _ in range(50):
            data.qpos[:] = random.uniform(-1, 1, model.nq)
            mujoco.mj_kinematics(model, data)
            addresses = {"joint_2": 2} | {name: int(model.joint(name).qposadr[0]) for name in joints - {"joint_2"}}
            positions = {name: float(data.qpos[address]) for name, address in addresses.items() if name in joints}
            for link in links:
                body = 2 if link == "body_2" else link
                expected = np.linalg.inv(placed(data, base)) @ placed(data, body)
                assert np.abs(robot.pose(link, positions) - expected).max() < 1e-9, link
    with pytest.raises(dermis.DermisError, match="unknown"):
        dermis.Robot(written(tmp_path, SKIN.format("hand"), text)).pose(
            "flap", {"turn": 0.0, "lift": 0.0, "hinge": 0.0}
        )


class Bench:
    """The arm with two skins, and a finger that is pressed on them."""

    def __init__(self, folder, skins, **options):
        spec = mujoco.MjSpec.from_string(ARM)
        rule = '\n[[rule]]\nname = "stop"\non = ["*"]\nwhen = "contact"\nunknown = "ignore"\n'
        # The cuff is the last one.
        text = "".join(map(SKIN.format, skins)) + ORIGIN + rule
        whole = spec.copy()
        whole.compiler.fusestatic = False
        self.whole = whole.compile()
        path = written(folder, text, describe(self.whole))
        wear(spec, path)
        self.model = spec.compile()
        assert "cuff" not in [self.model.body(index).name for index in range(self.model.nbody)]
        self.data = mujoco.MjData(self.model)
        self.robot = SimulatedRobot(path, self.model, method="noser", **options)
        self.data.qpos[:2] = 0.4, -0.7
        mujoco.mj_forward(self.model, self.data)

    def pose(self, link):
        """The pose of a link, as the model has it whose bodies are not merged."""
        data = mujoco.MjData(self.whole)
        data.qpos[:] = self.data.qpos
        mujoco.mj_kinematics(self.whole, data)
        return placed(data, link)

    def put(self, name, point, normal):
        """Puts the finger on a point of a skin, in the skin's frame, and returns the point in the world."""
        worn = self.robot.skins[name].worn
        self.data.qpos[2:5] = worn.to_world(self.data, point + 0.0051 * normal) - 2
        self.data.qvel[:] = 0
        return worn.to_world(self.data, point)

    def run(self, count, force=(0, 0, 0)):
        """Presses the finger with a force in the world; returns what was sensed at each frame, and all events."""
        sensed, events = [], []
        for _ in range(count * 25 // 3):
            # The hand damps it.
            self.data.xfrc_applied[self.model.body("finger").id, :3] = force - 5 * self.data.qvel[2:5]
            mujoco.mj_step(self.model, self.data)
            snapshot, new = self.robot.sense(self.data)
            sensed.append((self.data.time, snapshot))
            events += [(self.data.time, event) for event in new]
        mujoco.mj_forward(self.model, self.data)
        return sensed, events


POINT, NORMAL = np.array([0.0, 0.05, 0.16]), np.array([0.0, 1.0, 0.0])


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    return Bench(tmp_path_factory.mktemp("robot"), ["upper", "cuff"])


def pressed(bench, name, share=0.3):
    """The finger on a skin, with a force of 5 N that is inclined along it."""
    worn = bench.robot.skins[name].worn
    at = bench.put(name, POINT, NORMAL)
    turn = bench.data.geom_xmat[worn.geom].reshape(3, 3) @ worn.rotation
    force = turn @ (5 * np.array([share, -1.0, 0.0]))
    return at, force, *bench.run(20, force)


@pytest.mark.parametrize("name", ["upper", "cuff"])
def test_a_press_is_found_on_its_link_and_its_truth_is_the_force_of_the_finger(bench, name):
    at, force, sensed, _ = pressed(bench, name)
    data = bench.data
    snapshot, truth = sensed[-1][1], bench.robot.truth(data)
    assert snapshot["touched"] is True
    (contact,) = snapshot["contacts"]
    assert (contact["skin"], contact["link"]) == (name, name)
    # The base is the world: the root of the model.
    assert bench.robot.base_pose(data) == pytest.approx(np.eye(4), abs=1e-9)
    # Of this method at this place; a wrong frame is off by centimetres.
    assert np.linalg.norm(np.array(contact["position_base_m"]) - at) < 0.008
    # Truth: the finger rests, so the arm takes its whole force, inclined as it is.
    assert set(truth.skins) == {name}
    assert truth.forces_n.sum(axis=0) == pytest.approx(force, abs=0.1)
    assert np.linalg.norm(truth.positions_m - at, axis=1).max() < 0.001
    assert truth.normals[0] @ force < -4.9
    pose = bench.pose(name)
    turned = pose[:3, :3].T @ truth.forces_n.sum(axis=0)
    arms = (truth.positions_m - pose[:3, 3]) @ pose[:3, :3]
    torque = np.cross(arms, truth.forces_n @ pose[:3, :3]).sum(axis=0)
    assert truth.wrenches[name] == pytest.approx(np.concatenate([turned, torque]), abs=1e-9)
    other = "upper" if name == "cuff" else "cuff"
    assert not truth.wrenches[other].any()
    # What the constraints of MuJoCo do to the joints.
    torques = [truth.joint_torques["shoulder"], truth.joint_torques["elbow"]]
    assert torques == pytest.approx(data.qfrc_constraint[:2], abs=1e-9)
    assert abs(torques[0]) > 0.1
    bench.data.qpos[2:5] = 0
    assert bench.run(30)[0][-1][1]["touched"] is False


def test_what_is_delivered_late_is_known_late(tmp_path):
    late = Bench(tmp_path, ["cuff"], delay_s=0.05)
    sensed, _ = late.run(3)
    assert sensed[-1][1]["skins"][0]["reason"] == "absent"
    late.run(20)
    begin_s = late.data.time
    *_, sensed, events = pressed(late, "cuff")
    first_s = next(time_s for time_s, snapshot in sensed if snapshot["touched"])
    # The delay, and at most an interval until the touch is seen and another until the next step of the press.
    assert 0.05 <= first_s - begin_s < 0.05 + 3 / 120
    # The contact is confirmed by the next frame.
    (event_s, event), *_ = events
    assert (event["rule"], event["event"]) == ("stop", "begins")
    assert 1 / 120 - 0.002 <= event_s - first_s <= 3 / 120
    ages = [snapshot["skins"][0]["age_s"] for _, snapshot in sensed]
    assert 0.05 - 1e-6 <= min(ages) and max(ages) < 0.05 + 1 / 120 + 0.0011


def test_geoms_have_no_mass(bench):
    bare = mujoco.MjSpec.from_string(ARM).compile()
    assert bench.model.body_mass == pytest.approx(bare.body_mass, abs=0)
    assert bench.model.body_inertia == pytest.approx(bare.body_inertia, abs=0)


@pytest.mark.parametrize("around", ["0..360", "5..355"])
def test_geoms_follow_a_skin_with_a_waist_and_a_slit(tmp_path, around):
    commands = pytest.importorskip("dermis.commands")
    (tmp_path / "link.stl").write_text(turned([(0, 0.045), (0.07, 0.03), (0.13, 0.03), (0.2, 0.045)]))
    link = '<link name="link"><collision><geometry><mesh filename="link.stl"/></geometry></collision></link>'
    (tmp_path / "link.urdf").write_text(f'<robot name="r">{link}</robot>')
    commands.new(
        "link", tmp_path / "link.urdf", "link", around=around, electrodes=12, output=tmp_path / "skin.toml", force=True
    )
    path = tmp_path / "robot.toml"
    skin = SKIN.format("link").replace("cylinder30", "skin.toml")
    path.write_text(f'name = "r"\ndescription = "link.urdf"\n{skin}')
    # A ball of 1 mm.
    spec = mujoco.MjSpec.from_string(
        '<mujoco><worldbody><body name="link"/><body><freejoint/><geom size="0.001"/></body></worldbody></mujoco>'
    )
    geoms = wear(spec, path)
    assert [geom.name for geom in geoms["link"][:2]] == ["link", "link/1"]
    model = spec.compile()
    data = mujoco.MjData(model)

    def touches(point):
        data.qpos[:3] = point
        mujoco.mj_forward(model, data)
        return data.ncon > 0

    mesh = dermis.Skin.load(tmp_path / "skin.toml").mesh
    corners = mesh.nodes[mesh.cells[::7]]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    for place, normal in zip(corners.mean(axis=1), normals):
        assert touches(place + 0.0009 * normal)
        assert not touches(place + 0.0018 * normal)
    # Between the banks of a slit, as far outside as they are, and 2 mm below.
    for height in np.linspace(mesh.nodes[:, 2].min() + 0.01, mesh.nodes[:, 2].max() - 0.01, 9):
        bank = mesh.nodes[
            np.argmin(np.abs(np.arctan2(mesh.nodes[:, 1], mesh.nodes[:, 0])) + 5 * np.abs(mesh.nodes[:, 2] - height))
        ]
        radius = np.hypot(*bank[:2])
        assert touches([radius, 0, bank[2]]) == touches([radius - 0.002, 0, bank[2]]) == (around == "0..360")


def test_a_sharp_fold_is_cut_to_its_cells():
    nodes = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.05, 0.1, 0.0], [0.05, 0.1, 0.01]])
    pieces = list(_convex_pieces(nodes, np.array([[0, 1, 2], [1, 0, 3]])))
    assert sorted(len(piece) for piece in pieces) == [6, 6]


def turned(profile, sides=48):
    """A closed body of revolution as an STL text: its profile is of heights and radii, m."""
    turn = np.linspace(0, 2 * np.pi, sides + 1)
    circle = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    heights = [profile[0][0], *(height for height, _ in profile), profile[-1][0]]
    radii = [0.0, *(radius for _, radius in profile), 0.0]
    rings = [np.column_stack([radius * circle, np.full(sides + 1, height)]) for height, radius in zip(heights, radii)]
    lines = ["solid body"]
    for number, (low, high) in enumerate(zip(rings, rings[1:])):
        for k in range(sides):
            # The first and the last ring are points.
            facets = [] if number == 0 else [[low[k], low[k + 1], high[k + 1]]]
            facets += [] if number == len(rings) - 2 else [[low[k], high[k + 1], high[k]]]
            for facet in facets:
                corners = "".join(f"vertex {x:.9g} {y:.9g} {z:.9g}\n" for x, y, z in facet)
                lines.append(f"facet normal 0 0 0\nouter loop\n{corners}endloop\nendfacet")
    return "\n".join([*lines, "endsolid body"])


def test_robots_that_cannot_be_are_refused(tmp_path):
    spec = mujoco.MjSpec.from_string(ARM)
    text = describe(spec.copy().compile())
    bare = tmp_path / "bare.toml"
    bare.write_text('name = "x"\n' + SKIN.format("upper").replace("link", "#"))
    with pytest.raises(dermis.DermisError, match="no description") as caught:
        wear(spec, bare)
    assert "describe" in caught.value.hint
    path = written(tmp_path, SKIN.format("upper") + SKIN.format("lower"), text)
    model = spec.copy().compile()
    with pytest.raises(dermis.DermisError, match="no geom 'upper'"):
        SimulatedRobot(path, model)
    elsewhere = mujoco.MjSpec.from_string(ARM.replace('"lower"', '"other"'))
    with pytest.raises(dermis.DermisError, match="no body 'lower'") as caught:
        wear(elsewhere, path)
    assert "other" in caught.value.hint
    wear(spec, path)
    model = spec.compile()
    with pytest.raises(dermis.DermisError, match="negative"):
        SimulatedRobot(path, model, delay_s=-0.01)
    path = written(tmp_path, SKIN.format("upper") + SKIN.format("lower"), text.replace('"elbow"', '"knee"'))
    with pytest.raises(dermis.DermisError, match="lacks a joint between 'world' and 'lower'") as caught:
        SimulatedRobot(path, model, method="noser")
    assert "knee" in caught.value.hint
    moved = text.replace('<axis xyz="1.0 0.0 0.0"/>', '<axis xyz="-1.0 0.0 0.0"/>', 1)
    path = written(tmp_path, SKIN.format("upper") + SKIN.format("lower"), moved)
    with pytest.raises(dermis.DermisError, match="'lower' .* from where the description has it"):
        SimulatedRobot(path, model, method="noser")
