"""Exploration of a drive, address by address, by reads that cannot move a motor; may take hours.

A refusal counts as an answer. Requests to a drive that falls silent are repeated after a pause. The answers so far
are recorded, so that a later run resumes from there. Other callers may use the line between two requests.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

from drivecomm.bus import ask_status, sleep_until
from drivecomm.commissioning.exploring.answers import AddressAnswer
from drivecomm.errors import (
    DamagedReplyError,
    DriveError,
    NoReplyError,
    OvertakenError,
    ParameterAddressError,
    RefusedError,
    ReplyError,
    UnexpectedReplyError,
    in_one_line,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from drivecomm.bus import Procedure
    from drivecomm.commissioning.exploring.exploration_plan import ExplorationPlan
    from drivecomm.commissioning.exploring.logbook import AnswerRecord

PAUSES_S = (1.0, 2.0, 5.0, 10.0, 30.0)
"""Pauses in seconds between requests to a silent drive; replacing a fuse or a restart takes less than their sum."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ExplorationStep:
    """Progress of an exploration.

    answer: the latest answer. asked: number of addresses done, including those of an earlier run. of: number of all
    addresses. found: number of addresses with a value. remembered: whether the answer comes from an earlier run, so
    that it took no time.
    """

    answer: AddressAnswer
    asked: int
    of: int
    found: int
    remembered: bool


Progress: TypeAlias = "Callable[[ExplorationStep], None]"
"""Callback for each step of an exploration."""

Asks: TypeAlias = "Callable[[str], Callable[[Any], Any]]"
"""Function that returns the request for an address; the result of that request is the drive's answer."""


def unseen(_step: ExplorationStep) -> None:
    """Ignore a step; default callback."""


def exploring(
    way: ExplorationPlan, asks: Asks, logbook: AnswerRecord, progress: Progress
) -> Procedure[list[AddressAnswer]]:
    """Request all addresses of an exploration plan; return the answers in its order.

    Raises NoReplyError if the drive stays silent, and LinkError if the line is lost.
    """
    work = _Work(way, asks, logbook, progress)
    yield from work.each(way.known)
    for address in way.rest:
        answer = yield from work.one(address)
        yield from work.elements(answer)
    return list(work.answers.values())


class _Work:
    """Exploration in progress. answers: answers by the key of their address."""

    def __init__(self, way: ExplorationPlan, asks: Asks, logbook: AnswerRecord, progress: Progress) -> None:
        self.answers: dict[str, AddressAnswer] = {}
        self._way = way
        self._asks = asks
        self._logbook = logbook
        self._progress = progress
        self._of = len(way)
        self._found = 0

    def each(self, addresses: Iterable[str]) -> Procedure[None]:
        for address in addresses:
            yield from self.one(address)

    def one(self, address: str) -> Procedure[AddressAnswer]:
        """Return the drive's answer for an address, now or from an earlier request."""
        key = self._way.key(address)
        if key in self.answers:
            return self.answers[key]
        before = self._logbook.answers.get(address)
        if before is None:
            answer = yield from self._asked(address)
            self._logbook.add(answer)
        else:
            answer = before
        self.answers[key] = answer
        self._found += answer.told is not None
        self._of = max(self._of, len(self.answers))
        self._progress(
            ExplorationStep(
                answer=answer,
                asked=len(self.answers),
                of=self._of,
                found=self._found,
                remembered=before is not None,
            )
        )
        return answer

    def elements(self, of: AddressAnswer) -> Procedure[None]:
        """Request the elements of a parameter that may have elements."""
        if of.told is None and of.code is None:
            return
        known = self._way.elements(of.address, of.code)
        for run in known.runs:
            for place, address in enumerate(run):
                if self._way.key(address) in self._way.taken:
                    continue
                answer = yield from self.one(address)
                if answer.told is None:
                    break
                if place == 0 and known.beyond and (yield from self._looks_at_no_element(known.beyond)):
                    self._forget(address)
                    self._forget(known.beyond)
                    return

    def _looks_at_no_element(self, beyond: str) -> Procedure[bool]:
        answer = yield from self.one(beyond)
        return answer.told is not None

    def _forget(self, address: str) -> None:
        """Remove an answer that in fact belongs to the plain address."""
        del self.answers[self._way.key(address)]
        self._found -= 1

    def _asked(self, address: str) -> Procedure[AddressAnswer]:
        for pause_s in PAUSES_S:
            answer = yield from self._maybe_answered(address)
            if answer is not None:
                return answer
            now: float = yield lambda drive: drive.bus.now()
            yield sleep_until(now + pause_s)
        answer = yield from self._maybe_answered(address)
        if answer is not None:
            return answer
        waited_s = sum(PAUSES_S)
        raise NoReplyError(f"the drive fell silent before {address}, and stayed so for {waited_s:g} s")

    def _maybe_answered(self, address: str) -> Procedure[AddressAnswer | None]:
        """Send one request; return None if the drive is silent."""
        try:
            told = yield self._asks(address)
        except RefusedError as error:
            absent = error.code in self._way.absent
            return AddressAnswer(address=address, absent=absent, code=error.code, reason=in_one_line(error))
        except ParameterAddressError as error:
            # The options of this drive allow fewer addresses than its model, so no telegram can carry this one.
            return AddressAnswer(address=address, absent=True, reason=in_one_line(error))
        except DriveError as error:
            return AddressAnswer(address=address, reason=in_one_line(error))
        except OvertakenError:
            # A stop took precedence and this request was not sent.
            return (yield from self._maybe_answered(address))
        except (UnexpectedReplyError, DamagedReplyError) as error:
            return AddressAnswer(address=address, reason=in_one_line(error))
        except ReplyError as error:
            if (yield from is_there()):
                # Some drives stay silent instead of refusing an unknown address.
                return AddressAnswer(address=address, absent=True, reason=in_one_line(error))
            return None
        return AddressAnswer(address=address, told=told)


def is_there() -> Procedure[bool]:
    """Return whether the drive answers another request, so that its silence concerned only one parameter."""
    try:
        yield ask_status()
    except ReplyError:
        return False
    except DriveError:
        return True
    return True
