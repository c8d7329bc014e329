#!/usr/bin/env python3
"""Presses of forms that no model of Dermis has: `forms.py DERMIS [METHOD...]`. Needs NumPy and SciPy; some minutes.

Four skins (patches of 10, 12 and 14 mm, none), 24 frames of each form on each, 100 untouched frames, white noise at 62 dB.
Contacts belong to objects one to one within 20 mm. Prints for each form: objects, misses, false contacts, those of them with a
confidence above 0.9, the mean error of the objects' middles (mm) and the share within the stated 95 % regions.
"""

import csv
import subprocess
import sys
import tempfile
from collections import defaultdict
from pathlib import Path

import numpy as np
from scipy.optimize import linear_sum_assignment

from skin import ELECTRODES, RADIUS, Skin, turn

SKINS = [(1, 0.010), (2, 0.012), (3, 0.014), (4, None)]
FRAMES, UNTOUCHED, NOISE_DB, GATE_MM = 24, 100, 62, 20.0
# Standard deviations of the circle that holds 95 % of a round normal distribution.
REGION_95_SD = 2.4477


def ball(skin, z, theta, sd):
    along, around = skin.offsets(z, theta)
    return np.exp(-(along**2 + around**2) / (2 * sd**2))


def turned(skin, z, theta, angle):
    """The offsets of the nodes from a place along a direction and across it, m."""
    along, around = skin.offsets(z, theta)
    return np.cos(angle) * along + np.sin(angle) * around, np.cos(angle) * around - np.sin(angle) * along


def bar(skin, z, theta, half_length, angle, sd=0.003, ends=1.0):
    """An edge; `ends` is the pressure at its ends over the mean."""
    u, v = turned(skin, z, theta, angle)
    part = np.abs(u) / half_length
    inside = 1 / (1 + np.exp((np.abs(u) - half_length) / 0.0015))
    return np.exp(-(v**2) / (2 * sd**2)) * inside * (1 + (ends - 1) * (2 * part - 1))


def palm(skin, z, theta, half_length, half_width, angle):
    u, v = turned(skin, z, theta, angle)
    part = np.hypot(u / half_length, v / half_width)
    inside = 1 / (1 + np.exp((part - 1) * min(half_length, half_width) / 0.0015))
    return inside * np.sqrt(np.maximum(0.05, 1 - np.minimum(part, 1) ** 2))


def ring(skin, z, theta, radius, sd=0.003):
    along, around = skin.offsets(z, theta)
    return np.exp(-((np.hypot(along, around) - radius) ** 2) / (2 * sd**2))


def corner(skin, z, theta, leg, angle):
    """Two edges that meet at a right angle; the place is the middle of both."""
    total = 0
    for leg_angle in (angle, angle + np.pi / 2):
        u = np.array([np.cos(leg_angle), np.sin(leg_angle)]) - 0.5 * np.array(
            [np.cos(angle) - np.sin(angle), np.sin(angle) + np.cos(angle)]
        )
        total = total + bar(skin, z + leg / 2 * u[0], theta + leg / 2 * u[1] / RADIUS, leg / 2, leg_angle)
    return total


def pair(skin, random, apart):
    z, theta, angle = random.uniform(0.08, 0.22), random.uniform(0, 2 * np.pi), random.uniform(0, np.pi)
    step = 0.5 * apart * np.array([np.cos(angle), np.sin(angle) / RADIUS])
    places = [(z + step[0], theta + step[1]), (z - step[0], theta - step[1])]
    return [(random.uniform(1, 5), ball(skin, *place, 0.005)) for place in places], places


def single(form, force=(3, 15)):
    def objects(skin, random):
        place, angle = (random.uniform(0.04, 0.26), random.uniform(0, 2 * np.pi)), random.uniform(0, np.pi)
        return [(random.uniform(*force), form(skin, *place, angle))], [place]

    return objects


FORMS = {
    "ball, sd 4 mm": single(lambda s, z, t, a: ball(s, z, t, 0.004), (1, 5)),
    "palm, 40 x 29 mm": single(lambda s, z, t, a: palm(s, z, t, 0.020, 0.0145, a)),
    "palm, 80 x 50 mm": single(lambda s, z, t, a: palm(s, z, t, 0.040, 0.025, a), (9, 45)),
    "edge, 30 mm": single(lambda s, z, t, a: bar(s, z, t, 0.015, a)),
    "edge, 60 mm": single(lambda s, z, t, a: bar(s, z, t, 0.030, a)),
    "edge, 40 mm, pressed at its ends": single(lambda s, z, t, a: bar(s, z, t, 0.020, a, ends=1.8)),
    "corner, legs of 25 mm": single(lambda s, z, t, a: corner(s, z, t, 0.025, a)),
    "ring, 40 mm": single(lambda s, z, t, a: ring(s, z, t, 0.020)),
    "ring, 70 mm": single(lambda s, z, t, a: ring(s, z, t, 0.035)),
    "two balls, 28 to 40 mm apart": lambda s, r: pair(s, r, r.uniform(0.028, 0.040)),
    "two balls, 45 mm apart": lambda s, r: pair(s, r, 0.045),
    "ball, sd 4 mm, with drift": single(lambda s, z, t, a: ball(s, z, t, 0.004), (1, 5)),
    "untouched, with drift": lambda s, r: ([], []),
    "untouched, with three times the noise": lambda s, r: ([], []),
}
# Of the conductance since the untouched frames, at most: linear along the axis, and across it.
DRIFT = 0.01


def contacts(dermis, method, frames, untouched, folder):
    """By frame, the contacts: place, deviation (m) and confidence."""
    np.save(folder / "frames.npy", frames)
    np.save(folder / "untouched.npy", untouched)
    files = ["--frames", "frames.npy", "--baseline", "untouched.npy", "-o", "contacts.csv", "--quiet"]
    subprocess.run([dermis, "contacts", "cylinder30", *files, "--method", method], cwd=folder, check=True, stdout=subprocess.DEVNULL)
    found = defaultdict(list)
    with open(folder / "contacts.csv") as file:
        for row in csv.DictReader(file):
            found[int(row["frame"])].append([float(row[name]) for name in ("z_m", "theta_rad", "sd_m", "confidence")])
    return found


def scored(truth, found):
    """Objects, misses, false contacts, confident ones among them, the sum of the errors, those in their regions, matched."""
    if not found:
        return np.array([len(truth), len(truth), 0, 0, 0, 0, 0])
    distance = [[1e3 * np.hypot(z - one[0], RADIUS * turn(theta - one[1])) for one in found] for z, theta in truth]
    distance = np.array(distance).reshape(len(truth), len(found))
    pairs = [pair for pair in zip(*linear_sum_assignment(np.minimum(distance, 1e3))) if distance[pair] <= GATE_MM]
    others = set(range(len(found))) - {contact for _, contact in pairs}
    errors = [distance[pair] for pair in pairs]
    held = [error <= REGION_95_SD * 1e3 * found[contact][2] for error, (_, contact) in zip(errors, pairs)]
    confident = sum(found[contact][3] > 0.9 for contact in others)
    return np.array([len(truth), len(truth) - len(pairs), len(others), confident, sum(errors), sum(held), len(pairs)])


def main(dermis, methods):
    far = [len({d, (d + 1) % ELECTRODES, m, (m + 1) % ELECTRODES}) == 4
           for d in range(ELECTRODES) for m in range(ELECTRODES) if m != d]
    skins = [Skin(*skin) for skin in SKINS]
    print(f"{'form':38} {'method':8} objects misses false confident   mean  region")
    for number, (name, objects) in enumerate(FORMS.items()):
        totals = defaultdict(lambda: np.zeros(7))
        for skin, (seed, _) in zip(skins, SKINS):
            random = np.random.default_rng([seed, number])
            drawn = [objects(skin, random) for _ in range(FRAMES)]
            drifts = random.uniform(-DRIFT, DRIFT, (FRAMES, 2)) if name.endswith("with drift") else np.zeros((FRAMES, 2))
            pressures = [skin.pressure(pressed) if pressed else None for pressed, _ in drawn]
            frames = np.array([skin.frame(pressure, drift) for pressure, drift in zip(pressures, drifts)])
            sd = np.sqrt((skin.untouched[far] ** 2).mean()) * 10 ** (-NOISE_DB / 20)
            noisy = frames + random.normal(0, sd * (3 if name.endswith("the noise") else 1), frames.shape)
            untouched = skin.untouched + random.normal(0, sd, (UNTOUCHED, frames.shape[1]))
            for method in methods:
                with tempfile.TemporaryDirectory() as folder:
                    found = contacts(dermis, method, noisy, untouched, Path(folder))
                totals[method] += sum(scored(places, found[index]) for index, (_, places) in enumerate(drawn))
        for method, (count, misses, false, confident, errors, held, matched) in totals.items():
            mean, share = errors / max(matched, 1), 100 * held / max(matched, 1)
            print(f"{name:38} {method:8} {count:7.0f} {misses:6.0f} {false:5.0f} {confident:9.0f} {mean:6.2f} {share:5.0f} %", flush=True)


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    main(str(Path(sys.argv[1]).resolve()), sys.argv[2:] or ["refined", "noser"])
