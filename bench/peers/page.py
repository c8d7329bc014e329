"""What the comparisons share: our program, running; the machine; the page that holds the tables."""

import os
import pathlib
import platform
import subprocess
import sys
from importlib.metadata import version

ROOT = pathlib.Path(__file__).resolve().parents[2]
OURS = ROOT / "target/release/dermis-bench"
PAGE = ROOT / "docs/benchmarks.md"
CORES = sorted(os.sched_getaffinity(0))


class Program:
    """Our program, running."""

    def __init__(self, arguments, environment=None):
        self.process = subprocess.Popen(
            [OURS, *arguments], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment
        )
        ready = self.process.stdout.readline()
        if not ready.startswith("ready"):
            sys.exit(f"dermis-bench {' '.join(map(str, arguments))} did not start")

    def times(self, command):
        """Times of our program in seconds."""
        self.process.stdin.write(f"{command}\n")
        self.process.stdin.flush()
        return [float(word) for word in self.process.stdout.readline().split()]

    def close(self):
        self.process.stdin.close()
        self.process.wait()


def machine(names):
    """The machine with its widest instructions, and the versions of packages."""
    processor = {}
    for line in reversed(open("/proc/cpuinfo").readlines()):
        key, _, value = line.partition(":")
        processor[key.strip()] = value.strip()
    model = processor.get("model name", platform.processor())
    if "cpu family" in processor:
        model += f" (family {processor['cpu family']}, model {processor['model']})"
    flags = processor.get("flags", "").split()
    widest = next((name for flag, name in (("avx512f", "AVX-512"), ("avx2", "AVX2")) if flag in flags), None)
    model += f", {widest}" if widest else ""
    versions = ", ".join(f"{name} {version(name)}" for name in names)
    return f"{model}, {len(CORES)} cores; Python {platform.python_version()}, {versions}."


def write_page(text, section=""):
    """Puts tables between the marks of a section of the page."""
    page = PAGE.read_text()
    begin, end = (f"<!-- measured{section and ' ' + section}: {mark} -->" for mark in ("begin", "end"))
    before, after = page.split(begin)[0], page.split(end)[1]
    PAGE.write_text(f"{before}{begin}\n{text}\n{end}{after}")
