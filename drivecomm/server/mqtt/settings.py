"""What a `[[door]]` of kind mqtt says, besides its broker.

prefix = "drivecomm/hall 2"     # above all topics; drivecomm/ and the plant's name unless given
messages = "drives"             # one for all values of a drive; "quantities" unless given: a topic for each
role = "operate"                # of whoever may publish to the command topics; only users with tokens unless given
home_assistant = "homeassistant"    # where Home Assistant looks for devices; none is told unless given
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from drivecomm.errors import meant
from drivecomm.server import ROLES
from drivecomm.server.broker import BROKER_KEYS, broker_settings
from drivecomm.tomlfile import TEXT, Kind

if TYPE_CHECKING:
    from drivecomm.server import Role
    from drivecomm.server.broker import BrokerSettings
    from drivecomm.tomlfile import Table

_PREFIX = Kind((str,), 'topics in quotes, such as "plant/hall 2"')
_KEYS = {
    "kind": TEXT,
    "prefix": _PREFIX,
    "messages": Kind((str,), '"quantities" or "drives"'),
    "role": Kind((str,), '"view", "operate" or "commission"'),
    "home_assistant": Kind((str,), 'the topic where it looks for devices, "homeassistant" unless it was changed there'),
    **BROKER_KEYS,
}
_LONGEST_PREFIX = 200


@dataclass(frozen=True, slots=True, kw_only=True)
class MqttSettings:
    """A door of kind mqtt. prefix: empty for the usual one. role: None where only users with tokens may ask."""

    broker: BrokerSettings
    prefix: str = ""
    messages: Literal["quantities", "drives"] = "quantities"
    role: Role | None = None
    home_assistant: str = ""


def mqtt_settings(table: Table) -> MqttSettings:
    """Return what a table says. Raises FileFormatError with its line."""
    given = table.take(_KEYS)
    for key in ("prefix", "home_assistant"):
        if key in given:
            _check_topic(table, key, given[key])
    if given.get("messages", "quantities") not in ("quantities", "drives"):
        raise table.error(f"messages cannot be {given['messages']!r:.80}; write {_KEYS['messages'].words}", "messages")
    role = given.get("role")
    if role is not None and role not in ROLES:
        raise table.error(f"unknown role {role!r:.80}; {meant(role, ROLES, 'use')}", "role")
    return MqttSettings(
        broker=broker_settings(table, given),
        prefix=given.get("prefix", ""),
        messages=given.get("messages", "quantities"),
        role=None if role is None else ROLES[role],
        home_assistant=given.get("home_assistant", ""),
    )


def _check_topic(table: Table, key: str, topic: str) -> None:
    levels = topic.split("/")
    fit = all(levels) and not topic.startswith("$") and not set(topic) & set("+#") and topic.isprintable()
    if not fit or len(topic) > _LONGEST_PREFIX:
        raise table.error(
            f"{key} cannot be {topic!r:.80}; write {_KEYS[key].words}, without + and #, no $ at its beginning, and no "
            "empty level",
            key,
        )
