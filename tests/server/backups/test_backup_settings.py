"""Backup settings of a plant file: for the plant, a line and a drive."""

import pytest

from drivecomm.errors import FileFormatError
from drivecomm.plant import read_plant
from drivecomm.server.backups.settings import BackupSettings
from drivecomm.server.settings import read_settings

PLANT = """\
format = 1
[server]
{server}
[[line]]
name = "hall"
{hall}
[[line]]
name = "yard"
[[drive]]
name = "pump"
drive = "vabus:1"
line = "hall"
{pump}
[[drive]]
drive = "vabus:2"
line = "yard"
"""


@pytest.fixture
def backups(tmp_path):
    def read(server="", hall="", pump=""):
        file = tmp_path / "plant.toml"
        file.write_text(PLANT.format(server=server, hall=hall, pump=pump))
        read_plant(file)
        return read_settings(file).backups

    return read


def test_backups_are_off_by_default(backups):
    assert backups().drives == {}


def test_backups_of_a_plant_cover_every_drive(backups, tmp_path):
    said = backups(server='backup = { every = "12 h", keep = 5, everything = "1 w", folder = "sets", git = true }')
    each = BackupSettings(every_s=12 * 3600, keep=5, everything_s=7 * 86400)
    assert said.drives == {"pump": each, "vabus:2": each}
    assert (said.folder, said.git) == (tmp_path / "sets", True)


def test_backup_true_takes_the_defaults(backups, tmp_path):
    said = backups(server="backup = true")
    assert said.drives == dict.fromkeys(("pump", "vabus:2"), BackupSettings())
    assert (said.folder, said.git) == (tmp_path / "backups", False)


def test_line_and_drive_override_the_plant(backups):
    said = backups(server='backup = { every = "2 d" }', hall="backup = { share = 0.5 }", pump="backup = { keep = 2 }")
    assert said.drives["pump"] == BackupSettings(every_s=2 * 86400, share=0.5, keep=2)
    assert said.drives["vabus:2"] == BackupSettings(every_s=2 * 86400)


def test_drive_with_backup_false_is_not_backed_up(backups):
    assert set(backups(server="backup = true", pump="backup = false").drives) == {"vabus:2"}


def test_backup_of_one_line_covers_only_its_drives(backups):
    assert set(backups(hall="backup = true").drives) == {"pump"}


@pytest.mark.parametrize(
    ("where", "text", "wrong"),
    [
        ("server", 'backup = { every = "daily" }', 'line 3: server, backup: invalid every = "daily"'),
        ("server", 'backup = { everything = "0 s" }', "invalid everything"),
        ("server", "backup = { keep = 0 }", "invalid keep = 0"),
        ("server", "backup = { share = 1.5 }", "invalid share = 1.5"),
        ("server", 'backup = { folder = "" }', "folder is empty"),
        ("server", 'backup = "daily"', "invalid backup = 'daily'; write true, false, or a table"),
        ("hall", "backup = { git = true }", "unknown key 'git'"),
        ("pump", 'backup = { evry = "1 d" }', "unknown key 'evry'"),
        ("pump", "backup = 1", "invalid backup = 1"),
    ],
)
def test_invalid_backup_entry_is_refused_with_its_place(backups, where, text, wrong):
    with pytest.raises(FileFormatError, match=r"plant\.toml") as caught:
        backups(**{where: text})
    assert wrong in str(caught.value)
