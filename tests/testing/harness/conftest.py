"""Fixtures for running the pytest plug-in, and for making lines without pytest."""

import tomllib
from pathlib import Path

import hypothesis  # noqa: F401 - loaded here for the same reason as the protocols below
import pytest

import drivecomm.server.http.application
import drivecomm.transport.opening  # noqa: F401
from drivecomm.protocol import installed
from drivecomm.testing import LineMaker

ROOT = Path(__file__).resolve().parents[3]

# Loaded here, so that inner test runs in this process do not load them again.
PLUGINS = list(installed.working())


@pytest.fixture(scope="session")
def plugin_folder(tmp_path_factory):
    """Return a folder with the plug-in's installation metadata, independent of the installed packages."""
    points = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["entry-points"]["pytest11"]
    folder = tmp_path_factory.mktemp("installed")
    metadata = folder / "drivecomm_plugin_of_this_tree-1.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: drivecomm-plugin-of-this-tree\nVersion: 1\n")
    lines = ["[pytest11]", *(f"{name} = {value}" for name, value in points.items())]
    (metadata / "entry_points.txt").write_text("\n".join(lines) + "\n")
    return folder


@pytest.fixture
def run_pytest(pytester, plugin_folder, monkeypatch):
    """Return a function that runs tests from a text in this process, with warnings as errors."""
    monkeypatch.syspath_prepend(str(plugin_folder))

    def run(text, *arguments):
        pytester.makepyfile(text)
        return pytester.runpytest_inprocess("-p", "no:cacheprovider", "-p", "no:randomly", "-W", "error", *arguments)

    return run


@pytest.fixture
def lines(tmp_path_factory):
    with LineMaker(0, folder=lambda: tmp_path_factory.mktemp("line")) as lines:
        yield lines


@pytest.fixture(params=PLUGINS, ids=lambda plugin: plugin.name)
def plugin(request):
    return request.param
