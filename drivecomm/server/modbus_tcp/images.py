"""What one connection has written to the command registers of one unit: its image, and what is new in it."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from math import isfinite
from typing import TYPE_CHECKING

from drivecomm.server.modbus_tcp.layout import (
    COMMAND_AT,
    COMMANDS,
    COMMANDS_END,
    HEARTBEAT_AT,
    REFERENCE_AT,
    REFERENCE_KIND_AT,
    REFERENCE_KINDS,
    SEQUENCE_AT,
    STOP_AT,
)
from drivecomm.server.modbus_tcp.requests import ExceptionCode, RefusedRequest

if TYPE_CHECKING:
    from collections.abc import Callable

SIZE = COMMANDS_END - STOP_AT


@dataclass(frozen=True, slots=True)
class Reference:
    """What a motor is to run at. kind: of `REFERENCE_KINDS`, 0 for none."""

    kind: int = 0
    value: float = 0.0

    @property
    def arguments(self) -> dict[str, float]:
        """How a command says it; nothing without a reference."""
        return {"percent": self.value} if self.kind == 1 else {"hz": self.value} if self.kind else {}


STEP_DIGITS = 2
"""References are rounded to 0.01: what a PLC computes has more digits than drives take, which round nothing."""


def nothing_held() -> None:
    """Release no stop, because the image holds none."""


class Image:
    """The command registers as one connection has written them, zeros before. address: of its peer.

    release_stop: ends the demand of the stop that it holds.

    heartbeat, sequence: the latest that were seen, None before the first: what is seen first only says where they
    stand, so that no old image starts anything.
    """

    def __init__(self, address: str) -> None:
        self.address = address
        self.is_connected = True
        self.words = [0] * SIZE
        self.heartbeat: int | None = None
        self.sequence: int | None = None
        self.release_stop: Callable[[], None] = nothing_held

    def merged(self, first: int, written: tuple[int, ...]) -> list[int]:
        """Return the registers with what is written. Raises RefusedRequest where they do not exist, or cut a number."""
        begin = first - STOP_AT
        end = begin + len(written)
        middle = REFERENCE_AT + 1 - STOP_AT
        if begin < 0 or end > SIZE or middle in (begin, end):
            raise RefusedRequest(ExceptionCode.ADDRESS)
        return [*self.words[:begin], *written, *self.words[end:]]

    @property
    def stop(self) -> int:
        """The stop that it holds, 0 for none."""
        return self.words[0]

    @property
    def command(self) -> int:
        """The command that it holds."""
        return self.words[COMMAND_AT - STOP_AT]

    @property
    def reference(self) -> Reference:
        """The reference that it holds."""
        return _reference(self.words)


def check(words: list[int]) -> None:
    """Raise RefusedRequest for registers that say nothing that could be meant."""
    command, reference = words[COMMAND_AT - STOP_AT], _reference(words)
    if (command and command not in COMMANDS) or reference.kind not in REFERENCE_KINDS or not isfinite(reference.value):
        raise RefusedRequest(ExceptionCode.VALUE)


def holds(first: int, written: tuple[int, ...], address: int) -> bool:
    """Whether a register is among those that are written."""
    return first <= address < first + len(written)


def heartbeat_of(words: list[int]) -> int:
    """Return the heartbeat in registers."""
    return words[HEARTBEAT_AT - STOP_AT]


def sequence_of(words: list[int]) -> int:
    """Return the sequence number in registers."""
    return words[SEQUENCE_AT - STOP_AT]


def _reference(words: list[int]) -> Reference:
    packed = struct.pack(">HH", *words[REFERENCE_AT - STOP_AT : REFERENCE_AT - STOP_AT + 2])
    return Reference(words[REFERENCE_KIND_AT - STOP_AT], round(struct.unpack(">f", packed)[0], STEP_DIGITS))
