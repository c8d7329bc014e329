"""The interpreter's lock, interrupts, forked processes, the program."""

import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

import dermis


@pytest.fixture(scope="module")
def skin():
    return dermis.Skin.load("cylinder30")


def frames_for(skin, seconds):
    """Conductivities whose frames take at least this time."""
    count = 64
    while True:
        conductivity = np.tile(skin.rest_conductivity, (count, 1))
        begun = time.perf_counter()
        skin.forward(conductivity)
        took = time.perf_counter() - begun
        if took >= seconds:
            return conductivity
        count = int(count * max(2.0, 1.2 * seconds / took))


def test_other_threads_run_during_a_long_call(skin):
    conductivity = frames_for(skin, 1.0)
    waits, stop = [], threading.Event()

    def tick():
        last = time.perf_counter()
        while not stop.is_set():
            time.sleep(0.001)
            now = time.perf_counter()
            waits.append(now - last)
            last = now

    thread = threading.Thread(target=tick)
    thread.start()
    skin.forward(conductivity)
    stop.set()
    thread.join()
    assert max(waits) < 0.05, f"a thread waited {max(waits):.3f} s"


def test_an_interrupt_ends_a_long_call(interruptible, skin):
    conductivity = frames_for(skin, 1.0)
    conductivity = np.tile(conductivity, (8, 1))
    timer = threading.Timer(0.3, os.kill, [os.getpid(), signal.SIGINT])
    begun = time.perf_counter()
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        skin.forward(conductivity)
    assert time.perf_counter() - begun < 2.0


def in_child(queue, skin):
    queue.put(skin.forward([skin.rest_conductivity] * 20).sum())


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_a_forked_child_computes(skin):
    expected = skin.forward([skin.rest_conductivity] * 20).sum()
    context = multiprocessing.get_context("fork")
    queue = context.Queue()
    child = context.Process(target=in_child, args=(queue, skin))
    child.start()
    try:
        assert queue.get(timeout=60) == expected
    finally:
        child.kill()
        child.join()


def tared_in_child(queue, skin, untouched):
    pipeline = dermis.Pipeline(skin, "spots", tare_frames=10)
    queue.put([pipeline.process(values, 1e9 + number).validity for number, values in enumerate(untouched)])


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_a_pipeline_of_a_forked_child_measures_its_noise(skin):
    untouched = skin.twin("lab", seed=1).untouched(12)
    # The parent has done the same, with threads that the child does not have.
    parent = dermis.Pipeline(skin, "spots", tare_frames=10)
    expected = [parent.process(values, 1e9 + number).validity for number, values in enumerate(untouched)]
    context = multiprocessing.get_context("fork")
    queue = context.Queue()
    child = context.Process(target=tared_in_child, args=(queue, skin, untouched))
    child.start()
    try:
        assert queue.get(timeout=60) == expected
    finally:
        child.kill()
        child.join()


def dermis_program(*arguments, cwd):
    return subprocess.run([sys.executable, "-m", "dermis", *arguments], cwd=cwd, capture_output=True, text=True)


def test_the_program_gives_the_same_bytes(skin, tmp_path):
    rng = np.random.default_rng(3)
    conductivity = skin.rest_conductivity * rng.uniform(0.9, 1.1, (20, len(skin.rest_conductivity)))
    touched = np.stack([skin.touched_conductivity([0.0, 0.05, 0.1]), skin.touched_conductivity([0.05, 0.0, 0.2])])
    np.save(tmp_path / "conductivity.npy", conductivity)
    np.save(tmp_path / "touched.npy", touched)
    np.save(tmp_path / "untouched.npy", skin.forward()[None])

    def run(*arguments):
        done = dermis_program(*arguments, cwd=tmp_path)
        assert done.returncode == 0, done.stderr

    run("forward", "cylinder30", "--conductivity", "conductivity.npy", "-o", "frames.npy")
    np.testing.assert_array_equal(np.load(tmp_path / "frames.npy"), skin.forward(conductivity))
    run("forward", "cylinder30", "--conductivity", "touched.npy", "-o", "frames.npy")
    frames = np.load(tmp_path / "frames.npy")
    np.testing.assert_array_equal(frames, skin.forward(touched))
    run("jacobian", "cylinder30", "-o", "jacobian.npy")
    np.testing.assert_array_equal(np.load(tmp_path / "jacobian.npy"), skin.jacobian())
    run("jacobian", "cylinder30", "--per", "cell", "-o", "jacobian.npy")
    np.testing.assert_array_equal(np.load(tmp_path / "jacobian.npy"), skin.jacobian(per="cell"))
    for name in ["noser", "tv", "greit", "spots", "paper"]:
        data = ["--frames", "frames.npy", "--baseline", "untouched.npy", "--method", name]
        run("reconstruct", "cylinder30", *data, "-o", "images.npy")
        method = skin.method(name)
        np.testing.assert_array_equal(np.load(tmp_path / "images.npy"), method.images(frames, skin.forward()))
        run("contacts", "cylinder30", *data, "-o", "contacts.csv")
        table = np.genfromtxt(tmp_path / "contacts.csv", delimiter=",", names=True)
        contacts = method.contacts(frames, skin.forward())
        np.testing.assert_array_equal(np.atleast_1d(table["x_m"]), contacts.position_m[:, 0])
        np.testing.assert_array_equal(np.atleast_1d(table["strength"]), contacts.strength)


def test_the_program_says_what_is_wrong(tmp_path):
    done = dermis_program("forward", "no-such-skin", "-o", "x.npy", cwd=tmp_path)
    assert done.returncode == 2 and "no-such-skin" in done.stderr
    done = dermis_program("no-such-command", cwd=tmp_path)
    assert done.returncode == 2


def test_importing_is_light():
    code = "import sys, dermis; print([name for name in ('torch', 'ray', 'mujoco', 'pandas', 'scipy', 'sklearn') if name in sys.modules])"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout.strip() == "[]"


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="no affinity here")
def test_a_call_ends_when_its_work_does_on_one_core():
    """The caller looks at signals every 50 ms, but does not wait for the next look."""
    code = """
import os, time
os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
import dermis
skin, times = dermis.Skin.load("skin16"), []
for _ in range(41):
    begun = time.perf_counter()
    skin.solve(skin.rest_conductivity)
    times.append(time.perf_counter() - begun)
print(min(times))
"""
    ended = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert float(ended.stdout) < 0.025
