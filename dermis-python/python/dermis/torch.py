"""PyTorch: networks as modules, training samples as datasets, the forward model as a differentiable function.

>>> import dermis, torch
>>> from dermis.torch import forward
>>> skin = dermis.Skin.load("skin16")
>>> conductivity = torch.tensor(skin.rest_conductivity, requires_grad=True)
>>> frame = forward(skin, conductivity)          # (channels,), ohm
>>> frame.square().sum().backward()
>>> conductivity.grad.shape == conductivity.shape
True
"""

import json
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from dermis._dermis import Dataset as _Dataset
from dermis._dermis import Samples, Skin, shipped_model
from dermis._errors import DermisError

__all__ = ["ElectrodeMotion", "Network", "SampleDataset", "SampleStream", "forward"]

# Added to the variance by batch normalization, and the share of running means that is kept (Keras' defaults).
_EPSILON, _MOMENTUM = 1e-3, 0.99
_KINDS = {"F32": "<f4", "F16": "<f2"}


class _Forward(torch.autograd.Function):
    @staticmethod
    def forward(ctx, skin, conductivity, contact_impedance, nodes):
        array = lambda tensor: None if tensor is None else tensor.detach().double().cpu().numpy()
        contacts, moved = array(contact_impedance), array(nodes)
        if not any(ctx.needs_input_grad):
            if contacts is None and moved is None:
                frames = skin.forward(array(conductivity))
            else:
                frames = skin.solve(array(conductivity), contact_impedance=contacts, nodes=moved).frames
        else:
            ctx.solution = skin.solve(array(conductivity), contact_impedance=contacts, nodes=moved)
            frames = ctx.solution.frames
        ctx.like = [conductivity, contact_impedance, nodes]
        return torch.tensor(frames, dtype=conductivity.dtype, device=conductivity.device)

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, by_frame):
        parameters = any(ctx.needs_input_grad[2:])
        gradient = ctx.solution.gradient(by_frame.double().cpu().numpy(), parameters=parameters)
        results = [None]
        for name, needed, like in zip(
            ("conductivity", "contact_impedance", "nodes"), ctx.needs_input_grad[1:], ctx.like
        ):
            values = torch.from_numpy(gradient[name]).to(like) if needed else None
            results.append(values)
        return tuple(results)


def forward(
    skin: Skin, conductivity: Tensor, contact_impedance: Tensor | None = None, nodes: Tensor | None = None
) -> Tensor:
    """Frames of conductivities, differentiable in reverse mode by an exact adjoint: no Jacobian is computed.

    The gradient is that of the frames as the instrument reports them (amplitudes if it loses the signs). It can be
    differentiated once. The computation is in double precision on the CPU.

    Args:
        skin: A `dermis.Skin`.
        conductivity: (cells,) or (n, cells): S on surfaces, S/m in volumes.
        contact_impedance: (electrodes,): ohm m2 on areas, ohm m on edges; that of the design without it.
        nodes: Positions of the nodes, (nodes, 3), m; those of the mesh without it. `ElectrodeMotion` moves electrodes.

    Returns:
        (channels,) or (n, channels), ohm, of the type and on the device of `conductivity`.

    Raises:
        DermisError: A wrong shape, a value that is not positive and finite.
    """
    return _Forward.apply(skin, conductivity, contact_impedance, nodes)


class ElectrodeMotion(nn.Module):
    """Nodes of a mesh whose electrodes are displaced along the surface.

    The nodes of an electrode move with it. The displacement of the others falls linearly to zero at five radii of the
    electrode, or halfway to the next electrode. On a cylinder nodes stay at their radius; on a plane, in it; on other
    bodies displacements along the surface must be given.

    Args:
        skin: A `dermis.Skin` of triangles.
    """

    _RADII = 5.0
    nodes: Tensor
    weights: Tensor
    _along: Tensor
    is_cylinder: bool

    def __init__(self, skin: Skin) -> None:
        super().__init__()
        mesh, centres = skin.mesh, skin.electrodes
        nodes = mesh.nodes
        if mesh.cells.shape[1] != 3:
            raise DermisError("electrodes are moved on surfaces", hint="give a design whose mesh is of triangles")
        distance = np.linalg.norm(nodes[:, None] - centres, axis=2)
        between = np.linalg.norm(centres[:, None] - centres, axis=2)
        np.fill_diagonal(between, np.inf)
        weights = np.zeros(distance.shape)
        for electrode, own in enumerate(mesh.electrode_nodes):
            radius = max(distance[own, electrode].max(), 1e-4)
            end = min(self._RADII * radius, between[electrode].min() / 2)
            fall = (end - distance[:, electrode]) / max(end - radius, 1e-9)
            weights[:, electrode] = np.clip(fall, 0.0, 1.0)
            weights[own, electrode] = 1.0
        radii = np.hypot(nodes[:, 0], nodes[:, 1])
        self.is_cylinder = bool(np.ptp(radii) < 1e-9 * radii.max() and np.ptp(nodes[:, 2]) > 0)
        # On a plane nodes stay in it.
        self.register_buffer("_along", torch.tensor([1.0, 1.0, 0.0 if np.ptp(nodes[:, 2]) == 0 else 1.0]).double())
        self.register_buffer("nodes", torch.tensor(nodes))
        self.register_buffer("weights", torch.tensor(weights))

    def forward(self, displacement: Tensor) -> Tensor:
        """Positions of the nodes, (nodes, 3), m.

        Args:
            displacement: Of each electrode, (electrodes, 3), m.
        """
        moved = self.nodes + self.weights @ (displacement * self._along)
        if not self.is_cylinder:
            return moved
        radius = torch.linalg.vector_norm(self.nodes[:, :2], dim=1, keepdim=True)
        return torch.cat(
            [moved[:, :2] * radius / torch.linalg.vector_norm(moved[:, :2], dim=1, keepdim=True), moved[:, 2:]], dim=1
        )


class _Refinement(nn.Module):
    """Convolutions of 3 x 3 pixels; the first channel of the input is added to the output."""

    def __init__(self, plan):
        super().__init__()
        self.plan = plan
        pairs = zip(plan["channels"], plan["channels"][1:])
        self.convolutions = nn.ModuleList(nn.Conv2d(*pair, 3) for pair in pairs)

    def forward(self, x):
        plan, pad = self.plan, nn.functional.pad
        x = x.view(len(x), plan["rows"], plan["columns"], plan["channels"][0]).permute(0, 3, 1, 2)
        first = x[:, :1]
        for index, convolution in enumerate(self.convolutions):
            x = torch.relu(x) if index else x
            x = pad(x, (1, 1, 0, 0), mode="circular" if plan["is_ring"] else "constant")
            x = convolution(pad(x, (0, 0, 1, 1)))
        return (x + first).flatten(1)


class Network(nn.Module):
    """A network of Dermis: differences of frames to images.

    `Network.load` reads a shipped network or a folder of `dermis train`; `save` writes a folder that every command of
    Dermis uses: `dermis live --method ./folder`.

    Args:
        card: The card of the network (`card.json`, docs/models.md).
    """

    card: dict[str, Any]
    trunk: nn.ModuleList
    refinement: nn.Module | None
    _mean: Tensor
    _sd: Tensor
    _average: Tensor

    def __init__(self, card: dict[str, Any]) -> None:
        super().__init__()
        self.card = card
        given = card["input"]
        self.register_buffer("_mean", torch.tensor(given["mean_ohm"]))
        self.register_buffer("_sd", torch.tensor(given["sd_ohm"]))
        average = torch.zeros(card["skin"]["channels"], len(given["channels"]))
        for index, channels in enumerate(given["channels"]):
            average[channels, index] = 1 / max(len(channels), 1)
        self.register_buffer("_average", average)
        layers = nn.ModuleList()
        for layer in card["plan"]["trunk"]:
            ((kind, sizes),) = layer.items()
            if kind == "dense":
                layers.append(nn.Linear(sizes["inputs"], sizes["outputs"]))
            else:
                layers.append(nn.BatchNorm1d(sizes["features"], eps=_EPSILON, momentum=1 - _MOMENTUM))
        self.trunk = layers
        plan = card["plan"]["refinement"]
        self.refinement = _Refinement(plan) if plan else None

    @classmethod
    def load(cls, name_or_folder: str | os.PathLike[str]) -> Self:
        """A shipped network (`best`, `paper`, `shapes`), or the one in a folder.

        Raises:
            DermisError: An unknown name, a folder that is no model, tensors of another shape.
        """
        name = os.fspath(name_or_folder)
        if Path(name).is_dir():
            try:
                card, weights = ((Path(name) / file).read_bytes() for file in ("card.json", "weights.safetensors"))
            except OSError as error:
                raise DermisError(f"{name} is no model: {error}") from error
        else:
            card, weights = shipped_model(name)
        try:
            network = cls(json.loads(card))
        except (ValueError, KeyError, TypeError, IndexError) as error:
            raise DermisError(f"{name}: card.json is damaged or of another version: {error!r}") from error
        network._set_tensors(name, _read_tensors(weights))
        return network.eval()

    def save(self, folder: str | os.PathLike[str]) -> None:
        """Writes the network to a folder, which is created: `card.json` and `weights.safetensors`."""
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        _write_whole(folder / "weights.safetensors", _tensors_as_bytes(self._tensors()))
        _write_whole(folder / "card.json", json.dumps(self.card, indent=2).encode())

    def inputs(self, differences: Tensor) -> tuple[Tensor, Tensor]:
        """What enters the first layer, and the size of each frame.

        Args:
            differences: Frames minus the untouched frame, (n, channels), ohm.
        """
        x = (differences @ self._average - self._mean) / self._sd
        if not self.card["input"].get("scale_free"):
            return x, torch.ones(len(x), 1, dtype=x.dtype, device=x.device)
        count = sum(bool(channels) for channels in self.card["input"]["channels"])
        size = (x.square().sum(dim=1, keepdim=True) / max(count, 1)).sqrt()
        return torch.where(size > 0, x / size.clamp_min(1e-30), x), size

    def outputs(self, inputs: Tensor) -> Tensor:
        """What the last layer gives, (n, pixels): the target of training."""
        x = inputs
        for layer, plan in zip(self.trunk, self.card["plan"]["trunk"]):
            ((_, sizes),) = plan.items()
            x = layer(x)
            x = torch.relu(x) if sizes["relu"] else x
        return x if self.refinement is None else self.refinement(x)

    def forward(self, differences: Tensor) -> Tensor:
        """Images of differences, (n, channels), ohm, to (n, pixels)."""
        x, size = self.inputs(differences)
        y = self.outputs(x)
        return size * (y if self.card["target"] == "conductance" else y * y.abs())

    def _tensors(self):
        """The tensors of the file, by name."""
        result = {}
        for index, layer in enumerate(self.trunk):
            if isinstance(layer, nn.Linear):
                parts = {"weight": layer.weight.T, "bias": layer.bias}
            else:
                parts = {
                    "scale": layer.weight,
                    "shift": layer.bias,
                    "mean": layer.running_mean,
                    "variance": layer.running_var,
                }
            result.update({f"trunk.{index}.{key}": value for key, value in parts.items()})
        for index, layer in enumerate(self.refinement.convolutions if self.refinement else []):
            result[f"refinement.{index}.weight"] = layer.weight.permute(2, 3, 1, 0)
            result[f"refinement.{index}.bias"] = layer.bias
        return {name: value.detach().cpu().float().contiguous().numpy() for name, value in result.items()}

    def _set_tensors(self, name, tensors):
        for key, own in self._tensors().items():
            if key not in tensors or tensors[key].shape != own.shape:
                found = tensors[key].shape if key in tensors else "missing"
                raise DermisError(f"{name}: the tensor `{key}` is {found}, not {own.shape}")
        with torch.no_grad():
            take = lambda key: torch.from_numpy(tensors[key].copy())
            for index, layer in enumerate(self.trunk):
                if isinstance(layer, nn.Linear):
                    layer.weight.copy_(take(f"trunk.{index}.weight").T)
                    layer.bias.copy_(take(f"trunk.{index}.bias"))
                else:
                    layer.weight.copy_(take(f"trunk.{index}.scale"))
                    layer.bias.copy_(take(f"trunk.{index}.shift"))
                    layer.running_mean.copy_(take(f"trunk.{index}.mean"))
                    layer.running_var.copy_(take(f"trunk.{index}.variance"))
            for index, layer in enumerate(self.refinement.convolutions if self.refinement else []):
                layer.weight.copy_(take(f"refinement.{index}.weight").permute(3, 2, 0, 1))
                layer.bias.copy_(take(f"refinement.{index}.bias"))


def _read_tensors(data):
    """The tensors of a safetensors file, as float32."""
    length = int.from_bytes(data[:8], "little")
    try:
        header = json.loads(data[8 : 8 + length])
        header.pop("__metadata__", None)
        result = {}
        for name, entry in header.items():
            begin, end = (8 + length + offset for offset in entry["data_offsets"])
            values = np.frombuffer(data[begin:end], _KINDS[entry["dtype"]])
            result[name] = values.astype(np.float32).reshape(entry["shape"])
        return result
    except (ValueError, KeyError, TypeError) as error:
        raise DermisError(f"the weights are damaged or no safetensors file: {error}") from error


def _tensors_as_bytes(tensors):
    """A safetensors file of float32."""
    header, parts, at = {}, [], 0
    for name, values in tensors.items():
        data = values.astype("<f4").tobytes()
        header[name] = {"dtype": "F32", "shape": list(values.shape), "data_offsets": [at, at + len(data)]}
        parts.append(data)
        at += len(data)
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 8)
    return len(text).to_bytes(8, "little") + text + b"".join(parts)


def _write_whole(path, data):
    """Writes a file completely or not at all."""
    partial = path.with_name(f"{path.name}.part-{os.getpid()}")
    partial.write_bytes(data)
    partial.replace(path)


class SampleDataset(torch.utils.data.Dataset[dict[str, Tensor]]):
    """The samples of a folder of `dermis simulate`, map-style.

    A sample is a dict of tensors: `frame` and `rest` (channels,), `image` (pixels,), `touches` (most, 6), `index`; see
    `dermis.Dataset.batch`. `__getitems__` reads a whole batch at once.

    Args:
        folder: The folder of the dataset.
    """

    folder: str

    def __init__(self, folder: str | os.PathLike[str]) -> None:
        self.folder = os.fspath(folder)
        self._dataset = _Dataset(self.folder)

    def __len__(self) -> int:
        return len(self._dataset)

    def __getitem__(self, index: int) -> dict[str, Tensor]:
        return self.__getitems__([index])[0]

    def __getitems__(self, indices: Sequence[int]) -> list[dict[str, Tensor]]:
        length = len(self)
        return _samples(self._dataset.batch([index + length if index < 0 else index for index in indices]))

    def __getstate__(self) -> str:
        return self.folder

    def __setstate__(self, folder: str) -> None:
        self.__init__(folder)


class SampleStream(torch.utils.data.IterableDataset[dict[str, Tensor]]):
    """The endless stream of samples of a recipe; each worker of a DataLoader computes its own part.

    Args:
        skin: A `dermis.Skin`.
        recipe: The path of a recipe file, or a dict with its keys.
        seed: The seed.
        first: Index of the first sample.
        block: Number of samples that are computed at once.
    """

    skin: Skin
    recipe: str | os.PathLike[str] | dict[str, Any]
    seed: int
    first: int
    block: int
    _samples: Samples | None

    def __init__(
        self,
        skin: Skin,
        recipe: str | os.PathLike[str] | dict[str, Any],
        seed: int,
        *,
        first: int = 0,
        block: int = 512,
    ) -> None:
        self.skin, self.recipe, self.seed, self.first, self.block = skin, recipe, seed, first, block
        self._samples = None

    def __iter__(self) -> Iterator[dict[str, Tensor]]:
        if self._samples is None:
            self._samples = self.skin.samples(self.recipe, self.seed)
        worker = torch.utils.data.get_worker_info()
        number, count = (0, 1) if worker is None else (worker.id, worker.num_workers)
        at = self.first + number * self.block
        while True:
            yield from _samples(self._samples.batch(at, self.block))
            at += count * self.block

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_samples": None}


def _samples(arrays: dict[str, NDArray[Any]]) -> list[dict[str, Tensor]]:
    """The samples of a batch, one dict each."""
    tensors = {name: torch.from_numpy(values.astype(np.int64) if name == "index" else values) for name, values in arrays.items()}
    count = len(arrays["index"])
    return [{name: values[row] for name, values in tensors.items()} for row in range(count)]
