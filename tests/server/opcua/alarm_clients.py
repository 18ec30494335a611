"""Two client stacks that follow, acknowledge, confirm and comment alarms of a door: asyncua and node-opcua."""

import asyncio
import json
from contextlib import asynccontextmanager
from dataclasses import dataclass, field

from asyncua import ua
from node_programs import node_program
from served_opcua import until

_METHODS = {
    "acknowledge": ua.ObjectIds.AcknowledgeableConditionType_Acknowledge,
    "confirm": ua.ObjectIds.AcknowledgeableConditionType_Confirm,
    "comment": ua.ObjectIds.ConditionType_AddComment,
}
_FIELDS = {
    "event": "EventId", "type": "EventType", "retain": "Retain", "active": "ActiveState/Id", "acked": "AckedState/Id",
    "confirmed": "ConfirmedState/Id", "severity": "Severity", "message": "Message", "comment": "Comment",
    "user": "ClientUserId", "branch": "BranchId", "quality": "Quality", "name": "ConditionName",
    "enabled": "EnabledState/Id", "source": "SourceName",
}  # fmt: skip


@dataclass
class Followed:
    """Notifications of alarms that a client received, oldest first, and of other events.

    act: a function that acknowledges, confirms or comments a condition.
    """

    act: object
    browse: object
    notifications: list = field(default_factory=list)
    others: list = field(default_factory=list)

    def latest(self, condition):
        return next((each for each in reversed(self.notifications) if each["alarm"] == condition), None)

    async def shows(self, condition, **wanted):
        """Wait until the client was notified of this state of a condition; return the fields of that notification."""

        def found():
            latest = self.latest(condition)
            return latest is not None and {key: latest[key] for key in wanted} == wanted

        await until(found, 60)
        return self.latest(condition)


def event_filter(*where):
    """Return a filter that selects the fields that `Followed` keeps. where: elements of its where clause."""
    condition = ua.SimpleAttributeOperand(
        TypeDefinitionId=ua.NodeId(ua.ObjectIds.ConditionType), BrowsePath=[], AttributeId=ua.AttributeIds.NodeId
    )
    fields = [operand(path) for path in _FIELDS.values()]
    return ua.EventFilter(SelectClauses=[condition, *fields], WhereClause=ua.ContentFilter(Elements=list(where)))


def operand(path):
    return ua.SimpleAttributeOperand(
        TypeDefinitionId=ua.NodeId(ua.ObjectIds.BaseEventType),
        BrowsePath=[ua.QualifiedName(each, 0) for each in path.split("/")], AttributeId=ua.AttributeIds.Value,
    )  # fmt: skip


def condition_fields(values):
    """Return the fields that `event_filter` selects, by name; None for an event that is not of a condition."""
    condition, *fields = values
    plain = {name: each.Value for name, each in zip(_FIELDS, fields, strict=True)}
    if condition.Value is None:
        return None
    return {
        **plain, "alarm": condition.Value.to_string(), "event": plain["event"].hex(), "type": plain["type"].to_string(),
        "message": plain["message"].Text, "comment": plain["comment"].Text or "", "quality": plain["quality"].name,
        "branch": plain["branch"].to_string(),
    }  # fmt: skip


async def refresh(client, *numbers):
    """Call ConditionRefresh, or ConditionRefresh2 with the number of an item; return the name of its status."""
    name = "ConditionRefresh2" if len(numbers) > 1 else "ConditionRefresh"
    request = ua.CallMethodRequest(
        ObjectId=ua.NodeId(ua.ObjectIds.ConditionType),
        MethodId=ua.NodeId(getattr(ua.ObjectIds, f"ConditionType_{name}")),
        InputArguments=[ua.Variant(each, ua.VariantType.UInt32) for each in numbers],
    )
    (result,) = await client.uaclient.call([request])
    return result.StatusCode.name


async def act_of(client, what, condition, event, comment=""):
    """Acknowledge, confirm or comment a condition with asyncua; return the name of the status."""
    request = ua.CallMethodRequest(
        ObjectId=ua.NodeId.from_string(condition), MethodId=ua.NodeId(_METHODS[what]),
        InputArguments=[ua.Variant(bytes.fromhex(event)), ua.Variant(ua.LocalizedText(comment))],
    )  # fmt: skip
    (result,) = await client.uaclient.call([request])
    return result.StatusCode.name


class _Publishing:
    """Callback of asyncua's client for each message of a subscription."""

    def __init__(self, followed):
        self._followed = followed

    async def __call__(self, result):
        for each in result.NotificationMessage.NotificationData or []:
            for event in getattr(each, "Events", None) or []:
                found = condition_fields(event.EventFields)
                if found is None:
                    self._followed.others.append(event.EventFields[2].Value.to_string())
                else:
                    self._followed.notifications.append(found)


@asynccontextmanager
async def followed_by_asyncua(one, user="otto", *, node=None, where=()):
    async with one.client(user) as client:

        async def act(what, condition, event="", comment=""):
            return await act_of(client, what, condition, event or followed.latest(condition)["event"], comment)

        async def browse(place):
            references = await client.get_node(place).get_references(direction=ua.BrowseDirection.Forward)
            return [[each.ReferenceTypeId.to_string(), each.NodeId.to_string()] for each in references]

        followed = Followed(act, browse)
        followed.client = client
        params = ua.CreateSubscriptionParameters(
            RequestedPublishingInterval=50.0, RequestedLifetimeCount=1000, RequestedMaxKeepAliveCount=20,
            PublishingEnabled=True,
        )  # fmt: skip
        made = await client.uaclient.create_subscription(params, _Publishing(followed))
        followed.subscription = made.SubscriptionId
        request = ua.MonitoredItemCreateRequest(
            ItemToMonitor=ua.ReadValueId(
                NodeId=node or ua.NodeId(ua.ObjectIds.Server), AttributeId=ua.AttributeIds.EventNotifier
            ),
            MonitoringMode=ua.MonitoringMode.Reporting,
            RequestedParameters=ua.MonitoringParameters(
                ClientHandle=ua.IntegerId(1), QueueSize=100, Filter=event_filter(*where)
            ),
        )
        (item,) = await client.uaclient.create_monitored_items(ua.CreateMonitoredItemsParameters(
            SubscriptionId=made.SubscriptionId, TimestampsToReturn=ua.TimestampsToReturn.Both, ItemsToCreate=[request],
        ))  # fmt: skip
        item.StatusCode.check()
        followed.item = item.MonitoredItemId
        assert await refresh(client, made.SubscriptionId) == "Good"
        yield followed


@asynccontextmanager
async def followed_by_node(folder, one, user="otto"):
    ready, answers = asyncio.Event(), asyncio.Queue()

    async def ask(**asked):
        process.stdin.write(json.dumps(asked).encode() + b"\n")
        return await asyncio.wait_for(answers.get(), 20)

    async def act(what, condition, event="", comment=""):
        return (await ask(do=what, condition=condition, event=event, comment=comment))["status"]

    async def browse(place):
        return (await ask(do="browse", node=place))["browsed"]

    followed = Followed(act, browse)

    def told(said):
        if "alarm" in said:
            followed.notifications.append(said)
        elif "told" in said:
            followed.others.append(said["told"])
        elif "ready" in said:
            ready.set()
        else:
            answers.put_nowait(said)

    async with node_program(folder, "node_alarms.js", one.url, user, told=told) as process:
        await asyncio.wait_for(ready.wait(), 30)
        yield followed
