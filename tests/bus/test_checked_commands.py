"""Commands with a check of the caller that runs again when their turn on the line has come."""

import asyncio
from types import SimpleNamespace

import pytest
from benches import Mortal, Recorder

import drivecomm
from drivecomm.bus import DriveVerbs, Sent, open_bus_async
from drivecomm.errors import LeaseError, UsageError
from drivecomm.line import Rank
from drivecomm.virtual import VirtualLine


class Looker:
    """A check that counts its calls, and raises from call number `raises_from` on."""

    def __init__(self, raises_from=None):
        self.asked = 0
        self.raises_from = raises_from

    def __call__(self):
        self.asked += 1
        if self.raises_from is not None and self.asked >= self.raises_from:
            raise LeaseError("it is over")


def commanded(recorder):
    return [event for event in recorder.events if event.what == "sent" and event.message.control_word & 0x0400]


@pytest.mark.parametrize("traced", [False, True])
def test_failing_check_prevents_the_command(traced):
    line = VirtualLine([Mortal("danfoss-fc", 1)])
    with drivecomm.open_bus(line.port, trace=Recorder() if traced else None) as bus:
        fan = bus.drive("danfoss-fc", 1, model="fc300")
        fan.set_reference(percent=50)
        for verb in (fan.checked(Looker(1)).start, lambda: fan.checked(Looker(1)).write("3-41", 5)):
            with pytest.raises(LeaseError):
                verb()
        assert not fan.status().running
        fan.start()
        line.advance(5)
        assert fan.status().running


def test_check_runs_before_each_telegram_until_one_that_acts_is_sent():
    recorder = Recorder()
    line = VirtualLine([Mortal("danfoss-fc", 1)])
    with drivecomm.open_bus(line.port, trace=recorder) as bus:
        fan = bus.drive("danfoss-fc", 1, model="fc300")
        looker = Looker(2)
        # The drive is read first, and commanded then.
        with pytest.raises(LeaseError):
            fan.checked(looker).set_reference(percent=50)
        assert looker.asked == 2
        assert commanded(recorder) == []


def test_retries_of_a_sent_command_are_not_checked_again():
    line = VirtualLine([Mortal("danfoss-fc", 1)])
    with drivecomm.open_bus(line.port) as bus:
        fan = bus.drive("danfoss-fc", 1, model="fc300")
        fan.set_reference(percent=0)
        line.drives[0].hear, hear = (lambda *_: None), line.drives[0].hear
        looker = Looker(2)
        with pytest.raises(drivecomm.errors.NoReplyError):
            fan.checked(looker).write("3-41", 5)
        assert looker.asked == 1, "it was repeated without being looked at"
        line.drives[0].hear = hear


def test_reads_and_stops_are_not_checked():
    line = VirtualLine([Mortal("danfoss-fc", 1)])
    with drivecomm.open_bus(line.port) as bus:
        fan = bus.drive("danfoss-fc", 1, model="fc300").checked(Looker(1))
        fan.status()
        fan.stop()


def test_failing_check_prevents_a_broadcast():
    line = VirtualLine([Mortal("danfoss-fc", 1)])
    with drivecomm.open_bus(line.port) as bus:
        everybody = bus.broadcast("danfoss-fc", model="fc300", broadcast_parameters=True)
        with pytest.raises(LeaseError):
            everybody.checked(Looker(1)).write("3-41", 5)


def test_checked_refuses_a_drive_on_a_line_of_a_server():
    class FromAfar(DriveVerbs, Sent):
        pass

    with pytest.raises(UsageError, match="on a line of a server"):
        FromAfar(None, SimpleNamespace(name="vabus:1"), None, None).checked(Looker())


def test_check_runs_when_the_turn_of_the_command_has_come():
    async def program():
        line = VirtualLine([Mortal("danfoss-fc", 1)])
        async with open_bus_async(line.port) as bus:
            fan = bus.drive("danfoss-fc", 1, model="fc300")
            over = False

            def check():
                if over:
                    raise LeaseError("it is over")

            turn = await asyncio.create_task(bus.line.taken(Rank.STOP))
            starting = asyncio.create_task(fan.checked(check).start())
            await asyncio.sleep(0)
            over = True
            bus.line.turns.give_back(turn)
            with pytest.raises(LeaseError):
                await starting
            assert not (await fan.status()).running

    asyncio.run(program())
