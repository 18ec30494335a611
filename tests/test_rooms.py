"""Modules are private to their package, so that they can move: other packages import only the package itself."""

import ast
import importlib
import types
from importlib.metadata import entry_points
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
FACES = sorted(path.parent for path in (ROOT / "drivecomm").rglob("__init__.pyi") if path.parent.name != "drivecomm")
ROOMS = {".".join(face.relative_to(ROOT).parts) for face in FACES}
PLACES = (
    "drivecomm",
    "drivecomm_command",
    "protocols",
    "pytest_drivecomm",
    "tests",
    "benchmarks",
    "fuzz",
    "mutants",
    "docs",
)
FACES_FOR_DOORS = ("drivecomm.server", "drivecomm.server.broker")
"""Packages that doors may import; the second one is shared by doors on a broker."""
FILES = sorted(path for place in PLACES for path in (ROOT / place).rglob("*.py"))


def room_of(module):
    """Return the innermost package of a module, both with dots; "" for top-level modules and the command line."""
    parts = module.split(".")
    heads = (".".join(parts[:length]) for length in range(len(parts), 1, -1))
    return next((head for head in heads if head in ROOMS), "")


def imported(path):
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield node.module, {alias.name for alias in node.names}


def promised(room):
    """Return the names that a package exports, and its subpackages; its other modules are private."""
    return {*importlib.import_module(room).__all__, *(each.removeprefix(f"{room}.") for each in ROOMS)}


def at_home(path, room):
    relative = path.relative_to(ROOT)
    if relative.parts[0] == "tests":
        # The search for commands that move a motor injects faults into the server.
        home = "server" if relative.parts[1] == "adversary" else relative.parts[1]
        return len(relative.parts) > 2 and room.split(".")[1] == home
    return relative.parts[0] == "drivecomm" and room == room_of(".".join(relative.with_suffix("").parts))


def test_other_packages_import_only_the_package_itself():
    found = [
        f"{path.relative_to(ROOT)}: {module}"
        for path in FILES
        for module, names in imported(path)
        if (room := room_of(module)) and not at_home(path, room)
        if not (names <= promised(room) if module == room else all(name.startswith("_") for name in names))
    ]
    assert not found


def test_doors_import_only_the_public_server_and_no_other_door():
    doors = {each.module for each in entry_points(group="drivecomm.doors")}
    own = sorted(door for door in doors if door.startswith("drivecomm.server."))
    assert len(own) >= 5
    found = [
        f"{path.relative_to(ROOT)}: {module}"
        for door in own
        for path in sorted((ROOT / Path(*door.split("."))).rglob("*.py"))
        for module, _ in imported(path)
        if module.startswith("drivecomm.server") and not f"{module}.".startswith(f"{door}.")
        if module not in FACES_FOR_DOORS
    ]
    assert not found


@pytest.mark.parametrize("room", sorted({"drivecomm", *ROOMS}))
def test_package_exports_existing_names_and_no_modules(room):
    face = importlib.import_module(room)
    for name in face.__all__:
        assert not isinstance(getattr(face, name), types.ModuleType), f"{room} hides {name} behind a module"
