"""Freshness of commands: old ones are refused, and repeated ones are carried out once."""

import asyncio
import math
from dataclasses import replace

import pytest
from hypothesis import given, strategies as st

from drivecomm.errors import LeaseError, NotAllowedError, UsageError
from drivecomm.server.callers import Caller, Role
from drivecomm.server.door import CommandAnswer, CommandRequest
from drivecomm.server.freshness import check_fresh
from drivecomm.server.repeats import MOST, REMEMBERED_S, AnswerCache

NOW_S = 1_790_000_000.0
START = CommandRequest(drive="pump", verb="start", id="1")
ANNA = Caller(name="anna", role=Role.OPERATE, door="http")
BEN = Caller(name="ben", role=Role.OPERATE, door="http")


def fresh(command, time_s=NOW_S, waited_s=0.0):
    try:
        check_fresh(command, session="now", time_s=time_s, waited_s=waited_s)
    except NotAllowedError:
        return False
    return True


def test_undated_command_expires_after_two_seconds_in_the_queue():
    assert fresh(START)
    assert fresh(START, waited_s=2.0)
    assert not fresh(START, waited_s=2.1)
    assert fresh(replace(START, valid_s=10), waited_s=9)


def test_command_of_an_earlier_session_is_refused():
    assert fresh(replace(START, session="now"))
    with pytest.raises(NotAllowedError, match="meant for an earlier run of the server; read its session again"):
        check_fresh(replace(START, session="before"), session="now", time_s=NOW_S)


@pytest.mark.parametrize("valid_s", [0, -1, 10.1, math.inf, math.nan, "2", None])
def test_invalid_validity_time_is_refused(valid_s):
    with pytest.raises(UsageError, match="give seconds above 0, at most 10"):
        check_fresh(replace(START, valid_s=valid_s), session="now", time_s=NOW_S)


@pytest.mark.parametrize("issued_s", [math.inf, math.nan, "now"])
def test_invalid_issue_time_is_refused(issued_s):
    with pytest.raises(UsageError, match="give seconds since 1970"):
        check_fresh(replace(START, issued_s=issued_s), session="now", time_s=NOW_S)


@given(issued=st.floats(-1e5, 1e5), valid_s=st.floats(0.1, 10), waited_s=st.floats(0, 20), set_by=st.floats(-1e5, 1e5))
def test_old_command_never_passes_with_any_clock_offsets(issued, valid_s, waited_s, set_by):
    """set_by: seconds by which the server's clock was set while the command waited."""
    command = replace(START, issued_s=NOW_S + issued, valid_s=valid_s)
    time_s = NOW_S + waited_s + set_by
    passed = fresh(command, time_s, waited_s)
    assert passed == (waited_s <= valid_s and abs(time_s - command.issued_s) <= valid_s)
    assert fresh(replace(command, verb="stop", session="before"), time_s, waited_s), "a stop is never too old"


def test_refusal_names_the_age_of_the_command():
    with pytest.raises(NotAllowedError, match=r"given 3600.0 s ago and is valid for only 2 s; it was not sent"):
        check_fresh(replace(START, issued_s=NOW_S - 3600), session="now", time_s=NOW_S)
    with pytest.raises(NotAllowedError, match=r"is dated in the future by 3600.0 s; set the clock"):
        check_fresh(replace(START, issued_s=NOW_S + 3600), session="now", time_s=NOW_S)
    with pytest.raises(NotAllowedError, match=r"had to wait for 3.0 s and is valid for only 2 s"):
        check_fresh(START, session="now", time_s=NOW_S, waited_s=3)


class Acting:
    """Callable that counts how often a command acts."""

    def __init__(self):
        self.times = 0
        self.go_on = asyncio.Event()
        self.go_on.set()
        self.fails = None

    async def __call__(self):
        self.times += 1
        mine = self.times
        await self.go_on.wait()
        if self.fails:
            raise self.fails
        return CommandAnswer(id="1", outcome="done", result=mine)


def run(test):
    return asyncio.run(test())


def test_repeated_command_gets_the_first_result():
    async def test():
        time = [0.0]
        repeats, act = AnswerCache(lambda: time[0]), Acting()
        assert (await repeats.once(ANNA, START, act)).result == 1
        time[0] = REMEMBERED_S - 1
        assert (await repeats.once(ANNA, START, act)).result == 1
        assert (await repeats.once(BEN, START, act)).result == 2, "ids are separate for each caller"
        assert (await repeats.once(replace(ANNA, door="mqtt"), START, act)).result == 3
        time[0] = REMEMBERED_S
        assert (await repeats.once(ANNA, START, act)).result == 4, "the result is forgotten after a while"

    run(test)


def test_commands_without_an_id_all_act():
    async def test():
        repeats, act = AnswerCache(), Acting()
        assert [(await repeats.once(ANNA, replace(START, id=""), act)).result for _ in range(3)] == [1, 2, 3]

    run(test)


def test_remembered_error_has_no_traceback():
    """The frames of a traceback would keep their local variables alive."""

    def refuse():
        raise NotAllowedError("not now") from KeyError("why")

    async def act():
        try:
            refuse()
        except NotAllowedError as error:
            return CommandAnswer(id="1", outcome="refused", error=error)

    async def test():
        repeats = AnswerCache()
        await repeats.once(ANNA, START, act)
        answer = await repeats.once(ANNA, START, act)
        assert str(answer.error) == "not now"
        assert answer.error.__traceback__ is None
        assert isinstance(answer.error.__cause__, KeyError)

    run(test)


def test_repetition_waits_for_the_running_command():
    async def test():
        repeats, act = AnswerCache(), Acting()
        act.go_on.clear()
        first, second = (asyncio.create_task(repeats.once(ANNA, START, act)) for _ in range(2))
        await asyncio.sleep(0)
        await asyncio.sleep(0)
        assert (act.times, first.done(), second.done()) == (1, False, False)
        # A cancelled caller does not cancel the command for the other one.
        first.cancel()
        act.go_on.set()
        assert (await second).result == 1
        assert act.times == 1

    run(test)


def test_id_reused_for_another_command_is_refused():
    async def test():
        repeats, act = AnswerCache(), Acting()
        await repeats.once(ANNA, START, act)
        for other in (
            replace(START, drive="fan"),
            replace(START, verb="reset"),
            replace(START, line="x"),
            replace(START, arguments={"reverse": True}),
        ):
            with pytest.raises(UsageError, match="the id '1' was used for another command"):
                await repeats.once(ANNA, other, act)
        assert (await repeats.once(ANNA, replace(START, issued_s=3.0, lease="key"), act)).result == 1
        with pytest.raises(UsageError, match="at most 200 characters"):
            await repeats.once(ANNA, replace(START, id="x" * 201), act)
        assert act.times == 1

    run(test)


def test_order_of_arguments_does_not_matter_and_long_ones_are_not_stored():
    async def test():
        repeats, act = AnswerCache(), Acting()
        reference = replace(START, arguments={"percent": 40, "junk": "y" * 60_000})
        await repeats.once(ANNA, reference, act)
        again = replace(reference, arguments=dict(reversed(reference.arguments.items())))
        assert (await repeats.once(ANNA, again, act)).result == 1
        known = [once for of_caller in repeats._known.values() for once in of_caller.values()]
        assert all(len(repr(once.asked)) < 200 for once in known)

    run(test)


def test_repetition_of_a_refused_command_is_refused():
    """Otherwise a replay of a refused command could be carried out later."""

    async def test():
        repeats, act = AnswerCache(), Acting()
        act.fails = LeaseError("pump is commanded by ben")
        for _ in range(2):
            with pytest.raises(LeaseError, match="pump is commanded by ben"):
                await repeats.once(ANNA, START, act)
        assert act.times == 1

    run(test)


def test_internal_error_is_not_remembered_as_a_result():
    async def test():
        repeats, act = AnswerCache(), Acting()
        act.fails = RuntimeError("a mistake")
        with pytest.raises(RuntimeError):
            await repeats.once(ANNA, START, act)
        act.fails = None
        assert (await repeats.once(ANNA, START, act)).result == 2

    run(test)


@pytest.mark.soak
def test_number_of_remembered_commands_is_limited():
    async def test():
        repeats, act = AnswerCache(lambda: 0.0), Acting()
        for number in range(MOST + 5):
            await repeats.once(ANNA, replace(START, id=str(number)), act)
        await repeats.once(ANNA, replace(START, id="5"), act)
        assert act.times == MOST + 5, "the oldest are forgotten first"
        await repeats.once(ANNA, replace(START, id="4"), act)
        assert act.times == MOST + 6

    run(test)
