"""What is written to a drive before anything else, and again whenever it or its line was away."""

import pytest
from benches import ADDRESS, PROTOCOLS, READABLE, WRITABLE, Mortal, model_of
from two_faces import FACES, open_on

import drivecomm
from drivecomm.errors import LinkDownError, NoReplyError, NotAnsweringError, RefusedError
from drivecomm.virtual import VirtualLine

EACH_PROTOCOL = pytest.mark.parametrize("protocol", PROTOCOLS)


class Refusing(Mortal):
    """A VABus drive that refuses to be written as long as it is told to."""

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
    """Return what the drive was asked since the last time, without the telegrams that only end an exchange."""
    heard = [
        (message.kind, getattr(message, "parameter", None)) for _, message in virtual.heard if message.kind != "eot"
    ]
    virtual.heard.clear()
    return heard


SET_UP = [("select", 481), ("select", 482)]


def test_making_a_drive_sends_nothing(drive, line, virtual):
    assert drive.name == "vabus:3"
    assert (line.time, virtual.heard) == (0.0, [])


def test_it_is_written_before_anything_else_and_once(drive, virtual):
    assert drive.read("481").raw == "000004D2"
    assert kinds(virtual) == [*SET_UP, ("enquiry", 481)]
    drive.write("480", 1)
    drive.status()
    assert ("select", 481) not in kinds(virtual)


@EACH_PROTOCOL
def test_every_protocol_sets_up_at_first_contact_and_after_being_away(protocol):
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


def test_it_is_not_stored(drive, virtual):
    drive.status()
    selects = [message for _, message in virtual.heard if message.kind == "select"]
    assert [message.dataset for message in selects] == [5, 5]


def test_after_being_away(drive, virtual, line, bus):
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
    # First the probe, then all that is to be set up, then what was asked for.
    assert heard[0][0] == "enquiry"
    assert heard[1:] == [*SET_UP, ("enquiry", 480)]


def test_a_call_that_failed_once_is_no_absence(drive, virtual):
    drive.status()
    virtual.alive = False
    with pytest.raises(NoReplyError):
        drive.status()
    virtual.alive = True
    kinds(virtual)
    drive.read("480")
    assert kinds(virtual) == [("enquiry", 480)]


def test_after_the_port_was_opened_again(drive, virtual, line, bus):
    other = bus.drive("vabus", ADDRESS, model="agile")
    drive.status()
    kinds(virtual)
    line.broken = True
    with pytest.raises(LinkDownError):
        drive.status()
    line.broken = False
    line.advance(1)
    # Whichever object comes first.
    other.read("480")
    assert kinds(virtual) == [*SET_UP, ("enquiry", 480)]
    drive.read("480")
    assert kinds(virtual) == [("enquiry", 480)]


def test_whoever_comes_first_sets_up_as_it_was_given(drive, virtual, bus):
    """The values were given to an object that knows the parameters; another one for the same drive does not."""
    plain = bus.drive("vabus", ADDRESS)
    plain.read("480", type="long")
    assert kinds(virtual) == [*SET_UP, ("enquiry", 480)]
    drive.read("480")
    assert kinds(virtual) == [("enquiry", 480)]


def test_stop_and_probe_do_not_wait_for_it(drive, virtual):
    drive.probe()
    assert ("select", 481) not in kinds(virtual)
    drive.stop()
    assert ("select", 481) not in kinds(virtual)
    drive.read("480")
    assert kinds(virtual) == [*SET_UP, ("enquiry", 480)]


def test_one_that_is_refused_raises_and_is_tried_again(drive, virtual):
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


def test_a_refused_one_does_not_keep_anybody_from_stopping(drive, virtual):
    virtual.refuses = True
    with pytest.raises(RefusedError) as caught:
        drive.read("480")
    assert caught.value.parameter == "481"
    virtual.refuses = False
    drive.stop()
    assert ("select", 410) in kinds(virtual)


def test_one_that_was_cut_off_is_begun_anew(drive, virtual):
    """The drive falls silent behind the first of two writes."""
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


def test_what_is_said_last_of_a_drive_holds_for_all_its_objects(bus, virtual):
    first = bus.drive("vabus", ADDRESS, model="agile", set_up={"481": "12.34"})
    first.read("480")
    kinds(virtual)
    second = bus.drive("vabus", ADDRESS, model="agile", set_up={"482": "5.00"})
    first.read("480")
    assert kinds(virtual) == [("select", 482), ("enquiry", 480)]
    second.read("480")
    assert kinds(virtual) == [("enquiry", 480)]


@pytest.mark.parametrize("given_first", [True, False])
def test_a_dead_drive_that_is_to_be_set_up_is_given_up_all_the_same(bus, line, virtual, given_first):
    """Nobody may hold up the line because a watchdog is to be written to a drive that is not there."""
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
def test_asking_at_other_line_settings_does_not_take_it_off_the_list(bus, virtual, live):
    drive = bus.drive("vabus", ADDRESS, model="agile", set_up={"481": "12.34", "482": "5.00"})
    if live:
        drive.status()
        virtual.alive = False
        while not bus.health[drive.name].given_up:
            with pytest.raises(NoReplyError):
                drive.read("480")
    # Such as a scan for a drive whose settings are not known.
    with pytest.raises(NoReplyError):
        bus.drive("vabus", ADDRESS, baudrate=9600).probe()
    virtual.alive = True
    bus.sleep_until(bus.now() + 20)
    virtual.heard.clear()
    drive.read("480")
    assert kinds(virtual)[-3:] == [*SET_UP, ("enquiry", 480)]


def test_a_scan_leaves_it_to_be_done(bus, virtual):
    drive = bus.drive("vabus", ADDRESS, model="agile", set_up={"481": "12.34", "482": "5.00"})
    assert [found.name for found in bus.scan(only=["vabus"], addresses=[ADDRESS])] == [drive.name]
    kinds(virtual)
    drive.read("480")
    assert kinds(virtual) == [*SET_UP, ("enquiry", 480)]


def test_broadcasts_are_never_set_up(bus, virtual):
    bus.drive("vabus", ADDRESS, model="agile", set_up={"481": "12.34"})
    bus.broadcast("vabus").stop()
    bus.sleep_until(bus.now() + 1)
    assert [kind for kind, number in kinds(virtual) if number == 481] == []
