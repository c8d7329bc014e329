"""Training of networks: the recipe of `dermis train`, the steps on a device of PyTorch."""

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
from dermis.torch._network import Network

# Keras' default, as in `dermis train`.
_ADAM_EPSILON = 1e-7
# Samples that are read at once when all of them are moved to the device.
_BLOCK = 8192
# Share of the free memory of the device that samples may take.
_KEPT = 0.6
# Distance of the seeds of noise of two trainings; epoch n of a training has the n-th after its own, the test its own.
_SEEDS = 1 << 32
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
    are drawn on the device, from other random numbers: losses agree within the spread of seeds. The samples stay in the
    memory of a GPU if they fit. The folder is a model like any other: `dermis live --method ./folder`. An interrupted
    training continues after its last epoch when it is called again with the same arguments.

    Args:
        design: The path of a design file, or a shipped name.
        output: Folder for the model: `card.json`, `weights.safetensors`, `losses.svg`, `checkpoint.pt`.
        device: A device of PyTorch; the GPU if there is one, without it.
        on_epoch: Function that is called after each epoch with its losses: a dict with `training_loss`, `test_loss`
            and `seconds`.
        **options: The options of `dermis train`: `data` (a folder or several) or `stream`, `test`, `network`,
            `without`, `noise`, `epochs`, `epoch_samples`, `rate`, `seed`, `half`.

    Returns:
        The trained `Network`; `card["training"]["epochs"]` has the losses.

    Raises:
        DermisError: What `dermis train` refuses; a checkpoint of another training; a loss that is not finite.
    """
    if isinstance(options.get("data"), (str, Path)):
        options["data"] = [options["data"]]
    with tempfile.TemporaryDirectory(prefix="dermis-") as folder:
        line = words("train", [design], {**options, "output": output}, Path(folder))
        training = Training(line[1:])
    device = torch.device(device or ("cuda" if torch.cuda.is_available() else "cpu"))
    run = _Run(training, device)
    run.resume()
    while not training.is_done(json.dumps(run.epochs)):
        epoch = run.epoch()
        run.save_checkpoint()
        training.write_losses(json.dumps(run.epochs))
        if on_epoch is not None:
            on_epoch(epoch)
    training.save(run.network.weights(), json.dumps(run.epochs))
    return Network.load(training.output)


class _Run:
    """A network during training."""

    def __init__(self, training, device):
        self.training, self.device = training, device
        self.plan = json.loads(training.plan)
        self.batch_size = self.plan["options"]["batch"]
        self.network = Network(self.plan)
        self.network.load_weights(training.initial_weights())
        self.network.to(device)
        self.batches = _Batches(self.plan, training.augmentation()).to(device)
        self.optimizer = torch.optim.Adam(self.network.parameters(), eps=_ADAM_EPSILON)
        self.samples = _Samples(training, device, self.plan["samples"], test=False)
        self.test_samples = _Samples(training, device, self.plan["test_samples"], test=True)
        self.steps, self.epochs = 0, []
        self.checkpoint = Path(training.output) / "checkpoint.pt"

    def epoch(self):
        """One epoch of steps, then the test; returns its losses."""
        begun, number, steps = time.monotonic(), len(self.epochs) + 1, self.training.steps_per_epoch
        order = self.training.order(number)[: steps * self.batch_size].reshape(steps, self.batch_size)
        draw = self._draw(number)
        total = torch.zeros((), dtype=torch.float64, device=self.device)
        self.network.train()
        for done, samples in enumerate(self.samples.batches(order)):
            inputs, targets = self.batches(self.network, samples, draw)
            self.steps += 1
            for group in self.optimizer.param_groups:
                group["lr"] = self.training.rate(self.steps)
            loss = nn.functional.mse_loss(self.network.outputs(inputs), targets)
            self.optimizer.zero_grad(set_to_none=True)
            loss.backward()
            self.optimizer.step()
            total += loss.detach()
            counts = ((done + 1) * self.batch_size, steps * self.batch_size)
            _progress.show(f"epoch {number}: samples", *counts, time.monotonic() - begun)
        loss = self._unscaled(total) / steps
        if not math.isfinite(loss):
            raise DermisError(f"the loss of epoch {number} is not finite", hint="give a smaller rate")
        epoch = {"training_loss": loss, "test_loss": self.test_loss(), "seconds": time.monotonic() - begun}
        self.epochs.append(epoch)
        return epoch

    @torch.no_grad()
    def test_loss(self):
        """The mean square error on the test samples, whose noise is always the same."""
        self.network.eval()
        draw = self._draw(0)
        count = self.plan["test_samples"]
        numbers = np.arange(count, dtype=np.uint64)
        total = torch.zeros((), dtype=torch.float64, device=self.device)
        for samples in self.test_samples.batches(np.array_split(numbers, -(-count // self.batch_size))):
            inputs, targets = self.batches(self.network, samples, draw)
            errors = (self.network.outputs(inputs) - targets).double()
            total += errors.square().mean(dim=1).sum()
        return self._unscaled(total) / count

    def _draw(self, number):
        """The random numbers of an epoch; the number 0 is the test."""
        return _Draw((self.plan["options"]["seed"] * _SEEDS + number) % (1 << 63), self.device)

    def _unscaled(self, loss):
        """A loss in units of the target."""
        return float(loss) / self.plan["target_scale"] ** 2

    def save_checkpoint(self):
        """Writes what is needed to continue, completely or not at all."""
        partial = self.checkpoint.with_suffix(".part")
        self.checkpoint.parent.mkdir(parents=True, exist_ok=True)
        state = {
            "plan": self._fixed(),
            "network": self.network.state_dict(),
            "optimizer": self.optimizer.state_dict(),
            "steps": self.steps,
            "epochs": self.epochs,
        }
        torch.save(state, partial)
        partial.replace(self.checkpoint)

    def resume(self):
        """Continues from the checkpoint, if there is one."""
        if not self.checkpoint.exists():
            return
        try:
            state = torch.load(self.checkpoint, map_location=self.device, weights_only=True)
            fixed = state["plan"]
        except Exception as error:  # pickle raises errors of many types
            raise DermisError(f"{self.checkpoint} is damaged: {error}", hint="move it away to begin anew") from error
        if fixed != self._fixed():
            raise DermisError(f"{self.checkpoint} is of another training", hint="move it away to begin anew")
        self.network.load_state_dict(state["network"])
        self.optimizer.load_state_dict(state["optimizer"])
        self.steps, self.epochs = state["steps"], state["epochs"]

    def _fixed(self):
        """What a continued training must have in common with its checkpoint: all but the number of epochs."""
        options = {key: value for key, value in self.plan["options"].items() if key != "epochs"}
        return json.dumps({**self.plan, "options": options}, sort_keys=True)


class _Samples:
    """Training or test samples, kept in the memory of the device if it is a GPU and they fit."""

    def __init__(self, training, device, count, *, test):
        self.training, self.device, self.test = training, device, test
        self.kept = self._all(count) if device.type == "cuda" and self._fits(count) else None

    def _fits(self, count):
        """Whether all samples fit; a stream has no end."""
        if self.training.is_stream:
            return False
        bytes_of_one = sum(values.nbytes for values in self.training.batch([0], test=self.test).values())
        free, _ = torch.cuda.mem_get_info(self.device)
        return count * bytes_of_one < _KEPT * free

    def _all(self, count):
        parts = list(self._read(np.split(np.arange(count, dtype=np.uint64), range(_BLOCK, count, _BLOCK))))
        most = max((part["touches"].shape[1] for part in parts if "touches" in part), default=0)
        for part in parts:
            if "touches" in part:
                part["touches"] = nn.functional.pad(part["touches"], (0, 0, 0, most - part["touches"].shape[1]))
        return {name: torch.cat([part[name] for part in parts]) for name in parts[0]}

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
            coming = None
            for row in [*numbers, None]:
                ready, coming = coming, None if row is None else thread.submit(read, row)
                if ready is not None:
                    arrays = ready.result()
                    yield {name: torch.from_numpy(values).to(self.device) for name, values in arrays.items()}


class _Draw:
    """Random numbers of a seed on a device."""

    def __init__(self, seed, device):
        self.device = device
        self.generator = torch.Generator(device).manual_seed(seed)
        # Numbers that decide about shapes are drawn where the shapes are needed.
        self.on_host = torch.Generator().manual_seed(seed)

    def normal(self, *shape):
        return torch.randn(shape, generator=self.generator, device=self.device)

    def uniform(self, low, high, *shape):
        return low + (high - low) * torch.rand(shape, generator=self.generator, device=self.device)


class _Batches(nn.Module):
    """Inputs and targets of samples: moved by symmetries, with noise and drift, as the preset of the training says."""

    def __init__(self, plan, augmentation):
        super().__init__()
        self.noise, self.target, self.scale = plan["noise"], plan["target"], plan["target_scale"]
        self.is_scale_free = bool(plan["input"].get("scale_free"))
        self.period = augmentation["period"]
        self.register_buffer("sd", torch.tensor(self.noise["sd_ohm"]))
        for name in ("frames", "motions", "contacts", "pixels"):
            self.register_buffer(name, torch.from_numpy(augmentation[name]).float())

    def forward(self, network, samples, draw):
        """Inputs (n, inputs) and scaled targets (n, pixels) of samples."""
        difference, rest = samples["difference"], samples["rest"]
        motions = None
        if len(self.frames):
            difference, rest, motions = self._move(difference, rest, draw)
        misfit = self.noise.get("misfit")
        if misfit:
            difference = self._stretch(misfit, difference, samples["rest"], draw)
        inputs = network.normalized(self._disturb(difference, rest, draw))
        if misfit:
            inputs = self._blur(misfit, inputs, draw)
        inputs, sizes = network.take_size(inputs)
        if "image" in samples:
            target = samples["image"] / sizes
        else:
            target = self._spots(samples["touches"], motions)
        return inputs, self.scale * target

    def _move(self, difference, rest, draw):
        """Frames moved by a symmetry each, and the symmetries' motions (n, 3, 4).

        The order of the samples is random, so that samples with the same symmetry can be neighbours.
        """
        count = torch.bincount(
            torch.randint(len(self.frames), (len(difference),), generator=draw.on_host), minlength=len(self.frames)
        )
        move = lambda values: torch.cat([part @ map.T for part, map in zip(values.split(count.tolist()), self.frames)])
        motions = self.motions.repeat_interleave(count.to(self.motions.device), dim=0)
        has_drift = self.noise["coat_drift"] > 0
        return move(difference), move(rest) if has_drift else rest, motions

    def _disturb(self, difference, rest, draw):
        """Drift of coat and contacts since the untouched frame, and white noise."""
        count, noise = len(difference), self.noise
        if noise["coat_drift"] > 0 or len(self.contacts):
            age = draw.normal(count, 1).abs().clamp(max=1)
            difference = difference + age * noise["coat_drift"] * draw.normal(count, 1) * rest
            difference = difference + (age * draw.normal(count, len(self.contacts))) @ self.contacts
        low, high = noise["factor"]
        factor = low * (high / low) ** draw.uniform(0, 1, count, 1)
        return difference + factor * self.sd * draw.normal(*difference.shape)

    def _stretch(self, misfit, difference, rest, draw):
        """A uniform change of the whole coat, in proportion to the untouched frame, and gain errors of the channels."""
        size = lambda values: values.square().sum(dim=1, keepdim=True).sqrt()
        share = draw.uniform(*misfit["whole"], len(difference), 1) * size(difference) / size(rest).clamp_min(_TINY)
        share = torch.copysign(share, (rest * difference).sum(dim=1, keepdim=True))
        return (difference + share * rest) * (misfit["loudness_sd"] * draw.normal(*difference.shape)).exp()

    def _blur(self, misfit, inputs, draw):
        """Noise of the inputs, and missing inputs."""
        count = len(inputs)
        sd = draw.uniform(*misfit["relative"], count, 1) * inputs.square().mean(dim=1, keepdim=True).sqrt()
        missing = misfit["missing"] * draw.uniform(0, 1, count, 1)
        noisy = inputs + sd * draw.normal(*inputs.shape)
        return torch.where(draw.uniform(0, 1, *inputs.shape) < missing, 0.0, noisy)

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
            round = torch.minimum(step[..., 0], self.period - step[..., 0])
            step = torch.cat([round[..., None], step[..., 1:]], dim=-1)
        spots = torch.exp(step.square().sum(dim=-1) * (-0.5 / self.target["touches"]["width_m"] ** 2))
        return (sizes.sqrt()[..., None] * spots).sum(dim=1)
