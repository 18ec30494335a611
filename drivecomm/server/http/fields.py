"""Pydantic fields of requests: FastAPI validates with them and describes them in OpenAPI.

A field that is missing from a body is None and not in `model_fields_set`; the code that uses the field decides what
that means. In a schema, `x-local` marks a field that only the local door accepts, and `x-network` a field that network
doors require.
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
"""Maximum characters of a text in a request, far above any telegram or note."""


def _inexact(given: Any) -> Any:
    return float(given) if isinstance(given, Decimal) else given


Text = Annotated[str, Field(max_length=LONGEST_TEXT)]
Number = Annotated[float, BeforeValidator(_inexact), Field(allow_inf_nan=False)]
Time = Annotated[Number, Field(ge=0, le=1e11)]
Names = Annotated[
    list[Text], BeforeValidator(lambda given: [name for each in given for name in each.split(",") if name])
]
Options = dict[str, Any]
Limit = Annotated[int, Query(ge=1, le=10_000, description="the maximum number of entries")]
LOCAL: Any = {"x-local": True}
NETWORK: Any = {"x-network": True}

# Routes match the path before it is unquoted, so that a quoted slash in a name does not split the path.
_SENT = AfterValidator(unquote)
DriveName = Annotated[str, _SENT, Path(description="the drive's name in the plant")]
DriveAddress = Annotated[str, _SENT, Path(description="PROTOCOL:ADDRESS")]
LineName = Annotated[str, _SENT, Path(description="the line's name in the plant")]
AlarmId = Annotated[str, _SENT, Path(description="the alarm's id")]
Verb = Annotated[
    str, _SENT, WithJsonSchema({"type": "string", "enum": sorted(NEEDS)}), Path(description="the verb to carry out")
]


def _optional(about: str, where: Any = None, **limits: Any) -> Any:
    return Field(None, description=about, json_schema_extra=where, **limits)


class _Body(BaseModel):
    # Strict: the text "5" is not accepted as a number.
    model_config = ConfigDict(extra="forbid", strict=True)


class Credentials(_Body):
    """Name and password of a user who logs in."""

    name: Text = Field(description="the user's name")
    password: Text = Field(description="the user's password")


class StopAll(_Body):
    """Lines to stop and the way to stop them."""

    how: Annotated[Stop, Field(strict=False)] = _optional("the way to stop; default: ramp")
    lines: list[Text] = _optional("the names of the lines; default: all")


class TakeLease(_Body):
    """Duration of a lease."""

    seconds: Number = Field(ge=0.1, le=30, description="the duration in seconds, until it is renewed")


class EndLease(_Body):
    """Key of a lease that the caller holds."""

    key: Text = Field(description="the key that came with the lease")


class RenewLease(EndLease, TakeLease):
    """Key of a lease that the caller holds, and its new duration."""


class Fresh(_Body):
    """Fields common to all commands, in addition to the arguments of the verb."""

    id: Text = _optional("a text of your choice; a repeated id gets the first answer again", NETWORK)
    lease: Text = _optional("the key of the lease under which the command is given")
    arm: bool = _optional("command a drive that the plant file does not arm", LOCAL)
    options: Options = _optional("facts about the drive, such as its model", LOCAL)
    issued_s: Time = _optional("when the command was given, in seconds since 1970")
    valid_s: Number = _optional("the number of seconds for which the command is valid; default: 2", ge=0.001, le=10)
    session: Text = _optional("the session of the plant for which the command is meant")


class CarryOut(Fresh):
    """Arguments of a verb, and the fields that show that the command is fresh."""

    arguments: Options = _optional("the arguments of the verb, by their names")


class StopDrive(CarryOut):
    """Arguments of a stop. Every stop is carried out, so its id serves for the answer only."""

    id: Text = _optional("a text of your choice, repeated in the response")


class Keep(Fresh):
    """Start settings and watchdog of a kept motor."""

    policy: Text = _optional("the reaction of the motor to a silent master; default: that of the plant file")
    watchdog_s: Number = _optional("the number of seconds after which the drive notices the silence", ge=0.001, le=3600)
    reverse: bool = _optional("backwards")
    percent: Number = _optional("the reference, as a share of its range")
    hz: Number = _optional("the reference, as an output frequency")
    by: Options = _optional("verb (jog, call, write) and arguments to start by", LOCAL)
    start: bool = _optional("false: the motor is not started now, but by a later command", LOCAL)


class _Examined(_Body):
    only: list[Text] = _optional("these protocols only")
    addresses: list[int] = _optional("these addresses only")
    options: Options = _optional("line settings and timing for all drives, and further options")


class Scan(_Examined):
    """Options of a scan."""

    choices: Options = _optional("the line settings to try")


class Doctor(_Examined):
    """Options of a line diagnosis."""

    probes: int = _optional("the number of requests to each drive", ge=1, le=1000)
    search: bool = _optional("whether drives that do not answer are searched with more time for a reply")
    rates: bool = _optional("whether other baud rates are tried if no drive answers")
