"""What a VLT telegram says: one frozen dataclass for each kind and direction.

VLT Series 3500 manual, printed page 86 (control characters U, R, C, I) and page 92 (byte 19 = 9). A field that is None
is not in the telegram.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Literal, TypeAlias

from drivecomm_vlt3500 import words

if TYPE_CHECKING:
    from decimal import Decimal

ReplyKind: TypeAlias = Literal["update", "read", "read_index"]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Request:
    address: int
    control_word: int = words.IDLE
    control_mask: int | None = None
    unchecked: bool | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Update(_Request):
    """U: store a value in a parameter, and obey the control word.

    decimals: byte 19; None for the fewest that are exact. control_mask: the bits of the control word that are given,
    None for all. sign: byte 13 where it is neither `+` nor `-`. unchecked: sent with `??` instead of a checksum.
    """

    kind: ClassVar[ReplyKind] = "update"
    parameter: int
    value: Decimal
    decimals: int | None = None
    sign: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Read(_Request):
    """R: ask for the value of a parameter, and obey the control word; its data are not looked at."""

    kind: ClassVar[ReplyKind] = "read"
    parameter: int


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadIndex(_Request):
    """I: ask for one element of an indexed parameter, (n) or (x, y), and obey the control word.

    decimals: byte 19, how many of the five digits are y; 0 for one dimension, always 2 for two when it is sent.
    """

    kind: ClassVar[ReplyKind] = "read_index"
    parameter: int
    index: tuple[int, ...]
    decimals: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Control(_Request):
    """C: obey the control word and tell the status.

    Parameter and data are not looked at; parameter is None where its characters are no number. filler: bytes 9 to 19
    where they are anything but a number and `+000000`.
    """

    kind: ClassVar[str] = "control"
    control_word: int
    parameter: int | None = 0
    filler: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Reply:
    """The answer to U, R or I: status word, and either the value now in the parameter or why there is none."""

    kind: ReplyKind
    address: int
    status_word: int
    parameter: int
    value: Decimal | None = None
    decimals: int | None = None
    fault_code: int | None = None
    sign: str | None = None
    unchecked: bool | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ControlReply:
    """The answer to C: the status word; the rest is a copy of the request and means nothing."""

    kind: ClassVar[str] = "control"
    address: int
    status_word: int
    parameter: int | None = 0
    filler: str | None = None
    unchecked: bool | None = None


Request: TypeAlias = Update | Read | ReadIndex | Control
