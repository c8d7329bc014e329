"""Copies of objects in other processes."""

from os import PathLike

from dermis._dermis import Method, Skin


def method(skin: Skin, name: str | PathLike[str], alpha: float | None) -> Method:
    """A method prepared again."""
    return skin.method(name, alpha=alpha)
