"""An alarm of the plant as an OPC UA condition (Part 9): type, fields, and the events that can be acknowledged.

Confirmation is optional: an alarm disappears once it is over and acknowledged, even without a confirmation.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from asyncua import ua

from drivecomm.server.opcua.events import PlantEvent, base_fields
from drivecomm.server.opcua.nodes import standard
from drivecomm.server.opcua.values import GOOD, LAST_USABLE, NULL, moment

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.server import Alarm, AlarmRule

_KINDS: Mapping[str, tuple[ua.NodeId, int, ua.NodeId]] = {
    on: (standard(kind), severity, standard(group))
    for on, kind, severity, group in (
        ("fault", ua.ObjectIds.TripAlarmType, 900, ua.ObjectIds.ProcessConditionClassType),
        ("silent", ua.ObjectIds.OffNormalAlarmType, 700, ua.ObjectIds.SystemConditionClassType),
        ("warning", ua.ObjectIds.OffNormalAlarmType, 500, ua.ObjectIds.ProcessConditionClassType),
        ("changed_since_baseline", ua.ObjectIds.OffNormalAlarmType, 500, ua.ObjectIds.SystemConditionClassType),
        ("limit", ua.ObjectIds.ExclusiveLevelAlarmType, 700, ua.ObjectIds.ProcessConditionClassType),
        # An unacknowledged alarm whose rule has been removed from the plant file.
        ("", ua.ObjectIds.AlarmConditionType, 700, ua.ObjectIds.BaseConditionClassType),
    )
}
"""Condition type, severity and condition class for each kind of rule."""
_SIDES = {
    "above": ("HighLimit", "High", standard(ua.ObjectIds.ExclusiveLimitStateMachineType_High)),
    "below": ("LowLimit", "Low", standard(ua.ObjectIds.ExclusiveLimitStateMachineType_Low)),
}
_MOST_EVENTS = 50
"""Number of recent events of a condition that an acknowledgement may name."""


def kind_of(rule: AlarmRule | None) -> ua.NodeId:
    """Return the condition type for a rule. rule: None if it has been removed."""
    return _KINDS["" if rule is None else rule.on][0]


class AlarmCondition:
    """Condition for one rule on one drive, after its first alarm.

    node: its own node. types: its type and supertypes. watched: the node that the rule watches.
    """

    def __init__(
        self, node: ua.NodeId, rule: AlarmRule | None, types: frozenset[ua.NodeId], watched: ua.NodeId | None
    ) -> None:
        self.node, self.kind = node, kind_of(rule)
        self._rule, self._types, self._watched = rule, types, watched
        self._known: dict[bytes, int] = {}
        self._turn = 0
        self._alarm: Alarm | None = None
        self._event: PlantEvent | None = None

    @property
    def alarm(self) -> Alarm:
        """The alarm in its last reported state."""
        assert self._alarm is not None  # noqa: S101 - taken when it was made
        return self._alarm

    @property
    def event(self) -> PlantEvent:
        """The event that reported that state."""
        assert self._event is not None  # noqa: S101 - made with the alarm
        return self._event

    @property
    def retains(self) -> bool:
        """Whether the condition is of interest: its alarm is active or not acknowledged."""
        return _retains(self.alarm)

    def take(self, alarm: Alarm, source: ua.NodeId, notifiers: frozenset[ua.NodeId]) -> PlantEvent | None:
        """Return an event for the new state of the alarm; None if the state has not changed."""
        before, self._alarm = self._alarm, alarm
        if before is not None:
            if _state(before) == _state(alarm):
                return None
            if before.id != alarm.id or (before.which and before.which != alarm.which):
                # An acknowledgement of an earlier alarm or of another fault does not apply to the new one.
                self._known.clear()
            elif before.acknowledged_by and not alarm.acknowledged_by:
                self._turn += 1
        latest_s = _latest_s(alarm)
        time_s = time.time() if before is not None and _latest_s(before) == latest_s else latest_s
        fields = self._fields(alarm, source, time_s)
        self._known[fields["EventId"].Value] = self._turn
        if len(self._known) > _MOST_EVENTS:
            del self._known[next(iter(self._known))]
        self._event = PlantEvent(fields=fields, types=self._types, notifiers=notifiers, condition=self.node)
        return self._event

    def knows(self, event: bytes) -> bool:
        """Return whether this event reported the present alarm."""
        return event in self._known

    def needs_acknowledgement(self, event: bytes) -> bool:
        """Return whether the state reported by this event still needs an acknowledgement."""
        return self._known.get(event) == self._turn and not self.alarm.acknowledged_by

    def needs_confirmation(self, event: bytes) -> bool:
        """Return whether the state reported by this event still needs a confirmation."""
        return self._known.get(event) == self._turn and not _is_confirmed(self.alarm)

    def _fields(self, alarm: Alarm, source: ua.NodeId, time_s: float) -> dict[str, ua.Variant]:
        rule = self._rule
        kind, severity, group = _KINDS["" if rule is None else rule.on]
        text = alarm.text if alarm.over_s is None else f"{alarm.text}; over: {alarm.gone}"
        fields = base_fields(kind, source, alarm.drive, text, severity, time_s)
        fields |= {
            "ConditionClassId": ua.Variant(group, ua.VariantType.NodeId),
            "ConditionClassName": _text(_CLASS_NAMES[group]),
            "ConditionName": ua.Variant(alarm.rule, ua.VariantType.String),
            "BranchId": ua.Variant(ua.NodeId(), ua.VariantType.NodeId),
            "Retain": ua.Variant(_retains(alarm), ua.VariantType.Boolean),
            "Quality": ua.Variant(GOOD if alarm.known else LAST_USABLE, ua.VariantType.StatusCode),
            "Quality/SourceTimestamp": _time(time_s),
            "LastSeverity": ua.Variant(severity, ua.VariantType.UInt16),
            "LastSeverity/SourceTimestamp": _time(alarm.raised_s),
            "Comment": _text(alarm.comment),
            "Comment/SourceTimestamp": _time(alarm.comment_s),
            "ClientUserId": ua.Variant(_latest_user(alarm), ua.VariantType.String),
            "InputNode": ua.Variant(self._watched or ua.NodeId(), ua.VariantType.NodeId),
            "SuppressedOrShelved": ua.Variant(False, ua.VariantType.Boolean),
            **_two_states("EnabledState", True, ("Enabled", "Disabled"), None),
            **_two_states(
                "AckedState", bool(alarm.acknowledged_by), ("Acknowledged", "Unacknowledged"),
                alarm.acknowledged_s or alarm.raised_s,
            ),
            **_two_states(
                "ConfirmedState", _is_confirmed(alarm), ("Confirmed", "Unconfirmed"),
                alarm.confirmed_s or alarm.acknowledged_s or alarm.raised_s,
            ),
            **_two_states(
                "ActiveState", alarm.over_s is None, ("Active", "Inactive"), alarm.over_s or alarm.raised_s,
            ),
        }  # fmt: skip
        if rule is not None:
            fields["OnDelay"] = ua.Variant(rule.for_s * 1000, ua.VariantType.Double)
            fields["OffDelay"] = ua.Variant(rule.over_s * 1000, ua.VariantType.Double)
            if rule.limit is None:
                fields["NormalState"] = ua.Variant(ua.NodeId(), ua.VariantType.NodeId)
            else:
                name, state, state_node = _SIDES[rule.limit.side]
                is_on = alarm.over_s is None
                fields[name] = ua.Variant(float(rule.limit.at), ua.VariantType.Double)
                fields["LimitState/CurrentState"] = _text(state) if is_on else NULL
                fields["LimitState/CurrentState/Id"] = ua.Variant(state_node, ua.VariantType.NodeId) if is_on else NULL
        return fields


_CLASS_NAMES = {
    standard(getattr(ua.ObjectIds, name)): name
    for name in ("ProcessConditionClassType", "SystemConditionClassType", "BaseConditionClassType")
}


def _retains(alarm: Alarm) -> bool:
    return alarm.over_s is None or not alarm.acknowledged_by


def _is_confirmed(alarm: Alarm) -> bool:
    """Return whether no confirmation is needed: only an acknowledged, still active alarm needs one."""
    return bool(alarm.confirmed_by) or not alarm.acknowledged_by or not _retains(alarm)


def _state(alarm: Alarm) -> tuple[object, ...]:
    return (
        alarm.id, alarm.told, alarm.times, alarm.which, alarm.known, alarm.over_s, alarm.acknowledged_s,
        alarm.confirmed_s, alarm.comment_s,
    )  # fmt: skip


def _latest_s(alarm: Alarm) -> float:
    since = alarm.told_s, alarm.over_s, alarm.acknowledged_s, alarm.confirmed_s, alarm.comment_s
    return max(alarm.raised_s, *(each or 0.0 for each in since))


def _latest_user(alarm: Alarm) -> str:
    done = (
        (alarm.acknowledged_s, alarm.acknowledged_by), (alarm.confirmed_s, alarm.confirmed_by),
        (alarm.comment_s, alarm.comment_by),
    )  # fmt: skip
    return max((time_s or 0.0, who) for time_s, who in done)[1]


def _two_states(name: str, is_true: bool, texts: tuple[str, str], since_s: float | None) -> dict[str, ua.Variant]:
    found = {
        name: _text(texts[0] if is_true else texts[1]),
        f"{name}/Id": ua.Variant(is_true, ua.VariantType.Boolean),
    }
    return found if since_s is None else {**found, f"{name}/TransitionTime": _time(since_s)}


def _text(text: str) -> ua.Variant:
    return ua.Variant(ua.LocalizedText(text), ua.VariantType.LocalizedText)


def _time(time_s: float | None) -> ua.Variant:
    return NULL if time_s is None else ua.Variant(moment(time_s), ua.VariantType.DateTime)
