"""Short and long path of an exchange have equal results: outcome, telegrams and times, counters, state of the line.

A traced exchange takes the long path. So the same calls are made on two equal lines, one traced and one not, with the
same mishaps on both: bytes lost, changed, doubled, in pieces, too late, too early, unrequested; a stop that waits in
the middle; Ctrl-C at any call of the port.
"""

from dataclasses import dataclass
from functools import cache, partial

import pytest
from addresses import address_of
from extents import LONG, every_choice, protocol_extents
from hypothesis import HealthCheck, Phase, given, settings, strategies as st

import drivecomm
from drivecomm.errors import DriveCommError
from drivecomm.link import PortProxy
from drivecomm.link.line_state import LineState
from drivecomm.link.other_masters import CAREFUL_S
from drivecomm.models import load_model
from drivecomm.protocol import Stop, installed
from drivecomm.virtual import VirtualLine, virtual_drive

PROTOCOLS = sorted(drivecomm.protocols())
EACH_PROTOCOL = pytest.mark.parametrize("protocol", PROTOCOLS)
READABLE = {
    "vabus": "481",
    "danfoss-fc": "16-13",
    "vlt3500": "215",
    "fuji": "M09",
    "modbus": "16130",
    "uss": "1082",
    "huanyang": "PD005",
    "mitsubishi": "H6F",
    "ei-bisynch": "09",
    "lecom": "C0011",
    "movilink": "8470",
    "hitachi": "A001",
    "ls-bus": "0x0009",
    "ct-ansi": "02.01",
    "toshiba": "0012",
    "weg": "P133",
}
WRITABLE = {
    "vabus": ("480", 7),
    "danfoss-fc": ("3-41", 5),
    "vlt3500": ("215", 6),
    "fuji": ("S05", 20),
    "modbus": ("3410", 5),
    "uss": ("1082", 20),
    "huanyang": ("CFG0", 20),
    "mitsubishi": ("HED", 20),
    "ei-bisynch": ("p9", 20),
    "lecom": ("C0011", 20),
    "movilink": ("8470", 2),
    "hitachi": ("F002", 20),
    "ls-bus": ("0x0007", 20),
    "ct-ansi": ("01.14", 0),
    "toshiba": ("0012", 40),
    "weg": ("P133", 600),
}
MODELS = {"modbus": {"model": "danfoss-fc"}}
"""Options for protocols that cannot command a drive without a model."""
NOISE = b"\x7f\x00"


@dataclass(frozen=True)
class Mishap:
    """Fate of one transmission. place: index of a byte, modulo the length. delay_s: delay of late bytes in seconds."""

    kind: str
    place: int
    delay_s: float

    def arrivals(self, data, before):
        place = self.place % len(data)
        first, rest = data[:place], data[place:]
        match self.kind:
            case "gone":
                return []
            case "late":
                return [(self.delay_s, data)]
            case "cut":
                return [(0.0, first)] if first else []
            case "in pieces":
                return [(0.0, first), (self.delay_s, rest)] if first else [(0.0, rest)]
            case "byte by byte":
                return [(number * self.delay_s, data[number : number + 1]) for number in range(len(data))]
            case "changed":
                return [(0.0, first + bytes([rest[0] ^ 1 << self.place % 7]) + rest[1:])]
            case "twice":
                return [(0.0, data), (self.delay_s, data)]
            case "behind noise":
                return [(0.0, NOISE + data)]
            case "before noise":
                return [(0.0, data + NOISE)]
            case "behind another's":
                return [(0.0, before + data)]
            case "another's":
                return [(0.0, before)] if before else []
        return [(0.0, data)]


KINDS = ["gone", "late", "cut", "in pieces", "byte by byte", "changed", "twice", "behind noise", "before noise",
         "behind another's", "another's"]  # fmt: skip
MISHAPS = st.one_of(
    st.none(),
    st.builds(
        Mishap,
        st.sampled_from(KINDS),
        st.integers(0, 30),
        st.sampled_from([0.0, 0.0005, 0.004, 0.03, 0.2, 0.6, 1.0, 2.5]) | st.floats(0, 3, allow_nan=False),
    ),
)


class Mishaps:
    """A disturbance with a list of mishaps in each direction, and none after them."""

    def __init__(self, requests, replies):
        self._requests = list(requests)
        self._replies = list(replies)
        self._before = b""

    def request(self, data, now):  # noqa: ARG002 - signature of a disturbance
        mishap = self._requests.pop(0) if self._requests else None
        return mishap.arrivals(data, b"") if mishap else [(0.0, data)]

    def reply(self, data, drive, now):  # noqa: ARG002
        mishap = self._replies.pop(0) if self._replies else None
        before, self._before = self._before, data
        return mishap.arrivals(data, before) if mishap else [(0.0, data)]


class WatchedPort(PortProxy):
    """Records the writes and their times; raises KeyboardInterrupt once, before or after call number `left`."""

    def __init__(self, port, line, *, real_time):
        super().__init__(port)
        self.real_time = real_time
        self.written = []
        self.calls = []
        self.left = None
        self.after = False
        self._line = line

    def write(self, data):
        self.written.append((self._line.time, data))
        self._call(super().write, data)

    def read(self, until, at_least):
        return self._call(super().read, until, at_least)

    def wait(self, until):
        self._call(super().wait, until)

    def _call(self, call, *arguments):
        self.calls.append(call.__name__)
        if self.left is not None:
            self.left -= 1
        over = self.left == 0
        if over and not self.after:
            raise KeyboardInterrupt
        result = call(*arguments)
        if over:
            raise KeyboardInterrupt
        return result


@dataclass(frozen=True, kw_only=True)
class Course:
    """Calls on a line, and the mishaps during them.

    calls: verbs with the index of their drive. unasked: times and bytes that arrive at these times. stop_waits: start
    and end of the time in which a stop waits. interrupted: number of the interrupted call of the port, and whether
    after it.
    """

    calls: tuple[tuple[str, int], ...]
    requests: tuple[Mishap | None, ...] = ()
    replies: tuple[Mishap | None, ...] = ()
    unasked: tuple[tuple[float, bytes], ...] = ()
    stop_waits: tuple[float, float] = (-1.0, -1.0)
    interrupted: tuple[int, bool] | None = None
    facts: tuple[tuple[str, float], ...] = ()
    other_settings: bool = False
    echo: bool = False
    paced: bool = True
    real_time: bool = False


@cache
def model_of(protocol):
    plugin = installed[protocol]
    return load_model(plugin.package, protocol, plugin.default_model)


def outcomes(protocol, course, trace, port_calls):
    """Yield the outcome of each call and the state after it. port_calls: list that collects the names of port calls."""
    faster = {"baudrate": 38400} if course.other_settings else {}
    virtual = [
        virtual_drive(protocol, address_of(protocol), model=model_of(protocol)),
        virtual_drive(protocol, address_of(protocol, 2), model=model_of(protocol), **faster),
    ]
    line = VirtualLine(virtual, echo=course.echo, paced=course.paced)
    line.disturbances.append(Mishaps(course.requests, course.replies))
    port = WatchedPort(line.port(), line, real_time=course.real_time)
    port.calls = port_calls
    with drivecomm.open_bus(lambda: port, trace=trace, **dict(course.facts)) as bus:

        def stop_waits():
            return course.stop_waits[0] <= line.time < course.stop_waits[1]

        bus.line.turns.stop_waits = bus._roster.link.stop_waits = stop_waits
        # A port that declares real time has a virtual clock here.
        bus.line.sleep_until = lambda until: line.advance(max(0.0, until - line.time))
        own = MODELS.get(protocol, {})
        drives = [
            bus.drive(protocol, address_of(protocol), **own),
            bus.drive(protocol, address_of(protocol, 2), **own, **faster),
        ]
        for time, data in course.unasked:
            line.call_at(time, partial(line.inject, data))
        if course.interrupted is not None:
            port.left, port.after = course.interrupted
        for verb, place in course.calls:
            port.written.clear()
            try:
                came = repr(call(protocol, bus, drives[place], verb, line))
            except DriveCommError as error:
                came = repr((type(error), str(error)))
            except KeyboardInterrupt:
                came = "interrupted"
                if "write" not in port.calls[-2:]:
                    # An unsent request leaves nothing behind; the end of the wait for a late reply to it may differ.
                    yield came, line.time, tuple(port.written), bus._roster.link._line.unclean
                    return
            yield came, line.time, tuple(port.written), standing(bus), [vars(each).get("memory") for each in virtual]


def call(protocol, bus, drive, verb, line):
    match verb:
        case "read":
            return drive.read(READABLE[protocol])
        case "write":
            return drive.write(*WRITABLE[protocol])
        case "stop all":
            return bus.broadcast(protocol, **MODELS.get(protocol, {})).stop(Stop.COAST)
        case "reference":
            return drive.set_reference(percent=10)
        case "pass":
            return line.advance(0.5)
    return getattr(drive, verb)()


def standing(bus):
    """Return the complete state of the link."""
    link = bus._roster.link
    line = {**vars(link._line), "trace": None, "talk": None, "away": None, "records": None, "newcomers": None}
    line["probed"] = [name for name, each in link._records.items() if each is line["probed"]]
    for name in ("echo", "delays", "tuning"):
        line[name] = vars(line[name]).copy()
    names = ("careful_until", "_asked", "_shared_until", "_drives", "passed_by")
    others = vars(line["others"])
    line["others"] = {name: others[name] for name in names}
    line["others"]["_heard_at"] = tuple(others["_heard_at"])
    line["tuning"]["_errors"] = {name: tuple(errors) for name, errors in line["tuning"]["_errors"].items()}
    line["delays"]["_delays"] = line["delays"]["_delays"].copy()
    drives = {}
    for name, record in link._records.items():
        drives[name] = {each: getattr(record, each) for each in record.__slots__}
        drives[name]["health"] = {**vars(record.health), "_pause": repr(record.health._pause)}
        drives[name]["statistics"] = repr(record.statistics)
        drives[name]["count"] = +record.count
    return line, drives


VERBS = ["read", "read", "read", "write", "status", "stop", "start", "reference", "probe", "stop all", "pass"]
SOON = st.floats(0, 1, allow_nan=False) | st.floats(0, 0.1, allow_nan=False)
COURSES = st.builds(
    Course,
    calls=st.lists(st.tuples(st.sampled_from(VERBS), st.sampled_from([0, 0, 1])), min_size=2, max_size=8).map(
        lambda calls: (("read", 0), *calls)
    ),
    requests=st.lists(MISHAPS, max_size=3).map(lambda each: (None, *each)),
    replies=st.lists(MISHAPS, max_size=6).map(lambda each: (None, *each)),
    unasked=st.lists(st.tuples(SOON, st.sampled_from([NOISE, b"\x02", b"\x41\x06"])), max_size=3).map(tuple),
    stop_waits=st.tuples(SOON, SOON) | st.just((-1.0, -1.0)),
    interrupted=st.none() | st.tuples(st.integers(4, 20), st.booleans()),
    facts=st.fixed_dictionaries(
        {},
        optional={
            "deadline_s": st.sampled_from([0.05, 0.3, 1.0]),
            "attempts": st.integers(1, 3),
            "request_interval_s": st.sampled_from([0.01, 0.2]),
            "reply_timeout_s": st.sampled_from([0.02, 0.1]),
            "late_s": st.sampled_from([0.1, 1.0]),
        },
    ).map(lambda facts: tuple(facts.items())),
    other_settings=st.booleans(),
    echo=st.sampled_from([False, False, False, True]),
    paced=st.booleans(),
    real_time=st.booleans(),
)


def assert_same(protocol, course):
    calls = [], []
    short, long = outcomes(protocol, course, None, calls[0]), outcomes(protocol, course, lambda _: None, calls[1])
    for one, other in zip(short, long, strict=course.interrupted is None):
        if "interrupted" in (one[0], other[0]) and (calls[0] != calls[1] or one[1] != other[1]):
            # One path polled the port once more, or polled where the other waited, so call number `left` is a
            # different one on each path.
            return
        assert one == other


def ways(monkeypatch):
    """Return a list that records the path of each exchange, True for the short one."""
    taken = []
    plain = LineState.is_plain_for

    def noted(line, peer):
        taken.append(plain(line, peer))
        return taken[-1]

    monkeypatch.setattr(LineState, "is_plain_for", noted)
    return taken


@EACH_PROTOCOL
def test_all_reads_after_the_first_take_the_short_path(protocol, monkeypatch):
    taken = ways(monkeypatch)
    line = VirtualLine(
        [virtual_drive(protocol, address_of(protocol)), virtual_drive(protocol, address_of(protocol, 2))]
    )
    with drivecomm.open_bus(line.port) as bus:
        own = MODELS.get(protocol, {})
        for drive in [
            bus.drive(protocol, address_of(protocol), **own),
            bus.drive(protocol, address_of(protocol, 2), **own),
        ] * 3:
            drive.read(READABLE[protocol])
    assert taken == [False, *[True] * 5]


@EACH_PROTOCOL
@pytest.mark.parametrize("kind", ["in pieces", "byte by byte"])
def test_reply_in_pieces_takes_the_short_path(protocol, kind, monkeypatch):
    def odd(_call, _exchange, command, begun):
        raise AssertionError(f"{command} went on by the long way after {begun}")

    line = VirtualLine([virtual_drive(protocol, address_of(protocol))])
    line.disturbances.append(Mishaps([], [None] + [Mishap(kind, 5, 0.001)] * 5))
    with drivecomm.open_bus(line.port) as bus:
        drive = bus.drive(protocol, address_of(protocol), **MODELS.get(protocol, {}))
        held = drive.read(READABLE[protocol])
        line.advance(CAREFUL_S)
        monkeypatch.setattr("drivecomm.link.link.resume_exchange", odd)
        for _ in range(5):
            assert drive.read(READABLE[protocol]).value == held.value


@EACH_PROTOCOL
@pytest.mark.parametrize("verb", ["read", "write", "status"])
def test_ctrl_c_leaves_the_same_state_on_both_paths(protocol, verb):
    calls = (("read", 0), (verb, 0), ("write", 0), ("read", 1))
    for call in range(4, 16):
        for after in (False, True):
            assert_same(protocol, Course(calls=calls, interrupted=(call, after)))


@EACH_PROTOCOL
def test_ctrl_c_between_two_pieces_leaves_the_same_state_on_both_paths(protocol):
    pieces = (None, *[Mishap("byte by byte", 0, 0.002)] * 4)
    for call in range(4, 16):
        for after in (False, True):
            assert_same(protocol, Course(calls=(("read", 0),) * 3, replies=pieces, interrupted=(call, after)))


@EACH_PROTOCOL
@pytest.mark.parametrize("delay_s", [0.005, 0.02, 0.04, 0.045, 0.06])
def test_slow_bytes_have_the_same_outcome_on_both_paths(protocol, delay_s):
    """No gap is long enough to end the telegram, but the time for the longest telegram runs out."""
    pieces = (None, *[Mishap("byte by byte", 0, delay_s)] * 4)
    assert_same(protocol, Course(calls=(("read", 0),) * 3, replies=pieces))


@pytest.mark.soak
@pytest.mark.parametrize("kind", ["cut", "byte by byte"])
@pytest.mark.parametrize(("protocol", "extent"), protocol_extents(PROTOCOLS, 30, 300))
def test_stop_waiting_between_two_pieces_has_the_same_outcome_on_both_paths(protocol, kind, extent):
    replies = (None, *[Mishap(kind, 5, 0.004)] * 4)
    for step in range(extent):
        begins_s = 0.6 * step / extent
        stop_waits = (begins_s, begins_s + 0.01)
        assert_same(protocol, Course(calls=(("read", 0),) * 3, replies=replies, stop_waits=stop_waits))


# The sample has each kind, paced and not, with at least one protocol, and each protocol several times.
@pytest.mark.parametrize(("protocol", "kind", "paced"), every_choice(5, PROTOCOLS, KINDS, [False, True]))
def test_mishap_at_each_byte_of_a_reply_has_the_same_outcome_on_both_paths(protocol, kind, paced):
    for place in range(0, 20, 3):
        replies = (None, None, Mishap(kind, place, 0.01))
        calls = (("read", 0), ("read", 1), ("read", 0), ("read", 0), ("write", 1))
        assert_same(protocol, Course(calls=calls, replies=replies, paced=paced))


@pytest.mark.parametrize(("protocol", "extent"), protocol_extents(PROTOCOLS, 8, 200))
def test_unrequested_bytes_at_any_time_have_the_same_outcome_on_both_paths(protocol, extent):
    for step in range(extent):
        unasked = ((0.2 * step / extent, NOISE),)
        assert_same(protocol, Course(calls=(("read", 0),) * 4, unasked=unasked))


@pytest.mark.parametrize("real_time", [False, True])
@pytest.mark.parametrize(("protocol", "extent"), protocol_extents(PROTOCOLS, 8, 200))
def test_stop_waiting_from_any_time_has_the_same_outcome_on_both_paths(protocol, real_time, extent):
    replies = (None, None, Mishap("late", 0, 0.05))
    for step in range(extent):
        stop_waits = (0.2 * step / extent, 0.2 * step / extent + 0.1)
        course = Course(calls=(("read", 0),) * 4, replies=replies, stop_waits=stop_waits, real_time=real_time)
        assert_same(protocol, course)


@EACH_PROTOCOL
@pytest.mark.parametrize("deadline_s", [0.001, 0.01, 0.05])
@pytest.mark.parametrize("paced", [False, True], ids=["at once", "paced"])
def test_deadline_before_the_end_of_a_request_has_the_same_outcome_on_both_paths(protocol, deadline_s, paced):
    replies = (None, Mishap("cut", 5, 0.0))
    calls = (("read", 0), ("status", 0), ("write", 0), ("read", 1))
    for real_time in (False, True):
        facts = (("deadline_s", deadline_s),)
        assert_same(protocol, Course(calls=calls, replies=replies, facts=facts, paced=paced, real_time=real_time))


@pytest.mark.soak
@pytest.mark.parametrize(("protocol", "extent"), protocol_extents(PROTOCOLS, 25, 2000 if LONG else 400))
def test_random_courses_have_the_same_outcome_on_both_paths(protocol, extent):
    @settings(
        max_examples=extent,
        deadline=None,
        database=None,
        # A course is short enough to be read without shrinking.
        phases=[Phase.generate],
        report_multiple_bugs=False,
        suppress_health_check=[HealthCheck.too_slow],
    )
    @given(COURSES)
    def same(course):
        assert_same(protocol, course)

    same()
