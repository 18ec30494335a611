"""Check of ambiguous replies: for every two requests to one drive, whether the reply to one passes for the other."""

from __future__ import annotations

from decimal import Decimal
from functools import partial
from typing import TYPE_CHECKING

from drivecomm.protocol import fields_of
from drivecomm.testing.checking import check, raise_all
from drivecomm.testing.direct_conversation import DirectConversation

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from drivecomm.protocol import Exchange, Message, Model, Operations, Protocol
    from drivecomm.testing.direct_conversation import AnsweredRequest

_WRITES = 24


@check("confusion")
def a_question_that_anothers_answer_fits_is_declared(plugin: Protocol, model: Model) -> None:
    """A request is sent as `nameless` if another request's reply passes for its own, and never as `distinct` then.

    Refusals are not compared: most protocols do not name what they refuse, and a late refusal only raises an error.
    Reads and writes of the same parameter are not compared either, nor two writes to it: their replies may be equal.
    """
    wrong = []
    asked, telling = _all_questions(plugin, model)
    for mine in asked:
        if mine.ask.nameless:
            continue
        passing = next((each for each in asked if each.answer.kind in telling and _passes(plugin, mine, each)), None)
        if passing is not None:
            is_asked = "which is asked as distinct" if mine.ask.distinct else "which is not asked as nameless"
            wrong.append(
                f"an answer in {passing.verb} passes for that to {mine.ask.message} in {mine.verb}, {is_asked}"
            )
    raise_all(wrong)


def _passes(plugin: Protocol, mine: AnsweredRequest, other: AnsweredRequest) -> bool:
    if other.ask.message == mine.ask.message or _are_of_one_place(mine, other):
        return False
    return not plugin.mismatch(mine.ask.message, other.answer)


def _are_of_one_place(mine: AnsweredRequest, other: AnsweredRequest) -> bool:
    """Whether one request reads the parameter that the other writes, or both write a value to the same parameter."""
    (verb, _, parameter), (other_verb, _, other_parameter) = (each.verb.partition(" ") for each in (mine, other))
    if verb != other_verb and parameter == other_parameter:
        return True
    asks, asks_other = fields_of(mine.ask.message), fields_of(other.ask.message)
    differing = [name for name in asks.keys() | asks_other.keys() if asks.get(name) != asks_other.get(name)]
    return mine.ask.acts and other.ask.acts and len(differing) == 1


def _all_questions(plugin: Protocol, model: Model) -> tuple[list[AnsweredRequest], set[str]]:
    """Return the requests of all reads, some writes, status and identify, and the kinds of reply that carry values."""
    talk = DirectConversation(plugin, model)
    asked: dict[tuple[Message, bool, bool], AnsweredRequest] = {}
    telling = set()
    for verb, begin in _verbs(talk.operations, model):
        pairs, succeeded = talk.over(verb, begin)
        # Status and identify may be refused on the way, so their replies do not define the kinds.
        if succeeded and verb.startswith(("read ", "write ")):
            telling |= {each.answer.kind for each in pairs}
        for each in pairs:
            asked.setdefault((each.ask.message, each.ask.nameless, each.ask.distinct), each)
    return list(asked.values()), telling


def _verbs(operations: Operations, model: Model) -> Iterator[tuple[str, Callable[[], Exchange[object]]]]:
    for info in model.parameters.values():
        yield f"read {info.address}", partial(operations.read, info.address)
    yield "status", operations.status
    yield "identify", operations.identify
    writable = [each for each in model.parameters.values() if "w" in each.access and isinstance(each.start, Decimal)]
    for info in writable[:_WRITES]:
        for store in (False, True):
            yield f"write {info.address}", partial(operations.write, info.address, info.start, store=store)
