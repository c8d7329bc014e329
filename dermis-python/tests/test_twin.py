"""Twins, experiments, calibrations: against the program, and against the truth."""

import pickle

import numpy as np
import pytest

import dermis


DISK = """
[body.disk]
diameter_m = 0.1
[sheet]
sheet_resistance_ohm = 1000
touch = "conductance_rises"
[electrodes]
shape.arc.length_m = 0.005
contact_impedance_ohm_m = 0.01
layout.rim.count = 8
[protocol]
pattern = "adjacent_undriven"
[image.grid]
rows = 8
columns = 8
[mesh]
max_edge_m = 0.01
electrode_edge_m = 0.0025
"""


@pytest.fixture(scope="module")
def skin():
    return dermis.Skin.load("skin16")


@pytest.fixture(scope="module")
def twin(skin):
    return skin.twin("lab", seed=3)


def places(skin, count, seed=1):
    """Positions on the skin, away from its edge."""
    pixels = skin.pixels
    centre, half = pixels.mean(axis=0), np.ptp(pixels, axis=0) / 2
    inside = pixels[(np.abs(pixels - centre) <= 0.8 * half + 1e-9).all(axis=1)]
    return np.random.default_rng(seed).choice(inside, count, replace=False)


def test_frames_depend_on_the_seed_and_their_number_only(skin, twin):
    position = places(skin, 3)
    frames = twin.press(position, force_n=[1, 2, 3], first=100)
    assert frames.shape == (3, len(skin.channels))
    again = skin.twin("lab", seed=3)
    assert np.array_equal(again.press(position[1], force_n=2, first=101)[0], frames[1])
    assert not np.array_equal(skin.twin("lab", seed=4).press(position, first=100), frames)
    assert np.array_equal(twin.untouched(5)[3:], twin.untouched(2, first=3))


def test_presses_of_one_frame_act_together(skin, twin):
    first, second = places(skin, 2)
    frames = twin.press([first, second, first], frame=[0, 0, 2])
    rest = twin.untouched(3, first=100)
    assert frames.shape == rest.shape
    # The middle frame has no press.
    assert np.array_equal(frames[1], rest[1])
    apart = twin.press([first, first, second], frame=[0, 2, 2])
    assert not np.array_equal(apart[0], frames[0])


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"positions": [[9.0, 0, 0]]}, "skin"),
        ({"positions": [[0.0, 0, 0]], "force_n": -1}, "force"),
        ({"positions": [[0.0, 0, 0]], "force_n": [1, 2]}, "`force_n` has the shape (2,)"),
        ({"positions": [[0.0, 0, 0]], "frame": [0.5]}, "`frame` has 0.5"),
        ({"positions": [0.0, 0]}, "`positions` has the shape (2,)"),
    ],
)
def test_presses_that_cannot_be_are_refused(twin, arguments, words):
    with pytest.raises(dermis.DermisError) as error:
        twin.press(**arguments)
    assert words in str(error.value)


def test_an_experiment_has_the_bytes_of_the_program(tmp_path):
    design = tmp_path / "disk.toml"
    design.write_text(DISK)
    skin = dermis.Skin.load(design)
    experiment = skin.experiment("lab", seed=5)
    dermis.command("experiment", design, twin="lab", seed=5, output=tmp_path / "experiment")
    for name, arrays in experiment.items():
        folder = tmp_path / "experiment" / name
        assert np.array_equal(np.load(folder / "frames.npy"), arrays["frames"])
        assert np.array_equal(np.load(folder / "baseline.npy"), arrays["baseline"])
        truth = np.genfromtxt(folder / "truth.csv", delimiter=",", names=True)
        assert np.allclose(truth["x_m"], arrays["truth"].position_m[:, 0], atol=1e-9)
    grid = experiment["grid"]
    score = skin.method("noser").score(grid["frames"], grid["truth"], grid["baseline"])
    folder = tmp_path / "experiment" / "grid"
    files = {"frames": folder / "frames.npy", "baseline": folder / "baseline.npy", "truth": folder / "truth.csv"}
    of_program = dermis.command("evaluate", design, method="noser", **files)
    assert score.keys() == of_program.keys()
    # The program reads positions with the digits of the table.
    assert score["misses"] == of_program["misses"]
    assert score["localisation_m"]["mean"] == pytest.approx(of_program["localisation_m"]["mean"], abs=1e-7)


def test_a_calibration_locates_presses_that_it_has_not_seen(skin, twin, tmp_path):
    positions = places(skin, 120)
    rng = np.random.default_rng(2)
    forces = rng.uniform(1, 4, len(positions))
    untouched = twin.untouched(100)
    frames = twin.press(positions, force_n=forces, first=100)
    calibration = skin.calibrate(
        frames, positions[:80], untouched, force_n=forces[:80], rows=np.arange(80), method="forward-map", force=True
    )
    assert calibration.name == "forward-map"
    located = calibration.locate(frames, untouched)
    errors = np.linalg.norm(located["position_m"] - positions, axis=1)[80:]
    # The twin's own noise and foam: a plain forward map reaches about a millimetre.
    assert errors.mean() < 0.004
    assert located["covariance_m2"].shape == (120, 3, 3)
    assert np.median(np.abs(located["force_n"][80:] / forces[80:] - 1)) < 0.3

    calibration.save(tmp_path / "calibration")
    read = skin.calibration(tmp_path / "calibration")
    again = read.locate(frames, untouched)
    assert all(np.array_equal(again[name], located[name], equal_nan=True) for name in located)
    contacts = skin.method(tmp_path / "calibration").contacts(frames, untouched)
    assert np.array_equal(calibration.method().contacts(frames, untouched).position_m, contacts.position_m)
    with pytest.raises(dermis.DermisError, match="cannot be pickled"):
        pickle.dumps(calibration.method())


def test_presses_that_cannot_be_fitted_are_refused(skin, twin):
    positions = places(skin, 5)
    frames = twin.press(positions)
    with pytest.raises(dermis.DermisError, match="at least 8"):
        skin.calibrate(frames, positions, twin.untouched(8))
    with pytest.raises(dermis.DermisError, match=r"`rows` has the shape \(2,\)"):
        skin.calibrate(frames, positions, twin.untouched(8), rows=[0, 1])
    with pytest.raises(dermis.DermisError, match="holds no calibration"):
        skin.calibration("no-such-folder")


def test_skins_and_methods_are_pickled(skin):
    copy = pickle.loads(pickle.dumps(skin))
    assert copy.name == skin.name
    assert np.array_equal(copy.forward(), skin.forward())
    method = skin.method("noser", alpha=0.5)
    assert pickle.loads(pickle.dumps(method)).alpha == method.alpha
