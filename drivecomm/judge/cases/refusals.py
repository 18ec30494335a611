"""Cases of refusals by the drive: the master must report them, and must not repeat a refused request."""

from __future__ import annotations

import re
from functools import partial
from typing import TYPE_CHECKING

from drivecomm.judge.cases.drive_preparation import prepare_drive
from drivecomm.judge.cases.value_checks import must_end, shown_by, watch_time_s
from drivecomm.judge.catalogue import case
from drivecomm.judge.judged_drive import key_of
from drivecomm.judge.learned_behaviour import says_success
from drivecomm.judge.verdicts import NotTried, fail
from drivecomm.protocol import Refuses

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from drivecomm.judge.judged_drive import ObservedRequest
    from drivecomm.judge.known_drive import KnownDrive
    from drivecomm.judge.order import JudgeOrder
    from drivecomm.judge.stand import JudgeLine
    from drivecomm.judge.trial import CaseContext
    from drivecomm.protocol import Framed, VirtualReply

_ASKS_AGAIN = re.compile(
    r"busy|in progress|still working|not ready|not now|again|damaged|check ?sum|parity|framing|overrun|syntax|"
    r"too long to arrive|took too long|acknowledge",
    re.IGNORECASE,
)
"""Words in a code's text that make a repetition of the request sensible."""
_ALL_CODES_OF = ("read", "write", "run", "start", "stop", "reset")
"""Order of preference: the first task that the master has, and writes, are refused with every code, others with one."""


def _codes(known: KnownDrive, order: JudgeOrder, task: str) -> Iterator[tuple[str, str, int]]:
    """Yield the name, title and code of a case for each code that means a refusal."""
    codes = {code: text for code, text in known.refusals.items() if not _is_none(text)}
    first = next(name for name in _ALL_CODES_OF if order.task(name))
    wanted = list(codes) if task in (first, "write") else list(codes)[:1]
    for code in wanted:
        yield f"-{code}", f" with code {code}, {codes[code]}", code


def _is_none(text: str) -> bool:
    return text.lower() in ("no error", "not used", "none")


@case("refused", "read", "write", "start", "stop", "reset", "run", title="the drive refuses it", each=_codes)
def refused(trial: CaseContext, code: int) -> str:
    """The master reports an error, shows no value, and does not repeat the refused request."""
    known, task = trial.known, trial.task.name
    wanted = _decisive(trial)
    refused: list[ObservedRequest] = []
    with trial.stand(partial(prepare_drive, trial)) as stand:
        stand.drive.between = _refusing(stand, wanted, code)
        run = trial.run(stand, within_s=watch_time_s(trial))
        refused = [each for each in stand.drive.since() if wanted(each.find)]
        was_refused = bool(stand.drive.refused_with)
    if not refused or not was_refused:
        raise NotTried("it sent nothing that drives of this protocol refuse with this code")
    text = f"{code}, {known.refusals[code]!r}"
    if task in ("read", "run") and (shown := shown_by(trial, run)):
        fail(f"it ignored an error code: it shows {shown[0][1].text}, and the drive refused with {text}")
    must_end(trial, run)
    if task not in ("read", "run") and says_success(run, trial.learned):
        fail(f"it ignored an error code: the drive refused with {text}, and its output is the same as on success")
    keys = [each.key for each in refused]
    times = keys.count(keys[0])
    usual = trial.learned.keys.get(keys[0], 1)
    if not trial.goes_on and task != "stop" and times > usual and not _may_be_repeated(known, code):
        fail(f"it sent a request {times} times, although the drive had refused it with {text}")
    return "it reported an error" if run.text.strip() or run.code else "it showed nothing"


@case(
    "after-refusal",
    "write",
    "start",
    "stop",
    "read",
    title="the drive refuses the first attempt, and the master is asked to repeat it",
)
def after_refusal(trial: CaseContext) -> str:
    """The next task after a refusal works as before, even if a drive first requires its error to be read."""
    codes = [code for code, text in trial.known.refusals.items() if not _is_none(text) and not _ASKS_AGAIN.search(text)]
    if not codes:
        raise NotTried("this protocol has no known refusals")
    wanted, task = _decisive(trial), trial.task.name
    with trial.stand(partial(prepare_drive, trial)) as stand:
        stand.drive.between = _refusing(stand, wanted, codes[0])
        trial.run(stand, within_s=watch_time_s(trial))
        if not stand.drive.refused_with:
            raise NotTried("it sent nothing that drives of this protocol refuse")
        stand.drive.between = lambda _, act: act()
        before = len(stand.drive.since())
        run = trial.run(stand, within_s=watch_time_s(trial))
        heard = stand.drive.since(before)
        motor = stand.drive.motor
    if not heard:
        fail("it sent nothing when it had to repeat the task after a refusal")
    if task == "read":
        if trial.learned.displays and not trial.goes_on and not shown_by(trial, run):
            fail("it shows no value after a refusal, though the drive answers again")
        return "it shows the value again"
    worked = {
        "start": any(each.started for each in heard),
        "stop": any(each.stopped for each in heard) or not motor.running,
        "write": any(wanted(each.find) and _accepted(trial, each) for each in heard),
    }[task]
    if not worked:
        fail(
            f"its next {task} after a refusal has no effect: the drive keeps refusing, because what it needs after a "
            "refusal was not done (some drives want their error register read)"
        )
    return f"its next {task} works"


def _accepted(trial: CaseContext, heard: ObservedRequest) -> bool:
    """Whether the drive gave the same reply to a request as a new drive would."""
    return heard.reply is not None and heard.reply == trial.known.answer(heard.find, {})


def _decisive(trial: CaseContext) -> Callable[[Framed], bool]:
    """Return a test for the requests that carry out the task: the read, the write, the start or the stop."""
    known, learned, task = trial.known, trial.learned, trial.task.name
    if task in ("read", "run"):
        if not learned.displays:
            raise NotTried("it is not known which of its requests asks for a value")
        return lambda find: bool(set(known.parameters_read_by(find)) & set(learned.displays)) or _reads(trial, find)
    if task == "write":
        return lambda find: known.parameter_written_by(find) == learned.written
    keys = {each.key for each in (*learned.starts, *learned.stops)}
    if keys:
        return lambda find: key_of(find.message) in keys
    return lambda find: not known.only_asks(find)


def _reads(trial: CaseContext, find: Framed) -> bool:
    return any(trial.known.reads(key_of(find.message), each) for each in trial.learned.displays)


def _refusing(
    stand: JudgeLine, wanted: Callable[[Framed], bool], code: int
) -> Callable[[Framed, Callable[[], VirtualReply | None]], VirtualReply | None]:
    drive = stand.drive
    if not isinstance(drive.inner, Refuses):
        raise NotTried("virtual drives of this protocol cannot be made to refuse")

    def between(find: Framed, act: Callable[[], VirtualReply | None]) -> VirtualReply | None:
        return (drive.refuse(find, code, stand.line.time) if wanted(find) else None) or act()

    return between


def _may_be_repeated(known: KnownDrive, code: int) -> bool:
    codes = {str(each) for all_of in known.plugin.line_errors.values() for each in all_of}
    return str(code) in codes or f"{code:02d}" in codes or _ASKS_AGAIN.search(known.refusals[code]) is not None
