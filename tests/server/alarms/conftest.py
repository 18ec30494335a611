"""Fixtures of the alarm tests."""

import time

import pytest
from alarm_receivers import Hook


@pytest.fixture
def hook():
    with Hook() as server:
        yield server


@pytest.fixture
def eventually():
    def wait(condition, within_s=20.0):
        until = time.monotonic() + within_s
        while not (found := condition()):
            assert time.monotonic() < until, "the condition did not become true"
            time.sleep(0.01)
        return found

    return wait
