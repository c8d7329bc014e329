"""A user's script passes strict type checking."""

import os
from pathlib import Path

import pytest

import dermis

api = pytest.importorskip("mypy.api")

SCRIPT = """
from typing import assert_type

import numpy as np
from numpy.typing import NDArray

import dermis

skin = dermis.Skin.load("cylinder30")
untouched = skin.forward()
assert_type(untouched, NDArray[np.float64])
contacts = skin.method("spots").contacts(skin.forward(skin.touched_conductivity([0.0, 0.05, 0.15])), untouched)
assert_type(contacts.of_frame(0), dermis.Contacts)
gradient = skin.solve(skin.rest_conductivity).gradient(untouched, parameters=True)
assert_type(gradient["nodes"], NDArray[np.float64])
print(dermis.command("benchmark", "skin16", twins=1, quick=True)["twins"][0])
try:
    calibration = skin.calibrate(untouched, contacts.position_m, force_n=2.0)
except dermis.DermisError as error:
    assert_type(error.hint, str | None)
with dermis.Live(skin, source="emulate", touch="press") as live:
    for frame in live:
        assert_type(frame.touched, bool | None)
"""


def test_a_script_is_typed(tmp_path, monkeypatch):
    # Installed packages are found; others are named.
    folder = Path(dermis.__file__).parents[1]
    if "site-packages" not in folder.parts:
        monkeypatch.setitem(os.environ, "MYPYPATH", str(folder))
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    printed, errors, code = api.run(["--strict", "--cache-dir", str(tmp_path / "cache"), str(script)])
    assert code == 0, printed + errors
