r"""Orders for a running plant as JSON objects: one order in, one answer out.

    {"order": "trip", "drive": "pump", "code": 5}
    {"order": "power", "drive": "pump", "state": "off"}           on, off, factory: on again with factory settings
    {"order": "set", "drive": "pump", "parameter": "480", "value": 1000}
    {"order": "inject", "line": "hall", "data": "04 41 FF"}
    {"order": "fault", "text": "drive = 'pump'\nkind = 'drop'"}    as after [[fault]] in a plant file
    {"order": "show"}                                             with drive and parameters: their values
    {"order": "telegrams", "since": 0}                            those after this number; "line" if there are several
    {"order": "violations"}                                       errors of the master; "line" if there are several
    {"order": "counters"}                                         counts of telegrams, faults and violations
    {"order": "state"}                                            present state of each line and drive

The answer is {"ok": true, ...}, or {"ok": false, "error": a sentence}.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from drivecomm.errors import DriveCommError, UsageError, in_one_line
from drivecomm.plant import bytes_of, read_fault
from drivecomm.virtual import query_orders

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from drivecomm.virtual.virtual_plant import VirtualPlant

_TEXT = ((str,), "a text")
_WHOLE = ((int,), "a whole number")
_RAW = ((int, str), "a whole number or a text")


def answer_order(plant: VirtualPlant, text: bytes) -> bytes:
    """Carry out an order, given as a line of JSON, and return the answer as a line of JSON."""
    try:
        told = {"ok": True, **_carried_out(plant, _order(text))}
    except DriveCommError as error:
        told = {"ok": False, "error": in_one_line(error)}
    return json.dumps(told).encode() + b"\n"


def _order(text: bytes) -> Mapping[str, Any]:
    try:
        order = json.loads(text)
    except (ValueError, RecursionError):
        order = None
    if not isinstance(order, dict):
        raise UsageError('an order is one JSON object on one line, such as {"order": "show"}')
    return order


def _carried_out(plant: VirtualPlant, order: Mapping[str, Any]) -> Mapping[str, Any]:
    orders: dict[str, Callable[[VirtualPlant, Mapping[str, Any]], Mapping[str, Any]]] = {
        "trip": _trip,
        "power": _power,
        "set": _set,
        "inject": _inject,
        "fault": _fault,
        "show": _show,
        "telegrams": _telegrams,
        "violations": _violations,
        "counters": _counters,
        "state": _state,
    }
    name = order.get("order")
    if not isinstance(name, str) or name not in orders:
        raise UsageError(f"unknown order {name!r}; write one of {', '.join(orders)}")
    return orders[name](plant, order)


def _trip(plant: VirtualPlant, order: Mapping[str, Any]) -> Mapping[str, Any]:
    drive, code = _fields(order, drive=_TEXT, code=_WHOLE)
    plant.trip(drive, code)
    return {}


def _power(plant: VirtualPlant, order: Mapping[str, Any]) -> Mapping[str, Any]:
    drive, state = _fields(order, drive=_TEXT, state=_TEXT)
    states = {"on": plant.power_on, "off": plant.power_off, "factory": plant.power_on_as_new}
    if state not in states:
        raise UsageError(f"invalid power state {state!r}; write one of {', '.join(states)}")
    states[state](drive)
    return {}


def _set(plant: VirtualPlant, order: Mapping[str, Any]) -> Mapping[str, Any]:
    drive, parameter, value = _fields(order, drive=_TEXT, parameter=_TEXT, value=_RAW)
    plant.set(drive, parameter, value)
    return {"value": plant.get(drive, parameter)}


def _inject(plant: VirtualPlant, order: Mapping[str, Any]) -> Mapping[str, Any]:
    line, data = _fields(order, line=_TEXT, data=_TEXT)
    plant.inject(line, bytes_of(data))
    return {}


def _fault(plant: VirtualPlant, order: Mapping[str, Any]) -> Mapping[str, Any]:
    (text,) = _fields(order, text=_TEXT)
    plant.add(read_fault(text))
    return {}


def _show(plant: VirtualPlant, order: Mapping[str, Any]) -> Mapping[str, Any]:
    if "drive" in order:
        drive, parameters = _fields(order, drive=_TEXT, parameters=((list,), "a list of texts"))
        return {"values": {str(parameter): plant.get(drive, str(parameter)) for parameter in parameters}}
    _fields(order)
    return {
        "speed": plant.speed,
        "lines": [{"name": name, "time_s": round(line.time, 3)} for name, line in plant.lines.items()],
        "drives": [state._asdict() for state in plant.states()],
    }


def _telegrams(plant: VirtualPlant, order: Mapping[str, Any]) -> Mapping[str, Any]:
    line, since = _fields({"line": "", "since": 0, **order}, line=_TEXT, since=_WHOLE)
    return query_orders.telegrams(plant, line, since)


def _violations(plant: VirtualPlant, order: Mapping[str, Any]) -> Mapping[str, Any]:
    (line,) = _fields({"line": "", **order}, line=_TEXT)
    return query_orders.violations(plant, line)


def _counters(plant: VirtualPlant, order: Mapping[str, Any]) -> Mapping[str, Any]:
    _fields(order)
    return query_orders.counters(plant)


def _state(plant: VirtualPlant, order: Mapping[str, Any]) -> Mapping[str, Any]:
    _fields(order)
    return query_orders.states(plant)


def _fields(order: Mapping[str, Any], **known: tuple[tuple[type, ...], str]) -> list[Any]:
    """Return the values of these fields of an order. Raises UsageError for a missing, unknown or invalid field."""
    name = order["order"]
    for key in sorted(set(order) - set(known) - {"order"}):
        raise UsageError(f"unknown key {key!r} in the order {name}; it has {', '.join(known) or 'no keys'}")
    for key, (types, words) in known.items():
        if key not in order:
            raise UsageError(f"the order {name} needs {key}, {words}")
        if not isinstance(order[key], types) or isinstance(order[key], bool):
            raise UsageError(f"invalid {key} {order[key]!r} in the order {name}; write {words}")
    return [order[key] for key in known]
