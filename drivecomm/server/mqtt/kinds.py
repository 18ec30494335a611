"""Home Assistant's terms for our quantities: name, class, unit and kind of each sensor. No I/O.

Source of classes and of the units that each takes: the documentation of its sensors, and DEVICE_CLASS_UNITS in
`homeassistant/components/sensor/const.py` of release 2026.11.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from drivecomm.line import STATUS
from drivecomm.models import TEXT_QUANTITIES, quantities
from drivecomm.protocol import DriveState

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.protocol import Reading
    from drivecomm.server import CurrentValue

_VALUE = "{{{{ {value} if {fresh} else None }}}}"
_TEXT = "(value_json{path}.text if value_json{path}.text is defined else value_json{path}.value)"
_UNITS = {"degC": "°C", "C": "°C", "deg C": "°C", "1/min": "rpm"}
"""Units with another name in Home Assistant."""
_CLASSES = {
    **dict.fromkeys(("Hz", "kHz"), "frequency"),
    **dict.fromkeys(("A", "mA"), "current"),
    **dict.fromkeys(("V", "mV", "kV"), "voltage"),
    **dict.fromkeys(("W", "kW", "MW"), "power"),
    **dict.fromkeys(("VA", "kVA"), "apparent_power"),
    **dict.fromkeys(("var", "kvar"), "reactive_power"),
    **dict.fromkeys(("ms", "s", "min", "h", "d"), "duration"),
    **dict.fromkeys(("J", "kJ", "MJ", "Wh", "kWh", "MWh"), "energy"),
    "°C": "temperature",
}
"""Device class for each unit; units such as rpm or Nm have none."""
_COUNTED = frozenset({"operating_hours", "running_hours", "energy", "power_ups"})
"""Quantities that only increase until they are reset."""
_STATE_CLASS = "state_class"
_DIAGNOSTIC = TEXT_QUANTITIES | {
    *("operating_hours", "running_hours", "power_ups", "status_word", "control_word", "alarm_word", "warning_word"),
    *("motor_rated_power", "motor_rated_voltage", "motor_rated_current", "motor_rated_frequency", "motor_rated_speed"),
    *("bus_address", "link_timeout", "switching_frequency"),
}
"""Quantities about the drive itself rather than its operation."""


def state_kinds(path: str) -> tuple[Mapping[str, Any], Mapping[str, Any]]:
    """Return the sensors for the state of a drive and for its fault. path: to the value in the message."""
    fresh = _is_fresh(path)
    state = {
        "name": "State",
        "device_class": "enum",
        "options": [each.value for each in DriveState],
        "value_template": _VALUE.format(value=f"value_json{path}.value", fresh=fresh),
    }
    has_fault = f"('ON' if value_json{path}.value == '{DriveState.FAULT.value}' else 'OFF')"
    problem = {
        "name": "Fault",
        "device_class": "problem",
        # Without a current state there is neither a fault nor its absence.
        "value_template": _VALUE.format(value=has_fault, fresh=fresh),
    }
    return state, problem


def kind_of(value: CurrentValue, path: str) -> Mapping[str, Any] | None:
    """Return the sensor for a quantity, None if its kind is unknown until the first reading."""
    known = quantities().get(value.name)
    if value.reading is not None:
        is_text, unit = isinstance(value.reading.value, str), value.reading.unit
    elif known is not None:
        is_text, unit = value.name in TEXT_QUANTITIES, known.unit
    else:
        return None
    said: dict[str, Any] = {"name": _title(value.name, value.reading)}
    unit = _UNITS.get(unit, unit)
    counted = "total_increasing" if value.name in _COUNTED or _CLASSES.get(unit) == "energy" else "measurement"
    shown = f"value_json{path}.value"
    if unit and not is_text:
        said |= {"unit_of_measurement": unit, _STATE_CLASS: counted}
        said |= {"device_class": _CLASSES[unit]} if unit in _CLASSES else {}
    elif value.name in _COUNTED:
        said |= {_STATE_CLASS: counted}
    else:
        # The text if there is one, such as the name of a fault instead of its number.
        shown = _TEXT.format(path=path)
    if value.name in _DIAGNOSTIC:
        said["entity_category"] = "diagnostic"
    return {**said, "value_template": _VALUE.format(value=shown, fresh=_is_fresh(path))}


def is_state(value: CurrentValue) -> bool:
    """Whether this value is the state of a drive."""
    return value.name == STATUS


def _is_fresh(path: str) -> str:
    """Return a template condition for a current value: false for a cleared topic or before the first reading."""
    there = f" and value_json{path} is defined" if path else ""
    return f"value_json is defined{there} and value_json{path}.quality in ['good', 'uncertain']"


def _title(name: str, reading: Reading | None) -> str:
    """Return a readable name; a parameter address is followed by its name from the model."""
    said = name if name in quantities() or reading is None or not reading.name else f"{name} {reading.name}"
    words = said.replace("_", " ")
    return f"{words[:1].upper()}{words[1:]}"
