"""The program `dermis`."""

import signal
import sys

from dermis._dermis import run_program


def main() -> None:
    """Runs `dermis` with the arguments of this process."""
    # As for any program: Ctrl-C and a closed pipe end it.
    for name in ("SIGINT", "SIGPIPE"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_DFL)
    sys.exit(run_program(sys.argv))


if __name__ == "__main__":
    main()
