"""The commands of the program `dermis`, from Python."""

import functools
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dermis._dermis import commands_json
from dermis._errors import DermisError


def command(name: str, *arguments: Any, **options: Any) -> Any:
    """Runs a command of the program `dermis` in a process of its own.

    The command is the same as on the command line: `dermis.command("benchmark", "cylinder30", method="noser", twins=2)`
    is `dermis benchmark cylinder30 --method noser --twins 2 --json`. Progress goes to standard error, as on the command line;
    an interrupt ends the process.

    Args:
        name: Name of the command, as in `dermis --help`; `robot check` has two words.
        *arguments: Positional arguments: names, paths.
        **options: Options by name, with underscores for hyphens; `for_` for `--for`. True gives an option without a value, None and False
            leave it out, a list gives several values. Arrays are written to temporary NPY files.

    Returns:
        The JSON that the command prints, as dicts and lists; text for commands without `--json`.

    Raises:
        DermisError: What the command refuses, with `hint` and `line`.
    """
    with tempfile.TemporaryDirectory(prefix="dermis-") as path:
        folder = Path(path)
        # These write their results to a file, or print them as JSON.
        writes = name in ("contacts", "forward", "reconstruct", "replay")
        if options_of(name).get("json") == "none" and not writes and not {"json", "jsonl"} & set(options):
            options["json"] = True
        line = words(name, arguments, options, folder)
        error = folder / "error.json"
        child = [sys.executable, "-m", "dermis._child", str(error), *line]
        ended = subprocess.run(child, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, check=False)
        if error.exists():
            raise DermisError(**json.loads(error.read_text()))
        if ended.returncode:
            raise DermisError(f"dermis {name} ended with the code {ended.returncode}")
    text = ended.stdout.decode()
    return json.loads(text) if options.get("json") and not writes else text


@functools.cache
def described() -> dict[str, dict[str, Any]]:
    """What each command does, and its arguments, by name."""
    return {described["name"]: described for described in json.loads(commands_json())}


def options_of(name: str) -> dict[str, str]:
    """What each option of a command takes, by name: `none`, `one`, `optional`, `several` or `repeated`."""
    if name not in described():
        raise DermisError(f"there is no command {name!r}", hint=f"one of {', '.join(sorted(described()))}")
    return {option["name"]: option["takes"] for option in described()[name]["arguments"] if not option["is_positional"]}


def words(name: str, arguments: Sequence[Any], options: dict[str, Any], folder: Path) -> list[str]:
    """The command line of a command; arrays are written to files in the folder."""
    takes, line = options_of(name), name.split()
    for key, value in options.items():
        option = key.removesuffix("_").replace("_", "-")
        if option not in takes:
            raise DermisError(f"{name} has no option {key!r}", hint=f"one of {', '.join(sorted(takes))}")
        line += _words(option, value, takes[option], folder)
    return [*line, "--", *(_word(argument, f"argument-{index}", folder) for index, argument in enumerate(arguments))]


def _words(option: str, value: Any, takes: str, folder: Path) -> list[str]:
    """The words of an option on the command line."""
    if value is None or value is False:
        return []
    if takes == "none" or (takes == "optional" and value is True):
        return [f"--{option}"]
    if isinstance(value, (list, tuple)) and takes in ("several", "repeated"):
        values = [_word(item, f"{option}-{index}", folder) for index, item in enumerate(value)]
        if takes == "several":
            return [f"--{option}", *values]
        return [f"--{option}={item}" for item in values]
    return [f"--{option}={_word(value, option, folder)}"]


def _word(value: Any, name: str, folder: Path) -> str:
    """A value on the command line; arrays are written to files."""
    if isinstance(value, (np.ndarray, list, tuple)):
        path = folder / f"{name}.npy"
        try:
            array = np.asarray(value)
            np.save(path, array if np.iscomplexobj(array) else array.astype(float))
        except (TypeError, ValueError) as error:
            raise DermisError(f"`{name}` is no array of numbers: {error}", hint="give numbers") from None
        return str(path)
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, (str, os.PathLike)):
        return os.fspath(value)
    if isinstance(value, (bool, int, float)):
        return repr(value)
    raise DermisError(f"`{name}` is a {type(value).__name__}", hint="give a text, a number, a path or an array")
