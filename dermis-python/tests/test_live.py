"""Streams of frames: pipelines, live skins, recordings."""

import itertools
import subprocess
import sys
import time

import numpy as np
import pytest

import dermis
import dermis.commands


@pytest.fixture(scope="module")
def skin():
    return dermis.Skin.load("skin16")


def test_a_pipeline_finds_a_press_in_frames_of_ones_own(skin):
    twin = skin.twin("lab", seed=2)
    pipeline = dermis.Pipeline(skin, "noser", tare_frames=50)
    position = skin.pixels[np.linalg.norm(skin.pixels - skin.pixels.mean(axis=0), axis=1).argmin()]
    untouched = twin.untouched(150)
    pressed = twin.press(np.tile(position, (30, 1)), force_n=3, first=150)
    frames = [
        pipeline.process(values, 1.0e9 + index / twin.frame_rate_hz)
        for index, values in enumerate(np.concatenate([untouched, pressed]))
    ]
    assert [frame.validity for frame in frames[:50]] == ["invalid"] * 50
    assert all(frame.is_usable and frame.touched is False for frame in frames[60:150])
    last = frames[-1]
    assert last.touched and len(last.contacts) == 1
    assert np.linalg.norm(last.contacts.position_m[0] - position) < 0.01
    assert last.contacts.seen[0] and last.contacts.velocity_m_s.shape == (1, 3)
    assert last.sequence == 179 and last.time_s == pytest.approx(1.0e9 + 179 / twin.frame_rate_hz)
    assert last.contacts.to_dataframe()["velocity_x_m_s"].notna().all()
    assert all(f"`{name}`" in dermis.Contacts.__doc__ for name in last.contacts.dtype.names)
    pipeline.tare()
    assert pipeline.process(untouched[0], 2.0e9).validity == "invalid"


def test_a_live_skin_is_read_and_its_recording_replayed(skin, tmp_path):
    with dermis.Live(skin, method="noser", touch="press", seed=4, speed=4) as live:
        for frame in itertools.islice(live, 10_000):
            if len(frame.contacts):
                break
    assert len(frame.contacts)
    assert frame.is_usable and frame.touched
    # After the end there is nothing more.
    list(live)

    recording = tmp_path / "touch.mcap"
    command = [sys.executable, "-m", "dermis", "live", "skin16", "--serve", "off", "--method", "noser", "--touch", "press"]
    subprocess.run([*command, "--for", "4", "--record", str(recording)], check=True, capture_output=True)
    replay = dermis.Replay(recording)
    frames = list(replay)
    assert len(frames) > 100
    assert replay.skin.name == "skin16"
    assert any(len(frame.contacts) for frame in frames)
    # Numbers increase, and so do times.
    assert (np.diff([frame.sequence for frame in frames]) > 0).all()


@pytest.mark.parametrize("all_frames", [False, True])
def test_a_loop_that_is_slow_gets_frames_of_now(skin, all_frames):
    with dermis.Live(skin, method="noser", all_frames=all_frames) as live:
        before = next(live).sequence
        time.sleep(1.5)
        passed = next(live).sequence - before
    assert passed == 1 if all_frames else passed > 50


def test_devices_and_recordings_that_cannot_be_are_refused(skin, tmp_path):
    with pytest.raises(dermis.DermisError, match="cannot reach the device"):
        dermis.Live(skin, "tcp:127.0.0.1:1", method="noser")
    with pytest.raises(dermis.DermisError, match="no-such-file"):
        dermis.Replay(tmp_path / "no-such-file.mcap")
    (tmp_path / "text.mcap").write_text("this is text")
    with pytest.raises(dermis.DermisError):
        dermis.Replay(tmp_path / "text.mcap")
    pipeline = dermis.Pipeline(skin, "noser")
    with pytest.raises(dermis.DermisError, match="`frame` has the shape"):
        pipeline.process([1.0])
    with pytest.raises(dermis.DermisError, match="`time_s` is -1"):
        pipeline.process(skin.forward(), -1)
    pipeline.process(skin.forward(), 1.0e9)
    with pytest.raises(dermis.DermisError, match="older than the one before"):
        pipeline.process(skin.forward(), 1.0e8)
    with pytest.raises(dermis.DermisError, match="no-such-method"):
        dermis.Pipeline(skin, "no-such-method")


def test_a_robot_is_read_live(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    dermis.commands.new("robot", output="arm.toml")
    robot = dermis.Robot("arm.toml")
    with robot.live(emulate=True, touch="press", record=tmp_path / "run") as live:
        with pytest.raises(dermis.DermisError, match="no skin `toe`"):
            live.tare("toe")
        first = next(live)
        # The skins are unknown at first.
        assert first["event"]["cause"] == "unknown"
        contacts = []
        for said in itertools.islice(live, 2000):
            contacts = said.get("snapshot", {"contacts": []})["contacts"]
            if contacts:
                break
    assert contacts and {"position_base_m", "parts", "self_link"} <= contacts[0].keys()
    assert list(live) == []
    replayed = dermis.commands.robot_replay(str(tmp_path / "run"), summary=True)
    assert replayed["touched_snapshots"] > 0
    with pytest.raises(dermis.DermisError, match="is there already"):
        robot.live(emulate=True, record=tmp_path / "run")
    with pytest.raises(dermis.DermisError, match="rate_hz"):
        robot.live(rate_hz=0)
