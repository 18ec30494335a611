"""The page about telegrams: its table has every leaf of the schema module."""

import inspect
import re

from pages import ROOT

from drivecomm.protocol import schema

TEXT = (ROOT / "docs" / "development" / "telegrams.md").read_text(encoding="utf-8")


def test_telegrams_page_lists_every_leaf():
    made = {name: getattr(schema, name) for name in schema.__all__}
    leaves = {
        name for name, each in made.items() if inspect.isfunction(each) and each.__annotations__["return"] == "Leaf"
    }
    rows = set(re.findall(r"^\| `(\w+)\(", TEXT, re.MULTILINE))
    assert rows == leaves | {"CheckCharacters", "Leaf"}


def test_every_number_leaf_has_the_argument_allowed():
    for name in ("decimal_number", "hex_number", "shifted_character", "signed", "unsigned", "whole"):
        assert "allowed" in inspect.signature(getattr(schema, name)).parameters
