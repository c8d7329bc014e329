"""Reconstruction and contacts."""

import numpy as np
import pytest

import dermis


@pytest.fixture(scope="module")
def skin():
    return dermis.Skin.load("cylinder30")


def test_a_touch_is_found_by_every_kind_of_method(skin):
    place = [0.0, 0.05, 0.15]
    touched = skin.forward(skin.touched_conductivity(place))
    for name in ["noser", "paper", "spots", None]:
        contacts = skin.method(name).contacts(touched, skin.forward())
        assert len(contacts) == 1, name
        assert np.linalg.norm(contacts.position_m[0] - place) < 0.008, name
        assert np.isclose(np.linalg.norm(contacts.normal[0]), 1.0)


def test_frames_are_numbered_and_tables_have_the_columns_of_the_program(skin):
    places = np.array([[0.0, 0.05, 0.1], [0.05, 0.0, 0.2]])
    frames = skin.forward([skin.rest_conductivity, *map(skin.touched_conductivity, places)])
    contacts = skin.method("noser").contacts(frames, skin.forward())
    assert contacts.frame.tolist() == [1, 2]
    assert len(contacts.of_frame(0)) == 0 and len(contacts.of_frame(2)) == 1
    assert isinstance(contacts, dermis.Contacts) and "<table>" in contacts._repr_html_()
    assert all(f"`{name}`" in dermis.Contacts.__doc__ for name in contacts.dtype.names)
    pandas = pytest.importorskip("pandas")
    table = contacts.to_dataframe()
    assert isinstance(table, pandas.DataFrame) and list(table.columns[:5]) == ["frame", "id", "x_m", "y_m", "z_m"]


def test_images_have_the_shape_of_the_design(skin):
    method = skin.method("noser")
    frames = skin.forward([skin.rest_conductivity] * 2)
    images = method.images(frames, skin.forward())
    assert images.shape[0] == 2 and images[0].size == len(skin.pixels)
    assert method.images(frames[0], skin.forward()).shape == images.shape[1:]
    np.testing.assert_array_equal(images, 0.0)


def test_wrong_input_is_refused(skin):
    method = skin.method("noser")
    frame = skin.forward()
    with pytest.raises(dermis.DermisError, match="frames"):
        method.contacts(frame[:-1], frame)
    with pytest.raises(dermis.DermisError, match="baseline"):
        method.contacts(frame, frame[:-1])
    bad = frame.copy()
    bad[3] = np.nan
    with pytest.raises(dermis.DermisError, match="channel 3"):
        method.contacts(bad, frame)
    with pytest.raises(dermis.DermisError, match="no-such-method"):
        skin.method("no-such-method")
    with pytest.raises(dermis.DermisError, match="both signs"):
        skin.method("spots").contacts(frame, frame, both_signs=True)
    with pytest.raises(dermis.DermisError, match="alpha"):
        skin.method("noser", alpha=-1.0)


def test_frames_of_another_skin_are_refused_as_by_the_program(skin):
    method, frame = skin.method("noser"), skin.forward()
    with pytest.raises(dermis.DermisError, match="whole frames"):
        method.contacts(frame)
    with pytest.raises(dermis.DermisError, match="signs turned"):
        method.contacts(-frame, -frame)
    with pytest.raises(dermis.DermisError, match="0.001 times"):
        method.images(1e-3 * frame, frame)
    with pytest.raises(dermis.DermisError, match="is 0"):
        method.contacts(0 * frame, frame)
    with pytest.warns(UserWarning, match="0.001 times"):
        method.images(1e-3 * frame, frame, force=True)
    with pytest.raises(dermis.DermisError, match="positions"):
        skin.touched_conductivity([30.0, 20.0, 0.0])


@pytest.mark.parametrize("change", [lambda truth: 1e3 * truth, lambda truth: truth + [0.1, 0, 0]])
def test_truth_off_the_skin_is_refused(skin, change):
    frames = skin.forward(skin.touched_conductivity(skin.pixels[:1]))[None]
    with pytest.raises(dermis.DermisError, match="`truth`: the place"):
        skin.method("noser").score(frames, change(skin.pixels[:1]), skin.forward()[None])
