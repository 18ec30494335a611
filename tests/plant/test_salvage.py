"""Salvage of damaged plant files: the lines and drives that can still be read."""

import pytest

from drivecomm.errors import FileFormatError
from drivecomm.plant import salvaged

LINES = """
[[line]]
name = "hall"
port = "/dev/ttyUSB0"
echo = true
baudrate = 9600
parity = "X"

[[line]]
name = "yard"
listen = "tcp:127.0.0.1:4001"
"""


@pytest.fixture
def read(tmp_path):
    def read(text):
        path = tmp_path / "plant.toml"
        path.write_text(text)
        return salvaged(path)

    return read


def drive(name, drive="vabus:1", line="hall"):
    return f'\n[[drive]]\nname = "{name}"\ndrive = "{drive}"\nline = "{line}"\n'


def test_valid_line_settings_are_salvaged(read):
    plant, lost = read(LINES + drive("pump") + "[drive]]")
    assert plant.line("hall").opening == {"baudrate": 9600, "echo": "expect"}
    assert [line.reached_at for line in plant.lines] == ["/dev/ttyUSB0", "socket://127.0.0.1:4001"]
    assert lost == []


def test_drives_with_the_same_name_are_all_salvaged(read):
    plant, lost = read(LINES + drive("pump") + drive("pump", "danfoss-fc:3") + drive("pump", line="yard"))
    assert [(str(each), each.line) for each in plant.drives] == [
        ("vabus:1", "hall"),
        ("danfoss-fc:3", "hall"),
        ("vabus:1", "yard"),
    ]
    assert lost == []


def test_unreadable_drives_are_reported(read):
    plant, lost = read(LINES + drive("pump") + drive("lift", line="cellar") + drive("fan", "danfoss-fc"))
    assert [each.name for each in plant.drives] == ["pump"]
    assert [" ".join(text.split(": ")[1].split()[:3]) for text in lost] == ["drive 2 (lift)", "drive 3 (fan)"]


@pytest.mark.parametrize(
    ("groups", "found"),
    [('["wet", "hall 2"]', ("wet", "hall 2")), ('"wet"', ("wet",)), ('["wet", 5, "vabus:2"]', ("wet",)), ("5", ())],
)
def test_valid_names_of_damaged_groups_are_salvaged(read, groups, found):
    plant, lost = read(LINES + drive("pump") + f"groups = {groups}\n[drive]]")
    assert [each.groups for each in plant.drives] == [found]
    assert lost == []


def test_file_without_a_readable_drive_is_refused(read):
    with pytest.raises(FileFormatError, match="none of its drives can be read"):
        read(LINES + "[[drive]]")
