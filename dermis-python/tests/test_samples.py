"""Training samples: files, and samples without files."""

import tomllib

import numpy as np
import pytest

import dermis

RECIPE = """
skins = "even"
[touch.gaussian]
most = 3
width_m = [0.004, 0.012]
amplitude = [0.1, 0.3]
"""


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    folder = tmp_path_factory.mktemp("dataset") / "set"
    recipe = folder.with_name("recipe.toml")
    recipe.write_text(RECIPE)
    dermis.command("simulate", "skin16", samples=300, seed=7, recipe=recipe, output=folder)
    dermis.command("simulate", finish=folder)
    return dermis.Dataset(folder)


def test_samples_are_those_of_the_files(dataset):
    assert len(dataset) == 300
    skin = dermis.Skin.load("skin16")
    samples = skin.samples(tomllib.loads(RECIPE), seed=7)
    indices = [0, 17, 299, 5]
    of_files = dataset.batch(indices)
    assert of_files["frame"].shape == (4, len(skin.channels))
    assert of_files["touches"].shape[1:] == (3, 6)
    for row, index in enumerate(indices):
        computed = samples.batch(index, 1)
        for name, values in of_files.items():
            assert np.array_equal(computed[name][0], values[row], equal_nan=True), name


def test_indices_that_do_not_exist_are_refused(dataset):
    with pytest.raises(dermis.DermisError, match="300"):
        dataset.batch([300])
    with pytest.raises(dermis.DermisError, match="-1"):
        dataset.batch([-1])
    with pytest.raises(dermis.DermisError):
        dermis.Dataset("no-such-folder")


def test_a_recipe_that_cannot_be_is_refused(tmp_path):
    skin = dermis.Skin.load("skin16")
    with pytest.raises(dermis.DermisError):
        skin.samples({"touch": "none"}, seed=1)
    with pytest.raises(dermis.DermisError, match="no-such-file"):
        skin.samples(tmp_path / "no-such-file.toml", seed=1)
