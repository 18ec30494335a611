"""A plant of two lines with running motors, for tests of stops."""

import pytest

from drivecomm.virtual import virtual_drive

PLANT = """
format = 1
[[line]]
name = "hall"
port = "hall"
[[line]]
name = "yard"
port = "yard"
echo = true
baudrate = 4800
[[line]]
name = "spare"
[[drive]]
name = "pump"
drive = "vabus:1"
line = "hall"
options = { model = "agile" }
[[drive]]
name = "lift"
drive = "vabus:2"
line = "hall"
[[drive]]
name = "fan"
drive = "danfoss-fc:3"
line = "hall"
[[drive]]
name = "mill"
drive = "fuji:7"
line = "yard"
"""


@pytest.fixture
def plant(shell, tmp_path):
    """Start the drives of two lines; return the plant file, the lines, and a list that collects their telegrams."""
    lines = {
        "hall": shell.line(
            virtual_drive("vabus", 1), virtual_drive("vabus", 2), virtual_drive("danfoss-fc", 3), name="hall"
        ),
        "yard": shell.line(virtual_drive("fuji", 7, baudrate=4800), name="yard", echo=True),
    }
    for name in ("vabus:1", "vabus:2", "danfoss-fc:3"):
        assert shell("start", name, "--link-loss", "hold", port="hall") == 0
    assert shell("start", "fuji:7", "--link-loss", "hold", "--echo", "--baudrate", "4800", port="yard") == 0
    heard = []
    for name, line in lines.items():
        line.advance(20)
        line.monitors.append(lambda sent, name=name: heard.append((name, sent.source, sent.data)))
    path = tmp_path / "plant.toml"
    path.write_text(PLANT, encoding="utf-8")
    return path, lines, heard


def motors(lines):
    for line in lines.values():
        line.advance(60)
        for drive in line.drives:
            drive.motor.advance(line.time)
    return [drive.motor.running for line in lines.values() for drive in line.drives]
