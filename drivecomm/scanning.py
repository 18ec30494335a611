"""Who is on a line: which addresses are asked, and what is made of the answers."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from drivecomm.errors import NoReplyError, ReplyError
from drivecomm.registry import installed

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from drivecomm.exchange import Exchange
    from drivecomm.protocol import Operations, Protocol


@dataclass(frozen=True, slots=True, kw_only=True)
class Found:
    """A drive that a scan met: where, and what it tells of itself. sound: False if it answered with damage only."""

    protocol: str
    address: int
    identity: Mapping[str, str] = field(default_factory=dict)
    sound: bool
    detail: str = ""

    @property
    def name(self) -> str:
        """The drive as the command line names it."""
        return f"{self.protocol}:{self.address}"


def scan_plan(only: Iterable[str] | None, addresses: Iterable[int] | None) -> list[tuple[Protocol, int]]:
    """Return whom a scan asks, in order; addresses that a protocol does not have are left out."""
    plugins = [installed[name] for name in only] if only is not None else list(installed.working())
    wanted = None if addresses is None else list(addresses)
    return [
        (plugin, address)
        for plugin in plugins
        for address in (wanted if wanted is not None else plugin.scan_addresses)
        if address in plugin.addresses
    ]


def look(protocol: str, address: int, operations: Operations) -> Exchange[Found | None]:
    """Ask one address whether a drive is there and what it is; None when nobody answers."""
    try:
        yield from operations.probe()
    except NoReplyError:
        return None
    except ReplyError as error:
        return Found(protocol=protocol, address=address, sound=False, detail=str(error))
    try:
        identity = yield from operations.identify()
    except ReplyError as error:
        return Found(protocol=protocol, address=address, sound=True, detail=str(error))
    return Found(protocol=protocol, address=address, identity=identity, sound=True)
