"""Cases of behaviour on the line: pauses and line settings of a master."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

from drivecomm.judge.cases.drive_preparation import prepare_drive
from drivecomm.judge.cases.value_checks import watch_time_s
from drivecomm.judge.catalogue import case
from drivecomm.judge.verdicts import NotTried, fail

if TYPE_CHECKING:
    from drivecomm.judge.trial import CaseContext
    from drivecomm.virtual import Violation

_TIMES = 3
_SETTINGS = "line settings"


@case("timing", "read", "write", "start", "stop", "reset", "run", title="its pauses are measured")
def timing(trial: CaseContext) -> str:
    """The master keeps the pauses that the maker demands, and waits for every reply."""
    broken = [each for each in _violations(trial, 1 if trial.goes_on else _TIMES) if each.rule != _SETTINGS]
    demanded = [each for each in broken if each.demanded]
    if demanded:
        rule, times = Counter(each.rule for each in demanded).most_common(1)[0]
        worst = next(each for each in demanded if each.rule == rule)
        fail(f"it does not keep to the timing of the line, {times} times ({rule}): {worst}")
    if broken:
        return f"it observes the required pauses; {broken[0]}"
    return "it observes the necessary pauses"


@case("settings", "read", "write", "start", "stop", "reset", "run", title="its line settings are looked at")
def settings(trial: CaseContext) -> str:
    """The master uses the line settings of the drive, as far as the port shows them."""
    for each in _violations(trial, 1):
        if each.rule == _SETTINGS:
            fail(f"its line settings are wrong: {each}")
    if trial.order.listen.startswith("rfc2217"):
        return "they are those of the drive"
    if trial.order.listen.startswith("tcp"):
        raise NotTried("a TCP connection carries no line settings; judge it with --listen rfc2217")
    return "speed and stop bits are those of the drive; a pseudo-terminal does not show data bits and parity"


def _violations(trial: CaseContext, times: int) -> list[Violation]:
    found: list[Violation] = []
    heard = 0
    for _ in range(times):
        with trial.stand(lambda drive: prepare_drive(trial, drive)) as stand:
            trial.run(stand, within_s=watch_time_s(trial))
            heard += len(stand.drive.since())
            found += stand.violations
    if not heard and not found:
        raise NotTried("it sent nothing that the drive understands")
    return found
