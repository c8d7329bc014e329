"""Training of networks: the recipe of `dermis train`, the steps on a device of PyTorch."""

import io
import json
import math
import os
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import nn

from dermis import _progress
from dermis._command import words
from dermis._dermis import Training
from dermis._errors import DermisError
from dermis._files import write_whole
from dermis.torch._network import Network

# Parameters of Adam, as in `dermis train` (Keras' defaults).
_ADAM_BETAS, _ADAM_EPSILON = (0.9, 0.999), 1e-7
# Samples that are read at once when all of them are moved to a GPU.
_READ_BATCH = 8192
# Share of the free memory of a GPU that samples may take.
_MEMORY_FRACTION = 0.6
_TINY = torch.finfo(torch.float32).tiny


def train(
    design: str | os.PathLike[str],
    output: str | os.PathLike[str],
    *,
    device: str | torch.device | None = None,
    on_epoch: Callable[[dict[str, float]], object] | None = None,
    **options: Any,
) -> Network:
    """Trains a network as `dermis train` does, with the steps on a device of PyTorch.

    Samples, options, initial weights, learning rates and files are those of `dermis train`. Noise, drift and symmetries
    are drawn on the device, from other random numbers: losses agree within the spread of seeds. Samples stay in the memory
    of a GPU if they fit. The folder is a model like any other: `dermis live --method ./folder`. An interrupted training
    continues after its last epoch when it is called again with the same arguments.

    Matrix products and convolutions have the precision that PyTorch is set to (TF32 on some GPUs). Batch normalization
    keeps the unbiased variance, `dermis train` the biased one: 0.3 % more for 360 samples a step.

    Args:
        design: The path of a design file, or a shipped name.
        output: Folder for the model: `card.json`, `weights.safetensors`, `losses.svg`, `checkpoint.pt`.
        device: `cpu`, `cuda` or `cuda:N`; a GPU if there is one, without it.
        on_epoch: Function that is called after each epoch with its losses: a dict with `training_loss`, `test_loss`
            and `seconds`.
        **options: The options of `dermis train`: `data` (a folder or several) or `stream` (the path of a recipe, or
            `gaussian`), `test`, `network`, `without`, `noise`, `epochs`, `epoch_samples`, `rate`, `seed`, `half`.

    Returns:
        The trained `Network`; `card["training"]["epochs"]` has the losses.

    Raises:
        DermisError: What `dermis train` refuses; another device; a checkpoint of another training; a loss that is not
            finite.
    """
    device = _device(device)
    with tempfile.TemporaryDirectory(prefix="dermis-") as folder:
        line = words("train", [design], {**options, "output": output}, Path(folder))
        training = Training(line[1:])
    run = _Run(training, device)
    run.resume()
    while not training.is_done(json.dumps(run.epochs)):
        epoch = run.epoch()
        run.save_checkpoint()
        training.write_losses(json.dumps(run.epochs))
        if on_epoch is not None:
            on_epoch(dict(epoch))
    training.save(run.network.weights(), json.dumps(run.epochs))
    return Network.load(training.output)


def _device(given):
    """The device of a training."""
    try:
        device = torch.device(given or ("cuda" if torch.cuda.is_available() else "cpu"))
    except (RuntimeError, TypeError) as error:
        raise DermisError(f"`device` is {given!r}: {error}", hint="give cpu, cuda or cuda:N") from error
    if device.type not in ("cpu", "cuda"):
        raise DermisError(f"`device` is {given}", hint="give cpu, cuda or cuda:N")
    if device.type == "cuda" and device.index is None:
        if not torch.cuda.is_available():
            raise DermisError("`device` is cuda, but PyTorch finds no GPU", hint="leave it out to train on the CPU")
        device = torch.device("cuda", torch.cuda.current_device())
    return device


class _Run:
    """A network during training."""

    def __init__(self, training, device):
        self.training, self.device = training, device
        self.settings = json.loads(training.settings)
        self.batch_size = self.settings["options"]["batch"]
        self.network = Network(self.settings)
        self.network.load_weights(training.initial_weights())
        self.network.to(device)
        self.augmentation = _Augmentation(self.settings, training.augmentation()).to(device)
        self.optimizer = torch.optim.Adam(self.network.parameters(), betas=_ADAM_BETAS)
        names = self.augmentation.names
        self.samples = _Samples(training, device, names, self.settings["samples"], test=False)
        self.test_samples = _Samples(training, device, names, self.settings["test_samples"], test=True)
        self.steps, self.epochs = 0, []
        self.checkpoint = Path(training.output) / "checkpoint.pt"

    def epoch(self):
        """One epoch of steps, then the test; returns its losses."""
        begun, number, steps = time.monotonic(), len(self.epochs) + 1, self.training.steps_per_epoch
        order = self.training.order(number)[: steps * self.batch_size].reshape(steps, self.batch_size)
        random = self._random_numbers(number)
        total = torch.zeros((), dtype=torch.float64, device=self.device)
        self.network.train()
        for done, samples in enumerate(self.samples.batches(order)):
            inputs, targets = self.augmentation(self.network, samples, random)
            self.steps += 1
            self._set_rate()
            loss = nn.functional.mse_loss(self.network.outputs(inputs), targets)
            self.optimizer.zero_grad(set_to_none=True)
            loss.backward()
            self.optimizer.step()
            total += loss.detach()
            counts = ((done + 1) * self.batch_size, steps * self.batch_size)
            _progress.show(f"epoch {number}: samples", *counts, time.monotonic() - begun)
        losses = {"training_loss": self._unscaled(total) / steps, "test_loss": self.test_loss()}
        if not all(math.isfinite(loss) for loss in losses.values()):
            raise DermisError(f"a loss of epoch {number} is not finite", hint="give a smaller rate")
        epoch = {**losses, "seconds": time.monotonic() - begun}
        self.epochs.append(epoch)
        return epoch

    @torch.no_grad()
    def test_loss(self):
        """The mean square error on the test samples, whose noise is always the same."""
        self.network.eval()
        random = self._random_numbers(0)
        count = self.settings["test_samples"]
        numbers = np.arange(count, dtype=np.uint64)
        total = torch.zeros((), dtype=torch.float64, device=self.device)
        for samples in self.test_samples.batches(np.array_split(numbers, -(-count // self.batch_size))):
            inputs, targets = self.augmentation(self.network, samples, random)
            errors = (self.network.outputs(inputs) - targets).double()
            total += errors.square().mean(dim=1).sum()
        return self._unscaled(total) / count

    def _random_numbers(self, number):
        """The random numbers of an epoch; the number 0 is the test."""
        return _RandomNumbers([self.settings["options"]["seed"], number], self.device)

    def _set_rate(self):
        """The learning rate of the step, and Adam's epsilon."""
        for group in self.optimizer.param_groups:
            group["lr"] = self.training.rate(self.steps)
            # PyTorch adds it to the corrected deviation, Keras and `dermis train` to the uncorrected one.
            group["eps"] = _ADAM_EPSILON / math.sqrt(1 - _ADAM_BETAS[1] ** self.steps)

    def _unscaled(self, loss):
        """A loss in units of the target."""
        return float(loss) / self.settings["target_scale"] ** 2

    def save_checkpoint(self):
        """Writes what is needed to continue, completely or not at all."""
        state = {
            "settings": self._fixed(),
            "network": self.network.state_dict(),
            "optimizer": self.optimizer.state_dict(),
            "steps": self.steps,
            "epochs": self.epochs,
        }
        data = io.BytesIO()
        torch.save(state, data)
        self.checkpoint.parent.mkdir(parents=True, exist_ok=True)
        write_whole(self.checkpoint, data.getvalue())

    def resume(self):
        """Continues from the checkpoint, if there is one."""
        if not self.checkpoint.exists():
            return
        hint = "delete it or move it away to start again"
        try:
            state = torch.load(self.checkpoint, map_location="cpu", weights_only=True)
            if state["settings"] == self._fixed():
                self.network.load_state_dict(state["network"])
                self.optimizer.load_state_dict(state["optimizer"])
                self.steps, self.epochs = state["steps"], state["epochs"]
                return
        except Exception as error:  # pickle raises errors of many types
            raise DermisError(f"{self.checkpoint} is damaged: {error}", hint=hint) from error
        raise DermisError(f"{self.checkpoint} is of another training", hint=hint)

    def _fixed(self):
        """What a continued training must have in common with its checkpoint: all but the number of epochs."""
        options = {key: value for key, value in self.settings["options"].items() if key != "epochs"}
        return json.dumps({**self.settings, "options": options}, sort_keys=True)


class _Samples:
    """Training or test samples, kept in the memory of a GPU if they fit."""

    def __init__(self, training, device, names, count, *, test):
        self.training, self.device, self.names, self.test = training, device, names, test
        self.kept = self._all(count) if device.type == "cuda" and self._fits(count) else None

    def _fits(self, count):
        """Whether all samples fit; a stream has no end."""
        if self.training.is_stream:
            return False
        few = np.arange(min(count, 64), dtype=np.uint64)
        bytes_of_few = sum(values.nbytes for values in next(self._read([few])).values())
        free, _ = torch.cuda.mem_get_info(self.device)
        return count / len(few) * bytes_of_few < _MEMORY_FRACTION * free

    def _all(self, count):
        kept, first = {}, 0
        for part in self._read(np.split(np.arange(count, dtype=np.uint64), range(_READ_BATCH, count, _READ_BATCH))):
            if "touches" in part and kept:
                most = max(values["touches"].shape[1] for values in (kept, part))
                for values in (kept, part):
                    values["touches"] = nn.functional.pad(values["touches"], (0, 0, 0, most - values["touches"].shape[1]))
            last = first + len(part["difference"])
            for name, values in part.items():
                if name not in kept:
                    kept[name] = torch.zeros((count, *values.shape[1:]), dtype=values.dtype, device=self.device)
                kept[name][first:last] = values
            first = last
        return kept

    def batches(self, numbers):
        """The samples of each row of numbers, on the device."""
        if self.kept is None:
            yield from self._read(numbers)
            return
        for row in numbers:
            row = torch.from_numpy(row.astype(np.int64)).to(self.device)
            yield {name: values[row] for name, values in self.kept.items()}

    def _read(self, numbers):
        """Reads the next batch while the device works on the last one."""
        read = lambda row: self.training.batch(row, test=self.test)
        with ThreadPoolExecutor(1) as thread:
            pending = None
            for row in [*numbers, None]:
                current, pending = pending, None if row is None else thread.submit(read, row)
                if current is not None:
                    arrays = current.result()
                    yield {name: torch.from_numpy(arrays[name]).to(self.device) for name in self.names & arrays.keys()}


class _RandomNumbers:
    """Random numbers of a seed on a device."""

    def __init__(self, seed, device):
        # PyTorch's generator of the CPU uses 32 bits of a seed.
        (state,) = np.random.SeedSequence(seed).generate_state(1)
        self.device = device
        self.generator = torch.Generator(device).manual_seed(int(state))
        # Numbers that decide about shapes are drawn where the shapes are needed.
        self.on_host = torch.Generator("cpu").manual_seed(int(state))

    def normal(self, *shape):
        return torch.randn(shape, generator=self.generator, device=self.device, dtype=torch.float32)

    def uniform(self, low, high, *shape):
        unit = torch.rand(shape, generator=self.generator, device=self.device, dtype=torch.float32)
        return low + (high - low) * unit

    def integers(self, below, count):
        return torch.randint(below, (count,), generator=self.on_host, device="cpu")


class _Augmentation(nn.Module):
    """Inputs and targets of samples: moved by symmetries, with noise and drift, as the preset of the training says."""

    def __init__(self, settings, augmentation):
        super().__init__()
        self.noise, self.target, self.scale = settings["noise"], settings["target"], settings["target_scale"]
        self.randomization = self.noise.get("misfit")
        self.is_scale_free = bool(settings["input"].get("scale_free"))
        self.period = augmentation["period"]
        # What it needs of samples.
        self.names = {"difference", "image", "touches"}
        if self.noise["coat_drift"] > 0 or self.randomization:
            self.names.add("rest")
        self.register_buffer("sd", torch.tensor(self.noise["sd_ohm"], dtype=torch.float32))
        for name in ("frames", "motions", "contacts", "pixels"):
            self.register_buffer(name, torch.from_numpy(augmentation[name]).float())

    def forward(self, network, samples, random):
        """Inputs (n, inputs) and scaled targets (n, pixels) of samples."""
        difference, rest = samples["difference"], samples.get("rest")
        motions = None
        if len(self.frames):
            elements = random.integers(len(self.frames), len(difference))
            motions = self.motions[elements.to(self.motions.device)]
            difference = self._moved(difference, elements)
            rest = rest if rest is None else self._moved(rest, elements)
        if self.randomization:
            difference = self._randomize_gains(difference, samples["rest"], random)
        inputs = network.normalized(self._disturb(difference, rest, random))
        if self.randomization:
            inputs = self._randomize_inputs(inputs, random)
        inputs, sizes = network.take_size(inputs)
        if "image" in samples:
            target = samples["image"] / sizes
        else:
            target = self._spots(samples["touches"], motions)
        return inputs, self.scale * target

    def _moved(self, frames, elements):
        """Frames moved by a symmetry each: those with the same symmetry by one product of matrices."""
        order = elements.argsort()
        counts = torch.bincount(elements, minlength=len(self.frames)).tolist()
        order = order.to(frames.device)
        parts = [part @ symmetry.T for part, symmetry in zip(frames[order].split(counts), self.frames)]
        moved = torch.empty_like(frames)
        moved[order] = torch.cat(parts)
        return moved

    def _disturb(self, difference, rest, random):
        """Drift of coat and contacts since the untouched frame, and white noise."""
        count, noise = len(difference), self.noise
        if noise["coat_drift"] > 0 or len(self.contacts):
            age = random.normal(count, 1).abs().clamp(max=1)
            if noise["coat_drift"] > 0:
                difference = difference + age * noise["coat_drift"] * random.normal(count, 1) * rest
            difference = difference + (age * random.normal(count, len(self.contacts))) @ self.contacts
        low, high = noise["factor"]
        factor = low * (high / low) ** random.uniform(0, 1, count, 1)
        return difference + factor * self.sd * random.normal(*difference.shape)

    def _randomize_gains(self, difference, rest, random):
        """A uniform change of the whole coat, in proportion to the untouched frame, and gain errors of the channels."""
        size = lambda values: values.square().sum(dim=1, keepdim=True).sqrt()
        share = random.uniform(*self.randomization["whole"], len(difference), 1)
        share = share * size(difference) / size(rest).clamp_min(_TINY)
        share = torch.copysign(share, (rest * difference).sum(dim=1, keepdim=True))
        gains = (self.randomization["loudness_sd"] * random.normal(*difference.shape)).exp()
        return (difference + share * rest) * gains

    def _randomize_inputs(self, inputs, random):
        """Noise of the inputs, and missing inputs."""
        count = len(inputs)
        sd = random.uniform(*self.randomization["relative"], count, 1) * inputs.square().mean(dim=1, keepdim=True).sqrt()
        missing = self.randomization["missing"] * random.uniform(0, 1, count, 1)
        noisy = inputs + sd * random.normal(*inputs.shape)
        return torch.where(random.uniform(0, 1, *inputs.shape) < missing, 0.0, noisy)

    def _spots(self, touches, motions):
        """Each touch as a Gaussian, its height the square root of its size, (n, pixels)."""
        centres, sizes = touches[..., :3], touches[..., 3]
        if motions is not None:
            centres = centres @ motions[:, :, :3].mT + motions[:, None, :, 3]
        if self.is_scale_free:
            sizes = sizes / sizes.sum(dim=1, keepdim=True).clamp_min(_TINY)
        if self.period is not None:
            angle = torch.atan2(centres[..., 1], centres[..., 0])
            zero = torch.zeros_like(angle)
            centres = torch.stack([angle * (self.period / math.tau), centres[..., 2], zero], dim=-1)
        step = (centres[:, :, None] - self.pixels).abs()
        if self.period is not None:
            around = torch.minimum(step[..., 0], self.period - step[..., 0])
            step = torch.cat([around[..., None], step[..., 1:]], dim=-1)
        spots = torch.exp(step.square().sum(dim=-1) * (-0.5 / self.target["touches"]["width_m"] ** 2))
        return (sizes.sqrt()[..., None] * spots).sum(dim=1)
