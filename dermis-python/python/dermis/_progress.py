"""Progress of long work, on terminals and in notebooks."""

import sys


def show(what: str, done: int, steps: int, seconds: float) -> None:
    """Shows how many of the steps are done, and the time left."""
    if not sys.stderr.isatty() and "ipykernel" not in sys.modules:
        return
    left = f"{seconds / done * (steps - done):.0f} s left" if done else ""
    # What is complete is cleared.
    text = f"{what} {done}/{steps} {left}" if done < steps else ""
    sys.stderr.write(f"\r{text:<70}\r{text}")
    sys.stderr.flush()
