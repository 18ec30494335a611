"""Where the values of a Huanyang drive stand, and how it is commanded.

`PD005` is a parameter, `CFG1` a status value. `CFG0`, the set frequency, is what function 05 writes. Control data have
no address; a virtual drive keeps them behind the 256 places that a telegram can name.
"""

from __future__ import annotations

import re
from decimal import Decimal
from typing import TYPE_CHECKING

from drivecomm.errors import ParameterAddressError
from drivecomm.profiles import Condition, ControlProfile, ControlTable, Place, State, Step, Target
from drivecomm.protocol import AddressSpace, DriveState, Stop, WordFormat
from drivecomm_huanyang.telegrams import REFUSED

if TYPE_CHECKING:
    from drivecomm.protocol import Model
    from drivecomm_huanyang.options import HuanyangOptions

MAXIMUM_HZ = "PD005"
SET_FREQUENCY, OUTPUT_FREQUENCY = "CFG0", "CFG1"
STEP_HZ = Decimal("0.01")
NEEDS_TO_START = {"PD001": (2,)}
NEEDS_TO_REVERSE = {**NEEDS_TO_START, "PD023": (1,)}
NEEDS_FOR_REFERENCE = {"PD002": (2,)}
"""2: from the communication port; PD023 = 0 forbids the motor to turn backwards (p. 25, 29)."""

CONTROL_PLACE, CNST, TURNS = "256", "CNST", "turns"
RUN, STOP, BACKWARDS = 0x01, 0x08, 0x10
"""Bits of CNTR: run, stop, r/f (p. 62). Programs in use send 01, 11 and 08, and no other bit of it."""
_LOOKED_AT = RUN | 0x04 | STOP | BACKWARDS

_TURNS = Condition(place=TURNS, mask=1, values=(1,))
_STANDS = Condition(place=TURNS, mask=1, values=(0,))
_OBEYED = (Condition(place=CNST, mask=RUN, values=(RUN,)), _TURNS)


def _starts(word: int) -> tuple[Step, ...]:
    return (Step(place=CONTROL_PLACE, word=word, mask=_LOOKED_AT, until=_OBEYED),)


PROFILE = ControlProfile(
    name="huanyang",
    source="HY Series Inverter, User Manual of 27 June 2010, p. 62; the values that are sent: programs in use",
    start=_starts(RUN),
    start_reverse=_starts(RUN | BACKWARDS),
    stops={Stop.RAMP: (Step(place=CONTROL_PLACE, word=STOP, mask=STOP, repeats=True),)},
    states=(
        State(name="running", known_by=_TURNS, means=DriveState.RUNNING),
        State(name="ready", known_by=_STANDS, means=DriveState.READY),
    ),
    bits={"running": (_TURNS,)},
)

CONTROL = ControlTable(profile=PROFILE, reference_hz=SET_FREQUENCY, plain_write="stored")

_ADDRESS = re.compile(r"PD([01][0-9]{2}|2[0-4][0-9]|25[0-5])|CFG([0-7])", re.ASCII)


def target(parameter: str, model: Model | None) -> Target:
    """Return what is to be read or written. Raises ParameterAddressError."""
    info = model.find(parameter) if model is not None else None
    address = info.address if info else parameter
    found = _ADDRESS.fullmatch(address) if isinstance(address, str) else None
    if found is None:
        raise ParameterAddressError(
            f"{parameter!r} is no parameter of a Huanyang drive; write PD005, with three digits up to PD255, or CFG0 "
            "to CFG7 for a status value"
        )
    return Target(
        address=address,
        place=Place("", int(found[1])) if found[1] else Place("i", int(found[2])),
        format=WordFormat(type="u16" if info else ""),
        wide=False,
        info=info,
        name=info.name if info and parameter == info.name else "",
    )


def address_space(_options: HuanyangOptions, _model: Model | None) -> AddressSpace:
    """Return the parameters of the manual's list, and the status values."""
    addresses = [*(f"PD{number:03d}" for number in range(184)), *(f"CFG{number}" for number in range(8))]
    return AddressSpace(
        addresses=addresses.__iter__,
        absent=frozenset({REFUSED}),
        source="PD000 to PD183, 81H for one that is not there: HY Series Inverter, User Manual, p. 18 to 24, 62",
    )
