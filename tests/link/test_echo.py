"""Adapters that echo what they send: completely, in part, disturbed, or not at all."""

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
    """The filter alone. It removes exactly the bytes that were sent and passes all others on."""

    def test_complete_echo_is_dropped(self):
        echo = EchoFilter("expect")
        echo.sent(b"abc")
        assert echo.missing == 3
        assert echo.take(b"abc") == (b"abc", b"")
        assert echo.take(b"xyz") == (b"", b"xyz")
        assert not echo.answered(0)

    def test_echo_joined_to_the_reply_is_dropped(self):
        echo = EchoFilter("expect")
        echo.sent(b"abc")
        assert echo.take(b"abcxyz") == (b"abc", b"xyz")

    def test_echo_in_pieces_is_dropped(self):
        echo = EchoFilter("expect")
        echo.sent(b"abc")
        assert echo.take(b"a") == (b"", b"")
        assert echo.missing == 2
        assert echo.take(b"bcx") == (b"abc", b"x")

    def test_second_telegram_equal_to_the_first_is_not_an_echo(self):
        echo = EchoFilter("expect")
        echo.sent(b"abc")
        assert echo.take(b"abcabc") == (b"abc", b"abc")
        assert echo.take(b"abc") == (b"", b"abc")

    @pytest.mark.parametrize("came", [b"bc", b"xbc", b"axc", b"abx"])
    def test_bytes_that_differ_from_the_request_are_passed_on_whole(self, came):
        echo = EchoFilter("expect")
        echo.sent(b"abc")
        assert echo.take(came + b"xyz") == (b"", came + b"xyz")
        assert echo.excused == 3
        assert echo.answered(0)

    def test_beginning_of_an_echo_is_held_until_give_up(self):
        echo = EchoFilter("expect")
        echo.sent(b"abc")
        assert echo.take(b"ab") == (b"", b"")
        assert echo.give_up() == b"ab"
        assert echo.give_up() == b""

    def test_auto_mode_detects_that_there_is_no_echo(self):
        echo = EchoFilter("auto")
        echo.sent(b"abc")
        assert echo.looking
        assert echo.missing == 0
        assert echo.take(b"xyz") == (b"", b"xyz")
        assert not echo.answered(0)
        assert not echo.looking

    def test_auto_mode_detects_an_echo(self):
        echo = EchoFilter("auto")
        echo.sent(b"abc")
        assert echo.take(b"abcxyz") == (b"abc", b"xyz")
        assert not echo.answered(0)
        assert echo.looking
        echo.sent(b"def")
        assert echo.missing == 3

    def test_auto_mode_learns_nothing_from_a_possible_mirrored_reply(self):
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

    def test_auto_mode_detects_a_mirrored_echo_if_a_reply_follows(self):
        echo = EchoFilter("auto")
        echo.sent(b"abc", mirrored=True)
        assert echo.take(b"abcabc") == (b"abc", b"abc")
        echo.answered(0)
        echo.sent(b"def", mirrored=True)
        assert echo.missing == 3
        assert echo.take(b"def") == (b"def", b"")
        assert not echo.doubted

    def test_copy_of_the_request_after_a_disturbed_echo_is_not_a_reply(self):
        echo = EchoFilter("auto")
        echo.sent(b"abcdef")
        echo.take(b"abXdef" + b"reply")
        echo.answered(6)
        echo.sent(b"stop", mirrored=True)
        assert echo.take(b"stop") == (b"stop", b"")
        assert not echo.doubted
        # The copy has not decided whether there is an echo.
        echo.sent(b"ask")
        assert (echo.missing, echo.take(b"rep")) == (0, (b"", b"rep"))
        echo.answered(0)
        assert not echo.looking

    def test_byte_of_noise_is_not_a_disturbed_echo(self):
        echo = EchoFilter("auto")
        echo.sent(b"abcdef")
        echo.take(b"\x00reply")
        echo.answered(1)
        echo.sent(b"stop", mirrored=True)
        echo.take(b"stop")
        assert echo.doubted

    def test_off_mode_looks_for_no_echo(self):
        assert not EchoFilter("off").looking


@pytest.fixture(params=["paced", "network"])
def line(request):
    """Return a line with echo, on a paced port and on a port where bytes arrive without delay."""
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
def test_complete_echo_leaves_reads_and_writes_right(protocol, mode):
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
    # The link does not wait after a telegram that only ends an exchange, and its echo comes with the next request's.
    assert counters["echo bytes"] >= sum(len(data) for data in asked)
    assert counters["retries"] == counters["timeouts"] == counters["damaged"] == 0
    assert counters["echoes missing"] == 0


@pytest.mark.parametrize("mode", ["expect", "auto"])
@EACH_PROTOCOL
def test_echo_does_not_slow_down_reads(protocol, mode):
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
def test_line_without_echo_works_with_echo_off_and_auto(protocol, mode):
    line = VirtualLine([Mortal(protocol)])
    with drivecomm.open_bus(line.port, echo=mode) as bus:
        drive = bus.drive(protocol, ADDRESS)
        for parameter in READABLE[protocol] * 2:
            assert drive.read(parameter).raw == line.drives[0].peek(parameter, line.time)
        assert bus.counters[drive.name]["echo bytes"] == 0
        assert bus.counters[drive.name]["retries"] == 0


def test_reply_longer_than_a_missing_echo_is_accepted():
    line = VirtualLine([Mortal("vabus")])
    with drivecomm.open_bus(line.port, echo="expect") as bus:
        drive = bus.drive("vabus", ADDRESS)
        for parameter in READABLE["vabus"] * 2:
            assert drive.read(parameter).raw == line.drives[0].peek(parameter, line.time)
        counters = bus.counters[drive.name]
        assert counters["echoes missing"] >= 4
        assert counters["retries"] == 0


@pytest.mark.parametrize("protocol", ["danfoss-fc", "fuji", "vlt3500"])
def test_bytes_in_place_of_an_echo_are_not_accepted_as_a_reply(protocol):
    """They may be an echo with several changed characters, which passes an eight-bit check once in 256 times."""
    line = VirtualLine([Mortal(protocol)])
    with drivecomm.open_bus(line.port, echo="expect") as bus:
        drive = bus.drive(protocol, ADDRESS, attempts=1)
        with pytest.raises(NoReplyError, match="if this adapter has none, open the port with echo off"):
            drive.read(READABLE[protocol][0])
        assert bus.counters[drive.name]["echoes"] == 1


@EACH_PROTOCOL
def test_unexpected_echo_error_names_the_remedy(protocol):
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
def test_unexpected_echo_error_on_a_network_port_names_the_remedy(protocol):
    """On a network port, an echo is recognised by its bytes, not by its time."""
    line = VirtualLine([], echo=True)
    port = line.port()
    port.paced = False
    with drivecomm.open_bus(lambda: port, echo="off") as bus:
        drive = bus.drive(protocol, ADDRESS, attempts=1)
        with pytest.raises(NoReplyError, match=r"the adapter echoes what it sends.*open the port with echo on"):
            drive.probe()


@EACH_PROTOCOL
def test_silent_loop_is_reported_as_no_reply(protocol):
    line = VirtualLine([], echo=True)
    with drivecomm.open_bus(line.port, echo="expect") as bus:
        with pytest.raises(NoReplyError) as caught:
            bus.drive(protocol, ADDRESS, attempts=1).probe()
        assert "echo on" not in str(caught.value)


def test_unknown_echo_mode_is_refused():
    with pytest.raises(UsageError, match="echo cannot be 'yes'; use off, expect or auto"):
        drivecomm.open_bus(VirtualLine([]).port, echo="yes")


def test_echo_of_a_broadcast_is_dropped(line):
    with drivecomm.open_bus(line.port, echo="expect") as bus:
        drive = bus.drive("vabus", ADDRESS, model="agile")
        drive.read("481")
        bus.broadcast("vabus", model="agile").write("481", 1)
        assert drive.read("481").raw == "00000064"
        assert bus.counters[drive.name]["timeouts"] == 0


def test_auto_mode_detects_an_echo_although_the_first_is_disturbed():
    """A disturbed first echo must not make the adapter count as one without echo."""
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
def test_echo_after_a_disturbed_first_echo_does_not_confirm_a_stop(protocol, model):
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
def test_echo_in_one_piece_with_the_reply_is_dropped(protocol):
    virtual = Mortal(protocol)
    for mode in ("expect", "auto"):
        with drivecomm.open_bus(lambda: Wire(virtual, glued), echo=mode) as bus:
            drive = bus.drive(protocol, ADDRESS)
            for parameter in READABLE[protocol] * 2:
                assert drive.read(parameter).raw == virtual.peek(parameter, 0.0)
            assert bus.counters[drive.name]["retries"] == 0
            assert bus.counters[drive.name]["echoes missing"] == 0


# Any cut, and any single character lost or changed, in echo or reply


DISTURBED_ONCE = settings(deadline=None, suppress_health_check=list(HealthCheck), derandomize=True)


@st.composite
def disturbances(draw):
    """Draw the cuts of the bytes into pieces, and the fate of one byte: nothing, lost, or changed."""
    return (
        draw(st.lists(st.integers(0, 60), max_size=4)),
        draw(st.sampled_from(["nothing", "lost", "changed"])),
        draw(st.integers(0, 60)),
        draw(st.integers(1, 255)),
        draw(st.sampled_from([0.0, 0.001, 0.01])),
    )


def disturbed(request, reply, disturbance):
    """Return the pieces that arrive; the disturbance applies to echo and reply together."""
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
def test_disturbed_echo_or_reply_gives_the_right_value_or_an_error(protocol, mode, extent):
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
                    # Only the disturbed read may fail.
                    assert number == 0
                    assert disturbance[1] != "nothing"
                else:
                    assert reading.raw == virtual.peek(parameter, 0.0)

    right_or_an_error()


@pytest.mark.parametrize("protocol", PROTOCOLS)
@extents(20, 100)
def test_disturbed_echo_does_not_lose_the_reply(protocol, extent):
    """For any disturbance of the echo, a sound reply after it is found without a retry."""
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
def test_disturbed_echo_confirms_no_write(protocol, extent):
    """The drive receives and sends nothing; the rest of the echo must not count as its confirmation."""
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
def test_echo_with_one_changed_character_confirms_no_write(protocol, extent):
    """All single-bit changes; a sample takes two bits of each character."""
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
                # A drive that counts as known is not given up.
                for health in bus.health.values():
                    health.answered()
                try:
                    drive.write(parameter, value)
                except ReplyError:
                    continue
                wrong.append((place, bit))
    assert wrong == []
