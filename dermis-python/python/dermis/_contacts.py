"""Contacts as an array."""

from collections.abc import Mapping
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

_VECTORS = {"position_m": ["x_m", "y_m", "z_m"], "normal": ["normal_x", "normal_y", "normal_z"]}
_FIELDS = [
    ("frame", "i8"),
    ("id", "u8"),
    ("position_m", "f8", 3),
    ("normal", "f8", 3),
    ("force_n", "f8"),
    ("force_sd_n", "f8"),
    ("strength", "f8"),
    ("area_m2", "f8"),
    ("sd_m", "f8"),
    ("confidence", "f8"),
    ("sign", "f8"),
]
_TRACKED_FIELDS = [
    ("centroid_m", "f8", 3),
    ("centre_of_pressure_m", "f8", 3),
    ("velocity_m_s", "f8", 3),
    ("seen", "?"),
    ("since_s", "f8"),
]
_DTYPE = np.dtype(_FIELDS, align=True)
_TRACKED = np.dtype(_FIELDS + _TRACKED_FIELDS, align=True)


class Contacts(np.recarray[Any, Any]):
    """The contacts of frames: a structured array with a row per contact.

    Fields: `frame` (index), `id`, `position_m` (3,), `normal` (3,) outward, `force_n` and `force_sd_n` (N, NaN where
    unknown), `strength` (integral of the image, m2), `area_m2`, `sd_m` (standard deviation of the position per axis),
    `confidence` (0 to 1), `sign` (1 if the conductance rises, -1 if it falls, NaN if one sign was looked for).

    Contacts of a pipeline are tracked: `id` lasts while the contact lasts, `frame` is the number of the frame, and there
    are `centroid_m`, `centre_of_pressure_m`, `velocity_m_s` (3,), `seen` (False while the position is predicted) and
    `since_s` (start, s since 1970).
    """

    def of_frame(self, frame: int) -> Self:
        """The contacts of one frame."""
        return self[self["frame"] == frame]

    def to_dataframe(self) -> Any:
        """A pandas.DataFrame with the columns of `dermis contacts -o contacts.csv`; vectors by component."""
        import pandas

        columns = {}
        for name in self.dtype.names:
            if self.dtype[name].shape:
                components = _VECTORS.get(name, [f"{name}_{axis}" for axis in "xyz"])
                columns.update(zip(components, np.asarray(self[name]).T))
            else:
                columns[name] = np.asarray(self[name])
        return pandas.DataFrame(columns)

    def _repr_html_(self) -> str:
        names = ["frame", "x_m", "y_m", "z_m", "force_n", "sd_m", "confidence"]
        rows = []
        for contact in self[:50]:
            x, y, z = contact["position_m"]
            values = [x, y, z, contact["force_n"], contact["sd_m"], contact["confidence"]]
            cells = [str(contact["frame"])] + [f"{value:.4g}" for value in values]
            rows.append("".join(f"<td>{cell}</td>" for cell in cells))
        head = "".join(f"<th>{name}</th>" for name in names)
        body = "".join(f"<tr>{row}</tr>" for row in rows)
        more = f"<caption>{len(self)} contacts, the first 50</caption>" if len(self) > 50 else ""
        return f"<table>{more}<tr>{head}</tr>{body}</table>"


def table(columns: Mapping[str, NDArray[Any]]) -> Contacts:
    """Contacts from the columns of the engine, vectors by component."""
    return _filled(_DTYPE, columns)


def tracked(columns: Mapping[str, NDArray[Any]]) -> Contacts:
    """Tracked contacts from the columns of the engine."""
    return _filled(_TRACKED, columns)


def _filled(dtype: np.dtype[Any], columns: Mapping[str, NDArray[Any]]) -> Contacts:
    contacts = np.empty(len(columns["frame"]), dtype).view(Contacts)
    for name in dtype.names:
        if name in columns:
            contacts[name] = columns[name]
        else:
            contacts[name] = np.stack([columns[component] for component in _VECTORS[name]], axis=1)
    return contacts
