"""The image of one connection: the contents it has written to the command registers of one unit."""

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
    """Reference of a motor. kind: one of `REFERENCE_KINDS`, 0 for none."""

    kind: int = 0
    value: float = 0.0

    @property
    def arguments(self) -> dict[str, float]:
        """Arguments of a command for this reference; empty without one."""
        return {"percent": self.value} if self.kind == 1 else {"hz": self.value} if self.kind else {}


STEP_DIGITS = 2
"""Decimals of a reference: a PLC computes more digits than drives accept, and drives do not round."""


def nothing_held() -> None:
    """Release no stop, because the image holds none."""


class RegisterImage:
    """Command registers as written by one connection, initially zero. address: address of the peer.

    release_stop: ends the demand for the stop in the image. heartbeat, sequence: last seen, None before the first. The
    first one only sets the starting point, so that an old image starts nothing.
    """

    def __init__(self, address: str) -> None:
        self.address = address
        self.is_connected = True
        self.words = [0] * SIZE
        self.heartbeat: int | None = None
        self.sequence: int | None = None
        self.release_stop: Callable[[], None] = nothing_held

    def merged(self, first: int, written: tuple[int, ...]) -> list[int]:
        """Return the registers after a write. Raises RefusedRequest for a missing register or half a number."""
        begin = first - STOP_AT
        end = begin + len(written)
        middle = REFERENCE_AT + 1 - STOP_AT
        if begin < 0 or end > SIZE or middle in (begin, end):
            raise RefusedRequest(ExceptionCode.ADDRESS)
        return [*self.words[:begin], *written, *self.words[end:]]

    @property
    def stop(self) -> int:
        """Code in the stop register, 0 for none."""
        return self.words[0]

    @property
    def command(self) -> int:
        """Code in the command register."""
        return self.words[COMMAND_AT - STOP_AT]

    @property
    def reference(self) -> Reference:
        """Reference in the registers."""
        return _reference(self.words)


def check(words: list[int]) -> None:
    """Raise RefusedRequest for an unknown command, an unknown kind of reference or a reference that is not finite."""
    command, reference = words[COMMAND_AT - STOP_AT], _reference(words)
    if (command and command not in COMMANDS) or reference.kind not in REFERENCE_KINDS or not isfinite(reference.value):
        raise RefusedRequest(ExceptionCode.VALUE)


def holds(first: int, written: tuple[int, ...], address: int) -> bool:
    """Whether a write includes a register. first: address of the first written register."""
    return first <= address < first + len(written)


def heartbeat_of(words: list[int]) -> int:
    """Return the heartbeat from the command registers."""
    return words[HEARTBEAT_AT - STOP_AT]


def sequence_of(words: list[int]) -> int:
    """Return the sequence number from the command registers."""
    return words[SEQUENCE_AT - STOP_AT]


def _reference(words: list[int]) -> Reference:
    packed = struct.pack(">HH", *words[REFERENCE_AT - STOP_AT : REFERENCE_AT - STOP_AT + 2])
    return Reference(words[REFERENCE_KIND_AT - STOP_AT], round(struct.unpack(">f", packed)[0], STEP_DIGITS))
