"""Contacts as an array."""

from collections.abc import Mapping
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray


class Contacts(np.recarray[Any, Any]):
    """The contacts of frames: a structured array with a row per contact.

    Fields: `frame` (index), `id`, `position_m` (3,), `normal` (3,) outward, `force_n` and `force_sd_n` (N, NaN where
    unknown), `strength` (integral of the image, m2), `area_m2`, `direction` (3,) along the contact, `half_length_m` and
    `half_width_m` (NaN unless its form was fitted), `edge_m` (distance from the edge of the skin, NaN if it is closed),
    `sd_m` (standard deviation of the position per axis), `confidence` (0 to 1), `conductance` (1 if it rises, -1 if it
    falls, NaN if one sign was looked for).

    Contacts of a pipeline are tracked: `id` lasts while the contact lasts, `frame` is the number of the frame, and there
    are `centroid_m`, `centre_of_pressure_m`, `velocity_m_s` (3,), `seen` (False while the position is predicted),
    `since_s` (start, s since 1970) and `age_s` (time since then).
    """

    def of_frame(self, frame: int) -> Self:
        """The contacts of one frame."""
        return self[self["frame"] == frame]

    def to_dataframe(self) -> Any:
        """A pandas.DataFrame with a column for each field; vectors by component, under the names of files of contacts."""
        import pandas

        from dermis._dermis import contact_columns

        vectors, columns = contact_columns(), {}
        for name in self.dtype.names:
            values = np.asarray(self[name])
            columns.update(zip(vectors[name], values.T) if name in vectors else {name: values})
        return pandas.DataFrame(columns)

    def _repr_html_(self) -> str:
        if not {"frame", "position_m", "force_n", "sd_m", "confidence"} <= set(self.dtype.names):
            return f"<pre>{self!r}</pre>"
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
    """Contacts from the columns of the engine."""
    dtype = np.dtype([(name, column.dtype, column.shape[1:]) for name, column in columns.items()], align=True)
    contacts = np.empty(len(columns["frame"]), dtype).view(Contacts)
    for name, column in columns.items():
        contacts[name] = column
    return contacts
