"""Replays: a capture answers, sends requests, and judges a program by the recorded traffic."""

import asyncio
from dataclasses import replace
from itertools import pairwise

import pytest
from hypothesis import given, settings, strategies as st
from sessions import ADDRESSES, READS, everybody, read_everybody, record, work_with_everybody

import drivecomm
from drivecomm.capture import Capture, CaptureWriter, Piece, Provenance
from drivecomm.errors import NoReplyError, NotSupported, TelegramError, UsageError
from drivecomm.plant import TRANSMISSION_FAULTS, Fault, FaultPlan
from drivecomm.protocol import Command, Damaged, Framed, Framer, installed
from drivecomm.traffic.replay import (
    RecordedCodec,
    RecordedExchange,
    RecordedRequest,
    ReplayedRequest,
    ReplayError,
    ReplayMaster,
    ReplyPart,
    Sending,
    difference,
    recorded_drives,
    recorded_exchanges,
    replayed,
)
from drivecomm.virtual import VirtualLine, virtual_drive

EVERYBODY = list(installed.working())
READ = bytes.fromhex("04 41 30 30 34 38 31 05")
VALUE = drivecomm.encode(
    "vabus", {"kind": "value", "address": 1, "parameter": 481, "data": "000003E8"}, direction="reply"
)


def pieces_of(*said):
    """Return a capture of (time, source, bytes)."""
    return Capture(
        provenance=Provenance(),
        pieces=[Piece(time_s=time_s, source=source, data=data) for time_s, source, data in said],
    )


def test_recorded_requests_are_paired_with_their_replies():
    found = recorded_exchanges(
        pieces_of(
            (0.0, "drive", b"late"),
            (0.1, "master", b"a"),
            (0.2, "drive", b"A"),
            (0.25, "drive", b"B"),
            (0.3, "master", b"b"),
            (0.4, "unknown", b"?"),
            (0.5, "master", b"b"),
        )
    )
    assert [(each.request, each.reply) for each in found] == [(b"a", b"AB"), (b"b", b""), (b"b", b"")]
    assert found[0].reply_s == pytest.approx(0.15)
    assert found[1].reply_s == 0


def test_exchanges_of_each_line_are_separate():
    said = [("one", "master", b"a"), ("two", "master", b"b"), ("one", "drive", b"A"), ("two", "drive", b"B")]
    pieces = [Piece(time_s=n, line=line, source=source, data=data) for n, (line, source, data) in enumerate(said)]
    found = recorded_exchanges(Capture(provenance=Provenance(), pieces=pieces))
    assert [(each.line, each.request, each.reply) for each in found] == [("one", b"a", b"A"), ("two", b"b", b"B")]


def test_capture_without_sources_is_refused():
    with pytest.raises(UsageError, match="who sent what"):
        recorded_exchanges(pieces_of((0, "unknown", b"a")))
    assert recorded_exchanges(pieces_of()) == []


# As drives


def test_drives_of_a_capture_give_the_recorded_replies():
    capture, values = record(read_everybody)
    line = VirtualLine(recorded_drives(capture))
    with drivecomm.open_bus(line.port) as bus:
        assert read_everybody(bus) == values
        assert read_everybody(bus) == values


def test_recorded_replies_come_in_order_and_the_last_one_repeats():
    (drive,) = recorded_drives(
        pieces_of(
            (0.0, "master", b"ask"),
            (0.5, "drive", b"1"),
            (1.0, "master", b"ask"),
            (2.0, "master", b"ask"),
            (2.1, "drive", b"3"),
            (2.2, "drive", b"4"),
            (3.0, "master", b"told"),
        )
    )
    answers = [drive.hear(Framed(b"ask", RecordedRequest(b"ask")), 0.0) for _ in range(5)]
    assert [answer and (answer.data, round(answer.delay_s, 6)) for answer in answers] == [
        (b"1", 0.5),
        None,
        (b"34", 0.2),
        (b"34", 0.2),
        (b"34", 0.2),
    ]
    assert drive.hear(Framed(b"told", RecordedRequest(b"told")), 0.0) is None
    assert drive.hear(Damaged(b"x", TelegramError("framing", "wrong")), 0.0) is None


def test_request_missing_in_the_capture_is_not_answered():
    capture, _ = record(read_everybody)
    line = VirtualLine(recorded_drives(capture))
    with drivecomm.open_bus(line.port, attempts=1) as bus:
        with pytest.raises(NoReplyError):
            bus.drive("vabus", 1).read("482")
        assert bus.drive("vabus", 1).read("481").raw


def test_recorded_drive_has_no_parameters_or_motor():
    (drive,) = recorded_drives(pieces_of((0.0, "master", b"a")))
    for call in (lambda: drive.peek("481", 0), lambda: drive.poke("481", 1), lambda: drive.trip(1, 0)):
        with pytest.raises(NotSupported):
            call()
    with pytest.raises(UsageError, match="no request"):
        recorded_drives(pieces_of())
    assert drive.codec.encode(RecordedRequest(b"a")) == b"a"
    with pytest.raises(TelegramError):
        drive.codec.encode(object.__new__(Kind))
    assert drive.codec.measure(b"a", "reply") == 0


class Kind:
    kind = "value"


@pytest.mark.soak
@given(
    requests=st.sets(st.binary(min_size=1, max_size=4), min_size=1, max_size=6),
    order=st.lists(st.integers(0, 5), max_size=6),
)
@settings(max_examples=300, deadline=None)
def test_recorded_requests_are_found_in_any_pieces(requests, order):
    """If no request is the beginning of another, a stream of them is split into the original requests."""
    known = sorted(each for each in requests if not any(other != each and each.startswith(other) for other in requests))
    codec = RecordedCodec(known)
    said = [known[number % len(known)] for number in order]
    assert codec.measure(b"", "request") == min(map(len, known))
    for size in (1, 3, 100):
        framer, stream, found = Framer(codec, "request"), b"".join(said), []
        for place in range(0, len(stream), size):
            found += framer.feed(stream[place : place + size])
        assert [find.data for find in found] == said


def test_longer_of_two_possible_requests_is_waited_for():
    codec = RecordedCodec([b"ab", b"abcd"])
    framer = Framer(codec, "request")
    assert framer.feed(b"ab") == []
    assert [find.data for find in framer.flush()] == [b"ab"]
    assert [find.data for find in framer.feed(b"abcd")] == [b"abcd"]


# As a test


@pytest.mark.parametrize("program", [read_everybody, work_with_everybody])
def test_same_program_gets_the_same_results_from_a_replay(program, tmp_path):
    capture, result = record(program)
    path = tmp_path / "session.pcapng"
    with CaptureWriter(path, capture.provenance) as writer:
        for piece in capture.pieces:
            writer.add(piece)
    for source in (capture, path, str(path)):
        with replayed(source) as line, drivecomm.open_bus(line.port) as bus:
            assert program(bus) == result


@pytest.mark.soak
def test_same_program_gets_the_same_results_from_a_replay_of_a_bad_line():
    def program(bus):
        results = []
        for _ in range(40):
            for name, address in ADDRESSES.items():
                try:
                    results.append(bus.drive(name, address).read(READS[name]).raw)
                except drivecomm.DriveCommError as error:
                    results.append(str(error))
        return results

    # A reply that comes seconds late meets a later request, which depends on the timing of the port.
    kinds = [each for each in TRANSMISSION_FAULTS if each is not Fault.DELAY]
    for seed in range(5):
        capture, results = record(program, everybody(faults=FaultPlan(seed=seed, rate=0.3, kinds=kinds)))
        assert len(recorded_exchanges(capture)) > len(results) + 40 + 10
        with replayed(capture) as line, drivecomm.open_bus(line.port) as bus:
            assert program(bus) == results


def test_async_program_gets_the_same_results_from_a_replay():
    capture, result = record(read_everybody)

    async def program(line):
        async with drivecomm.open_bus_async(line.port) as bus:
            return [(await bus.drive(name, address).read(READS[name])).raw for name, address in ADDRESSES.items()]

    with replayed(capture) as line:
        assert asyncio.run(program(line)) == result


def test_first_difference_is_named():
    capture, _ = record(read_everybody)
    with (
        pytest.raises(
            ReplayError, match=r"request 1, at 0.004 s .* 34 38 31 05 \(vabus:1 enquiry\); now .* \(vabus:2 enq"
        ),
        replayed(capture) as line,
        drivecomm.open_bus(line.port) as bus,
    ):
        bus.drive("vabus", 2).read("481")


def test_surplus_and_missing_requests_are_differences():
    capture, _ = record(read_everybody)
    with (
        pytest.raises(ReplayError, match="requests of the capture were not sent; the first is request 3"),
        replayed(capture) as line,
        drivecomm.open_bus(line.port) as bus,
    ):
        bus.drive("vabus", 1).read("481")
    with replayed(capture) as line, drivecomm.open_bus(line.port) as bus:
        read_everybody(bus)
        drive = bus.drive("vabus", 1)
        with pytest.raises(ReplayError, match="the capture has ended, but 04 41"):
            drive.read("481")


def test_error_of_the_program_is_not_hidden_by_the_replay():
    capture, _ = record(read_everybody)
    with pytest.raises(ZeroDivisionError), replayed(capture):
        raise ZeroDivisionError


def test_time_of_a_replay_is_virtual_and_equals_the_recorded_one():
    capture, _ = record(read_everybody)
    with replayed(capture) as line, drivecomm.open_bus(line.port) as bus:
        read_everybody(bus)
        assert capture.pieces[-1].time_s <= line.time < capture.pieces[-1].time_s + 0.1


# As a master


def asked(capture, line, **options):
    """Send the requests of a capture on a virtual line; return their outcomes."""
    return list(ReplayMaster(recorded_exchanges(capture), EVERYBODY, **options).on(line.port()))


def test_replayed_requests_get_the_same_replies_from_the_same_drives():
    capture, _ = record(read_everybody)
    outcomes = asked(capture, everybody())
    assert len(outcomes) == len(recorded_exchanges(capture))
    assert all(outcome.sent and not outcome.differs for outcome in outcomes)


@pytest.mark.parametrize("faster", [0.5, 1.0, 4.0])
def test_replay_keeps_the_recorded_timing_times_a_factor(faster):
    said = []
    for n in range(5):
        said += [(n * 0.4, "master", READ), (n * 0.4 + 0.03, "drive", b"x")]
    line = VirtualLine([virtual_drive("vabus", 1)])
    began = []
    line.monitors.append(lambda sent: began.append(sent.began) if sent.source == "master" else None)
    asked(pieces_of(*said), line, faster=faster)
    assert [later - began[0] for later in began] == pytest.approx([n * 0.4 / faster for n in range(5)])


def test_fast_replay_sends_no_faster_than_drives_can_receive():
    capture, _ = record(read_everybody)
    line = everybody()
    outcomes = asked(capture, line, faster=1e6)
    assert not any(outcome.differs for outcome in outcomes)
    assert line.time < capture.pieces[-1].time_s + 1


def test_fast_replay_keeps_the_pause_of_each_drive():
    said = []
    for n in range(5):
        said += [(n * 0.4, "master", READ), (n * 0.4 + 0.04, "drive", VALUE)]
    line, spoken = VirtualLine([virtual_drive("vabus", 1)]), []
    line.monitors.append(spoken.append)
    asked(pieces_of(*said), line, faster=1e6)
    pauses = [later.began - one.ended for one, later in pairwise(spoken) if later.source == "master"]
    assert len(pauses) == 4
    assert min(pauses) > 0.0099


def test_replay_leaves_commands_out():
    """A replay of any program's requests moves no motor and writes nothing."""
    capture, _ = record(work_with_everybody)
    line = everybody()
    for _ in range(2):
        outcomes = asked(capture, line, faster=10)
        for drive in line.drives:
            assert drive.motor.command is Command.OFF
            assert drive.motor.output_hz == 0
    assert {outcome.sent for outcome in outcomes} == {True, False}
    assert not any(outcome.differs for outcome in outcomes if not outcome.sent)


def test_replay_sends_commands_with_sending_everything():
    def start(bus):
        drive = bus.drive("danfoss-fc", 3)
        drive.set_reference(percent=50)
        drive.start()

    capture, _ = record(start)
    line = everybody()
    outcomes = asked(capture, line, sending=Sending.EVERYTHING)
    assert all(outcome.sent for outcome in outcomes)
    assert line.drives[1].motor.command is Command.RUN


def test_changed_values_and_missing_replies_are_named():
    capture, _ = record(read_everybody)
    line = everybody()
    line.drives[0].poke("481", 2000)
    line.power_off(line.drives[2])
    different = [outcome for outcome in asked(capture, line) if outcome.differs]
    assert [difference(outcome, EVERYBODY) for outcome in different] == [
        "data was 000003E8, is 000007D0",
        "nothing came",
    ]
    assert [outcome.number for outcome in different] == [1, 4]


def test_difference_text_shows_both_replies():
    then = RecordedExchange(asked_s=0, request=READ, parts=(ReplyPart(after_s=0.1, data=b"\x01\x02"),))
    assert difference(ReplayedRequest(number=1, then=then, came=b"\x03"), EVERYBODY) == "was 01 02, is 03"
    silent = replace(then, parts=())
    assert difference(ReplayedRequest(number=1, then=silent, came=b"\x03"), EVERYBODY) == "nothing came then, now 03"
    assert not ReplayedRequest(number=1, then=silent).differs


def test_reply_to_a_formerly_unanswered_request_is_a_difference():
    line = VirtualLine([virtual_drive("vabus", 1)])
    outcomes = asked(pieces_of((0, "master", READ), (1, "master", READ)), line)
    assert [outcome.differs for outcome in outcomes] == [True, True]


def test_surplus_bytes_after_a_reply_are_a_difference():
    """A second drive with the same address answers after the first one."""
    line = VirtualLine([virtual_drive("vabus", 1)])
    capture, _ = record(lambda bus: bus.drive("vabus", 1).read("481"), line)
    line = VirtualLine([virtual_drive("vabus", 1)])
    line.monitors.append(lambda sent: line.inject(b"!!") if sent.source == "drive" else None)
    outcomes = asked(capture, line)
    assert outcomes[0].came == recorded_exchanges(capture)[0].reply + b"!!"
    assert outcomes[0].differs


def test_echo_is_not_a_difference():
    capture, _ = record(read_everybody)
    assert not any(outcome.differs for outcome in asked(capture, everybody(echo=True), echo="expect"))
    assert not any(outcome.differs for outcome in asked(capture, everybody(echo=True), echo="auto"))


def test_replay_uses_line_settings_of_the_capture_or_overrides():
    capture, _ = record(read_everybody)
    slow = {"baudrate": 4800}
    line = VirtualLine([virtual_drive(name, address, **slow) for name, address in ADDRESSES.items()])
    assert all(outcome.differs for outcome in asked(capture, line) if outcome.then.parts)
    assert not any(outcome.differs for outcome in asked(capture, line, overrides=slow))
    # Without settings in the capture, the usual ones of the protocol apply.
    bare = replace(capture, pieces=[replace(piece, settings=None) for piece in capture.pieces])
    assert not any(outcome.differs for outcome in asked(bare, everybody()))
    with pytest.raises(UsageError, match="line settings"):
        asked(pieces_of((0, "master", b"?")), everybody(), sending=Sending.EVERYTHING)


@pytest.mark.parametrize("faster", [0, -1, float("nan"), float("inf")])
def test_invalid_speed_factor_is_refused(faster):
    with pytest.raises(UsageError, match="is not a valid speed factor"):
        ReplayMaster([], EVERYBODY, faster=faster)


def test_replay_of_an_empty_capture_sends_nothing():
    assert asked(pieces_of(), everybody()) == []
