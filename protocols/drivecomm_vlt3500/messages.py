"""Contents of VLT telegrams: one frozen dataclass for each kind and direction.

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
    None for all. sign: byte 13 if it is neither `+` nor `-`. unchecked: sent with `??` instead of a checksum.
    """

    kind: ClassVar[ReplyKind] = "update"
    parameter: int
    value: Decimal
    decimals: int | None = None
    sign: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Read(_Request):
    """R: read the value of a parameter, and obey the control word; the drive ignores its data."""

    kind: ClassVar[ReplyKind] = "read"
    parameter: int


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadIndex(_Request):
    """I: read one element of an indexed parameter, (n) or (x, y), and obey the control word.

    decimals: byte 19, the number of digits of y among the five; 0 for one dimension, always 2 for two in requests from
    here.
    """

    kind: ClassVar[ReplyKind] = "read_index"
    parameter: int
    index: tuple[int, ...]
    decimals: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Control(_Request):
    """C: obey the control word and return the status.

    The drive ignores parameter and data; parameter is None if its characters are not a number. filler: bytes 9 to 19 if
    they are anything but a number and `+000000`.
    """

    kind: ClassVar[str] = "control"
    control_word: int
    parameter: int | None = 0
    filler: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Reply:
    """The answer to U, R or I: status word, and either the present value of the parameter or the cause of a refusal."""

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
    """The answer to C: the status word; the rest is a copy of the request without meaning."""

    kind: ClassVar[str] = "control"
    address: int
    status_word: int
    parameter: int | None = 0
    filler: str | None = None
    unchecked: bool | None = None


Request: TypeAlias = Update | Read | ReadIndex | Control
