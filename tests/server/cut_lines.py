"""A core with one line, whose port the test can remove or whose requests it can discard."""

from contextlib import asynccontextmanager

from served_core import ENGINEER, NoteBook, asked, simulated, until

from drivecomm.errors import LinkDownError, PortError
from drivecomm.link import PortProxy
from drivecomm.plant import read_plant
from drivecomm.server.core import Core
from drivecomm.transport import SerialPort

PLANT = """\
format = 1
[[line]]
name = "yard"
listen = "tcp:127.0.0.1:0"
paced = false
"""
DRIVE = """\
[[drive]]
name = "{name}"
drive = "danfoss-fc:{address}"
line = "yard"
armed = true
options = {{ model = "fc302", reply_timeout_s = 0.05, attempts = 2 }}
link_loss = {{ policy = "ramp", watchdog_s = 60 }}
network = {{ http = ["start", "reference"] }}
"""
FAN = PLANT + DRIVE.format(name="fan", address=3)
FAN_AND_MIXER = FAN + DRIVE.format(name="mixer", address=4)


class Cable:
    """Opener of a line's port. pulled: the port is missing; deaf: the port stays and requests are lost."""

    def __init__(self, address):
        self.pulled = self.deaf = False
        self._address = address.partition("://")[2] or address

    def port(self):
        if self.pulled:
            raise PortError("the cable is pulled")
        return CutPort(SerialPort(f"socket://{self._address}"), self)


class CutPort(PortProxy):
    """A port at the end of a `Cable`."""

    def __init__(self, port, cable):
        super().__init__(port)
        self._cable = cable

    def write(self, data):
        if self._cable.pulled:
            raise LinkDownError("the cable is pulled")
        if not self._cable.deaf:
            super().write(data)


@asynccontextmanager
async def cut_core(tmp_path, text=FAN, *, pulled=False, status_period_s=0.02):
    """Yield a core, the control of its virtual drives, and the cable. pulled: the cable is unplugged from the start."""
    file = tmp_path / "plant.toml"
    file.write_text(text)
    plant = read_plant(file)
    with simulated(plant) as (server, control):
        cable = Cable(server.addresses["yard"])
        cable.pulled = pulled
        async with Core(
            plant, session="s", audit=NoteBook(), status_period_s=status_period_s, port_of=lambda _: cable.port
        ) as core:
            if not pulled:
                await until(lambda: all(each.reachability == "answers" for each in core.drives()))
            yield core, control, cable


async def run(core, drive="fan"):
    """Start a motor without a keep order."""
    assert (await asked(core, ENGINEER, drive, "set_reference", arguments={"percent": 50})).outcome == "done"
    assert (await asked(core, ENGINEER, drive, "start")).outcome == "done"


def stops_sent(core, name="yard"):
    """Return a growing list of the stops sent on a line, by the drive's name on its bus."""
    sent, link = [], core.lines[name].bus._roster.link
    stop = link.stop

    def noted(peer, *values, **options):
        sent.append(peer.name)
        return stop(peer, *values, **options)

    link.stop = noted
    return sent


def event_texts(core, *kinds):
    """Return the texts of the events of these kinds."""
    return [each.text for each in core.table.events() if each.kind in kinds]
