"""Stops from other programs while a command has a port: sent over its bus, or let through by closing the port.

A command with an open bus sends them with the priority of a stop, and continues. A command with the bare port, such as
`doctor`, ends as by Ctrl-C, so that the other program can open the port.
"""

from __future__ import annotations

from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from threading import Event
from typing import TYPE_CHECKING, Any

from drivecomm.cli import signals
from drivecomm.cli.output import note
from drivecomm.errors import DriveCommError, NotSupported, ServerLostError, UsageError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from drivecomm.bus import AsyncBus, Bus
    from drivecomm.client import StopOrder
    from drivecomm.protocol import Stop

# Time for a stop with all its attempts, and for the watchdog's parameters.
_END_S = 12.0


@dataclass(slots=True)
class _KeptDrive:
    """Drive that its command keeps running. end: stops it and ends the command. left: set when the block has ended."""

    protocol: str
    address: int
    end: Callable[[Stop], None]
    stopping: Event
    left: Event
    failed: bool = False

    def is_meant(self, order: StopOrder) -> bool:
        """Return whether a stop concerns this drive; ALL concerns any kept drive."""
        return order.protocol == ALL or (order.protocol == self.protocol and order.address in (None, self.address))


ALL = "*"
"""Placeholder for a protocol that stands for any drive that the command keeps running."""


class StopsFromOthers:
    """Handling of stops from other programs in one command. program: its name for display."""

    def __init__(self, program: str = "drivecomm") -> None:
        self._program = program
        self._kept: _KeptDrive | None = None
        self._came: list[StopOrder] = []

    @contextmanager
    def ended_by(self, name: str, end: Callable[[Stop], None]) -> Iterator[Event]:
        """Let stops of this drive, PROTOCOL:ADDRESS, end the block.

        end: stops the drive in this way and ends the block. Yields an event that is set when such a stop arrives.
        """
        protocol, _, address = name.partition(":")
        kept = self._kept = _KeptDrive(protocol, int(address), end, Event(), Event())
        try:
            # A start must not undo a stop that arrived during its preparation.
            for order in filter(kept.is_meant, list(self._came)):
                kept.stopping.set()
                kept.end(order.how)
            yield kept.stopping
        except BaseException:
            kept.failed = True
            raise
        finally:
            kept.left.set()

    @contextmanager
    def over(self, port: str, bus: Bus) -> Iterator[None]:
        """Carry out stops for a port over its bus for the time of the block."""
        if not bus.real_time:
            yield
            return
        from drivecomm.client import stop_door, stop_on

        with stop_door(port, self._program, partial(self._carry_out, partial(stop_on, bus)), _no_door):
            yield

    @contextmanager
    def over_async(self, port: Any, bus: AsyncBus) -> Iterator[None]:
        """Carry out stops over an asyncio bus, in the event loop that is running when the block is entered."""
        if not isinstance(port, str) or not bus.real_time:
            yield
            return
        import asyncio

        from drivecomm.client import stop_door, stop_on_async

        loop = asyncio.get_running_loop()

        def stop(order: StopOrder) -> None:
            asyncio.run_coroutine_threadsafe(stop_on_async(bus, order), loop).result(_END_S)

        with stop_door(port, self._program, stop, _no_door):
            yield

    @contextmanager
    def make_way(self, port: str) -> Iterator[None]:
        """End the block by a KeyboardInterrupt when a stop for its port arrives, so that the port becomes free."""
        from drivecomm.client import stop_door

        def leave(_: StopOrder) -> None:
            with suppress(Exception):
                note(f"{self._program} exits, because its port is needed for a stop")
            signals.interrupt_main_thread()
            raise ServerLostError(f"{self._program} exits, so that its port is free for this stop")

        with stop_door(port, self._program, leave, _no_door):
            yield

    def _carry_out(self, stop: Callable[[StopOrder], None], order: StopOrder) -> None:
        self._came.append(order)
        kept = self._kept if self._kept is not None and self._kept.is_meant(order) else None
        if kept is None:
            if order.protocol == ALL:
                raise UsageError(f"{self._program} keeps no motor running")
            stop(order)
            return
        # Set first, so that the command does not start the motor that is being stopped.
        kept.stopping.set()
        wrong: DriveCommError | None = None
        if order.protocol != ALL:
            # Releasing the motor also writes the watchdog's parameters, so the stop is sent first.
            try:
                stop(order)
            except NotSupported:
                kept.stopping.clear()
                raise
            except DriveCommError as error:
                wrong = error
        kept.end(order.how)
        # Releasing the motor stops it a second time.
        if not (kept.left.wait(_END_S) and not kept.failed) and wrong is not None:
            raise wrong


def _no_door(error: Exception) -> None:
    with suppress(Exception):
        note(f"a stop from another program will not get through to this one ({error}); end it with Ctrl-C first")
