"""Table of the methods: arguments, verbs of the server, and the words by which a plant file permits them."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from decimal import Decimal
from typing import TYPE_CHECKING, Any

from asyncua import ua

from drivecomm.errors import UsageError, suggestion
from drivecomm.server.opcua.nodes import standard

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

_NUMERAL = re.compile(r"[+-]?\d{1,20}(\.\d{1,20})?", re.ASCII)
_UNITS = {"Hz": "hz", "%": "percent", "rpm": "rpm"}
_TYPES = {
    ua.VariantType.Double: ua.ObjectIds.Double,
    ua.VariantType.UInt16: ua.ObjectIds.UInt16,
    ua.VariantType.Boolean: ua.ObjectIds.Boolean,
    ua.VariantType.String: ua.ObjectIds.String,
    ua.VariantType.Int32: ua.ObjectIds.Int32,
}


@dataclass(frozen=True, slots=True)
class Argument:
    """Input or output argument of a method."""

    name: str
    kind: ua.VariantType
    about: str

    @property
    def described(self) -> ua.Argument:
        """The argument in the form that clients see."""
        return ua.Argument(
            Name=self.name,
            DataType=standard(_TYPES[self.kind]),
            ValueRank=ua.Int32(ua.ValueRank.Scalar),
            Description=ua.LocalizedText(self.about),
        )


def _none(_: Sequence[Any]) -> Mapping[str, Any]:
    return {}


_OUTCOME = (
    Argument("Outcome", ua.VariantType.String, "done, refused, failed, or open: whether the drive acted is not known"),
    Argument("Text", ua.VariantType.String, "why it was not done"),
)
_LOCKED = (
    Argument("Status", ua.VariantType.Int32, "0 when it was done"),
    Argument("Text", ua.VariantType.String, "why it was not done"),
)
_NUMBER = Argument("Number", ua.VariantType.UInt16, "from 1 on")


@dataclass(frozen=True, slots=True, kw_only=True)
class Method:
    """Method.

    verb: verb of the server. word: permits it in a plant file. arguments: converts inputs to those of the verb.

    arguments raises UsageError for invalid inputs.
    """

    name: str
    about: str
    verb: str = ""
    word: str = ""
    takes: tuple[Argument, ...] = ()
    gives: tuple[Argument, ...] = _OUTCOME
    arguments: Callable[[Sequence[Any]], Mapping[str, Any]] = field(default=_none)


def _reference(given: Sequence[Any]) -> Mapping[str, Any]:
    value, unit = given
    if unit not in _UNITS:
        raise UsageError(f"a reference cannot be in {unit!r}; {suggestion(unit, _UNITS, 'give')}")
    return {_UNITS[unit]: Decimal(repr(value))}


def _written(given: Sequence[Any]) -> Mapping[str, Any]:
    parameter, text = given
    return {"parameter": parameter, "value": Decimal(text) if _NUMERAL.fullmatch(text) else text}


STOPS = (
    Method(name="Stop", verb="stop", about="Stop the motor on its ramp.", arguments=lambda _: {"how": "ramp"}),
    Method(
        name="QuickStop", verb="stop", about="Stop the motor on its quick ramp.", arguments=lambda _: {"how": "quick"}
    ),
    Method(name="Coast", verb="stop", about="Let the motor coast.", arguments=lambda _: {"how": "coast"}),
)

METHODS = (
    *STOPS,
    Method(name="Start", verb="start", word="start", about="Start the motor with the reference that is set."),
    Method(name="Reverse", verb="reverse", word="reverse", about="Start it in reverse, or reverse its direction."),
    Method(name="ResetFault", verb="reset", word="reset", about="Acknowledge a fault; this does not start the motor."),
    Method(
        name="SetReference",
        verb="set_reference",
        word="reference",
        about="Set the reference.",
        takes=(
            Argument("Value", ua.VariantType.Double, "in the unit that follows"),
            Argument("Unit", ua.VariantType.String, "Hz, % (of the reference range) or rpm"),
        ),
        arguments=_reference,
    ),
    Method(
        name="Jog",
        verb="jog",
        word="jog",
        about="Run at a jog speed until the next start or stop.",
        takes=(_NUMBER,),
        arguments=lambda given: {"number": given[0]},
    ),
    Method(name="Hold", verb="hold", word="hold", about="Keep the output frequency as it is."),
    Method(
        name="SelectSetup",
        verb="select_setup",
        word="select_setup",
        about="Use this set-up of parameters.",
        takes=(_NUMBER,),
        arguments=lambda given: {"number": given[0]},
    ),
    Method(
        name="SelectPreset",
        verb="select_preset",
        word="select_preset",
        about="Use this preset reference.",
        takes=(_NUMBER,),
        arguments=lambda given: {"number": given[0]},
    ),
    Method(
        name="SetRelay",
        verb="set_relay",
        word="set_relay",
        about="Switch a relay.",
        takes=(_NUMBER, Argument("On", ua.VariantType.Boolean, "whether to switch it on")),
        arguments=lambda given: {"number": given[0], "on": given[1]},
    ),
    Method(
        name="WriteParameter",
        verb="write",
        word="write",
        about="Write a parameter that the plant file lists; nothing is stored in EEPROM.",
        takes=(
            Argument("Parameter", ua.VariantType.String, "as the plant file names it"),
            Argument("Value", ua.VariantType.String, "a number, or the text of one of its options"),
        ),
        arguments=_written,
    ),
)

STOP_ALL = Method(name="StopAll", about="Stop all motors of the plant on their ramps.")

LOCKING = (
    Method(
        name="InitLock",
        about="Acquire the right to command this drive, for this session and some seconds.",
        takes=(Argument("Context", ua.VariantType.String, "the purpose, in words"),),
        gives=_LOCKED,
    ),
    Method(name="RenewLock", about="Renew the lock from now on.", gives=_LOCKED),
    Method(name="ExitLock", about="Release the lock.", gives=_LOCKED),
    Method(name="BreakLock", about="End the lock of another session of this door.", gives=_LOCKED),
)
