"""Independent masters with the virtual plant: noise and losses cause no wrong value and no hang."""

from __future__ import annotations

from random import Random

import pytest
from campaign import Campaign, seconds
from masters import DanfossMaster, FujiMaster, Line, Talk, VabusMaster, Vlt3500Master
from uss import UssMaster

# pyserial's own client of RFC 2217.
pytestmark = [pytest.mark.filterwarnings("ignore:set(Daemon|Name):DeprecationWarning"), pytest.mark.soak]

# One or two wrong bits in a character turn no check of these protocols into another valid one: an exclusive-or
# and a sum modulo 256 detect any single character, and no two bits change the sum of VLT 3500 by 100.
_NOISE = 'noise = {{ rate = 0.03, seed = {seed}, bits = 2, kinds = ["corrupt", "corrupt", "drop", "truncate"] }}'
_DRIVES = {
    "vabus": 'drive = "vabus:5"\noptions = { model = "agile" }',
    "danfoss": 'drive = "danfoss-fc:9"\noptions = { model = "fc300" }',
    "danfoss 2": 'drive = "danfoss-fc:10"\noptions = { model = "fc300" }',
    "vlt3500": 'drive = "vlt3500:7"',
    "fuji": 'drive = "fuji:11"',
    "uss": 'drive = "uss:13"',
    "uss 2": 'drive = "uss:14"',
}
_MASTERS = {
    "vabus": lambda line: VabusMaster(line, 5),
    "danfoss": lambda line: DanfossMaster(line, 9),
    "danfoss 2": lambda line: DanfossMaster(line, 10),
    "vlt3500": lambda line: Vlt3500Master(line, 7),
    "fuji": lambda line: FujiMaster(line, 11),
    "uss": lambda line: UssMaster(line, 13),
    "uss 2": lambda line: UssMaster(line, 14),
}
_LINES = {
    "a": ("pty", ("vabus", "danfoss", "danfoss 2")),
    "b": ("pty", ("vlt3500", "fuji")),
    "c": ("tcp", ("vabus", "vlt3500", "danfoss", "uss")),
    "d": ("tcp", ("fuji", "danfoss")),
    "e": ("rfc2217", ("fuji", "vlt3500")),
}
_USS_LINES = {
    name: (where, ("uss", "uss 2")) for name, where in zip("fghijk", ("pty", "tcp", "rfc2217") * 2, strict=True)
}


def plant_of(lines):
    parts = ["format = 1"]
    for number, (name, (where, drives)) in enumerate(lines.items(), 1):
        listen = f"pty:FOLDER/{name}" if where == "pty" else f"{where}:127.0.0.1:0"
        parts.append(f'[[line]]\nname = "{name}"\nlisten = "{listen}"\n{_NOISE.format(seed=number)}')
        parts += [f'[[drive]]\nname = "{each} on {name}"\nline = "{name}"\n{_DRIVES[each]}' for each in drives]
    return "\n\n".join(parts) + "\n"


@pytest.fixture
def talks_on():
    """Yield a function that opens a line and returns a talk with each of its drives."""
    opened = []

    def talks(name, url, drives, *, seed):
        line = Line(url)
        opened.append(line)
        found = [Talk(_MASTERS[each](line), line, Random(seed + place)) for place, each in enumerate(drives)]
        for talk in found:
            talk.master.name = f"{talk.master.name} on {name}"
        return found

    yield talks
    for line in opened:
        line.close()


@pytest.mark.parametrize("chosen", [_LINES, _USS_LINES], ids=["all", "uss"])
def test_independent_masters_read_and_write_the_virtual_plant(chosen, simulated, talks_on, tell):
    addresses = simulated(plant_of(chosen))
    campaign = Campaign(
        talks_on(f"{name}, {where}", addresses[name], drives, seed=100 * number)
        for number, (name, (where, drives)) in enumerate(chosen.items())
    )
    campaign.run(seconds())
    tell(campaign.report("independent masters and the virtual plant"))
    assert sum(talk.repeats for talk in campaign.talkers) > 0, "nothing went wrong on these lines"
    campaign.judge(most_failed=0.01)


@pytest.mark.parametrize("kind", ["socket", "rfc2217"])
def test_independent_masters_read_and_write_the_virtual_plant_through_ser2net(kind, simulated, ser2net, talks_on, tell):
    lines = {name: _LINES[name] for name in ("a", "b")}
    addresses = simulated(plant_of(lines))
    talks = [
        talks_on(f"{name}, ser2net {kind}", ser2net(addresses[name], kind), drives, seed=100 * number)
        for number, (name, (_, drives)) in enumerate(lines.items())
    ]
    # A change of the settings of a serial server takes some tenths of a second.
    campaign = Campaign(talks, in_a_row=5)
    campaign.run(seconds())
    tell(campaign.report(f"independent masters through ser2net ({kind}) and the virtual plant"))
    campaign.judge(most_failed=0.01)
