"""MuJoCo: contacts of a simulator on the twin of a skin. Skipped where MuJoCo is missing."""

import doctest
import importlib.util
from pathlib import Path

import numpy as np
import pytest

import dermis

mujoco = pytest.importorskip("mujoco")
import dermis.mujoco  # noqa: E402
from dermis.mujoco import SimulatedSkin, WornSkin  # noqa: E402

EXAMPLE = Path(__file__).parents[3] / "examples" / "mujoco_arm.py"
# A cylinder that is turned and moved, and a box that lies on it with a face.
SCENE = """
<mujoco>
  <worldbody>
    <body pos="0.1 0.2 0.5" euler="90 0 0">
      <geom name="link" type="cylinder" size="0.05 0.15"/>
    </body>
    <body pos="0.1 0.25 0.558"><freejoint/><geom name="box" type="box" size="0.008 0.008 0.008" mass="0.3"/></body>
  </worldbody>
</mujoco>
"""


@pytest.fixture(scope="module")
def skin():
    return dermis.Skin.load("cylinder30")


def settled(steps=400):
    model = mujoco.MjModel.from_xml_string(SCENE)
    data = mujoco.MjData(model)
    # Held above the line where it would roll off.
    model.dof_damping[3:] = 10.0
    for _ in range(steps):
        mujoco.mj_step(model, data)
    return model, data


def test_the_example_of_the_module_runs():
    result = doctest.testmod(dermis.mujoco)
    assert result.attempted and not result.failed


def test_points_of_a_flat_contact_are_one_press_with_the_weight_of_the_box(skin):
    model, data = settled()
    worn = WornSkin(skin, model, "link")
    assert data.ncon > 1
    touches = worn.touches(data)
    assert touches.positions_m.shape == (1, 3)
    # The contact is inclined nowhere: the normal force carries the weight.
    assert touches.forces_n[0] == pytest.approx(0.3 * 9.81, rel=0.1)
    (position,) = touches.positions_m
    assert np.hypot(*position[:2]) == pytest.approx(0.05, abs=2e-4)
    # The skin's frame begins at the lower end of the cylinder.
    assert 0 < position[2] < 0.3
    assert worn.to_world(data, position) == pytest.approx([0.1, 0.25, 0.55], abs=2e-3)
    assert worn.to_skin(data, worn.to_world(data, position)) == pytest.approx(position, abs=1e-12)
    # The force points into the skin.
    assert touches.normals[0] @ [position[0], position[1], 0.0] < 0


def test_penetrating_points_are_moved_to_the_surface(skin):
    model, data = settled(1)
    worn = WornSkin(skin, model, "link")
    for point in ([0.045, 0.0, 0.1], [0.03, 0.03, 0.2], [0.0, -0.06, 0.29]):
        nearest = worn.nearest(np.array(point))
        assert np.hypot(*nearest[:2]) == pytest.approx(0.05, abs=2e-4)
        angle = np.arctan2(point[1], point[0])
        expected = [0.05 * np.cos(angle), 0.05 * np.sin(angle), point[2]]
        assert nearest == pytest.approx(expected, abs=2e-3)


def test_on_a_mesh_the_skin_is_in_the_frame_of_its_file(skin):
    # A tetrahedron whose middle and principal axes are not those of the file.
    model = mujoco.MjModel.from_xml_string("""
    <mujoco><asset><mesh name="m" vertex="0 0 0  0.1 0 0  0 0.2 0  0.02 0.05 0.3"/></asset>
    <worldbody><body pos="0.5 -0.2 0.1" euler="30 40 50"><geom name="link" type="mesh" mesh="m"/></body></worldbody></mujoco>""")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    axes = data.xmat[1].reshape(3, 3)
    worn = WornSkin(skin, model, "link")
    for point in ([0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.02, 0.05, 0.3]):
        assert worn.to_world(data, point) == pytest.approx(data.xpos[1] + axes @ point, abs=1e-9)
    moved = WornSkin(skin, model, "link", position=[0.01, 0.02, 0.03], rotation=[[0, -1, 0], [1, 0, 0], [0, 0, 1]])
    assert moved.to_world(data, [0.1, 0.0, 0.0]) == pytest.approx(data.xpos[1] + axes @ [0.01, 0.12, 0.03], abs=1e-9)


def test_the_arm_finds_presses():
    spec = importlib.util.spec_from_file_location("mujoco_arm", EXAMPLE)
    example = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(example)
    share, mean_m = example.run(20, "noser")
    assert share >= 0.95
    assert mean_m <= 0.0045


def test_models_that_cannot_be_are_refused(skin):
    model, _ = settled(1)
    with pytest.raises(dermis.DermisError, match="no geom 'arm'"):
        WornSkin(skin, model, "arm")
    with pytest.raises(dermis.DermisError, match="no geom 7"):
        WornSkin(skin, model, 7)
    with pytest.raises(dermis.DermisError, match="no rotation"):
        WornSkin(skin, model, "link", rotation=2 * np.eye(3))
    with pytest.raises(dermis.DermisError, match="no-such-method"):
        SimulatedSkin(skin, model, "link", method="no-such-method")


def on_a_geom(geom, sphere, skin, **pose):
    """The presses of a sphere that is pushed in x or z against a geom."""
    axis, place, force = sphere
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><option gravity="0 0 0"/><worldbody><geom name="link" {geom}/><body pos="{place}">'
        f'<joint type="slide" axis="{axis}"/><geom type="sphere" size="0.015" mass="0.05"/></body></worldbody></mujoco>'
    )
    data = mujoco.MjData(model)
    data.qfrc_applied[0] = force
    for _ in range(300):
        mujoco.mj_step(model, data)
    assert data.ncon == 1
    return WornSkin(skin, model, "link", **pose).touches(data).forces_n


def test_what_presses_the_rest_of_a_geom_is_no_press(skin):
    plate, flat = 'type="box" size="0.05 0.05 0.02"', dermis.Skin.load("skin16")
    worn = {"position": [0, 0, 0.02]}
    assert on_a_geom(plate, ("0 0 1", "0.01 0 0.034", -2.0), flat, **worn) == pytest.approx([2.0])
    assert not len(on_a_geom(plate, ("0 0 1", "0.01 0 -0.034", 2.0), flat, **worn)), "from below"
    rod = 'type="cylinder" size="0.05 0.5"'
    assert on_a_geom(rod, ("1 0 0", "0.064 0 0.14", -3.0), skin) == pytest.approx([3.0])
    assert not len(on_a_geom(rod, ("1 0 0", "0.064 0 0.16", -3.0), skin)), "beyond the end"


@pytest.mark.parametrize("pose", [{"rotation": np.diag([1.0, 1.0, -1.0])}, {"position": [np.nan, 0, 0]}, {"merge_m": -1.0}])
def test_poses_that_are_none_are_refused(skin, pose):
    with pytest.raises(dermis.DermisError, match=f"`{next(iter(pose))}` is"):
        WornSkin(skin, settled(1)[0], "link", **pose)
