"""Options of a drive, combined from its protocol, its model, its line and its caller, and checked."""

from __future__ import annotations

from dataclasses import fields
from typing import TYPE_CHECKING, Any

from drivecomm.errors import AddressError, UsageError, shortened, suggestion
from drivecomm.protocol.argument_types import as_declared, wrong_argument
from drivecomm.protocol.line import LINE_FACT_NAMES

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from drivecomm.protocol.contract import Protocol
    from drivecomm.protocol.line import LineFacts
    from drivecomm.protocol.model import Model


CONFIRMED = "confirmed"
"""The option of every drive with which a person confirms that its name plate is that of its model's series."""
CONFIRMED_FACTS = "confirmed_facts"
"""The option of every drive with the parameters whose type, scale and unit a person has checked on this very drive."""
ABOUT_THE_DRIVE = frozenset({CONFIRMED, CONFIRMED_FACTS})
"""Options of every drive that have no influence on the communication with it."""


def resolve_options(
    plugin: Protocol, model: Model | None, given: Mapping[str, Any], *, for_all: Mapping[str, Any] | None = None
) -> tuple[LineFacts, Any]:
    """Return the line facts of a drive and its protocol's options.

    The options of the protocol are overridden by those of the model, these by `for_all` (for all drives of the line),
    and these by `given` (for this drive). Options of ABOUT_THE_DRIVE are left out. Raises UsageError for an unknown
    name or an invalid value.
    """
    own = option_names(plugin)
    given = {name: value for name, value in given.items() if name not in ABOUT_THE_DRIVE}
    of_model, of_line = model.options if model else {}, line_overrides(for_all or {})
    _known(plugin, given, own | LINE_FACT_NAMES, also={"model", *ABOUT_THE_DRIVE})
    if unknown := sorted(set(of_model) - own - LINE_FACT_NAMES):
        raise UsageError(f"model {model.name if model else ''} sets {unknown[0]!r}, which {plugin.name} does not have")
    said = {**of_model, **of_line, **given}
    facts = plugin.facts.override({name: value for name, value in said.items() if name in LINE_FACT_NAMES})
    return facts, protocol_options(plugin, {name: value for name, value in said.items() if name in own})


def protocol_options(plugin: Protocol, given: Mapping[str, Any]) -> Any:
    """Return the protocol's own drive options. Raises UsageError for an unknown name or an invalid value."""
    _known(plugin, given, option_names(plugin))
    chosen = as_declared(plugin.options, given)
    if wrong := wrong_argument(plugin.options, chosen):
        name, takes = wrong
        raise UsageError(f"invalid {name} = {shortened(chosen[name])}; it takes {takes}")
    try:
        return plugin.options(**chosen)
    except UsageError:
        raise
    except Exception as error:
        raise UsageError(
            f"{plugin.name} refuses its options {', '.join(sorted(chosen))} without saying so as it should "
            f"({type(error).__name__}: {error}); give other values, and report it to the maker of the package"
        ) from error


def option_names(plugin: Protocol) -> frozenset[str]:
    """Return the names of the protocol's own drive options."""
    return frozenset(field.name for field in fields(plugin.options))


def line_overrides(facts: Mapping[str, Any]) -> dict[str, Any]:
    """Return the line facts that are not None. Raises UsageError for an unknown name."""
    if unknown := sorted(set(facts) - LINE_FACT_NAMES):
        known = suggestion(unknown[0], sorted(LINE_FACT_NAMES), "use one of")
        raise UsageError(f"unknown line setting {unknown[0]!r}; {known}")
    return {name: value for name, value in facts.items() if value is not None}


def checked_address(plugin: Protocol, address: object, options: Any) -> int:
    """Return the address if drives with these options can have it. Raises AddressError otherwise."""
    addresses = plugin.addresses if plugin.addresses_of is None else plugin.addresses_of(options)
    if type(address) is not int or address not in addresses:
        allowed = f"{addresses[0]} to {addresses[-1]}"
        if gaps := [each for each in range(addresses[0], addresses[-1]) if each not in addresses]:
            allowed += f" without {', '.join(map(str, gaps))}"
        raise AddressError(f"{plugin.name} has no drive at address {shortened(address)}; addresses are {allowed}")
    return address


def _known(plugin: Protocol, given: Iterable[str], allowed: frozenset[str], also: Iterable[str] = ()) -> None:
    """Raise UsageError for an unknown option.

    also: options that are handled elsewhere, for the suggestion in the error.
    """
    if unknown := sorted(set(given) - allowed):
        known = suggestion(unknown[0], sorted({*allowed, *also}), "they have")
        raise UsageError(f"{plugin.name} drives have no option {shortened(unknown[0])}; {known}")
