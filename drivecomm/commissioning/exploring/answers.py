"""What came of one question to a drive."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from drivecomm.protocol import ParameterInfo, Reading


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """What a drive answered when it was asked for one address.

    told: its value, or what it says the parameter is; None where it told neither. absent: it says that it has no such
    parameter or element. code: with which it refused. reason: why nothing was told, as a sentence.
    """

    address: str
    told: Reading | ParameterInfo | None = None
    absent: bool = False
    code: int | None = None
    reason: str = ""
