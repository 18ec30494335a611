"""Server nodes, state nodes, and results of single nodes, read by two client stacks over TCP."""

import asyncio
import json
import os
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from asyncua import ua
from served_opcua import PASSWORDS, ReceivedValues, data, node, reads_good, until

from drivecomm.protocol import DriveState
from drivecomm.version import __version__

pytestmark = pytest.mark.soak

PROGRAM = Path(__file__).with_name("node_results.js")
GOOD, BAD = "drives/fan/Monitoring/ConverterOutputFrequency", "drives/fan/Monitoring/Nowhere"
STATES = [each.value for each in DriveState]
FURTHER = {
    "states": "ns=2;s=types/DriveType/State/EnumStrings",
    "true": "ns=2;s=types/DriveType/Running/TrueState",
    "false": "ns=2;s=types/DriveType/Running/FalseState",
    "state": "ns=2;s=drives/fan/Status/State",
    "running": "ns=2;s=drives/fan/Status/Running",
    "reachability": "ns=2;s=drives/fan/Status/Reachability",
    "version": "i=2264",
    "product": "i=2262",
    "profiles": "i=2269",
    "namespace": "ns=2;s=namespace/NamespaceUri",
    "subset": "ns=2;s=namespace/IsNamespaceSubset",
}


async def asked_by_asyncua(_folder, one):
    async with one.client("vera") as vera:
        places = [ua.NodeId(each, 2) for each in (GOOD, BAD, GOOD)]
        value = ua.AttributeIds.Value
        told = {}
        read = await vera.uaclient.read(ua.ReadParameters(
            NodesToRead=[ua.ReadValueId(NodeId=each, AttributeId=value) for each in places]
        ))  # fmt: skip
        told["read"] = [each.StatusCode.name for each in read]
        written = await vera.uaclient.write(ua.WriteParameters(NodesToWrite=[
            ua.WriteValue(NodeId=each, AttributeId=value, Value=ua.DataValue(ua.Variant(1.0))) for each in places
        ]))  # fmt: skip
        told["write"] = [each.name for each in written]
        subscription = await vera.create_subscription(100, None)
        items = await vera.uaclient.create_monitored_items(ua.CreateMonitoredItemsParameters(
            SubscriptionId=subscription.subscription_id,
            ItemsToCreate=[
                ua.MonitoredItemCreateRequest(ItemToMonitor=ua.ReadValueId(NodeId=each, AttributeId=value))
                for each in places
            ],
        ))  # fmt: skip
        told["monitor"] = [each.StatusCode.name for each in items]
        now = datetime.now(UTC)
        past = await vera.uaclient.history_read(ua.HistoryReadParameters(
            HistoryReadDetails=ua.ReadRawModifiedDetails(
                IsReadModified=False, StartTime=now - timedelta(minutes=1), EndTime=now, NumValuesPerNode=3
            ),
            ReleaseContinuationPoints=False, NodesToRead=[ua.HistoryReadValueId(NodeId=each) for each in places],
        ))  # fmt: skip
        told["history"] = [each.StatusCode.name for each in past]

        def plain(found):
            if isinstance(found, list):
                return [plain(each) for each in found]
            return found.Text if isinstance(found, ua.LocalizedText) else found

        told["values"] = [plain(await vera.get_node(each).read_value()) for each in FURTHER.values()]
        return told


async def asked_by_node(folder, one):
    process = await asyncio.create_subprocess_exec(
        "node", str(PROGRAM), one.url, "vera", PASSWORDS["vera"], f"ns=2;s={GOOD}", f"ns=2;s={BAD}", *FURTHER.values(),
        stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.PIPE, env={**os.environ, "NODE_PATH": folder},
    )  # fmt: skip
    out, errors = await asyncio.wait_for(process.communicate(), 60)
    assert process.returncode == 0, errors.decode()[-2000:]
    return json.loads(out.decode().strip().splitlines()[-1])


@pytest.fixture(params=["asyncua", "node-opcua"])
def answers(request, door):
    """Return the results that one client stack gets from the door."""
    folder = "" if request.param == "asyncua" else request.getfixturevalue("node_opcua")
    asked = asked_by_asyncua if request.param == "asyncua" else asked_by_node
    found = {}

    async def test(one):
        async with one.client("vera") as vera:
            await reads_good(vera, GOOD)
            await reads_good(vera, "drives/fan/Status/State")
        found.update(await asked(folder, one))

    door.run(test)
    return found


def test_unknown_node_among_others_gets_its_own_result(answers):
    unknown = "BadNodeIdUnknown"
    assert answers["read"][1] == answers["monitor"][1] == answers["write"][1] == answers["history"][1] == unknown
    # On a busy machine a value may be stale by now.
    assert {answers["read"][0], answers["read"][2]} <= {"Good", "UncertainLastUsableValue"}
    assert [answers["monitor"][0], answers["monitor"][2]] == ["Good", "Good"]
    assert [answers["write"][0], answers["write"][2]] == ["BadNotWritable", "BadNotWritable"]
    assert {answers["history"][0], answers["history"][2]} == {"Good"}


def test_server_object_and_state_nodes_have_correct_values(answers):
    found = dict(zip(FURTHER, answers["values"], strict=True))
    assert (found["version"], found["product"]) == (__version__, "urn:drivecomm")
    assert (found["namespace"], found["subset"]) == ("urn:drivecomm:plant", False)
    assert "http://opcfoundation.org/UA-Profile/Server/ACAckAlarm" in found["profiles"]
    assert "http://opcfoundation.org/UA-Profile/Server/AggregateHistorical" in found["profiles"]
    # Clients store state numbers, so that another order would change their meaning.
    assert found["states"] == ["not_ready", "ready", "running", "stopping", "fault"] == STATES
    assert (found["false"], found["true"], found["running"]) == ("stopped", "running", False)
    assert STATES[found["state"]] in ("not_ready", "ready")
    assert found["reachability"] == 1


def test_build_info_is_of_this_program(door):
    async def test(one):
        async with one.client("vera") as vera:
            build = await vera.get_node(ua.ObjectIds.Server_ServerStatus_BuildInfo).read_value()
            assert datetime(2024, 1, 1, tzinfo=UTC) < build.BuildDate.replace(tzinfo=UTC) <= datetime.now(UTC)
            assert (build.BuildNumber, build.ManufacturerName) == (__version__, "drivecomm")

    door.run(test)


def test_state_nodes_have_standard_types_and_share_their_texts(door):
    async def test(one):
        async with one.client("vera") as vera:
            for place, kind, word in (
                ("drives/fan/Status/Running", ua.ObjectIds.TwoStateDiscreteType, "0:TrueState"),
                ("drives/pump/Status/State", ua.ObjectIds.MultiStateDiscreteType, "0:EnumStrings"),
                ("lines/yard/Up", ua.ObjectIds.TwoStateDiscreteType, "0:FalseState"),
            ):
                shown = node(vera, place)
                assert await shown.read_type_definition() == ua.NodeId(kind)
                assert str((await shown.get_child(word)).nodeid.Identifier).startswith("types/")
            assert (await data(vera, "drives/pump/Status/State")).Value.VariantType == ua.VariantType.UInt32

    door.run(test)


def test_each_path_and_subscription_gets_its_own_result(door):
    async def test(one):
        async with one.client("vera") as vera:
            empty = ua.BrowsePath(StartingNode=ua.NodeId("plant", 2), RelativePath=ua.RelativePath(Elements=[]))
            name = ua.RelativePathElement(
                ReferenceTypeId=ua.NodeId(ua.ObjectIds.HierarchicalReferences), IncludeSubtypes=True, IsInverse=False,
                TargetName=ua.QualifiedName("Name", 2),
            )  # fmt: skip
            known = ua.BrowsePath(StartingNode=ua.NodeId("plant", 2), RelativePath=ua.RelativePath(Elements=[name]))
            found = await vera.uaclient.translate_browsepaths_to_nodeids([empty, known])
            assert [each.StatusCode.name for each in found] == ["BadNothingToDo", "Good"]
            own = await vera.create_subscription(100, None)
            ended = await vera.uaclient.delete_subscriptions([1, own.subscription_id])
            assert [each.name for each in ended] == ["BadSubscriptionIdInvalid", "Good"]

    door.run(test)


def test_enabled_item_sends_its_present_value(door):
    async def test(one):
        told = ReceivedValues()

        async with one.client("vera") as vera:
            subscription = await vera.create_subscription(50, told)
            item = await subscription.subscribe_data_change(node(vera, "drives/fan/Identification/Title"))
            await until(lambda: len(told) == 1)
            for mode in (ua.MonitoringMode.Disabled, ua.MonitoringMode.Reporting):
                await subscription.set_monitoring_mode(mode)
            await until(lambda: len(told) == 2)
            assert told[0] == told[1]
            assert item

    door.run(test)
