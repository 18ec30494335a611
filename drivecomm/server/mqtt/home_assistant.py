"""How Home Assistant is told of drives: one message a drive, by its discovery of devices. No I/O.

Each drive is a device with sensors, and with buttons and numbers for what its `network` allows to this door.
"""

from __future__ import annotations

import re
from hashlib import sha256
from math import ceil
from typing import TYPE_CHECKING, Any

from drivecomm.client import json_text
from drivecomm.polling import STATUS
from drivecomm.server.broker import Message
from drivecomm.version import __version__

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence

    from drivecomm.protocol import Reading
    from drivecomm.server import CurrentValue, DriveState
    from drivecomm.server.mqtt.live import Messages
    from drivecomm.server.mqtt.topics import Topics

_VALID_S = 5
"""For so long what is pressed there counts: its clock and ours may differ a little."""
_LEAST_S = 10
"""A value that is asked for often is not taken away for a short pause."""
_UNFIT = re.compile(r"[^a-z0-9_]+")
_CLASSES = {
    "Hz": ("frequency", "Hz"),
    "kHz": ("frequency", "kHz"),
    "A": ("current", "A"),
    "mA": ("current", "mA"),
    "V": ("voltage", "V"),
    "W": ("power", "W"),
    "kW": ("power", "kW"),
    "°C": ("temperature", "°C"),
    "C": ("temperature", "°C"),
    "s": ("duration", "s"),
    "min": ("duration", "min"),
    "h": ("duration", "h"),
    "1/min": ("", "rpm"),
}
"""Our units as Home Assistant knows them: the class of device, and its name of the unit."""
_COUNTED = {"Wh", "kWh", "MWh"}
_BUTTONS = {
    "start": ("Start", "start", "mdi:play"),
    "reverse": ("Start backwards", "reverse", "mdi:rotate-left"),
    "reset": ("Reset fault", "reset", "mdi:restart"),
}
"""Verbs without arguments: what a person reads, the verb, and its picture."""
_FRESH = "value_json{path}.value if value_json{path}.quality in ['good', 'uncertain'] else None"


class Discovery:
    """Tells Home Assistant of drives. prefix: where it looks. session: of the connection, for what is pressed there."""

    def __init__(self, prefix: str, topics: Topics, messages: Messages, plant: str) -> None:
        self._prefix, self._topics, self._messages, self._plant = prefix, topics, messages, plant
        # A value that is not there for a while stays of its kind.
        self._kinds: dict[tuple[str, str], Mapping[str, Any]] = {}

    def topic(self, drive: str) -> str:
        """Return where a drive is told."""
        return f"{self._prefix}/device/{self._id(drive)}/config"

    def forgotten(self, drive: str) -> Message:
        """Return what removes a drive there."""
        return Message(topic=self.topic(drive), payload=b"", retain=True)

    def told(self, drive: DriveState, values: Sequence[CurrentValue], may: Collection[str], session: str) -> Message:
        """Return what tells a drive, with its values, and what may be done with it here."""
        own = self._id(drive.name)
        if not (drive.config.link_loss and drive.config.link_loss.policy == "hold"):
            # A motor that is kept running needs a lease that is renewed, which nobody does there.
            may = [verb for verb in may if verb not in ("start", "reverse")]
        components = {
            key: {**component, "unique_id": f"{own}_{key}", "default_entity_id": f"{component['platform']}.{own}_{key}"}
            for key, component in {**self._sensors(values), **self._controls(drive.name, may, session)}.items()
        }
        state = {"value_template": "{{ value_json.state }}"}
        content = {
            "device": {
                "identifiers": [own],
                "name": drive.config.title or drive.name,
                "model": str(drive.config.options.get("model") or drive.config.protocol),
                "suggested_area": self._plant,
            },
            "origin": {"name": "drivecomm", "sw_version": __version__},
            "availability": [
                {"topic": self._topics.state, **state},
                {"topic": self._topics.availability(drive.name), **state},
            ],
            "availability_mode": "all",
            "components": components,
            "qos": 1,
        }
        return Message(topic=self.topic(drive.name), payload=json_text(content), retain=True)

    def _id(self, drive: str) -> str:
        text = f"{self._topics.prefix}_{drive}"
        plain = _slug(text)
        # Another name never has the same.
        return plain if plain == text.replace("/", "_") else f"{plain}_{sha256(text.encode()).hexdigest()[:6]}"

    def _sensors(self, values: Sequence[CurrentValue]) -> Mapping[str, Mapping[str, Any]]:
        found: dict[str, Mapping[str, Any]] = {}
        for value in values:
            key = _free(_slug(value.name), found)
            topic, path = self._topics.value(value.drive, value.name), ""
            if self._messages == "drives":
                topic, path = self._topics.values(value.drive), f"[{json_text(value.name)}]"
            found[key] = {
                "platform": "sensor",
                "name": "State" if value.name == STATUS else value.name.replace("_", " "),
                "state_topic": topic,
                "value_template": f"{{{{ {_FRESH.format(path=path)} }}}}",
                "expire_after": max(_LEAST_S, ceil(3 * value.keeps_s)),
                **self._kind(value),
            }
            if value.name == STATUS:
                found["problem"] = {
                    "platform": "binary_sensor",
                    "name": "Fault",
                    "device_class": "problem",
                    "state_topic": topic,
                    "value_template": f"{{{{ 'ON' if value_json{path}.value == 'fault' else 'OFF' }}}}",
                    "expire_after": found[key]["expire_after"],
                }
        return found

    def _kind(self, value: CurrentValue) -> Mapping[str, Any]:
        key = value.drive, value.name
        if value.reading is not None:
            self._kinds[key] = _kind(value.reading)
        return self._kinds.get(key, {})

    def _controls(self, drive: str, may: Collection[str], session: str) -> Mapping[str, Mapping[str, Any]]:
        found: dict[str, Mapping[str, Any]] = {}
        if "stop" in may:
            found["command_stop"] = {
                "platform": "button",
                "name": "Stop",
                "icon": "mdi:stop",
                "command_topic": self._topics.stop(drive),
                "payload_press": "ramp",
            }
        for verb, (name, key, icon) in _BUTTONS.items():
            if verb in may:
                found[f"command_{key}"] = {
                    "platform": "button",
                    "name": name,
                    "icon": icon,
                    "command_topic": self._topics.command(drive),
                    "command_template": _template(verb, "{}", session),
                }
        if "set_reference" in may:
            found["command_reference"] = {
                "platform": "number",
                "name": "Reference",
                "min": 0,
                "max": 100,
                "step": 0.1,
                "unit_of_measurement": "%",
                "command_topic": self._topics.command(drive),
                "command_template": _template("set_reference", '{"percent":{{ value }}}', session),
            }
        return found


def _template(verb: str, arguments: str, session: str) -> str:
    """Return a template that Home Assistant fills in when somebody presses: the time, and an id of its own."""
    now, one = "{{ now().timestamp() }}", "{{ now().timestamp() }}-{{ range(100000, 999999) | random }}"
    return (
        f'{{"id":"{one}","verb":"{verb}","arguments":{arguments},"issued_s":{now},"valid_s":{_VALID_S},'
        f'"session":"{session}"}}'
    )


def _kind(reading: Reading) -> Mapping[str, Any]:
    """Return what kind of quantity this is; a text, such as a state, is of none."""
    if isinstance(reading.value, str) or not reading.unit:
        return {}
    if reading.unit in _COUNTED:
        return {"device_class": "energy", "unit_of_measurement": reading.unit, "state_class": "total_increasing"}
    device_class, unit = _CLASSES.get(reading.unit, ("", reading.unit))
    said = {"unit_of_measurement": unit, "state_class": "measurement"}
    return said | ({"device_class": device_class} if device_class else {})


def _slug(text: str) -> str:
    return _UNFIT.sub("_", text.lower()).strip("_") or "x"


def _free(key: str, taken: Mapping[str, object]) -> str:
    number = 2
    found = key
    while found in taken:
        found, number = f"{key}_{number}", number + 1
    return found
