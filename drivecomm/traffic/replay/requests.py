"""What a captured request means: in which protocols it is one, and whether it can do anything."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.errors import TelegramError

if TYPE_CHECKING:
    from collections.abc import Iterable

    from drivecomm.protocol import Message, Protocol


def meanings(request: bytes, protocols: Iterable[Protocol]) -> list[tuple[Protocol, Message]]:
    """Return what these bytes ask for, in each of the protocols in which they are one request."""
    found = []
    for plugin in protocols:
        try:
            found.append((plugin, plugin.codec(plugin.options()).decode(request, "request")))
        except TelegramError:
            continue
    return found


def only_asks(request: bytes, protocols: Iterable[Protocol]) -> bool:
    """Whether these bytes are a request that neither commands nor writes, in whatever protocol they are read.

    Bytes that are a request in none of them could be anything, so they do not only ask.
    """
    found = meanings(request, protocols)
    return bool(found) and all(plugin.only_asks is not None and plugin.only_asks(message) for plugin, message in found)


def described(request: bytes, protocols: Iterable[Protocol]) -> str:
    """Return a request for people: its bytes, and what it is in the first protocol that knows it."""
    shown = request.hex(" ").upper()
    for plugin, message in meanings(request, protocols):
        address = getattr(message, "address", None)
        return f"{shown} ({plugin.name}{'' if address is None else f':{address}'} {message.kind})"
    return shown
