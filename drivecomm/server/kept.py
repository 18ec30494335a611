"""Motors that a server keeps in hand: fed while their commander's lease holds, treated by their policy after it."""

from __future__ import annotations

import asyncio
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from drivecomm.bus import keep_async
from drivecomm.client import error_content
from drivecomm.errors import DriveCommError

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Callable, Mapping

    from drivecomm.bus import AsyncDrive
    from drivecomm.protocol import DriveStatus, LinkLoss, Stop


@dataclass(frozen=True, slots=True, kw_only=True)
class KeepOrder:
    """How a motor is to be started and kept. watchdog_s: of the drive's own watchdog. percent, hz: set before."""

    policy: LinkLoss
    watchdog_s: Any = 5
    reverse: bool = False
    percent: Any = None
    hz: Any = None


MOST_TOLD = 200
"""So much of what has happened to one motor is told to whoever asks for it later; the history has it all."""


class Story:
    """What has happened to a kept motor since it was started, for all who want to know, whenever they begin to ask."""

    def __init__(self) -> None:
        self._told: deque[Mapping[str, Any]] = deque(maxlen=MOST_TOLD)
        self._number = 0
        self._over = False
        self._more = asyncio.Event()

    def tell(self, item: Mapping[str, Any]) -> None:
        """Add something."""
        self._told.append(item)
        self._number += 1
        self._woken()

    def end(self) -> None:
        """Say that nothing more will come."""
        self._over = True
        self._woken()

    async def __aiter__(self) -> AsyncIterator[Mapping[str, Any]]:
        """Yield what there is, and what comes until the end."""
        place = 0
        while True:
            more = self._more
            while place < self._number:
                first = self._number - len(self._told)
                place = max(place, first) + 1
                yield self._told[place - 1 - first]
            if self._over and place == self._number:
                return
            await more.wait()

    def _woken(self) -> None:
        woken, self._more = self._more, asyncio.Event()
        woken.set()


class KeptMotor:
    """A motor that was started for somebody and is kept in hand until it is released.

    told: hears what happens to it, each thing once: a word for programs, a sentence, and more.
    """

    def __init__(
        self, drive: AsyncDrive, order: KeepOrder, told: Callable[[str, str, Mapping[str, Any]], None]
    ) -> None:
        self.order = order
        self._drive = drive
        self._told = told
        self._failing = ""
        self._fault = False
        self._end = asyncio.Event()
        self._keeper = keep_async(
            drive, order.policy, watchdog_s=order.watchdog_s, on_failure=self._failed, on_status=self._answered
        )
        self._task: asyncio.Task[None] | None = None

    async def begin(self) -> None:
        """Set its watchdog, start it, and keep it from now on. Raises what either raises; then nothing is kept."""
        begun: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._task = asyncio.create_task(self._keep(begun), name=f"keeping {self._drive.name}")
        self._task.add_done_callback(_heard)
        try:
            await asyncio.shield(begun)
        except asyncio.CancelledError:
            self._end.set()
            raise

    @property
    def watchdog(self) -> str:
        """How its own watchdog is set, in words; empty where its model knows none."""
        return "" if self._keeper.watchdog is None else str(self._keeper.watchdog)

    @property
    def over(self) -> bool:
        """Whether it is kept no longer."""
        return self._task is None or self._task.done()

    def stop_by(self, how: Stop) -> None:
        """Let it be stopped so when it is released, whatever its policy says."""
        self._keeper.stop_by(how)

    async def release(self) -> None:
        """Treat it by its policy and set its watchdog as it was; returns when that is done. Raises what that raises."""
        self._end.set()
        if self._task is not None:
            await asyncio.shield(self._task)

    async def _keep(self, begun: asyncio.Future[None]) -> None:
        order = self.order
        try:
            async with self._keeper as kept:
                self._tell("watchdog set", f"watchdog: {kept.watchdog} without this program")
                if not self._end.is_set():
                    await self._start()
                begun.set_result(None)
                self._tell(
                    "started",
                    "started; Ctrl-C stops it and sets the watchdog as it was",
                    link_loss=order.policy,
                    watchdog_s=order.watchdog_s,
                )
                if order.policy != "hold":
                    await self._end.wait()
        except Exception as error:
            if begun.done():
                told = {"error": error_content(error)} if isinstance(error, DriveCommError) else {}
                self._tell("failed", " ".join(str(error).split()), **told)
                raise
            begun.set_exception(error)
        else:
            if order.policy != "hold":
                self._tell("stop commanded", "stop commanded; watchdog as it was")

    async def _start(self) -> None:
        drive, order = self._drive, self.order
        given = order.percent is not None or order.hz is not None
        # Some drives take a reference only from whoever commands them, so a motor that runs is commanded first.
        runs = given and (await drive.status()).running
        if given and not runs:
            await drive.set_reference(percent=order.percent, hz=order.hz)
        await drive.start(reverse=order.reverse)
        if runs:
            await drive.set_reference(percent=order.percent, hz=order.hz)

    def _tell(self, done: str, text: str, **further: Any) -> None:
        self._told(done, text, further)

    def _failed(self, error: DriveCommError) -> None:
        if str(error) != self._failing:
            self._failing = str(error)
            self._tell("not answering", " ".join(str(error).split()), error=error_content(error))

    def _answered(self, status: DriveStatus) -> None:
        if self._failing:
            self._failing = ""
            self._tell("answers again", "answers again")
        if status.fault and not self._fault:
            self._fault = True
            fault = " ".join(str(part) for part in (status.fault_code, status.fault_text) if part)
            self._tell("fault", f"has a fault{f' ({fault})' if fault else ''}", fault_code=status.fault_code)
            self._end.set()


def _heard(task: asyncio.Task[None]) -> None:
    """Take the error of a motor that nobody released: it was told already."""
    if not task.cancelled():
        task.exception()
