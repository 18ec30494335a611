"""A served line on two clocks: its virtual time follows real time, and its memory does not grow."""

import gc
import sys
import tracemalloc
from math import inf

import pytest
from extents import extents

import drivecomm
from drivecomm.plant import Condition as When, Fault, Noise, Plant, PlantLine, PowerCutStep, TelegramFault, TripStep
from drivecomm.protocol import DriveConfig, LineSettings, Motor, VirtualReply, installed
from drivecomm.virtual import ServedLine, VirtualLine, VirtualPlant, virtual_drive
from drivecomm.virtual.medium import _MOST_AUDIBLE, _ROOM
from drivecomm.virtual.uart import _sampled
from drivecomm_vabus.telegrams import telegrams

ENQUIRY = bytes.fromhex("04 41 30 30 34 38 31 05")
VALUE = bytes.fromhex("41 02 30 30 34 38 31 30 38 30 30 30 30 30 33 45 38 03")


class Script:
    """A listener whose master sends bytes of the test, and which collects the bytes for the master."""

    def __init__(self, settings=None):
        self.address = "nowhere"
        self.descriptor = 7
        self.settings = settings
        self.incoming = b""
        self.sent = []

    def open(self):
        pass

    def close(self):
        pass

    def receive(self, wait_s):
        assert wait_s == 0.0
        data, self.incoming = self.incoming, b""
        return data

    def send(self, data):
        self.sent.append(data)


def served(*drives, settings=None, **options):
    line = VirtualLine(drives or [virtual_drive("vabus", 1)], **options)
    listener = Script(settings)
    return ServedLine(line, listener), listener


class Fickle:
    """A drive that takes another time for each reply."""

    def __init__(self, *delays):
        self.address, self.gap_s, self.motor, self.codec = 1, 0.05, Motor(), telegrams()
        self.settings = LineSettings()
        self._delays = list(delays)

    def hear(self, *_):
        return VirtualReply(data=b"%d" % len(self._delays), delay_s=self._delays.pop(0))


@pytest.mark.parametrize(
    ("delays", "answers"),
    [
        ((1.0, 0.1), [(0.6, b"1")]),
        ((1.0, 2.0), [(2.5, b"1")]),
        ((1.0, 0.1, 1.0), [(0.6, b"2"), (2.0, b"1")]),
        ((0.1, 0.2, 0.3), [(0.1, b"3"), (0.7, b"2"), (1.3, b"1")]),
    ],
)
def test_drive_has_room_for_one_reply(delays, answers):
    line = VirtualLine([Fickle(*delays)], paced=False)
    port = line.port()
    heard = []
    for number in range(len(delays)):
        port.wait(number * 0.5)
        port.write(ENQUIRY)
        until = (number + 1) * 0.5 if number < len(delays) - 1 else 10.0
        while data := port.read(until, 1):
            heard.append((round(port.now(), 6), data))
    assert heard == answers
    assert all(station.answer is None for station in line._stations)
    assert all(station.wakes_at == inf for station in line._stations)


# Without pacing


def test_characters_take_no_time_without_pacing():
    line = VirtualLine([virtual_drive("vabus", 1, reply_delay_s=0.004)], paced=False, echo=True)
    port = line.port()
    port.configure(line.drives[0].settings)
    port.write(ENQUIRY)
    assert port.take() == ENQUIRY
    assert port.read(1.0, 10) != b""
    assert port.now() == 0.004


@pytest.mark.parametrize("plugin", list(installed.working()), ids=lambda plugin: plugin.name)
def test_every_protocol_answers_without_pacing(plugin):
    address = plugin.addresses[1]
    drive = virtual_drive(plugin.name, address)
    line = VirtualLine([drive], paced=False)
    with drivecomm.open_bus(line.port) as bus:
        parameter = plugin.parameter_examples[0]
        reading = bus.drive(plugin.name, address, model=plugin.default_model).read(parameter)
        assert reading.raw == drive.peek(parameter, line.time)


# A line driven by another clock


def test_served_line_knows_its_next_due_time():
    couple, listener = served(virtual_drive("vabus", 1, reply_delay_s=0.01))
    wire = couple.line.drives[0].settings.wire_s
    assert couple.due == inf
    listener.incoming = ENQUIRY
    couple.attend(5.0)
    asked_at = 5.0 + wire(len(ENQUIRY))
    assert couple.due == pytest.approx(asked_at)
    couple.follow(couple.due)
    assert couple.due == pytest.approx(asked_at + 0.01)
    couple.follow(couple.due)
    assert listener.sent == []
    assert couple.due == pytest.approx(asked_at + 0.01 + wire(len(VALUE) + 1))
    couple.follow(couple.due)
    assert [reply[:-1] for reply in listener.sent] == [VALUE]
    assert couple.due == inf


def test_late_wake_changes_no_time_on_the_line():
    couple, listener = served(virtual_drive("vabus", 1, reply_delay_s=0.01))
    listener.incoming = ENQUIRY
    couple.attend(5.0)
    told = []
    couple.line.monitors.append(lambda sent: told.append((sent.source, round(sent.began, 6))))
    couple.follow(9.0)
    wire = couple.line.drives[0].settings.wire_s
    assert told == [("master", 5.0), ("drive", round(5.0 + wire(len(ENQUIRY)) + 0.01, 6))]
    assert [reply[:-1] for reply in listener.sent] == [VALUE]


def test_echo_is_due_at_its_time():
    couple, listener = served(echo=True)
    listener.incoming = b"\x00"
    couple.attend(1.0)
    couple.follow(couple.due)
    assert listener.sent == [b"\x00"]


def test_echo_without_settings_equals_the_bytes_sent():
    # The drive whose settings determine the pace has seven data bits; the telegram is for the other one.
    couple, listener = served(virtual_drive("vabus", 1), virtual_drive("danfoss-fc", 3), echo=True)
    listener.incoming = bytes(range(256))
    couple.attend(1.0)
    while couple.line.backlog_s:
        couple.follow(couple.due)
    assert b"".join(listener.sent) == bytes(range(256))


def test_bytes_sent_ahead_are_taken_gradually():
    couple, listener = served()
    listener.incoming = bytes(10_000)
    couple.attend(0.0)
    assert couple.descriptor is None
    full_until = couple.due
    assert 0 < full_until < couple.line.drives[0].settings.wire_s(10_000)
    couple.follow(full_until)
    assert couple.descriptor == 7
    assert couple.due < inf


def test_master_without_settings_reaches_all_drives_with_unchanged_settings():
    fast, slow = virtual_drive("vabus", 1), virtual_drive("vabus", 2, baudrate=4800)
    couple, listener = served(fast, slow, paced=False)
    second = ENQUIRY.replace(b"A", b"B")

    def answered():
        listener.sent.clear()
        for number, request in enumerate((ENQUIRY, second)):
            listener.incoming = request
            couple.attend(couple.line.time + 1 + number)
            couple.follow(couple.line.time + 1)
        return [reply[:1] for reply in listener.sent if len(reply) == len(VALUE) + 1]

    assert answered() == [b"A", b"B"]
    couple.line.power_off(slow)
    couple.line.power_on(slow, LineSettings(baudrate=9600, bytesize=7, parity="E"))
    assert answered() == [b"A"]


def test_master_with_settings_reaches_drives_with_the_same_settings():
    couple, listener = served(settings=LineSettings(baudrate=9600))
    listener.incoming = ENQUIRY
    couple.attend(0.0)
    couple.follow(1.0)
    assert not any(VALUE in reply for reply in listener.sent)
    listener.settings = couple.line.drives[0].settings
    listener.incoming = ENQUIRY
    couple.attend(2.0)
    couple.follow(3.0)
    assert VALUE in listener.sent[-1]


def test_line_without_drives_is_served():
    couple, listener = served(echo=True)
    couple.line.drives.clear()
    empty = ServedLine(VirtualLine(echo=True), listener)
    listener.incoming = b"\xff\x80"
    empty.attend(0.0)
    empty.follow(1.0)
    assert listener.sent == [b"\xff\x80"]


# Days


def test_unread_bytes_beyond_the_buffer_are_lost():
    line = VirtualLine(echo=True)
    port = line.port()
    for _ in range(3 * _ROOM // 500):
        port.write(bytes(500))
        port.wait(port.now() + 1)
    assert len(line._master._audible) <= _MOST_AUDIBLE
    assert len(port.take()) == _ROOM


def plant_with_everything():
    names = ("vabus", "danfoss-fc", "vlt3500", "fuji")
    return VirtualPlant(
        Plant(
            lines=(PlantLine(name="hall", echo=True, noise=Noise(rate=0.05, kinds=tuple(Fault)[:-2])),),
            drives=tuple(DriveConfig(protocol=name, address=5, line="hall", name=name) for name in names),
            script=(
                TelegramFault(line="hall", kind=Fault.DUPLICATE, every=7),
                TelegramFault(drive="fuji", kind=Fault.DELAY, of="reply to a read", rate=0.1),
                PowerCutStep(drive="danfoss-fc", off_at_s=1800, back_at_s=1900),
                PowerCutStep(drive="fuji", off_at_s=3000, back_at_s=3100, factory=True),
            ),
        )
    )


def an_hour(plant, requests):
    line = plant.line("hall")
    port = line.port()
    port.configure(LineSettings())
    until = port.now() + 3600
    while port.now() < until:
        for settings, request in requests:
            port.configure(settings)
            port.write(request)
            port.read(port.now() + 0.2, 1000)
        port.wait(port.now() + 20)


@pytest.mark.soak
@extents(3, 5)
def test_hours_of_traffic_take_no_memory(extent):
    plant = plant_with_everything()
    line = plant.line("hall")
    requests = []
    for name, parameter in {"vabus": "210", "danfoss-fc": "16-30", "vlt3500": "502[1]", "fuji": "M09"}.items():
        drive = plant.drive(name)
        ask = next(drive._operations.read(parameter))
        requests.append((drive.settings, drive._codec.encode(ask.message)))
    an_hour(plant, requests)
    tracemalloc.start()
    try:
        taken, objects = [], []
        for _ in range(extent):
            an_hour(plant, requests)
            assert all(len(station.known) <= 512 for station in line._stations)
            assert len(line._audience._known) <= 512
            assert _sampled.cache_info().maxsize
            # Caches have their own limits, and are not under test here.
            _sampled.cache_clear()
            for station in line._stations:
                station.known.clear()
            line._audience._known.clear()
            gc.collect()
            objects.append(len(gc.get_objects()))
            taken.append(tracemalloc.get_traced_memory()[0])
            assert len(line._events) < 20
            assert len(line._master._audible) < 20
            assert len(line._medium._present) < 20
    finally:
        tracemalloc.stop()
    assert line.time > extent * 3600
    assert sum(disturbance.happened for disturbance in plant.disturbances) > 20 * extent
    assert objects[-1] - objects[1] < 50, objects
    if sys.gettrace() is None:
        # A coverage tool would allocate memory of its own.
        assert taken[-1] - taken[1] < 5_000, taken


def test_waiting_condition_keeps_a_single_event():
    drive = DriveConfig(protocol="vabus", address=1, line="hall", name="pump")
    step = TripStep(drive="pump", code=5, when=When(parameter="210", above=1))
    plant = VirtualPlant(Plant(lines=(PlantLine(name="hall"),), drives=(drive,), script=(step,)))
    plant.line("hall").advance(60)
    assert len(plant.line("hall")._events) == 1
