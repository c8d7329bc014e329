"""Runs the comparison that `run.sh` describes: agreement first, then the programs take turns, medians at the end."""

import argparse
import contextlib
import itertools
import pathlib
import platform
import subprocess
import sys
import tempfile
import time
import warnings
from importlib.metadata import version

import numpy as np
from pyeit.eit.fem import EITForward
from pyeit.eit.protocol import PyEITProtocol
from pyeit.mesh import PyEITMesh

from cem import Cholmod, System, unit_stiffness

ROOT = pathlib.Path(__file__).resolve().parents[2]
OURS = ROOT / "target/release/dermis-bench"
PAGE = ROOT / "docs/benchmarks.md"
# Two programs that solve the same equations differ by rounding, amplified by the system's condition (about 1e5).
AGREEMENT = 1e-9
FORWARD_BAR = 1.0
JACOBIAN_BAR_MS = 30.0


class Problem:
    """What `dermis-bench` wrote, and the running program itself."""

    def __init__(self, case, folder):
        self.case = case
        self.process = subprocess.Popen(
            [OURS, case, folder], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        ready = self.process.stdout.readline()
        if not ready.startswith("ready"):
            sys.exit(f"dermis-bench {case} did not start")
        load = lambda name: np.load(pathlib.Path(folder) / f"{name}.npy")
        whole = lambda name: np.rint(load(name)).astype(np.int64)
        self.nodes, self.cells = load("nodes"), whole("cells")
        self.electrode_parts, self.channels = whole("electrode_parts"), whole("channels")
        self.contact_impedances = load("contact_impedances")
        self.conductivities, self.voltages = load("conductivities"), load("voltages")

    def ours(self, command, count):
        """Times of our program in seconds."""
        self.process.stdin.write(f"{command} {count}\n")
        self.process.stdin.flush()
        return [float(word) for word in self.process.stdout.readline().split()]

    def close(self):
        self.process.stdin.close()
        self.process.wait()


class PyEit:
    """pyEIT's forward solver; its stiffness matrices, which know flat triangles only, replaced by ours in space."""

    name = "pyEIT"

    def __init__(self, problem):
        points = problem.electrode_parts[np.argsort(problem.electrode_parts[:, 0]), 1]
        free = next(node for node in range(len(problem.nodes)) if node not in set(points))
        mesh = PyEITMesh(node=problem.nodes, element=problem.cells, perm=1.0, el_pos=points, ref_node=free)
        drives, drive_of_channel = np.unique(problem.channels[:, :2], axis=0, return_inverse=True)
        measures = [problem.channels[drive_of_channel == drive, 2:] for drive in range(len(drives))]
        keep = np.ones(len(problem.channels), bool)
        self.solver = EITForward(mesh, PyEITProtocol(drives, np.array(measures), keep))
        self.solver.se = unit_stiffness(problem.nodes, problem.cells)
        self.order = np.argsort(drive_of_channel, kind="stable")

    def frame(self, conductivity):
        values = np.empty(len(self.order))
        values[self.order] = self.solver.solve_eit(conductivity)
        return values


def timed(peer, conductivities):
    times = []
    for conductivity in conductivities:
        start = time.perf_counter()
        peer.frame(conductivity)
        times.append(time.perf_counter() - start)
    return times


def check_agreement(problem, peer):
    worst = 0.0
    for conductivity, voltages in zip(problem.conductivities, problem.voltages):
        difference = np.linalg.norm(peer.frame(conductivity) - voltages) / np.linalg.norm(voltages)
        worst = max(worst, difference)
    print(f"{problem.case}: {peer.name} agrees to {worst:.1e}", flush=True)
    if not worst <= AGREEMENT:
        sys.exit(f"{problem.case}: {peer.name} differs by {worst:.1e}, more than {AGREEMENT:.0e}: nothing is timed")
    return worst


def best_cholmod(problem):
    """The fastest of CHOLMOD's ways on this problem."""
    system, tried = System(problem), []
    for mode, ordering in itertools.product(("simplicial", "supernodal"), ("amd", "colamd", "metis", "nesdis", "best")):
        with contextlib.suppress(Exception):
            peer = Cholmod(system, mode, ordering)
            timed(peer, problem.conductivities)
            tried.append((np.median(timed(peer, problem.conductivities)), peer))
    tried.sort(key=lambda pair: pair[0])
    for seconds, peer in tried:
        print(f"{problem.case}: CHOLMOD {peer.name}: {1e3 * seconds:.2f} ms")
    return tried[0][1]


def compare(case, rounds, with_cholmod):
    with tempfile.TemporaryDirectory() as folder:
        problem = Problem(case, folder)
        peer = best_cholmod(problem) if with_cholmod else PyEit(problem)
        agreement = check_agreement(problem, peer)
        ours, theirs, jacobian = [], [], []
        problem.ours("forward", 20)
        for index in range(rounds):
            ours += problem.ours("forward", 20)
            batch = problem.conductivities if with_cholmod else problem.conductivities[index % 8 :][:1]
            theirs += timed(peer, batch)
            jacobian += problem.ours("jacobian", 2)
        problem.close()
        return {
            "case": case,
            "nodes": len(problem.nodes),
            "cells": len(problem.cells),
            "peer": f"CHOLMOD ({peer.name})" if with_cholmod else "pyEIT",
            "agreement": agreement,
            "ours": np.array(ours),
            "theirs": np.array(theirs),
            "jacobian": np.array(jacobian),
        }


def milliseconds(seconds):
    return f"{1e3 * np.median(seconds):.3g} ({1e3 * np.min(seconds):.3g})"


def tables(results):
    lines = [
        "| mesh | nodes | cells | peer | outputs agree to | dermis, ms: median (fastest) | peer, ms | ratio of medians (of fastest) |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for row in results:
        ratio, fastest = (f(row["ours"]) / f(row["theirs"]) for f in (np.median, np.min))
        lines.append(
            f"| `{row['case']}` | {row['nodes']:,} | {row['cells']:,} | {row['peer']} | {row['agreement']:.0e} "
            f"| {milliseconds(row['ours'])} | {milliseconds(row['theirs'])} | {ratio:.2g} ({fastest:.2g}) |"
        )
    lines += ["", "| mesh | nodes | Jacobian 870 x pixels, factorisation included, ms: median (fastest) |", "|---|---|---|"]
    for row in results:
        if not row["case"].endswith("-points"):
            lines.append(f"| `{row['case']}` | {row['nodes']:,} | {milliseconds(row['jacobian'])} |")
    return "\n".join(lines)


def machine():
    model = next(
        (line.split(":")[1].strip() for line in open("/proc/cpuinfo") if line.startswith("model name")),
        platform.processor(),
    )
    versions = ", ".join(f"{name} {version(name)}" for name in ("scikit-sparse", "pyeit", "numpy", "scipy"))
    return f"{model}, one core; Python {platform.python_version()}, {versions}."


def write_page(text):
    page = PAGE.read_text()
    begin, end = "<!-- measured: begin -->", "<!-- measured: end -->"
    before, after = page.split(begin)[0], page.split(end)[1]
    PAGE.write_text(f"{before}{begin}\n{text}\n{end}{after}")


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--write", action="store_true", help="put the tables into docs/benchmarks.md")
    parser.add_argument("--rounds", type=int, default=20)
    parser.add_argument("--cases", nargs="*", default=["cylinder30", "disk30"])
    arguments = parser.parse_args()
    warnings.simplefilter("ignore")
    results = [compare(case, arguments.rounds, True) for case in arguments.cases]
    results += [compare(f"{case}-points", min(arguments.rounds, 8), False) for case in arguments.cases]
    text = f"{machine()}\n\n{tables(results)}"
    print(f"\n{text}\n")
    if arguments.write:
        write_page(text)
    missed = []
    for row in results:
        ratio = np.median(row["ours"]) / np.median(row["theirs"])
        if ratio > FORWARD_BAR:
            missed.append(f"{row['case']}: forward {ratio:.2f} times {row['peer']}, bar {FORWARD_BAR}")
        if 1e3 * np.median(row["jacobian"]) > JACOBIAN_BAR_MS and not row["case"].endswith("-points"):
            missed.append(f"{row['case']}: Jacobian {1e3 * np.median(row['jacobian']):.1f} ms, bar {JACOBIAN_BAR_MS}")
    if missed:
        sys.exit("bars missed: " + "; ".join(missed))


if __name__ == "__main__":
    main()
