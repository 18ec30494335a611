"""Benches for tests of the bus: drives that can die, recorded traces, and parameters with different values."""

from __future__ import annotations

import drivecomm
from drivecomm.models import is_monitoring_only, load_model
from drivecomm.protocol import Framed, installed
from drivecomm.virtual import VirtualLine, virtual_drive

PROTOCOLS = sorted(
    set(drivecomm.protocols())
    - {
        "ct-ansi",
        "ei-bisynch",
        "hitachi",
        "huanyang",
        "lecom",
        "ls-bus",
        "mitsubishi",
        "modbus",
        "movilink",
        "toshiba",
        "weg",
    }
)
"""Protocols whose drives are commanded without a model, with one telegram per verb; others have own tests."""

COMMANDED = sorted(
    name
    for name, plugin in installed.items()
    if not is_monitoring_only(plugin, load_model(plugin.package, name, plugin.default_model))
)
"""Protocols whose default model has commands."""

READABLE = {
    "danfoss-fc": ("3-10[3]", "3-10[2]"),
    "fuji": ("F03", "o05"),
    "uss": ("1082", "1120"),
    "vabus": ("481", "482"),
    "vlt3500": ("205", "206"),
}
"""Two parameters of each protocol with different values."""

WRITABLE = {
    "danfoss-fc": ("3-41", 10, 1000),
    "fuji": ("S08", 7, 70),
    "uss": ("1082", 12.5, 0x41480000),
    "vabus": ("481", "12.34", "000004D2"),
    "vlt3500": ("215", 3, "3.00"),
}
"""A parameter of each protocol, a value to write, and the drive's value afterwards."""

ADDRESS = 3


class Mortal:
    """A virtual drive that can die, and that records the requests received while alive, with their times."""

    def __init__(self, protocol, address=ADDRESS):
        self._made_of = protocol, address
        self._drive = virtual_drive(protocol, address)
        self.alive = True
        self.heard = []

    def __getattr__(self, name):
        return getattr(self._drive, name)

    def revive(self):
        """Revive the drive in its factory state, as after switching mains on."""
        self._drive = virtual_drive(*self._made_of)
        self.alive = True

    def hear(self, find, now):
        if not self.alive:
            return None
        answer = self._drive.hear(find, now)
        if isinstance(find, Framed):
            self.heard.append((now, find.message))
        return answer


class Recorder:
    """Recorder of trace events in their order."""

    def __init__(self):
        self.events = []

    def __call__(self, event):
        self.events.append(event)

    def sent(self, drive=None):
        """Return the events of sent telegrams, for all drives or one."""
        return [event for event in self.events if event.what == "sent" and drive in (None, event.drive)]

    def of(self, what):
        return [event for event in self.events if event.what == what]


class Port:
    """Wrapper of a port that calls a hook before each call of the methods named in `hooks`."""

    def __init__(self, port, **hooks):
        self._port = port
        self._hooks = hooks

    def __getattr__(self, name):
        value = getattr(self._port, name)
        hook = self._hooks.get(name)
        if hook is None:
            return value

        def call(*arguments):
            hook(*arguments)
            return value(*arguments)

        return call


def model_of(protocol):
    return installed[protocol].default_model


def bench(*protocols, **options):
    """Return a line with one mortal drive of each protocol."""
    return VirtualLine([Mortal(protocol) for protocol in protocols], **options)


def running(line, virtual):
    virtual.motor.advance(line.time)
    return virtual.motor.running


def set_reference(protocol, drive):
    """Set half speed in a unit of the protocol; the result is awaitable if the drive's calls are."""
    if protocol in ("danfoss-fc", "uss", "vlt3500"):
        return drive.set_reference(percent=50)
    return drive.set_reference(hz=25)
