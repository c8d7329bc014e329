"""Training in PyTorch against `dermis train`. Skipped where torch is missing."""

import itertools

import numpy as np
import pytest

import dermis

torch = pytest.importorskip("torch")
from dermis.torch import train  # noqa: E402

SEEDS = (1, 2, 3)
CYLINDER = """
[body.cylinder]
length_m = 0.2
diameter_m = 0.1
[sheet]
sheet_resistance_ohm = 1000.0
touch = "conductance_rises"
[electrodes]
shape.disc.radius_m = 0.004
contact_impedance_ohm_m2 = 2e-5
[electrodes.layout.rings]
rings = 4
per_ring = 4
spacing_m = 0.060
stagger = 0.5
[protocol]
pattern = "adjacent"
[image.grid]
rows = 10
columns = 12
[mesh]
max_edge_m = 0.015
electrode_edge_m = 0.003
"""


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """The path of a small design, and the folder of a dataset of it."""
    folder = tmp_path_factory.mktemp("small")
    (folder / "design.toml").write_text(CYLINDER)
    return str(folder / "design.toml"), simulated(folder / "data", str(folder / "design.toml"), 4000, skins="random")


def simulated(folder, design, samples, **options):
    dermis.command("simulate", design, samples=samples, seed=5, output=folder, **options)
    dermis.command("simulate", finish=folder)
    return folder


def losses(epochs):
    return [[epoch["training_loss"], epoch["test_loss"]] for epoch in epochs]


def curves(design, data, folder, **options):
    """The losses of `dermis train` and of `dermis.torch.train`, (seeds, epochs, 2) each."""
    program, pytorch = [], []
    for seed in SEEDS:
        trained = dermis.command("train", design, data=[data], output=folder / f"program-{seed}", seed=seed, **options)
        program.append(losses(trained["epochs"]))
        network = train(design, folder / f"torch-{seed}", data=data, seed=seed, device="cpu", **options)
        pytorch.append(losses(network.card["training"]["epochs"]))
    return np.array(program), np.array(pytorch)


def assert_same_curves(program, pytorch):
    """The means over the seeds differ by less than three standard errors; deviations are pooled over the epochs."""
    mean = program.mean(axis=0)
    difference = (pytorch.mean(axis=0) - mean) / mean
    variance = (program / mean).var(axis=0, ddof=1) + (pytorch / mean).var(axis=0, ddof=1)
    error = np.sqrt(variance.mean(axis=0) / len(SEEDS))
    for number, row in enumerate(zip(mean, pytorch.mean(axis=0)), 1):
        print(f"epoch {number}: dermis train {row[0]}, dermis.torch.train {row[1]} (training, test)")
    print(f"largest relative difference {np.abs(difference).max(axis=0)}, standard error {error}")
    assert (np.abs(difference) < 3 * error).all()


def test_the_papers_recipe_has_the_loss_curve_of_the_program(tmp_path):
    data = simulated(tmp_path / "data", "cylinder30", 6000, skins="random")
    program, pytorch = curves("cylinder30", data, tmp_path, network="paper", epochs=3)
    assert_same_curves(program, pytorch)
    # The model serves like any other.
    skin = dermis.Skin.load("cylinder30")
    assert skin.method(str(tmp_path / "torch-1")).images(skin.forward(), skin.forward()).shape == (30, 30)
    with dermis.Live(skin, method=str(tmp_path / "torch-1"), touch="press", seed=4, speed=8) as live:
        assert sum(frame.is_usable for frame in itertools.islice(live, 300)) > 50


@pytest.mark.parametrize("network", ["spots", "shapes"])
def test_noise_drift_and_symmetries_are_those_of_the_program(network, small, tmp_path):
    program, pytorch = curves(*small, tmp_path, network=network, epochs=3)
    assert_same_curves(program, pytorch)
    assert program[0, 2, 1] < 0.95 * program[0, 0, 1], "it has learned"


def test_an_interrupted_training_continues_with_the_same_losses(small, tmp_path):
    design, data = small
    options = {"data": data, "network": "spots", "device": "cpu", "epochs": 3}
    whole = train(design, tmp_path / "whole", **options)

    def interrupt(epoch):
        raise KeyboardInterrupt

    for _ in range(2):
        with pytest.raises(KeyboardInterrupt):
            train(design, tmp_path / "parts", on_epoch=interrupt, **options)
    parts = train(design, tmp_path / "parts", **options)
    assert losses(parts.card["training"]["epochs"]) == losses(whole.card["training"]["epochs"])
    assert parts.weights() == whole.weights()
    assert {path.name for path in (tmp_path / "parts").iterdir()} == {
        "card.json",
        "checkpoint.pt",
        "losses.svg",
        "weights.safetensors",
    }
    with pytest.raises(dermis.DermisError, match="another training"):
        train(design, tmp_path / "parts", **{**options, "seed": 9})
    (tmp_path / "parts" / "checkpoint.pt").write_bytes(b"no checkpoint")
    with pytest.raises(dermis.DermisError, match="checkpoint.pt is damaged"):
        train(design, tmp_path / "parts", **options)


def test_a_stream_has_new_samples_in_every_epoch(small, tmp_path):
    options = {"stream": "gaussian", "epoch_samples": 1800, "epochs": 2, "network": "spots"}
    network = train(small[0], tmp_path / "torch", device="cpu", **options)
    program = dermis.command("train", small[0], output=tmp_path / "program", **options)
    pytorch = losses(network.card["training"]["epochs"])
    assert np.allclose(pytorch, losses(program["epochs"]), rtol=0.05)
    assert not np.allclose(*pytorch, rtol=1e-3)


def test_trainings_that_cannot_be_are_refused(small, tmp_path):
    design, data = small
    refused = lambda match: pytest.raises(dermis.DermisError, match=match)
    with refused("no option 'batches'"):
        train(design, tmp_path, data=data, batches=3)
    with refused("required"):
        train(design, tmp_path)
    with refused("run.json|manifest|No such file"):
        train(design, tmp_path, data=tmp_path / "nothing")
    with refused("simulate it anew"):
        train("cylinder30", tmp_path, data=data)


def test_seeds_and_epochs_have_random_numbers_of_their_own():
    from dermis.torch._training import _RandomNumbers

    drawn = [_RandomNumbers(seed, torch.device("cpu")) for seed in ([1, 0], [2, 0], [1, 1], [1 + (1 << 40), 0])]
    assert len({float(numbers.normal(1)) for numbers in drawn}) == len(drawn)
    assert float(_RandomNumbers([1, 0], torch.device("cpu")).normal(1)) == float(
        _RandomNumbers([1, 0], torch.device("cpu")).normal(1)
    )


def test_devices_that_cannot_be_are_refused_before_any_work(tmp_path):
    for device in ("gpu", "meta", "mps"):
        with pytest.raises(dermis.DermisError, match="`device` is"):
            train("cylinder30", tmp_path, data=tmp_path, device=device)
