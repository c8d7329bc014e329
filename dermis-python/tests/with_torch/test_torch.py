"""PyTorch: the forward model's gradients, networks, samples. Skipped where torch is missing."""

import multiprocessing
import tomllib

import numpy as np
import pytest

import dermis

torch = pytest.importorskip("torch")
from dermis.torch import ElectrodeMotion, Network, SampleDataset, SampleStream, forward  # noqa: E402

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
RECIPE = """
skins = "even"
[touch.gaussian]
most = 2
width_m = [0.004, 0.012]
amplitude = [0.1, 0.3]
"""


@pytest.fixture(scope="module")
def disk():
    return dermis.Skin.load(tomllib.loads(DISK))


def uneven(skin, count, seed=1):
    """Conductivities in units of that at rest."""
    factors = np.random.default_rng(seed).uniform(0.7, 1.4, (count, len(skin.rest_conductivity)))
    return torch.tensor(factors)


def test_gradcheck_by_conductivity(disk):
    rest = torch.tensor(disk.rest_conductivity)
    function = lambda factors: forward(disk, factors * rest)
    factors = uneven(disk, 2).requires_grad_()
    assert torch.autograd.gradcheck(function, factors, eps=1e-5, rtol=1e-5, atol=1e-6, fast_mode=True)


def test_gradcheck_by_contact_impedance_and_electrode_position(disk):
    rest = torch.tensor(disk.rest_conductivity)
    conductivity = uneven(disk, 3) * rest
    contacts = torch.tensor(disk.contact_impedance)
    motion = ElectrodeMotion(disk)

    def function(factors, displacement_mm):
        return forward(disk, conductivity, factors * contacts, motion(displacement_mm * 1e-3))

    factors = torch.linspace(0.5, 2.0, len(contacts), dtype=torch.double).requires_grad_()
    displacement_mm = torch.full((len(contacts), 3), 0.1, dtype=torch.double).requires_grad_()
    assert torch.autograd.gradcheck(
        function, (factors, displacement_mm), eps=1e-4, rtol=1e-4, atol=1e-4, fast_mode=True
    )


def test_what_is_no_mesh_and_no_number_is_refused(disk):
    rest, contacts = torch.tensor(disk.rest_conductivity), len(disk.contact_impedance)
    with pytest.raises(dermis.DermisError, match="int64"):
        forward(disk, torch.ones(len(rest), dtype=torch.int64))
    far = torch.zeros(contacts, 3, dtype=torch.double)
    far[0] = 0.05
    with pytest.raises(dermis.DermisError, match="over"):
        forward(disk, rest, nodes=ElectrodeMotion(disk)(far))


def test_the_gradient_on_a_cylinder_is_the_transposed_jacobian_times_the_derivative():
    skin = dermis.Skin.load("cylinder30")
    conductivity = (uneven(skin, 1)[0] * torch.tensor(skin.rest_conductivity)).requires_grad_()
    frame = forward(skin, conductivity)
    weights = torch.linspace(-1, 1, len(frame), dtype=torch.double)
    (frame * weights).sum().backward()
    expected = skin.jacobian(conductivity.detach().numpy(), per="cell").T @ weights.numpy()
    assert np.abs(conductivity.grad.numpy() - expected).max() < 1e-10 * np.abs(expected).max()


def test_nodes_stay_on_a_cylinder_when_electrodes_move():
    skin = dermis.Skin.load("cylinder30")
    motion = ElectrodeMotion(skin)
    moved = motion(torch.full((30, 3), 1e-3, dtype=torch.double)).numpy()
    nodes = skin.mesh.nodes
    assert np.allclose(np.hypot(*moved[:, :2].T), np.hypot(*nodes[:, :2].T), atol=1e-12)
    own = skin.mesh.electrode_nodes[3]
    assert np.allclose(moved[own, 2] - nodes[own, 2], 1e-3)
    assert not np.allclose(moved, nodes)


def test_electrode_positions_are_improved_by_frames_of_another_mesh():
    # The frames are those of a skin whose electrodes lie elsewhere, meshed anew: not of the mesh that is differentiated.
    design = tomllib.loads(DISK.replace("max_edge_m = 0.02", "max_edge_m = 0.005"))
    skin = dermis.Skin.load(design)
    nominal = skin.electrodes
    angles = np.arctan2(nominal[:, 1], nominal[:, 0]) + np.random.default_rng(1).normal(0, 0.02, 8)
    places = [{"x_m": 0.05 * np.cos(angle), "y_m": 0.05 * np.sin(angle)} for angle in angles]
    moved = {**design, "electrodes": {**design["electrodes"], "layout": {"positions": places}}}
    moved["mesh"] = {"max_edge_m": 0.006, "electrode_edge_m": 0.002}
    true = dermis.Skin.load(moved)
    measured = torch.tensor(true.forward())
    rest, motion = torch.tensor(skin.rest_conductivity), ElectrodeMotion(skin)
    tangent = torch.tensor(np.stack([-nominal[:, 1], nominal[:, 0], 0 * nominal[:, 0]], axis=1)) / 0.05
    along_mm = torch.zeros(8, 1, dtype=torch.double, requires_grad=True)
    optimizer = torch.optim.LBFGS([along_mm], max_iter=60, line_search_fn="strong_wolfe")

    def loss():
        optimizer.zero_grad()
        frame = forward(skin, rest, nodes=motion(1e-3 * along_mm * tangent))
        misfit = ((frame - measured) / measured).square().mean()
        misfit.backward()
        return misfit

    optimizer.step(loss)
    found = nominal + 1e-3 * (along_mm * tangent).detach().numpy()
    before = np.linalg.norm(nominal - true.electrodes, axis=1).mean()
    after = np.linalg.norm(found - true.electrodes, axis=1).mean()
    print(f"mean error of the electrodes: {1e3 * before:.2f} mm before, {1e3 * after:.2f} mm after")
    assert after < 0.5 * before


@pytest.mark.parametrize(("name", "design"), [("spots", "cylinder30"), ("paper", "cylinder30"), ("shapes", "skin16")])
def test_networks_make_the_images_of_the_program(name, design, tmp_path):
    skin = dermis.Skin.load(design)
    rng = np.random.default_rng(1)
    positions = skin.pixels[rng.choice(len(skin.pixels), 3, replace=False)]
    untouched = skin.forward()
    differences = skin.forward([skin.touched_conductivity(position) for position in positions]) - untouched
    images = skin.method(name).images(differences).reshape(3, -1)
    images = images[:, np.isfinite(images[0])]
    network = Network.load(name)
    with torch.inference_mode():
        ours = network(torch.tensor(differences, dtype=torch.float32)).numpy()
    assert np.abs(ours - images).max() < 1e-4 * np.abs(images).max()
    # Trained further and saved, it is a method again.
    with torch.no_grad():
        network.trunk[-1].bias.add_(0.01)
    network.save(tmp_path / "network")
    changed = skin.method(tmp_path / "network").images(differences).reshape(3, -1)
    changed = changed[:, np.isfinite(changed[0])]
    with torch.inference_mode():
        ours = network(torch.tensor(differences, dtype=torch.float32)).numpy()
    assert np.abs(ours - changed).max() < 1e-4 * np.abs(changed).max()
    assert np.abs(changed - images).max() > 1e-3 * np.abs(images).max()


def test_networks_that_cannot_be_are_refused(tmp_path):
    with pytest.raises(dermis.DermisError, match='no network "nothing"'):
        Network.load("nothing")
    with pytest.raises(dermis.DermisError, match="is no model"):
        Network.load(tmp_path)
    Network.load("paper").save(tmp_path / "empty")
    for text in ("{}", "{", '{"input": 3}'):
        (tmp_path / "empty" / "card.json").write_text(text)
        with pytest.raises(dermis.DermisError, match="card.json is damaged"):
            Network.load(tmp_path / "empty")
    Network.load("paper").save(tmp_path / "cut")
    weights = tmp_path / "cut" / "weights.safetensors"
    weights.write_bytes(weights.read_bytes()[:1000])
    with pytest.raises(dermis.DermisError, match="damaged"):
        Network.load(tmp_path / "cut")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("dataset") / "set"
    recipe = folder.with_name("recipe.toml")
    recipe.write_text(RECIPE)
    dermis.command("simulate", "skin16", samples=256, seed=7, recipe=recipe, output=folder)
    dermis.command("simulate", finish=folder)
    return folder


@pytest.mark.parametrize("start", ["fork", "spawn", "forkserver"])
def test_a_loader_with_workers_reads_every_sample(folder, start):
    if start not in multiprocessing.get_all_start_methods():
        pytest.skip(f"this system has no {start}")
    # The thread pool of this process has started: a forked child makes its own.
    dermis.Skin.load("skin16").forward()
    loader = torch.utils.data.DataLoader(
        SampleDataset(folder), batch_size=32, num_workers=4, multiprocessing_context=start, timeout=60
    )
    indices = torch.cat([batch["index"] for batch in loader])
    assert torch.equal(indices, torch.arange(256))


@pytest.mark.parametrize("start", ["fork", "spawn"])
def test_workers_share_a_stream_without_repeats(folder, start):
    stream = SampleStream(dermis.Skin.load("skin16"), tomllib.loads(RECIPE), 7, block=32)
    loader = torch.utils.data.DataLoader(
        stream, batch_size=32, num_workers=2, multiprocessing_context=start, timeout=60
    )
    batches = [batch for batch, _ in zip(loader, range(8))]
    indices = torch.cat([batch["index"] for batch in batches])
    assert torch.equal(indices.sort().values, torch.arange(256))
    of_files = SampleDataset(folder)[int(indices[40])]
    assert len(list(SampleDataset(folder))) == len(SampleDataset(folder))
    with pytest.raises(TypeError):
        SampleDataset(folder)[0:2]
    assert torch.equal(of_files["frame"], batches[1]["frame"][8])


def test_shapes_that_cannot_be_are_refused(disk):
    with pytest.raises(dermis.DermisError, match="`conductivity` has the shape"):
        forward(disk, torch.ones(3, dtype=torch.double))
    with pytest.raises(dermis.DermisError, match="`contact_impedance` has the shape"):
        forward(disk, torch.tensor(disk.rest_conductivity), torch.ones(3, dtype=torch.double))
