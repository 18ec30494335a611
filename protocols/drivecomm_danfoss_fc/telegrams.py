"""The telegrams of the Danfoss FC protocol.

VLT 5000 Design Guide MG.52.B2.02 p. 84-99 (seed 001: p. 85); FC 101 Design Guide MG18C502 p. 82, section 7.4 (seed
004).

    process     STX LGE=6     ADR                          PCD1 PCD2 BCC
    parameter   STX LGE=14    ADR PKE IND PWE-high PWE-low PCD1 PCD2 BCC
    text        STX LGE=10+n  ADR PKE IND c...c            PCD1 PCD2 BCC

STX is 02H. LGE counts the bytes after itself. All words go high byte first, 32-bit values as two words, high word
first. PCD1 and PCD2 are control word and bus reference from the master, status word and actual value from the drive.
BCC is the exclusive-or of everything before it, STX included. There is no escape sequence and no end character: 02H may
occur anywhere in a telegram, so reception depends on LGE and on silence.

A parameter block and a text block of four characters are equally long; AK and IND distinguish them (specification,
section 4): text is a reply with AK 15, a request with AK 15 and IND 05xxH, and a reply with AK 3 and IND 6.

Faults to expect: a wrong BCC, a cut telegram, a reply of another drive or to an earlier request, AK 0 ("no response"),
the master's own telegram handed back by its adapter, which looks like a reply with value 0, and a telegram that broke
off with its repetition right after it, which can have a sound BCC.
"""

from __future__ import annotations

from functools import partial
from operator import attrgetter
from typing import TYPE_CHECKING, Any

from construct import this

from drivecomm.errors import TelegramError
from drivecomm.protocol import begins_again
from drivecomm.protocol.schema import (
    Check,
    Form,
    Leaf,
    characters,
    constant,
    kind_of,
    message_of,
    signed,
    unsigned,
    wrong_field,
    xor_byte,
)
from drivecomm_danfoss_fc.messages import (
    ADDRESS_FORMATS,
    FORMAT_31,
    FORMAT_126,
    REPLIES,
    REQUESTS,
    OfParameter,
)

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.protocol import Direction, Message
    from drivecomm_danfoss_fc.messages import Reply, Request

LONGEST_TEXT = 255 - 10

_STX = b"\x02"
_PROCESS_LGE, _PARAMETER_LGE, _EMPTY_TEXT_LGE = 6, 14, 10
_IND = 6


_NEVER_SENT = range(5, 13)
"""Commands of PROFIBUS and USS that no FC-protocol table lists (specification, section 6.1)."""


def _adr(*, broadcast_allowed: bool) -> Leaf:
    """Return the leaf for ADR, read as format, broadcast and address (seed 001, seed 004 section 7.4.4)."""

    def parse(found: bytes) -> tuple[str, bool, int | None]:
        if found[0] & 0x80:
            layout, broadcast, address = FORMAT_126, found[0] == 0x80, found[0] & 0x7F
        else:
            layout, broadcast, address = FORMAT_31, bool(found[0] & 0x20), found[0] & 0x1F
        if broadcast and not broadcast_allowed:
            raise ValueError(f"ADR {found[0]:02X} is the broadcast, and no drive answers with that")
        if not broadcast and address not in _addresses(layout):
            raise ValueError(f"ADR {found[0]:02X} is not an address")
        return layout, broadcast, None if broadcast else address

    def write(adr: tuple[str, bool, int | None]) -> bytes:
        layout, broadcast, address = adr
        if broadcast and not broadcast_allowed:
            raise ValueError("no drive answers with the broadcast address")
        if broadcast is not (address is None):
            raise ValueError("it is missing, or this is a broadcast, which has none")
        if not broadcast and (type(address) is not int or address not in _addresses(layout)):
            raise ValueError(f"{address!r} is not an address of format {layout}")
        number = address or 0
        return bytes([0x80 | number if layout == FORMAT_126 else number | (0x20 if broadcast else 0)])

    return Leaf(1, parse, write, meaning="ADR: 80H + 1..126, or 1..31; 80H, 20H for all")


def _addresses(layout: str) -> range:
    return range(1, 32) if layout == FORMAT_31 else range(1, 127)


def _pke(pnu_bits: int) -> Leaf:
    """Return the leaf for PKE, read as AK, toggle bit (None with twelve bits of PNU) and PNU."""
    mask = 2**pnu_bits - 1

    def parse(found: bytes) -> tuple[int, bool | None, int]:
        word = int.from_bytes(found, "big")
        return word >> 12, bool(word >> 11 & 1) if pnu_bits == 11 else None, word & mask

    def write(pke: tuple[int, bool | None, int]) -> bytes:
        ak, spm, pnu = pke
        return (ak << 12 | bool(spm) << 11 | pnu).to_bytes(2, "big")

    return Leaf(2, parse, write, meaning=f"PKE: AK in bits 12..15, PNU in bits 0..{pnu_bits - 1}")


def _lge_of_text() -> Leaf:
    def parse(found: bytes) -> int:
        if found[0] < _EMPTY_TEXT_LGE:
            raise ValueError(f"LGE {found[0]} is too short for a text block")
        return found[0] - _EMPTY_TEXT_LGE

    return Leaf(
        1, parse, lambda count: bytes([_EMPTY_TEXT_LGE + count]), category="length", meaning="LGE: 10 + characters"
    )


_HEAD = constant(_STX, "STX")
_BCC = Check(1, 0, xor_byte, meaning="BCC: exclusive-or of all bytes before it")
_FROM_MASTER = (
    "address" / _adr(broadcast_allowed=True),
    ("control_word" / unsigned(2, "PCD1: control word"), "reference" / signed(2, "PCD2: 4000H = 100 %")),
)
_FROM_DRIVE = (
    "address" / _adr(broadcast_allowed=False),
    ("status_word" / unsigned(2, "PCD1: status word"), "main_actual" / signed(2, "PCD2: 4000H = 100 %")),
)


def _forms(pnu_bits: int) -> dict[type[Any], Form[Any]]:
    """Return the form of each message for a width of the parameter number."""
    pke = "pke" / _pke(pnu_bits)
    ind = "ind" / unsigned(2, "IND: text command or 0, array index")
    pwe = "pwe" / unsigned(4, "PWE: value, high word first")
    text = "text" / characters(this.characters, lowest=0, highest=255, meaning="characters, ISO 8859-1")
    lge_process, lge = constant(bytes([_PROCESS_LGE]), "LGE: 6"), constant(bytes([_PARAMETER_LGE]), "LGE: 14")
    check = partial(_check, pnu_bits=pnu_bits)
    forms: dict[type[Any], Form[Any]] = {}
    for messages, (adr, pcd) in ((REQUESTS, _FROM_MASTER), (REPLIES, _FROM_DRIVE)):
        blocks: Any = (
            ((lge_process, adr), _READS, _WRITES),
            ((lge, adr, pke, ind, pwe), _READS_PKE, _WRITES_PKE),
            (("characters" / _lge_of_text(), adr, pke, ind, text), _READS_PKE, _WRITES_TEXT),
        )
        for message, (leaves, reads, writes) in zip(messages, blocks, strict=True):
            forms[message] = Form(message, _HEAD, *leaves, *pcd, _BCC, reads=reads, writes=writes, check=check)
    return forms


_READS: dict[str, Any] = {"address_format broadcast address": lambda address: address}
_READS_PKE: dict[str, Any] = {**_READS, "ak spm pnu": lambda pke: pke}
_WRITES: dict[str, Any] = {"address": attrgetter("address_format", "broadcast", "address")}
_WRITES_PKE: dict[str, Any] = {**_WRITES, "pke": attrgetter("ak", "spm", "pnu")}
_WRITES_TEXT: dict[str, Any] = {**_WRITES_PKE, "characters": lambda message: _length(message.text)}


def _check(message: Request | Reply, *, pnu_bits: int) -> None:
    if message.address_format not in ADDRESS_FORMATS:
        raise wrong_field("address_format", f"{message.address_format!r} is neither 1-31 nor 1-126")
    if type(message.broadcast) is not bool:
        raise wrong_field("broadcast", f"{message.broadcast!r} is neither true nor false")
    if isinstance(message, OfParameter):
        _check_pke(message, pnu_bits, "request" if isinstance(message, REQUESTS) else "reply")


def _check_pke(message: OfParameter, pnu_bits: int, direction: Direction) -> None:
    asks = direction == "request"
    if type(message.ak) is not int or message.ak not in range(16):
        raise wrong_field("ak", f"{message.ak!r} does not fit the four bits of AK")
    if type(message.pnu) is not int or message.pnu not in range(2**pnu_bits):
        raise wrong_field("pnu", f"{message.pnu!r} does not fit {pnu_bits} bits of PNU")
    if message.spm is not None and (pnu_bits != 11 or type(message.spm) is not bool):
        raise wrong_field("spm", f"{message.spm!r}: there is a toggle bit beside 11 bits of PNU only, true or false")
    if message.spm and asks:
        raise wrong_field("spm", "the toggle bit is for spontaneous messages on PROFIBUS; on RS-485 a master sends 0")
    if asks and message.ak in _NEVER_SENT:
        raise wrong_field("ak", f"AK {message.ak} is in no command table of the FC protocol and is not sent")
    if type(message.ind) is not int:
        raise wrong_field("ind", f"{message.ind!r} is not a number")
    if is_text(message.ak, message.ind, direction) is not (message.kind == "text"):
        raise wrong_field(
            "ak", f"AK {message.ak} with IND {message.ind:04X} in a {direction} is not a {message.kind} block"
        )


def _length(text: object) -> int:
    if not isinstance(text, str):
        raise wrong_field("text", f"{text!r} is not a text")
    if len(text) > LONGEST_TEXT:
        raise wrong_field("text", f"{len(text)} characters are more than the {LONGEST_TEXT} that LGE can count")
    return len(text)


def is_text(ak: int, ind: int, direction: Direction) -> bool:
    """Return whether a block is a text block and not a parameter block (specification, section 4)."""
    if direction == "request":
        return ak == 15 and ind >> 8 == 5
    return ak == 15 or (ak == 3 and ind & 0xFF == 6)


_FORMS_11, _FORMS_12 = _forms(11), _forms(12)


class DanfossFcCodec:
    """Codec of the telegrams, in both address formats.

    pnu_bits: 12 (FC series), or 11 with the toggle bit above them (VLT 2800, 5000, 6000, 8000).
    """

    def __init__(self, pnu_bits: int = 12) -> None:
        self.pnu_bits = pnu_bits
        self._forms = _FORMS_11 if pnu_bits == 11 else _FORMS_12

    def measure(self, head: bytes, direction: Direction) -> int:
        """Return the length of the telegram that begins with these bytes, see `Codec.measure`.

        A drive also receives telegrams of other makers, in which 02H is common. It waits for a long telegram only if
        the next bytes can belong to a text write.
        """
        if not head:
            return _PROCESS_LGE + 2
        if head[:1] != _STX:
            return 0
        if len(head) < 2:
            return 2
        lge = head[1]
        if lge != _PROCESS_LGE and lge < _EMPTY_TEXT_LGE:
            return 0
        if direction == "request" and lge not in (_PROCESS_LGE, _PARAMETER_LGE):
            if len(head) < 6:
                return 6
            if not is_text(head[3] >> 4, head[5] << 8, direction):
                return 0
        return lge + 2

    def decode(self, data: bytes, direction: Direction) -> Message:
        """Return the content of one telegram."""
        process, parameter, texts = REQUESTS if direction == "request" else REPLIES
        lge = data[1] if len(data) > 1 else 0
        if lge == _PROCESS_LGE:
            return self._parse(process, data)
        of_text = len(data) > _IND and is_text(data[3] >> 4, int.from_bytes(data[5:7], "big"), direction)
        if lge == _PARAMETER_LGE and not of_text:
            return self._parse(parameter, data)
        message = self._parse(texts, data)
        if not of_text:
            raise TelegramError("length", f"LGE {lge} fits only a text block, which AK {data[3] >> 4} is not")
        return message

    def encode(self, message: Message) -> bytes:
        """Return the bytes of one telegram."""
        return self._forms[type(message)].build(message)

    def _parse(self, message: type[Any], data: bytes) -> Message:
        parsed: Message = self._forms[message].parse(data)
        if begins_again(data):
            raise TelegramError("framing", "a telegram that broke off and its repetition, run together")
        return parsed


def message_from(given: Mapping[str, Any], direction: Direction) -> Message:
    """Build a message from fields as test vectors name them."""
    chosen = kind_of(REQUESTS if direction == "request" else REPLIES, given)
    message: Message = message_of(chosen, given, f"a {chosen.kind} block")
    return message


def titled_forms() -> dict[str, Form[Any]]:
    """Return the forms of all telegrams by their human-readable titles, with twelve bits of PNU."""
    sides: Any = zip(REQUESTS + REPLIES, ["master"] * 3 + ["drive"] * 3, strict=True)
    return {f"{message.kind.capitalize()} block, {side}": _FORMS_12[message] for message, side in sides}
