"""Runs the comparison that `run.sh` describes: agreement first, then the programs take turns, medians at the end."""

import argparse
import contextlib
import csv
import functools
import io
import itertools
import multiprocessing
import os
import pathlib
import subprocess
import sys
import tempfile
import time
import warnings

import numpy as np

from page import CORES, OURS, Program, machine, write_page
from peers import SUPERLU_ORDERS, Cholmod, PyEit, ScikitFem, SciPy, made

CASES = ["cylinder30", "disk30", "cylinder30-20k", "disk30-20k"]
# Two programs that solve the same equations differ by rounding, amplified by the system's condition (about 1e5).
AGREEMENT = 1e-9
# The command of the tables, as every table of the documents has it.
MARK = "<!-- table: bench/peers/run.sh -->"
FORWARD_BAR, BATCHED_BAR = 1.0, 8.0
BATCHED_AIM = {False: 15.0, True: 12.0}  # at 5,000 nodes, at 20,000
JACOBIAN_BAR_MS = 30.0
PACKAGES = ("scikit-sparse", "scikit-fem", "pyeit", "numpy", "scipy")
# A turn of a program lasts about so long, but for at least one frame.
TURN_S = 0.05


class Arrays:
    """What `dermis-bench` wrote."""

    def __init__(self, case, folder):
        self.case = case
        load = lambda name: np.load(pathlib.Path(folder) / f"{name}.npy")
        whole = lambda name: np.rint(load(name)).astype(np.int64)
        self.nodes, self.cells = load("nodes"), whole("cells")
        self.electrode_parts, self.channels = whole("electrode_parts"), whole("channels")
        self.contact_impedances = load("contact_impedances")
        self.conductivities, self.voltages = load("conductivities"), load("voltages")
        self.voltages_batched = load("voltages_batched").T


class Timed:
    """A program, how well it agrees, and its times per sample: on one core, and on two that work side by side."""

    def __init__(self, name, agreement, one, two, close):
        self.name, self.agreement, self.one, self.two, self.close = name, agreement, one, two, close
        self.on_one, self.on_two = [], []

    def median(self):
        return np.median(self.on_one)


def timed(peer, conductivities):
    times = []
    for conductivity in conductivities:
        start = time.perf_counter()
        peer.frame(conductivity)
        times.append(time.perf_counter() - start)
    return times


def check_agreement(problem, name, frames):
    worst = max(np.linalg.norm(a - b) / np.linalg.norm(b) for a, b in zip(frames, problem.voltages))
    print(f"{problem.case}: {name} agrees to {worst:.1e}", flush=True)
    if not worst <= AGREEMENT:
        sys.exit(f"{problem.case}: {name} differs by {worst:.1e}, more than {AGREEMENT:.0e}: nothing is timed")
    return worst


def fastest(arrays, recipes):
    """The fastest of a program's ways on this problem: its time, how to make it, the program."""
    tried = []
    for recipe in recipes:
        with contextlib.suppress(Exception):
            peer = made(arrays, recipe)
            timed(peer, arrays.conductivities[:1])
            tried.append((np.median(timed(peer, arrays.conductivities[1:4])), recipe, peer))
    tried.sort(key=lambda trial: trial[0])
    for seconds, _, peer in tried:
        print(f"{arrays.case}: {peer.name}: {1e3 * seconds:.2f} ms", flush=True)
    return tried[0]


def peers(arrays):
    """The programs for this problem, each by its fastest way."""
    if arrays.case.endswith("-points"):
        return [fastest(arrays, [(PyEit,)])]
    ways = itertools.product(("simplicial", "supernodal"), ("amd", "colamd", "metis", "nesdis", "best"))
    return [
        fastest(arrays, [(Cholmod, *way) for way in ways]),
        fastest(arrays, [(SciPy, order) for order in SUPERLU_ORDERS]),
        fastest(arrays, [(ScikitFem, order) for order in SUPERLU_ORDERS]),
    ]


def work(arrays, recipe, core, pipe):
    """A process of its own with a program of its own; each number it is sent is a count of frames."""
    os.sched_setaffinity(0, {core})
    warnings.simplefilter("ignore")
    peer = made(arrays, recipe)
    timed(peer, arrays.conductivities[:1])
    pipe.send("ready")
    for count in iter(pipe.recv, 0):
        start = time.perf_counter()
        timed(peer, arrays.conductivities[:count])
        pipe.send((start, time.perf_counter()))


class Pair:
    """Two processes with the same program, a core each."""

    def __init__(self, arrays, recipe):
        # Not forked: a forked OpenBLAS waits for threads that are not there.
        context, self.pipes = multiprocessing.get_context("spawn"), []
        for core in CORES[-2:]:
            here, there = context.Pipe()
            context.Process(target=work, args=(arrays, recipe, core, there), daemon=True).start()
            self.pipes.append(here)
        for pipe in self.pipes:
            pipe.recv()

    def time(self, count):
        """Seconds per sample where both make so many frames: from the first one's start to the last one's end."""
        for pipe in self.pipes:
            pipe.send(count)
        spans = np.array([pipe.recv() for pipe in self.pipes])
        return [(spans[:, 1].max() - spans[:, 0].min()) / (2 * count)]

    def close(self):
        for pipe in self.pipes:
            pipe.send(0)


def entrants(arrays, program):
    """All programs, ours first, each with how to time a turn of it."""

    def ours(name, command, samples, agreement):
        (trial,) = program.times(f"{command} 1")
        count = max(1, round(TURN_S / (trial * samples)))
        one = lambda turn: program.times(f"{command} {count}")
        two = lambda turn: program.times(f"{command}-on 2 {count}")
        return Timed(name, agreement, one, two, close=lambda: None)

    def theirs(seconds, recipe, peer):
        # pyEIT takes seconds a frame on the finer meshes: three frames agree or do not.
        few = arrays.conductivities[: 3 if seconds > 1.0 else None]
        agreement = check_agreement(arrays, peer.name, [peer.frame(conductivity) for conductivity in few])
        count = int(np.clip(round(TURN_S / seconds), 1, 8))
        one = lambda turn: timed(peer, np.roll(arrays.conductivities, -turn, axis=0)[:count])
        pair = functools.cache(lambda: Pair(arrays, recipe))
        return Timed(peer.name, agreement, one, lambda turn: pair().time(count), close=lambda: pair().close())

    batched = check_agreement(arrays, "dermis, batched,", arrays.voltages_batched)
    return [
        ours("dermis, batched", "batched", 8, batched),
        ours("dermis, single", "forward", 1, 0.0),
        *(theirs(*chosen) for chosen in peers(arrays)),
    ]


def compare(case, rounds):
    with tempfile.TemporaryDirectory() as folder:
        os.sched_setaffinity(0, CORES[-1:])
        program = Program(["serve", case, folder])
        arrays = Arrays(case, folder)
        entries = entrants(arrays, program)
        jacobian = []
        turn_s = sum(np.median(entry.one(0)) for entry in entries)
        rounds = int(np.clip(round(15.0 / turn_s), 3, rounds))
        for turn in range(rounds):
            for entry in entries:
                entry.on_one += entry.one(turn)
            if is_small(case):
                jacobian += program.times("jacobian 2")
        if len(CORES) > 1:
            for process in (0, program.process.pid):
                os.sched_setaffinity(process, CORES[-2:])
            for turn in range(max(2, rounds // 3)):
                for entry in entries:
                    entry.on_two += entry.two(turn)
            for entry in entries:
                entry.close()
        program.close()
        print(f"{case}: {', '.join(f'{entry.name} {1e3 * entry.median():.3g} ms' for entry in entries)}", flush=True)
        return {"case": case, "nodes": len(arrays.nodes), "cells": len(arrays.cells), "entries": entries,
                "jacobian": np.array(jacobian)}


def is_small(case):
    """Whether the bar for the Jacobian is meant for it."""
    return "20k" not in case and not case.endswith("-points")


def milliseconds(seconds):
    if not len(seconds):
        return "-"
    return f"{1e3 * np.median(seconds):.3g} ({1e3 * np.min(seconds):.3g})"


def times_table(results):
    lines = [
        MARK,
        "| mesh | nodes | cells | program | largest difference from ours | one core, ms per sample: median (fastest) | two cores, ms per sample | time over that of dermis batched, one core (two) |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for row in results:
        ours = row["entries"][0]
        for entry in row["entries"]:
            agreement = f"{entry.agreement:.0e}" if entry.agreement else "-"
            ratio = f"{entry.median() / ours.median():.3g}"
            if entry.on_two:
                ratio += f" ({np.median(entry.on_two) / np.median(ours.on_two):.3g})"
            lines.append(
                f"| `{row['case']}` | {row['nodes']:,} | {row['cells']:,} | {entry.name} | {agreement} "
                f"| {milliseconds(entry.on_one)} | {milliseconds(entry.on_two)} | {ratio} |"
            )
    return lines


def jacobian_table(results):
    lines = [MARK, "| mesh | nodes | Jacobian 870 x pixels, with factorization, ms: median (fastest) |", "|---|---|---|"]
    rows = [row for row in results if len(row["jacobian"])]
    return lines + [f"| `{row['case']}` | {row['nodes']:,} | {milliseconds(row['jacobian'])} |" for row in rows]


def cost_tables():
    """How the time per sample grows, from `dermis-bench cost`."""
    os.sched_setaffinity(0, CORES[-1:])
    text = subprocess.run([OURS, "cost"], stdout=subprocess.PIPE, text=True, check=True).stdout
    rows = list(csv.DictReader(io.StringIO(text)))
    levels = list(dict.fromkeys(row["level"] for row in rows))
    by_level = [[row for row in rows if row["level"] == level] for level in levels]
    names = {"plain": "plain", "avx2": "AVX2", "avx512": "AVX-512", "neon": "NEON"}
    lines = [MARK,
             "| nodes | cells | entries of the factor | million multiply-adds | single, ms | "
             + " | ".join(f"batched, {names[level]}, ms per sample" for level in levels) + " | multiply-adds per second of the last, 1e9 |",
             "|---" * (6 + len(levels)) + "|"]
    for same in zip(*by_level):
        row, times = same[0], [float(row["batched_ms"]) for row in same]
        work = float(row["multiply_adds"])
        lines.append(
            f"| {int(row['nodes']):,} | {int(row['cells']):,} | {int(row['factor_entries']):,} | {work / 1e6:.2f} "
            f"| {float(row['single_ms']):.3g} | " + " | ".join(f"{time:.3g}" for time in times) + f" | {work / times[-1] / 1e6:.1f} |"
        )
    exponent = lambda key, own: np.polyfit(*np.log([[float(row[k]) for row in own] for k in ("nodes", key)]), 1)[0]
    first = [exponent(key, by_level[0]) for key in ("cells", "factor_entries", "multiply_adds", "single_ms")]
    last = [exponent("batched_ms", own) for own in by_level]
    lines.append("| exponent | " + " | ".join(f"{value:.2f}" for value in first + last) + " | |")
    return lines


def missed_bars(results):
    missed = []
    for row in results:
        batched, single, *others = row["entries"]
        for peer in (other for other in others if other.name.startswith("CHOLMOD")):
            ratio = single.median() / peer.median()
            print(f"{row['case']}: single {ratio:.2f} times {peer.name} (bar {FORWARD_BAR})")
            if not ratio <= FORWARD_BAR:
                missed.append(f"{row['case']}: forward {ratio:.2f} times {peer.name}, bar {FORWARD_BAR}")
            speed, aim = peer.median() / batched.median(), BATCHED_AIM["20k" in row["case"]]
            print(f"{row['case']}: batched, per core, {speed:.1f} times as fast as {peer.name} (bar {BATCHED_BAR:.0f}, aim {aim:.0f})")
            if not speed >= BATCHED_BAR:
                missed.append(f"{row['case']}: batched {speed:.1f} times as fast as {peer.name}, bar {BATCHED_BAR:.0f}")
        if len(row["jacobian"]) and not 1e3 * np.median(row["jacobian"]) <= JACOBIAN_BAR_MS:
            missed.append(f"{row['case']}: Jacobian {1e3 * np.median(row['jacobian']):.1f} ms, bar {JACOBIAN_BAR_MS}")
    return missed


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--write", action="store_true", help="put the tables into docs/benchmarks.md")
    parser.add_argument("--rounds", type=int, default=20)
    parser.add_argument("--cases", nargs="*", default=CASES)
    arguments = parser.parse_args()
    warnings.simplefilter("ignore")
    begin, load = time.monotonic(), os.getloadavg()[0]
    cost = cost_tables()
    results = [compare(case + points, arguments.rounds) for case in arguments.cases for points in ("", "-points")]
    minutes = (time.monotonic() - begin) / 60
    busy = f"{minutes:.0f} minutes; load average before the run {load:.1f}."
    text = "\n".join([f"{machine(PACKAGES)} {busy}", "", *times_table(results), "", *jacobian_table(results), "", *cost])
    print(f"\n{text}\n")
    missed = missed_bars(results)
    if arguments.write:
        write_page(text)
    if missed:
        sys.exit("bars missed: " + "; ".join(missed))


if __name__ == "__main__":
    main()
