"""The alarms of the plant as conditions: objects in the folder Alarms, their events and their methods.

A condition exists from its first alarm on and keeps its node id. Its state is that of the server, whichever door
changes it. So an acknowledgement through another door is reported here, and the state survives a restart.
"""

from __future__ import annotations

import time
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from asyncua import ua

from drivecomm.errors import NotAllowedError, UsageError, printable
from drivecomm.server import Role
from drivecomm.server.opcua.active_request import current_request
from drivecomm.server.opcua.condition import AlarmCondition, kind_of
from drivecomm.server.opcua.events import PlantEvent, base_fields
from drivecomm.server.opcua.instances import make_variable, with_supertypes
from drivecomm.server.opcua.naming import part, place_of
from drivecomm.server.opcua.nodes import COMPONENT, FOLDER, ORGANIZES, standard
from drivecomm.server.opcua.values import GOOD, now, status

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable, Sequence

    from asyncua.server.address_space import AttributeValue
    from asyncua.server.internal_session import InternalSession

    from drivecomm.server import Alarm, AlarmRule, Event, ServedPlant
    from drivecomm.server.opcua.events import Events
    from drivecomm.server.opcua.nodes import Nodes
    from drivecomm.server.opcua.tree import PlantTree

_HAS_CONDITION = standard(ua.ObjectIds.HasCondition)
_METHODS = tuple(
    standard(each)
    for each in (
        ua.ObjectIds.AcknowledgeableConditionType_Acknowledge,
        ua.ObjectIds.AcknowledgeableConditionType_Confirm,
        ua.ObjectIds.ConditionType_AddComment,
        ua.ObjectIds.ConditionType_Enable,
        ua.ObjectIds.ConditionType_Disable,
    )
)
_WATCHED = {"fault": "Fault", "warning": "Warning", "silent": "Reachability"}
_LONGEST_COMMENT = 500


class AlarmConditions:
    """Conditions of a plant; `sync` reports changed alarms."""

    def __init__(self, plant: ServedPlant, nodes: Nodes, tree: PlantTree, events: Events) -> None:
        self._plant, self._nodes, self._tree, self._events = plant, nodes, tree, events
        self._folder = nodes.make_object(tree.root, nodes.id("alarms"), "Alarms", kind=FOLDER, by=ORGANIZES)
        self._conditions: dict[tuple[str, str], AlarmCondition] = {}
        self._shown: dict[ua.NodeId, list[AttributeValue]] = {}

    def link(self, session: InternalSession) -> None:
        """Register the condition methods. session: the server's own session."""
        acknowledge, confirm, comment, enable, disable = _METHODS
        session.add_method_callback(acknowledge, self._acknowledge)
        session.add_method_callback(confirm, self._confirm)
        session.add_method_callback(comment, self._comment)
        # Alarms are enabled and disabled in the plant file only.
        session.add_method_callback(enable, _refusing(ua.StatusCodes.BadConditionAlreadyEnabled))
        session.add_method_callback(disable, _refusing(ua.StatusCodes.BadNotSupported))
        session.add_method_callback(standard(ua.ObjectIds.ConditionType_ConditionRefresh), self._refresh)
        session.add_method_callback(standard(ua.ObjectIds.ConditionType_ConditionRefresh2), self._refresh)

    async def sync(self, happened: Sequence[Event] = ()) -> None:
        """Report changed alarms. happened: events since the last call."""
        rules = {rule.name: rule for rule in self._plant.alarm_rules()}
        standing = {(alarm.rule, alarm.drive): alarm for alarm in self._plant.alarms()}
        for (name, _), alarm in standing.items():
            await self._take(alarm, rules.get(name))
        for (name, drive), condition in list(self._conditions.items()):
            rule = rules.get(name)
            if (name, drive) not in standing:
                if condition.retains:
                    await self._take(_left(condition.alarm, happened), rule)
                if rule is None or drive not in rule.drives:
                    await self._forget(name, drive)

    async def _take(self, alarm: Alarm, rule: AlarmRule | None) -> None:
        key = alarm.rule, alarm.drive
        known = self._conditions.get(key)
        if known is not None and rule is not None and known.kind != kind_of(rule):
            await self._forget(*key)
            known = None
        drive = self._tree.node_of(alarm.drive)
        condition = known or AlarmCondition(
            self._nodes.id("alarms", part(alarm.rule), part(alarm.drive)), rule,
            with_supertypes(self._nodes, kind_of(rule)), None if rule is None else self._watched(rule, alarm.drive),
        )  # fmt: skip
        event = condition.take(alarm, drive or self._tree.root, self._events.notifiers(alarm.drive))
        if known is None:
            self._conditions[key] = condition
            self._show(condition)
        if drive is not None:
            self._nodes.refer(drive, condition.node, _HAS_CONDITION)
        if event is not None:
            for attribute in self._shown[condition.node]:
                await self._nodes.changed(attribute)
            await self._events.tell(event)

    def _watched(self, rule: AlarmRule, drive: str) -> ua.NodeId | None:
        if rule.on not in {*_WATCHED, "limit"}:
            return None
        if rule.limit is None:
            return self._nodes.id("drives", part(drive), "Status", _WATCHED[rule.on])
        place = place_of(rule.limit.quantity)
        return self._nodes.id("drives", part(drive), place.folder, part(place.name))

    def _show(self, condition: AlarmCondition) -> None:
        """Create the nodes of a condition, as declared by its type."""
        nodes, alarm = self._nodes, condition.alarm
        name = f"{alarm.drive}: {alarm.rule}"
        nodes.make_object(self._folder, condition.node, name, kind=condition.kind)
        shown = [
            nodes.make_when_read(
                make_variable(nodes, condition.node, condition.kind, path), partial(_field, condition, path)
            )
            for path in condition.event.fields
        ]
        self._shown[condition.node] = shown
        for method in _METHODS:
            nodes.refer(condition.node, method, COMPONENT)

    async def _forget(self, name: str, drive: str) -> None:
        condition = self._conditions.pop((name, drive))
        del self._shown[condition.node]
        source = self._tree.node_of(drive)
        if source is not None:
            self._nodes.refer_no_more(source, {condition.node})
        await self._nodes.remove(set(self._nodes.below(condition.node)))

    async def _acknowledge(self, node: ua.NodeId, *given: ua.Variant) -> ua.StatusCode:
        return await self._treat(
            node, given, AlarmCondition.needs_acknowledgement, ua.StatusCodes.BadConditionBranchAlreadyAcked,
            self._plant.acknowledge,
        )  # fmt: skip

    async def _confirm(self, node: ua.NodeId, *given: ua.Variant) -> ua.StatusCode:
        return await self._treat(
            node, given, AlarmCondition.needs_confirmation, ua.StatusCodes.BadConditionBranchAlreadyConfirmed,
            self._plant.confirm_alarm,
        )  # fmt: skip

    async def _comment(self, node: ua.NodeId, *given: ua.Variant) -> ua.StatusCode:
        return await self._treat(
            node, given, AlarmCondition.knows, ua.StatusCodes.BadEventIdUnknown, self._plant.comment_alarm
        )

    async def _treat(
        self,
        node: ua.NodeId,
        given: Sequence[ua.Variant],
        needs: Callable[[AlarmCondition, bytes], bool],
        done: int,
        treat: Callable[..., Awaitable[Alarm]],
    ) -> ua.StatusCode:
        """Carry out a method on an alarm.

        needs: whether the named event permits the method. done: status code if it does not.
        """
        await self.sync()
        caller = current_request.get().session.caller
        if caller.role < Role.OPERATE:
            return status(ua.StatusCodes.BadUserAccessDenied)
        condition = next((each for each in self._conditions.values() if each.node == node), None)
        if condition is None:
            return status(ua.StatusCodes.BadNodeIdInvalid)
        if len(given) != 2:
            few = len(given) < 2
            return status(ua.StatusCodes.BadArgumentsMissing if few else ua.StatusCodes.BadTooManyArguments)
        event, comment = (each.Value for each in given)
        if not isinstance(event, bytes) or not isinstance(comment, ua.LocalizedText | None):
            return status(ua.StatusCodes.BadInvalidArgument)
        text = printable(" ".join((comment.Text or "" if comment else "").split()))
        if len(text) > _LONGEST_COMMENT:
            return status(ua.StatusCodes.BadOutOfRange)
        if not condition.knows(event):
            return status(ua.StatusCodes.BadEventIdUnknown)
        if not needs(condition, event):
            return status(done)
        try:
            alarm = await treat(caller, condition.alarm.id, text)
        except NotAllowedError:
            return status(ua.StatusCodes.BadUserAccessDenied)
        except UsageError:
            # Another door has already done this.
            return status(done)
        await self._take(alarm, self._rule(alarm.rule))
        return GOOD

    def _rule(self, name: str) -> AlarmRule | None:
        return next((rule for rule in self._plant.alarm_rules() if rule.name == name), None)

    async def _refresh(self, _: ua.NodeId, *given: ua.Variant) -> ua.StatusCode:
        """Send all conditions of interest to one subscription or one of its items."""
        if not 1 <= len(given) <= 2 or any(not isinstance(each.Value, int) for each in given):
            return status(ua.StatusCodes.BadInvalidArgument)
        items = current_request.get().session.own_items().get(given[0].Value)
        if items is None:
            return status(ua.StatusCodes.BadSubscriptionIdInvalid)
        only = given[1].Value if len(given) > 1 else None
        if only is not None and only not in items:
            return status(ua.StatusCodes.BadMonitoredItemIdInvalid)
        if not items.event_count:
            return status(ua.StatusCodes.BadNothingToDo)
        await items.tell(_marking(ua.ObjectIds.RefreshStartEventType, "the conditions follow"), only)
        for each in self._conditions.values():
            if each.retains:
                await items.tell(each.event, only)
        await items.tell(_marking(ua.ObjectIds.RefreshEndEventType, "these were the conditions"), only)
        return GOOD


def _left(alarm: Alarm, happened: Sequence[Event]) -> Alarm:
    """Return the final state of an alarm that has disappeared from the plant's list."""
    who = next((each.who for each in reversed(happened) if each.alarm == alarm.id and each.who), "")
    time_s = time.time()
    if not alarm.acknowledged_by:
        alarm = replace(alarm, acknowledged_by=who.partition(" (")[0] or "another door", acknowledged_s=time_s)
    return alarm if alarm.over_s is not None else replace(alarm, over_s=time_s)


def _field(condition: AlarmCondition, path: str) -> ua.DataValue:
    fields = condition.event.fields
    return ua.DataValue(fields[path], GOOD, fields["Time"].Value, now())


def _marking(kind: int, text: str) -> PlantEvent:
    node = standard(kind)
    fields = base_fields(node, standard(ua.ObjectIds.Server), "Server", text, 100, time.time())
    return PlantEvent(fields=fields, types=frozenset({node}), notifiers=None)


def _refusing(code: int) -> Callable[..., Awaitable[ua.StatusCode]]:
    async def refuse(*_: object) -> ua.StatusCode:
        return status(code)

    return refuse
