"""Training samples: files, and samples without files."""

import os
import signal
import threading
import time
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
    with pytest.raises(dermis.DermisError, match="truth values"):
        dataset.batch(np.arange(300) < 3)
    with pytest.raises(dermis.DermisError):
        dermis.Dataset("no-such-folder")


def test_a_recipe_that_cannot_be_is_refused(tmp_path):
    skin = dermis.Skin.load("skin16")
    with pytest.raises(dermis.DermisError):
        skin.samples({"touch": "none"}, seed=1)
    with pytest.raises(dermis.DermisError, match="no-such-file"):
        skin.samples(tmp_path / "no-such-file.toml", seed=1)


def of_folder(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir() if not path.name.startswith(".")}


def test_a_simulation_writes_the_files_of_the_program(dataset, tmp_path):
    simulation = dermis.Skin.load("skin16").simulation(tomllib.loads(RECIPE), seed=7, samples=300)
    folder = tmp_path / "set"
    assert simulation.begin(folder) == [0] and simulation.files == 1
    assert simulation.run(folder, (1, 2)) == 0
    assert simulation.run(folder, (0, 2), threads=1) == 300
    assert simulation.begin(folder) == [] and simulation.run(folder) == 0
    assert len(dermis.finish_dataset(folder)) == 300
    assert of_folder(folder) == of_folder(dataset.folder)


def test_a_simulation_refuses_what_it_cannot_write(dataset, tmp_path):
    skin = dermis.Skin.load("skin16")
    simulation = skin.simulation(tomllib.loads(RECIPE), seed=8, samples=300)
    with pytest.raises(dermis.DermisError, match="`recipe.seed` is 7, not 8"):
        simulation.run(dataset.folder)
    with pytest.raises(dermis.DermisError, match="shard 2 of 2"):
        simulation.run(tmp_path / "set", (2, 2))
    with pytest.raises(dermis.DermisError, match="`threads` is 0"):
        simulation.run(tmp_path / "set", threads=0)
    with pytest.raises(dermis.DermisError, match="the number of samples is 0"):
        skin.simulation(tomllib.loads(RECIPE), seed=1, samples=0)
    with pytest.raises(dermis.DermisError, match="room for"):
        skin.simulation(tomllib.loads(RECIPE), seed=1, samples=10**14).run(tmp_path / "large")
    assert not (tmp_path / "large").exists()


def test_files_of_another_process_are_refused_or_waited_for(tmp_path):
    fcntl = pytest.importorskip("fcntl")
    simulation = dermis.Skin.load("skin16").simulation(tomllib.loads(RECIPE), seed=7, samples=100)
    simulation.begin(tmp_path)
    lock = (tmp_path / ".lock-00000").open("w")
    fcntl.flock(lock, fcntl.LOCK_EX)
    with pytest.raises(dermis.DermisError, match="is being made by another process"):
        simulation.run(tmp_path)
    timer = threading.Timer(0.7, lock.close)
    timer.start()
    assert simulation.run(tmp_path, wait=True) == 100
    assert not timer.is_alive()


def test_an_interrupt_ends_a_simulation(interruptible, tmp_path):
    simulation = dermis.Skin.load("skin16").simulation(tomllib.loads(RECIPE), seed=7, samples=10**6)
    timer = threading.Timer(0.5, os.kill, [os.getpid(), signal.SIGINT])
    timer.start()
    begun = time.perf_counter()
    with pytest.raises(KeyboardInterrupt):
        simulation.run(tmp_path)
    assert time.perf_counter() - begun < 3.0
    assert not list(tmp_path.glob(".part-*"))
