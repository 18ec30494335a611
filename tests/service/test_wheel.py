"""The wheel, built from what git knows, and installed where nothing else is: what a user of pip or pipx gets."""

import os
import subprocess
import tomllib
import venv
import zipfile
from pathlib import Path

import pytest

from drivecomm import __version__

ROOT = Path(__file__).resolve().parents[2]
SYSTEMD = ROOT / "packaging" / "systemd"

pytestmark = [pytest.mark.soak, pytest.mark.timeout(600)]


def tried(*command, **options):
    return subprocess.run(
        [str(word) for word in command], capture_output=True, text=True, timeout=600, check=False, **options
    )


def run(*command, **options):
    done = tried(*command, **options)
    assert done.returncode == 0, f"{command}\n{done.stdout}{done.stderr}"
    return done.stdout


class Environment:
    """A virtual environment with pip and nothing else."""

    def __init__(self, folder):
        venv.create(folder, with_pip=True)
        self.folder = folder
        self.programs = folder / ("Scripts" if os.name == "nt" else "bin")
        self.pip_words = (self.programs / "python", "-m", "pip", "--quiet", "--disable-pip-version-check")

    def pip(self, *arguments):
        run(*self.pip_words, *arguments)

    def pip_tried(self, *arguments):
        return tried(*self.pip_words, *arguments)

    def drivecomm(self, *arguments):
        # Elsewhere than here, where the packages could be imported from the working folder.
        return run(self.programs / "drivecomm", *arguments, cwd=self.folder, env={**os.environ, "COLUMNS": "200"})

    def python(self, program):
        return run(self.programs / "python", "-c", program, cwd=self.folder)


@pytest.fixture(scope="module")
def environment(tmp_path_factory):
    made = Environment(tmp_path_factory.mktemp("bare") / "environment")
    # Whichever registry this machine's pip is set up for.
    sought = ("download", "--no-cache-dir", "--no-deps", "--retries", "0", "--timeout", "5", "construct")
    done = made.pip_tried(*sought, "--dest", made.folder / "reached", "--constraint", ROOT / "constraints.txt")
    if done.returncode != 0:
        pytest.skip(f"no package registry can be reached: {done.stderr.strip()[-300:]}")
    return made


@pytest.fixture(scope="module")
def wheel(environment, tmp_path_factory):
    folder = tmp_path_factory.mktemp("wheel")
    environment.pip("wheel", "--no-deps", "--wheel-dir", folder, ROOT)
    (made,) = folder.iterdir()
    return made


@pytest.fixture(scope="module")
def installed(environment, wheel):
    environment.pip("install", "--constraint", ROOT / "constraints.txt", f"drivecomm[server] @ {wheel.as_uri()}")
    return environment


def tracked(folder):
    return run("git", "ls-files", "-z", folder, cwd=ROOT).split("\0")[:-1]


def test_everything_that_is_tracked_is_in_it(wheel):
    with (ROOT / "pyproject.toml").open("rb") as file:
        packages = tomllib.load(file)["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"]
    wanted = {name.removeprefix("protocols/") for package in packages for name in tracked(package)}
    shared = {f"drivecomm-{__version__}.data/data/share/drivecomm/systemd/{path.name}" for path in SYSTEMD.iterdir()}
    with zipfile.ZipFile(wheel) as content:
        names = set(content.namelist())
    assert wanted <= names
    assert shared <= names
    assert {name for name in names if ".dist-info/" not in name} == wanted | shared


def test_the_command_is_there(installed):
    assert __version__ in installed.drivecomm("--version")
    assert {"danfoss-fc", "fuji", "vabus", "vlt3500"} <= set(installed.drivecomm("protocols").split())


def test_a_plant_is_served_with_nothing_else_installed(installed):
    assert "SIGHUP" in installed.drivecomm("serve", "--help")
    printed = installed.drivecomm("demo")
    assert "left out" not in printed
    assert "GET /api/v1/events" in printed


def test_the_files_for_systemd_are_there(installed):
    folder = installed.folder / "share" / "drivecomm" / "systemd"
    assert {path.name for path in folder.iterdir()} == {path.name for path in SYSTEMD.iterdir()}


def test_nothing_is_missing_that_the_packages_need(installed):
    installed.pip("check")


def test_the_http_door_is_an_entry_point_and_can_be_loaded(installed):
    installed.python(
        "from importlib.metadata import entry_points\n"
        "(door,) = entry_points(group='drivecomm.doors', name='http')\n"
        "assert callable(door.load())\n"
    )
