"""Networks as modules."""

import json
import os
from pathlib import Path
from typing import Any, Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from dermis._dermis import shipped_model
from dermis._errors import DermisError
from dermis._files import write_whole

# Added to the variance by batch normalization, and the share of running means that is kept (Keras' defaults).
_EPSILON, _MOMENTUM = 1e-3, 0.99
_KINDS = {"F32": "<f4", "F16": "<f2"}


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
        self.register_buffer("_mean", torch.tensor(given["mean_ohm"], dtype=torch.float32))
        self.register_buffer("_sd", torch.tensor(given["sd_ohm"], dtype=torch.float32))
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
        """A shipped network (`spots`, `paper`, `shapes`), or the one in a folder.

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
        network.load_weights(weights, name)
        return network.eval()

    def save(self, folder: str | os.PathLike[str]) -> None:
        """Writes the network to a folder, which is created: `card.json` and `weights.safetensors`."""
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        write_whole(folder / "weights.safetensors", self.weights())
        write_whole(folder / "card.json", json.dumps(self.card, indent=2).encode())

    def weights(self) -> bytes:
        """The weights as the bytes of a safetensors file."""
        return _tensors_as_bytes(self._tensors())

    def load_weights(self, weights: bytes, name: str = "weights") -> None:
        """Takes the weights of the bytes of a safetensors file.

        Raises:
            DermisError: A damaged file, tensors that are missing or of another shape.
        """
        self._set_tensors(name, _read_tensors(weights))

    def inputs(self, differences: Tensor) -> tuple[Tensor, Tensor]:
        """What enters the first layer, and the size of each frame.

        Args:
            differences: Frames minus the untouched frame, (n, channels), ohm.
        """
        return self.take_size(self.normalized(differences))

    def normalized(self, differences: Tensor) -> Tensor:
        """Means of channels, normalized, (n, inputs)."""
        return (differences @ self._average - self._mean) / self._sd

    def take_size(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """Normalized inputs divided by the size of each frame if the network is scale-free, and the sizes, (n, 1)."""
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
