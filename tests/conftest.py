"""What holds for the run of all tests."""

import gc
import signal

import pytest


def pytest_configure():
    # Some tests send themselves SIGHUP, which commands leave ignored where nohup has started them.
    if hasattr(signal, "SIGHUP") and signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
        signal.signal(signal.SIGHUP, lambda *_: None)


@pytest.hookimpl(wrapper=True)
def pytest_collection():
    """What is collected stays until the end of the run, so it is not looked through for garbage again."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()
