"""What the telegrams of the Danfoss FC protocol say: one message for each block and direction.

Every message has the address format (`1-31` or `1-126`), the address or, for all drives, `broadcast`; and the two
process words, which are in every telegram: control word and reference from the master, status word and actual value
from the drive. ak, spm and pnu are the parts of PKE: command or response code, toggle bit, parameter number. spm is
None where PKE has none. What may be left out beside a parameter or a text commands nothing: control word 0, which a
drive ignores, reference 0, index 0, value 0, and of a text what says that it is written.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, TypeAlias

FORMAT_31, FORMAT_126 = "1-31", "1-126"
ADDRESS_FORMATS = (FORMAT_31, FORMAT_126)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Addressed:
    address_format: str = FORMAT_126
    broadcast: bool = False
    address: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class OfParameter(_Addressed):
    """What is about a parameter."""

    kind: ClassVar[str]
    ak: int
    spm: bool | None = None
    pnu: int
    ind: int


@dataclass(frozen=True, slots=True, kw_only=True)
class ProcessRequest(_Addressed):
    """The master commands, and asks for nothing but the status word."""

    kind: ClassVar[str] = "process"
    control_word: int
    reference: int


@dataclass(frozen=True, slots=True, kw_only=True)
class ProcessReply(_Addressed):
    """The drive tells its status word and actual value."""

    kind: ClassVar[str] = "process"
    status_word: int
    main_actual: int


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterRequest(OfParameter):
    """The master reads or writes a number, or asks for a text; pwe is the value, unsigned."""

    kind: ClassVar[str] = "parameter"
    ind: int = 0
    pwe: int = 0
    control_word: int = 0
    reference: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterReply(OfParameter):
    """The drive gives or confirms a number, or refuses with AK 7 and a fault code in pwe."""

    kind: ClassVar[str] = "parameter"
    pwe: int
    status_word: int
    main_actual: int


@dataclass(frozen=True, slots=True, kw_only=True)
class TextRequest(OfParameter):
    """The master writes a text."""

    kind: ClassVar[str] = "text"
    ak: int = 15
    ind: int = 0x0500
    text: str
    control_word: int = 0
    reference: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class TextReply(OfParameter):
    """The drive gives a text; the characters stand as they came, with whatever they are padded with."""

    kind: ClassVar[str] = "text"
    text: str
    status_word: int
    main_actual: int


Request: TypeAlias = ProcessRequest | ParameterRequest | TextRequest
Reply: TypeAlias = ProcessReply | ParameterReply | TextReply
REQUESTS = (ProcessRequest, ParameterRequest, TextRequest)
REPLIES = (ProcessReply, ParameterReply, TextReply)
