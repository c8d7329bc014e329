"""Meshes and images for other libraries; each is imported when it is used."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dermis._dermis import Mesh, Method


def to_meshio(mesh: Mesh, cell_data: dict[str, ArrayLike] | None = None) -> Any:
    """The mesh as a `meshio.Mesh`.

    Args:
        mesh: A `dermis.Mesh`.
        cell_data: Values per cell by name, (cells,) each: conductivities, for example.
    """
    import meshio

    kind = "triangle" if mesh.cells.shape[1] == 3 else "tetra"
    data = {name: [np.asarray(values)] for name, values in (cell_data or {}).items()}
    return meshio.Mesh(mesh.nodes, [(kind, mesh.cells)], cell_data=data)


def to_xarray(method: Method, frames: ArrayLike, baseline: ArrayLike | None = None) -> Any:
    """Images of frames as an `xarray.DataArray` with the positions of the pixels as coordinates.

    Args:
        method: A `dermis.Method`.
        frames: (n, channels), ohm.
        baseline: Untouched frames; without it, `frames` are differences.

    Returns:
        Dimensions `frame`, `row`, `column` with the coordinates `x_m`, `y_m`, `z_m` (NaN outside the body); `frame`,
        `pixel` for designs without a grid.
    """
    import xarray

    images = method.images(np.atleast_2d(frames), baseline)
    pixels = method.skin.pixels
    axes = ("row", "column") if images.ndim == 3 else ("pixel",)
    grid = np.full((*images.shape[1:], 3), np.nan)
    grid[np.isfinite(images[0])] = pixels
    coordinates = {name: (axes, grid[..., axis]) for axis, name in enumerate(("x_m", "y_m", "z_m"))}
    return xarray.DataArray(images, dims=("frame", *axes), coords=coordinates, name=method.name)
