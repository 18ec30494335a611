"""Telegrams of MOVILINK over RS-485 (MOVIDRIVE MDX60B/61B communication manual, p. 21 to 28).

    02 or 1D  ADR  TYP  [parameter channel, 8 bytes]  [1 to 3 process words]  BCC

02 begins the master's telegrams, 1D those of a drive. BCC is the exclusive-or of all bytes before it (p. 27). TYP
determines the length. Bit 7 of TYP makes a telegram acyclic; only cyclic ones arm a drive's timeout (p. 21). The
parameter channel comes before the process data (PROFIBUS interface DFP21B, section 5.2).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from drivecomm.protocol import schema
from drivecomm.protocol.schema import unsigned, wrong_field

ADDRESSES, NO_GROUP, BROADCAST = range(100), 100, 255
_REPLYING = (*ADDRESSES, 254)
_CALLED = (*_REPLYING, *range(NO_GROUP, 200), BROADCAST)
"""Valid addresses of a request (p. 23): 100 + n is group n, 254 any drive that hears it, 255 all.

253 is for programs inside a drive.
"""
PARAMETER, CYCLIC = 0x86, {2: 0x03, 3: 0x05}  # TYP: acyclic, without a command; process data by the number of words
_CONTENTS = {0x00: (8, 1), 0x01: (0, 1), 0x02: (8, 2), 0x03: (0, 2), 0x04: (8, 3), 0x05: (0, 3), 0x06: (8, 0)}
"""Size of the parameter channel in bytes and number of process words, by TYP without bit 7 (p. 27)."""
_CHANNEL = (
    "management" / unsigned(1, "management: service, length, handshake, error"),
    "subindex" / unsigned(1, "subindex"),
    "index" / unsigned(2, "index"),
    "value" / unsigned(4, "value, or error class, error code and additional code"),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Telegram:
    """Fields of both directions. pd: process words.

    The last four fields are the parameter channel, None without one.
    """

    address: int
    type: int
    pd: tuple[int, ...] = ()
    management: int | None = None
    subindex: int | None = None
    index: int | None = None
    value: int | None = None

    @property
    def kind(self) -> str:
        """Process data, a parameter channel, or both."""
        return f"{'parameter ' * (self.management is not None)}{'process' if self.pd else ''}".strip()


class Request(Telegram):
    """A telegram of the master. pd: control word, speed, ramp."""


class Reply(Telegram):
    """A telegram of a drive. pd: status word 1 and two values that are selected at the drive."""

    @property
    def status_word(self) -> int:
        """Status word 1; the low word of the value if it was read as a parameter."""
        return self.pd[0] if self.pd else (self.value or 0) & 0xFFFF


def _form(message: type[Telegram], low: int) -> schema.Form[Any]:
    (channel, words), types = _CONTENTS[low], (low, low | 0x80)
    start, addresses = (b"\x02", _CALLED) if message is Request else (b"\x1d", _REPLYING)
    content = "content" / schema.characters(2 * words, lowest=0, highest=0xFF, meaning="process words")

    def check(given: Telegram) -> None:
        if len(schema.numbers(given.pd, 0xFFFF, "pd")) != words:
            raise wrong_field("pd", f"a telegram {given.type:02X} has {words} process words, not {len(given.pd)}")
        if given.address == NO_GROUP:
            raise wrong_field("address", "100 is the group of drives without a group, and none obeys it")
        if message is Request and words and given.pd[0] & 7 == 7:
            raise wrong_field("pd", f"{given.pd[0]:04X} enables, and inhibits by bit 0; give 0006 or 0001")

    return schema.Form(
        message,
        schema.constant(start, f"start of a {message.__name__.lower()}"),
        "address" / schema.deciding(schema.choice({bytes([each]): each for each in addresses}, "ADR")),
        "type" / schema.deciding(schema.choice({bytes([each]): each for each in types}, "TYP, bit 7: acyclic")),
        *(_CHANNEL if channel else ()),
        *((content,) if words else ()),
        schema.CheckCharacters(1, 0, schema.xor_byte, meaning="BCC: exclusive-or of all bytes before it"),
        reads={"pd": schema.words_in} if words else None,
        writes={"content": lambda given: schema.words_as(given.pd)} if words else None,
        check=check,
    )


TELEGRAMS = schema.Telegrams(
    {f"{low:02X} and {low | 0x80:02X}": _form(Request, low) for low in _CONTENTS},
    {f"{low:02X} and {low | 0x80:02X}, drive": _form(Reply, low) for low in _CONTENTS},
)
