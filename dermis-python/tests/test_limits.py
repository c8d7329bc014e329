"""Arguments that no memory holds, values that are not finite, rows that do not exist: errors, never a panic or an abort."""

import os
from pathlib import Path

import numpy as np
import pytest

import dermis


@pytest.fixture(scope="module")
def skin():
    return dermis.Skin.load("skin16")


@pytest.fixture(scope="module")
def presses(skin):
    inside = skin.pixels[np.linalg.norm(skin.pixels - skin.pixels.mean(axis=0), axis=1) < 0.02]
    positions = inside[np.random.default_rng(1).choice(len(inside), 24, replace=False)]
    twin = skin.twin("lab", seed=1)
    untouched = twin.untouched(50)
    return positions, twin.press(positions) - untouched.mean(axis=0)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda twin, position: twin.untouched(10**12), "`count` asks for 1000000000000 rows"),
        (lambda twin, position: twin.untouched(2**62), "`count` asks for"),
        (lambda twin, position: twin.untouched(2, first=2**64 - 1), "`first` is 18446744073709551615"),
        (lambda twin, position: twin.press([position], frame=[9_999_999]), "`frame` asks for 10000000 rows"),
    ],
)
def test_results_that_no_memory_holds_are_refused(skin, call, words):
    with pytest.raises(dermis.DermisError) as error:
        call(skin.twin("lab", seed=1), skin.pixels[400])
    assert words in str(error.value)


def test_too_many_samples_are_refused(skin):
    recipe = {"skins": "even", "touch": {"gaussian": {"most": 1, "width_m": [0.004, 0.012], "amplitude": [0.1, 0.3]}}}
    samples = skin.samples(recipe, seed=1)
    with pytest.raises(dermis.DermisError, match="`count` asks for 4294967295 rows"):
        samples.batch(0, 2**32 - 1)
    with pytest.raises(dermis.DermisError, match="`first` is"):
        samples.batch(2**63, 1)
    assert len(samples.batch(2**40, 3)["index"]) == 3


def test_labels_of_frames_that_do_not_exist_are_refused(skin, presses):
    positions, differences = presses
    for method in ("noser", "forward-map", None):
        with pytest.raises(dermis.DermisError, match="a label names frame"):
            skin.calibrate(differences[:10], positions, method=method)
        bad = positions.copy()
        bad[3, 0] = np.nan
        with pytest.raises(dermis.DermisError, match="must be finite"):
            skin.calibrate(differences, bad, method=method)


def test_masked_values_are_refused(skin):
    frames = np.ma.masked_invalid(np.tile(skin.forward(), (3, 1)))
    assert len(skin.method("noser").contacts(frames, skin.forward())) == 0
    frames[1, 4] = np.ma.masked
    with pytest.raises(dermis.DermisError, match="`frames` has masked values"):
        skin.method("noser").contacts(frames, skin.forward())


def test_useless_calibrations_are_refused(skin, presses):
    positions, differences = presses
    with pytest.raises(dermis.DermisError, match="without a calibration|same place|random order"):
        skin.calibrate(differences, positions[::-1].copy(), method="forward-map")
    with pytest.warns(UserWarning, match="check that the labels belong to the frames"):
        skin.calibrate(differences, positions[::-1].copy(), method="forward-map", force=True)


def test_frames_with_values_that_are_not_finite_are_refused(skin, presses):
    positions, differences = presses
    calibration = skin.calibrate(differences, positions, method="forward-map")
    for value in (np.nan, np.inf):
        frames = differences.copy()
        frames[2, 5] = value
        with pytest.raises(dermis.DermisError, match="frame 2, channel 5"):
            calibration.locate(frames)
        with pytest.raises(dermis.DermisError):
            calibration.method().contacts(frames)


def test_nodes_that_no_mesh_has_are_refused(skin):
    nodes = skin.mesh.nodes
    nodes[7, 1] = np.nan
    with pytest.raises(dermis.DermisError, match="node 7 is not finite"):
        skin.solve(skin.rest_conductivity, nodes=nodes)
    nodes = skin.mesh.nodes
    nodes[skin.mesh.cells[11, 0]] = nodes[skin.mesh.cells[11, 1]]
    with pytest.raises(dermis.DermisError, match="has no extent"):
        skin.solve(skin.rest_conductivity, nodes=nodes)
    with pytest.raises(dermis.DermisError, match="nodes: 3 values"):
        skin.solve(skin.rest_conductivity, nodes=nodes[:3])


def test_a_score_needs_a_touch_for_each_frame(skin, presses):
    positions, differences = presses
    with pytest.raises(dermis.DermisError, match="`truth` has 5 positions for 24 frames"):
        skin.method("noser").score(differences, positions[:5])
    assert skin.method("noser").score(differences, positions)["presses"] == 24


def test_arrays_need_no_alignment(skin):
    packed = np.zeros(1, dtype=[("flag", "?"), ("position", "f8", 3)])
    packed["position"] = skin.pixels[400]
    touched = skin.touched_conductivity(packed["position"][0])
    assert np.array_equal(touched, skin.touched_conductivity(skin.pixels[400]))


def test_a_folder_is_a_method_as_a_path(skin, presses, tmp_path, monkeypatch):
    positions, differences = presses
    monkeypatch.chdir(tmp_path)
    folder = Path("my-calibration")
    skin.calibrate(differences, positions, method="forward-map").save(folder)
    assert skin.method(folder).name == os.path.abspath(folder)
    assert dermis.Pipeline(skin, folder)


def test_a_live_skin_that_cannot_start_leaves_no_thread(skin):
    before = len(os.listdir("/proc/self/task")) if os.path.isdir("/proc/self/task") else None
    for _ in range(5):
        with pytest.raises(dermis.DermisError, match="threshold"):
            dermis.Live(skin, method="noser", threshold=0)
    if before is not None:
        assert len(os.listdir("/proc/self/task")) <= before + 3
