"""Any plant file, order or bytes on a served line lead to an error message or to a working plant."""

import json
from contextlib import suppress
from math import inf
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import example, given, settings, strategies as st

import drivecomm.plant.files
from drivecomm.errors import DriveCommError, FileFormatError
from drivecomm.models import load_model
from drivecomm.plant import Plant, PlantLine, read_plant
from drivecomm.protocol import DriveConfig, LineSettings
from drivecomm.virtual import ServedLine, VirtualLine, VirtualPlant, answer_order, virtual_drive
from drivecomm.virtual.audience import Audience
from drivecomm.virtual.timers import Timers

EXAMPLE = drivecomm.plant.files.__doc__
EXAMPLE = EXAMPLE[EXAMPLE.index("format = 1") :].splitlines()
ASSIGNMENTS = [number for number, line in enumerate(EXAMPLE) if " = " in line]
JUNK = [
    "0",
    "-1",
    "1e300",
    "nan",
    "inf",
    "true",
    '""',
    '"x"',
    '"vabus:1"',
    "[]",
    "[1]",
    "{}",
    "{ a = 1 }",
    "1979-05-27",
]


@pytest.mark.soak
@settings(deadline=None, max_examples=150)
@given(st.sampled_from(ASSIGNMENTS), st.sampled_from(JUNK))
def test_plant_file_with_junk_in_one_place_loads_or_is_refused(number, junk):
    lines = list(EXAMPLE)
    lines[number] = f"{lines[number].partition(' = ')[0]} = {junk}"
    with TemporaryDirectory() as folder:
        path = Path(folder) / "plant.toml"
        path.write_text("\n".join(lines))
        # Any other error is a failure.
        with suppress(FileFormatError):
            plant = read_plant(path)
            with suppress(DriveCommError):
                VirtualPlant(plant)


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner, max_size=3),
    max_leaves=5,
)
ORDERS = st.fixed_dictionaries(
    {"order": st.sampled_from(["trip", "power", "set", "inject", "fault", "show"]) | JSON},
    optional={
        "drive": st.just("pump") | JSON,
        "line": st.just("hall") | JSON,
        "parameter": st.sampled_from(["480", "481", "410", "10", "394"]) | JSON,
        "parameters": JSON,
        "value": JSON,
        "code": JSON,
        "state": st.sampled_from(["on", "off", "factory"]) | JSON,
        "data": st.just("04 41") | JSON,
        "text": JSON,
    },
)


MODEL = load_model("drivecomm_vabus", "vabus", "agile")


@pytest.mark.soak
@settings(deadline=None, max_examples=50)
@given(st.lists(ORDERS, max_size=6))
def test_random_orders_are_carried_out_or_refused_and_the_plant_continues(orders):
    drive = DriveConfig(protocol="vabus", address=1, line="hall", name="pump", options={"model": MODEL})
    plant = VirtualPlant(Plant(lines=(PlantLine(name="hall"),), drives=(drive,)))
    line = plant.line("hall")
    port = line.port()
    port.configure(plant.drive("pump").settings)
    for order in orders:
        answer = json.loads(answer_order(plant, json.dumps(order).encode()))
        assert answer.pop("ok") is True or list(answer) == ["error"]
        for parameter in ("480", "481", "410"):
            request = {"kind": "enquiry", "address": 1, "parameter": int(parameter)}
            port.write(drivecomm.encode("vabus", request, direction="request"))
            port.read(port.now() + 0.1, 100)
    assert json.loads(answer_order(plant, b'{"order": "show"}'))["ok"] is True


class Listener:
    address = "nowhere"
    descriptor = 7
    settings = None

    def __init__(self):
        self.incoming = b""
        self.sent = b""

    def receive(self, _):
        data, self.incoming = self.incoming, b""
        return data

    def send(self, data):
        self.sent += data


PIECES = st.lists(st.tuples(st.floats(0, 0.3), st.binary(min_size=1, max_size=40)), max_size=20)


@settings(deadline=None, max_examples=60)
@given(PIECES, st.booleans(), st.lists(st.floats(0, 1), max_size=5))
def test_served_line_comes_to_rest_and_echoes_every_byte(pieces, paced, naps):
    # A drive that is switched off, so that the line carries only the echo.
    drive = virtual_drive("danfoss-fc", 1)
    line = VirtualLine([drive], echo=True, paced=paced)
    line.power_off(drive)
    listener = Listener()
    couple = ServedLine(line, listener)
    now = 0.0
    for pause, data in pieces:
        now += pause
        listener.incoming = data
        couple.attend(now)
        assert couple.due >= now - 1e-9
    for nap in naps:
        now += nap
        couple.follow(now)
    steps = 0
    while couple.due < inf:
        couple.follow(max(now, couple.due))
        steps += 1
        assert steps < 1000
    assert listener.sent == b"".join(data for _, data in pieces)
    assert line.backlog_s == 0
    assert couple.descriptor == 7


def heard_when(when, pieces):
    """Return the bytes for the master of a line that is followed at its times `when`, and their last arrival."""
    drives = [virtual_drive("vabus", 1, reply_delay_s=0.0), virtual_drive("danfoss-fc", 2)]
    listener = Listener()
    couple = ServedLine(VirtualLine([*drives, virtual_drive("vabus", 3, reply_delay_s=0.02)]), listener)
    now, came, last = 0.0, 0, 0.0
    for pause, data in [*pieces, (1.0, b"")]:
        until = now + pause
        while (due := getattr(couple, when)) <= until:
            now = max(now, due)
            couple.follow(now)
            if len(listener.sent) > came:
                came, last = len(listener.sent), round(now, 9)
        now = until
        listener.incoming = data
        couple.attend(now)
    return listener.sent, last


REQUESTS = st.sampled_from([
    bytes.fromhex("04 41 30 30 34 38 31 05"),
    bytes.fromhex("04 43 30 30 34 38 31 05"),
    # To all drives: no drive answers.
    bytes.fromhex("04 40 02 30 34 38 31 30 30 30 30 03"),
    bytes.fromhex("02 0e 82 16 4d 00 00 00 00 00 00 00 00 00 00 d5"),
    b"\x04",
])  # fmt: skip


@pytest.mark.soak
@settings(deadline=None, max_examples=60)
@given(st.lists(st.tuples(st.floats(0, 0.1), REQUESTS), max_size=12))
def test_served_line_followed_only_at_deadlines_sends_the_same_bytes(pieces):
    (came, last), (should, at) = heard_when("deadline", pieces), heard_when("due", pieces)
    assert came == should
    # Bytes that met another transmission are delivered in the pieces in which they were examined.
    assert last <= at + 0.0005 + 1e-9
    if not any(pause < 0.08 for pause, _ in pieces[1:]):
        assert last == at


class Everybody(Audience):
    """An audience that passes everything to every drive, with no memory."""

    def of(self, *_):
        return self._stations


def on_the_line(audience, steps):
    """Return all transmissions on a line of several protocols, and the states of its drives afterwards."""
    line = PlantLine(name="hall")
    drives = [
        DriveConfig(protocol=protocol, address=address, line="hall", name=f"{protocol} {address}", options=options)
        for protocol, options in (
            ("vabus", {}),
            ("danfoss-fc", {"parity": "N"}),
            ("vlt3500", {"start_inhibit": False}),
            ("fuji", {}),
        )
        for address in (1, 2)
    ]
    plant = VirtualPlant(Plant(lines=(line,), drives=tuple(drives)))
    hall = plant.line("hall")
    hall._audience = audience(hall._stations)
    told = []
    hall.monitors.append(lambda sent: told.append((sent.source, sent.began, sent.data)))
    port = hall.port()
    for pause, step in steps:
        if isinstance(step, bytes):
            port.write(step)
        elif isinstance(step, LineSettings):
            port.configure(step)
        else:
            step(plant)
        port.read(port.now() + pause, 1000)
    return told, plant.states(), [station.pending for station in hall._stations]


HEARD = st.sampled_from([
    # Two reads for each protocol, each for another drive; an odd one, cut, doubled, to all, and noise.
    *(bytes.fromhex(text) for text in (
        "04 41 30 30 34 38 31 05",
        "04 42 30 30 34 38 31 05",
        "02 0e 81 16 4d 00 00 00 00 00 00 00 00 00 00 d6",
        "02 0e 82 16 4d 00 00 00 00 00 00 00 00 00 00 d5",
        "02 06 80 04 7c 20 00 dc",
        "3c 30 31 52 40 40 40 40 30 32 31 35 2b 30 30 30 30 30 30 36 36 3e",
        "3c 30 32 52 40 40 40 40 30 32 31 35 2b 30 30 30 30 30 30 36 37 3e",
        "01 30 31 05 52 4d 30 39 20 30 30 30 30 03 35 31",
        "01 30 32 05 52 4d 30 39 20 30 30 30 30 03 35 32",
        "04 40 02 30 34 38 31 30 30 30 30 03 01",
        "04 41 30 30 34",
        "38 31 05",
        "04",
        "ff",
    )),
    LineSettings(baudrate=19200),
    LineSettings(),
    lambda plant: plant.power_off("vabus 2"),
    lambda plant: plant.power_on("vabus 2"),
    lambda plant: plant.power_on_as_new("fuji 1"),
    lambda plant: plant.set("vlt3500 2", "500", 1),
    lambda plant: setattr(plant.drive("danfoss-fc 2"), "settings", LineSettings(baudrate=19200)),
    lambda plant: setattr(plant.drive("fuji 2").inner, "address", 1),
])  # fmt: skip


@pytest.mark.soak
@settings(deadline=None, max_examples=60)
@given(st.lists(st.tuples(st.sampled_from([0.0, 0.02, 0.2]), HEARD), max_size=16))
@example([
    (0.2, bytes.fromhex("3c 30 31 52 40 40 40 40 30 32 31 35 2b 30 30 30 30 30 30 36 36 3e")),
    (0.0, lambda plant: plant.set("vlt3500 2", "500", 1)),
])  # fmt: skip
def test_drives_behave_alike_with_and_without_telegrams_for_others(steps):
    assert on_the_line(Audience, steps * 2) == on_the_line(Everybody, steps * 2)


@settings(deadline=None, max_examples=100)
@given(st.lists(st.one_of(st.tuples(st.integers(0, 9), st.floats(0, 10) | st.just(inf)), st.floats(0, 11))))
def test_timers_return_the_earliest_deadline_first(steps):
    timers, deadlines = Timers[int](), dict.fromkeys(range(10), inf)
    for step in steps:
        if isinstance(step, tuple):
            timers.set(*step)
            deadlines[step[0]] = step[1]
        else:
            popped = timers.pop(step)
            earliest = min(deadlines.values())
            assert (popped is None) == (earliest > step)
            if popped is not None:
                assert deadlines[popped] == earliest
                deadlines[popped] = inf
        assert timers.deadline == min(deadlines.values())


def test_timers_moved_repeatedly_take_no_memory():
    timers = Timers[str]()
    timers.set("late", 1e9)
    for number in range(1000):
        timers.set("moved", 1e6 - number)
    assert len(timers._heap) < 100
    assert [timers.pop(inf), timers.pop(inf)] == ["moved", "late"]
