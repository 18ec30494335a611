"""Findings about parameters: existence, type, limits and scale, compared between drive and model."""

from __future__ import annotations

from dataclasses import dataclass, field
from decimal import Decimal
from typing import TYPE_CHECKING, Any

from drivecomm.errors import DriveCommError, NotSupported, RefusedError, ReplyError, UnexpectedReplyError, in_one_line
from drivecomm.models import factor_between, quantities as common_quantities
from drivecomm.proving.findings import ProofFinding
from drivecomm.proving.private_data import LEFT_OUT, is_private

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from drivecomm.protocol import ParameterInfo, Reading
    from drivecomm.proving.findings import Shown


@dataclass(slots=True, kw_only=True)
class ParameterAnswers:
    """The drive's answers about one parameter.

    readings: by the address of each element that was read. described: the drive's own description of the parameter;
    None if the protocol or the drive gives none.
    """

    info: ParameterInfo
    common: str = ""
    readings: dict[str, Reading | DriveCommError] = field(default_factory=dict)
    described: ParameterInfo | DriveCommError | None = None


def why_not_asked(info: ParameterInfo) -> str:
    """Return the reason why a parameter is not read, or "" if it is read."""
    if info.kind == "command":
        return "it is a command"
    return "" if "r" in info.access else "it can only be written"


def model_facts(info: ParameterInfo) -> dict[str, Any]:
    """Return the model's facts about a parameter as a proof records them, to detect later changes of the model."""
    said: dict[str, Any] = {"name": info.name, "type": info.type, "unit": info.unit, "factor": info.factor}
    said |= {"access": info.access, "minimum": info.minimum, "maximum": info.maximum}
    if info.values:
        said["options"] = sorted(info.values)
    return {key: value for key, value in said.items() if value not in ("", None)}


def parameter_finding(told: ParameterAnswers, *, scale: bool, answers_all: bool, with_names: bool) -> ProofFinding:
    """Return the finding about one parameter. scale: whether any other scale would be implausible.

    answers_all: whether the drive also answers for unknown addresses, so that an answer proves little.
    """
    info = told.info
    against = list(dict.fromkeys(_against(told)))
    shows: list[Shown] = []
    readings = [each for each in told.readings.values() if not isinstance(each, DriveCommError)]
    if not against:
        shows = list(_shown(told, readings, scale=scale, exists=not answers_all))
    return ProofFinding(
        kind="parameter",
        verdict="contradicts" if against else "agrees",
        about=f"parameter {info.address}",
        addresses=(info.address,),
        model=model_facts(info),
        drive=_said_by_drive(told, with_names=with_names),
        shows=tuple(shows),
        why="; ".join(against),
    )


def _against(told: ParameterAnswers) -> Iterator[str]:
    info = told.info
    for address, answer in told.readings.items():
        of = "" if address == info.address else f"{address}: "
        if isinstance(answer, DriveCommError):
            yield f"{of}{_refusal(answer)}"
        else:
            yield from (f"{of}{each}" for each in _against_reading(info, answer))
    if isinstance(told.described, RefusedError) and not told.readings:
        yield _refusal(told.described)
    elif told.described is not None and not isinstance(told.described, DriveCommError):
        yield from _against_description(info, told.described)


def _refusal(error: DriveCommError) -> str:
    if isinstance(error, RefusedError):
        number = "without a code" if error.code is None else f"with code {error.code}"
        return f"the drive refused it {number}: {error.reason}"
    if isinstance(error, ReplyError) and not isinstance(error, UnexpectedReplyError):
        return "the drive answers everything else, but not this"
    return in_one_line(error)


def _against_reading(info: ParameterInfo, reading: Reading) -> Iterator[str]:
    if reading.doubt:
        yield reading.doubt
        return
    if isinstance(reading.value, str):
        if info.type and info.values:
            yield "the drive returned characters, and the model has a number"
        return
    value = Decimal(reading.value)
    if not info.allows(value):
        low = "" if info.minimum is None else f"{info.minimum:f}"
        high = "" if info.maximum is None else f"{info.maximum:f}"
        yield f"the drive holds a value outside {low or 'no minimum'} to {high or 'no maximum'} {info.unit}".rstrip()
    # Many drives show 0 for a parameter that was never set, or does not apply at present.
    if value and is_option(info) and int(value / info.factor) not in info.values:
        yield f"the drive holds {int(value / info.factor)}, which is not one of the options"


def is_option(info: ParameterInfo) -> bool:
    """Whether a parameter takes only listed values; a list of one value counts as incomplete."""
    if info.unit or len(info.values) < 2:
        return False
    if info.minimum is None and info.maximum is None:
        return True
    if info.minimum is None or info.maximum is None or info.maximum - info.minimum > max(info.values):
        return False
    return all(code in info.values for code in range(int(info.minimum), int(info.maximum) + 1))


def _against_description(info: ParameterInfo, said: ParameterInfo) -> Iterator[str]:
    if info.type and said.type and info.type != said.type:
        yield f"type {info.type} in the model, {said.type} by the drive"
    if info.type and not said.type:
        yield f"type {info.type} in the model, none of these by the drive"
    if not (info.type in ("text", "string") or said.type in ("", "text", "string")):
        yield from _against_scale(info, said)
    if (info.access == "r") is not (said.access == "r"):
        yield f"access {info.access} in the model, {said.access} by the drive"


def _against_scale(info: ParameterInfo, said: ParameterInfo) -> Iterator[str]:
    between = factor_between(said.unit, info.unit) if said.unit and info.unit else Decimal(1)
    if between is None:
        yield f"unit {info.unit} in the model, {said.unit} by the drive"
        return
    if said.factor * between != info.factor:
        yield f"factor {info.factor:f} in the model, {said.factor * between:f} by the drive"
        return
    for end, ours, theirs in (("minimum", info.minimum, said.minimum), ("maximum", info.maximum, said.maximum)):
        if ours is not None and theirs is not None and ours != theirs * between:
            yield f"{end} {ours:f} in the model, {theirs * between:f} by the drive"


def _shown(told: ParameterAnswers, readings: Sequence[Reading], *, scale: bool, exists: bool) -> Iterator[Shown]:
    if exists and readings:
        yield "exists"
    if told.described is not None and not isinstance(told.described, DriveCommError):
        yield "described"
    if readings and all(isinstance(each.value, str) and each.value.strip() for each in readings):
        yield "text"
    # Some drives answer 0 for any address.
    numbers = [Decimal(each.value) for each in readings if not isinstance(each.value, str)]
    if is_option(told.info) and any(numbers):
        yield "option"
    if scale:
        yield "scale"


def _said_by_drive(told: ParameterAnswers, *, with_names: bool) -> dict[str, Any]:
    said: dict[str, Any] = {}
    for address, answer in told.readings.items():
        key = "value" if len(told.readings) == 1 else address
        if isinstance(answer, RefusedError):
            said[key] = f"refused with code {answer.code}"
        elif isinstance(answer, DriveCommError):
            said[key] = "no value"
        elif is_private(told.info, told.common, answer.value) and not with_names:
            said[key] = LEFT_OUT
        else:
            said[key] = str(answer)
            said |= {} if str(answer.raw) == str(answer.value) else {f"{key}_raw": answer.raw}
    described = told.described
    if described is not None and not isinstance(described, DriveCommError):
        said["described"] = {key: each for key, each in model_facts(described).items() if key != "name"}
    elif isinstance(described, DriveCommError) and not isinstance(described, NotSupported):
        said["described"] = "it does not say"
    return said


def asked_addresses(addresses: Sequence[str]) -> Sequence[str]:
    """Return the element addresses of a parameter to read: all if there are few, else the first and the last."""
    return addresses if len(addresses) <= _MOST_ELEMENTS else (addresses[0], addresses[-1])


_MOST_ELEMENTS = 4


def plate_of(told: Mapping[str, ParameterAnswers], quantities: Mapping[str, str]) -> dict[str, Decimal]:
    """Return the values of the common names in common units. told: the answers by address of the parameter."""
    return {name: value for name, address in quantities.items() if (value := _common(told, name, address)) is not None}


def _common(told: Mapping[str, ParameterAnswers], name: str, address: str) -> Decimal | None:
    one = told.get(address) or told.get(address.partition("[")[0])
    known = common_quantities().get(name)
    if one is None or known is None:
        return None
    reading = one.readings.get(address) or next(iter(one.readings.values()), None)
    if reading is None or isinstance(reading, DriveCommError) or isinstance(reading.value, str) or reading.doubt:
        return None
    between = factor_between(reading.unit, known.unit)
    return None if between is None else Decimal(reading.value) * between
