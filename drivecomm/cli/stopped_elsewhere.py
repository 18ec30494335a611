"""`stop` for a drive whose line another program of ours holds: that one stops it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.cli.asking_start import WhatToStop, stopped_by_its_keeper
from drivecomm.cli.output import emit, say
from drivecomm.cli.stoppable import reached_for_stopping

if TYPE_CHECKING:
    from drivecomm.cli.asking_start import Answer
    from drivecomm.cli.line_options import LineOptions
    from drivecomm.protocol import Stop


def stopped_elsewhere(line: LineOptions, drive: str, model: str | None, how: Stop) -> bool:
    """Have a drive, or all of a protocol, stopped by the `start` that holds the line; False when there is none.

    Raises the error that the drive or its line answered with.
    """
    chosen = {"model": model} if model else {}
    protocol, colon, address = drive.partition(":")
    if colon and address == "*":
        reached, what = line, WhatToStop(how=how, protocols=((protocol, chosen),))
    else:
        reached, name, _ = reached_for_stopping(line, drive)
        one = (name.name, name.protocol, name.address, {**name.options, **chosen})
        what = WhatToStop(how=how, drives=(one,))
    answers: list[Answer] = []
    keeper = stopped_by_its_keeper(reached.named_port, what, answers.append, reached.opening)
    if keeper is None:
        return False
    for answer in answers:
        if answer.error is not None:
            raise answer.error
        told = "commanded" if answer.drive else "sent to all; nobody confirms a broadcast"
        instead = "" if answer.how is how else f", because it cannot by {how.value}"
        done = f"stop ({answer.how.value}{instead}) {told}"
        who = answer.drive or f"{answer.protocol}:*"
        if line.json:
            emit(drive=who, done=done, result=None, by=str(keeper))
        else:
            say(f"{who}  {done}, by {keeper}")
    return True
