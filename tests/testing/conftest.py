"""Fixtures that replace installed protocols by faulty copies."""

from dataclasses import replace

import pytest
from altered import Altered

from drivecomm.protocol import installed


@pytest.fixture
def in_place_of(monkeypatch):
    """Replace fields of an installed protocol; return the changed protocol, which is installed for the test."""

    def replaced(name, **fields):
        plugin = replace(installed[name], **fields)
        monkeypatch.setitem(installed._loaded, name, plugin)
        return plugin

    return replaced


@pytest.fixture
def with_operations(in_place_of):
    """Replace operations of an installed protocol; each replacement is a function of the real operations."""

    def replaced(name, **verbs):
        real = installed[name].operations

        def operations(*arguments):
            made = real(*arguments)
            return Altered(made, **{verb: make(made) for verb, make in verbs.items()})

        return in_place_of(name, operations=operations)

    return replaced
