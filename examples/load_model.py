"""Load a model of `dermis train` in PyTorch, and with NumPy alone, and make images of frames without Dermis.

python load_model.py MODEL DIFFERENCES.npy [IMAGES.npy]      (pip install numpy; torch is used where it is installed)

MODEL is a model's folder, DIFFERENCES are frames less the untouched frame, ohm, a row each; IMAGES, where given, are what
`dermis reconstruct --method` made of them, and must agree.
"""

import json
import sys
from pathlib import Path

import numpy as np

KINDS = {"F32": "<f4", "F16": "<f2"}
# What batch normalisation adds to a variance, and what its running means keep of themselves at each batch (Keras' defaults).
EPSILON, MOMENTUM = 1e-3, 0.99
# Rounding of float32 along a network, of the largest value.
AGREEMENT = 1e-5


def read(folder):
    """A model's card, and its tensors as float32."""
    folder = Path(folder)
    card = json.loads((folder / "card.json").read_text())
    data = (folder / "weights.safetensors").read_bytes()
    length = int.from_bytes(data[:8], "little")
    header = json.loads(data[8 : 8 + length])
    header.pop("__metadata__", None)

    def tensor(entry):
        begin, end = (8 + length + offset for offset in entry["data_offsets"])
        return np.frombuffer(data[begin:end], KINDS[entry["dtype"]]).astype(np.float32).reshape(entry["shape"])

    return card, {name: tensor(entry) for name, entry in header.items()}


def inputs(card, differences):
    """What enters the network: means of channels that read the same, normalised."""
    given = card["input"]
    if given.get("scale_free"):
        raise SystemExit("this network sees the shape of a frame alone: use `dermis export --onnx`, which divides and multiplies by its size")
    means = np.stack([differences[:, channels].mean(axis=1) for channels in given["channels"]], axis=1)
    return ((means - np.float32(given["mean_ohm"])) / np.float32(given["sd_ohm"])).astype(np.float32)


def image(card, outputs):
    """What the network's output means: the change of conductance itself, or the root of the touches with its sign."""
    return outputs if card["target"] == "conductance" else outputs * np.abs(outputs)


def layers(card):
    """The layers of the trunk: kind, name of the tensors, whether a rectifier follows."""
    for index, layer in enumerate(card["plan"]["trunk"]):
        ((kind, sizes),) = layer.items()
        yield kind, f"trunk.{index}", sizes["relu"]


def with_numpy(card, tensors, differences):
    """Images, by NumPy alone."""
    x = inputs(card, differences)
    for kind, name, relu in layers(card):
        part = lambda key: tensors[f"{name}.{key}"]
        if kind == "dense":
            x = x @ part("weight") + part("bias")
        else:
            x = (x - part("mean")) / np.sqrt(part("variance") + EPSILON) * part("scale") + part("shift")
        if relu:
            x = np.maximum(x, 0)
    refinement = card["plan"]["refinement"]
    if refinement:
        x = refined_with_numpy(refinement, tensors, x)
    return image(card, x)


def refined_with_numpy(plan, tensors, x):
    rows, columns, count = plan["rows"], plan["columns"], len(plan["channels"]) - 1
    x = picture = x.reshape(len(x), rows, columns, plan["channels"][0])
    for index in range(count):
        weight, bias = (tensors[f"refinement.{index}.{key}"] for key in ("weight", "bias"))
        bordered = np.pad(x, ((0, 0), (1, 1), (0, 0), (0, 0)))
        bordered = np.pad(bordered, ((0, 0), (0, 0), (1, 1), (0, 0)), "wrap" if plan["is_ring"] else "constant")
        x = bias + sum(
            bordered[:, row : row + rows, column : column + columns] @ weight[row, column]
            for row in range(3)
            for column in range(3)
        )
        if index + 1 < count:
            x = np.maximum(x, 0)
    return (x[..., 0] + picture[..., 0]).reshape(len(x), -1)


def with_torch(card, tensors):
    """The network as a module of PyTorch that can be trained on; from `inputs` to what `image` takes."""
    import torch

    value = lambda name: torch.from_numpy(tensors[name].copy())
    modules = []
    for kind, name, relu in layers(card):
        if kind == "dense":
            weight = value(f"{name}.weight")
            module = torch.nn.Linear(*weight.shape)
            module.weight.data, module.bias.data = weight.T.contiguous(), value(f"{name}.bias")
        else:
            module = torch.nn.BatchNorm1d(len(value(f"{name}.scale")), eps=EPSILON, momentum=1 - MOMENTUM)
            module.weight.data, module.bias.data = value(f"{name}.scale"), value(f"{name}.shift")
            module.running_mean, module.running_var = value(f"{name}.mean"), value(f"{name}.variance")
        modules += [module, torch.nn.ReLU()] if relu else [module]
    plan = card["plan"]["refinement"]
    if plan:
        modules.append(refinement_with_torch(plan, value))
    return torch.nn.Sequential(*modules)


def refinement_with_torch(plan, value):
    import torch

    class Refinement(torch.nn.Module):
        def __init__(self):
            super().__init__()
            pairs = list(zip(plan["channels"], plan["channels"][1:]))
            self.convolutions = torch.nn.ModuleList(torch.nn.Conv2d(*pair, 3) for pair in pairs)
            for index, one in enumerate(self.convolutions):
                one.weight.data = value(f"refinement.{index}.weight").permute(3, 2, 0, 1).contiguous()
                one.bias.data = value(f"refinement.{index}.bias")

        def forward(self, x):
            pad = torch.nn.functional.pad
            x = x.view(len(x), plan["rows"], plan["columns"], plan["channels"][0]).permute(0, 3, 1, 2)
            first = x[:, :1]
            for index, one in enumerate(self.convolutions):
                x = torch.relu(x) if index else x
                x = pad(x, (1, 1, 0, 0), mode="circular" if plan["is_ring"] else "constant")
                x = one(pad(x, (0, 0, 1, 1)))
            return (x + first).flatten(1)

    return Refinement()


def check(name, theirs, images):
    worst, largest = np.abs(theirs - images).max(), np.abs(images).max()
    print(f"{name}: {len(images)} images agree to {worst / largest:.1e} of the largest value, {largest:.3g}")
    assert worst <= AGREEMENT * largest


def main():
    card, tensors = read(sys.argv[1])
    differences = np.load(sys.argv[2]).astype(np.float32)
    images = with_numpy(card, tensors, differences)
    print(f"{card['name']}: {len(images)} images of {images.shape[1]} pixels, the largest value {images.max():.3g}")
    if len(sys.argv) > 3:
        # A picture has no numbers outside the body; the network gives the pixels inside.
        ours = np.load(sys.argv[3]).reshape(len(images), -1)
        check("NumPy and Dermis", images, ours[:, np.isfinite(ours[0])])
    try:
        import torch
    except ImportError:
        print("PyTorch is not installed: not tried")
        return
    network = with_torch(card, tensors).eval()
    with torch.inference_mode():
        outputs = network(torch.from_numpy(inputs(card, differences))).numpy()
    check("PyTorch and NumPy", image(card, outputs), images)


if __name__ == "__main__":
    main()
