"""Options of a drive changed in a plant file, which otherwise stays as it is."""

import tomllib

import pytest

from drivecomm.errors import FileFormatError
from drivecomm.plant import read_plant, write_options

BEFORE = """# our plant
format = 1

[[line]] # the hall
name = "hall"   # short

"""
AFTER = """
# the last one
[[ drive ]]
drive = "vabus:9"
title = "options = { a = 1 }"
"""
DRIVE = """[[drive]]
name = "pump"
drive = "vlt3500:1" # the pump
"""
TUNED = {"tuned_turnaround_s": 0.0015, "reply_timeout_s": 0.1}


def changed(tmp_path, drive, options=TUNED, *, number=0, before=BEFORE, after=AFTER):
    file = tmp_path / "plant.toml"
    file.write_bytes((before + drive + after).encode())
    write_options(file, number, options)
    text = file.read_bytes().decode()
    assert text.startswith(before)
    assert text.endswith(after)
    assert dict(read_plant(file).drives[number].options).items() >= options.items()
    return text[len(before) : len(text) - len(after)]


@pytest.mark.parametrize(
    ("own", "result"),
    [
        ("", "options = { tuned_turnaround_s = 0.0015, reply_timeout_s = 0.1 }\n"),
        ("# remark\n", "options = { tuned_turnaround_s = 0.0015, reply_timeout_s = 0.1 }\n# remark\n"),
        (
            "  options = {idle_word = 0x000F} # why\n",
            "  options = {idle_word = 0x000F, tuned_turnaround_s = 0.0015, reply_timeout_s = 0.1 } # why\n",
        ),
        (
            "options = { reply_timeout_s = 0.25, idle_word = 15 }\n",
            "options = { reply_timeout_s = 0.1, idle_word = 15, tuned_turnaround_s = 0.0015 }\n",
        ),
        ("options = {}\n", "options = { tuned_turnaround_s = 0.0015, reply_timeout_s = 0.1 }\n"),
        (
            "options.idle_word = 15\noptions.reply_timeout_s = 0.3 # long\n",
            "options.tuned_turnaround_s = 0.0015\noptions.idle_word = 15\noptions.reply_timeout_s = 0.1 # long\n",
        ),
        (
            "[drive.options]\nidle_word = 1\n",
            "[drive.options]\nreply_timeout_s = 0.1\ntuned_turnaround_s = 0.0015\nidle_word = 1\n",
        ),
    ],
)
def test_options_are_changed_in_any_notation(tmp_path, own, result):
    assert changed(tmp_path, DRIVE + own) == DRIVE + result


def test_options_of_the_numbered_drive_are_changed(tmp_path):
    file = tmp_path / "plant.toml"
    file.write_text(BEFORE + '[[drive]]\ndrive = "vabus:1"\n' + AFTER)
    write_options(file, 1, TUNED)
    assert [dict(drive.options) for drive in read_plant(file).drives] == [{}, TUNED]


def test_line_ends_are_kept(tmp_path):
    file = tmp_path / "plant.toml"
    text = (BEFORE + '[[drive]]\ndrive = "vlt3500:1"\n' + AFTER).replace("\n", "\r\n")
    file.write_bytes(text.encode())
    write_options(file, 0, TUNED)
    lines = file.read_bytes().decode().split("\n")
    assert all(line.endswith("\r") for line in lines[:-1])
    assert tomllib.loads(file.read_bytes().decode())["drive"][0]["options"] == TUNED


@pytest.mark.parametrize(
    "odd",
    [
        'drive = [{ drive = "vlt3500:1" }]\n',
        '[[drive]]\ntitle = """\noptions = { a = 1 }\n"""\ndrive = "vlt3500:1"\n',
        '[[drive]]\ndrive = "vlt3500:1"\noptions = { lenient_status = true } # {why}\n',
        '[[drive]]\ndrive = "vlt3500:1"\n"options" = { idle_word = 15 }\n',
    ],
)
def test_unusual_notation_is_refused_and_the_file_stays(tmp_path, odd):
    file = tmp_path / "plant.toml"
    text = odd + '[[line]]\nname = "hall"\n'
    file.write_text(text)
    with pytest.raises(FileFormatError, match="drive 1 cannot be changed; write there: "):
        write_options(file, 0, {"idle_word": 3})
    assert file.read_text() == text


def test_missing_file_is_refused(tmp_path):
    with pytest.raises(FileFormatError, match="there is no such file"):
        write_options(tmp_path / "plant.toml", 0, TUNED)
