"""What holds for the run of all tests."""

import gc
import re
import signal
import sys
from importlib import import_module
from pathlib import Path

import pytest

import drivecomm

_SAMPLE = re.compile(r"(?<=[\[-])sample(?=[]-])")
"""The extent of a test, in its name; `extents.extents` gives it."""


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


def pytest_collection_modifyitems(config, items):
    """Leave the sample of a test out where all of it is played in the same run."""
    if config.option.markexpr:
        return
    names = {item.nodeid for item in items}
    left_out = {item for item in items if _SAMPLE.search(item.nodeid) and _SAMPLE.sub("all", item.nodeid) in names}
    config.hook.pytest_deselected(items=list(left_out))
    items[:] = [item for item in items if item not in left_out]
