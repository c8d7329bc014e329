"""Fixtures of all tests."""

import signal

import pytest


@pytest.fixture
def interruptible():
    """Interrupts raise `KeyboardInterrupt`: a shell without job control starts programs in the background that ignore them."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)
