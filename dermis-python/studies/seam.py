"""Two flat skins side by side: touches that slide over their seam, and two fingers 60 mm apart at it.

python dermis-python/studies/seam.py [--gap-mm 2] [--count 60] [--json]

A touch is a Gaussian change of conductance, of which each skin has the part that lies on it: the model of touch is that of the method.
"""

import argparse
import json
import sys
import tempfile
from pathlib import Path

import numpy as np

import dermis
import dermis.commands

RATE_HZ = 120.0
# A touch farther from a skin than this changes nothing there, m: four widths of the widest.
REACH_M = 0.038


class Pair:
    """Two skins of one design, the second behind the first along x."""

    def __init__(self, skin, path, random, shift_m):
        self.skin, self.random, self.shift_m = skin, random, shift_m
        self.rest = skin.forward()
        self.noise = np.abs(self.rest).mean() * 10 ** (-random.uniform(50, 70) / 20)
        self.robot = dermis.Robot(path)
        self.pipelines = {name: dermis.Pipeline(skin, tare_frames=100, force=True) for name in ("a", "b")}
        self.time_s = 1000.0
        for _ in range(125):
            self.snapshot(np.zeros((0, 2)), 0.5, 0.008)

    def snapshot(self, places, amplitude, width_m):
        """The robot after a frame of both skins with touches at places of the first, (touches, 2), m."""
        for name, pipeline in self.pipelines.items():
            shifted = places - [self.shift_m if name == "b" else 0.0, 0.0]
            low, high = self.skin.mesh.nodes[:, 0].min(), self.skin.mesh.nodes[:, 0].max()
            near = shifted[(shifted[:, 0] > low - REACH_M) & (shifted[:, 0] < high + REACH_M)]
            values = self.rest
            if len(near):
                at = np.c_[near, np.zeros(len(near))]
                values = self.skin.forward(self.skin.touched_conductivity(at, amplitude=amplitude, width_m=width_m))
            noisy = values + self.noise * self.random.standard_normal(len(values))
            self.robot.feed(name, pipeline.process(noisy, self.time_s), self.time_s)
        self.time_s += 1 / RATE_HZ
        return self.robot.snapshot(self.time_s)


def slide(pair, edge_m, gap_m, span_m):
    """A slide over the seam: ids, errors, and strengths near the seam over those elsewhere."""
    random = pair.random
    amplitude, width_m, speed_m_s = random.uniform(0.2, 0.8), random.uniform(0.005, 0.010), random.uniform(0.05, 0.2)
    y_m = random.uniform(span_m[0] + 0.03, span_m[1] - 0.03)
    ids, errors, near, far = set(), [], [], []
    for x_m in np.arange(edge_m - 0.05, edge_m + gap_m + 0.05, speed_m_s / RATE_HZ):
        contacts = pair.snapshot(np.array([[x_m, y_m]]), amplitude, width_m)["contacts"]
        ids |= {contact["id"] for contact in contacts}
        if contacts:
            off = [np.hypot(c["position_link_m"][0] - x_m, c["position_link_m"][1] - y_m) for c in contacts]
            errors.append(min(off))
            is_near = abs(x_m - edge_m - gap_m / 2) < 0.02
            (near if is_near else far).append(sum(contact["strength"] for contact in contacts))
    ratios = np.array(near) / np.median(far)
    return len(ids), np.mean(errors), np.mean(np.abs(ratios - 1) < 0.25)


def fingers(pair, edge_m, gap_m, span_m):
    """Two fingers 60 mm apart about the seam: the number of contacts after 20 frames."""
    random = pair.random
    amplitude, width_m, angle = random.uniform(0.2, 0.8), random.uniform(0.005, 0.010), random.uniform(0, 2 * np.pi)
    middle = [edge_m + gap_m / 2 + random.uniform(-0.01, 0.01), np.mean(span_m) + random.uniform(-0.02, 0.02)]
    half = 0.03 * np.array([np.cos(angle), np.sin(angle)])
    for _ in range(20):
        contacts = pair.snapshot(np.array([middle + half, middle - half]), amplitude, width_m)["contacts"]
    return len(contacts)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--gap-mm", type=float, default=2.0, help="width of the seam")
    parser.add_argument("--count", type=int, default=60, help="slides, and pairs of fingers")
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        design, path = Path(folder) / "plate.toml", Path(folder) / "plates.toml"
        dermis.commands.new("rectangle", output=str(design))
        skin = dermis.Skin.load(design)
        nodes, gap_m = skin.mesh.nodes, 1e-3 * given.gap_mm
        edge_m, span_m = nodes[:, 0].max(), (nodes[:, 1].min(), nodes[:, 1].max())
        text = 'name = "plates"\nage_s = 0.1\n'
        for name, x_m in (("a", 0.0), ("b", edge_m + gap_m)):
            place = f'link = "plate"\norigin = {{ xyz_m = [{x_m}, 0, 0] }}\nsource = "emulate"\n'
            text += f'[[skin]]\nname = "{name}"\ndesign = "plate.toml"\n{place}'
        path.write_text(text)
        random, slides, pairs = np.random.default_rng(given.seed), [], []
        for number in range(given.count):
            print(f"\r{number + 1} of {given.count}", end="", file=sys.stderr, flush=True)
            slides.append(slide(Pair(skin, path, random, edge_m + gap_m), edge_m, gap_m, span_m))
            pairs.append(fingers(Pair(skin, path, random, edge_m + gap_m), edge_m, gap_m, span_m))
        print(file=sys.stderr)
    ids, errors_m, within = map(np.array, zip(*slides))
    rows = {
        "slides with one id, %": 100 * np.mean(ids == 1),
        "position error mean, mm": 1e3 * errors_m.mean(),
        "frames near the seam whose strength is within 25 %, %": 100 * within.mean(),
        "two fingers 60 mm apart are two, %": 100 * np.mean(np.array(pairs) == 2),
    }
    print(json.dumps(rows) if given.json else "\n".join(f"{name:56} {value:.1f}" for name, value in rows.items()))


if __name__ == "__main__":
    main()
