"""Alarms as conditions (OPC UA Part 9): two client stacks follow, acknowledge and confirm them over TCP."""

import asyncio
from functools import partial

import pytest
from alarm_clients import act_of, event_filter, followed_by_asyncua, followed_by_node, operand, refresh
from asyncua import ua
from served_core import ENGINEER, OPERATOR
from served_opcua import PLANT, ReceivedValues, data, node, opened, until

from drivecomm.server.drift_state import DriveDrift, SetChange

pytestmark = pytest.mark.soak

TRIPPED, CURRENT, SILENT = (f"ns=2;s=alarms/{each}/fan" for each in ("tripped", "current", "silent"))
ALARMS = """
[[alarm]]
name = "tripped"
on = "fault"
over_s = 1
[[alarm]]
name = "current"
drives = ["fan"]
quantity = "518"
above = 100
hysteresis = 5
over_s = 1
[[alarm]]
name = "silent"
drives = ["fan"]
on = "silent"
over_s = 1
"""
ALARMED = (
    PLANT.replace('"output_current", "maximum_frequency"], period_s = 0.05', '"480", "518"], period_s = 0.2') + ALARMS
)
TRIP_TYPE, LEVEL_TYPE = f"i={ua.ObjectIds.TripAlarmType}", f"i={ua.ObjectIds.ExclusiveLevelAlarmType}"
REFRESH = [f"i={ua.ObjectIds.RefreshStartEventType}", f"i={ua.ObjectIds.RefreshEndEventType}"]


@pytest.fixture(scope="module")
def alarmed(tmp_path_factory):
    """Yield a function that runs a test with the door of a plant with alarms, and clears all alarms afterwards."""
    with asyncio.Runner() as runner:
        context = opened(tmp_path_factory.mktemp("plant"), ALARMED)
        one = runner.run(context.__aenter__())

        async def run(test):
            try:
                await test(one)
            finally:
                one.control.order("power", drive="fan", state="factory")
                one.control.order("power", drive="fan", state="on")
                await until(lambda: cleared(one), 40)

        async def cleared(one):
            for alarm in one.plant.alarms():
                await one.plant.acknowledge(OPERATOR, alarm.id)
            return not one.plant.alarms()

        try:
            yield lambda test: runner.run(run(test))
        finally:
            runner.run(context.__aexit__(None, None, None))


@pytest.fixture(params=["asyncua", "node-opcua"])
def follower(request):
    """Return a function of one client stack that follows the alarms of a door."""
    if request.param == "asyncua":
        return followed_by_asyncua
    return partial(followed_by_node, request.getfixturevalue("node_opcua"))


def trip(one, code=14):
    one.control.order("trip", drive="fan", code=code)


def reset(one):
    one.control.order("power", drive="fan", state="off")
    one.control.order("power", drive="fan", state="on")


def test_alarm_is_acknowledged_confirmed_and_over(alarmed, follower):
    async def test(one):
        async with follower(one) as client:
            trip(one)
            raised = await client.shows(TRIPPED, active=True)
            assert raised["message"].startswith("fault ")
            expected = {
                "type": TRIP_TYPE, "retain": True, "acked": False, "confirmed": True, "severity": 900, "comment": "",
                "quality": "Good", "name": "tripped", "enabled": True, "source": "fan",
            }  # fmt: skip
            assert {key: raised[key] for key in expected} == expected
            assert raised["branch"] in ("i=0", "ns=0;i=0", None)
            assert await client.act("confirm", TRIPPED) == "BadConditionBranchAlreadyConfirmed"
            assert await client.act("acknowledge", TRIPPED, comment="eva looks") == "Good"
            acked = await client.shows(TRIPPED, acked=True, confirmed=False, retain=True)
            assert (acked["comment"], acked["user"]) == ("eva looks", "otto")
            assert acked["event"] != raised["event"]
            (alarm,) = [each for each in one.plant.alarms() if each.rule == "tripped"]
            assert (alarm.acknowledged_by, alarm.comment) == ("otto", "eva looks")
            event = [each for each in one.core.table.events() if "acknowledged by otto" in each.text][-1]
            assert event.who.startswith("otto (opcua ")
            assert await client.act("acknowledge", TRIPPED) == "BadConditionBranchAlreadyAcked"
            assert await client.act("acknowledge", TRIPPED, raised["event"]) == "BadConditionBranchAlreadyAcked"
            assert await client.act("comment", TRIPPED, comment="fuse replaced") == "Good"
            assert (await client.shows(TRIPPED, comment="fuse replaced"))["acked"]
            assert await client.act("confirm", TRIPPED, comment="done") == "Good"
            await client.shows(TRIPPED, confirmed=True, comment="done")
            reset(one)
            over = await client.shows(TRIPPED, active=False, retain=False, acked=True)
            assert "over: no fault" in over["message"]
            assert not one.plant.alarms()
            assert await client.act("acknowledge", TRIPPED) == "BadConditionBranchAlreadyAcked"

    alarmed(test)


def test_condition_that_is_over_remains_until_acknowledged(alarmed, follower):
    async def test(one):
        async with follower(one) as client:
            one.control.order("set", drive="fan", parameter="518", value=12000)
            raised = await client.shows(CURRENT, active=True)
            assert (raised["type"], raised["severity"]) == (LEVEL_TYPE, 700)
            one.control.order("set", drive="fan", parameter="518", value=1000)
            await client.shows(CURRENT, active=False, retain=True, acked=False)
            assert await client.act("acknowledge", CURRENT) == "Good"
            await client.shows(CURRENT, retain=False, acked=True, confirmed=True)

    alarmed(test)


def test_acknowledgement_at_another_door_is_notified(alarmed, follower):
    async def test(one):
        async with follower(one) as client:
            trip(one)
            raised = await client.shows(TRIPPED, active=True)
            await one.plant.acknowledge(ENGINEER, one.plant.alarms()[0].id, "by telephone")
            told = await client.shows(TRIPPED, acked=True)
            assert (told["user"], told["comment"]) == (ENGINEER.name, "by telephone")
            assert await client.act("acknowledge", TRIPPED, raised["event"]) == "BadConditionBranchAlreadyAcked"

    alarmed(test)


def test_event_id_of_an_earlier_fault_does_not_acknowledge_the_present_one(alarmed, follower):
    async def test(one):
        async with follower(one) as client:
            trip(one, 14)
            first = await client.shows(TRIPPED, active=True)
            trip(one, 5)
            await until(lambda: client.latest(TRIPPED)["message"] != first["message"])
            assert await client.act("acknowledge", TRIPPED, first["event"]) == "BadEventIdUnknown"
            assert await client.act("acknowledge", TRIPPED) == "Good"

    alarmed(test)


@pytest.mark.parametrize("what", ["acknowledge", "confirm", "comment"])
def test_unknown_event_or_user_without_the_right_changes_nothing(alarmed, follower, what):
    async def test(one):
        async with follower(one) as otto, follower(one, "vera") as vera:
            trip(one)
            for client in (otto, vera):
                await client.shows(TRIPPED, active=True)
            assert await vera.act(what, TRIPPED, comment="x") == "BadUserAccessDenied"
            assert await otto.act(what, TRIPPED, "00" * 16, comment="x") == "BadEventIdUnknown"
            (alarm,) = [each for each in one.plant.alarms() if each.rule == "tripped"]
            assert (alarm.acknowledged_by, alarm.confirmed_by, alarm.comment) == ("", "", "")

    alarmed(test)


def test_silent_drive_raises_a_condition_and_makes_others_uncertain(alarmed, follower):
    async def test(one):
        async with follower(one) as client:
            one.control.order("set", drive="fan", parameter="518", value=12000)
            await client.shows(CURRENT, active=True, quality="Good")
            one.control.order("power", drive="fan", state="off")
            assert (await client.shows(SILENT, active=True))["severity"] == 700
            await client.shows(CURRENT, active=True, quality="UncertainLastUsableValue")

    alarmed(test)


def test_clients_find_conditions_below_their_drive(alarmed, follower):
    async def test(one):
        async with follower(one) as client:
            trip(one)
            await client.shows(TRIPPED, active=True)
            assert [f"i={ua.ObjectIds.HasCondition}", TRIPPED] in await client.browse("ns=2;s=drives/fan")
            assert ["i=35", "ns=2;s=alarms"] in await client.browse("ns=2;s=plant")
            below = await client.browse(TRIPPED)
            assert [f"i={ua.ObjectIds.HasTypeDefinition}", TRIP_TYPE] in below
            assert [f"i={ua.ObjectIds.HasComponent}", f"{TRIPPED}/AckedState"] in below

    alarmed(test)


def test_refresh_sends_standing_alarms_between_start_and_end_events(alarmed, follower):
    async def test(one):
        trip(one)
        await until(one.plant.alarms)
        async with follower(one) as client:
            # Nothing has changed since, so the event comes from the refresh.
            await client.shows(TRIPPED, active=True)
            if follower is followed_by_asyncua:
                await until(lambda: len(client.others) >= 2)
                assert [each for each in client.others if each in REFRESH] == REFRESH
                before = client.latest(TRIPPED)["event"]
                assert await refresh(client.client, client.subscription, client.item) == "Good"
                await until(lambda: [each for each in client.others if each in REFRESH] == REFRESH * 2)
                assert client.latest(TRIPPED)["event"] == before

    alarmed(test)


def test_refresh_needs_a_subscription_of_the_session_with_events(alarmed):
    async def test(one):
        async with followed_by_asyncua(one) as otto, one.client("vera") as vera:
            assert await refresh(vera, otto.subscription) == "BadSubscriptionIdInvalid"
            assert await refresh(otto.client, otto.subscription, 1) == "BadMonitoredItemIdInvalid"
            empty = await vera.create_subscription(100, None)
            assert await refresh(vera, empty.subscription_id) == "BadNothingToDo"

    alarmed(test)


def test_where_clause_filters_condition_fields_but_not_refresh_events(alarmed):
    is_limit = ua.ContentFilterElement(
        FilterOperator=ua.FilterOperator.OfType,
        FilterOperands=[ua.LiteralOperand(Value=ua.Variant(ua.NodeId(ua.ObjectIds.LimitAlarmType)))],
    )
    is_active = ua.ContentFilterElement(
        FilterOperator=ua.FilterOperator.Equals,
        FilterOperands=[operand("ActiveState/Id"), ua.LiteralOperand(Value=ua.Variant(True))],
    )
    both = ua.ContentFilterElement(
        FilterOperator=ua.FilterOperator.And, FilterOperands=[ua.ElementOperand(Index=1), ua.ElementOperand(Index=2)]
    )

    async def test(one):
        async with (
            followed_by_asyncua(one, where=(both, is_limit, is_active)) as few,
            followed_by_asyncua(one, node=ua.NodeId("drives/fan", 2)) as fan,
            followed_by_asyncua(one, node=ua.NodeId("drives/pump", 2)) as pump,
        ):
            trip(one)
            one.control.order("set", drive="fan", parameter="518", value=12000)
            await fan.shows(TRIPPED, active=True)
            await few.shows(CURRENT, active=True)
            one.control.order("set", drive="fan", parameter="518", value=1000)
            await fan.shows(CURRENT, active=False)
            assert few.latest(TRIPPED) is None
            assert few.latest(CURRENT)["active"] is True
            assert few.others == REFRESH
            assert pump.notifications == []

    alarmed(test)


def test_fields_of_a_condition_are_read_and_followed_as_variables(alarmed):
    async def test(one):
        told = ReceivedValues()

        async with one.client("vera") as vera:
            one.control.order("set", drive="fan", parameter="518", value=12000)

            async def is_active():
                found = await data(vera, "alarms/current/fan/ActiveState/Id")
                return found.StatusCode.is_good() and found.Value.Value

            await until(is_active)
            found = {
                path: (await data(vera, f"alarms/current/fan/{path}")).Value.Value
                for path in ("Retain", "HighLimit", "OffDelay", "LimitState/CurrentState/Id", "InputNode", "SourceNode")
            }
            assert found == {
                "Retain": True, "HighLimit": 100.0, "OffDelay": 1000.0,
                "LimitState/CurrentState/Id": ua.NodeId(ua.ObjectIds.ExclusiveLimitStateMachineType_High),
                "InputNode": ua.NodeId("drives/fan/Parameters/518", 2), "SourceNode": ua.NodeId("drives/fan", 2),
            }  # fmt: skip
            acked = node(vera, "alarms/current/fan/AckedState/Id")
            definition = await node(vera, "alarms/current/fan/AckedState").read_type_definition()
            assert definition == ua.NodeId(ua.ObjectIds.TwoStateVariableType)
            subscription = await vera.create_subscription(50, told)
            await subscription.subscribe_data_change(acked)
            await until(lambda: told == [False])
            await one.plant.acknowledge(OPERATOR, one.plant.alarms()[0].id)
            await until(lambda: told == [False, True])

    alarmed(test)


def test_condition_of_a_removed_rule_disappears_when_acknowledged(tmp_path):
    async def test():
        async with opened(tmp_path, ALARMED) as one, followed_by_asyncua(one) as client:
            trip(one)
            await client.shows(TRIPPED, active=True)
            one.alarms.change_rules([rule for rule in one.alarms.rules if rule.name != "tripped"])
            over = await client.shows(TRIPPED, active=False, retain=True, acked=False)
            assert "the plant file no longer has this alarm" in over["message"]
            assert await client.act("acknowledge", TRIPPED) == "Good"
            await client.shows(TRIPPED, acked=True, retain=False)

            async def is_gone():
                gone = await data(client.client, "alarms/tripped/fan/Retain")
                return gone.StatusCode.name == "BadNodeIdUnknown"

            await until(is_gone)
            assert [f"i={ua.ObjectIds.HasCondition}", TRIPPED] not in await client.browse("ns=2;s=drives/fan")

    asyncio.run(test())


def test_clients_cannot_enable_or_disable_conditions(alarmed):
    async def test(one):
        async with one.client("otto") as otto:
            for name, status in (("Enable", "BadConditionAlreadyEnabled"), ("Disable", "BadNotSupported")):
                request = ua.CallMethodRequest(
                    ObjectId=ua.NodeId("plant", 2), MethodId=ua.NodeId(getattr(ua.ObjectIds, f"ConditionType_{name}"))
                )
                (result,) = await otto.uaclient.call([request])
                assert result.StatusCode.name == status

    alarmed(test)


def test_filter_of_an_event_item_can_be_changed(alarmed):
    nothing = ua.ContentFilterElement(
        FilterOperator=ua.FilterOperator.Equals,
        FilterOperands=[ua.LiteralOperand(Value=ua.Variant(1)), ua.LiteralOperand(Value=ua.Variant(2))],
    )

    async def test(one):
        async with followed_by_asyncua(one) as changed, followed_by_asyncua(one) as same:
            request = ua.MonitoredItemModifyRequest(
                MonitoredItemId=changed.item,
                RequestedParameters=ua.MonitoringParameters(ClientHandle=1, Filter=event_filter(nothing)),
            )
            (result,) = await changed.client.uaclient.modify_monitored_items(
                ua.ModifyMonitoredItemsParameters(SubscriptionId=changed.subscription, ItemsToModify=[request])
            )
            assert result.StatusCode.is_good()
            trip(one)
            await same.shows(TRIPPED, active=True)
            await same.act("acknowledge", TRIPPED)
            await same.shows(TRIPPED, acked=True)
            assert changed.notifications == []

    alarmed(test)


def test_anonymous_caller_may_follow_alarms_but_not_acknowledge(tmp_path):
    async def test():
        async with opened(tmp_path, ALARMED, anonymous="view") as one, followed_by_asyncua(one, "") as client:
            trip(one)
            raised = await client.shows(TRIPPED, active=True)
            for what in ("acknowledge", "confirm", "comment"):
                assert await client.act(what, TRIPPED, comment="x") == "BadUserAccessDenied"
            async with one.client("otto") as otto:
                assert await act_of(otto, "acknowledge", "ns=2;s=drives/fan", raised["event"]) == "BadNodeIdInvalid"

    asyncio.run(test())


def test_standing_alarm_keeps_its_state_over_a_restart(tmp_path):
    async def test():
        async with opened(tmp_path, ALARMED) as one, followed_by_asyncua(one) as client:
            trip(one)
            await client.shows(TRIPPED, active=True)
            assert await client.act("acknowledge", TRIPPED, comment="eva looks") == "Good"
            before = await client.shows(TRIPPED, acked=True)
        async with opened(tmp_path, ALARMED, reached=False) as one, followed_by_asyncua(one) as client:
            after = await client.shows(TRIPPED, active=True, acked=True, confirmed=False, retain=True)
            assert (after["comment"], after["user"]) == ("eva looks", "otto")
            assert await client.act("acknowledge", TRIPPED, before["event"]) == "BadEventIdUnknown"
            assert await client.act("confirm", TRIPPED) == "Good"

    asyncio.run(test())


def test_change_since_the_baseline_is_a_condition_of_the_drive(tmp_path):
    text = PLANT + '[server]\nbackup = true\n[[alarm]]\nname = "changed"\non = "changed_since_baseline"\nover_s = 1\n'

    async def test():
        async with opened(tmp_path, text) as one, followed_by_asyncua(one) as client:
            change = SetChange(address="420", name="", unit="s", approved=5, now=7, since_s=100.0)
            one.core.drift["fan"] = DriveDrift(state="changed", changes=(change,))
            raised = await client.shows("ns=2;s=alarms/changed/fan", active=True)
            assert raised["message"] == f"1 parameter differs from the baseline since 1970-01-01 00:01 UTC: {change}"
            one.core.drift["fan"] = DriveDrift(state="as approved")
            await client.shows("ns=2;s=alarms/changed/fan", active=False)

    asyncio.run(test())
