"""A kept motor whose drive is silent: it is stopped when it answers, and other drives of its line are still served."""

import asyncio
import time

import pytest
from served_core import OPERATOR, awaited, core_of, runs, until

from drivecomm.protocol import Stop
from drivecomm.server import CommandRequest
from drivecomm.server.commands import CommandExecutor

PLANT = """\
format = 1
[[line]]
name = "yard"
listen = "tcp:127.0.0.1:0"
paced = false
"""
DRIVE = """\
[[drive]]
name = "{name}"
drive = "danfoss-fc:{address}"
line = "yard"
armed = true
options = {{ model = "fc302", reply_timeout_s = 0.1 }}
link_loss = {{ policy = "ramp", watchdog_s = 60 }}
network = {{ http = ["start", "reference"] }}
"""
FAN = PLANT + DRIVE.format(name="fan", address=3)


async def keep(core, drive):
    """Keep a motor running, and return its lease."""
    lease = core.leases.take(OPERATOR, drive, 30, now=time.monotonic(), time_s=time.time())
    command = CommandRequest(drive=drive, verb="keep", lease=lease.key, arguments={"percent": 50}, valid_s=10)
    answer = await CommandExecutor(core).carry_out(OPERATOR, command)
    assert answer.outcome == "done", answer.error
    return lease


def stops_sent(core):
    """Return a growing list of the telegrams sent at the rank of a stop, by drive."""
    sent, link = [], core.lines["yard"].bus._roster.link
    stop = link.stop

    def noted(peer, *values, **options):
        sent.append(peer.name)
        return stop(peer, *values, **options)

    link.stop = noted
    return sent


@pytest.mark.soak
@awaited
async def test_stop_of_a_silent_kept_motor_is_sent_once_and_again_when_it_answers(tmp_path):
    async with core_of(tmp_path, FAN) as (core, control):
        await until(lambda: core.drive("fan").reachability == "answers")
        lease = await keep(core, "fan")
        sent = stops_sent(core)
        now_s = max(line["time_s"] for line in control.order("show")["lines"])
        text = f'line = "yard"\nkind = "drop"\nof = "request"\nfrom_s = {now_s}\nuntil_s = {now_s + 0.8}'
        control.order("fault", text=text)
        core.kept.given_back(core.leases.end(OPERATOR, "fan", lease.key, now=time.monotonic()))
        await asyncio.sleep(0.6)
        assert sent == ["danfoss-fc:3"]
        assert runs(control, "fan")
        await until(lambda: "fan" not in core.kept, 6)
        assert len(sent) == 2


@pytest.mark.soak
@awaited
async def test_retries_of_an_earlier_stop_end_with_a_later_stop(tmp_path):
    """A retry of the earlier stop would turn the quick stop of a motor into a ramp."""
    async with core_of(tmp_path, FAN) as (core, control):
        await until(lambda: core.drive("fan").reachability == "answers")
        lease = await keep(core, "fan")
        fan, hows = core.lines["yard"].drive("fan"), []
        operations = fan._exchanges.operations
        stop = operations.stop
        operations.stop = lambda how: hows.append(how) or stop(how)
        control.order("power", drive="fan", state="off")
        core.kept.given_back(core.leases.end(OPERATOR, "fan", lease.key, now=time.monotonic()))
        await until(lambda: any("may be running" in each.text for each in core.table.events()))
        control.order("power", drive="fan", state="on")
        await until(lambda: core.drive("fan").reachability == "answers")
        del hows[:]
        quick = CommandRequest(drive="fan", verb="stop", arguments={"how": "quick"})
        assert (await CommandExecutor(core).carry_out(OPERATOR, quick)).outcome == "done"
        await until(lambda: "fan" not in core.kept)
        assert set(hows) == {Stop.QUICK}
