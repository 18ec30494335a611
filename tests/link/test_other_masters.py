"""Another master on the line: its replies are never accepted as ours, it is noticed, and our traffic continues."""

import logging
from random import Random

import pytest
from extents import LONG

import drivecomm
from drivecomm.errors import DoubtfulReplyError, DriveCommError
from drivecomm.link import CAREFUL_S, SHARED_S
from drivecomm.plant import Fault, FaultPlan
from drivecomm.protocol import installed
from drivecomm.virtual import VirtualLine, virtual_drive

SOAK = pytest.mark.soak
SEEDS = 22 if LONG else 1


def crc16(data):
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = (crc >> 1) ^ 0xA001 if crc & 1 else crc >> 1
    return crc.to_bytes(2, "little")


def modbus(text):
    data = bytes.fromhex(text)
    return data + crc16(data)


class Site:
    """A Modbus drive on a virtual line with a different value in each register, and another master that reads some."""

    def __init__(self, seed=0, *, paced=True, replies_only=False, every_s=0.2, model="delta", **options):
        self.random = Random(seed)
        self.drive_ = virtual_drive("modbus", 1, model=model)
        self.line = VirtualLine([self.drive_], paced=paced)
        self.replies_only = replies_only
        self.every_s = every_s
        self.bus = drivecomm.open_bus(self.line.port, **options)
        self.drive = self.bus.drive("modbus", 1, model=model)

    def other_asks(self):
        """Send a request of the other master now, or only its reply, and repeat that at random times."""
        if self.replies_only:
            self.line.inject(modbus("010302 1E61"))
        else:
            self.line.inject(modbus("0103 2106 0001"))
        self.line.call_at(self.line.time + self.random.uniform(0.5, 1.5) * self.every_s, self.other_asks)

    def with_other(self):
        self.line.call_at(self.random.uniform(0, self.every_s), self.other_asks)
        return self

    def believed(self, number):
        """Read values at random times; return the numbers of wrong good, wrong and good values, and of failures."""
        wrong_good = wrong = good = failed = 0
        right = {}
        for name, raw in (("0x2102", 5000), ("0x2104", 567), ("0x2105", 3210)):
            self.drive_.poke(name, raw)
            right[name] = self.drive_.peek(name, self.line.time)
        for _ in range(number):
            name = self.random.choice(sorted(right))
            self.line.advance(self.random.choice([0.0, 0.0, self.random.uniform(0, 0.1)]))
            try:
                reading = self.drive.read(name)
            except DriveCommError:
                failed += 1
                continue
            good += reading.quality == "good"
            wrong += reading.raw != self.drive_.peek(name, self.line.time)
            wrong_good += reading.raw != self.drive_.peek(name, self.line.time) and reading.quality == "good"
        return wrong_good, wrong, good, failed


@pytest.mark.parametrize("seed", range(5))
def test_replies_to_a_second_master_are_never_accepted_on_a_nameless_line(seed):
    site = Site(seed).with_other()
    wrong_good, wrong, good, failed = site.believed(400)
    assert (wrong_good, wrong) == (0, 0)
    assert good < 40, "the line counts as shared as soon as the other master was heard"
    assert failed < 100, "two that speak at once spoil each other, and what is uncertain is asked up to nine times"


@SOAK
@pytest.mark.parametrize("every_s", [0.2, 1.0])
@pytest.mark.parametrize("paced", [True, False])
def test_replies_to_a_second_master_are_never_accepted_in_thousands_of_reads(every_s, paced):
    read = 0
    for seed in range(SEEDS):
        wrong_good, wrong, _, failed = Site(seed, every_s=every_s, paced=paced).with_other().believed(1000)
        assert (wrong_good, wrong) == (0, 0)
        read += 1000 - failed
    assert read >= 850 * SEEDS


@pytest.mark.parametrize("paced", [True, False])
@pytest.mark.parametrize("seed", range(3))
def test_replies_to_other_clients_of_a_gateway_are_never_good(seed, paced):
    wrong_good, _, good, failed = Site(seed, paced=paced, replies_only=True).with_other().believed(300)
    assert (wrong_good, failed) == (0, 0)
    assert good < 60


@SOAK
@pytest.mark.parametrize("paced", [True, False])
def test_replies_to_other_clients_are_good_only_until_they_are_noticed(paced):
    for seed in range(SEEDS):
        # A reply does not name its client: the first one may be read before foreign traffic was noticed.
        assert Site(seed, paced=paced, replies_only=True).with_other().believed(1000)[0] <= 2


VLT = {"215": 44, "502[1]": 11, "502[2]": 22, "502[3]": 33}


def vlt_readings(seed, number):
    """Read array elements beside a master that reads other elements; the replies do not name the index.

    Return the number of wrong values with good quality, and of failures.
    """
    random = Random(seed)
    virtual = virtual_drive("vlt3500", 1, model="vlt3500")
    for parameter, raw in VLT.items():
        virtual.poke(parameter, raw)
    line = VirtualLine([virtual])
    ask = drivecomm.encode(
        "vlt3500",
        {"kind": "read_index", "address": 1, "control_word": 0, "parameter": 502, "index": [3, 0]},
        direction="request",
    )

    def other_asks():
        line.inject(ask)
        line.call_at(line.time + random.uniform(0.15, 0.6), other_asks)

    line.call_at(random.uniform(0, 0.3), other_asks)
    wrong_good = failed = 0
    with drivecomm.open_bus(line.port) as bus:
        drive = bus.drive("vlt3500", 1, model="vlt3500")
        for _ in range(number):
            parameter = random.choice(["502[1]", "502[2]", "215"])
            line.advance(random.choice([0.0, random.uniform(0, 0.1)]))
            try:
                reading = drive.read(parameter)
            except DriveCommError:
                failed += 1
                continue
            wrong_good += reading.quality == "good" and reading.raw != virtual.peek(parameter, line.time)
    return wrong_good, failed


class TestLine:
    """Another master as seen by the whole line."""

    def test_line_counts_as_shared_after_one_foreign_exchange(self, caplog):
        site = Site()
        site.drive.read("0x2105")
        assert site.bus.other_master == ""
        with caplog.at_level(logging.WARNING, logger="drivecomm"):
            site.line.inject(modbus("0103 2106 0001"))
            site.line.advance(0.2)
            assert site.drive.read("0x2105").quality == "uncertain"
            for _ in range(5):
                site.drive.read("0x2105")
        assert [record.name for record in caplog.records] == ["drivecomm.bus"], "it warns once"
        assert caplog.messages[0].startswith("modbus:1: another master is on this line")
        assert site.bus.other_master.startswith("another master is on this line")
        assert site.drive.read("0x2105").doubt == "another master is on this line, and this may be a reply to it"

    def test_line_counts_as_unshared_after_a_minute_without_foreign_traffic(self):
        site = Site()
        site.line.inject(modbus("0103 2106 0001"))
        site.line.advance(0.2)
        assert site.drive.read("0x2105").quality == "uncertain"
        site.line.advance(SHARED_S)
        assert site.drive.read("0x2105").quality == "good"
        assert site.bus.other_master == ""

    @pytest.mark.parametrize(
        "unasked", [b"\x00", b"\x7f\x00\xff", modbus("0183 02"), modbus("0103 2106 0001")[:-1] + b"\x00"]
    )
    def test_noise_and_damage_do_not_make_a_line_shared(self, unasked):
        site = Site()
        for _ in range(20):
            site.line.inject(unasked)
            site.line.advance(0.3)
            assert site.drive.read("0x2105").quality == "good"
        assert site.bus.other_master == ""

    def test_own_late_and_doubled_replies_do_not_make_a_line_shared(self):
        for kind in (Fault.DELAY, Fault.DUPLICATE, Fault.DROP, Fault.CORRUPT, Fault.TRUNCATE):
            for seed in range(4):
                site = Site()
                site.line.faults = FaultPlan(rate=0.2, seed=seed, kinds=[kind], delay_s=2)
                for number in range(80):
                    site.line.advance(0.01)
                    try:
                        site.drive.read(("0x2105", "0x2104")[number % 2])
                    except DriveCommError:
                        continue
                assert site.bus.other_master == "", (kind, seed)

    def test_own_echo_does_not_make_a_line_shared(self):
        site = Site()
        site.line.echo = True
        for _ in range(10):
            site.drive.read("0x2105")
        assert site.bus.other_master == ""

    def test_master_of_another_drive_is_noticed_and_our_values_stay_good(self):
        site = Site()
        for _ in range(3):
            site.line.inject(modbus("0203 2106 0001"))
            site.line.advance(0.2)
            assert site.drive.read("0x2105").quality == "good"
        assert site.bus.other_master

    def test_drive_whose_replies_name_the_request_stays_good(self):
        virtual = virtual_drive("vabus", 1)
        line = VirtualLine([virtual])
        with drivecomm.open_bus(line.port) as bus:
            drive = bus.drive("vabus", 1, model="agile")
            for _ in range(4):
                line.advance(0.1)
                line.inject(bytes.fromhex("0441303034383105"))
                line.advance(0.2)
                assert drive.read("480").quality == "good"
            assert bus.other_master


@pytest.mark.parametrize("protocol", sorted(installed))
def test_reply_to_a_foreign_request_is_not_accepted(protocol):
    """If the reply to a foreign request could answer our own, our request is repeated."""
    if protocol == "vlt3500":
        assert [vlt_readings(seed, 150)[0] for seed in range(3)] == [0, 0, 0]
        return
    if protocol != "modbus":
        pytest.skip("its replies to reads name what was asked")
    site = Site(paced=False)
    site.drive.read("0x2105")
    site.line.advance(CAREFUL_S)
    right = site.drive_.peek("0x2105", 0.0)
    # The foreign request follows our request before the reply: both get replies, in any order.
    site.line.disturbances.append(Behind(site.line, modbus("0103 2106 0001"), times=1))
    assert site.drive.read("0x2105").raw == right
    assert site.bus.counters["modbus:1"]["doubtful"] == 1


def test_indistinguishable_foreign_requests_raise_doubtful_reply_error():
    site = Site(paced=False)
    site.drive.read("0x2105")
    site.line.disturbances.append(Behind(site.line, modbus("0103 2106 0001"), times=10_000))
    with pytest.raises(DoubtfulReplyError, match="another master asked modbus:1"):
        site.drive.read("0x2105")


def test_two_different_replies_are_both_doubtful():
    site = Site(paced=False)
    right = site.drive.read("0x2105").raw
    site.line.disturbances.append(Beside(modbus("010302 1E61")))
    assert site.drive.read("0x2105").raw == right
    assert site.bus.counters["modbus:1"]["doubtful"] == 1


class Behind:
    """A disturbance that sends a foreign request right after each of the first `times` requests of ours."""

    def __init__(self, line, data, times):
        self._line, self._data, self._times = line, data, times

    def request(self, data, now):
        if self._times:
            self._times -= 1
            self._line.call_at(now, lambda: self._line.inject(self._data))
        return [(0.0, data)]

    def reply(self, data, drive, now):  # noqa: ARG002
        return [(0.0, data)]


class Beside:
    """A disturbance that puts a foreign reply right before the first reply."""

    def __init__(self, data):
        self._data = data

    def request(self, data, now):  # noqa: ARG002
        return [(0.0, data)]

    def reply(self, data, drive, now):  # noqa: ARG002
        before, self._data = self._data, b""
        return [(0.0, before + data)]
