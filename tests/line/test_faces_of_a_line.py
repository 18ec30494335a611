"""Behaviour of a line common to all bus classes: turns by rank, stops, deadlines, lost ports, and lending."""

import threading
from collections import Counter

import pytest
from line_faces import DEAD, LIVE, LOCAL, READ, SERVED, SOON_S, opened, outcome, until

from drivecomm.errors import (
    CommandCancelledError,
    DeadlineError,
    LinkDownError,
    NoReplyError,
    NotAnsweringError,
    OvertakenError,
    UsageError,
)
from drivecomm.protocol import Command, Framed

FACES = [*LOCAL, *(pytest.param(each, marks=pytest.mark.soak) for each in SERVED)]
PROTOCOLS = ["danfoss-fc", "vabus"]
each_face = pytest.mark.parametrize("kind", FACES)
each_local_face = pytest.mark.parametrize("kind", LOCAL)
each_protocol = pytest.mark.parametrize("protocol", PROTOCOLS)


def queued(face, *calls):
    """Queue calls for the line, one after the other."""
    futures = []
    for call in calls:
        futures.append(face.call(*call))
        until(lambda: face.waiting == len(futures))
    return futures


# Turns


@each_local_face
def test_calls_are_served_by_rank_and_then_in_order(kind):
    read = READ["danfoss-fc"]
    with opened(kind) as (face, on):
        with on.held(face) as holding:
            futures = queued(
                face,
                (LIVE[1], "polled", read),
                (LIVE[2], "read", read),
                (LIVE[3], "write", "3-41", 5),
                (LIVE[4], "status"),
            )
        for each in (holding, *futures):
            assert outcome(each) is None
        # Below the rank of commands, polls have every second turn.
        assert on.asked() == [LIVE[0], LIVE[3], LIVE[2], LIVE[1], LIVE[4]]


@each_local_face
@each_protocol
def test_concurrent_calls_do_not_interleave_and_each_gets_its_own_value(kind, protocol):
    with opened(kind, protocol) as (face, on):
        for place, drive in enumerate(on.server.drives):
            drive.poke(READ[protocol], 100 + place)
        told = []
        end = face.bus.listen(told.append)
        asked = [number % len(LIVE) for number in range(40)]
        calls = [face.call(LIVE[place], "read", READ[protocol]) for place in asked]
        for place, each in zip(asked, calls, strict=True):
            assert each.result(SOON_S).raw == on.server.drives[place].peek(READ[protocol], on.server.now())
        end()
        # A VABus telegram that only closes an exchange gets no reply.
        spoken = [each for each in told if each.what != "note" and getattr(each.message, "kind", "") != "eot"]
        assert [each.what for each in spoken] == ["sent", "received"] * len(calls)
        assert [each.drive for each in spoken[::2]] == [each.drive for each in spoken[1::2]]


@each_local_face
def test_line_is_used_again_after_a_failed_call(kind):
    with opened(kind) as (face, on):
        assert isinstance(outcome(face.call(DEAD[0], "status")), NoReplyError)
        assert face.result(LIVE[1], "status").word
        assert on.asked() == [DEAD[0], LIVE[1]]


@each_local_face
def test_call_leaves_the_queue_at_its_deadline(kind):
    with opened(kind) as (face, on):
        with on.held(face):
            error = outcome(face.call(LIVE[1], "status", deadline_s=0.05))
            assert isinstance(error, DeadlineError)
            assert "the line was busy with others for 0.05 s" in str(error)
            assert face.waiting == 0
        assert face.result(LIVE[2], "status").word
        assert LIVE[1] not in on.asked()


@each_face
def test_given_up_drive_does_not_delay_the_line(kind):
    with opened(kind) as (face, on):
        until(lambda: isinstance(outcome(face.call(DEAD[0], "status")), NotAnsweringError))
        before = len(on.requests)
        assert face.result(LIVE[1], "status").word
        assert isinstance(outcome(face.call(DEAD[0], "status")), NotAnsweringError)
        assert on.asked(before)[0] == LIVE[1]


@each_local_face
def test_bus_is_not_closed_during_an_exchange(kind):
    with opened(kind) as (face, on):
        with on.held(face) as holding:
            closing = face.hold(face.bus, "close")
            until(lambda: face.waiting == 1)
        assert outcome(holding) is None
        assert outcome(closing) is None
        error = outcome(face.call(LIVE[1], "status"))
        assert isinstance(error, UsageError)
        assert "this bus is closed" in str(error)


# Trace functions


@each_local_face
def test_error_in_a_trace_function_leaves_the_line_usable(kind):
    with opened(kind) as (face, _):

        def trace(event):
            if event.what == "sent":
                end()
                raise ZeroDivisionError

        end = face.bus.listen(trace)
        assert isinstance(outcome(face.call(LIVE[1], "status")), ZeroDivisionError)
        assert face.result(LIVE[2], "status").word


@pytest.mark.parametrize("kind", ["threads", "engine"])
def test_trace_function_cannot_use_the_bus_that_calls_it(kind):
    with opened(kind) as (face, _):
        refused = []

        def trace(_):
            end()
            try:
                face.drive(LIVE[2]).status()
            except UsageError as error:
                refused.append(str(error))

        end = face.bus.listen(trace)
        assert face.result(LIVE[1], "status").word
        assert refused == ["a trace function cannot use the bus that calls it"]


# Stops


@each_face
def test_stop_is_sent_to_a_given_up_drive(kind):
    with opened(kind) as (face, on):
        until(lambda: isinstance(outcome(face.call(DEAD[0], "status")), NotAnsweringError))
        before = len(on.requests)
        assert isinstance(outcome(face.call(DEAD[0], "stop")), NoReplyError)
        assert DEAD[0] in on.asked(before)


@each_face
def test_stop_does_not_wait_for_a_missing_reply(kind):
    with opened(kind) as (face, on), on.held(face) as holding:
        before = len(on.requests)
        stopping = face.call(LIVE[1], "stop")
        assert isinstance(outcome(holding), OvertakenError)
        on.server.drives[0].is_open.set()
        assert outcome(stopping) is None
        assert on.asked(before)[0] == LIVE[1]


@each_face
@each_protocol
def test_stop_waits_for_at_most_one_attempt_of_each_dead_drive(kind, protocol):
    with opened(kind, protocol) as (face, on):
        before = len(on.requests)
        dead = [face.call(address, "stop") for address in DEAD]
        until(lambda: len(on.requests) > before)
        assert outcome(face.call(LIVE[1], "stop")) is None
        assert all(isinstance(outcome(each), NoReplyError) for each in dead)
        came = on.asked(before)
        assert max(Counter(came[: came.index(LIVE[1])]).values()) == 1


@each_local_face
@each_protocol
def test_stops_of_dead_drives_make_one_attempt_each_in_turn(kind, protocol):
    with opened(kind, protocol) as (face, on):
        with on.held(face, "stop"):
            *dead, live = queued(face, *((address, "stop") for address in (*DEAD, LIVE[1])))
        assert outcome(live) is None
        assert all(isinstance(outcome(each), NoReplyError) for each in dead)
        assert on.asked() == [LIVE[0], *DEAD, LIVE[1], *DEAD, *DEAD]


@each_local_face
@each_protocol
def test_stop_precedes_stops_of_silent_drives(kind, protocol):
    with opened(kind, protocol) as (face, on):
        for address in DEAD:
            assert isinstance(outcome(face.call(address, "read", READ[protocol], attempts=1)), NoReplyError)
        before = len(on.requests)
        with on.held(face, "stop"):
            *dead, live = queued(face, *((address, "stop") for address in (*DEAD, LIVE[1])))
        assert outcome(live) is None
        assert all(isinstance(outcome(each), NoReplyError) for each in dead)
        assert on.asked(before) == [LIVE[0], LIVE[1], *DEAD, *DEAD, *DEAD]


@each_local_face
@each_protocol
def test_reads_take_turns_with_the_attempts_of_a_silent_drive(kind, protocol):
    with opened(kind, protocol) as (face, on):
        assert isinstance(outcome(face.call(DEAD[0], "read", READ[protocol], attempts=1)), NoReplyError)
        before = len(on.requests)
        with on.held(face, "stop"):
            stopping, reading = queued(face, (DEAD[0], "stop"), (LIVE[1], "status"))
        assert outcome(reading) is None
        assert isinstance(outcome(stopping), NoReplyError)
        assert on.asked(before) == [LIVE[0], DEAD[0], LIVE[1], DEAD[0]]


@each_local_face
def test_later_stop_of_the_same_drive_replaces_the_first(kind):
    """Otherwise the first stop could follow the second, and stop the motor another way."""
    with opened(kind) as (face, on):
        with on.held(face, "stop"):
            first, second = queued(face, (DEAD[0], "stop", "coast"), (DEAD[0], "stop", "quick"))
        error = outcome(first)
        assert isinstance(error, OvertakenError)
        assert "a later stop of it continues" in str(error)
        assert isinstance(outcome(second), NoReplyError)


@each_local_face
def test_lost_telegram_turns_no_ramp_into_coasting_while_another_stop_waits(kind):
    """A VABus drive that was started here is stopped as requested even without its reply."""
    with opened(kind, "vabus") as (face, on):
        drive = on.server.drives[1]
        assert outcome(face.call(LIVE[1], "start")) is None
        with on.held(face, "stop"):
            ramp, other = queued(face, (LIVE[1], "stop"), (DEAD[0], "stop"))
            lost, hear = [], drive.hear

            def lose_one(find, now):
                if isinstance(find, Framed) and find.message.kind == "enquiry":
                    lost.append(find)
                    drive.hear = hear
                    return None
                return hear(find, now)

            drive.hear = lose_one
        assert outcome(ramp) is None
        assert lost
        assert isinstance(outcome(other), NoReplyError)
        assert drive.motor.command is Command.RAMP_STOP


@each_local_face
@pytest.mark.parametrize(("protocol", "requests"), [("danfoss-fc", 3), ("vabus", 4)])
def test_stop_of_a_silent_drive_makes_all_attempts_in_one_turn_on_a_free_line(kind, protocol, requests):
    with opened(kind, protocol) as (face, on):
        assert isinstance(outcome(face.call(DEAD[0], "stop")), NoReplyError)
        until(lambda: len(on.requests) == requests)


@each_local_face
def test_stop_does_not_wait_for_a_request_in_its_request_interval(kind):
    with opened(kind) as (face, _):
        assert face.result(LIVE[1], "status").word
        waiting = face.call(LIVE[1], "status", request_interval_s=SOON_S)
        until(lambda: face.bus.line.queue.owner is not None and face.bus.line.queue.owner.is_alive())
        assert outcome(face.call(LIVE[2], "stop")) is None
        assert isinstance(outcome(waiting), OvertakenError)


@each_local_face
@pytest.mark.parametrize(
    "command",
    [("start",), ("reverse",), ("write", "3-41", 7), ("select_setup", 2)],
    ids=lambda command: command[0],
)
def test_stop_cancels_queued_commands_for_its_drive(kind, command):
    with opened(kind) as (face, on):
        with on.held(face) as holding:
            (waiting,) = queued(face, (LIVE[1], *command))
            stopping = face.call(LIVE[1], "stop")
            assert isinstance(outcome(holding), OvertakenError)
        assert outcome(stopping) is None
        assert isinstance(outcome(waiting), CommandCancelledError)
        assert not on.server.drives[1].motor.running


@each_local_face
def test_stop_of_all_drives_overtakes_waiting_calls(kind):
    with opened(kind) as (face, on):
        with on.held(face) as holding:
            (reading,) = queued(face, (LIVE[1], "status"))
            stopping = face._begin(face.bus.broadcast("danfoss-fc"), "stop")
            assert isinstance(outcome(holding), OvertakenError)
        assert outcome(stopping) is None
        assert outcome(reading) is None
        assert on.asked() == [LIVE[0], 0, LIVE[1]]


# Cancelling


@pytest.mark.parametrize("rank", ["read", "stop"])
def test_cancelled_call_leaves_the_queue(rank):
    with opened("tasks") as (face, on):
        with on.held(face) as holding:
            if rank == "read":
                (waiting,) = queued(face, (LIVE[1], "status"))
                waiting.cancel()
                until(lambda: face.waiting == 0)
            else:
                holding.cancel()
        assert face.result(LIVE[2], "status").word
        assert LIVE[1] not in on.asked()


# Lost ports


class Flaky:
    """Opener of a port that counts its calls and fails while `gone` is set."""

    def __init__(self, opener):
        self._open, self.tries, self.gone = opener, 0, False

    def __call__(self):
        self.tries += 1
        if self.gone:
            raise LinkDownError("the adapter is not there")
        return self._open()


def cut(_data):
    raise LinkDownError("it was unplugged")


@each_local_face
def test_stops_of_a_lost_line_try_the_port_only_once(kind):
    """Opening the port may take seconds, and each stop would wait for all earlier attempts."""
    with opened(kind) as (face, on):
        flaky = face.bus.line.open_port = Flaky(face.bus.line.open_port)
        flaky.gone = True
        with on.held(face, "stop"):
            stops = queued(face, *((address, "stop") for address in (*LIVE[1:], *DEAD)))
            on.server.lines[0].listener.close()
        for each in stops:
            assert isinstance(outcome(each), LinkDownError)
        assert flaky.tries == 1


@each_local_face
def test_stop_reopens_a_lost_port_that_other_calls_wait_for(kind):
    with opened(kind) as (face, on):
        assert face.result(LIVE[1], "status").word
        flaky = face.bus.line.open_port = Flaky(face.bus.line.open_port)
        flaky.gone = True
        lost, closed = face.bus.line.port, []
        close = lost.close
        lost.write, lost.close = cut, lambda: closed.append(close())
        for _ in range(3):
            assert isinstance(outcome(face.call(LIVE[1], "status")), LinkDownError)
        assert (flaky.tries, len(closed)) == (1, 1)
        flaky.gone, before = False, len(on.requests)
        assert "opened again in" in str(outcome(face.call(LIVE[1], "status")))
        assert outcome(face.call(LIVE[2], "stop")) is None
        assert on.asked(before) == [LIVE[2]]
        assert face.result(LIVE[1], "status").word


# Lending


def sit(_port, lent):
    lent.wait(lent.now() + 10)


@pytest.mark.parametrize("kind", ["threads", "tasks"])
def test_stop_takes_back_a_lent_port(kind):
    with opened(kind) as (face, on):
        came = threading.Event()

        def work(port, lent):
            came.set()
            sit(port, lent)

        lending = face._begin(face.bus, "lend", work)
        assert came.wait(5)
        stopping = face.call(LIVE[1], "stop")
        error = outcome(lending)
        assert isinstance(error, LinkDownError)
        assert "a stop goes first" in str(error)
        assert outcome(stopping) is None
        assert on.asked() == [LIVE[1]]


def test_cancelled_borrower_gives_back_a_lent_port():
    with opened("tasks") as (face, _):
        came = threading.Event()

        def work(port, lent):
            came.set()
            sit(port, lent)

        lending = face._begin(face.bus, "lend", work)
        assert came.wait(5)
        lending.cancel()
        assert face.result(LIVE[1], "status").word


@pytest.mark.parametrize("kind", ["threads", "tasks"])
def test_borrower_of_a_port_has_the_line_alone(kind):
    with opened(kind) as (face, on):
        came, leave = threading.Event(), threading.Event()

        def work(_port, _lent):
            came.set()
            return leave.wait(5)

        lending = face._begin(face.bus, "lend", work)
        assert came.wait(5)
        (reading,) = queued(face, (LIVE[1], "status"))
        assert on.asked() == []
        leave.set()
        assert outcome(lending) is None
        assert outcome(reading) is None
