"""Required support of a packaged model: confirmed facts behind each command and common name, and two sources.

`exceptions.toml` beside this module lists the models that lack this so far, and why. The list can only shrink: a test
refuses an exception that is no longer needed.
"""

from __future__ import annotations

import tomllib
from functools import cache
from importlib import resources
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

from drivecomm.models.quantities import parameter_at
from drivecomm.models.schema import Mistake
from drivecomm.protocol import DOUBTFUL

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from drivecomm.protocol import Model

KINDS = ("common_names", "control_facts", "sources", "taken_over")
"""Kinds of missing support.

common_names: names that rest on an unconfirmed fact. control_facts: addresses of unconfirmed parameters behind a
command or the status. sources: `commands` or `status` without two sources. taken_over: `stop`, `plain_write` or
`watchdog`, if the model has it only by `extends`, without a statement of its own.
"""

_ORDERS = ("start", "start_reverse", "stop", "coast", "quick", "dc_brake", "reset")
_STOPS = ("stop", "coast", "quick", "dc_brake", "sure_stop")
_PARAMETERS = ("fault_code", "reference_hz", "reference_percent")
_ENOUGH = 2


class Lack(NamedTuple):
    """Missing support of a model. kind: one of KINDS. name: the name or address that it concerns."""

    kind: str
    name: str
    mistake: Mistake


@cache
def exceptions() -> Mapping[str, Mapping[str, Any]]:
    """Return the support that models may lack, by PROTOCOL/MODEL: the reason, and names by kind."""
    text = resources.files("drivecomm.models").joinpath("exceptions.toml").read_text(encoding="utf-8")
    return MappingProxyType(tomllib.loads(text))


def unsupported(content: Mapping[str, Any], model: Model, base: Model | None) -> Iterator[Mistake]:
    """Yield the missing support that no exception allows. content: content of the model's file. base: its base."""
    allowed = exceptions().get(f"{model.protocol}/{model.name}", {})
    for lack in lacks(content, model, base):
        if lack.name not in allowed.get(lack.kind, ()):
            yield lack.mistake


def lacks(content: Mapping[str, Any], model: Model, base: Model | None) -> Iterator[Lack]:
    """Yield all missing support of a model, whether or not an exception allows it."""
    for name, address in model.quantities.items():
        info = parameter_at(address, model)
        if info is not None and info.sure in DOUBTFUL:
            text = f"rests on parameter {address}, which is {info.sure}; find its page, or give the name up"
            yield Lack("common_names", name, Mistake(table="quantities", key=name, text=text))
    control = model.control
    for address in dict.fromkeys(addresses_behind(control)):
        info = model.find(address)
        if info is not None and info.sure in DOUBTFUL:
            text = f"a command or the status rests on {address}, which is {info.sure}; find its page"
            yield Lack("control_facts", address, Mistake(table="control", text=text))
    needed = {"commands": any(each in control for each in _ORDERS), "status": bool(control.get("status"))}
    for name, is_needed in needed.items():
        if is_needed and len(set(model.sources.get(name, ()))) < _ENOUGH:
            text = f"{name} = [...] under [sources] must name two documents or programs"
            yield Lack("sources", name, Mistake(table="control", text=text))
    if base is not None:
        for name in _taken_over(content, base):
            text = f"inherits {name} from {base.name}; define it here as the documents of this series do"
            yield Lack("taken_over", name, Mistake(key="extends", text=text))


def addresses_behind(control: Mapping[str, Any]) -> Iterator[str]:
    """Yield the addresses used by the commands, the status, the references and the fault code of a `[control]`."""
    steps = [step for order in _ORDERS for step in control.get(order, ())]
    for place in (*steps, *control.get("status", {}).values()):
        yield place[0].partition(".")[0]
    for key in _PARAMETERS:
        yield control.get(key, "").partition(".")[0]


def _taken_over(content: Mapping[str, Any], base: Model) -> Iterator[str]:
    own = content.get("control", {})
    if any(each in base.control for each in _STOPS) and not any(each in own for each in _STOPS):
        yield "stop"
    if "plain_write" in base.control and "plain_write" not in own:
        yield "plain_write"
    if base.watchdog is not None and not content.keys() & {"watchdog", "link_loss"}:
        yield "watchdog"
