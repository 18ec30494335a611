"""What requests may hold, as pydantic fields: FastAPI checks by them, and describes them in OpenAPI.

A field of a body that is not given is None, and not among its `model_fields_set`: what it then means is decided where
it is used. In a schema, `x-local` marks a field that only the local door takes, and `x-network` one that doors to a
network need.
"""

from __future__ import annotations

from decimal import Decimal
from typing import Annotated, Any
from urllib.parse import unquote

from fastapi import Path, Query
from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, WithJsonSchema

from drivecomm.protocol import Stop
from drivecomm.server import NEEDS

LONGEST_TEXT = 4096
"""Characters of a text in a request; a telegram or a note is far below it."""


def _inexact(given: Any) -> Any:
    return float(given) if isinstance(given, Decimal) else given


Text = Annotated[str, Field(max_length=LONGEST_TEXT)]
Number = Annotated[float, BeforeValidator(_inexact), Field(allow_inf_nan=False)]
Time = Annotated[Number, Field(ge=0, le=1e11)]
Names = Annotated[
    list[Text], BeforeValidator(lambda given: [name for each in given for name in each.split(",") if name])
]
Options = dict[str, Any]
Limit = Annotated[int, Query(ge=1, le=10_000, description="how many at most")]
LOCAL: Any = {"x-local": True}
NETWORK: Any = {"x-network": True}

# Routes match the path as it was sent, so that a slash in a name divides nothing.
_SENT = AfterValidator(unquote)
DriveName = Annotated[str, _SENT, Path(description="the drive's name in the plant")]
DriveAddress = Annotated[str, _SENT, Path(description="PROTOCOL:ADDRESS")]
LineName = Annotated[str, _SENT, Path(description="the line's name in the plant")]
AlarmId = Annotated[str, _SENT, Path(description="the alarm's id")]
Verb = Annotated[str, _SENT, WithJsonSchema({"type": "string", "enum": sorted(NEEDS)}), Path(description="what to do")]


def _optional(about: str, where: Any = None, **limits: Any) -> Any:
    return Field(None, description=about, json_schema_extra=where, **limits)


class _Body(BaseModel):
    # No text is taken for a number.
    model_config = ConfigDict(extra="forbid", strict=True)


class Credentials(_Body):
    """Who logs in."""

    name: Text = Field(description="the user's name")
    password: Text = Field(description="the user's password")


class StopAll(_Body):
    """What to stop, and how."""

    how: Annotated[Stop, Field(strict=False)] = _optional("ramp unless given")
    lines: list[Text] = _optional("the names of lines; all unless given")


class TakeLease(_Body):
    """For how long to command a drive."""

    seconds: Number = Field(ge=0.1, le=30, description="for how long, until it is renewed")


class EndLease(_Body):
    """A lease of the caller."""

    key: Text = Field(description="the key that came with the lease")


class RenewLease(EndLease, TakeLease):
    """A lease of the caller, and for how long to have it."""


class Fresh(_Body):
    """What every command may have, besides what its verb takes."""

    id: Text = _optional("a text of your choice; the same again gets the first answer again", NETWORK)
    lease: Text = _optional("the key of the lease under which it is asked")
    arm: bool = _optional("command a drive that the plant file does not arm", LOCAL)
    options: Options = _optional("what you say of the drive, such as its model", LOCAL)
    issued_s: Time = _optional("when the command was given, in seconds since 1970")
    valid_s: Number = _optional("for how many seconds it counts; 2 unless given", ge=0.001, le=10)
    session: Text = _optional("the session of the plant that it is meant for")


class CarryOut(Fresh):
    """The arguments of a verb, and what makes the command fresh."""

    arguments: Options = _optional("the arguments of the verb, by their names")


class StopDrive(CarryOut):
    """How to stop a drive: a stop acts each time that it comes, so that nothing has to tell it apart."""

    id: Text = _optional("a text of your choice, for the answer")


class Keep(Fresh):
    """How a motor is started and kept running."""

    policy: Text = _optional("what the motor does when its master falls silent; as the plant says")
    watchdog_s: Number = _optional("after how many seconds the drive notices", ge=0.001, le=3600)
    reverse: bool = _optional("backwards")
    percent: Number = _optional("the reference, as a share of its range")
    hz: Number = _optional("the reference, as an output frequency")
    by: Options = _optional("verb (jog, call, write) and arguments to start by", LOCAL)
    start: bool = _optional("false: not started, which commands then do", LOCAL)


class _Examined(_Body):
    only: list[Text] = _optional("these protocols only")
    addresses: list[int] = _optional("these addresses only")
    options: Options = _optional("line settings and timing for all drives, and further options")


class Scan(_Examined):
    """How to look for drives."""

    choices: Options = _optional("the line settings to try")


class Doctor(_Examined):
    """How to examine a line."""

    probes: int = _optional("how often each drive is asked", ge=1, le=1000)
    search: bool = _optional("whether drives that do not answer are given more time")
    rates: bool = _optional("whether other baud rates are tried where nobody answers")
