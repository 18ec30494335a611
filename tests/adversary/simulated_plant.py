"""Simulated plant of three lines in a separate process; its control door shows the true state of the drives.

The TCP lines are reached through a cable, a process that can be cut; the pseudo-terminal through a link that can be
removed.
"""

import contextlib
import os
import select
import signal
import socket
import time
from pathlib import Path

from drivecomm.errors import DriveCommError
from drivecomm.virtual import ControlClient

LINES = {
    "hall": {"a": ("vabus:1", "agile"), "b": ("danfoss-fc:3", "fc300")},
    "yard": {"c": ("fuji:7", "frenic"), "d": ("vlt3500:2", "vlt3500"), "e": ("vabus:5", "acu")},
    "dock": {"f": ("danfoss-fc:6", "fc302"), "g": ("vlt3500:4", "vlt3000"), "h": ("fuji:9", "frenic")},
}
DRIVES = {name: (line, *drive) for line, drives in LINES.items() for name, drive in drives.items()}
# Address prefixes of the master's end and of the line's end.
REACHED = {"hall": ("", "pty:"), "yard": ("socket://", "tcp:"), "dock": ("rfc2217://", "rfc2217:")}
# A parameter of each protocol that moves nothing, the options for writing it, and its raw value for 1.
WRITABLE = {
    "vabus": ("481", (), lambda raw: int(raw, 16) / 100),
    "danfoss-fc": ("3-10[3]", (), lambda raw: int(raw) / 100),
    "fuji": ("C05", ("--store",), lambda raw: int(raw) / 100),
    "vlt3500": ("205", (), float),
}
# Parameters for ramps of 0.2 s, if the drive has them.
RAMPS = {
    "vabus": "{ }",
    "danfoss-fc": '{ "3-41" = 20, "3-42" = 20 }',
    "fuji": '{ "F07" = 20, "F08" = 20 }',
    "vlt3500": '{ "215" = "0.20", "216" = "0.20" }',
}
# Reply timeout in seconds for a simulator that other programs delay.
REPLY_S = 0.4
MOTOR = "{ ramp_up_s = 0.2, ramp_down_s = 0.2, quick_ramp_s = 0.1, coast_s = 0.2, rated_hz = 50, maximum_hz = 50 }"
_READY_S = 20
_CHUNK = 4096


class SimulatedPlant:
    """Simulated plant in the working folder."""

    def __init__(self, fork):
        free = iter(_free_places(4))
        self._cables = {}
        text = ["format = 1"]
        self.ports = {}
        for line, (scheme, kind) in REACHED.items():
            if scheme:
                listens, reached = next(free), next(free)
                self._cables[line] = _Cable(fork, reached, listens)
                place, self.ports[line] = f"127.0.0.1:{listens}", f"{scheme}127.0.0.1:{reached}"
            else:
                place = self.ports[line] = line
            text += ["[[line]]", f'name = "{line}"', f'port = "{self.ports[line]}"', f'listen = "{kind}{place}"']
        for name, (line, drive, model) in DRIVES.items():
            text += ["[[drive]]", f'name = "{name}"', f'line = "{line}"', f'drive = "{drive}"', "armed = true"]
            text += [f'options = {{ model = "{model}", reply_timeout_s = {REPLY_S} }}', f"motor = {MOTOR}"]
            text += [f"values = {RAMPS[drive.partition(':')[0]]}"]
        Path("plant.toml").write_text("\n".join(text) + "\n", encoding="utf-8")
        self.simulator = fork("simulate", "plant.toml", "--control", "unix:door")
        self._control = self._connected()

    def _connected(self):
        until = time.monotonic() + _READY_S
        while True:
            try:
                return ControlClient("unix:door")
            except DriveCommError:
                if time.monotonic() > until:
                    raise
                time.sleep(0.02)

    def order(self, order, **fields):
        return self._control.order(order, **fields)

    def states(self):
        return {state["name"]: state for state in self.order("show")["drives"]}

    def value(self, drive):
        parameter, _, physical = WRITABLE[DRIVES[drive][1].partition(":")[0]]
        return physical(self.order("show", drive=drive, parameters=[parameter])["values"][parameter])

    def vanish(self, line):
        """Remove a port like an unplugged adapter; open connections through a cable are cut."""
        if line in self._cables:
            self._cables[line].tell(b"x")
        else:
            with contextlib.suppress(FileNotFoundError):
                Path(line).rename(f"{line} pulled out")

    def come_back(self, line):
        if line in self._cables:
            self._cables[line].tell(b"o")
        else:
            with contextlib.suppress(FileNotFoundError):
                Path(f"{line} pulled out").rename(line)

    def silence(self):
        """Suspend all lines and drives, like hanging serial servers."""
        os.kill(self.simulator, signal.SIGSTOP)

    def wake(self):
        os.kill(self.simulator, signal.SIGCONT)

    def close(self):
        self._control.close()
        for process in (self.simulator, *(cable.process for cable in self._cables.values())):
            os.kill(process, signal.SIGKILL)
            os.waitpid(process, 0)
        for cable in self._cables.values():
            os.close(cable.orders)


class _Cable:
    """Forwarder of connections from one local port to another, which can be cut."""

    def __init__(self, fork, reached, listens):
        door = socket.create_server(("127.0.0.1", reached))
        read, self.orders = os.pipe()
        self.process = fork(lambda: _carry(door, read, listens), keep=(door.fileno(), read))
        os.close(read)
        door.close()

    def tell(self, order):
        os.write(self.orders, order)


def _carry(door, orders, listens):
    ends = {}
    cut = False
    while True:
        for ready in select.select([orders, door, *ends], [], [])[0]:
            if ready == orders:
                order = os.read(orders, 1)
                if not order:
                    return
                cut = order == b"x"
                if cut:
                    for end in ends:
                        end.close()
                    ends.clear()
                break
            if ready is door:
                _connect(door, ends, None if cut else listens)
            elif ready in ends and not _pass_on(ready, ends[ready]):
                other = ends.pop(ready)
                del ends[other]
                ready.close()
                other.close()


def _connect(door, ends, listens):
    one, _ = door.accept()
    try:
        if listens is None:
            raise ConnectionRefusedError
        other = socket.create_connection(("127.0.0.1", listens))
    except OSError:
        one.close()
        return
    for end in (one, other):
        end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    ends[one], ends[other] = other, one


def _pass_on(one, other):
    try:
        data = one.recv(_CHUNK)
        other.sendall(data)
    except OSError:
        return False
    return bool(data)


def _free_places(count):
    doors = [socket.create_server(("127.0.0.1", 0)) for _ in range(count)]
    places = [door.getsockname()[1] for door in doors]
    for door in doors:
        door.close()
    return places
