"""Lines with a drive each, and a poll plan on them that is carried out in one way or another."""

import threading

from two_faces import open_on, poll_on

from drivecomm.line import PollItem
from drivecomm.virtual import Server, VirtualLine, parse_listen, virtual_drive

KINDS = {
    "one line": ("threads", 1),
    "one line, awaited": ("tasks", 1),
    "many lines": ("threads", 3),
    "many lines, awaited": ("tasks", 3),
    "many lines in one thread": ("engine", 3),
}


class Site:
    """Lines with a VABus drive each, and a bus on each of them."""

    def __init__(self, kind, stack, listen="tcp:127.0.0.1:0", **options):
        face, number = KINDS[kind]
        self._listen = listen
        self.in_real_time, self._face = face == "engine", "threads" if face == "engine" else face
        self.drives = [virtual_drive("vabus", 1) for _ in range(number)]
        ports = [self._served(each, stack) if self.in_real_time else VirtualLine([each]).port for each in self.drives]
        self.buses = [stack.enter_context(open_on(self._face, each, **options)) for each in ports]

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
        """Nothing of a plan is left, and the lines are used as before."""
        assert not [thread for thread in threading.enumerate() if thread.name == "drivecomm poll"]
        assert self.buses[-1].drive("vabus", 1, model="agile").read("480").raw
