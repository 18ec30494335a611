"""What an undisturbed run of a task shows: what the master asks, what it changes, and what it prints."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Hashable, Mapping

    from drivecomm.judge.drive import Heard
    from drivecomm.judge.process import Run
    from drivecomm.judge.shown import Display


@dataclass(frozen=True, slots=True, kw_only=True)
class Learned:
    """What one task does where nothing is disturbed.

    goes_on: whether it goes on until it is ended. saying: what it says when all is well, see `saying`. keys: how often
    each request came. displays: how it shows the parameters that it reads, by address. raws: two values for each of
    these. starts, stops: the requests that made the motor run, and stop. written: the parameter that it writes.
    """

    goes_on: bool
    saying: tuple[int | None, frozenset[str]]
    keys: Mapping[Hashable, int] = field(default_factory=Counter)
    displays: Mapping[str, Display] = field(default_factory=dict)
    raws: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    starts: tuple[Heard, ...] = ()
    stops: tuple[Heard, ...] = ()
    written: str = ""


def saying(run: Run) -> tuple[int | None, frozenset[str]]:
    """Return what a master says of how it went: its exit code, and its lines with other numbers in them.

    Two runs that say the same tell nobody that one of them went wrong.
    """
    lines = (re.sub(r"[-+]?\d[\d.,:]*", "#", line.text).strip() for line in run.lines)
    return run.code, frozenset(line for line in lines if line)


def says_success(run: Run, learned: Learned) -> bool:
    """Whether a run says nothing that an undisturbed one does not say as well."""
    code, lines = saying(run)
    usual_code, usual = learned.saying
    return code == usual_code and lines <= usual
