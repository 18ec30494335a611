"""Addresses to request from a drive, in order: first those that its model knows, then all others that it may hold."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from drivecomm.errors import NotSupported, ParameterAddressError
from drivecomm.protocol import NO_ELEMENTS, resolve_options

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Sequence

    from drivecomm.protocol import Elements, Model, Protocol


@dataclass(frozen=True, slots=True, kw_only=True)
class ExplorationPlan:
    """Addresses of one drive, in the order of the requests.

    known: addresses that the model knows. rest: all other addresses. absent: see `AddressSpace`. elements: elements to
    request of a parameter among the rest, by the code of its refusal, None for a value. key: returns the same text for
    every notation of an address. taken: keys of all addresses that the model knows, so that none of their elements
    counts as unknown.
    """

    known: Sequence[str]
    rest: Sequence[str]
    absent: frozenset[int]
    elements: Callable[[str, int | None], Elements]
    key: Callable[[str], str]
    taken: frozenset[str]

    def __len__(self) -> int:
        return len(self.known) + len(self.rest)


def course(
    plugin: Protocol, model: Model | None, *, known: Iterable[str], within: Collection[str] | None = None
) -> ExplorationPlan:
    """Return all addresses that a drive of a protocol may hold, in the order of the requests.

    known: addresses to request first. within: limits the other addresses to these; None for all. Raises NotSupported if
    the protocol package does not list the possible addresses.
    """
    if plugin.address_space is None:
        raise NotSupported(
            f"the package {plugin.package} does not list the addresses of a {plugin.name} drive, so "
            "they cannot be read; back up the parameters that its model knows"
        )
    _, options = resolve_options(plugin, model, {})
    space = plugin.address_space(options, model)
    operations = plugin.operations(plugin.addresses[0], options, model)

    def key(address: str) -> str:
        try:
            return operations.address_of(address)
        except ParameterAddressError:
            return address

    first = list(dict.fromkeys(known))
    taken = frozenset(map(key, first)) | {key(address) for address in (model.parameters if model else ())}
    chosen = None if within is None else {key(address) for address in within}
    return ExplorationPlan(
        known=first,
        rest=[
            address
            for address in space.addresses()
            if (place := key(address)) not in taken and (chosen is None or place in chosen)
        ],
        absent=space.absent,
        elements=space.elements,
        key=key,
        taken=taken,
    )


def chosen_course(plugin: Protocol, model: Model | None, addresses: Iterable[str]) -> ExplorationPlan:
    """Return a plan with these addresses only."""
    _, options = resolve_options(plugin, model, {})
    space = plugin.address_space(options, model) if plugin.address_space is not None else None
    return ExplorationPlan(
        known=list(dict.fromkeys(addresses)),
        rest=(),
        absent=space.absent if space is not None else frozenset(),
        elements=_none,
        key=str,
        taken=frozenset(),
    )


def without_elements(way: ExplorationPlan) -> ExplorationPlan:
    """Return a plan that requests only whole parameters, for drives that describe elements with their parameter."""
    return replace(way, elements=_none)


def _none(_address: str, _code: int | None) -> Elements:
    return NO_ELEMENTS
