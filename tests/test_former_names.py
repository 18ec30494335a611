"""Public names of 0.1 lead to the present ones, each with a warning, and are listed in the page on upgrading."""

import importlib
import re
from pathlib import Path

import pytest

from drivecomm.former_names import with_former_names

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = sorted(
    ".".join(path.relative_to(ROOT).parts[:-1])
    for path in (ROOT / "drivecomm").rglob("__init__.py")
    if "_FORMER_NAMES" in path.read_text(encoding="utf-8")
)


@pytest.mark.parametrize("package", PACKAGES)
def test_former_names_of_a_package_lead_to_the_present_ones(package):
    module = importlib.import_module(package)
    for former, present in module._FORMER_NAMES.items():
        expected = rf"{package}\.{former} is now {package}\.{present}; drivecomm 0\.3"
        with pytest.warns(DeprecationWarning, match=expected):
            assert getattr(module, former) is getattr(module, present)
        assert former not in dir(module)


def test_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="Nonsense"):
        importlib.import_module("drivecomm.protocol").Nonsense  # noqa: B018


def test_package_without_former_names_finds_present_names_only():
    assert with_former_names("x", str.upper, {})("name") == "NAME"


def test_upgrade_page_lists_every_former_name():
    page = (ROOT / "docs/reference/former-names.md").read_text(encoding="utf-8")
    listed = set(re.findall(r"^\| `(\S+)` \| `(\S+)` \|$", page, re.MULTILINE))
    known = {
        (f"{package}.{former}", f"{package}.{present}")
        for package in PACKAGES
        for former, present in importlib.import_module(package)._FORMER_NAMES.items()
    }
    assert listed == known
