"""A line with mostly dead drives: the rate of the live ones, and the time until a returned drive is used again.

All with the default line facts of each protocol, in virtual time. Every drive is polled in a loop that ignores the
health of drives; refusing a call to a dead drive takes no time on the line.
"""

from dataclasses import dataclass

import pytest
from benches import PROTOCOLS, Mortal
from extents import some

import drivecomm
from drivecomm.errors import NoReplyError
from drivecomm.protocol import installed
from drivecomm.virtual import VirtualLine

DRIVES = 31
LIVE = 3
FIRST_MINUTE_S = 60.0
LEAST_SHARE = 0.95

RETURN_S = {
    "vabus": 10.0,
    "danfoss-fc": 10.0,
    "fuji": 22.0,
    "vlt3500": 25.0,
    "modbus": 22.0,
    "uss": 60.0,
    "huanyang": 60.0,
    "mitsubishi": 22.0,
    "hitachi": 60.0,
    "ls-bus": 60.0,
    "toshiba": 60.0,
}
"""Longest time in seconds until a returned drive is used again, with 28 dead drives on the line.

At 9600 baud a probe and its reply take some 50 ms on the wire for fuji and vlt3500. To probe 28 dead drives once in ten
seconds takes more than the 5 % of the line that dead drives may use, so the limit is longer there; with half as many
dead drives it is twelve seconds. Each probe of USS follows a telegram that no drive answers, and its pause.
"""
MANY, FEW = 28, 14
RETURNING = 3


def addresses(protocol):
    """Return the first 31 addresses of a protocol; VABus has only 30."""
    return list(installed[protocol].addresses)[:DRIVES]


class Site:
    """A line with drives of one protocol, some of them dead, and objects for all configured drives.

    Dead drives that will return are on the line but mute; the other dead drives are missing.
    """

    def __init__(self, protocol, *, dead, returning=0):
        places = addresses(protocol)[: LIVE + dead]
        # The live drives are spread over the addresses.
        self.live = [places[index * (len(places) - 1) // (LIVE - 1)] for index in range(LIVE)]
        self.dead = [address for address in places if address not in self.live]
        self.returning = self.dead[:: max(1, len(self.dead) // max(1, returning))][:returning]
        self.virtual = {address: Mortal(protocol, address) for address in sorted([*self.live, *self.returning])}
        for address in self.returning:
            self.virtual[address].alive = False
        self.line = VirtualLine(self.virtual.values())
        self.bus = drivecomm.open_bus(self.line.port)
        self.drives = {
            address: self.bus.drive(protocol, address, model=installed[protocol].default_model) for address in places
        }

    def ask(self, address):
        """Read the status of one drive; return whether it answered."""
        try:
            self.drives[address].status()
        except NoReplyError:
            return False
        return True

    def round(self):
        """Read the status of all drives; return the number of answers."""
        return sum([self.ask(address) for address in self.drives])

    def rate(self, seconds):
        """Poll all drives for this time in seconds; return the answers per second."""
        began, answers = self.line.time, 0
        while self.line.time < began + seconds:
            answers += self.round()
        return answers / (self.line.time - began)

    def probes(self):
        """Return the number of probes of each dead drive."""
        return [self.bus.counters[self.drives[address].name]["probes"] for address in self.dead]

    def time_to_return(self, address):
        """Revive a drive and poll all drives until it answers; return the time in seconds, infinite after a minute."""
        began = self.line.time
        self.virtual[address].alive = True
        while not self.ask(address):
            self.round()
            if self.line.time > began + 60:
                return float("inf")
        return self.line.time - began


@dataclass
class Story:
    """Results of a site: rates in answers per second, probes of each dead drive in 30 s, times to return in seconds."""

    dead: int
    alone: float
    first_minute: float
    afterwards: float
    probes: list
    returns: list
    trouble: int


def tell(protocol, dead):
    alone = Site(protocol, dead=0)
    alone.rate(2.0)
    site = Site(protocol, dead=dead, returning=RETURNING)
    first_minute = site.rate(FIRST_MINUTE_S)
    before = site.probes()
    trouble = [site.bus.counters[site.drives[address].name] for address in site.live]
    story = Story(
        dead=len(site.dead),
        alone=alone.rate(5.0),
        first_minute=first_minute,
        afterwards=site.rate(30.0),
        probes=[after - then for then, after in zip(before, site.probes(), strict=True)],
        returns=[],
        trouble=sum(counters["timeouts"] + counters["retries"] + counters["damaged"] for counters in trouble),
    )
    for address in site.returning:
        # Each drive returns at another moment of its pause, long after the previous one.
        story.returns.append(site.time_to_return(address))
        site.virtual[address].alive = False
        site.rate(10.7)
    return story


# The quick tests take the protocols that return slowest and quickest.
EACH = [pytest.param(name, marks=[] if name in {"vabus", "vlt3500"} else [pytest.mark.soak]) for name in PROTOCOLS]


@pytest.fixture(scope="module", params=EACH)
def protocol(request):
    return request.param


@pytest.fixture(scope="module")
def story(protocol):
    return tell(protocol, MANY)


def test_live_drives_get_95_percent_of_the_line(story, protocol):
    """With 28 of 31 drives dead, the rate after the first minute is at least 95 % of the rate without them."""
    assert story.dead == min(MANY, len(addresses(protocol)) - LIVE)
    assert LEAST_SHARE <= story.afterwards / story.alone <= 1.0
    assert story.trouble == 0


def test_first_minute_spends_at_most_two_calls_on_each_dead_drive(story, protocol):
    timing = installed[protocol].facts.timing
    # A drive is given up after two calls if a call takes less than a second, otherwise after one.
    call = timing.attempts * (timing.reply_timeout_s + 0.05)
    calls = story.dead * call * (1 if call > 1 else 2)
    assert story.first_minute >= LEAST_SHARE * story.alone * (FIRST_MINUTE_S - calls) / FIRST_MINUTE_S
    assert story.first_minute < story.afterwards


def test_every_dead_drive_is_probed_repeatedly(story):
    assert min(story.probes) >= 1
    assert max(story.probes) <= 3 * min(story.probes)


def test_returning_drive_is_used_again_within_its_limit(story, protocol):
    """The limit is 10 s; it is longer with long telegrams at 9600 baud (see RETURN_S)."""
    assert len(story.returns) == RETURNING
    assert max(story.returns) <= RETURN_S[protocol], [f"{each:.1f} s" for each in story.returns]


@pytest.mark.soak
@pytest.mark.parametrize("slow", some(3, [name for name, limit in RETURN_S.items() if limit > 10]))
def test_returning_drive_is_used_within_12_s_among_14_dead_ones(slow):
    story = tell(slow, FEW)
    assert story.afterwards >= LEAST_SHARE * story.alone
    assert max(story.returns) <= 12.0, [f"{each:.1f} s" for each in story.returns]


@pytest.mark.soak
def test_drives_that_return_together_are_used_as_soon_as_a_single_one(protocol):
    """This happens to all drives of a cabinet whose mains is switched on again."""
    site = Site(protocol, dead=MANY, returning=MANY)
    site.rate(35.0)
    for drive in site.virtual.values():
        drive.alive = True
    began = site.line.time
    while (used := site.round()) < len(site.drives):
        took = site.line.time - began
        # With all drives alive, a round itself takes more than a second.
        assert took <= RETURN_S[protocol] + 1.5, f"{used} of {len(site.drives)} are used after {took:.0f} s"
