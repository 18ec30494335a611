"""The bus and its drives on virtual lines."""

from dataclasses import replace
from decimal import Decimal

import pytest
from benches import Port
from two_faces import FACES, open_on

import drivecomm
from drivecomm.errors import (
    AddressError,
    DriveCommError,
    FileFormatError,
    LinkDownError,
    NoReplyError,
    NotSupported,
    ParameterAddressError,
    PortError,
    RefusedError,
    UnknownProtocolError,
    UsageError,
    ValueRefusedError,
)
from drivecomm.line import Job
from drivecomm.plant import Fault, FaultPlan
from drivecomm.protocol import LineSettings, Pause, Stop, installed
from drivecomm.virtual import VirtualLine, virtual_drive


@pytest.fixture
def line():
    return VirtualLine([virtual_drive("vabus", 1), virtual_drive("vabus", 2)])


@pytest.fixture(params=FACES)
def face(request):
    return request.param


@pytest.fixture
def bus(line, face):
    with open_on(face, line.port) as opened:
        yield opened


# Making drives


def test_drive_has_the_name_of_the_command_line(bus):
    drive = bus.drive("vabus", 1)
    assert drive.name == "vabus:1"
    assert "vabus:1" in repr(drive)
    assert drive.model is None
    assert drive.facts == installed["vabus"].facts
    assert Stop.RAMP in drive.capabilities.stops


def test_drive_takes_a_packaged_model_or_the_file_of_a_user(bus, tmp_path):
    assert bus.drive("vabus", 1, model="act").model.name == "act"
    path = tmp_path / "own.toml"
    path.write_text('format = 1\nprotocol = "vabus"\nname = "own"\n', encoding="utf-8")
    assert bus.drive("vabus", 1, model=path).model.name == "own"


def test_options_come_from_model_bus_and_call_in_this_order(line, tmp_path):
    path = tmp_path / "own.toml"
    path.write_text(
        'format = 1\nprotocol = "vabus"\nname = "own"\n'
        "[options]\nbaudrate = 2400\nattempts = 7\nreply_timeout_s = 3.0\nram_datasets = false\n",
        encoding="utf-8",
    )
    with drivecomm.open_bus(line.port, attempts=5, reply_timeout_s=2.0) as bus:
        drive = bus.drive("vabus", 1, model=path, reply_timeout_s=1.0)
        assert drive.facts.settings.baudrate == 2400
        assert drive.facts.timing.attempts == 5
        assert drive.facts.timing.reply_timeout_s == 1.0
        assert not drive.capabilities.volatile_writes
        assert bus.drive("vabus", 1, model=path, ram_datasets=True).capabilities.volatile_writes


@pytest.mark.parametrize("name", ["baudrate", "bytesize", "parity", "stopbits", "reply_timeout_s", "attempts"])
def test_option_of_open_bus_applies_to_all_drives(line, name):
    value = {"baudrate": 2400, "bytesize": 8, "parity": "O", "stopbits": 2, "reply_timeout_s": 0.25, "attempts": 2}[
        name
    ]
    with drivecomm.open_bus(line.port, **{name: value}) as bus:
        facts = bus.drive("vabus", 1).facts
    assert getattr(facts.settings, name, None) == value or getattr(facts.timing, name, None) == value


@pytest.mark.parametrize("address", [0, 31, 32, -1, 999, "1", 1.0, True, None])
def test_invalid_drive_address_is_refused(bus, address):
    with pytest.raises(AddressError, match=r"vabus has no drive at address .*; addresses are 1 to 30"):
        bus.drive("vabus", address)


def test_unknown_or_impossible_option_of_a_drive_is_refused(bus):
    with pytest.raises(UsageError, match=r"vabus drives have no option 'colour'; they have .*baudrate.*sys"):
        bus.drive("vabus", 1, colour="red")
    with pytest.raises(UsageError, match="vabus drives have no option 'colour'"):
        bus.broadcast("vabus", colour="red")
    with pytest.raises(UsageError, match="6 data bits are not possible"):
        bus.drive("vabus", 1, bytesize=6)
    with pytest.raises(UsageError, match="system-bus node 99"):
        bus.drive("vabus", 1, sys=99)


def test_model_with_an_unknown_option_is_refused(bus, tmp_path):
    path = tmp_path / "own.toml"
    path.write_text('format = 1\nprotocol = "vabus"\nname = "own"\n[options]\ncolour = "red"\n', encoding="utf-8")
    with pytest.raises(UsageError, match="model own sets 'colour', which vabus does not have"):
        bus.drive("vabus", 1, model=path)


def test_unknown_protocol_or_model_is_refused(bus):
    with pytest.raises(UnknownProtocolError):
        bus.drive("profibus", 1)
    with pytest.raises(UnknownProtocolError):
        bus.broadcast("profibus")
    with pytest.raises(UsageError, match="no model 'none'"):
        bus.drive("vabus", 1, model="none")
    with pytest.raises(FileFormatError):
        bus.drive("vabus", 1, model="/nowhere.toml")


# Verbs


def test_drive_reads_and_writes_parameters(bus, line):
    drive = bus.drive("vabus", 1, model="agile")
    reading = drive.read("fixed_frequency_2")
    assert (reading.parameter, reading.value, reading.unit) == ("481", Decimal("10.00"), "Hz")
    assert reading.time_s == bus.wall_time() == line.time > 0
    assert drive.write("481", "12.34") is None
    assert drive.read("481").value == Decimal("12.34")
    assert line.drives[0].peek("481", line.time) == "000004D2"
    assert bus.drive("vabus", 2, model="agile").read("481").value == Decimal("10.00")


def test_invalid_call_sends_nothing(line):
    events = []
    with drivecomm.open_bus(line.port, trace=events.append) as bus:
        drive = bus.drive("vabus", 1, model="agile")
        for call, error in (
            (lambda: drive.read("48x"), ParameterAddressError),
            (lambda: drive.read("1600"), ParameterAddressError),
            (lambda: drive.write("481", "1.234"), ValueRefusedError),
            (lambda: drive.write("481", 1e9), ValueRefusedError),
            (lambda: drive.write("481", "ten"), ValueRefusedError),
            (lambda: drive.stop(Stop.DC_BRAKE), NotSupported),
            (drive.jog, NotSupported),
            (lambda: drive.set_reference(rpm=1, hz=1), UsageError),
            (lambda: drive.read("481", colour="red"), UsageError),
            (lambda: drive.write("481", 1, colour="red"), UsageError),
            (drive.set_reference, UsageError),
            (lambda: drive.set_reference(percent=1, hz=1), UsageError),
        ):
            with pytest.raises(error):
                call()
    assert not [event for event in events if event.what == "sent"]


def test_unknown_option_of_a_verb_is_refused_with_the_known_ones(bus):
    with pytest.raises(UsageError, match="read has no option 'colour' here; it has type, dataset"):
        bus.drive("vabus", 1).read("481", colour="red")


def test_drive_starts_stops_and_resets_its_motor(bus, line):
    drive = bus.drive("vabus", 1, model="agile")
    drive.set_reference(hz=20)
    drive.start()
    assert drive.status().running
    line.advance(30.0)
    assert drive.status().at_reference
    drive.set_reference(percent=0)
    drive.stop()
    line.advance(30.0)
    assert not drive.status().running
    assert not line.drives[1].motor.running
    line.drives[0].trip(5, line.time)
    assert drive.status().fault
    line.advance(20.0)
    drive.reset()
    assert not drive.status().fault
    drive.probe()
    assert drive.identify()


def test_refused_read_raises_refused_error(bus):
    with pytest.raises(RefusedError) as caught:
        bus.drive("vabus", 1).read("1599")
    assert caught.value.parameter == "1599"
    assert bus.drive("vabus", 1).read("481").raw


def test_missing_drive_raises_no_reply_error(bus):
    with pytest.raises(NoReplyError, match="vabus:9 did not answer within 500 ms"):
        bus.drive("vabus", 9).read("481")
    assert bus.counters["vabus:9"]["timeouts"] == 3
    assert bus.drive("vabus", 1).read("481").raw


def test_broadcast_reaches_all_drives_and_waits_for_no_reply(bus, line):
    everybody = bus.broadcast("vabus", model="agile")
    before = line.time
    everybody.write("481", "7.00")
    assert line.time - before < 0.1
    line.advance(0.1)
    assert [drive.peek("481", line.time) for drive in line.drives] == ["000002BC"] * 2
    for drive in (bus.drive("vabus", 1), bus.drive("vabus", 2)):
        drive.start()
    everybody.stop()
    line.advance(30)
    for drive in line.drives:
        drive.motor.advance(line.time)
        assert not drive.motor.running
    assert "vabus:*" in bus.counters or bus.counters
    with pytest.raises(UsageError):
        everybody.write("481", "7.00", colour="red")


# Scanning


def test_scan_finds_the_drives_on_the_line(bus):
    progress = []
    found = list(bus.scan(only=["vabus"], addresses=[0, 1, 2, 3, 99], progress=lambda *step: progress.append(step)))
    assert [drive.name for drive in found] == ["vabus:1", "vabus:2"]
    assert all(drive.sound and drive.identity for drive in found)
    # Invalid addresses of the protocol are not probed.
    assert progress == [("vabus", 0, 3), ("vabus", 1, 3), ("vabus", 2, 3), ("vabus", 3, 3)]


def test_scan_finds_one_drive_of_every_protocol():
    plugins = list(installed.working())
    # A model may have its own line settings; a scan uses the usual ones of the protocol. A virtual drive recognises the
    # start of a telegram by some characters of silence, even within bytes that looked like a telegram of its own.
    # Some telegrams of Huanyang drives are also Modbus ones: the two protocols must not share an address here.
    addresses = {each.name: each.addresses[2 if each.name == "huanyang" else 1] for each in plugins}
    drives = [
        virtual_drive(each.name, addresses[each.name], parity=each.facts.settings.parity, gap_s=0.006)
        for each in plugins
    ]
    line = VirtualLine(drives)
    with drivecomm.open_bus(line.port) as bus:
        found = list(bus.scan(addresses=sorted(set(addresses.values())), attempts=1))
        expected = {f"{name}:{address}" for name, address in addresses.items()}
        assert {drive.name for drive in found if drive.sound} == expected
    assert not any(drive.motor.running for drive in line.drives)


def test_scan_without_addresses_tries_the_usual_ones(bus):
    found = list(bus.scan(only=["vabus"], reply_timeout_s=0.05))
    assert [drive.address for drive in found] == [1, 2]


def test_scan_of_no_address_or_an_invalid_one_finds_nothing(bus):
    assert list(bus.scan(only=["vabus"], addresses=[])) == []
    assert list(bus.scan(only=["vabus"], addresses=[99], progress=lambda *_: None)) == []
    with pytest.raises(UnknownProtocolError):
        list(bus.scan(only=["profibus"]))


def test_scan_reports_a_drive_that_answers_with_damaged_telegrams():
    class Spoilt(FaultPlan):
        def reply(self, data):
            return [(0.0, data[:-1] + bytes([data[-1] ^ 1]))]

    line = VirtualLine([virtual_drive("vabus", 1)], faults=Spoilt(rate=0.0))
    with drivecomm.open_bus(line.port) as bus:
        (found,) = bus.scan(only=["vabus"], addresses=[1])
    assert not found.sound
    assert found.identity == {}
    assert "damaged" in found.detail


def test_scan_reports_a_drive_that_stops_answering():
    class Once(FaultPlan):
        left = 1

        def reply(self, data):
            self.left -= 1
            return [(0.0, data)] if self.left >= 0 else []

    line = VirtualLine([virtual_drive("vabus", 1)], faults=Once(rate=0.0))
    with drivecomm.open_bus(line.port) as bus:
        (found,) = bus.scan(only=["vabus"], addresses=[1])
    assert found.sound
    assert found.identity == {}
    assert "did not answer" in found.detail


# Port and lock


def test_closed_bus_refuses_calls(face, line):
    bus = open_on(face, line.port)
    drive = bus.drive("vabus", 1)
    drive.probe()
    bus.close()
    bus.close()
    with pytest.raises(UsageError, match="this bus is closed"):
        drive.read("481")


def test_leaving_the_context_closes_the_bus_after_an_error(face, line):
    with pytest.raises(ZeroDivisionError), open_on(face, line.port) as bus:
        raise ZeroDivisionError
    with pytest.raises(UsageError):
        bus.drive("vabus", 1).probe()


def test_lost_port_is_closed_and_reopened(face, line):
    opened, closed = [], []

    def port():
        opened.append(Port(line.port(), close=lambda: closed.append(line.time)))
        return opened[-1]

    with open_on(face, port) as bus:
        drive = bus.drive("vabus", 1)
        drive.probe()
        line.broken = True
        for _ in range(3):
            with pytest.raises(LinkDownError):
                drive.read("481")
        assert len(closed) == 1
        line.broken = False
        with pytest.raises(LinkDownError, match=r"opened again in 0\.5 s"):
            drive.read("481")
        line.advance(0.5)
        assert drive.read("481").raw
        assert len(opened) == 2


def test_interrupted_exchange_is_closed_immediately(line):
    closed = []

    def interrupt(*_):
        raise KeyboardInterrupt

    def exchange():
        try:
            yield Pause(seconds=1.0)
        finally:
            closed.append(True)

    with drivecomm.open_bus(lambda: Port(line.port(), wait=interrupt)) as bus:
        # The caught exception holds the traceback, and with it the frames of the exchange.
        with pytest.raises(KeyboardInterrupt) as caught:
            bus.run(Job(bus.drive("vabus", 1).peer, exchange()))
        assert closed == [True]
        assert caught.value.__traceback__ is not None


def test_lost_port_is_reopened_at_each_call_until_it_succeeds(face, line):
    answers = [line.port, None, line.port]

    def port():
        make = answers.pop(0)
        if make is None:
            raise PortError("in use")
        return make()

    with open_on(face, port) as bus:
        drive = bus.drive("vabus", 1)
        line.broken = True
        with pytest.raises(LinkDownError):
            drive.probe()
        line.broken = False
        with pytest.raises(PortError):
            drive.probe()
        line.advance(0.5)
        drive.probe()


def test_opening_a_bus_on_a_missing_port_raises_port_error(face):
    def port():
        raise PortError("the port does not exist")

    with pytest.raises(PortError):
        open_on(face, port)


def test_drives_with_different_line_settings_share_a_line(face):
    line = VirtualLine([virtual_drive("vabus", 1, baudrate=9600), virtual_drive("vabus", 2)])
    configured = []

    class Port:
        def __init__(self, port):
            self._port = port

        def __getattr__(self, name):
            return getattr(self._port, name)

        def configure(self, settings):
            configured.append(settings.baudrate)
            return self._port.configure(settings)

    with open_on(face, lambda: Port(line.port())) as bus:
        slow, fast = bus.drive("vabus", 1, baudrate=9600), bus.drive("vabus", 2)
        assert slow.facts.settings == LineSettings(baudrate=9600, bytesize=7, parity="E")
        for drive in (slow, slow, fast, fast, slow):
            drive.probe()
    assert configured == [9600, 19200, 9600]


def test_echoing_adapter_works_with_the_echo_option(face):
    line = VirtualLine([virtual_drive("vabus", 1)], echo=True)
    with open_on(face, line.port, echo=True) as bus:
        assert bus.drive("vabus", 1).read("481").raw
        assert bus.counters["vabus:1"]["echo bytes"] > 0


def test_drive_that_sends_endless_garbage_does_not_block_the_line(face):
    class Garbage(FaultPlan):
        def reply(self, data):
            return [(0.0, b"\x41\x02\x30\x7f" * 5000)] if self.rate else [(0.0, data)]

    plan = Garbage(rate=1.0)
    line = VirtualLine([virtual_drive("vabus", 1), virtual_drive("vabus", 2)], faults=plan)
    with open_on(face, line.port) as bus:
        with pytest.raises(DriveCommError):
            bus.drive("vabus", 1, attempts=1).read("481")
        assert line.time < 5.0
        plan.rate = 0.0
        line.advance(60.0)
        assert bus.drive("vabus", 2).read("481").raw


def test_silent_drive_does_not_disturb_other_drives(face):
    line = VirtualLine(
        [virtual_drive("vabus", 1), virtual_drive("vabus", 2)],
        faults=FaultPlan(rate=1.0, kinds=[Fault.DROP], requests=False),
    )
    with open_on(face, line.port) as bus:
        with pytest.raises(NoReplyError):
            bus.drive("vabus", 1).read("481")
        line.faults = FaultPlan(rate=0.0)
        assert bus.drive("vabus", 2).read("481").raw
        assert bus.counters["vabus:2"]["retries"] == 0


def test_call_carries_out_verbs_of_one_protocol_only(line):
    calls = []

    def jog(*, number):
        calls.append(number)
        return "jogging"
        yield

    with drivecomm.open_bus(line.port) as bus:
        drive = bus.drive("vabus", 1)
        with pytest.raises(NotSupported, match="vabus:1 has no verb 'dance'; it has "):
            drive.call("dance")
        operations = type("Operations", (), {"extra": {"jog": jog}})()
        jogging = drivecomm.Drive(bus, drive._peer, operations, None)
        assert jogging.call("jog", number=2) == "jogging"
        with pytest.raises(NotSupported, match="it has jog"):
            jogging.call("dance")
        with pytest.raises(UsageError, match="jog has no option 'speed' here; it has number"):
            jogging.call("jog", speed=2)
        with pytest.raises(UsageError, match="jog needs number"):
            jogging.call("jog")
    assert calls == [2]


def test_protocol_without_broadcast_refuses_broadcasts(bus):
    take_away = installed.register(replace(installed["vabus"], name="lonely", broadcast_address=None))
    try:
        with pytest.raises(NotSupported, match="lonely has no broadcast"):
            bus.broadcast("lonely")
        assert bus.drive("lonely", 1).name == "lonely:1"
    finally:
        take_away()


def test_line_options_apply_to_all_drives(line):
    with drivecomm.open_bus(line.port, turnaround_s=0.2, gap_s=None) as bus:
        assert bus.drive("vabus", 1).facts.turnaround_s == 0.2
        assert bus.drive("vabus", 1).facts.gap_s == 0.05
    with pytest.raises(UsageError, match="turnaround_s"):
        drivecomm.open_bus(line.port, turnround_s=0.2)
