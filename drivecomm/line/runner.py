"""Non-blocking execution of a link's steps, driven by events of the port and of the clock.

An event loop reports the events: that of asyncio, or the engine that runs many lines in one thread.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from drivecomm.errors import LinkDownError
from drivecomm.line.effects import carry_out
from drivecomm.link import Arrival, Receive, Transaction, Wait

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.link import Effect, LinkSteps, Port

# The constructor of a NamedTuple is a Python function, and slower.
_new = tuple.__new__

# Shorter waits cost less as a busy loop than going to sleep and waking up.
_NOT_WORTH_SLEEPING_S = 0.00003
# Shorter than a character at 115200 baud: a port that was just emptied is not read again before a request, because that
# costs as much as the reading did. Bytes that come in between are judged as if they came after the request.
_JUST_NOW_S = 0.00008
# More than a line can leave behind between two exchanges; limits the memory for endless noise.
_MOST_UNASKED = 4096


class LineRunner:
    """Runner of exchanges on one open port, one after the other.

    wake_at: requests a call of `time_passed` at a time; an earlier call does no harm. wake_precisely: the same as
    exactly as possible, for the pauses between telegrams. ended: called with the result or the error of an exchange; it
    may begin the next one. lost: called before `ended` if the port turns out to be lost while reading.
    """

    def __init__(
        self,
        port: Port,
        wake_at: Callable[[float], None],
        wake_precisely: Callable[[float], None],
        ended: Callable[[Any, Exception | None], None],
        lost: Callable[[LinkDownError], None],
    ) -> None:
        self._port = port
        self._now = port.now
        self._wake_at = wake_at
        self._wake_precisely = wake_precisely
        self._ended = ended
        self._lost = lost
        self._steps: LinkSteps[Any] | None = None
        self._stop_waits: Callable[[], bool] = _never
        self._held = 0
        """Minimum number of bytes set by `hold_back`; 0 if another caller may have changed it."""
        self._waiting: Receive | Transaction | Wait | None = None
        self._paused: Transaction | None = None
        """Request to send when the pause is over."""
        self._inbox = b""
        self._emptied_at = float("-inf")
        """Time when the port was last emptied."""

    def turn_came(self) -> None:
        """Record that other callers may have used the port."""
        self._held = 0
        self._emptied_at = float("-inf")

    def begin(self, steps: LinkSteps[Any], stop_waits: Callable[[], bool]) -> None:
        """Begin to carry out the steps of a link. stop_waits: returns whether a stop waits for the line."""
        self._steps, self._stop_waits = steps, stop_waits
        self._go_on(None)

    def cut_off(self) -> None:
        """Abort the current exchange without calling `ended`."""
        steps, self._steps, self._waiting, self._paused = self._steps, None, None, None
        if steps is not None:
            steps.close()

    def give_way(self) -> None:
        """End a wait that gives way, if a stop waits for the line."""
        waiting = self._waiting
        if waiting is not None and waiting.gives_way and self._stop_waits():
            self._go_on(Arrival(self._now()) if isinstance(waiting, Wait) else self._arrival())

    def readable(self) -> None:
        """Take the received bytes, and continue if there are enough."""
        data, waiting = self._taken(), self._waiting
        if data is None:
            return
        if waiting is not None and not isinstance(waiting, Wait) and len(data) >= waiting.at_least:
            self._inbox = b""
            self._emptied_at = now = self._now()
            self._go_on(_new(Arrival, (now, data, "")))
        else:
            self._inbox = data[-_MOST_UNASKED:]

    def time_passed(self) -> None:
        """Continue if the current wait is over."""
        waiting = self._waiting
        if waiting is None:
            return
        until, now = waiting.until, self._now()
        if not isinstance(waiting, Wait):
            if now < until:
                self._wake_at(until)
                return
            # Fewer bytes than expected may have come.
            data = self._taken()
            if data is None:
                return
            self._inbox = b""
            self._go_on(_new(Arrival, (self._now(), data, "")))
        elif until - now > _NOT_WORTH_SLEEPING_S:
            self._wake_precisely(until)
        else:
            # Busy waiting: on a busy event loop a timer would end too late for even one more round.
            while now < until:
                now = self._now()
            paused, self._paused = self._paused, None
            self._go_on(Arrival(now), paused)

    def _go_on(self, arrival: Arrival | None, effect: Effect | None = None) -> None:
        """Carry out effects until one must wait: first `effect`, if given, then those that the steps yield."""
        steps, port, now = self._steps, self._port, self._now
        if steps is None:
            return
        self._waiting = None
        try:
            while True:
                if effect is None:
                    effect = steps.send(arrival)  # type: ignore[arg-type]
                if isinstance(effect, Transaction):
                    free_at, began = effect.free_at, now()
                    if free_at - began > _NOT_WORTH_SLEEPING_S:
                        self._paused, self._waiting = effect, Wait(free_at)
                        self._wake_precisely(free_at)
                        return
                    while began < free_at:
                        began = now()
                    if began - self._emptied_at > _JUST_NOW_S:
                        self._inbox += port.read(began, 1)
                        began = now()
                    if not self._inbox:
                        effect.begun = began
                        port.write(effect.data)
                        if effect.at_least:
                            if effect.at_least != self._held:
                                self._held = effect.at_least
                                port.hold_back(effect.at_least)
                            self._waiting = effect
                            self._wake_at(min(began + effect.wire_s + effect.reply_s, effect.deadline))
                            return
                    arrival = self._arrival()
                elif isinstance(effect, Receive | Wait):
                    come = self._received(effect) if isinstance(effect, Receive) else self._waited(effect)
                    if come is None:
                        self._waiting = effect
                        return
                    arrival = come
                else:
                    arrival = carry_out(effect, port)
                    self._held = 0
                effect = None
        except StopIteration as finished:
            result = finished.value
        except Exception as error:  # noqa: BLE001 - passed on to the caller of the exchange
            self._failed(error)
            return
        self._steps = None
        self._ended(result, None)

    def _received(self, effect: Receive) -> Arrival | None:
        """Return the received bytes if they are enough or the time is over.

        Otherwise request a wake-up and return None.
        """
        until, at_least, gives_way = effect
        if self._now() >= until:
            # Usually nothing has come, which `read` detects without an exception.
            self._inbox += self._port.read(until, 1)
        elif len(self._inbox) < at_least and not (gives_way and self._stop_waits()):
            self._held = at_least - len(self._inbox)
            self._port.hold_back(self._held)
            self._wake_at(until)
            return None
        return self._arrival()

    def _waited(self, effect: Wait) -> Arrival | None:
        """Return the time if it has come or a stop waits; otherwise request a wake-up and return None."""
        until = effect.until
        if not (effect.gives_way and self._stop_waits()):
            if until - self._now() > _NOT_WORTH_SLEEPING_S:
                self._wake_precisely(until)
                return None
            while self._now() < until:
                pass
        return Arrival(self._now())

    def _taken(self) -> bytes | None:
        """Return all received bytes, including earlier ones; None if the port is lost, which ends the exchange."""
        try:
            return self._inbox + self._port.take()
        except LinkDownError as error:
            self._lost(error)
            self._failed(error)
            return None

    def _failed(self, error: Exception) -> None:
        """End the current exchange with an error."""
        if self._steps is not None:
            self.cut_off()
            self._ended(None, error)

    def _arrival(self) -> Arrival:
        data, self._inbox = self._inbox, b""
        return _new(Arrival, (self._now(), data, ""))


def _never() -> bool:
    return False
