"""Unproven features: master and virtual drive come from one package, and only a printed telegram proves both right."""

from __future__ import annotations

import re
from dataclasses import fields
from functools import partial
from typing import TYPE_CHECKING

from drivecomm.errors import FileFormatError
from drivecomm.testing.checking import codec_for, decoded, known_model
from drivecomm.testing.direct_conversation import DirectConversation
from drivecomm.testing.vectors import packaged_vectors

if TYPE_CHECKING:
    from collections.abc import Iterator

    from drivecomm.protocol import Message, Protocol
    from drivecomm.testing.exchange_vectors import ExchangeVector
    from drivecomm.testing.vectors import VectorFile

_COMMANDS = ("start", "stop", "reset", "set_reference", "write", "read", "status")


def unproven(plugin: Protocol) -> tuple[str, ...]:
    """Return the commands, kinds of address and preparing requests that no exchange with a printed source shows.

    An exchange counts as printed if it is marked so, or if one of its requests is in a printed vector.
    """
    try:
        file = packaged_vectors(plugin)
    except FileFormatError:
        return ()
    printed = [each for each in file.exchanges if _is_printed(file, each)]
    calls = [(each, call) for each in printed for call in each.calls if not call.expected.error]
    told = {call.call for _, call in calls}
    shown = {shape for each, call in calls if (shape := _shape_of(plugin, each, call.arguments.get("parameter", "")))}
    wanted = {_shape(address): address for address in reversed(plugin.parameter_examples)}
    steps = {found for each in printed for step in each.steps if (found := _request(plugin, each, step.data))}
    prepared = {_bare(message): message for message in _preparing(plugin)}
    return (
        *(f"no printed exchange shows {verb}" for verb in _COMMANDS if verb not in told),
        *(f"no printed exchange shows a parameter such as {wanted[each]}" for each in sorted(wanted.keys() - shown)),
        *(
            f"no printed exchange shows {prepared[each]}, which prepares a read"
            for each in prepared
            if each not in steps
        ),
    )


def _is_printed(file: VectorFile, exchange: ExchangeVector) -> bool:
    known = {each.data for each in file.vectors if each.printed and each.direction == "request"}
    return exchange.printed or any(step.action == "send" and step.data in known for step in exchange.steps)


def _shape_of(plugin: Protocol, exchange: ExchangeVector, parameter: str) -> str:
    """Return the form of the address that an exchange names, or "" if it names none."""
    model = known_model(plugin, exchange.model) if exchange.model else None
    info = model.find(parameter) if model and parameter else None
    return _shape(info.address if info else parameter)


def _shape(address: str) -> str:
    """Return an address with a 9 in place of every number."""
    return re.sub(r"\d+", "9", address)


def _request(plugin: Protocol, exchange: ExchangeVector, data: bytes) -> frozenset[tuple[str, str]]:
    own = {name: value for name, value in exchange.options.items() if hasattr(plugin.options, name)}
    message = decoded(codec_for(plugin, own), data, "request")
    return frozenset() if message is None else _bare(message)


def _bare(message: Message) -> frozenset[tuple[str, str]]:
    """Return the fields of a request without the drive's address."""
    names = {"kind", *(each.name for each in fields(message))} - {"address"}
    return frozenset((name, repr(getattr(message, name))) for name in names)


def _preparing(plugin: Protocol) -> Iterator[Message]:
    """Yield the requests that precede the reading request itself, such as the selection of a page."""
    model = known_model(plugin, plugin.default_model)
    talk = DirectConversation(plugin, model)
    for address in (info.address for info in model.parameters.values()):
        asked, _ = talk.over(f"read {address}", partial(talk.operations.read, address))
        yield from (each.ask.message for each in asked[:-1])
