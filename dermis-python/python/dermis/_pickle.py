"""Copies of objects in other processes."""


def method(skin, name, alpha):
    """A method prepared again."""
    return skin.method(name, alpha=alpha)
