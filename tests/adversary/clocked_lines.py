"""Virtual lines on the clock of an event loop, with a record of their motors' real behaviour.

An event loop waits for their ports as for serial ports, but all data stays in memory.
"""

import asyncio
import os
import time
from dataclasses import dataclass

from drivecomm.errors import LinkDownError, PortError
from drivecomm.plant import read_fault
from drivecomm.virtual import VirtualPlant

LOOK_S = 0.2
"""Sampling interval of the motors in seconds."""
_TICK_S = 1e-6
"""Smallest delay of a due event: time must pass before it."""


@dataclass(frozen=True, slots=True)
class Seen:
    """State of a motor from this time on, by the clock of the loop."""

    at: float
    running: bool
    output_hz: float
    powered: bool
    fault: int


class ClockedPlant:
    """The lines of a plant. truth: each change of a motor's state by drive, the oldest first."""

    def __init__(self, plant):
        self.virtual = VirtualPlant(plant)
        self._loop = asyncio.get_running_loop()
        self._began = self._loop.time()
        self.truth = {drive.name: [] for drive in plant.drives}
        self.lines = {name: ClockedLine(self, line) for name, line in self.virtual.lines.items()}
        self.looked()
        self._looking = asyncio.create_task(self._look())

    def line_time(self):
        return self._loop.time() - self._began

    def looked(self):
        """Record the changes since the last sample."""
        now = self._loop.time()
        for state in self.virtual.states():
            seen = Seen(now, state.running, round(state.output_hz, 1), state.powered, state.fault)
            known = self.truth[state.name]
            if not known or (known[-1].running, known[-1].output_hz, known[-1].powered, known[-1].fault) != (
                seen.running, seen.output_hz, seen.powered, seen.fault,
            ):  # fmt: skip
                known.append(seen)

    def running(self, drive):
        self.looked()
        return self.truth[drive][-1].running

    def add_fault(self, seconds, **keys):
        """Disturb telegrams for some seconds, as a [[fault]] of a plant file does."""
        now = self.line_time()
        said = {**keys, "from_s": now, "until_s": now + seconds}
        self.virtual.add(read_fault("\n".join(f"{name} = {_toml(value)}" for name, value in said.items())))

    def close(self):
        self._looking.cancel()
        for line in self.lines.values():
            line.cut()

    async def _look(self):
        while True:
            await asyncio.sleep(LOOK_S)
            for line in self.lines.values():
                line.follow()
            self.looked()


def _toml(value):
    return f'"{value}"' if isinstance(value, str) else str(value)


class ClockedLine:
    """One line. away: the port cannot be opened."""

    def __init__(self, plant, line):
        self.line, self.away = line, False
        self._plant, self._loop, self._timer = plant, asyncio.get_running_loop(), None
        self._port = None
        line.configure(None)

    def open(self):
        if self.away:
            raise PortError("the simulated adapter is not plugged in")
        if self._port is not None:
            raise PortError("the simulated port is in use")
        self._port = ClockedPort(self)
        return self._port

    def cut(self):
        """Break the present connection."""
        port, self._port = self._port, None
        if port is not None:
            port.lose()

    def given_back(self, port):
        if port is self._port:
            self._port = None

    def sent(self, data):
        self.line.pass_time(self._plant.line_time())
        self.line.transmit(data)
        self.follow()

    def follow(self):
        self.line.pass_time(self._plant.line_time())
        heard = self.line.take()
        if heard and self._port is not None:
            self._port.came(heard)
        due = self.line.silent_until
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if due != float("inf"):
            self._timer = self._loop.call_at(self._loop.time() + max(_TICK_S, due - self.line.time), self.follow)


class ClockedPort:
    """The master's end of a line."""

    real_time, paced = True, False

    def __init__(self, line):
        self._line, self._inbox, self._lost, self._closed = line, b"", False, False
        self._loop = line._loop
        self.descriptor = os.eventfd(0, os.EFD_NONBLOCK)

    def now(self):
        return self._loop.time()

    def wall_time(self):
        return time.time()

    def configure(self, settings):
        self._check()
        self._line.line.configure(settings)
        return ""

    def write(self, data):
        self._check()
        self._line.sent(data)

    def read(self, until, at_least):
        del until, at_least
        return self.take()

    def take(self):
        self._check()
        data, self._inbox = self._inbox, b""
        if data:
            os.eventfd_read(self.descriptor)
        return data

    def hold_back(self, at_least):
        pass

    def wait(self, until):
        raise NotImplementedError

    def close(self):
        if not self._closed:
            self._closed = True
            self._line.given_back(self)
            os.close(self.descriptor)

    def came(self, data):
        if not self._inbox:
            os.eventfd_write(self.descriptor, 1)
        self._inbox += data

    def lose(self):
        self._lost = True
        if not self._closed:
            os.eventfd_write(self.descriptor, 1)

    def _check(self):
        if self._lost or self._closed:
            raise LinkDownError("the simulated connection was cut")
