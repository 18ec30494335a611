"""Lines with one drive each, and a poll plan on them, carried out in each possible way."""

import threading
from pathlib import Path
from tempfile import TemporaryDirectory

from running_server import running_server
from two_faces import open_on, own_threads, poll_on, reach_on

from drivecomm.line import PollItem
from drivecomm.virtual import Server, VirtualLine, parse_listen, virtual_drive

KINDS = {
    "one line": ("threads", 1),
    "one line, awaited": ("tasks", 1),
    "many lines": ("threads", 3),
    "many lines, awaited": ("tasks", 3),
    "many lines in one thread": ("engine", 3),
    "one served line": ("served", 1),
    "one served line, awaited": ("awaited-served", 1),
    "many served lines": ("served", 3),
    "many served lines, awaited": ("awaited-served", 3),
}
SERVED = {"served": "threads", "awaited-served": "tasks"}
PLANT = """
[[line]]
name = "line {number}"
port = "{port}"
[[drive]]
name = "pump {number}"
line = "line {number}"
drive = "vabus:1"
options = {{ model = "agile" }}
"""


class Site:
    """Lines with one VABus drive each, and a bus on each line."""

    def __init__(self, kind, stack, listen="tcp:127.0.0.1:0", **options):
        face, number = KINDS[kind]
        self._listen = listen
        self.in_real_time = face in {"engine", *SERVED}
        self._face = "threads" if face == "engine" else SERVED.get(face, face)
        self.drives = [virtual_drive("vabus", 1) for _ in range(number)]
        ports = [self._served(each, stack) if self.in_real_time else VirtualLine([each]).port for each in self.drives]
        if face in SERVED:
            self._run_server(ports, stack)
            stack.enter_context(own_threads())
        opens = reach_on if face in SERVED else open_on
        self.buses = [stack.enter_context(opens(self._face, each, **options)) for each in ports]

    def _run_server(self, ports, stack):
        text = "format = 1\n[server]\nstatus_period_s = 3600.0\n"
        text += "".join(PLANT.format(number=number, port=port) for number, port in enumerate(ports))
        file = Path(stack.enter_context(TemporaryDirectory())) / "plant.toml"
        file.write_text(text, encoding="utf-8")
        stack.enter_context(running_server(file))

    def _served(self, drive, stack):
        server, stop = stack.enter_context(Server([drive], parse_listen(self._listen))), threading.Event()
        thread = threading.Thread(target=server.run, args=(stop,))
        thread.start()
        stack.callback(thread.join)
        stack.callback(stop.set)
        return server.address

    def items(self, *parameters, **facts):
        return [
            PollItem(drive=bus.drive("vabus", 1, model="agile"), parameter=parameter, name=f"line {number}", **facts)
            for number, bus in enumerate(self.buses)
            for parameter in parameters
        ]

    def poll(self, *parameters, more=(), cycles=None, duration_s=None, **facts):
        items = [*self.items(*parameters, **facts), *more]
        if len(self.buses) == 1:
            return self.buses[0].poll(items, cycles=cycles, duration_s=duration_s)
        return poll_on(self._face, items, cycles=cycles, duration_s=duration_s)

    def assert_free(self):
        """Assert that the plan left no thread behind and that the lines can be used as before."""
        assert not [thread for thread in threading.enumerate() if thread.name == "drivecomm poll"]
        assert self.buses[-1].drive("vabus", 1, model="agile").read("480").raw
