"""Whether a start from a network is looser on link loss than the plant file, and that such a one is refused."""

from dataclasses import replace

import pytest
from served_core import ENGINEER, OPERATOR, asked, awaited, core_of, runs

from drivecomm.errors import NotAllowedError, ValueRefusedError
from drivecomm.protocol import DriveConfig, LinkLossPolicy, NetworkAccess
from drivecomm.server.door import Command
from drivecomm.server.keep_orders import why_looser
from drivecomm.server.rights import Rights

RAMP = LinkLossPolicy(policy="ramp", watchdog_s=2)
HOLD = LinkLossPolicy(policy="hold")


@pytest.mark.parametrize(
    ("said", "policy", "watchdog_s", "looser"),
    [
        # What the start leaves to the plant file is never looser.
        (RAMP, None, None, ""),
        (HOLD, None, None, ""),
        (None, None, None, ""),
        # The same policy, with a watchdog that waits as long, shorter, longer.
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
        # Whether it is safer to coast or to trip, only the plant file can say.
        (RAMP, "coast", 1, "the policy 'coast' instead of ramp"),
        (RAMP, "trip", 2, "the policy 'trip' instead of ramp"),
        (RAMP, "HOLD", None, "the policy 'HOLD' instead of ramp"),
        # Nothing is looser than hold.
        (HOLD, "hold", None, ""),
        (HOLD, "ramp", 600, ""),
        (HOLD, "trip", 5, ""),
        # Without link_loss a start may only choose to be stopped, within the usual time.
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
def test_watchdog_time_that_is_no_number_is_refused(watchdog_s):
    with pytest.raises(ValueRefusedError, match="is no number"):
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
async def test_looser_start_of_a_network_caller_moves_nothing(tmp_path, verb, arguments):
    async with core_of(tmp_path) as (core, control):
        answer = await asked(core, OPERATOR, "pump", verb, arguments=arguments)
        assert (answer.outcome, type(answer.error)) == ("refused", NotAllowedError)
        assert not runs(control, "pump")
        # The server's own user decides anew.
        answer = await asked(core, ENGINEER, "pump", "keep", arguments={"policy": "hold"})
        assert answer.outcome == "done", answer.error
        assert runs(control, "pump")
