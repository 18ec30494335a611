"""Adapters that hand back what they send: whole, in part, disturbed, or not at all."""

from itertools import pairwise

import pytest
from benches import ADDRESS, PROTOCOLS, READABLE, WRITABLE, Mortal, Recorder, model_of
from extents import extents
from hypothesis import HealthCheck, given, settings, strategies as st
from wire import Wire

import drivecomm
from drivecomm.errors import NoReplyError, ReplyError, UsageError
from drivecomm.link import EchoFilter
from drivecomm.virtual import VirtualLine, virtual_drive

EACH_PROTOCOL = pytest.mark.parametrize("protocol", PROTOCOLS)


class TestFilter:
    """The filter alone. What it takes out is exactly what was sent; all else goes on."""

    def test_a_whole_echo_is_dropped(self):
        echo = EchoFilter("expect")
        echo.sent(b"abc")
        assert echo.missing == 3
        assert echo.take(b"abc") == (b"abc", b"")
        assert echo.take(b"xyz") == (b"", b"xyz")
        assert not echo.answered(0)

    def test_glued_to_the_reply(self):
        echo = EchoFilter("expect")
        echo.sent(b"abc")
        assert echo.take(b"abcxyz") == (b"abc", b"xyz")

    def test_in_pieces(self):
        echo = EchoFilter("expect")
        echo.sent(b"abc")
        assert echo.take(b"a") == (b"", b"")
        assert echo.missing == 2
        assert echo.take(b"bcx") == (b"abc", b"x")

    def test_a_second_telegram_like_the_first_is_no_echo(self):
        echo = EchoFilter("expect")
        echo.sent(b"abc")
        assert echo.take(b"abcabc") == (b"abc", b"abc")
        assert echo.take(b"abc") == (b"", b"abc")

    @pytest.mark.parametrize("came", [b"bc", b"xbc", b"axc", b"abx"])
    def test_what_differs_goes_on_whole(self, came):
        echo = EchoFilter("expect")
        echo.sent(b"abc")
        assert echo.take(came + b"xyz") == (b"", came + b"xyz")
        assert echo.excused == 3
        assert echo.answered(0)

    def test_the_beginning_of_one_is_held_until_nothing_follows(self):
        echo = EchoFilter("expect")
        echo.sent(b"abc")
        assert echo.take(b"ab") == (b"", b"")
        assert echo.give_up() == b"ab"
        assert echo.give_up() == b""

    def test_by_itself_it_finds_out_that_there_is_none(self):
        echo = EchoFilter("auto")
        echo.sent(b"abc")
        assert echo.looking
        assert echo.missing == 0
        assert echo.take(b"xyz") == (b"", b"xyz")
        assert not echo.answered(0)
        assert not echo.looking

    def test_by_itself_it_finds_out_that_there_is_one(self):
        echo = EchoFilter("auto")
        echo.sent(b"abc")
        assert echo.take(b"abcxyz") == (b"abc", b"xyz")
        assert not echo.answered(0)
        assert echo.looking
        echo.sent(b"def")
        assert echo.missing == 3

    def test_what_may_be_the_reply_itself_shows_nothing_by_itself(self):
        echo = EchoFilter("auto")
        echo.sent(b"abc", mirrored=True)
        assert echo.take(b"abc") == (b"abc", b"")
        assert echo.doubted
        echo.sent(b"def")
        assert not echo.doubted
        assert echo.missing == 0
        assert echo.take(b"xyz") == (b"", b"xyz")
        echo.answered(0)
        assert not echo.looking

    def test_what_may_be_the_reply_itself_is_an_echo_when_something_follows(self):
        echo = EchoFilter("auto")
        echo.sent(b"abc", mirrored=True)
        assert echo.take(b"abcabc") == (b"abc", b"abc")
        echo.answered(0)
        echo.sent(b"def", mirrored=True)
        assert echo.missing == 3
        assert echo.take(b"def") == (b"def", b"")
        assert not echo.doubted

    def test_behind_what_may_be_a_disturbed_echo_the_request_itself_is_no_reply(self):
        echo = EchoFilter("auto")
        echo.sent(b"abcdef")
        echo.take(b"abXdef" + b"reply")
        echo.answered(6)
        echo.sent(b"stop", mirrored=True)
        assert echo.take(b"stop") == (b"stop", b"")
        assert not echo.doubted
        # Nothing is settled by it.
        echo.sent(b"ask")
        assert (echo.missing, echo.take(b"rep")) == (0, (b"", b"rep"))
        echo.answered(0)
        assert not echo.looking

    def test_a_byte_of_noise_is_no_disturbed_echo(self):
        echo = EchoFilter("auto")
        echo.sent(b"abcdef")
        echo.take(b"\x00reply")
        echo.answered(1)
        echo.sent(b"stop", mirrored=True)
        echo.take(b"stop")
        assert echo.doubted

    def test_off_looks_for_nothing(self):
        assert not EchoFilter("off").looking


@pytest.fixture(params=["paced", "network"])
def line(request):
    """A line with echo, on a port whose characters take their time and on one where they arrive at once."""
    line = VirtualLine([Mortal("vabus")], echo=True)
    if request.param == "network":
        make = line.port

        def port():
            made = make()
            made.paced = False
            return made

        line.port = port
    return line


def glued(request, reply):
    return [(0.02, request + reply)]


@pytest.mark.parametrize("mode", ["expect", "auto", True])
@EACH_PROTOCOL
def test_a_whole_echo(protocol, mode):
    line = VirtualLine([Mortal(protocol)], echo=True)
    recorder = Recorder()
    with drivecomm.open_bus(line.port, echo=mode, trace=recorder) as bus:
        drive = bus.drive(protocol, ADDRESS, model=model_of(protocol))
        for _ in range(3):
            for parameter in READABLE[protocol]:
                assert drive.read(parameter).raw == line.drives[0].peek(parameter, line.time)
        parameter, value, raw = WRITABLE[protocol]
        drive.write(parameter, value)
        assert line.drives[0].peek(parameter, line.time) == raw
        counters = bus.counters[drive.name]
    asked = [event.data for event in recorder.sent() if event.message.kind != "eot"]
    # What only ends an exchange is not listened to, and its echo comes with the next request's.
    assert counters["echo bytes"] >= sum(len(data) for data in asked)
    assert counters["retries"] == counters["timeouts"] == counters["damaged"] == 0
    assert counters["echoes missing"] == 0


@pytest.mark.parametrize("mode", ["expect", "auto"])
@EACH_PROTOCOL
def test_reading_with_an_echo_takes_no_longer(protocol, mode):
    times = {}
    for echo in (False, True):
        line = VirtualLine([Mortal(protocol)], echo=echo)
        with drivecomm.open_bus(line.port, echo=mode if echo else "off") as bus:
            drive = bus.drive(protocol, ADDRESS)
            drive.status()
            began = line.time
            for _ in range(10):
                drive.status()
            times[echo] = line.time - began
    assert times[True] == pytest.approx(times[False], rel=0.02)


@pytest.mark.parametrize("mode", ["off", "auto", False])
@EACH_PROTOCOL
def test_no_echo_where_none_is_expected(protocol, mode):
    line = VirtualLine([Mortal(protocol)])
    with drivecomm.open_bus(line.port, echo=mode) as bus:
        drive = bus.drive(protocol, ADDRESS)
        for parameter in READABLE[protocol] * 2:
            assert drive.read(parameter).raw == line.drives[0].peek(parameter, line.time)
        assert bus.counters[drive.name]["echo bytes"] == 0
        assert bus.counters[drive.name]["retries"] == 0


def test_a_reply_longer_than_the_echo_that_does_not_come():
    line = VirtualLine([Mortal("vabus")])
    with drivecomm.open_bus(line.port, echo="expect") as bus:
        drive = bus.drive("vabus", ADDRESS)
        for parameter in READABLE["vabus"] * 2:
            assert drive.read(parameter).raw == line.drives[0].peek(parameter, line.time)
        counters = bus.counters[drive.name]
        assert counters["echoes missing"] >= 4
        assert counters["retries"] == 0


@pytest.mark.parametrize("protocol", ["danfoss-fc", "fuji", "vlt3500"])
def test_what_comes_in_place_of_an_echo_is_not_believed(protocol):
    """It may be one with several characters changed, which passes an eight-bit check once in 256 times."""
    line = VirtualLine([Mortal(protocol)])
    with drivecomm.open_bus(line.port, echo="expect") as bus:
        drive = bus.drive(protocol, ADDRESS, attempts=1)
        with pytest.raises(NoReplyError, match="if this adapter has none, open the port with echo off"):
            drive.read(READABLE[protocol][0])
        assert bus.counters[drive.name]["echoes"] == 1


@EACH_PROTOCOL
def test_an_echo_that_nobody_expects_says_what_to_do(protocol):
    line = VirtualLine([], echo=True)
    for paced in (True, False):
        port = line.port()
        port.paced = paced
        with drivecomm.open_bus(lambda port=port: port, echo="off") as bus:
            drive = bus.drive(protocol, ADDRESS, attempts=1)
            with pytest.raises(ReplyError) as caught:
                drive.probe()
            if paced:
                assert "open the port with echo on" in str(caught.value)
                assert bus.counters[drive.name]["echo bytes"] > 0


@EACH_PROTOCOL
def test_an_echo_that_nobody_expects_on_a_network_port_says_what_to_do(protocol):
    """There the echo does not give itself away by its time, only by its bytes."""
    line = VirtualLine([], echo=True)
    port = line.port()
    port.paced = False
    with drivecomm.open_bus(lambda: port, echo="off") as bus:
        drive = bus.drive(protocol, ADDRESS, attempts=1)
        with pytest.raises(NoReplyError, match=r"the adapter hands back what it sends.*open the port with echo on"):
            drive.probe()


@EACH_PROTOCOL
def test_a_loop_with_nobody_on_it_is_silence(protocol):
    line = VirtualLine([], echo=True)
    with drivecomm.open_bus(line.port, echo="expect") as bus:
        with pytest.raises(NoReplyError) as caught:
            bus.drive(protocol, ADDRESS, attempts=1).probe()
        assert "echo on" not in str(caught.value)


def test_no_other_word():
    with pytest.raises(UsageError, match="echo cannot be 'yes'; use off, expect or auto"):
        drivecomm.open_bus(VirtualLine([]).port, echo="yes")


def test_a_broadcast_and_its_echo(line):
    with drivecomm.open_bus(line.port, echo="expect") as bus:
        drive = bus.drive("vabus", ADDRESS, model="agile")
        drive.read("481")
        bus.broadcast("vabus", model="agile").write("481", 1)
        assert drive.read("481").raw == "00000064"
        assert bus.counters[drive.name]["timeouts"] == 0


def test_the_first_echo_may_be_a_bad_one():
    """An adapter is not taken for one without echo because the first one was disturbed."""
    spoil = [True]

    def say(request, reply):
        echo = request[:-1] + b"\x00" if spoil and spoil.pop() else request
        return [(0.01, echo), (0.03, reply)]

    virtual = Mortal("danfoss-fc")
    with drivecomm.open_bus(lambda: Wire(virtual, say), echo="auto") as bus:
        drive = bus.drive("danfoss-fc", ADDRESS)
        for parameter in READABLE["danfoss-fc"] * 2:
            assert drive.read(parameter).raw == virtual.peek(parameter, 0.0)
        counters = bus.counters[drive.name]
        assert counters["retries"] <= 1
        assert counters["echo bytes"] > 0


@pytest.mark.parametrize(("protocol", "model"), [("modbus", "bonfiglioli"), ("huanyang", "hy")])
def test_behind_a_disturbed_first_echo_no_echo_confirms_a_stop_of_a_drive_that_has_gone_deaf(protocol, model):
    heard = []

    def say(request, reply):
        heard.append(request)
        if len(heard) == 1:
            return [(0.01, request[:-3] + b"\x00" + request[-2:]), (0.03, reply)]
        return [(0.01, request)]

    virtual = virtual_drive(protocol, ADDRESS, model=model)
    with drivecomm.open_bus(lambda: Wire(virtual, say), echo="auto") as bus:
        drive = bus.drive(protocol, ADDRESS, model=model)
        drive.read("output_frequency")
        with pytest.raises(ReplyError):
            drive.stop()
    assert len(heard) > 1


@EACH_PROTOCOL
def test_glued_to_the_reply_in_one_piece(protocol):
    virtual = Mortal(protocol)
    for mode in ("expect", "auto"):
        with drivecomm.open_bus(lambda: Wire(virtual, glued), echo=mode) as bus:
            drive = bus.drive(protocol, ADDRESS)
            for parameter in READABLE[protocol] * 2:
                assert drive.read(parameter).raw == virtual.peek(parameter, 0.0)
            assert bus.counters[drive.name]["retries"] == 0
            assert bus.counters[drive.name]["echoes missing"] == 0


# Any cut, any one character lost or changed, in echo or reply


DISTURBED_ONCE = settings(deadline=None, suppress_health_check=list(HealthCheck), derandomize=True)


@st.composite
def disturbances(draw):
    """Where the bytes are cut into pieces, and what happens to one of them: nothing, lost, or changed."""
    return (
        draw(st.lists(st.integers(0, 60), max_size=4)),
        draw(st.sampled_from(["nothing", "lost", "changed"])),
        draw(st.integers(0, 60)),
        draw(st.integers(1, 255)),
        draw(st.sampled_from([0.0, 0.001, 0.01])),
    )


def disturbed(request, reply, disturbance):
    """Return the pieces that arrive; the disturbance is of the echo and the reply as one."""
    cuts, what, place, mask, step = disturbance
    data = request + reply
    if data and what != "nothing":
        place %= len(data)
        changed = b"" if what == "lost" else bytes([data[place] ^ mask])
        data = data[:place] + changed + data[place + 1 :]
    edges = sorted({0, len(data), *(cut % (len(data) + 1) for cut in cuts)})
    pieces = [data[start:end] for start, end in pairwise(edges)]
    return [(0.002 + number * step, piece) for number, piece in enumerate(pieces)]


DRIVES = {protocol: Mortal(protocol) for protocol in PROTOCOLS}


@pytest.mark.parametrize("mode", ["expect", "auto"])
@pytest.mark.parametrize("protocol", PROTOCOLS)
@extents(20, 100)
def test_a_reading_is_right_or_an_error(protocol, mode, extent):
    virtual = DRIVES[protocol]

    @settings(DISTURBED_ONCE, max_examples=extent)
    @given(disturbance=disturbances())
    def right_or_an_error(disturbance):
        left = []

        def say(request, reply):
            if left and reply:
                return disturbed(request, reply, left.pop())
            return [(0.002, request), (0.004, reply)]

        with drivecomm.open_bus(lambda: Wire(virtual, say), echo=mode) as bus:
            drive = bus.drive(protocol, ADDRESS, attempts=1)
            drive.probe()
            left.append(disturbance)
            for number, parameter in enumerate(READABLE[protocol] * 2):
                try:
                    reading = drive.read(parameter)
                except ReplyError:
                    # Only the one that was disturbed may fail.
                    assert number == 0
                    assert disturbance[1] != "nothing"
                else:
                    assert reading.raw == virtual.peek(parameter, 0.0)

    right_or_an_error()


@pytest.mark.parametrize("protocol", PROTOCOLS)
@extents(20, 100)
def test_a_disturbed_echo_costs_no_reply(protocol, extent):
    """Whatever happens to the echo, a sound reply behind it is found, without asking again."""
    virtual = DRIVES[protocol]

    @settings(DISTURBED_ONCE, max_examples=extent)
    @given(disturbance=disturbances())
    def costs_no_reply(disturbance):
        left = [disturbance]

        def say(request, reply):
            if left and reply:
                cuts, what, place, mask, step = left.pop()
                return [*disturbed(request, b"", (cuts, what, place, mask, step)), (0.04, reply)]
            return [(0.002, request), (0.004, reply)]

        with drivecomm.open_bus(lambda: Wire(virtual, say), echo="expect") as bus:
            drive = bus.drive(protocol, ADDRESS, attempts=1)
            for parameter in READABLE[protocol]:
                assert drive.read(parameter).raw == virtual.peek(parameter, 0.0)

    costs_no_reply()


@pytest.mark.parametrize("protocol", PROTOCOLS)
@extents(15, 100)
def test_a_disturbed_echo_confirms_no_write(protocol, extent):
    """The drive hears nothing and says nothing; the remains of the echo must not be taken for its confirmation."""
    virtual = DRIVES[protocol]

    @settings(DISTURBED_ONCE, max_examples=extent)
    @given(disturbance=disturbances())
    def confirms_nothing(disturbance):
        def say(request, _):
            return disturbed(request, b"", disturbance)

        parameter, value, _ = WRITABLE[protocol]
        with drivecomm.open_bus(lambda: Wire(virtual, say), echo="expect") as bus:
            drive = bus.drive(protocol, ADDRESS, model=model_of(protocol), attempts=1)
            with pytest.raises(ReplyError):
                drive.write(parameter, value)

    confirms_nothing()


@EACH_PROTOCOL
@extents((0, 6), range(8))
def test_no_changed_character_of_an_echo_confirms_a_write(protocol, extent):
    """All single changes there are; a sample is of two bits of each character."""
    virtual = DRIVES[protocol]
    parameter, value, _ = WRITABLE[protocol]
    change = [0, 0]
    lengths = []

    def say(request, _):
        lengths.append(len(request))
        place, mask = change
        echo = request[:place] + bytes([request[place] ^ mask]) + request[place + 1 :] if place < len(request) else b""
        return [(0.002, echo)]

    wrong = []
    with drivecomm.open_bus(lambda: Wire(virtual, say), echo="expect") as bus:
        for place in range(40):
            if lengths and place >= max(lengths):
                break
            for bit in extent:
                change[:] = place, 1 << bit
                drive = bus.drive(protocol, ADDRESS, model=model_of(protocol), attempts=1, late_s=0.0)
                # Known, so that it is not given up.
                for health in bus.health.values():
                    health.answered()
                try:
                    drive.write(parameter, value)
                except ReplyError:
                    continue
                wrong.append((place, bit))
    assert wrong == []
