"""The queue of one line, without threads or tasks: the next caller, and callers that are passed over."""

from itertools import pairwise, permutations

import pytest

from drivecomm.errors import UsageError
from drivecomm.line import TURNS_PER_POLL, TURNS_PER_SURVEY, LineQueue, Place, Rank


class Caller(Place):
    """A caller under control of the test."""

    def __init__(self, rank, name="", *, caller=None, behind=False):
        super().__init__(rank, caller or object(), behind=behind)
        self.name = name or rank.name
        self.alive = True
        self.woken = 0
        self.asked_to_give_way = 0

    def __repr__(self):
        return self.name

    def is_alive(self):
        return self.alive

    def begin_waiting(self):
        assert not self.woken

    def wake(self):
        self.woken += 1

    def give_way(self):
        self.asked_to_give_way += 1


@pytest.fixture
def queue():
    return LineQueue()


@pytest.fixture
def owner(queue):
    """Return the caller that has the line."""
    has = Caller(Rank.READ, "owner")
    assert queue.ask(has)
    return has


def asked(queue, *callers):
    for each in callers:
        assert not queue.ask(each)
    return callers


def end(queue, place):
    place.alive = False
    queue.hand_on()


def served(queue):
    """End one turn after the other; return the names of their callers."""
    order = []
    end(queue, queue.owner)
    while queue.owner is not None:
        order.append(queue.owner.name)
        assert queue.owner.woken == 1
        end(queue, queue.owner)
    return order


def test_free_line_is_taken_immediately(queue):
    first = Caller(Rank.POLL)
    assert queue.ask(first)
    assert not first.woken
    assert not queue.ask(Caller(Rank.STOP))


@pytest.mark.usefixtures("owner")
def test_callers_are_served_by_rank_and_then_in_order(queue):
    ranks = (Rank.POLL, Rank.READ, Rank.COMMAND, Rank.READ, Rank.STOP, Rank.POLL, Rank.STOP)
    asked(queue, *(Caller(rank, f"{rank.name} {number}") for number, rank in enumerate(ranks)))
    assert served(queue) == ["STOP 4", "STOP 6", "COMMAND 2", "READ 1", "POLL 0", "READ 3", "POLL 5"]


@pytest.mark.usefixtures("owner")
def test_place_with_behind_comes_after_all_others_of_its_rank(queue):
    asked(queue, Caller(Rank.STOP, "dead", behind=True), Caller(Rank.STOP, "runs"), Caller(Rank.READ, "read"))
    assert served(queue) == ["runs", "dead", "read"]


def test_newcomer_does_not_overtake_a_waiting_caller_between_two_turns(queue, owner):
    """The turn is over, and the line was not handed on yet."""
    waiting, newcomer = Caller(Rank.READ, "waiting"), Caller(Rank.READ, "newcomer")
    asked(queue, waiting)
    owner.alive = False
    assert not queue.ask(newcomer)
    assert queue.has_come(waiting)


@pytest.mark.usefixtures("owner")
@pytest.mark.parametrize("gone", range(3))
def test_caller_that_leaves_does_not_change_the_order_of_the_others(queue, gone):
    callers = asked(queue, *(Caller(Rank.READ, str(number)) for number in range(3)))
    assert queue.leave(callers[gone])
    assert queue.leave(callers[gone])
    assert served(queue) == [str(number) for number in range(3) if number != gone]


def test_leave_reports_a_turn_that_has_come(queue, owner):
    (waiting,) = asked(queue, Caller(Rank.READ))
    end(queue, owner)
    assert not queue.leave(waiting)


@pytest.mark.usefixtures("owner")
@pytest.mark.parametrize("order", list(permutations(range(3))))
def test_dead_caller_is_passed_over(queue, order):
    callers = [Caller(rank) for rank in (Rank.STOP, Rank.COMMAND, Rank.READ)]
    asked(queue, *(callers[number] for number in order))
    callers[0].alive = False
    assert not queue.stop_waits()
    assert served(queue) == ["COMMAND", "READ"]
    assert not callers[0].woken


def test_owner_that_died_silently_is_replaced(queue, owner):
    owner.alive = False
    assert queue.ask(Caller(Rank.POLL))


def test_only_a_stop_makes_the_owner_give_way(queue, owner):
    asked(queue, Caller(Rank.COMMAND), Caller(Rank.READ), Caller(Rank.POLL))
    assert (owner.asked_to_give_way, queue.stop_waits()) == (0, False)
    asked(queue, Caller(Rank.STOP))
    assert (owner.asked_to_give_way, queue.stop_waits()) == (1, True)


@pytest.mark.usefixtures("owner")
def test_waits_is_true_for_the_rank_of_a_waiting_caller_and_lower_ones(queue):
    asked(queue, Caller(Rank.COMMAND))
    assert [queue.waits(rank) for rank in Rank] == [False, True, True, True, True]


def test_owner_that_calls_again_is_refused(queue, owner):
    with pytest.raises(UsageError, match="a trace function cannot use the bus that calls it"):
        queue.ask(Caller(Rank.READ, caller=owner.caller))
    assert queue.waiting == []


def test_caller_whose_last_turn_is_over_may_call_again(queue, owner):
    again = Caller(Rank.READ, caller=owner.caller)
    asked(queue, Caller(Rank.COMMAND))
    owner.alive = False
    assert not queue.ask(again)
    assert served(queue)[-1] == "READ"


class Crowd:
    """Callers that queue again as soon as their turn is over, so that the line is never free."""

    def __init__(self, queue, *ranks):
        self.queue, self.served = queue, []
        for rank in ranks:
            queue.ask(Caller(rank))

    def serve(self, turns):
        for _ in range(turns):
            over = self.queue.owner
            self.served.append(over.rank)
            self.queue.waiting.append(again := Caller(over.rank))
            again.order = 10**6 + len(self.served)
            end(self.queue, over)
        return self.served


def turns_of(served, rank):
    return [number for number, each in enumerate(served) if each is rank]


def test_polls_keep_a_share_of_a_line_flooded_by_reads(queue):
    served = Crowd(queue, *[Rank.READ] * 40, Rank.POLL).serve(400)
    assert {later - earlier for earlier, later in pairwise(turns_of(served, Rank.POLL))} == {TURNS_PER_POLL}


def test_surveys_keep_a_share_of_a_line_flooded_by_reads_and_polls(queue):
    served = Crowd(queue, *[Rank.READ] * 40, *[Rank.POLL] * 3, Rank.SURVEY).serve(400)
    surveys, reads = turns_of(served, Rank.SURVEY), turns_of(served, Rank.READ)
    assert max(later - earlier for earlier, later in pairwise(surveys)) <= TURNS_PER_SURVEY + 1
    assert max(later - earlier for earlier, later in pairwise(reads)) <= 4
    assert min(len(turns_of(served, rank)) for rank in (Rank.READ, Rank.POLL)) >= 400 // 3


def test_polls_leave_surveys_a_share(queue):
    served = Crowd(queue, *[Rank.POLL] * 3, Rank.SURVEY).serve(400)
    assert {later - earlier for earlier, later in pairwise(turns_of(served, Rank.SURVEY))} == {TURNS_PER_SURVEY}


@pytest.mark.parametrize("urgent", [Rank.STOP, Rank.COMMAND])
def test_stops_and_commands_share_the_line_with_no_lower_rank(queue, urgent):
    assert set(Crowd(queue, *[urgent] * 3, Rank.READ, Rank.POLL, Rank.SURVEY).serve(100)) == {urgent}


def test_unused_share_of_polls_is_not_saved_up(queue):
    crowd = Crowd(queue, Rank.READ, Rank.READ)
    crowd.serve(50)
    queue.ask(Caller(Rank.POLL))
    assert turns_of(crowd.serve(3), Rank.POLL) == [50 + TURNS_PER_POLL]
