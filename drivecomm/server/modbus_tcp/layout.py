"""Register layout of a unit: the same addresses for every drive, so that a PLC program is written only once.

Addresses count from 0, as in telegrams. A value takes four registers: two for the number, higher word first, then its
quality and its age. New entries take free addresses; existing ones never move.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias

from drivecomm.models import quantities

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

NumberType: TypeAlias = Literal["float32", "uint32"]

VERSION = 1
"""Version of this layout, which is also in the first register."""

VERSION_AT, STATE_AT, RAW_WORD_AT, FAULT_AT, STATUS_QUALITY_AT, STATUS_AGE_AT = range(6)
FIRST_QUANTITY = 8
VALUE_WORDS = 4
FIXED_END = 120
"""End of the state and the common quantities: one telegram of 125 registers holds them all."""
FIRST_OWN, LAST_OWN = 200, 996
"""Addresses at which the plant file may place further values of a drive."""

_FLOATS = (
    *("output_frequency", "output_current", "output_voltage", "output_power", "dc_link_voltage", "torque_percent"),
    *("torque", "motor_speed", "reference_frequency", "reference_percent", "heat_sink_temperature"),
    *("motor_thermal_load", "drive_thermal_load", "operating_hours", "running_hours", "energy"),
)
_WHOLE = ("fault_code", "alarm_word", "warning_word")
_MORE_WHOLE = frozenset({"status_word", "control_word", "power_ups", "bus_address"})

FIXED_QUANTITIES: Sequence[tuple[int, str]] = tuple(
    (FIRST_QUANTITY + VALUE_WORDS * place, name) for place, name in enumerate((*_FLOATS, *_WHOLE))
)
"""Address and name of each common quantity, the same on every drive."""

STOP_AT, HEARTBEAT_AT, SEQUENCE_AT, COMMAND_AT, REFERENCE_KIND_AT = range(1000, 1005)
REFERENCE_AT = 1006
COMMANDS_END = 1008
"""End of the command registers; the registers with the results follow."""
ANSWERED_AT, OUTCOME_AT, REASON_AT, LEASE_AT, LEASE_LEFT_AT = range(1008, 1013)
REFERENCE_OUTCOME_AT, REFERENCE_REASON_AT, STOP_OUTCOME_AT = range(1013, 1016)
RESULTS_END = 1016

STATE_BITS = (
    "what the other bits say is current",
    "the drive answers",
    "ready: would start on command",
    "running: the motor is being driven",
    "at reference",
    "fault: tripped, needs a reset",
    "warning",
    "the motor turns backwards",
    "stopping: a quick stop is under way",
    "remote: the bus may command the drive",
    "the server keeps the motor running, and treats it by its link-loss policy when its commander is lost",
    "the lease of the drive is held",
    "a stop stands: it is not confirmed and retried, or a stop register demands it",
)
"""Meanings of the bits of the state word, from bit 0 on."""

COMMANDS = {1: "start", 2: "start backwards", 3: "reset a fault", 4: "send the reference again"}
REFERENCE_KINDS = {0: "none", 1: "per cent", 2: "Hz"}
STOPS = {1: "ramp", 2: "coast", 3: "quick", 4: "dc_brake"}


@dataclass(frozen=True, slots=True)
class OwnRegister:
    """Further value of one drive. name: as polled by the plant. address: address of its first register."""

    name: str
    address: int
    type: NumberType


@dataclass(frozen=True, slots=True, kw_only=True)
class RegisterRow:
    """Row of the register map: one or more registers with one meaning.

    written: whether commands write it. about: name of the value whose quality or age it holds.
    """

    address: int
    words: int
    type: str
    name: str
    unit: str = ""
    meaning: str = ""
    written: bool = False
    about: str = ""


def number_type(name: str) -> NumberType:
    """Return the default type of a value's registers: uint32 for bits and whole numbers, else float32."""
    return "uint32" if name in _WHOLE or name in _MORE_WHOLE else "float32"


def state_rows() -> Iterator[RegisterRow]:
    """Yield the registers with the state of a drive, which come before its values."""

    def row(address: int, name: str, meaning: str) -> RegisterRow:
        return RegisterRow(address=address, words=1, type="uint16", name=name, meaning=meaning)

    yield row(VERSION_AT, "layout", f"version of this layout: {VERSION}")
    yield row(STATE_AT, "state", "the state word: bits that mean the same on every drive")
    yield row(RAW_WORD_AT, "raw_status_word", "the drive's own status word, in the maker's bits")
    yield row(FAULT_AT, "active_fault", "number of the active fault; 0 without one, 65535 where it is not told")
    yield row(STATUS_QUALITY_AT, "status_quality", "quality of the three words before")
    yield row(STATUS_AGE_AT, "status_age", "their age in 0.1 s")


def value_rows(address: int, name: str, number: NumberType) -> Iterator[RegisterRow]:
    """Yield the registers of one value."""
    known = quantities().get(name)
    unit, meaning = (known.unit, known.meaning) if known else ("", "as the drive's model has it")
    yield RegisterRow(address=address, words=2, type=number, name=name, unit=unit, meaning=meaning)
    for offset, what in ((2, "quality"), (3, "age")):
        said = "how far it can be believed" if what == "quality" else "its age in 0.1 s; 65535 without a value"
        yield RegisterRow(
            address=address + offset, words=1, type="uint16", name=f"{name}_{what}", meaning=said, about=name
        )


def fixed_rows() -> Iterator[RegisterRow]:
    """Yield the registers that are the same for every drive."""
    yield from state_rows()
    for address, name in FIXED_QUANTITIES:
        yield from value_rows(address, name, number_type(name))


def command_rows() -> Iterator[RegisterRow]:
    """Yield the command registers and those with the results."""

    def row(address: int, name: str, meaning: str, *, words: int = 1, number: str = "uint16") -> RegisterRow:
        written = address < COMMANDS_END
        return RegisterRow(address=address, words=words, type=number, name=name, meaning=meaning, written=written)

    stops = ", ".join(f"{code} {how}" for code, how in STOPS.items())
    codes = ", ".join(f"{code} {what}" for code, what in COMMANDS.items())
    yield row(STOP_AT, "stop", f"0 none, {stops}; any other number is a ramp; needs no lease")
    yield row(HEARTBEAT_AT, "heartbeat", "counts up while the commander lives, which holds the lease; 0 gives it back")
    yield row(SEQUENCE_AT, "sequence", "a command is carried out once when this changes")
    yield row(COMMAND_AT, "command", codes)
    kinds = ", ".join(f"{code} {what}" for code, what in REFERENCE_KINDS.items())
    yield row(REFERENCE_KIND_AT, "reference_kind", f"what the reference is: {kinds}")
    yield row(1005, "reserved", "whatever is written")
    yield row(REFERENCE_AT, "reference", "sent when it changes, while the lease is held", words=2, number="float32")
    yield row(ANSWERED_AT, "answered_sequence", "the sequence number that the outcome is about")
    yield row(OUTCOME_AT, "outcome", "outcome of the command")
    yield row(REASON_AT, "reason", "why it was not done")
    yield row(LEASE_AT, "lease", "0 not held, 1 held by this address, 2 held by another commander")
    yield row(LEASE_LEFT_AT, "lease_left", "for how long this address still has the lease, in 0.1 s")
    yield row(REFERENCE_OUTCOME_AT, "reference_outcome", "outcome of the latest reference")
    yield row(REFERENCE_REASON_AT, "reference_reason", "why it was not sent, or not taken")
    yield row(STOP_OUTCOME_AT, "stop_outcome", "present outcome of the latest stop")
