"""Set-up of the whole test run."""

import gc
import re
import signal
import sys
from importlib import import_module
from pathlib import Path

import pytest

import drivecomm

_SAMPLE = re.compile(r"(?<=[\[-])sample(?=[]-])")
"""Pattern of the extent `sample` in the id of a test; `extents.extents` sets the extent."""


def pytest_configure(config):
    if sys.platform == "linux":
        config.pluginmanager.import_plugin("time_limits")
    # Some tests send SIGHUP to themselves; nohup starts them with it ignored, which commands would inherit.
    if hasattr(signal, "SIGHUP") and signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
        signal.signal(signal.SIGHUP, lambda *_: None)
    # Others send SIGINT to themselves or to commands; a shell starts background jobs with it ignored.
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    # Each package reads its list of names when it is imported. In Python 3.11 this fails if two threads do it at the
    # same time, as tests with servers in threads would.
    package = Path(drivecomm.__file__).parent
    for names in sorted(package.rglob("__init__.pyi")):
        import_module(".".join(("drivecomm", *names.parent.relative_to(package).parts)))


@pytest.hookimpl(wrapper=True)
def pytest_collection():
    """Exclude collected tests from garbage collection, since they stay until the end of the run."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


def pytest_collection_modifyitems(config, items):
    """Skip the sample of a test if all of its cases run in the same session."""
    if config.option.markexpr:
        return
    names = {item.nodeid for item in items}
    left_out = {item for item in items if _SAMPLE.search(item.nodeid) and _SAMPLE.sub("all", item.nodeid) in names}
    config.hook.pytest_deselected(items=list(left_out))
    items[:] = [item for item in items if item not in left_out]
