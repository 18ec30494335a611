"""A command line whose ports are virtual lines, so that no command waits in real time."""

import json

import pytest
import running_plant

import drivecomm.bus.opening
from drivecomm.cli import main
from drivecomm.errors import PortError
from drivecomm.virtual import VirtualLine, virtual_drive

plant = running_plant.plant


class Shell:
    """Command runner whose ports are virtual lines; keeps the output of the latest command."""

    def __init__(self, capsys):
        self.lines = {}
        self._capsys = capsys
        self.out = self.err = ""

    def line(self, *drives, name="line", **options):
        self.lines[name] = VirtualLine(drives or [virtual_drive("vabus", 1)], **options)
        return self.lines[name]

    def open(self, name):
        if name not in self.lines:
            raise PortError(f"port {name} does not exist; plug the adapter in")
        return self.lines[name].port()

    def __call__(self, *arguments, port="line"):
        given = [*arguments, *(["--port", port] if port else [])]
        code = main(given)
        captured = self._capsys.readouterr()
        self.out, self.err = captured.out, captured.err
        return code

    @property
    def objects(self):
        return [json.loads(text) for text in self.out.splitlines()]


@pytest.fixture
def shell(capsys, monkeypatch):
    monkeypatch.delenv("DRIVECOMM_PORT", raising=False)
    one = Shell(capsys)

    def port_opener(port, **_):
        return (lambda: one.open(port)) if isinstance(port, str) else port

    # Commands import `port_opener` from the package, the bus imports it from `opening`: replace both.
    for place in (drivecomm.bus, drivecomm.bus.opening):
        monkeypatch.setattr(place, "port_opener", port_opener)
    return one
