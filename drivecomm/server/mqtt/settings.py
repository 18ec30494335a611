"""Settings of a `[[door]]` of kind mqtt, except those of its broker.

prefix = "drivecomm/hall-2"     # above all topics; default: drivecomm/ and the plant's name
levels = ["site", "area", "line"]   # names above those of drives in topics; default: only the plant's
messages = "drives"             # one message for all values of a drive; default "quantities": a topic for each
publish = "changes"             # only values that differ from the last one published; default "polls": all
deadband = { output_current = 0.1 } # with changes: smallest change of a quantity, in its unit
at_least_every_s = 60           # with changes: interval at which an unchanged value is published
role = "operate"                # of publishers without a token; default: only users with tokens may command
home_assistant = "homeassistant"    # discovery prefix of Home Assistant; default: no discovery
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf
from typing import TYPE_CHECKING, Any, Literal

from drivecomm.errors import suggestion
from drivecomm.server import LEVELS_KEY, ROLES
from drivecomm.server.broker import BROKER_KEYS, broker_settings
from drivecomm.server.mqtt.changes import AT_LEAST_EVERY_S, ChangeRules
from drivecomm.tomlfile import SECONDS, TABLE, TEXT, Kind

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.server import Role
    from drivecomm.server.broker import BrokerSettings
    from drivecomm.tomlfile import TomlTable

_PREFIX = Kind((str,), 'topics in quotes, such as "plant/hall-2"')
_KEYS = {
    "kind": TEXT,
    "prefix": _PREFIX,
    "levels": LEVELS_KEY,
    "messages": Kind((str,), '"quantities" or "drives"'),
    "publish": Kind((str,), '"polls" or "changes"'),
    "deadband": TABLE,
    "at_least_every_s": SECONDS,
    "role": Kind((str,), '"view", "operate" or "commission"'),
    "home_assistant": Kind((str,), 'the topic where it looks for devices, "homeassistant" unless it was changed there'),
    **BROKER_KEYS,
}
_LONGEST_PREFIX = 200
_LONGEST_EVERY_S = 86_400


@dataclass(frozen=True, slots=True, kw_only=True)
class MqttSettings:
    """Settings of an MQTT door.

    prefix: "" for the default one. levels: their names in topics, empty without them. changes: None if every poll is
    published. role: None if only users with tokens may command.
    """

    broker: BrokerSettings
    prefix: str = ""
    levels: Mapping[str, str] = field(default_factory=dict, hash=False)
    messages: Literal["quantities", "drives"] = "quantities"
    changes: ChangeRules | None = None
    role: Role | None = None
    home_assistant: str = ""


def mqtt_settings(table: TomlTable) -> MqttSettings:
    """Return the settings from a table. Raises FileFormatError with the line in the file."""
    given = table.take(_KEYS)
    for key in ("prefix", "home_assistant"):
        if key in given:
            _check_topic(table, key, given[key])
    if given.get("messages", "quantities") not in ("quantities", "drives"):
        raise table.error(f"invalid messages = {given['messages']!r:.80}; write {_KEYS['messages'].words}", "messages")
    if given.get("publish", "polls") not in ("polls", "changes"):
        raise table.error(f"invalid publish = {given['publish']!r:.80}; write {_KEYS['publish'].words}", "publish")
    role = given.get("role")
    if role is not None and role not in ROLES:
        raise table.error(f"unknown role {role!r:.80}; {suggestion(role, ROLES, 'use')}", "role")
    return MqttSettings(
        broker=broker_settings(table, given),
        prefix=given.get("prefix", ""),
        levels=given.get("levels", {}),
        messages=given.get("messages", "quantities"),
        changes=_change_rules(table, given),
        role=None if role is None else ROLES[role],
        home_assistant=given.get("home_assistant", ""),
    )


def _change_rules(table: TomlTable, given: Mapping[str, Any]) -> ChangeRules | None:
    if given.get("publish", "polls") == "polls":
        for key in ("deadband", "at_least_every_s"):
            if key in given:
                raise table.error(f'{key} is for doors that publish changes; write publish = "changes" beside it', key)
        return None
    deadbands = given.get("deadband", {})
    for name, size in deadbands.items():
        if isinstance(size, bool) or not isinstance(size, int | float) or not 0 <= size < inf:
            raise table.error(
                f"invalid deadband of {name}: {size!r:.80}; write a number in the quantity's unit, 0 or more",
                "deadband",
            )
    every_s = given.get("at_least_every_s", AT_LEAST_EVERY_S)
    if not 1 <= every_s <= _LONGEST_EVERY_S:
        raise table.error(
            f"invalid at_least_every_s = {every_s:g}; write 1 to {_LONGEST_EVERY_S} seconds", "at_least_every_s"
        )
    return ChangeRules(deadbands=deadbands, at_least_every_s=every_s)


def _check_topic(table: TomlTable, key: str, topic: str) -> None:
    levels = topic.split("/")
    fit = all(levels) and not topic.startswith("$") and not set(topic) & set("+#") and topic.isprintable()
    if not fit or len(topic) > _LONGEST_PREFIX:
        raise table.error(
            f"invalid {key} = {topic!r:.80}; write {_KEYS[key].words}, without + and #, no $ at its beginning, and no "
            "empty level",
            key,
        )
