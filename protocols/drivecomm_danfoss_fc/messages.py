"""Messages of the Danfoss FC protocol, one for each block and direction, and the rules for replies.

Every message has the address format (`1-31` or `1-126`), and the address or, for all drives, `broadcast`. Every
telegram also has two process words: control word and reference from the master, status word and actual value from the
drive. ak, spm and pnu are the parts of PKE: command or response code, toggle bit, parameter number. spm is None if PKE
has no toggle bit. The defaults of a request command nothing: control word 0, which a drive ignores, reference 0, index
0, value 0. The defaults of a text request say that the text is written.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, TypeAlias

from drivecomm.protocol import Intent, difference
from drivecomm_danfoss_fc.tables import table
from drivecomm_danfoss_fc.words import VALID_BIT, has

if TYPE_CHECKING:
    from drivecomm.protocol import Message

FORMAT_31, FORMAT_126 = "1-31", "1-126"
ADDRESS_FORMATS = (FORMAT_31, FORMAT_126)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Addressed:
    address_format: str = FORMAT_126
    broadcast: bool = False
    address: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class OfParameter(_Addressed):
    """Message about a parameter."""

    kind: ClassVar[str]
    ak: int
    spm: bool | None = None
    pnu: int
    ind: int


@dataclass(frozen=True, slots=True, kw_only=True)
class ProcessRequest(_Addressed):
    """Request that commands the drive and reads only the status word."""

    kind: ClassVar[str] = "process"
    control_word: int
    reference: int


@dataclass(frozen=True, slots=True, kw_only=True)
class ProcessReply(_Addressed):
    """Reply with status word and actual value."""

    kind: ClassVar[str] = "process"
    status_word: int
    main_actual: int


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterRequest(OfParameter):
    """Request that reads or writes a number, or reads a text.

    pwe: the value, unsigned.
    """

    kind: ClassVar[str] = "parameter"
    ind: int = 0
    pwe: int = 0
    control_word: int = 0
    reference: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterReply(OfParameter):
    """Reply that returns or confirms a number, or refuses with AK 7 and a fault code in pwe."""

    kind: ClassVar[str] = "parameter"
    pwe: int
    status_word: int
    main_actual: int


@dataclass(frozen=True, slots=True, kw_only=True)
class TextRequest(OfParameter):
    """Request that writes a text."""

    kind: ClassVar[str] = "text"
    ak: int = 15
    ind: int = 0x0500
    text: str
    control_word: int = 0
    reference: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class TextReply(OfParameter):
    """Reply with a text; its characters are as received, with any padding."""

    kind: ClassVar[str] = "text"
    text: str
    status_word: int
    main_actual: int


Request: TypeAlias = ProcessRequest | ParameterRequest | TextRequest
Reply: TypeAlias = ProcessReply | ParameterReply | TextReply
REQUESTS = (ProcessRequest, ParameterRequest, TextRequest)
REPLIES = (ProcessReply, ParameterReply, TextReply)

_REFUSALS = (0, 7)
_LISTED_RESPONSES = (0, 1, 2, 3, 7, 15)
_NO_ACCESS, _TEXT = 0, 15
_READING_TEXT = frozenset([0x00, 0x04])
"""High bytes of IND with which a text is read and not written (specification, section 8)."""


def intent(request: Message) -> Intent:
    """Return the purpose of a request: access by its AK, and a command if bit 10 of its control word is set."""
    if not isinstance(request, REQUESTS):
        return Intent(commands=True)
    commands = has(request.control_word, VALID_BIT)
    if isinstance(request, ProcessRequest):
        return Intent(commands=commands)
    if request.ak == _TEXT:
        reads = isinstance(request, ParameterRequest) and request.ind >> 8 in _READING_TEXT
        return Intent(access="read" if reads else "write", commands=commands)
    access = table("commands").get(request.ak, {}).get("access", "")
    return Intent(access=access, commands=commands or (not access and request.ak != _NO_ACCESS))


def mismatch(request: Message, reply: Message) -> str:
    """Return the first field in which a sound reply does not belong to a request; empty if it belongs.

    Specification, section 6.2. The whole ADR is compared, including the address format: a drive returns it unchanged
    (seeds 001 and 004). An AK that no response table lists is accepted, so that the exchange can report it
    (specification, section 15, no. 29).
    """
    if not isinstance(request, REQUESTS) or not isinstance(reply, REPLIES):
        return "kind"
    if difference(request, reply, "address", "address_format", "broadcast"):
        return "address"
    if isinstance(request, ProcessRequest) or isinstance(reply, ProcessReply):
        return "" if isinstance(request, ProcessRequest) and isinstance(reply, ProcessReply) else "kind"
    if reply.pnu != request.pnu:
        return "pnu"
    if isinstance(request, TextRequest):
        # No manual states the reply to a text write, so AK alone decides (specification, section 8).
        return "ak" if reply.ak == 3 else ""
    known = table("commands").get(request.ak, {})
    if (reply.ind ^ request.ind) & (0x00FF if known.get("indexed") else 0xFFFF):
        return "ind"
    legal = reply.ak not in _LISTED_RESPONSES or reply.ak in known.get("answers", _REFUSALS)
    return "" if legal else "ak"
