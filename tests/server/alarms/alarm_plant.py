"""A stand-in for a served plant with one drive, for tests of alarms; the test sets its state."""

import asyncio

from alarm_points import pump

from drivecomm.line import STATUS
from drivecomm.server import CurrentValue, Event


class Changes:
    def __init__(self):
        self.lost = 0
        self.closed = False
        self.queue = asyncio.Queue()
        self.loop = asyncio.get_running_loop()

    async def __aiter__(self):
        while True:
            yield await self.queue.get()

    def close(self):
        self.closed = True


class AlarmPlant:
    name = "hall 2"

    def __init__(self, session="run"):
        self.session = session
        self.state = pump()
        self.all_values = []
        self.read = []

    def drives(self):
        return [self.state]

    def drive(self, name):
        assert name == "pump"
        return self.state

    def values(self):
        return self.all_values

    def changes(self, every_s=0.0):  # noqa: ARG002 - reports every change immediately
        self.read.append(Changes())
        return self.read[-1]

    def see(self, state, kind=""):
        """Set the state of the drive, and report it by an event of this kind, or as a polled status without a kind."""
        self.state = state
        event = Event(number=1, time_s=0.0, kind=kind, text="", drive="pump") if kind else None
        status = CurrentValue(time_s=1.0, drive="pump", name=STATUS, reading=None, quality="good")
        self.put([] if event else [status], [event] if event else [])

    def put(self, values=(), events=()):
        changes = self.read[-1]
        changes.loop.call_soon_threadsafe(changes.queue.put_nowait, (values, events))
