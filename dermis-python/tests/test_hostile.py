"""Arguments of every kind: a result or a typed error, never a panic."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

import dermis

SKIN = dermis.Skin.load("skin16")
CELLS, CHANNELS = len(SKIN.rest_conductivity), len(SKIN.channels)
METHOD = SKIN.method("noser")
SHIPPED = ("cylinder30", "skin16", "tank16")

shapes = st.one_of(
    st.sampled_from([(), (0,), (CELLS,), (CHANNELS,), (0, CHANNELS), (2, CHANNELS), (1, CELLS), (1, 1, CHANNELS)]),
    arrays.array_shapes(min_dims=0, max_dims=4, max_side=4),
)
arrays_of_any_kind = arrays.arrays(
    st.sampled_from([np.float64, np.float32, np.int8, np.uint64, np.bool_, np.complex128, "M8[s]", "U3"]), shapes
)
scalars = st.one_of(st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=20), st.binary(max_size=20))
anything = st.one_of(
    arrays_of_any_kind,
    scalars,
    st.recursive(scalars, lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner, max_size=4)),
)
hostile = settings(max_examples=2000, deadline=None, suppress_health_check=list(HealthCheck))


def accepted(call):
    """The result, or None for a typed error."""
    try:
        return call()
    except (dermis.DermisError, TypeError, OverflowError):
        return None


@hostile
@given(anything)
def test_conductivities(conductivity):
    frames = accepted(lambda: SKIN.forward(conductivity))
    assert frames is None or conductivity is None or np.isfinite(frames).all()


@hostile
@given(anything, anything)
def test_frames(frames, baseline):
    contacts = accepted(lambda: METHOD.contacts(frames, baseline))
    assert contacts is None or isinstance(contacts, dermis.Contacts)


@hostile
@given(anything, scalars, scalars)
def test_touches(positions, amplitude, width_m):
    touched = accepted(lambda: SKIN.touched_conductivity(positions, amplitude=amplitude, width_m=width_m))
    assert touched is None or touched.shape == (CELLS,)


@hostile
@given(anything)
def test_designs(design):
    # Texts are drawn from the constants of the program, too.
    assert accepted(lambda: dermis.Skin.load(design)) is None or design in SHIPPED


@hostile
@given(scalars, scalars)
def test_methods(name, alpha):
    assert accepted(lambda: SKIN.method(name, alpha=alpha)) is None or name in (None, "", *SKIN.methods)
