"""Discovery messages for Home Assistant: one message per drive, in its device format. No I/O.

Each drive is a device with sensors, plus the buttons and numbers that its `network` allows for this door.
"""

from __future__ import annotations

import re
from hashlib import sha256
from math import ceil
from typing import TYPE_CHECKING, Any

from drivecomm.client import json_text
from drivecomm.server.broker import BrokerMessage
from drivecomm.server.mqtt.kinds import is_state, kind_of, state_kinds
from drivecomm.version import __version__

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence

    from drivecomm.server import CurrentValue, DriveSnapshot
    from drivecomm.server.mqtt.topics import Topics
    from drivecomm.server.mqtt.value_publisher import Messages

_VALID_S = 5
"""Seconds for which a command from Home Assistant is valid; allows for a small clock difference."""
_LEAST_S = 10
"""Shortest expiry in seconds, so that a short pause does not remove a frequently polled value."""
_UNFIT = re.compile(r"[^a-z0-9_]+")
_BUTTONS = {
    "start": ("Start", "start", "mdi:play"),
    "reverse": ("Start backwards", "reverse", "mdi:rotate-left"),
    "reset": ("Reset fault", "reset", "mdi:restart"),
}
"""Verbs without arguments: label, key and icon of their buttons."""
_CONTROLS = {
    "command_stop": "button",
    "command_start": "button",
    "command_reverse": "button",
    "command_reset": "button",
    "command_reference": "number",
    "command_answer": "event",
}
"""Platforms of all possible controls. Home Assistant removes a control only if it is listed with its platform alone."""
_OUTCOMES = ["done", "refused", "failed", "open"]
_ANSWERED = (
    "{% if value_json.verb in ['start', 'stop', 'reverse', 'reset', 'set_reference'] %}"
    "{{ {'event_type': value_json.outcome, 'verb': value_json.verb, "
    "'error': value_json.error.text if value_json.error else None} | to_json }}{% endif %}"
)
_PERCENT = "percent="
_ACCEPTED = (
    f"{{% if value_json.outcome == 'done' and value_json.id.startswith('{_PERCENT}') %}}"
    f"{{{{ value_json.id[{len(_PERCENT)}:].split(';')[0] }}}}{{% endif %}}"
)
"""Template that reads an accepted reference from an answer: our own command id contains it."""


class Discovery:
    """Discovery messages of drives.

    prefix: discovery prefix of Home Assistant. area: suggested area of the drives. session: session of the connection,
    for commands from Home Assistant. stays_s: longest time in seconds for which an unchanged value is not published.
    """

    def __init__(self, prefix: str, topics: Topics, messages: Messages, area: str, *, stays_s: float = 0.0) -> None:
        self._stays_s = stays_s
        self._prefix, self._topics, self._messages, self._area = prefix, topics, messages, area
        # A value that is temporarily missing keeps its kind.
        self._kinds: dict[tuple[str, str], Mapping[str, Any] | None] = {}

    def topic(self, drive: str) -> str:
        """Return the discovery topic of a drive."""
        return f"{self._prefix}/device/{self._id(drive)}/config"

    def told(
        self,
        drive: DriveSnapshot,
        values: Sequence[CurrentValue],
        may: Collection[str],
        session: str,
        gone: Collection[str] = (),
    ) -> BrokerMessage:
        """Return the discovery message of a drive: its values, its permitted controls, and removed quantities."""
        own = self._id(drive.name)
        if not (drive.config.link_loss and drive.config.link_loss.policy == "hold"):
            # The server keeps the motor only under a renewed lease, which Home Assistant cannot renew.
            may = [verb for verb in may if verb not in ("start", "reverse")]
        sensors = self._sensors(values)
        named = {
            key: {**component, "unique_id": f"{own}_{key}", "default_entity_id": f"{component['platform']}.{own}_{key}"}
            for key, component in {**sensors, **self._controls(drive.name, may, session)}.items()
        }
        none_any_more = {**_CONTROLS, **{_slug(name): "sensor" for name in gone}}
        components = {**{key: {"platform": platform} for key, platform in none_any_more.items()}, **named}
        content = {
            "device": {
                "identifiers": [own],
                "name": drive.config.title or drive.name,
                "model": str(drive.config.options.get("model") or drive.config.protocol),
                "suggested_area": self._area,
            },
            "origin": {"name": "drivecomm", "sw_version": __version__},
            "availability": [_online(self._topics.state), _online(self._topics.availability(drive.name))],
            "availability_mode": "all",
            "components": components,
            "qos": 1,
        }
        return BrokerMessage(topic=self.topic(drive.name), payload=json_text(content), retain=True)

    def _id(self, drive: str) -> str:
        text = f"{self._topics.prefix}_{drive}"
        plain = _slug(text)
        # The hash keeps different names with the same slug apart.
        return plain if plain == text.replace("/", "_") else f"{plain}_{sha256(text.encode()).hexdigest()[:6]}"

    def _sensors(self, values: Sequence[CurrentValue]) -> Mapping[str, Mapping[str, Any]]:
        found: dict[str, Mapping[str, Any]] = {}
        for value in values:
            topic, path = self._topics.value(value.drive, value.name), ""
            if self._messages == "drives":
                topic, path = self._topics.values(value.drive), f"[{json_text(value.name)}]"
            source = {"state_topic": topic, "expire_after": max(_LEAST_S, ceil(3 * value.keeps_s + self._stays_s))}
            key = _free(_slug(value.name), found)
            if is_state(value):
                state, problem = state_kinds(path)
                found[key] = {"platform": "sensor", **source, **state}
                found["problem"] = {"platform": "binary_sensor", **source, **problem}
            elif (kind := self._kind(value, path)) is not None:
                found[key] = {"platform": "sensor", **source, **kind}
        return found

    def _kind(self, value: CurrentValue, path: str) -> Mapping[str, Any] | None:
        key = value.drive, value.name
        if value.reading is not None or self._kinds.get(key) is None:
            self._kinds[key] = kind_of(value, path)
        return self._kinds[key]

    def _controls(self, drive: str, may: Collection[str], session: str) -> Mapping[str, Mapping[str, Any]]:
        found: dict[str, Mapping[str, Any]] = {}
        # Controls stay available if the drive is silent: it may still receive, and the answer shows the outcome.
        always = {"availability": [_online(self._topics.state)]}
        if "stop" in may:
            found["command_stop"] = {
                **always,
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
                # A text box: a dragged slider would send many references.
                "mode": "box",
                "min": 0,
                "max": 100,
                "step": 0.1,
                "unit_of_measurement": "%",
                "command_topic": self._topics.command(drive),
                "command_template": _template(
                    "set_reference", '{"percent":{{ value }}}', session, mark=_PERCENT + "{{ value }};"
                ),
                # Only an accepted reference is shown as set.
                "state_topic": self._topics.response(drive),
                "value_template": _ACCEPTED,
            }
        if found:
            found["command_answer"] = {
                **always,
                "platform": "event",
                "name": "Answer",
                "icon": "mdi:reply",
                "event_types": _OUTCOMES,
                "state_topic": self._topics.response(drive),
                "value_template": _ANSWERED,
            }
        return found


def _online(topic: str) -> Mapping[str, str]:
    """Return an availability entry for a topic; a cleared topic means offline."""
    return {"topic": topic, "value_template": "{{ value_json.state if value_json is defined else 'offline' }}"}


def _template(verb: str, arguments: str, session: str, mark: str = "") -> str:
    """Return a command template, which Home Assistant fills in at each press with the time and a new id.

    mark: beginning of the id.
    """
    # Home Assistant limits a range to 100000.
    now, one = "{{ now().timestamp() }}", mark + "{{ now().timestamp() }}-{{ range(100000) | random }}"
    return (
        f'{{"id":"{one}","verb":"{verb}","arguments":{arguments},"issued_s":{now},"valid_s":{_VALID_S},'
        f'"session":"{session}"}}'
    )


def _slug(text: str) -> str:
    return _UNFIT.sub("_", text.lower()).strip("_") or "x"


def _free(key: str, taken: Mapping[str, object]) -> str:
    number = 2
    found = key
    while found in taken:
        found, number = f"{key}_{number}", number + 1
    return found
