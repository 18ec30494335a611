"""Virtual lines for the runner behind event loops: their clock is the loop, and each character is an event."""

from __future__ import annotations

from drivecomm.line import LineRunner
from drivecomm.link import PortProxy


class WatchedPort(PortProxy):
    """A port of a virtual line that can hold bytes before anybody reads."""

    def __init__(self, port):
        super().__init__(port)
        self.came = b""
        self._looks = 0

    def now(self):
        """Return the time; repeated calls without a read advance it, so that a loop polling the clock ends."""
        self._looks += 1
        if self._looks > 20:
            self._port.wait(self._port.now() + 1e-6)
        return self._port.now()

    def write(self, data):
        self._looks = 0
        self._port.write(data)

    def take(self):
        came, self.came = self.came, b""
        return came + self._port.take()

    def read(self, until, at_least):
        self._looks = 0
        came, self.came = self.came, b""
        return came + self._port.read(until, at_least - len(came)) if len(came) < at_least else came


class EventLoop:
    """One virtual port and its runner; runs the steps of a link as the blocking runner does."""

    def __init__(self, port):
        self._port = port
        self._watched = WatchedPort(port)
        self._times = []
        self._results = []
        self._runner = LineRunner(
            self._watched, self._times.append, self._times.append, lambda *came: self._results.append(came), print
        )

    def run(self, steps, stop_waits):
        self._results.clear()
        self._times.clear()
        self._runner.begin(steps, stop_waits)
        while not self._results:
            until = min(self._times)
            self._watched.came += self._port.read(until, 1)
            if self._watched.came:
                self._runner.readable()
            else:
                # Drop the timers that have expired; the runner sets a new one if it waits longer.
                self._times[:] = [time for time in self._times if time > until]
                self._runner.time_passed()
        ((result, error),) = self._results
        if error is not None:
            raise error
        return result


def on_event_loops():
    """Return a function that runs the steps of a link on virtual ports, each with its own event loop."""
    loops = {}

    def run(steps, port, stop_waits):
        if port not in loops:
            loops[port] = EventLoop(port)
        return loops[port].run(steps, stop_waits)

    return run
