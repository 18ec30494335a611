"""The documentation site, built once for all tests of a run, and the modules that make its pages.

DRIVECOMM_SITE names the folder of a site that `make docs` has just built; tests then use that site.
"""

import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest
from pages import ROOT, blocks_of

sys.path.insert(0, str(ROOT / "docs"))


@pytest.fixture(scope="session")
def site(tmp_path_factory):
    built = os.environ.get("DRIVECOMM_SITE")
    if built is not None:
        assert Path(built, "index.html").exists(), "the folder that DRIVECOMM_SITE names has no site"
        return Path(built)
    pytest.importorskip("mkdocs", reason="the pages need the extra named docs")
    run = os.environ.get("PYTEST_XDIST_TESTRUNUID")
    if run is None:
        return _built(tmp_path_factory.mktemp("site"))
    # Worker processes share this folder: the first one builds the site, and the others wait.
    folder = tmp_path_factory.getbasetemp().parent / f"site-{run}"
    ready = folder.with_suffix(".ready")
    try:
        folder.mkdir()
    except FileExistsError:
        for _ in range(1200):
            if ready.exists():
                return folder
            time.sleep(0.1)
        pytest.fail("the site could not be built")
    _built(folder)
    ready.touch()
    return folder


@pytest.fixture
def plant_file(request, tmp_path, monkeypatch):
    """Write the plant file of a page into an empty folder, with separate server state and sockets; yield its path."""
    monkeypatch.chdir(tmp_path)
    for name in ("DRIVECOMM_PORT", "DRIVECOMM_PLANT", "DRIVECOMM_CONTROL", "RUNTIME_DIRECTORY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path / "state"))
    # The path of a unix socket has room for only about a hundred characters.
    runtime = tempfile.mkdtemp(prefix="dc")
    monkeypatch.setenv("XDG_RUNTIME_DIR", runtime)
    (content,) = (block.code for block in blocks_of(request.module.PAGE) if block.title == "plant.toml")
    path = tmp_path / "plant.toml"
    path.write_text(content)
    yield path
    shutil.rmtree(runtime, ignore_errors=True)


def _built(folder):
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(folder)],
        cwd=ROOT,
        env={**os.environ, "NO_MKDOCS_2_WARNING": "1"},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return folder
