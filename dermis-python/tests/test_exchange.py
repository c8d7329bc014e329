"""Meshes, images and pictures for other libraries. Each part is skipped where its library is missing."""

import doctest

import numpy as np
import pytest

import dermis


@pytest.fixture(scope="module")
def skin():
    return dermis.Skin.load("skin16")


def touched(skin, count=2):
    inside = skin.pixels[np.linalg.norm(skin.pixels - skin.pixels.mean(axis=0), axis=1) < 0.02][::50][:count]
    return inside, skin.forward([skin.touched_conductivity(position) for position in inside])


def test_a_mesh_survives_meshio(skin, tmp_path):
    meshio = pytest.importorskip("meshio")
    mesh = skin.mesh.to_meshio({"conductivity": skin.rest_conductivity})
    mesh.write(tmp_path / "mesh.vtu")
    read = meshio.read(tmp_path / "mesh.vtu")
    assert np.array_equal(read.points, skin.mesh.nodes)
    assert np.array_equal(read.cells_dict["triangle"], skin.mesh.cells)
    assert np.allclose(read.cell_data["conductivity"][0], skin.rest_conductivity)


def test_images_have_the_positions_of_their_pixels(skin):
    pytest.importorskip("xarray")
    positions, frames = touched(skin)
    images = skin.method("noser").to_xarray(frames, skin.forward())
    assert images.dims == ("frame", "row", "column") and images.sizes["frame"] == len(positions)
    for image, position in zip(images, positions):
        # The peak is at the coordinates of the touch.
        peak = image.where(image == image.max(), drop=True)
        found = np.array([float(peak[name].squeeze()) for name in ("x_m", "y_m")])
        assert np.linalg.norm(found - position[:2]) < 0.004


@pytest.mark.parametrize("design", ["skin16", "cylinder30", "tank16"])
def test_pictures_place_the_peak_where_the_contact_is(design):
    pytest.importorskip("matplotlib").use("Agg")
    from matplotlib import pyplot

    from dermis import plot

    skin = dermis.Skin.load(design)
    position = skin.pixels[np.linalg.norm(skin.pixels - skin.pixels.mean(axis=0) - [0.004, 0.006, 0], axis=1).argmin()]
    untouched = skin.forward()
    frame = skin.forward(skin.touched_conductivity(position))
    image = skin.method("noser").images(frame, untouched)
    axes = plot.image(skin, image)
    mesh = axes.collections[0]
    values = np.ma.filled(mesh.get_array().astype(float), -np.inf)
    row, column = np.unravel_index(values.argmax(), values.shape)
    drawn = mesh.get_coordinates()[row : row + 2, column : column + 2].mean(axis=(0, 1))
    assert np.linalg.norm(drawn - plot.flat(skin, position)[0]) < 12
    plot.positions(skin, [position], axes)
    plot.cells(skin, skin.touched_conductivity(position) / skin.rest_conductivity - 1, diverging=True)
    pyplot.close("all")


def test_the_example_of_the_module_runs():
    pytest.importorskip("matplotlib")
    import dermis.plot

    result = doctest.testmod(dermis.plot)
    assert result.attempted and not result.failed


def test_the_names_of_the_columns_of_a_table_decide(skin):
    pandas = pytest.importorskip("pandas")
    _, frames = touched(skin)
    rest = skin.forward()
    names = ["v_" + "_".join(str(electrode) for electrode in channel) for channel in skin.channels]
    method = skin.method("noser")
    expected = method.images(frames, rest)
    for named in (names, [f"ch{number}" for number in range(len(names))], [str(number) for number in range(len(names))]):
        table = pandas.DataFrame(frames, columns=named)
        for columns in (named, sorted(named), named[::-1]):
            assert np.array_equal(method.images(table[columns], rest), expected, equal_nan=True), columns[:3]
    with pytest.raises(dermis.DermisError, match="the names do not say which channels they are"):
        method.contacts(pandas.DataFrame(frames, columns=[f"a{number}_7" for number in range(len(names))][::-1]), rest)
