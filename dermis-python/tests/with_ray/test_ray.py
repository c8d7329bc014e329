"""Datasets, benchmarks and sweeps by Ray: nodes and drivers that are killed, nodes without the package. Skipped without Ray.

DERMIS_SLOW=1 adds 65,536 samples on four nodes of which two are killed, as is the driver, for each of DERMIS_SEEDS (5) seeds.
"""

import hashlib
import json
import os
import random
import subprocess
import sys
import threading
import time
import tomllib

import pytest

import dermis

ray = pytest.importorskip("ray")
import dermis.ray  # noqa: E402
from ray.cluster_utils import Cluster  # noqa: E402

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
max_edge_m = 0.02
electrode_edge_m = 0.0025
"""
RECIPE = {"skins": "even", "touch": {"gaussian": {"most": 2, "width_m": [0.004, 0.012], "amplitude": [0.1, 0.3]}}}
TOML = """
skins = "even"
[touch.gaussian]
most = 2
width_m = [0.004, 0.012]
amplitude = [0.1, %s]
"""
# The call of a driver that can be killed.
DRIVER = """
import json, sys
import dermis.ray
design, output, recipe, samples = json.loads(sys.argv[1])
dermis.ray.simulate(design, output, recipe=recipe, seed=1, samples=samples)
"""


def sums(folder):
    """The SHA-256 of every file but locks."""
    files = [path for path in folder.iterdir() if not path.name.startswith(".")]
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


def of_one_process(design, folder, samples):
    dermis.Skin.load(design).simulation(RECIPE, seed=1, samples=samples).run(folder)
    dermis.finish_dataset(folder)
    return sums(folder)


def files_of(folder):
    return len(list(folder.glob("samples-*"))) if folder.exists() else 0


@pytest.fixture
def cluster(monkeypatch):
    """A cluster whose first node runs no tasks."""
    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 0, "include_dashboard": False})
    monkeypatch.setenv("RAY_ADDRESS", cluster.address)
    yield cluster
    ray.shutdown()
    cluster.shutdown()


@pytest.fixture
def this_machine(monkeypatch):
    monkeypatch.delenv("RAY_ADDRESS", raising=False)
    yield
    ray.shutdown()


def test_the_files_are_those_of_one_process_when_a_node_is_killed(cluster, tmp_path):
    design, samples = tomllib.loads(DISK), 8 * 8192
    expected = of_one_process(design, tmp_path / "one", samples)
    nodes = [cluster.add_node(num_cpus=1) for _ in range(3)]
    folder, killed_at = tmp_path / "many", []

    def kill():
        while not files_of(folder):
            time.sleep(0.01)
        cluster.remove_node(nodes[0], allow_graceful=False)
        killed_at.append(files_of(folder))

    thread = threading.Thread(target=kill)
    thread.start()
    assert len(dermis.ray.simulate(design, folder, recipe=RECIPE, seed=1, samples=samples)) == samples
    thread.join()
    assert killed_at[0] < 8, "the node was killed too late"
    assert sums(folder) == expected
    # Nothing is left to do.
    assert len(dermis.ray.simulate(design, folder, recipe=RECIPE, seed=1, samples=samples)) == samples


@pytest.mark.parametrize(
    ("module", "words"),
    [
        ('__version__ = "0.0.9"', "has version 0.0.9 of dermis; this process has version"),
        ('raise ImportError("no module")', "cannot import dermis: no module; this process has version"),
    ],
)
def test_a_node_with_another_package_is_named(cluster, tmp_path, module, words):
    package = tmp_path / "other" / "dermis"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text(module)
    node = cluster.add_node(num_cpus=1, env_vars={"PYTHONPATH": str(package.parent)})
    with pytest.raises(dermis.DermisError, match=words) as error:
        dermis.ray.simulate(tomllib.loads(DISK), tmp_path / "set", recipe=RECIPE, seed=1, samples=100)
    assert f"node {node.node_ip_address}" in str(error.value) and dermis.__version__ in str(error.value)
    assert "install" in error.value.hint


def test_a_cluster_that_does_not_answer_is_named(tmp_path, monkeypatch):
    monkeypatch.setenv("RAY_ADDRESS", "127.0.0.1:9")
    with pytest.raises(dermis.DermisError, match="no Ray cluster answers at RAY_ADDRESS=127.0.0.1:9"):
        dermis.ray.simulate(tomllib.loads(DISK), tmp_path / "set", recipe=RECIPE, seed=1, samples=100)


def test_bad_input_is_refused_before_tasks_run(this_machine, tmp_path):
    simulate = lambda **given: dermis.ray.simulate(
        tomllib.loads(DISK), tmp_path / "set", **{"recipe": RECIPE, "seed": 1, "samples": 100, **given}
    )
    for given, words in [
        ({"samples": 0}, "the number of samples is 0"),
        ({"recipe": {"touch": "none"}}, "recipe"),
        ({"recipe": "no-such-file.toml"}, "no-such-file.toml"),
        ({"threads": 0}, "`threads` is 0"),
        ({"threads": 10**6}, "`threads` is 1000000, but Ray has nodes with"),
    ]:
        with pytest.raises(dermis.DermisError, match=words):
            simulate(**given)
    assert len(simulate()) == 100
    with pytest.raises(dermis.DermisError, match="`recipe.seed` is 1, not 2"):
        simulate(seed=2)
    with pytest.raises(dermis.DermisError, match="`methods` is empty"):
        dermis.ray.benchmark("skin16", [])
    with pytest.raises(dermis.DermisError, match="`twins` is 0"):
        dermis.ray.benchmark("skin16", "noser", twins=0)
    with pytest.raises(dermis.DermisError, match=r"node .*: there is no method `nothing`"):
        dermis.ray.benchmark("skin16", "nothing", twins=1)


def test_a_node_that_does_not_see_the_folder_is_an_error(tmp_path):
    with pytest.raises(dermis.DermisError, match="is not there or empty") as error:
        dermis.ray._simulate_file(b"", "", 1, 100, str(tmp_path / "elsewhere"), 0, 1)
    assert error.value.hint == "give a folder that all nodes share"
    assert not (tmp_path / "elsewhere").exists()


def test_a_full_folder_is_the_engine_s_error(this_machine, tmp_path):
    with pytest.raises(dermis.DermisError, match="has room for"):
        dermis.ray.simulate(tomllib.loads(DISK), tmp_path / "set", recipe=RECIPE, seed=1, samples=10**14)


def test_a_benchmark_equals_that_of_one_process(this_machine, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "disk.toml").write_text(DISK)
    results = dermis.ray.benchmark("disk.toml", ["noser", "tikhonov"], twins=2, quick=True)
    assert list(results) == ["noser", "tikhonov"]
    assert results["noser"] == dermis.command("benchmark", "disk.toml", method="noser", twins=2, quick=True)
    rows = dermis.ray.table(results)
    assert [(row["method"], row["seed"]) for row in rows] == [
        (method, seed) for method in results for seed in (1001, 1002)
    ]
    assert rows[1]["random.localisation_m.mean"] == results["noser"]["twins"][1]["random"]["localisation_m"]["mean"]


def test_a_sweep_exports_the_best_model_and_continues(this_machine, tmp_path, monkeypatch):
    from ray import tune

    monkeypatch.chdir(tmp_path)
    (tmp_path / "disk.toml").write_text(DISK)
    for amplitude in (0.2, 0.3):
        (tmp_path / f"{amplitude}.toml").write_text(TOML % amplitude)
    space = {"stream": tune.grid_search(["0.2.toml", "0.3.toml"]), "epochs": 1, "epoch_samples": 720, "seed": 1}
    sweep = lambda space: dermis.ray.sweep("disk.toml", "sweep", space)
    result = sweep(space)
    assert {trial["options"]["stream"] for trial in result.trials} == {"0.2.toml", "0.3.toml"}
    scores = [trial["score"] for trial in result.trials]
    assert scores == sorted(scores) and all(trial["error"] is None for trial in result.trials)
    best = result.trials[0]
    alone = dermis.command("train", "disk.toml", output="alone", **best["options"])
    assert best["score"] == min(epoch["test_loss"] for epoch in alone["epochs"])
    assert (result.best / "weights.safetensors").read_bytes() == (tmp_path / "alone/weights.safetensors").read_bytes()
    skin = dermis.Skin.load("disk.toml")
    assert skin.method(result.best).images(skin.forward() * 0).shape == (8, 8)
    ray.shutdown()
    assert sweep(space) == result
    with pytest.raises(dermis.DermisError, match="holds another sweep: its `space`"):
        sweep({**space, "epochs": 2})
    with pytest.raises(dermis.DermisError, match="train has no option 'colour'"):
        sweep({"colour": 1})
    with pytest.raises(dermis.DermisError, match="none of 1 trainings has succeeded: .*missing.toml"):
        dermis.ray.sweep("disk.toml", "other", {"stream": "missing.toml", "epochs": 1})


@pytest.mark.skipif("DERMIS_SLOW" not in os.environ, reason="slow: set DERMIS_SLOW=1")
def test_killed_nodes_and_drivers_leave_the_files_of_one_process(tmp_path, monkeypatch):
    samples, seeds = 65_536, int(os.environ.get("DERMIS_SEEDS", "5"))
    # Not behind other programs of this machine, so that the time of one process is a measure.
    monkeypatch.setenv("RAY_worker_niceness", "0")
    begun = time.monotonic()
    expected = of_one_process("skin16", tmp_path / "one", samples)
    # Most kills meet tasks at work.
    horizon_s = 0.7 * (time.monotonic() - begun)
    for seed in range(seeds):
        killed = survive(seed, tmp_path / str(seed), samples, horizon_s, monkeypatch)
        print(f"seed {seed}: {killed}", flush=True)
        assert sums(tmp_path / str(seed)) == expected, f"seed {seed}"


def survive(seed, folder, samples, horizon_s, monkeypatch):
    """Kills two nodes of four and the driver at random times until the horizon; what was killed when."""
    rng = random.Random(seed)
    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 0, "include_dashboard": False})
    monkeypatch.setenv("RAY_ADDRESS", cluster.address)
    nodes = [cluster.add_node(num_cpus=1) for _ in range(4)]
    call = json.dumps(["skin16", str(folder), RECIPE, samples])
    start = lambda: subprocess.Popen([sys.executable, "-c", DRIVER, call])
    driver, log = start(), []
    try:
        while not (folder / "run.json").exists():
            time.sleep(0.05)
        begun = time.monotonic()
        victims = ["node", "node", "driver"]
        rng.shuffle(victims)
        for when, victim in zip(sorted(rng.uniform(0, horizon_s) for _ in victims), victims):
            time.sleep(max(0.0, begun + when - time.monotonic()))
            log.append(f"{victim} at {when:.0f} s ({files_of(folder)} of 8 files)")
            if victim == "node":
                cluster.remove_node(nodes.pop(rng.randrange(len(nodes))), allow_graceful=False)
            else:
                driver.kill()
                driver.wait()
                driver = start()
        assert driver.wait(timeout=600) == 0
        return f"{', '.join(log)}; done after {time.monotonic() - begun:.0f} s"
    finally:
        driver.kill()
        cluster.shutdown()
