"""Single telegrams by hand: bytes to fields and back, without a bus."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from drivecomm.errors import UsageError
from drivecomm.protocol.options import protocol_options
from drivecomm.protocol.registry import installed
from drivecomm.protocol.telegram import Telegram

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.protocol.framing import Codec
    from drivecomm.protocol.telegram import Direction


def decode(protocol: str, data: bytes, *, direction: Direction, **options: Any) -> Telegram:
    """Return the one telegram that these bytes are.

    options: the protocol's drive options, such as pnu_bits=11 (danfoss-fc) or type="int" (vabus). Raises TelegramError
    with a category when the bytes are no telegram, UsageError for an unknown protocol or option.
    """
    message = _codec(protocol, direction, options).decode(bytes(data), direction)
    return Telegram(protocol=protocol, direction=direction, data=bytes(data), message=message)


def encode(protocol: str, fields: Mapping[str, Any], *, direction: Direction, **options: Any) -> bytes:
    """Return the telegram with these fields, named as in `Telegram.fields`; checks and lengths are computed.

    Raises TelegramError when the fields make no telegram, UsageError for an unknown protocol or option.
    """
    codec = _codec(protocol, direction, options)
    return codec.encode(installed[protocol].message(fields, direction))


def _codec(protocol: str, direction: Direction, options: Mapping[str, Any]) -> Codec:
    plugin = installed[protocol]
    if direction not in ("request", "reply"):
        raise UsageError(f"a direction is 'request' or 'reply', not {direction!r}")
    return plugin.codec(protocol_options(plugin, options))
