"""Sorting out what is said of a drive: facts of its line, and options of its protocol."""

from __future__ import annotations

from dataclasses import fields
from typing import TYPE_CHECKING, Any

from drivecomm.errors import UsageError, meant, shortened
from drivecomm.protocol.argument_types import as_asked, misfit
from drivecomm.protocol.line import LINE_FACT_NAMES

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.protocol.contract import Protocol
    from drivecomm.protocol.line import LineFacts
    from drivecomm.protocol.model import Model


def sort_out(
    plugin: Protocol, model: Model | None, given: Mapping[str, Any], *, for_all: Mapping[str, Any] | None = None
) -> tuple[LineFacts, Any]:
    """Return the line facts of a drive and its protocol's options.

    The protocol's own come first, then what its model says, then what holds for all drives of the line, then what is
    given for this one. Raises UsageError for a name that is neither, or a value that cannot be.
    """
    own = option_names(plugin)
    allowed = own | LINE_FACT_NAMES
    of_model = model.options if model else {}
    if unknown := sorted(set(given) - allowed):
        known = meant(unknown[0], sorted(allowed), "they have")
        raise UsageError(f"{plugin.name} drives have no option {shortened(unknown[0])}; {known}")
    if unknown := sorted(set(of_model) - allowed):
        raise UsageError(f"model {model.name if model else ''} sets {unknown[0]!r}, which {plugin.name} does not have")
    said = {**of_model, **(for_all or {}), **given}
    chosen = as_asked(plugin.options, {name: value for name, value in said.items() if name in own})
    if wrong := misfit(plugin.options, chosen):
        name, takes = wrong
        raise UsageError(f"{name} cannot be {shortened(chosen[name])}; it takes {takes}")
    facts = plugin.facts.override({name: value for name, value in said.items() if name in LINE_FACT_NAMES})
    return facts, plugin.options(**chosen)


def option_names(plugin: Protocol) -> frozenset[str]:
    """Return the names of the protocol's own drive options."""
    return frozenset(field.name for field in fields(plugin.options))
