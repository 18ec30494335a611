"""A stop of a drive that does not answer holds up nobody: not the stop of one that runs, nor what is read meanwhile."""

import asyncio
from contextlib import asynccontextmanager
from functools import wraps

import pytest
from benches import Mortal, Recorder

from drivecomm.bus import open_bus_async
from drivecomm.errors import NoReplyError, OvertakenError
from drivecomm.protocol import Stop
from drivecomm.virtual import VirtualLine
from drivecomm_vabus.telegrams import Select

LIVES = 9
DEAD = range(1, 6)


class Deaf(Mortal):
    """A drive that does not hear the next telegram, and then all others."""

    def __init__(self, *made_of):
        super().__init__(*made_of)
        self.misses = 0

    def hear(self, find, now):
        if self.misses:
            self.misses -= 1
            return None
        return super().hear(find, now)


class Hall:
    """A line with dead drives and one that lives, and what was sent to whom."""

    def __init__(self, bus, virtual, sent):
        self.bus, self.virtual, self._sent = bus, virtual, sent
        self.drives = {address: bus.drive("vabus", address, model="agile") for address in (*DEAD, LIVES)}

    def asked(self, since=0):
        """Return the addresses in the order in which they were spoken to, each once in a row."""
        all_of_them = [int(event.drive.partition(":")[2]) for event in self._sent.sent()[since:]]
        return [each for place, each in enumerate(all_of_them) if place == 0 or all_of_them[place - 1] != each]

    @property
    def number(self):
        """How many telegrams were sent."""
        return len(self._sent.sent())

    async def until_sent(self, number):
        while self.number < number:  # noqa: ASYNC110 - time passes by itself here
            await asyncio.sleep(0)


@asynccontextmanager
async def hall(*, known_silent=True):
    virtual, sent = Deaf("vabus", LIVES), Recorder()
    async with open_bus_async(VirtualLine([virtual]).port, trace=sent) as bus:
        here = Hall(bus, virtual, sent)
        await here.drives[LIVES].status()
        for address in DEAD if known_silent else ():
            with pytest.raises(NoReplyError):
                await here.drives[address].read("481")
        yield here


def awaited(test):
    @wraps(test)
    def run(*values, **options):
        asyncio.run(test(*values, **options))

    return run


@awaited
async def test_a_running_drive_is_stopped_before_those_that_are_silent():
    async with hall() as here:
        before = here.number
        stops = [asyncio.create_task(here.drives[address].stop()) for address in (*DEAD, LIVES)]
        ended = await asyncio.gather(*stops, return_exceptions=True)
        assert here.asked(before)[:3] == [1, LIVES, 2]
        assert [type(each) for each in ended] == [NoReplyError] * len(DEAD) + [type(None)]


@awaited
async def test_those_that_are_silent_have_their_attempts_one_after_the_other():
    async with hall() as here:
        before = here.number
        stops = [asyncio.create_task(here.drives[address].stop()) for address in DEAD]
        await asyncio.gather(*stops, return_exceptions=True)
        assert here.asked(before) == [*DEAD] * 3


@awaited
async def test_a_stop_waits_for_one_attempt_of_another_also_where_nobody_knew_that_it_is_silent():
    async with hall(known_silent=False) as here:
        before = here.number
        first = asyncio.create_task(here.drives[1].stop())
        await here.until_sent(before + 1)
        await here.drives[LIVES].stop()
        with pytest.raises(NoReplyError):
            await first
        assert here.asked(before) == [1, LIVES, 1]


@awaited
async def test_one_lost_telegram_makes_no_ramp_a_coasting_because_another_stop_waits():
    async with hall() as here:
        here.virtual.misses, before = 1, here.number
        first = asyncio.create_task(here.drives[LIVES].stop(Stop.RAMP))
        second = asyncio.create_task(here.drives[1].stop())
        with pytest.raises(NoReplyError):
            await second
        await first
        assert here.asked(before)[0] == LIVES
        told = [each for _, each in here.virtual.heard if isinstance(each, Select) and each.address == LIVES]
        assert {each.data for each in told} == {"0007"}
        assert here.virtual.misses == 0


@awaited
async def test_readings_go_between_the_attempts_of_one_that_was_silent():
    async with hall() as here:
        before = here.number
        stop = asyncio.create_task(here.drives[1].stop())
        await here.until_sent(before + 1)
        await here.drives[LIVES].status()
        assert not stop.done()
        with pytest.raises(NoReplyError):
            await stop
        assert here.asked(before) == [1, LIVES, 1]


@awaited
async def test_a_later_stop_of_the_same_drive_goes_on_instead():
    """Otherwise the first one could follow the second, and stop the motor another way."""
    async with hall() as here:
        before = here.number
        first = asyncio.create_task(here.drives[1].stop(Stop.COAST))
        await here.until_sent(before + 1)
        second = asyncio.create_task(here.drives[1].stop(Stop.QUICK))
        with pytest.raises(OvertakenError, match="a later one"):
            await first
        with pytest.raises(NoReplyError):
            await second


@awaited
async def test_alone_on_the_line_it_is_asked_as_often_as_any_other():
    async with hall() as here:
        before = here.number
        with pytest.raises(NoReplyError):
            await here.drives[1].stop()
        # Three times who is in charge, and then the word that stops it whoever that is.
        assert here.number == before + 4
