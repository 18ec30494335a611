"""The errors page names every exception class with its exit code, in the order of the class tree."""

import re

import pytest
from pages import ROOT

import drivecomm
from drivecomm import errors
from drivecomm.cli.streams import NOT_READ

PAGE = (ROOT / "docs" / "reference" / "errors.md").read_text(encoding="utf-8")


def tree(kind):
    yield kind
    for below in kind.__subclasses__():
        if below.__module__ == errors.__name__:
            yield from tree(below)


KINDS = list(tree(errors.DriveCommError))


@pytest.mark.parametrize("kind", KINDS[1:], ids=lambda kind: kind.__name__)
def test_errors_page_has_a_row_for_the_class(kind):
    row = re.search(rf"^\| `{kind.__name__}` \| (\d+) \|", PAGE, re.MULTILINE)
    assert row, f"{kind.__name__} is missing"
    assert int(row[1]) == kind.exit_code
    assert getattr(drivecomm, kind.__name__) is kind
    for part in kind.remedy.split(","):
        assert part.strip() in PAGE


def test_tree_on_the_page_and_in_the_docstring_is_complete():
    drawn = re.findall(r"(?:^|── )(\w+Error|NotSupported)", PAGE, re.MULTILINE)
    told = re.findall(r"(?:^|── )(\w+Error|NotSupported)", errors.__doc__, re.MULTILINE)
    assert drawn == told
    assert sorted(drawn) == sorted(kind.__name__ for kind in KINDS)


def test_errors_page_lists_every_exit_code():
    shown = {int(code) for code in re.findall(r"^\| (\d+) \|", PAGE, re.MULTILINE)}
    by_signals = {129, 130, 143}
    assert shown == {0, 130, NOT_READ, *by_signals} | {kind.exit_code for kind in KINDS}
