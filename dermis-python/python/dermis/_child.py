"""The process of `dermis.command`: runs a command, and writes its error as JSON to a file."""

import ctypes
import json
import signal
import sys
from pathlib import Path

from dermis._dermis import run_command
from dermis._errors import DermisError

# Of <linux/prctl.h>.
_PR_SET_PDEATHSIG = 1


def main(error: str, *line: str) -> None:
    """Runs a command; writes its error to the file `error`."""
    # As for any program: Ctrl-C ends it.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    # A command does not go on when its caller is killed.
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    try:
        run_command(["dermis", *line])
    except DermisError as raised:
        fields = {"message": raised.message, "hint": raised.hint, "line": raised.line, "field": raised.field}
        Path(error).write_text(json.dumps(fields))


if __name__ == "__main__":
    main(*sys.argv[1:])
