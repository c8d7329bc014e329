"""Matplotlib pictures, as the program draws them: the skin unrolled, or in space where its body has no plane picture.

>>> import dermis, matplotlib
>>> matplotlib.use("Agg")
>>> from dermis import plot
>>> skin = dermis.Skin.load("cylinder30")
>>> touched = skin.touched_conductivity([0.0, 0.05, 0.15])
>>> axes = plot.cells(skin, touched / skin.rest_conductivity - 1, label="relative change of conductance")
>>> contacts = skin.method("noser").contacts(skin.forward(touched), skin.forward())
>>> plot.positions(skin, contacts.position_m, axes)
"""

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dermis._dermis import Skin
from dermis._errors import DermisError

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["cells", "flat", "image", "positions"]


def flat(skin: Skin, points: ArrayLike) -> NDArray[np.float64]:
    """Coordinates of points in pictures, mm.

    Args:
        skin: A `dermis.Skin`.
        points: (n, 3), m.

    Returns:
        (n, 2): arc length from theta = 0 and z on a cylinder, the two axes of a flat skin; (n, 3) on other bodies.
    """
    points = np.asarray(points, dtype=float)
    if points.ndim not in (1, 2) or points.shape[-1] != 3:
        raise DermisError(f"`points` has the shape {points.shape}", hint="give (3,) or (n, 3), m")
    points = points.reshape(-1, 3)
    radius, plane = _radius(skin), _plane(skin)
    if radius is not None:
        arc = radius * (np.arctan2(points[:, 1], points[:, 0]) % (2 * np.pi))
        return 1e3 * np.stack([arc, points[:, 2]], axis=1)
    return 1e3 * (points if plane is None else points[:, plane])


def cells(
    skin: Skin, values: ArrayLike, axes: "Axes | None" = None, *, label: str = "", diverging: bool = False
) -> "Axes":
    """A value per cell of the mesh. Cells across the cut of a cylinder, at theta = 0, are left out.

    Args:
        skin: A `dermis.Skin` of triangles.
        values: (cells,).
        axes: The matplotlib axes; new ones without it.
        label: Name of the values, with the unit.
        diverging: Colours on both sides of zero.

    Returns:
        The axes.
    """
    axes = _axes(skin, axes)
    corners = flat(skin, skin.mesh.nodes)[skin.mesh.cells]
    values = np.asarray(values, dtype=float)
    if corners.shape[-1] == 3:
        from mpl_toolkits.mplot3d.art3d import Poly3DCollection

        drawn = Poly3DCollection(corners[:, :3])
        _coloured(drawn, values, diverging)
        axes.add_collection3d(drawn)
        return _finished(skin, axes, drawn, label)
    radius = _radius(skin)
    shown = np.ones(len(corners), dtype=bool)
    if radius is not None:
        shown = np.ptp(corners[..., 0], axis=1) < 1e3 * np.pi * radius
    points = corners[shown].reshape(-1, 2)
    triangles = np.arange(len(points)).reshape(-1, 3)
    drawn = axes.tripcolor(*points.T, triangles, facecolors=values[shown], **_colours(values[shown], diverging))
    return _finished(skin, axes, drawn, label)


def image(
    skin: Skin, values: ArrayLike, axes: "Axes | None" = None, *, label: str = "image", diverging: bool = False
) -> "Axes":
    """An image of `Method.images`, pixel by pixel.

    Args:
        skin: A `dermis.Skin`.
        values: (rows, columns) with NaN outside the body, or (pixels,).
        axes: The matplotlib axes; new ones without it.
        label: Name of the values, with the unit.
        diverging: Colours on both sides of zero.

    Returns:
        The axes.
    """
    axes = _axes(skin, axes)
    values = np.asarray(values, dtype=float)
    places, inside = flat(skin, skin.pixels), values[np.isfinite(values)]
    if places.shape[1] == 3:
        drawn = axes.scatter(*places.T, c=inside, **_colours(inside, diverging))
        return _finished(skin, axes, drawn, label)
    if values.ndim == 1:
        drawn = axes.tripcolor(*places.T, inside, **_colours(inside, diverging))
        return _finished(skin, axes, drawn, label)
    # The grid is regular in the plane of the picture; pixels that the rim cuts have their centres off it.
    grid, index = values, np.argwhere(np.isfinite(values))
    if _step(index[:, 0], places[:, 0])[1] ** 2 > _step(index[:, 1], places[:, 0])[1] ** 2:
        grid, index = grid.T, index[:, ::-1]
    up, across = (np.polyval(_step(index[:, axis], places[:, 1 - axis])[::-1], range(grid.shape[axis])) for axis in (0, 1))
    drawn = axes.pcolormesh(across, up, grid, shading="nearest", **_colours(inside, diverging))
    return _finished(skin, axes, drawn, label)


def positions(
    skin: Skin, points: ArrayLike, axes: "Axes", *, marker: str = "x", color: Any = "black", label: str | None = None
) -> None:
    """Marks positions, for example contacts.

    Args:
        skin: A `dermis.Skin`.
        points: (n, 3), m.
        axes: The matplotlib axes.
        marker: The marker.
        color: Its colour.
        label: Its name in a legend.
    """
    axes.scatter(*flat(skin, points).T, marker=marker, c=color, label=label, zorder=3)


def _step(numbers, coordinates):
    """The coordinate at number 0 of a grid, and the step."""
    return np.polyfit(numbers, coordinates, 1)[::-1]


def _radius(skin):
    """The radius of a cylinder about the z axis, m; None for other bodies."""
    nodes = skin.mesh.nodes
    radii = np.hypot(nodes[:, 0], nodes[:, 1])
    is_cylinder = np.ptp(radii) < 1e-6 * radii.max() and np.ptp(nodes[:, 2]) > 0
    return radii.mean() if is_cylinder else None


def _plane(skin):
    """The two axes of a flat skin; None for a body that is not flat."""
    extents = np.ptp(skin.mesh.nodes, axis=0)
    thin = extents.argmin()
    is_flat = skin.mesh.cells.shape[1] == 3 and extents[thin] < 1e-9 * extents.max()
    return np.delete(range(3), thin) if is_flat else None


def _axes(skin, axes):
    if axes is not None:
        return axes
    from matplotlib import pyplot

    projection = "3d" if flat(skin, skin.electrodes).shape[1] == 3 else None
    return pyplot.subplots(layout="constrained", subplot_kw={"projection": projection})[1]


def _colours(values, diverging):
    """The colour map of the program's pictures, with its limits."""
    if not diverging:
        return {"cmap": "viridis"}
    extent = np.abs(values).max() or 1.0
    return {"cmap": "RdBu_r", "vmin": -extent, "vmax": extent}


def _coloured(drawn, values, diverging):
    """Colours a collection that has no argument for it."""
    colours = _colours(values, diverging)
    drawn.set_array(values)
    drawn.set_cmap(colours["cmap"])
    drawn.set_clim(colours.get("vmin", values.min()), colours.get("vmax", values.max()))


def _finished(skin, axes, drawn, label):
    """The electrodes with their numbers, the colour bar, the axes."""
    axes.figure.colorbar(drawn, ax=axes, label=label)
    axes.set_aspect("equal")
    places = flat(skin, skin.electrodes)
    axes.scatter(*places.T, s=16, c="white", edgecolors="black", zorder=4)
    for number, place in enumerate(places):
        if places.shape[1] == 3:
            axes.text(*place, f" {number}", fontsize=7, zorder=5)
        else:
            axes.annotate(str(number), place, (3, 3), textcoords="offset points", fontsize=7, zorder=5)
    if _radius(skin) is not None:
        names = ["arc length (mm)", "z (mm)"]
    else:
        plane = _plane(skin)
        names = [f"{axis} (mm)" for axis in np.array(["x", "y", "z"])[slice(None) if plane is None else plane]]
    axes.set(**dict(zip(["xlabel", "ylabel", "zlabel"], names)))
    return axes
