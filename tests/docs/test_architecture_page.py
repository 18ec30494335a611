"""The architecture page lists every package of drivecomm, in the order of the import contract."""

import re
import tomllib

from pages import ROOT

PAGE = (ROOT / "docs" / "development" / "architecture.md").read_text(encoding="utf-8")
ROOMS = re.findall(r"^\| `drivecomm\.(\w+)` \|", PAGE, re.MULTILINE)


def test_architecture_page_lists_the_existing_packages():
    packages = {place.parent.name for place in (ROOT / "drivecomm").glob("*/__init__.py")}
    assert sorted(ROOMS) == sorted(packages)


def test_architecture_page_has_the_order_of_the_import_contract():
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"][
        "contracts"
    ]
    (layers,) = (contract["layers"] for contract in contracts if contract["type"] == "layers")
    floors = [[room for room in layer.split(" | ") if room not in {"__main__", "version"}] for layer in layers]
    order = re.search(r"^```text\n(cli > .*)\n```$", PAGE, re.MULTILINE)
    assert order
    assert [floor.split(" | ") for floor in order[1].split(" > ")] == [floor for floor in floors if floor]
    floor_of = {room: floor for floor, rooms in enumerate(floors) for room in rooms}
    assert sorted(ROOMS, key=floor_of.__getitem__) == ROOMS
