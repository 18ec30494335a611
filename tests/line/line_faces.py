"""A line of virtual drives behind a real socket, and the bus classes by which programs use it."""

import asyncio
import threading
import time
from concurrent.futures import Future
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory

from running_server import running_server
from serving_threads import served_in_thread

from drivecomm.bus import BroadcastVerbs, DriveVerbs, open_bus, open_bus_async
from drivecomm.line import Engine
from drivecomm.plant import async_bus_of_server, bus_of_server
from drivecomm.protocol import Framed
from drivecomm.virtual import DriveProxy, Server, parse_listen, virtual_drive

LIVE, DEAD = (11, 12, 13, 14, 15), (1, 2, 3, 4)
ATTEMPT_S = 0.1
SOON_S = 10.0
MODELS = {"danfoss-fc": "fc300", "vabus": "agile"}
READ = {"danfoss-fc": "3-10[3]", "vabus": "481"}


def until(condition):
    end = time.monotonic() + SOON_S
    while not condition():
        assert time.monotonic() < end, "nothing happens"
        time.sleep(0.001)


def address_of(protocol, data):
    """Return the address in a request; None for a telegram that only closes an exchange."""
    if protocol == "danfoss-fc":
        return data[2] & 0x7F
    # EOT, which closes an exchange, may stand alone or begin a request.
    request = data.lstrip(b"\x04")
    return request[0] - 0x40 if request else None


class Gate(DriveProxy):
    """A virtual drive that answers its next request only when the gate is open; the whole line waits for it."""

    def __init__(self, drive):
        super().__init__(drive)
        self.is_open, self.came = threading.Event(), threading.Event()
        self.is_open.set()

    def hear(self, find, now):
        if isinstance(find, Framed) and getattr(find.message, "address", None) == self.address:
            self.came.set()
            assert self.is_open.wait(SOON_S)
        return super().hear(find, now)


class Wire:
    """Recorded requests of a line, and the drives on it."""

    def __init__(self, protocol, server):
        self.protocol, self.server = protocol, server
        self.port = "socket://" + server.address.partition("://")[2]
        self.requests = []
        server.line.monitors.append(self._hear)

    def _hear(self, sent):
        if sent.sender is None:
            address = address_of(self.protocol, sent.data)
            if address is not None:
                self.requests.append((time.monotonic(), address))

    def asked(self, since=0):
        """Return the addresses in the order of their requests, without immediate repetitions."""
        all_of_them = [address for _, address in self.requests[since:]]
        return [each for place, each in enumerate(all_of_them) if place == 0 or all_of_them[place - 1] != each]

    @contextmanager
    def held(self, face, verb="status"):
        """Keep the line busy with a call to the first live drive; a `stop` as verb does not give way to others."""
        gate = self.server.drives[0]
        gate.is_open.clear()
        gate.came.clear()
        holding = face.hold(face.drive(LIVE[0]), verb)
        assert gate.came.wait(SOON_S)
        try:
            yield holding
        finally:
            gate.is_open.set()


@contextmanager
def wire(protocol):
    drives = [Gate(virtual_drive(protocol, LIVE[0], model=MODELS[protocol]))]
    drives += [virtual_drive(protocol, address, model=MODELS[protocol]) for address in LIVE[1:]]
    with served_in_thread(Server(drives, parse_listen("tcp:127.0.0.1:0"))) as server:
        yield Wire(protocol, server)


class Face:
    """One way to use a line. call: calls a verb of a drive, and returns a future of its result."""

    def __init__(self, on, stack):
        self.on = on
        self.drives = {}
        self._open(stack)

    def drive(self, address, **options):
        timing = {"reply_timeout_s": SOON_S if address == LIVE[0] else ATTEMPT_S} | options
        return self.bus.drive(self.on.protocol, address, model=MODELS[self.on.protocol], **timing)

    def call(self, address, verb, *arguments, **options):
        drive = self.drive(address, **options)
        return self._begin(drive, verb, *arguments)

    def hold(self, drive, verb):
        """Call a verb in the most usual way, to keep the line busy."""
        return self._begin(drive, verb)

    def result(self, address, verb, *arguments, **options):
        return self.call(address, verb, *arguments, **options).result(SOON_S)

    @property
    def waiting(self):
        """Number of calls that wait for the line."""
        return len(self.bus.line.queue.waiting)


class Threads(Face):
    """`Bus`: a thread for each call."""

    def _open(self, stack):
        self.bus = stack.enter_context(open_bus(self.on.port))

    def _begin(self, drive, verb, *arguments):
        future = Future()

        def run():
            try:
                future.set_result(getattr(drive, verb)(*arguments))
            except BaseException as error:  # noqa: BLE001 - raised again in `result`
                future.set_exception(error)

        threading.Thread(target=run, daemon=True).start()
        return future


class Tasks(Face):
    """`AsyncBus`: a task for each call, in the event loop of a thread."""

    def _open(self, stack):
        self._loop = asyncio.new_event_loop()
        thread = threading.Thread(target=self._loop.run_forever)
        thread.start()

        def end():
            self._loop.call_soon_threadsafe(self._loop.stop)
            thread.join()
            self._loop.close()

        stack.callback(end)
        self.bus = self.in_loop(self._opened()).result(SOON_S)
        stack.callback(lambda: self.in_loop(self.bus.close()).result(SOON_S))

    async def _opened(self):
        return await open_bus_async(self.on.port).__aenter__()

    def in_loop(self, coroutine):
        return asyncio.run_coroutine_threadsafe(coroutine, self._loop)

    def _begin(self, drive, verb, *arguments):
        async def run():
            return await getattr(drive, verb)(*arguments)

        return self.in_loop(run())


class Engined(Threads):
    """`EngineLine`: one call at a time on an engine, others in threads on the same bus."""

    def _open(self, stack):
        super()._open(stack)
        self._engine, self._is_over, self._busy = Engine(), False, False
        self._line = self.bus.on_engine(self._engine)
        thread = threading.Thread(target=lambda: self._engine.run(lambda: self._is_over))
        thread.start()

        def end():
            def close():
                self._line.close()
                self._is_over = True

            self._engine.call_soon(close)
            thread.join()
            self._engine.close()

        stack.callback(end)

    def hold(self, drive, verb):
        """Call a verb in a thread, so that the engine's line has to wait for its turn."""
        return super()._begin(drive, verb)

    def _begin(self, drive, verb, *arguments):
        if self._busy:
            return super()._begin(drive, verb, *arguments)
        self._busy, future = True, Future()

        def ended(result, error):
            # The engine keeps the turn while no other caller waits; rest() gives the line back.
            self._line.rest()
            self._busy = False
            if error is None:
                future.set_result(result)
            else:
                future.set_exception(error)

        declared = BroadcastVerbs if isinstance(drive, BroadcastVerbs) else DriveVerbs
        job = getattr(declared, verb)(drive, *arguments)
        self._engine.call_soon(lambda: self._line.run(job, ended))
        return future


PLANT = """
format = 1
[server]
status_period_s = 3600.0
[[line]]
name = "hall"
port = "{port}"
"""
DRIVE = """
[[drive]]
name = "{protocol}{address}"
line = "hall"
drive = "{protocol}:{address}"
options = {{ model = "{model}", reply_timeout_s = {timeout} }}
"""


class Served(Threads):
    """`ServedBus`: a thread for each call, the line in a server."""

    def _open(self, stack):
        protocol = self.on.protocol
        text = PLANT.format(port=self.on.port)
        for address in (*LIVE, *DEAD):
            timeout = SOON_S if address == LIVE[0] else ATTEMPT_S
            text += DRIVE.format(protocol=protocol, address=address, model=MODELS[protocol], timeout=timeout)
        file = Path(stack.enter_context(TemporaryDirectory())) / "plant.toml"
        file.write_text(text, encoding="utf-8")
        served = stack.enter_context(running_server(file))
        until(lambda: all(each.reachability != "unknown" for each in served.drives()) and self._is_quiet())
        self._enter(stack)

    def _is_quiet(self):
        """Return whether no request was sent for longer than a call to a dead drive takes."""
        return self.on.requests and time.monotonic() - self.on.requests[-1][0] > 4 * ATTEMPT_S

    def _enter(self, stack):
        self.bus = bus_of_server(self.on.port)
        stack.callback(self.bus.close)

    def drive(self, address, **options):
        return self.bus.drive(self.on.protocol, address, model=MODELS[self.on.protocol], **options)


class AwaitedServed(Served, Tasks):
    """`AsyncServedBus`: a task for each call, the line in a server."""

    def _enter(self, stack):
        Tasks._open(self, stack)

    async def _opened(self):
        return await async_bus_of_server(self.on.port).__aenter__()

    def _begin(self, drive, verb, *arguments):
        return Tasks._begin(self, drive, verb, *arguments)


LOCAL = {"threads": Threads, "tasks": Tasks, "engine": Engined}
SERVED = {"served": Served, "awaited-served": AwaitedServed}


@contextmanager
def opened(kind, protocol="danfoss-fc"):
    """Yield one face of a line, and its wire."""
    with wire(protocol) as on, ExitStack() as stack:
        yield (LOCAL | SERVED)[kind](on, stack), on


def outcome(future):
    """Return the error that a call ends with; None for a result."""
    with suppress(TimeoutError):
        return future.exception(SOON_S)
    return AssertionError("the call does not end")
