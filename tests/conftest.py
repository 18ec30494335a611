"""What holds for the run of all tests."""

import gc
import signal
import sys
from importlib import import_module
from pathlib import Path

import pytest

import drivecomm


def pytest_configure(config):
    if sys.platform == "linux":
        config.pluginmanager.import_plugin("time_limits")
    # Some tests send themselves SIGHUP, which commands leave ignored where nohup has started them.
    if hasattr(signal, "SIGHUP") and signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
        signal.signal(signal.SIGHUP, lambda *_: None)
    # Others send SIGINT, to themselves or to commands, which a shell leaves ignored for what runs in the background.
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    # Each room reads the list of its names when it is loaded, and Python 3.11 fails where two threads do that at the
    # same time; some tests run servers in threads.
    package = Path(drivecomm.__file__).parent
    for names in sorted(package.rglob("__init__.pyi")):
        import_module(".".join(("drivecomm", *names.parent.relative_to(package).parts)))


@pytest.hookimpl(wrapper=True)
def pytest_collection():
    """What is collected stays until the end of the run, so it is not looked through for garbage again."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()
