"""A third-party distribution, installed as by an installer, and commands in an environment that contains it."""

import contextlib
import io
import json
import os
import shutil
import signal
import subprocess
import sys
import tomllib
from dataclasses import dataclass

import pytest
from strangers_distribution import PACKAGE, ROOT, SOURCE, leave_metadata

from drivecomm.cli import main
from drivecomm.protocol import installed


@pytest.fixture(scope="session")
def site(tmp_path_factory):
    """Return a folder with the installed third-party package, and the pytest plug-in of this tree."""
    site = tmp_path_factory.mktemp("site")
    shutil.copytree(PACKAGE, site / PACKAGE.name, ignore=shutil.ignore_patterns("__pycache__"))
    project = tomllib.loads((SOURCE / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    leave_metadata(site, project, project["entry-points"])
    points = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["entry-points"]
    plugin = {"name": "drivecomm-plugin-of-this-tree", "version": "1"}
    leave_metadata(site, plugin, {"pytest11": points["pytest11"]})
    return site


@dataclass(frozen=True)
class Done:
    """Result of a command: its exit code and its output."""

    code: int
    out: str
    err: str

    @property
    def objects(self):
        return [json.loads(line) for line in self.out.splitlines()]


class Shell:
    """Runner of programs in a new folder, in an environment with the third-party package."""

    def __init__(self, site, folder):
        self.folder = folder
        path = [str(site), *filter(None, [os.environ.get("PYTHONPATH")])]
        self.environment = {**os.environ, "PYTHONPATH": os.pathsep.join(path)}
        self._running = []

    def __call__(self, *arguments):
        """Run a drivecomm command in this process, which is quicker and finds the package in the same way."""
        out, err = io.StringIO(), io.StringIO()
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            code = main(list(arguments))
        return Done(code, out.getvalue(), err.getvalue())

    def python(self, *arguments):
        """Run a new Python process in the folder."""
        done = subprocess.run(
            [sys.executable, *arguments],
            cwd=self.folder,
            env=self.environment,
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        )
        return Done(done.returncode, done.stdout, done.stderr)

    def serve(self, *arguments):
        """Start a long-running command; return the first object that it prints."""
        process = subprocess.Popen(
            [sys.executable, "-m", "drivecomm", *arguments, "--json"],
            cwd=self.folder,
            env=self.environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        self._running.append(process)
        return json.loads(process.stdout.readline())

    def close(self):
        for process in self._running:
            process.send_signal(signal.SIGTERM)
        for process in self._running:
            output, _ = process.communicate(timeout=10)
            assert process.returncode == 0, output


def forget_the_package():
    """Remove the third-party package from this process."""
    installed._loaded.pop("acme", None)
    for name in [name for name in sys.modules if name.partition(".")[0] == PACKAGE.name]:
        del sys.modules[name]


@pytest.fixture
def shell(site, tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(site))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.delenv("DRIVECOMM_PORT", raising=False)
    shell = Shell(site, tmp_path)
    try:
        yield shell
    finally:
        forget_the_package()
        shell.close()
