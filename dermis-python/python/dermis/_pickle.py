"""Copies of objects in other processes."""

from os import PathLike
from pathlib import Path
from tempfile import TemporaryDirectory

from dermis._dermis import Calibration, Method, Skin


def method(skin: Skin, name: str | PathLike[str], alpha: float | None) -> Method:
    """A method prepared again."""
    return skin.method(name, alpha=alpha)


def calibration(skin: Skin, files: dict[str, bytes]) -> Calibration:
    """A calibration from its files."""
    with TemporaryDirectory() as folder:
        for name, content in files.items():
            Path(folder, name).write_bytes(content)
        return skin.calibration(folder)


def files(calibration: Calibration) -> dict[str, bytes]:
    """The files of a calibration, by their names."""
    with TemporaryDirectory() as folder:
        calibration.save(folder)
        return {path.name: path.read_bytes() for path in Path(folder).iterdir()}
