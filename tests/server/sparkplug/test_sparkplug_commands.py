"""Commands of Sparkplug hosts: those accepted, those refused with a reason, and stops, which are always sent."""

import asyncio
import time
from contextlib import asynccontextmanager

import pytest
from mosquitto import mosquitto, needs_mosquitto
from served_core import OPERATOR, awaited, runs
from sparkplug_listener import listening
from sparkplug_plant import PLANT, command, door_of, gateway

from drivecomm.server import DriveDrift
from drivecomm.server.sparkplug import SparkplugDoor, hosts as hosts_module
from drivecomm.server.sparkplug.payload import DataType, Metric
from drivecomm.tomlfile import TomlTable

pytestmark = needs_mosquitto

START = "Command/Start"
PERCENT = "Command/Reference Percent"


@asynccontextmanager
async def commanded(tmp_path, text=PLANT, **keys):
    """Yield a host, and a gateway whose drives it may command."""
    with mosquitto(tmp_path / "broker") as broker:
        async with listening(broker.port) as host:
            if "host" in keys:
                await host.host(online=True)
            async with gateway(tmp_path, door_of(broker.url, **keys), text, journal=False) as served:
                host.served, host.broker, host.audit = served, broker, served.core.audit
                await host.until(lambda: {each.device for each in host.of("DBIRTH")} == {"pump", "fan"})
                yield host


async def answered(host, device, outcome, text=""):
    """Wait until hosts have received this outcome, with this text in its reason."""
    await host.until(
        lambda: host.value(device, "Answer/Outcome") == outcome and text in (host.value(device, "Answer/Text") or "")
    )


def refusals(host):
    return [each for each in host.audit.ended_with if each[2].startswith("refused")]


def metrics_of(host, device):
    return {each.name: each for each in host.of("DBIRTH", device=device)[-1].message.metrics}


@pytest.mark.soak
@awaited
async def test_allowed_commands_are_offered_and_carried_out(tmp_path):
    async with commanded(tmp_path) as host:
        offered = {name for name in metrics_of(host, "pump") if name.startswith("Command/")}
        assert offered == {
            "Command/Stop", "Command/Stop Coast", "Command/Stop Quick", "Command/Reset", PERCENT,
            "Command/Reference Hertz", START, "Command/Session",
        }  # fmt: skip
        assert {name for name in metrics_of(host, "fan") if name.startswith("Command/")} == {
            "Command/Stop", "Command/Stop Coast", "Command/Stop Quick",
        }  # fmt: skip
        await host.command("pump", command(PERCENT, 40.0))
        await answered(host, "pump", "done")
        assert host.value("pump", "Answer/Command") == "set_reference"
        assert host.audit.asked_for == [("(broker) (sparkplug plant/gateway)", "pump", "set_reference")]
        # Hosts send commands by alias; an integer is accepted as well.
        alias = metrics_of(host, "pump")["Command/Reference Hertz"].alias
        await host.command("pump", command(value=10, alias=alias, uuid="by alias"))
        await host.until(lambda: host.value("pump", "Answer/Id") == "by alias-0")
        assert host.value("pump", "Answer/Outcome") == "done"
        # Command metrics never have a value, since a command is not a state.
        names = host.names()
        sent = {names[metric.alias][1] for each in host.of("DDATA") for metric in each.message.metrics}
        assert not [name for name in sent if name.startswith("Command/")]
        assert all(each.is_null for name, each in metrics_of(host, "pump").items() if name.startswith("Command/"))


REFUSED = {
    "unknown": (lambda: command("Command/Fly", value=True), "cannot be written"),
    "a-state": (lambda: command("Status/Running", value=True), "cannot be written"),
    "of-another-type": (lambda: command(PERCENT, "40"), "takes a double"),
    "not-a-number": (lambda: command(PERCENT, float("nan")), "needs a value"),
    "nothing": (lambda: command(PERCENT, None, DataType.DOUBLE), "needs a value"),
    "an-alias-of-nobody": (lambda: command(value=1.0, alias=9999), "cannot be written"),
    "no-payload": (lambda: b"\xff\xfe{not protobuf", "not a Sparkplug B payload"),
    "too-large": (lambda: b"\x0a" * 70_000, "send at most"),
}


@pytest.mark.soak
@awaited
async def test_refused_command_is_answered_and_recorded(tmp_path):
    async with commanded(tmp_path) as host:
        for name, (make, why) in REFUSED.items():
            told = len(host.values("pump", "Answer/Outcome"))
            await host.command("pump", make())
            await host.until(lambda told=told: len(host.values("pump", "Answer/Outcome")) > told)
            assert host.value("pump", "Answer/Outcome") == "refused", name
            assert why in host.value("pump", "Answer/Text"), name
            assert why in refusals(host)[-1][2], name
            # The number of recorded refusals per second is limited.
            await asyncio.sleep(0.1)
        assert not host.audit.asked_for
        assert not runs(host.served.control, "pump")


@pytest.mark.soak
@awaited
async def test_retained_commands_are_refused_even_a_stop(tmp_path):
    async with commanded(tmp_path) as host:
        await host.command("pump", command(PERCENT, 40.0), retain=True)
        await answered(host, "pump", "refused", "retained")
        await host.command("fan", command("Command/Stop", value=True), retain=True)
        await answered(host, "fan", "refused", "retained")
        assert not host.audit.stops
        before = len(refusals(host))
        # A new session does not receive them again.
        await host.command("", command("Node Control/Rebirth", value=True))
        await host.until(lambda: len(host.of("NBIRTH")) == 2)
        assert len(refusals(host)) == before


@awaited
async def test_stop_needs_no_lease_or_time_and_is_sent_beside_invalid_metrics(tmp_path):
    async with commanded(tmp_path, role="view") as host:
        served = host.served
        lease = served.core.leases.take(OPERATOR, "pump", 20, now=time.monotonic(), time_s=time.time())
        assert lease.holder == OPERATOR
        more = [Metric(name="Command/Nonsense", type=DataType.STRING, value="x")]
        await host.command("pump", command("Command/Stop Coast", value=True, timed=False, more=more))
        await answered(host, "pump", "done")
        assert host.audit.stops == [("pump", "coast")]
        await host.until(lambda: host.value("pump", "Status/Commander") == str(OPERATOR))
        await host.command("pump", command(PERCENT, 40.0))
        await answered(host, "pump", "refused", "role view")


@awaited
async def test_hosts_without_a_role_may_not_command_or_stop(tmp_path):
    said = {"group": "plant", "node": "gateway"}
    with mosquitto(tmp_path / "broker") as broker:
        door = SparkplugDoor(TomlTable({"broker": broker.url, **said}, "plant.toml"))
        async with listening(broker.port) as host, gateway(tmp_path, door, journal=False) as served:
            host.audit = served.core.audit
            await host.until(lambda: {each.device for each in host.of("DBIRTH")} == {"pump", "fan"})
            assert not [name for name in metrics_of(host, "pump") if name.startswith("Command/")]
            await host.command("pump", command("Command/Stop", value=True))
            await host.command("pump", command(PERCENT, 40.0))
            await answered(host, "pump", "refused")
            assert not host.audit.stops
            assert not host.audit.asked_for


@pytest.mark.soak
@awaited
async def test_start_needs_session_and_primary_host_and_ends_with_the_host(tmp_path, monkeypatch):
    monkeypatch.setattr(hosts_module, "LEASE_S", 1.5)
    async with commanded(tmp_path, host="scada") as host:
        old = Metric(name="Command/Session", type=DataType.STRING, value="another run")
        await host.command("pump", command(START, value=True, more=[old]))
        await answered(host, "pump", "refused", "earlier run")
        said = host.of("NBIRTH")[0].metric("Properties/Session").string_value
        session = Metric(name="Command/Session", type=DataType.STRING, value=said)
        await host.command("pump", command(PERCENT, 50.0))
        await answered(host, "pump", "done")
        await host.command("pump", command(START, value=True, more=[session]))
        await host.until(lambda: host.value("pump", "Status/Running") is True)
        assert host.value("pump", "Status/Kept") == "trip"
        assert host.value("pump", "Status/Commander") == "scada (sparkplug plant/gateway)"
        # The pause is longer than the lease, so the lease has been renewed.
        await asyncio.sleep(2.5)
        assert runs(host.served.control, "pump")
        await host.host(online=False)
        await host.until(lambda: not runs(host.served.control, "pump"))
        await host.host(online=True)
        await host.until(lambda: len(host.of("NBIRTH")) == 2)
        await asyncio.sleep(0.5)
        # The returning host does not restart the motor.
        assert not runs(host.served.control, "pump")


@pytest.mark.parametrize(
    ("online_ms", "offline_ms"),
    [(365 * 86_400_000, 0), (0, -3_600_000)],
    ids=["online was from the future", "clock of the host was set back"],
)
@awaited
async def test_offline_message_stops_a_started_motor_despite_a_wrong_time(tmp_path, online_ms, offline_ms):
    now_ms = round(time.time() * 1000)
    async with commanded(tmp_path, host="scada") as host:
        await host.host(online=True, time_ms=now_ms + online_ms)
        said = host.of("NBIRTH")[0].metric("Properties/Session").string_value
        session = Metric(name="Command/Session", type=DataType.STRING, value=said)
        await host.command("pump", command(PERCENT, 50.0))
        await answered(host, "pump", "done")
        await host.command("pump", command(START, value=True, more=[session]))
        await host.until(lambda: runs(host.served.control, "pump"))
        assert host.served.core.leases.holder_of("pump", now=time.monotonic()) is not None
        await host.host(online=False, time_ms=now_ms + offline_ms)
        await host.until(lambda: not runs(host.served.control, "pump"))
        assert host.served.core.leases.holder_of("pump", now=time.monotonic()) is None


@awaited
async def test_start_without_a_primary_host_is_refused(tmp_path):
    async with commanded(tmp_path) as host:
        said = host.of("NBIRTH")[0].metric("Properties/Session").string_value
        session = Metric(name="Command/Session", type=DataType.STRING, value=said)
        await host.command("pump", command(START, value=True, more=[session]))
        await answered(host, "pump", "refused", "write host = in [[door]]")
        assert not runs(host.served.control, "pump")


@pytest.mark.soak
@awaited
async def test_stop_cancels_earlier_starts(tmp_path):
    async with commanded(tmp_path, host="scada") as host:
        said = host.of("NBIRTH")[0].metric("Properties/Session").string_value
        session = Metric(name="Command/Session", type=DataType.STRING, value=said)
        await asyncio.gather(
            *(host.command("pump", command(START, value=True, more=[session], uuid=str(each))) for each in range(20))
        )
        await host.command("pump", command("Command/Stop", value=True))
        await host.until(lambda: host.audit.stops)
        await asyncio.sleep(1.0)
        assert not runs(host.served.control, "pump")
        assert host.served.core.leases.holder_of("pump", now=time.monotonic()) is None


@pytest.mark.soak
@awaited
async def test_flood_of_garbage_and_commands_does_not_block_a_stop(tmp_path):
    async with commanded(tmp_path) as host:
        sending = time.monotonic()
        for number in range(500):
            await host.command("pump", bytes([number % 256]) * 50)
            await host.command("fan", command(PERCENT, float(number), uuid=str(number)))
        began = time.monotonic()
        await host.command("pump", command("Command/Stop", value=True))
        await host.until(lambda: host.audit.stops)
        assert time.monotonic() - began < 5
        # Refusals are recorded, but a flood of them must not fill the disk.
        assert 5 < len(refusals(host)) < 40 * (time.monotonic() - sending + 2)
        await host.until(lambda: host.value("pump", "Answer/Command") == "stop")


@pytest.mark.soak
@awaited
async def test_flood_of_stops_leaves_no_stop_pending(tmp_path):
    async with commanded(tmp_path) as host:
        for number in range(200):
            await host.command("pump", command("Command/Stop", value=True, uuid=str(number)))
        await host.until(lambda: "pump" in dict(host.audit.stops))
        await asyncio.sleep(1.0)
        assert 1 <= len(host.audit.stops) <= 200
        assert not host.served.core.changing


@awaited
async def test_standing_stop_is_a_metric_and_a_stop_command_does_not_stand(tmp_path):
    async with commanded(tmp_path) as host:
        assert host.value("pump", "Status/Standing Stop") == ""
        await host.command("pump", command("Command/Stop", value=True))
        await answered(host, "pump", "done")
        assert host.value("pump", "Status/Standing Stop") == ""
        release = host.served.plant.hold_stop(OPERATOR, "pump", "ramp")
        said = "stop (ramp) demanded by otto (http 127.0.0.1:1)"
        await host.until(lambda: host.value("pump", "Status/Standing Stop") == said)
        release()
        await host.until(lambda: host.value("pump", "Status/Standing Stop") == "")


@awaited
async def test_drift_of_a_drive_is_a_metric(tmp_path):
    async with commanded(tmp_path) as host:
        host.served.core.drift["pump"] = DriveDrift(state="as approved")
        await host.until(lambda: host.value("pump", "Status/Drift") == "set as approved")


@awaited
async def test_command_metric_with_value_false_is_ignored(tmp_path):
    async with commanded(tmp_path) as host:
        await host.command("pump", command("Command/Stop", value=False))
        await host.command("pump", command("Command/Reset", value=False))
        await host.command("pump", command(PERCENT, 40.0))
        await answered(host, "pump", "done")
        assert not host.audit.stops
        assert not refusals(host)


@awaited
async def test_only_stops_are_carried_out_without_a_session(tmp_path):
    with mosquitto(tmp_path / "broker") as broker:
        async with listening(broker.port) as host:
            await host.host(online=False)
            async with gateway(tmp_path, door_of(broker.url, host="scada"), journal=False) as served:
                await host.until(served.opened.is_set)
                host.audit = served.core.audit
                await host.command("pump", command(PERCENT, 40.0))
                await host.until(lambda: refusals(host))
                assert "has no session" in refusals(host)[0][2]
                await host.command("pump", command("Command/Stop", value=True))
                await host.until(lambda: host.audit.stops)
                assert not host.audit.asked_for
                assert not host.of("NBIRTH")
