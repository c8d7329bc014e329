"""Skins: designs, forward model, Jacobian."""

import timeit

import numpy as np
import pytest

import dermis


@pytest.fixture(scope="module")
def skin():
    return dermis.Skin.load("cylinder30")


def test_arrays_have_the_documented_shapes(skin):
    channels, cells = len(skin.channels), len(skin.rest_conductivity)
    assert skin.name == "cylinder30" and skin.electrodes.shape == (30, 3) and skin.channels.shape == (870, 4)
    assert skin.mesh.cells.shape == (cells, 3) and skin.mesh.measures.shape == (cells,)
    assert skin.mesh.nodes.shape[1] == 3 and skin.mesh.cells.max() == len(skin.mesh.nodes) - 1
    assert np.isclose(skin.mesh.measures.sum(), np.pi * 0.1 * 0.3, rtol=0.01)
    assert skin.forward().shape == (channels,)
    assert skin.forward([skin.rest_conductivity] * 3).shape == (3, channels)
    assert skin.jacobian().shape == (channels, len(skin.pixels))


def test_a_design_takes_arrays():
    design = {
        "body": {"disk": {"diameter_m": 0.1}},
        "sheet": {"sheet_resistance_ohm": 1000.0, "touch": "conductance_rises"},
        "electrodes": {"shape": "point", "layout": {"positions": [{"theta_rad": theta} for theta in np.arange(8) * np.pi / 4]}},
        "protocol": {"first_electrode": 1, "pattern": {"channels": np.array([[1, 2, 4, 5], [8, 1, 3, 6]])}},
        "mesh": {"max_edge_m": 0.02, "electrode_edge_m": np.float64(0.01)},
    }
    np.testing.assert_array_equal(dermis.Skin.load(design).channels, [[0, 1, 3, 4], [7, 0, 2, 5]])
    design["protocol"]["first_electrode"] = 0
    with pytest.raises(dermis.DermisError, match="channel 1 of `channels`, its row 2, names electrode 8.*first_electrode = 1"):
        dermis.Skin.load(design)


def test_array_likes_are_converted(skin):
    rest = skin.rest_conductivity
    expected = skin.forward(rest)
    strided = np.repeat(rest, 2)[::2]
    for conductivity in [rest.tolist(), strided, np.asfortranarray(np.stack([rest, rest]))[0], memoryview(rest)]:
        np.testing.assert_array_equal(skin.forward(conductivity), expected)
    readonly = rest.copy()
    readonly.setflags(write=False)
    np.testing.assert_array_equal(skin.forward(readonly), expected)
    np.testing.assert_allclose(skin.forward(rest.astype(np.float32)), expected, rtol=1e-5)


def test_the_jacobian_is_the_derivative(skin):
    rest, cell = skin.rest_conductivity, 100
    step = np.zeros_like(rest)
    step[cell] = 1e-4 * rest[cell]
    difference = (skin.forward(rest + step) - skin.forward(rest - step)) / (2 * step[cell])
    derivative = skin.jacobian(per="cell")[:, cell]
    assert np.abs(difference - derivative).max() < 1e-5 * np.abs(derivative).max()


def test_the_jacobian_is_held_not_copied(skin):
    assert skin.jacobian() is skin.jacobian()
    assert not skin.jacobian().flags.writeable
    writable = skin.jacobian(skin.rest_conductivity)
    assert np.from_dlpack(writable).ctypes.data == writable.ctypes.data


def test_a_design_is_a_name_a_path_or_a_dict(tmp_path):
    tomllib = pytest.importorskip("tomllib")
    text = dermis.Skin.load("skin16").design
    (tmp_path / "my skin.toml").write_text(text)
    skins = [dermis.Skin.load("skin16"), dermis.Skin.load(tmp_path / "my skin.toml"), dermis.Skin.load(tomllib.loads(text))]
    for skin in skins[1:]:
        np.testing.assert_array_equal(skin.forward(), skins[0].forward())
    assert "cylinder30" in dermis.Skin.shipped()


def test_errors_name_the_place_and_the_fix(tmp_path):
    path = tmp_path / "bad.toml"
    path.write_text("nam" + dermis.Skin.load("skin16").design.partition("name")[2])
    with pytest.raises(dermis.DermisError, match="`nam`") as caught:
        dermis.Skin.load(path)
    assert caught.value.line == 1 and caught.value.field == "nam" and isinstance(caught.value, ValueError)
    with pytest.raises(dermis.DermisError, match="no-such-skin"):
        dermis.Skin.load("no-such-skin")


@pytest.mark.parametrize(
    "conductivity, said",
    [
        ([1.0, 2.0], r"`conductivity` has the shape \(2,\)"),
        (np.ones((2, 2, 2)), r"\(2, 2, 2\)"),
        (3.0, r"\(\)"),
        ("text", "no array of real numbers"),
        ([[1.0], [1.0, 2.0]], "no array of real numbers"),
        (np.ones(3) * 1j, "no array of real numbers"),
        ({"a": 1}, "no array of real numbers"),
    ],
)
def test_wrong_arrays_are_refused_by_name(skin, conductivity, said):
    with pytest.raises(dermis.DermisError, match=said):
        skin.forward(conductivity)


@pytest.mark.parametrize("value", [np.nan, np.inf, 0.0, -1.0])
def test_conductivities_are_positive(skin, value):
    conductivity = skin.rest_conductivity
    conductivity[7] = value
    with pytest.raises(dermis.DermisError, match="cell 7"):
        skin.forward(conductivity)


def test_the_jacobian_is_shared_without_a_copy():
    skin = dermis.Skin.load("skin16")
    jacobian = skin.jacobian()
    assert skin.jacobian() is jacobian and not jacobian.flags.writeable
    best_s = min(timeit.repeat(skin.jacobian, number=1000, repeat=5)) / 1000
    assert best_s < 1e-6, f"{1e6 * best_s:.2f} us"
    if np.lib.NumpyVersion(np.__version__) >= "2.1.0":
        # Older versions share no read-only arrays.
        assert np.shares_memory(np.from_dlpack(jacobian), jacobian)


def test_pictures_are_svg():
    skin = dermis.Skin.load("skin16")
    assert skin.svg("electrodes").startswith("<svg") and skin._repr_html_() == skin.svg("electrodes")
    untouched = skin.forward()
    frame = skin.forward(skin.touched_conductivity(skin.pixels[400]))
    assert "detected contact" in skin.method("noser").svg(frame, untouched)
    with pytest.raises(dermis.DermisError, match="`what` is"):
        skin.svg("nothing")


def test_gradients_are_the_transposed_jacobian_times_the_derivative(skin):
    conductivity = skin.rest_conductivity * np.random.default_rng(1).uniform(0.8, 1.2, (3, len(skin.rest_conductivity)))
    solution = skin.solve(conductivity)
    assert np.array_equal(solution.frames, skin.forward(conductivity))
    weights = np.random.default_rng(2).normal(size=solution.frames.shape)
    gradient = solution.gradient(weights)["conductivity"]
    expected = np.stack([skin.jacobian(one, per="cell").T @ by for one, by in zip(conductivity, weights)])
    assert np.abs(gradient - expected).max() < 1e-9 * np.abs(expected).max()
    other = skin.solve(conductivity, contact_impedance=2 * skin.contact_impedance)
    assert other.gradient(weights, parameters=True)["nodes"].shape == skin.mesh.nodes.shape
    with pytest.raises(dermis.DermisError, match="`by_frame` has 1 rows"):
        solution.gradient(weights[0])
