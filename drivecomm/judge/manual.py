"""Manual master: a program that runs already, such as a controller on a bench; a person carries out the tasks."""

from __future__ import annotations

import time
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any, Self

from drivecomm.judge.process import OutputLine, Run
from drivecomm.judge.stand import JudgeLine, listener_at

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.judge.judged_drive import JudgedDrive
    from drivecomm.judge.order import JudgeOrder, JudgeTask
    from drivecomm.virtual import Listener

_DO = {
    "read": "let your master read the drive",
    "write": "let your master write {value}",
    "start": "let your master start the motor",
    "stop": "let your master stop the motor",
    "reset": "let your master reset the fault",
    "run": "let your master do its work",
}
_QUIET_S = 0.3


class _KeptListener:
    """Listener that stays open from line to line, so that a master keeps its connection."""

    def __init__(self, inner: Listener) -> None:
        self._inner = inner
        self._is_open = False

    def __getattr__(self, name: str) -> Any:
        return getattr(self._inner, name)

    def open(self) -> None:
        """Open the listener the first time; do nothing later."""
        if not self._is_open:
            self._inner.open()
            self._is_open = True

    def close(self) -> None:
        """Leave the listener open for the next line."""


class ManualMaster:
    """A master operated by a person; its address stays the same within the block.

    ask: shows a text and returns the person's answer. Cases are played one at a time.
    """

    in_parallel = False

    def __init__(self, order: JudgeOrder, ask: Callable[[str], str]) -> None:
        self._order = order
        self._ask = ask
        self._open = ExitStack()
        self._listener: Any = None

    def __enter__(self) -> Self:
        inner = self._open.enter_context(listener_at(self._order.listen))
        self._listener = _KeptListener(inner)
        self._open.callback(inner.close)
        return self

    def __exit__(self, *_: object) -> None:
        self._open.close()

    def stop(self) -> None:
        """Do nothing: a person operates the master, so no process can be ended."""

    def stand(self, drive: JudgedDrive, listen: str, *, echo: bool) -> JudgeLine:  # noqa: ARG002 - its address is fixed
        """Return a line with this drive at the address of the master."""
        return JudgeLine(drive, self._listener, echo=echo)

    def run(
        self,
        stand: JudgeLine,
        task: JudgeTask,
        *,
        value: str,
        goes_on: bool | None,  # noqa: ARG002 - the person decides when the task is done
        until: Callable[[], bool] | None,  # noqa: ARG002
        limit_s: float,  # noqa: ARG002
    ) -> Run:
        """Ask the person to carry out a task, and to enter what the master shows."""
        run = Run(began_s=stand.now(), code=0)
        words = _DO[task.name].format(value=value)
        said = self._ask(
            f"at {stand.port}: {words}, wait until it is done, then type what it shows (- for nothing, ! for an error)"
        )
        time.sleep(_QUIET_S)
        run.ended_s = stand.now()
        if said.strip() == "!":
            run.code = 1
            run.lines.append(OutputLine(run.ended_s, "error", is_error=True))
        elif said.strip() not in ("", "-"):
            run.lines.append(OutputLine(run.ended_s, said.strip(), is_error=False))
        return run

    def killed(self, stand: JudgeLine, task: JudgeTask, condition: Callable[[], bool], limit_s: float) -> Run:
        """Ask the person to carry out a task, and to switch the master off when the motor runs."""
        run = Run(began_s=stand.now())
        self._ask(f"at {stand.port}: {_DO[task.name].format(value='')}, then press Enter")
        stand.comes_about(condition, min(limit_s, 1.0))
        self._ask("now switch your master off, or end its program, and press Enter")
        run.ended_s = stand.now()
        return run
