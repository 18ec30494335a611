"""Rules for the consistency of a model's tables: parameters, common names, the watchdog.

Nothing here uses a protocol; `drivecomm.models.trials` does.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from decimal import Decimal
from typing import TYPE_CHECKING

from drivecomm.errors import did_you_mean
from drivecomm.models.quantities import factor_between, parameter_at, quantities
from drivecomm.models.schema import Mistake

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from drivecomm.protocol import LinkLoss, Model, ParameterInfo, Watchdog

_PRINTED = re.compile(r"(x|\*)?\s*(\d+(?:\.\d+)?)\b.*")
_NAME = re.compile(r"[a-z][a-z0-9_]*", re.ASCII)
_NO_SOURCE = "its source is missing; name the manual and the page under source"


@dataclass(frozen=True, slots=True, kw_only=True)
class OwnContent:
    """The file's own part of a model, without the content that it takes over.

    parameters: with their positions in the file. quantities: as written. watchdog: whether the file has that table.
    fault_log: as written. source: source of the file as a whole.
    """

    parameters: Sequence[tuple[int, ParameterInfo]]
    quantities: Mapping[str, str]
    watchdog: bool
    fault_log: Sequence[str]
    source: str


def broken_rules(given: OwnContent, model: Model, base: Model | None) -> Iterator[Mistake]:
    """Yield every inconsistency that this file causes; inherited ones belong to the base's file."""
    yield from _names(given, model)
    for number, info in given.parameters:
        yield from _limits(number, info)
        if info.printed and (factor := printed_factor(info.printed)) != info.factor:
            says = "no scale" if factor is None else f"a factor of {factor}"
            yield _of(number, "printed", f"{info.printed!r} says {says}, and the factor here is {info.factor}")
        for address in info.only_with:
            if address not in model.parameters:
                yield _of(number, "only_with", _unknown(address, model))
        if not (info.source.strip() or given.source.strip()):
            yield _of(number, "", f"parameter {info.address}: {_NO_SOURCE}")
    yield from _quantities(given, model, base)
    for address in given.fault_log:
        logged = parameter_at(address, model)
        if logged is None:
            yield Mistake(key="fault_log", text=_unknown(address, model))
        elif "r" not in logged.access:
            yield Mistake(key="fault_log", text=f"parameter {address} cannot be read")
    if given.watchdog and model.watchdog is not None:
        yield from _watchdog(model.watchdog, given, model)


def printed_factor(printed: str) -> Decimal | None:
    """Return the factor of a printed scale, such as `0.01 Hz`, `* 0.1` or `x 100 A`; None if it has none.

    A scale without a number, such as `Hz`, means whole units.
    """
    found = _PRINTED.fullmatch(printed.strip())
    if found is None:
        return None if re.search(r"\d", printed) else Decimal(1)
    times, number = found.groups()
    if not Decimal(number):
        return None
    return 1 / Decimal(number) if times == "x" else Decimal(number)


def starts_within_limits(info: ParameterInfo) -> bool:
    """Return whether the start value is between minimum and maximum; a missing value or limit is no violation."""
    start, low, high = info.start, info.minimum, info.maximum
    if start is None or isinstance(start, str):
        return True
    return (low is None or start >= low) and (high is None or start <= high)


def _of(number: int, key: str, text: str) -> Mistake:
    return Mistake(text=text, key=key, table="parameter", number=number)


def _names(given: OwnContent, model: Model) -> Iterator[Mistake]:
    own = {info.address for _, info in given.parameters}
    names = {info.name: info.address for info in model.parameters.values() if info.address not in own}
    addresses: set[str] = set()
    for number, info in given.parameters:
        if info.address in addresses:
            yield _of(number, "address", f"{info.address} is listed twice")
            continue
        addresses.add(info.address)
        if not _NAME.fullmatch(info.name):
            yield _of(number, "name", f"{info.name!r} is not a name; use lower case and join words by underscores")
        other = names.setdefault(info.name, info.address)
        if other != info.address:
            yield _of(number, "name", f"{info.name} is parameter {other} already; a name means one parameter")
        common = quantities().get(info.name)
        mapped = model.quantities.get(info.name)
        if common is not None and (mapped is None or parameter_at(mapped, model) is not model.find(info.address)):
            meant = f"{common.meaning}{f', in {common.unit}' if common.unit else ''}"
            remedy = f'say {info.name} = "{info.address}" under [quantities] if it is that, else choose another name'
            yield _of(number, "name", f"{info.name} is a common name ({meant}); {remedy}")


def _limits(number: int, info: ParameterInfo) -> Iterator[Mistake]:
    low, high, unit = info.minimum, info.maximum, f" {info.unit}".rstrip()
    if low is not None and high is not None and low > high:
        yield _of(number, "minimum", f"{low}{unit} is above the maximum of {high}{unit}")
        return
    if not starts_within_limits(info):
        limits = " and ".join(
            text
            for text, end in ((f"the minimum of {low}{unit}", low), (f"the maximum of {high}{unit}", high))
            if end is not None
        )
        yield _of(number, "start", f"{info.start}{unit} is not within {limits}")


def _quantities(given: OwnContent, model: Model, base: Model | None) -> Iterator[Mistake]:
    known = quantities()
    for name, address in given.quantities.items():
        if name not in known:
            remedy = did_you_mean(name, known) or "drivecomm models names lists them"
            yield Mistake(table="quantities", key=name, text=f"no common name; {remedy}")
        elif not address and (base is None or name not in base.quantities):
            yield Mistake(table="quantities", key=name, text="is empty, and no other model has mapped it before")
    own = {info.address: number for number, info in given.parameters}
    for name, address in model.quantities.items():
        info = parameter_at(address, model)
        stands_here = name in given.quantities
        if name not in known:
            continue
        if info is None:
            if stands_here:
                yield Mistake(table="quantities", key=name, text=_unknown(address, model))
            continue
        if stands_here:
            place = {"table": "quantities", "key": name}
        elif info.address in own:
            place = {"table": "parameter", "key": "unit"}
        else:
            continue
        number = 0 if stands_here else own[info.address]
        for text in _misfits(name, info):
            yield Mistake(text=text, number=number, **place)


def _misfits(name: str, info: ParameterInfo) -> Iterator[str]:
    wanted = quantities()[name].unit
    if "r" not in info.access:
        yield f"parameter {info.address} cannot be read"
    if factor_between(info.unit, wanted) is None:
        is_in = f"is in {info.unit}" if info.unit else "has no unit"
        yield f"parameter {info.address} {is_in}, and {name} is {f'given in {wanted}' if wanted else 'without one'}"


def _unknown(address: str, model: Model) -> str:
    remedy = did_you_mean(address, {*model.parameters, *(info.name for info in model.parameters.values())})
    return f"there is no parameter {address!r}" + (f"; {remedy}" if remedy else "")


def _watchdog(watchdog: Watchdog, given: OwnContent, model: Model) -> Iterator[Mistake]:
    for key, address in (("time", watchdog.time), ("action", watchdog.action)):
        info = parameter_at(address, model)
        if key == "action" and not address:
            continue
        if info is None:
            yield _in_watchdog(key, _unknown(address, model))
        elif "r" not in info.access:
            yield _in_watchdog(key, f"parameter {address} cannot be read")
        elif key == "time" and factor_between(info.unit, "s") is None:
            yield _in_watchdog(key, f"parameter {address} is in {info.unit or 'no unit'}, and a time is in s")
        elif key == "action" and info.values:
            for policy, code in watchdog.actions.items():
                if code not in info.values:
                    known = ", ".join(map(str, info.values))
                    yield _in_watchdog("actions", f"{policy} = {code}, and parameter {address} accepts {known}")
    if not watchdog.action and len(watchdog.actions) != 1:
        yield _in_watchdog("actions", "without a parameter for the action a drive has exactly one reaction")
    if watchdog.fault is not None and watchdog.fault not in model.faults:
        yield _in_watchdog("fault", f"[faults] has no fault {watchdog.fault}")
    if watchdog.fault is not None and "trip" not in watchdog.actions:
        yield _in_watchdog("fault", "no action of this watchdog trips")
    if not (watchdog.source.strip() or given.source.strip()):
        yield _in_watchdog("", _NO_SOURCE)


def _in_watchdog(key: str, text: str) -> Mistake:
    return Mistake(text=text, key=key, table="watchdog")


_DOES: dict[LinkLoss, str] = {
    "hold": "it keeps running",
    "ramp": "it stops down its ramp",
    "coast": "it coasts",
    "trip": "it trips",
}


def link_loss_of(model: Model | None) -> str:
    """Return the reaction of drives of this model when their master falls silent, and the parameters that set it."""
    if model is None:
        return "no model is given, so its reaction to a link loss is not known"
    watchdog = model.watchdog
    if watchdog is None:
        return model.link_loss or "no watchdog is documented in our sources"
    never = "" if watchdog.off is None else f", never with {watchdog.off}"
    when = f"after the time in {watchdog.time}{never}"
    if not watchdog.action:
        said = f"{_DOES[next(iter(watchdog.actions))]} {when}"
    else:
        does = ", ".join(f"{code} {_DOES[policy]}" for policy, code in watchdog.actions.items())
        said = f"as set by {watchdog.action} ({does}), {when}"
    return f"{said}; {watchdog.note}" if watchdog.note else said
