"""The set-up of a drive: written before anything else, and again after an absence of the drive or its line."""

import pytest
from benches import ADDRESS, PROTOCOLS, READABLE, WRITABLE, Mortal, model_of
from two_faces import FACES, open_on

import drivecomm
from drivecomm.errors import LinkDownError, NoReplyError, NotAnsweringError, RefusedError
from drivecomm.virtual import VirtualLine

EACH_PROTOCOL = pytest.mark.parametrize("protocol", PROTOCOLS)


class Refusing(Mortal):
    """A VABus drive that refuses writes while `refuses` is set."""

    refuses = False

    def hear(self, find, now):
        message = getattr(find, "message", None)
        if self.refuses and message is not None and message.kind == "select":
            answer = super().hear(find, now)
            return answer and type(answer)(data=answer.data[:1] + b"\x15", delay_s=answer.delay_s)
        return super().hear(find, now)


@pytest.fixture
def virtual():
    return Refusing("vabus")


@pytest.fixture
def line(virtual):
    return VirtualLine([virtual])


@pytest.fixture(params=FACES)
def bus(line, request):
    with open_on(request.param, line.port) as opened:
        yield opened


@pytest.fixture
def drive(bus):
    return bus.drive("vabus", ADDRESS, model="agile", set_up={"481": "12.34", "482": "5.00"})


def kinds(virtual):
    """Return the requests to the drive since the last call, without telegrams that only end an exchange."""
    heard = [
        (message.kind, getattr(message, "parameter", None)) for _, message in virtual.heard if message.kind != "eot"
    ]
    virtual.heard.clear()
    return heard


SET_UP = [("select", 481), ("select", 482)]


def test_making_a_drive_sends_nothing(drive, line, virtual):
    assert drive.name == "vabus:3"
    assert (line.time, virtual.heard) == (0.0, [])


def test_set_up_is_written_once_before_the_first_read(drive, virtual):
    assert drive.read("481").raw == "000004D2"
    assert kinds(virtual) == [*SET_UP, ("enquiry", 481)]
    drive.write("480", 1)
    drive.status()
    assert ("select", 481) not in kinds(virtual)


@EACH_PROTOCOL
def test_set_up_is_written_at_first_contact_and_after_an_absence(protocol):
    parameter, value, raw = WRITABLE[protocol]
    virtual = Mortal(protocol)
    line = VirtualLine([virtual])
    with drivecomm.open_bus(line.port) as bus:
        drive = bus.drive(protocol, ADDRESS, model=model_of(protocol), set_up={parameter: value})
        assert virtual.peek(parameter, line.time) != raw
        drive.read(READABLE[protocol][0])
        assert virtual.peek(parameter, line.time) == raw
        virtual.alive = False
        for _ in range(20):
            with pytest.raises(NoReplyError):
                drive.read(READABLE[protocol][0])
            line.advance(0.5)
        virtual.revive()
        assert virtual.peek(parameter, line.time) != raw
        line.advance(20)
        drive.read(READABLE[protocol][0])
        assert virtual.peek(parameter, line.time) == raw


def test_set_up_is_written_to_ram_only(drive, virtual):
    drive.status()
    selects = [message for _, message in virtual.heard if message.kind == "select"]
    assert [message.dataset for message in selects] == [5, 5]


def test_set_up_is_written_again_after_an_absence(drive, virtual, line, bus):
    drive.status()
    virtual.alive = False
    while not bus.health[drive.name].given_up:
        with pytest.raises(NoReplyError):
            drive.read("480")
    kinds(virtual)
    virtual.alive = True
    line.advance(10)
    drive.read("480")
    heard = kinds(virtual)
    # First the probe, then the set-up, then the requested parameter.
    assert heard[0][0] == "enquiry"
    assert heard[1:] == [*SET_UP, ("enquiry", 480)]


def test_single_failed_call_does_not_repeat_the_set_up(drive, virtual):
    drive.status()
    virtual.alive = False
    with pytest.raises(NoReplyError):
        drive.status()
    virtual.alive = True
    kinds(virtual)
    drive.read("480")
    assert kinds(virtual) == [("enquiry", 480)]


def test_set_up_is_written_again_after_the_port_was_reopened(drive, virtual, line, bus):
    other = bus.drive("vabus", ADDRESS, model="agile")
    drive.status()
    kinds(virtual)
    line.broken = True
    with pytest.raises(LinkDownError):
        drive.status()
    line.broken = False
    line.advance(1)
    # The first object to use the drive writes the set-up.
    other.read("480")
    assert kinds(virtual) == [*SET_UP, ("enquiry", 480)]
    drive.read("480")
    assert kinds(virtual) == [("enquiry", 480)]


def test_object_without_a_model_writes_the_set_up_of_another_object(drive, virtual, bus):
    """The set-up belongs to an object that has the model; the object that uses the drive first has none."""
    plain = bus.drive("vabus", ADDRESS)
    plain.read("480", type="long")
    assert kinds(virtual) == [*SET_UP, ("enquiry", 480)]
    drive.read("480")
    assert kinds(virtual) == [("enquiry", 480)]


def test_stop_and_probe_do_not_wait_for_the_set_up(drive, virtual):
    drive.probe()
    assert ("select", 481) not in kinds(virtual)
    drive.stop()
    assert ("select", 481) not in kinds(virtual)
    drive.read("480")
    assert kinds(virtual) == [*SET_UP, ("enquiry", 480)]


def test_refused_set_up_raises_and_is_retried(drive, virtual):
    virtual.refuses = True
    for _ in range(3):
        with pytest.raises(RefusedError) as caught:
            drive.read("480")
        assert caught.value.parameter == "481"
        heard = kinds(virtual)
        assert ("select", 481) in heard
        assert ("enquiry", 480) not in heard
    virtual.refuses = False
    assert drive.read("480").raw
    heard = kinds(virtual)
    assert heard[-3:] == [*SET_UP, ("enquiry", 480)]


def test_refused_set_up_does_not_prevent_a_stop(drive, virtual):
    virtual.refuses = True
    with pytest.raises(RefusedError) as caught:
        drive.read("480")
    assert caught.value.parameter == "481"
    virtual.refuses = False
    drive.stop()
    assert ("select", 410) in kinds(virtual)


def test_interrupted_set_up_is_repeated_from_its_beginning(drive, virtual):
    """The drive falls silent after the first of two writes."""
    answers = [True, False]
    hear = virtual._drive.hear

    def once(find, now):
        answer = hear(find, now)
        message = getattr(find, "message", None)
        if message is not None and message.kind == "select":
            return answer if answers and answers.pop(0) else None
        return answer

    virtual._drive.hear = once
    with pytest.raises(NoReplyError):
        drive.read("480")
    virtual._drive.hear = hear
    virtual.heard.clear()
    while True:
        try:
            drive.read("480")
        except NoReplyError:
            drive.bus.sleep_until(drive.bus.now() + 1)
            continue
        break
    assert kinds(virtual)[-3:] == [*SET_UP, ("enquiry", 480)]


def test_latest_set_up_applies_to_all_objects_of_a_drive(bus, virtual):
    first = bus.drive("vabus", ADDRESS, model="agile", set_up={"481": "12.34"})
    first.read("480")
    kinds(virtual)
    second = bus.drive("vabus", ADDRESS, model="agile", set_up={"482": "5.00"})
    first.read("480")
    assert kinds(virtual) == [("select", 482), ("enquiry", 480)]
    second.read("480")
    assert kinds(virtual) == [("enquiry", 480)]


@pytest.mark.parametrize("given_first", [True, False])
def test_dead_drive_with_a_set_up_is_given_up(bus, line, virtual, given_first):
    """An unwritten set-up of a missing drive must not hold up the line."""
    if given_first:
        drive = bus.drive("vabus", ADDRESS, model="agile", set_up={"481": "12.34"})
    else:
        drive = bus.drive("vabus", ADDRESS, model="agile")
        drive.read("480")
        drive = bus.drive("vabus", ADDRESS, model="agile", set_up={"481": "12.34"})
    virtual.alive = False
    for _ in range(10):
        with pytest.raises(NoReplyError):
            drive.read("480")
    before = line.time
    with pytest.raises(NotAnsweringError):
        drive.read("480")
    assert line.time == before
    assert bus.health[drive.name].given_up


@pytest.mark.parametrize("live", [True, False])
def test_probe_at_other_line_settings_leaves_the_set_up_pending(bus, virtual, live):
    drive = bus.drive("vabus", ADDRESS, model="agile", set_up={"481": "12.34", "482": "5.00"})
    if live:
        drive.status()
        virtual.alive = False
        while not bus.health[drive.name].given_up:
            with pytest.raises(NoReplyError):
                drive.read("480")
    # A scan for a drive with unknown settings does the same.
    with pytest.raises(NoReplyError):
        bus.drive("vabus", ADDRESS, baudrate=9600).probe()
    virtual.alive = True
    bus.sleep_until(bus.now() + 20)
    virtual.heard.clear()
    drive.read("480")
    assert kinds(virtual)[-3:] == [*SET_UP, ("enquiry", 480)]


def test_scan_leaves_the_set_up_pending(bus, virtual):
    drive = bus.drive("vabus", ADDRESS, model="agile", set_up={"481": "12.34", "482": "5.00"})
    assert [found.name for found in bus.scan(only=["vabus"], addresses=[ADDRESS])] == [drive.name]
    kinds(virtual)
    drive.read("480")
    assert kinds(virtual) == [*SET_UP, ("enquiry", 480)]


def test_broadcasts_write_no_set_up(bus, virtual):
    bus.drive("vabus", ADDRESS, model="agile", set_up={"481": "12.34"})
    bus.broadcast("vabus").stop()
    bus.sleep_until(bus.now() + 1)
    assert [kind for kind, number in kinds(virtual) if number == 481] == []
