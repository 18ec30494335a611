"""The wheel, built from tracked files and installed into an empty environment, as pip or pipx does."""

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
    """A virtual environment with only pip."""

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
        # In the repository the packages would be imported from the working folder.
        return run(self.programs / "drivecomm", *arguments, cwd=self.folder, env={**os.environ, "COLUMNS": "200"})

    def python(self, program):
        return run(self.programs / "python", "-c", program, cwd=self.folder)


@pytest.fixture(scope="module")
def environment(tmp_path_factory):
    made = Environment(tmp_path_factory.mktemp("bare") / "environment")
    # The package registry that pip on this machine uses.
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


def test_wheel_has_exactly_the_tracked_files(wheel):
    with (ROOT / "pyproject.toml").open("rb") as file:
        packages = tomllib.load(file)["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"]
    wanted = {name.removeprefix("protocols/") for package in packages for name in tracked(package)}
    shared = {f"drivecomm-{__version__}.data/data/share/drivecomm/systemd/{path.name}" for path in SYSTEMD.iterdir()}
    with zipfile.ZipFile(wheel) as content:
        names = set(content.namelist())
    assert wanted <= names
    assert shared <= names
    assert {name for name in names if ".dist-info/" not in name} == wanted | shared


def test_wheel_installs_the_command(installed):
    assert __version__ in installed.drivecomm("--version")
    assert {"danfoss-fc", "fuji", "vabus", "vlt3500"} <= set(installed.drivecomm("protocols").split())


def test_installed_wheel_serves_a_plant_without_other_packages(installed):
    assert "SIGHUP" in installed.drivecomm("serve", "--help")
    printed = installed.drivecomm("demo")
    assert "left out" not in printed
    assert "GET /api/v1/events" in printed


def test_wheel_installs_the_files_for_systemd(installed):
    folder = installed.folder / "share" / "drivecomm" / "systemd"
    assert {path.name for path in folder.iterdir()} == {path.name for path in SYSTEMD.iterdir()}


def test_installed_wheel_has_all_its_requirements(installed):
    installed.pip("check")


def test_http_door_of_the_installed_wheel_can_be_loaded(installed):
    installed.python(
        "from importlib.metadata import entry_points\n"
        "(door,) = entry_points(group='drivecomm.doors', name='http')\n"
        "assert callable(door.load())\n"
    )


def test_installed_wheel_passes_the_conformance_checks_of_a_package(installed):
    done = tried(installed.programs / "python", "-m", "drivecomm", "conformance", "vabus", cwd=installed.folder)
    assert done.returncode == 0, done.stdout + done.stderr


def test_source_distribution_builds_the_same_wheel_every_time(environment, wheel, tmp_path):
    environment.pip("install", "hatchling")
    python = environment.programs / "python"
    run(python, "-m", "hatchling", "build", "--target", "sdist", "--directory", tmp_path, cwd=ROOT)
    (source,) = tmp_path.iterdir()
    for folder in (tmp_path / "first", tmp_path / "second"):
        environment.pip("wheel", "--no-deps", "--wheel-dir", folder, source)
        (built,) = folder.iterdir()
        assert built.name == wheel.name
        assert built.read_bytes() == wheel.read_bytes()
