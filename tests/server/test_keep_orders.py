"""A start from the network that is looser on link loss than the plant file is recognised and refused."""

import time
from dataclasses import replace

import pytest
from served_core import ENGINEER, OPERATOR, PLANT, asked, awaited, core_of, runs, until

from drivecomm.errors import LeaseError, NotAllowedError, UsageError, ValueRefusedError
from drivecomm.protocol import DriveConfig, LinkLossPolicy, NetworkAccess, Stop
from drivecomm.server.callers import Role
from drivecomm.server.door import Command
from drivecomm.server.keep_orders import why_looser
from drivecomm.server.rights import Rights

RAMP = LinkLossPolicy(policy="ramp", watchdog_s=2)
HOLD = LinkLossPolicy(policy="hold")


@pytest.mark.parametrize(
    ("said", "policy", "watchdog_s", "looser"),
    [
        # Settings that the start omits are never looser.
        (RAMP, None, None, ""),
        (HOLD, None, None, ""),
        (None, None, None, ""),
        # The same policy with an equal, shorter, or longer watchdog time.
        (RAMP, "ramp", None, ""),
        (RAMP, "ramp", 2, ""),
        (RAMP, "ramp", "1.5", ""),
        (RAMP, None, 1, ""),
        (RAMP, "ramp", 2.01, "a watchdog time of 2.01 s, where 2 s is the longest"),
        (RAMP, None, 600, "a watchdog time of 600 s, where 2 s is the longest"),
        (RAMP, "ramp", "600", "a watchdog time of 600 s, where 2 s is the longest"),
        # hold switches the watchdog off.
        (RAMP, "hold", None, "the policy 'hold' instead of ramp"),
        (RAMP, "hold", 1, "the policy 'hold' instead of ramp"),
        # Only the plant file can decide whether coast or trip is the safer policy.
        (RAMP, "coast", 1, "the policy 'coast' instead of ramp"),
        (RAMP, "trip", 2, "the policy 'trip' instead of ramp"),
        (RAMP, "HOLD", None, "the policy 'HOLD' instead of ramp"),
        # No policy is looser than hold.
        (HOLD, "hold", None, ""),
        (HOLD, "ramp", 600, ""),
        (HOLD, "trip", 5, ""),
        # Without link_loss a start may only choose a policy that stops the motor, within the default time.
        (None, "ramp", None, ""),
        (None, "coast", 5, ""),
        (None, "trip", 5.5, "a watchdog time of 5.5 s, where 5 s is the longest"),
        (None, "hold", None, "the policy hold, which link_loss does not name"),
        (None, None, 600, ""),
    ],
)
def test_start_is_looser_than_the_plant_file_by_policy_and_time(said, policy, watchdog_s, looser):
    assert why_looser(policy, watchdog_s, said) == looser


@pytest.mark.parametrize("watchdog_s", ["soon", float("nan"), float("inf"), True, []])
def test_watchdog_time_that_is_not_a_number_is_refused(watchdog_s):
    with pytest.raises(ValueRefusedError, match="is not a number"):
        why_looser("ramp", watchdog_s, RAMP)


FAN = DriveConfig(
    protocol="danfoss-fc",
    address=3,
    name="fan",
    armed=True,
    link_loss=RAMP,
    network=NetworkAccess(verbs=dict.fromkeys(("http", "mqtt", "opcua", "modbus-tcp"), ("start", "reverse"))),
)


@pytest.mark.parametrize("verb", ["start", "keep", "reverse"])
@pytest.mark.parametrize("door", ["http", "mqtt", "opcua", "modbus-tcp"])
def test_looser_start_is_refused_at_every_door_but_the_local_one(door, verb):
    rights = Rights("plant.toml")
    looser = Command(drive="fan", verb=verb, arguments={"policy": "hold"})
    caller = replace(OPERATOR, door=f"{door} 127.0.0.1:1")
    with pytest.raises(NotAllowedError) as refused:
        rights.check(caller, looser, FAN)
    assert str(refused.value) == (
        f"{verb} of fan over {door} asks for the policy 'hold' instead of ramp; plant.toml allows policy = \"ramp\" "
        "within 2 s or less"
    )
    with pytest.raises(NotAllowedError, match=r"plant.toml has no link_loss for it, which allows trip, ramp or coast"):
        rights.check(caller, looser, replace(FAN, link_loss=None))
    rights.check(caller, replace(looser, arguments={"watchdog_s": 1}), FAN)
    rights.check(ENGINEER, looser, FAN)


@pytest.mark.parametrize("arguments", [{"policy": "hold"}, {"watchdog_s": 600}, {"policy": "coast"}])
@pytest.mark.parametrize("verb", ["start", "keep"])
@awaited
async def test_looser_start_of_a_network_caller_moves_no_motor(tmp_path, verb, arguments):
    async with core_of(tmp_path) as (core, control):
        answer = await asked(core, OPERATOR, "pump", verb, arguments=arguments)
        assert (answer.outcome, type(answer.error)) == ("refused", NotAllowedError)
        assert not runs(control, "pump")
        # A local caller may choose a looser policy.
        answer = await asked(core, ENGINEER, "pump", "keep", arguments={"policy": "hold"})
        assert answer.outcome == "done", answer.error
        assert runs(control, "pump")


MOVED = PLANT.replace(
    'link_loss = { policy = "coast", watchdog_s = 2 }',
    'link_loss = { policy = "ramp", watchdog_s = 2 }\n'
    'network = { http = ["jog", "start", "reference"], write = ["jog", "control_word", "3-41"] }',
).replace('write = ["480"]', 'write = ["480", "410", "413", "413[1]", "watchdog_time"]')
OLGA = replace(OPERATOR, role=Role.COMMISSION)


def leased(core, drive):
    return core.leases.take(OLGA, drive, 5, now=time.monotonic(), time_s=time.time()).key


@awaited
async def test_jog_from_a_network_is_kept_and_ends_with_its_lease(tmp_path):
    async with core_of(tmp_path, MOVED) as (core, control):
        answer = await asked(core, OLGA, "fan", "jog")
        assert (answer.outcome, type(answer.error)) == ("refused", LeaseError)
        assert not runs(control, "fan")
        answer = await asked(core, OLGA, "fan", "jog", arguments={"policy": "hold"})
        assert (answer.outcome, type(answer.error)) == ("refused", NotAllowedError)
        key = leased(core, "fan")
        answer = await asked(core, OLGA, "fan", "jog", lease=key, arguments={"number": 1})
        assert (answer.outcome, answer.result["policy"]) == ("done", "ramp"), answer.error
        assert runs(control, "fan")
        assert core.kept.policy("fan") == "ramp"
        core.kept.lapsed(core.leases.end(OLGA, "fan", key, now=time.monotonic()))
        await until(lambda: not runs(control, "fan"))


@pytest.mark.parametrize(
    ("drive", "verb", "arguments"),
    [
        ("fan", "call", {"verb": "jog"}),
        ("fan", "call", {"verb": "control_word", "word": 0x047C}),
        ("pump", "write", {"parameter": "410", "value": 15}),
        ("pump", "write_and_read", {"parameter": "410", "value": 15}),
    ],
)
@awaited
async def test_call_or_write_from_a_network_starts_no_motor(tmp_path, drive, verb, arguments):
    async with core_of(tmp_path, MOVED) as (core, control):
        answer = await asked(core, OLGA, drive, verb, lease=leased(core, drive), arguments=arguments)
        assert (answer.outcome, type(answer.error)) == ("refused", NotAllowedError)
        assert "over a network start or jog does, which the server keeps in hand" in str(answer.error)
        assert not runs(control, drive)


@awaited
async def test_write_from_a_network_that_starts_no_motor_is_sent(tmp_path):
    async with core_of(tmp_path, MOVED) as (core, _):
        assert (await asked(core, OLGA, "fan", "write", arguments={"parameter": "3-41", "value": 5})).outcome == "done"
        answer = await asked(core, OLGA, "fan", "call", arguments={"verb": "control_word", "word": 0x043C})
        assert answer.outcome == "done", answer.error


@awaited
async def test_local_caller_may_keep_a_motor_started_by_another_verb(tmp_path):
    by = {"verb": "call", "arguments": {"verb": "jog"}}
    async with core_of(tmp_path, MOVED) as (core, control):
        answer = await asked(core, OLGA, "fan", "keep", lease=leased(core, "fan"), arguments={"by": by})
        assert (answer.outcome, type(answer.error)) == ("refused", NotAllowedError)
        core.leases.forget("fan")
        answer = await asked(core, ENGINEER, "fan", "keep", arguments={"by": {"verb": "stop"}, "policy": "hold"})
        assert (answer.outcome, type(answer.error)) == ("refused", UsageError)
        assert not runs(control, "fan")
        answer = await asked(core, ENGINEER, "fan", "keep", arguments={"by": by, "policy": "hold"})
        assert answer.outcome == "done", answer.error
        assert runs(control, "fan")


@pytest.mark.parametrize("arguments", [{"percent": -5}, {"hz": "-5"}, {"percent": -0.1}])
@pytest.mark.parametrize("verb", ["set_reference", "keep"])
def test_negative_reference_from_a_network_needs_the_word_reverse(verb, arguments):
    forwards = replace(FAN, network=NetworkAccess(verbs={"http": ("start", "reference")}))
    with pytest.raises(NotAllowedError, match="add 'reverse' to network"):
        Rights().check(OPERATOR, Command(drive="fan", verb=verb, arguments=arguments), forwards)
    both = replace(FAN, network=NetworkAccess(verbs={"http": ("start", "reference", "reverse")}))
    Rights().check(OPERATOR, Command(drive="fan", verb=verb, arguments=arguments), both)
    Rights().check(OPERATOR, Command(drive="fan", verb=verb, arguments={"percent": -0.0}), forwards)


@pytest.mark.parametrize("parameter", ["413", "413[1]", "watchdog_time"])
@awaited
async def test_watchdog_of_a_drive_is_not_written_from_a_network(tmp_path, parameter):
    async with core_of(tmp_path, MOVED) as (core, _):
        order = {"parameter": parameter, "value": 0}
        answer = await asked(core, OLGA, "pump", "write", arguments=order)
        assert (answer.outcome, type(answer.error)) == ("refused", NotAllowedError)
        assert "belongs to its watchdog" in str(answer.error)


@pytest.mark.parametrize(
    ("drive", "verb", "arguments"),
    [
        ("pump", "write", {"parameter": "410", "value": 15}),
        ("fan", "call", {"verb": "control_word", "word": 0x047C}),
        ("fan", "jog", {}),
    ],
)
@awaited
async def test_demanded_stop_refuses_every_command_that_may_start_a_motor(tmp_path, drive, verb, arguments):
    async with core_of(tmp_path, MOVED) as (core, control):
        release = core.stop_demands.hold(drive, Stop.RAMP, "plc")
        answer = await asked(core, ENGINEER, drive, verb, arguments=arguments)
        assert answer.outcome == "refused", answer
        assert not runs(control, drive)
        release()
