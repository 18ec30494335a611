"""Protocols by name: found as entry points of installed distributions, loaded on first use."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import contextmanager
from threading import Lock
from typing import TYPE_CHECKING, Any

from drivecomm.errors import (
    DriveCommError,
    ProtocolLoadError,
    TelegramError,
    UnknownProtocolError,
    UsageError,
    shortened,
    suggestion,
)
from drivecomm.protocol.contract import Protocol
from drivecomm.protocol.entry_points import entry_points
from drivecomm.protocol.options import protocol_options
from drivecomm.protocol.telegram import Telegram

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from drivecomm.protocol.framing import Codec
    from drivecomm.protocol.telegram import Direction

GROUP = "drivecomm.protocols"


class Protocols(Mapping[str, Protocol]):
    """The installed protocols by name.

    A name is known immediately; its package is imported when the protocol is looked up. The lookup raises
    UnknownProtocolError for a name that no distribution provides, and ProtocolLoadError for a broken plug-in or a name
    that two distributions provide.
    """

    def __init__(self) -> None:
        self._loaded: dict[str, Protocol] = {}
        self._added: dict[str, Protocol] = {}
        self._lock = Lock()

    def __getitem__(self, name: str) -> Protocol:
        if not isinstance(name, str):
            raise unknown_protocol(name, self)
        if name in self._added:
            return self._added[name]
        with self._lock:
            if name not in self._loaded:
                self._loaded[name] = _load(name)
            return self._loaded[name]

    def __iter__(self) -> Iterator[str]:
        return iter(sorted({entry.name for entry in entry_points(GROUP)} | set(self._added)))

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {', '.join(self)}>"

    def __len__(self) -> int:
        return len(list(iter(self)))

    def __contains__(self, name: object) -> bool:
        return name in list(iter(self))

    def register(self, protocol: Protocol) -> Callable[[], None]:
        """Add a protocol that is not installed, for example in a test; return a function that removes it.

        Raises ProtocolLoadError if the name is taken.
        """
        if protocol.name in self:
            raise ProtocolLoadError(f"the protocol name {protocol.name!r} is taken")
        self._added[protocol.name] = protocol

        def take_away() -> None:
            self._added.pop(protocol.name, None)

        return take_away

    def working(self) -> Iterator[Protocol]:
        """Yield the protocols that can be loaded, ordered by name; `broken` names the others."""
        for name in self:
            try:
                yield self[name]
            except ProtocolLoadError:
                continue

    def broken(self) -> dict[str, str]:
        """Return the errors of the plug-ins that cannot be loaded, by name."""
        found = {}
        for name in self:
            try:
                self[name]
            except ProtocolLoadError as error:
                found[name] = str(error)
        return found


def unknown_protocol(name: str, known: Iterable[str]) -> UnknownProtocolError:
    """Return the error for a name that none of the known protocols has."""
    there = suggestion(name, sorted(known), "installed are")
    return UnknownProtocolError(f"no installed protocol is named {shortened(name)}; {there}")


def _load(name: str) -> Protocol:
    there = entry_points(GROUP)
    entries = sorted({entry for entry in there if entry.name == name}, key=lambda entry: entry.distribution)
    if not entries:
        raise unknown_protocol(name, {entry.name for entry in there})
    if len(entries) > 1:
        owners = " and ".join(entry.distribution for entry in entries)
        raise ProtocolLoadError(f"the protocol name {name!r} is claimed by {owners}; uninstall one of them")
    entry = entries[0]
    try:
        protocol = entry.load()
    except (Exception, SystemExit) as error:
        raise ProtocolLoadError(
            f"the protocol {name!r} of {entry.distribution} cannot be loaded ({type(error).__name__}: {error}); "
            "reinstall or uninstall it"
        ) from error
    if not isinstance(protocol, Protocol):
        raise ProtocolLoadError(
            f"the entry point {name!r} of {entry.distribution} is not a drivecomm.protocol.Protocol"
        )
    if protocol.name != name:
        raise ProtocolLoadError(
            f"the entry point {name!r} of {entry.distribution} provides a protocol named {protocol.name!r}"
        )
    return protocol


installed = Protocols()
"""The protocols of this Python installation."""


def protocols() -> Protocols:
    """Return the installed protocols by name; each is loaded when it is looked up."""
    return installed


def decode(protocol: str, data: bytes, *, direction: Direction, **options: Any) -> Telegram:
    """Return the telegram that these bytes hold.

    options: the protocol's drive options, such as pnu_bits=11 (danfoss-fc) or type="int" (vabus). Raises TelegramError
    with a category if the bytes are not exactly one telegram, UsageError for an unknown protocol or option.
    """
    codec = _codec(protocol, direction, options)
    with _refused_as_telegram(protocol):
        message = codec.decode(bytes(data), direction)
    return Telegram(protocol=protocol, direction=direction, data=bytes(data), message=message)


def encode(protocol: str, fields: Mapping[str, Any], *, direction: Direction, **options: Any) -> bytes:
    """Return the bytes of the telegram with these fields, named as in `Telegram.fields`.

    Check characters and lengths are computed. Raises TelegramError if the fields do not make a telegram, UsageError for
    an unknown protocol or option.
    """
    codec = _codec(protocol, direction, options)
    with _refused_as_telegram(protocol):
        return codec.encode(installed[protocol].message(fields, direction))


@contextmanager
def _refused_as_telegram(protocol: str) -> Iterator[None]:
    """Raise TelegramError for any unexpected exception of a codec: its package is faulty, and so is the telegram."""
    try:
        yield
    except DriveCommError:
        raise
    except Exception as error:
        raise TelegramError(
            "field",
            f"{protocol} fails at this telegram ({type(error).__name__}: {error}); check its fields, and tell the "
            "maker of the package",
        ) from error


def _codec(protocol: str, direction: Direction, options: Mapping[str, Any]) -> Codec:
    plugin = installed[protocol]
    if direction not in ("request", "reply"):
        raise UsageError(f"a direction is 'request' or 'reply', not {direction!r}")
    return plugin.codec(protocol_options(plugin, options))
