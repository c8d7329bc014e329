"""Runs the comparison that `learn.sh` describes: agreement first, then the programs take turns, medians at the end."""

import argparse
import json
import os
import pathlib
import subprocess
import sys
import tempfile
import time

import numpy as np
import onnxruntime
import torch

from page import CORES, ROOT, Program, machine, write_page

sys.path.append(str(ROOT / "examples"))
import load_model
import read_dataset

# The command of the tables, as every table of the documents has it.
MARK = "<!-- table: bench/peers/learn.sh -->"
NETWORKS = ("paper", "spots")
SAMPLES, BATCH, RATE = 14_400, 360, 1e-3
# A thirtieth is held out: what is left is one batch.
FEW = 372
# Rounding of float32; measured 1.3e-7.
LOSS_AGREEMENT = 1e-5
IMAGE_AGREEMENT = 1e-5
TRAINING_BAR, TRAINING_AIM = 1.0, 1.3
INFERENCE_BAR, P99_BAR_MS = 1.0, 0.3
# Steps of a turn, and frames.
STEPS, FRAMES = 20, 200


def ours(core_count, *arguments):
    """Our program on so many cores; a thread for each."""
    os.sched_setaffinity(0, CORES[-core_count:])
    return Program(arguments, {**os.environ, "RAYON_NUM_THREADS": str(core_count)})


class TorchTraining:
    """The paper's network in PyTorch: the same start, batch, noise and normalisation; fused Adam."""

    def __init__(self, folder, data):
        self.card, self.tensors = load_model.read(folder / "start")
        self.network = load_model.with_torch(self.card, self.tensors).train()
        self.adam = torch.optim.Adam(self.network.parameters(), lr=RATE, eps=1e-7, fused=True)
        manifest = json.loads((data / "manifest.json").read_text())
        held = [read_dataset.tensors(data / file["name"]) for file in manifest["files"]]
        self.differences = torch.from_numpy(np.concatenate([one["frames"] - one["rest"] for one in held]))
        self.images = torch.from_numpy(np.concatenate([one["images"] for one in held]))
        given = self.card["input"]
        self.mean, self.sd = torch.tensor(given["mean_ohm"]), torch.tensor(given["sd_ohm"])
        self.noise = torch.from_numpy(np.load(folder / "noise_ohm.npy").astype(np.float32))

    def losses(self, inputs, targets, count):
        """The losses of some steps on one batch without noise."""
        inputs, targets = (torch.from_numpy(values.astype(np.float32)) for values in (inputs, targets))
        losses = []
        for step in range(1, count + 1):
            # Keras adds epsilon before the correction of the mean squares, PyTorch after it.
            self.adam.param_groups[0]["eps"] = 1e-7 / (1 - 0.999**step) ** 0.5
            losses.append(self.step(inputs, targets))
        return np.array(losses)

    def step(self, inputs, targets):
        loss = torch.nn.functional.mse_loss(self.network(inputs), targets)
        self.adam.zero_grad(set_to_none=True)
        loss.backward()
        self.adam.step()
        return loss.item()

    def times(self, count):
        """Seconds of each of some steps, noise and normalisation included."""
        times = []
        for chosen in torch.randperm(len(self.differences))[: count * BATCH].view(count, BATCH):
            start = time.perf_counter()
            noisy = torch.addcmul(self.differences[chosen], torch.randn(BATCH, len(self.mean)), self.noise)
            self.step((noisy - self.mean) / self.sd, self.images[chosen])
            times.append(time.perf_counter() - start)
        return times


class OnnxInference:
    """Our exported file in ONNX Runtime, one thread; input and output stay where they are."""

    name = "ONNX Runtime"

    def __init__(self, folder, network):
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        self.session = onnxruntime.InferenceSession(folder / f"{network}.onnx", options, providers=["CPUExecutionProvider"])

    def image(self, difference):
        return self.session.run(None, {"difference_ohm": difference})[0]


class TorchInference:
    """The model's folder in PyTorch."""

    name = "PyTorch"

    def __init__(self, folder, network):
        self.card, tensors = load_model.read(folder / network)
        given = self.card["input"]
        self.groups = torch.tensor([group + group if len(group) == 1 else group for group in given["channels"]])
        self.each = all(len(group) == 1 for group in given["channels"])
        self.mean, self.sd = torch.tensor(given["mean_ohm"]), torch.tensor(given["sd_ohm"])
        self.network = load_model.with_torch(self.card, tensors).eval()

    @torch.inference_mode()
    def image(self, difference):
        x = torch.from_numpy(difference)
        if not self.each:
            x = x[:, self.groups].mean(dim=2)
        outputs = self.network((x - self.mean) / self.sd)
        if self.card["target"] != "conductance":
            outputs = outputs * outputs.abs()
        return outputs.numpy()


def simulate(folder, samples):
    program = [ROOT / "target/release/dermis", "simulate"]
    for arguments in (["cylinder30", "--samples", str(samples), "--seed", "1", "-o", folder], ["--finish", folder]):
        subprocess.run(program + arguments, check=True, stdout=subprocess.DEVNULL)


def check(what, worst, most):
    print(f"{what} agrees to {worst:.1e}", flush=True)
    if not worst <= most:
        sys.exit(f"{what} differs by {worst:.1e}, more than {most:.0e}: nothing is timed")
    return worst


def training(folder, data, rounds):
    """Samples a second of ours and of PyTorch's turns, and how well the losses agree."""
    program = ours(2, "training", data, folder / "few", folder)
    torch.set_num_threads(2)
    peer = TorchTraining(folder, data)
    load = lambda name: np.load(folder / f"{name}.npy")
    losses = peer.losses(load("batch_inputs"), load("batch_targets"), len(load("losses")))
    agreement = check("PyTorch's loss", np.abs(losses / load("losses") - 1).max(), LOSS_AGREEMENT)
    entries = {"dermis": [], "PyTorch, fused Adam": []}
    program.times(f"train {STEPS}"), peer.times(STEPS)
    for _ in range(rounds):
        entries["dermis"] += program.times(f"train {STEPS}")
        entries["PyTorch, fused Adam"] += peer.times(STEPS)
    program.close()
    return entries, agreement


def inference(folder, data, rounds):
    """For each network the times of one frame by each program, one core, and how well the images agree."""
    program = ours(1, "inference", data, folder)
    torch.set_num_threads(1)
    differences = np.load(folder / "differences.npy").astype(np.float32)
    results = {}
    for network in NETWORKS:
        images = np.load(folder / f"{network}_images.npy")
        peers = [OnnxInference(folder, network), TorchInference(folder, network)]
        agreements, times = [0.0], {"dermis": []}
        for peer in peers:
            theirs = np.concatenate([peer.image(difference[None]) for difference in differences])
            worst = np.abs(theirs - images).max() / np.abs(images).max()
            agreements.append(check(f"{network} network in {peer.name}", worst, IMAGE_AGREEMENT))
            times[peer.name] = []
        for turn in range(rounds + 1):
            own = {"dermis": program.times(f"infer {network} {FRAMES}")}
            own |= {peer.name: one_by_one(peer, differences) for peer in peers}
            # The first turn warms up.
            if turn:
                for name, seconds in own.items():
                    times[name] += seconds
        results[network] = (times, agreements)
    program.close()
    return results


def one_by_one(peer, differences):
    times = []
    for turn in range(FRAMES):
        difference = differences[turn % len(differences)][None]
        start = time.perf_counter()
        peer.image(difference)
        times.append(time.perf_counter() - start)
    return times


def training_table(entries, agreement):
    ours = np.median(entries["dermis"])
    lines = [MARK, "| program | largest difference of the losses of five steps | samples per second: median step (10th percentile) | speed over that of dermis |", "|---|---|---|---|"]
    for name, times in entries.items():
        speed, slow = BATCH / np.median(times), BATCH / np.quantile(times, 0.9)
        agrees = "-" if name == "dermis" else f"{agreement:.0e}"
        lines.append(f"| {name} | {agrees} | {speed:,.0f} ({slow:,.0f}) | {ours / np.median(times):.2f} |")
    return lines


def inference_table(results):
    lines = [MARK, "| network | program | largest difference from ours | one frame, one core, ms: median | 99th percentile | median over that of dermis |", "|---|---|---|---|---|---|"]
    for network, (times, agreements) in results.items():
        ours = np.median(times["dermis"])
        for (name, own), agreement in zip(times.items(), agreements):
            agrees = f"{agreement:.0e}" if agreement else "-"
            median, late = np.median(own), np.quantile(own, 0.99)
            lines.append(f"| {network} | {name} | {agrees} | {1e3 * median:.3f} | {1e3 * late:.3f} | {median / ours:.2f} |")
    return lines


def missed_bars(entries, results):
    missed = []

    def bar(what, value, holds, bar):
        print(f"{what}: {value:.3g} ({bar})")
        if not holds:
            missed.append(f"{what} {value:.3g}, {bar}")

    speed = np.median(entries["PyTorch, fused Adam"]) / np.median(entries["dermis"])
    bar("training, times PyTorch's speed", speed, speed >= TRAINING_BAR, f"bar {TRAINING_BAR}, aim {TRAINING_AIM}")
    for network, (times, _) in results.items():
        ratio = np.median(times["dermis"]) / np.median(times["ONNX Runtime"])
        late = 1e3 * np.quantile(times["dermis"], 0.99)
        bar(f"{network}: one frame, of ONNX Runtime's time", ratio, ratio <= INFERENCE_BAR, f"bar {INFERENCE_BAR}")
        bar(f"{network}: one frame, 99 of 100 within ms", late, late <= P99_BAR_MS, f"bar {P99_BAR_MS}")
    return missed


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--write", action="store_true", help="put the tables into docs/benchmarks.md")
    parser.add_argument("--rounds", type=int, default=15)
    arguments = parser.parse_args()
    load = os.getloadavg()[0]
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        data = folder / "data"
        simulate(data, SAMPLES)
        simulate(folder / "few", FEW)
        entries, agreement = training(folder, data, arguments.rounds)
        results = inference(folder, data, arguments.rounds)
    names = ("torch", "onnxruntime", "numpy")
    text = "\n".join([f"{machine(names)} Load average before the run {load:.1f}.", "", *training_table(entries, agreement), "", *inference_table(results)])
    print(f"\n{text}\n")
    missed = missed_bars(entries, results)
    if arguments.write:
        write_page(text, "networks")
    if missed:
        sys.exit("bars missed: " + "; ".join(missed))


if __name__ == "__main__":
    main()
