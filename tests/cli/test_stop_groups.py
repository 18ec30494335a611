"""stop GROUP: stops all drives of the group and no other, also by a damaged plant file."""

import re
from collections import Counter

import pytest
from running_plant import PLANT, motors

from drivecomm.errors import DriveCommError
from drivecomm.plant import read_plant
from drivecomm.virtual import virtual_drive

GROUPS = {"pump": '["wet", "hall 2"]', "lift": '["hall 2"]', "mill": '["wet"]'}
GROUPED = PLANT
for _name, _groups in GROUPS.items():
    GROUPED = GROUPED.replace(f'name = "{_name}"', f'name = "{_name}"\ngroups = {_groups}')


@pytest.fixture
def grouped(plant):
    """Add groups to the running plant: "wet" is pump and mill, "hall 2" is pump and lift; fan is in no group."""
    path, lines, heard = plant
    path.write_text(GROUPED, encoding="utf-8")
    return path, lines, heard


def stop(shell, path, *words):
    return shell("stop", *words, "--plant", str(path), port=None)


def running(lines):
    return dict(zip(("pump", "lift", "fan", "mill"), motors(lines), strict=True))


def test_stop_of_a_group_stops_its_drives_on_all_lines_and_no_other(shell, grouped):
    path, lines, heard = grouped
    assert stop(shell, path, "wet") == 0
    assert sorted(shell.out.splitlines()) == [
        "hall: pump  stop (ramp) confirmed",
        "yard: mill  stop (ramp) confirmed",
    ]
    assert shell.err == ""
    assert running(lines) == {"pump": False, "lift": True, "fan": True, "mill": False}
    assert not any(data.startswith(b"\x02\x06\x80") for _, source, data in heard if source == "master"), "no broadcast"


def test_group_name_with_a_space_is_one_argument(shell, grouped):
    path, lines, _ = grouped
    assert stop(shell, path, "hall 2", "--how", "coast") == 0
    assert running(lines) == {"pump": False, "lift": False, "fan": True, "mill": True}


def test_stop_of_overlapping_groups_and_drives_stops_each_drive_once(shell, grouped):
    path, lines, _ = grouped
    assert stop(shell, path, "hall 2", "vabus:1", "wet", "pump", "hall 2", "--json") == 0
    assert sorted(each["drive"] for each in shell.objects) == ["lift", "mill", "pump"]
    assert all(each["confirmed"] for each in shell.objects)
    assert running(lines) == {"pump": False, "lift": False, "fan": True, "mill": False}


def test_stop_of_a_group_takes_options_after_its_name_and_a_model(shell, grouped):
    path, lines, _ = grouped
    assert stop(shell, path, "hall 2,reply_timeout_s=1", "--model", "agile") == 0
    assert running(lines) == {"pump": False, "lift": False, "fan": True, "mill": True}


def test_misspelt_name_does_not_prevent_the_stop_of_a_group(shell, grouped):
    path, lines, _ = grouped
    assert stop(shell, path, "wte", "wet") == 2
    assert "there is no drive 'wte' in this plant" in shell.err
    assert running(lines) == {"pump": False, "lift": True, "fan": True, "mill": False}


def test_misspelt_group_stops_nothing_and_suggests_the_group(shell, grouped):
    path, lines, _ = grouped
    assert stop(shell, path, "wte") == 2
    assert "did you mean 'wet'?" in shell.err
    assert shell.err.count("\n") == 1
    assert all(running(lines).values())


def test_silent_drive_of_a_group_exits_with_5_and_others_are_stopped(shell, grouped):
    path, lines, _ = grouped
    lines["hall"].power_off(lines["hall"].drives[0])
    assert stop(shell, path, "wet", "wte") == 5
    assert "pump has not confirmed its stop: vabus:1 did not answer" in shell.err
    assert running(lines)["mill"] is False


def test_line_without_a_port_does_not_prevent_the_stop_of_other_lines(shell, grouped):
    path, lines, _ = grouped
    path.write_text(GROUPED.replace('port = "hall"', ""), encoding="utf-8")
    assert stop(shell, path, "wet") == 5
    assert "pump has not confirmed its stop" in shell.err
    assert "line hall has no port" in shell.err
    assert running(lines)["mill"] is False


def test_group_with_the_port_of_one_line_reports_its_drives_elsewhere(shell, grouped):
    path, lines, _ = grouped
    assert shell("stop", "wet", "--plant", str(path), port="yard") == 5
    assert "pump is on line hall, at hall; leave --port yard out" in shell.err
    assert running(lines) == {"pump": True, "lift": True, "fan": True, "mill": False}


BROKEN = {
    "unknown key": ("echo = true", "echo = true\necko = true"),
    "text without its end": ('options = { model = "agile" }', 'options = { model = "agile"'),
    "group without brackets": ('groups = ["hall 2"]', 'groups = "hall 2"'),
    "group with an invalid name beside it": ('["wet", "hall 2"]', '["wet", "a,b", "hall 2"]'),
    "no format": ("format = 1", ""),
}


@pytest.mark.parametrize("what", BROKEN)
@pytest.mark.parametrize("words", [("wet",), ("hall 2",), ("wet", "mill")], ids=" ".join)
def test_stop_of_a_group_by_a_damaged_file_stops_readable_drives_and_exits_with_5(shell, grouped, what, words):
    path, lines, _ = grouped
    path.write_text(GROUPED.replace(*BROKEN[what], 1), encoding="utf-8")
    assert stop(shell, path, *words) == 5
    members = {"wet": ("pump", "mill"), "hall 2": ("pump", "lift")}[words[0]]
    assert running(lines) == {name: name not in members for name in ("pump", "lift", "fan", "mill")}
    assert re.match(rf"drivecomm: {re.escape(str(path))}(, line \d+)?: ", shell.err)
    assert "stopping the drives that can still be read" in shell.err
    assert f"the group {words[0]!r} may have more drives than can be read there; look at the motors" in shell.err


def test_unreadable_drive_of_a_group_is_named(shell, grouped):
    path, lines, _ = grouped
    path.write_text(GROUPED.replace('drive = "vabus:1"', 'drive = "vabus 1"'), encoding="utf-8")
    assert stop(shell, path, "wet") == 5
    assert "drive 1 (pump) cannot be read, so it is not stopped by itself" in shell.err
    assert running(lines) == {"pump": True, "lift": True, "fan": True, "mill": False}


def test_group_with_the_name_of_a_drive_stops_both(shell, grouped):
    """The plant file is invalid, and the name may mean either of them."""
    path, lines, _ = grouped
    path.write_text(GROUPED.replace('"wet"', '"fan"'), encoding="utf-8")
    assert stop(shell, path, "fan") == 5
    assert "the group 'fan' has the name of a drive" in shell.err
    assert running(lines) == {"pump": False, "lift": True, "fan": False, "mill": False}


def test_group_named_like_an_address_is_ignored_in_a_damaged_file(shell, grouped):
    path, lines, _ = grouped
    path.write_text(GROUPED.replace('"wet"', '"danfoss-fc:3"'), encoding="utf-8")
    assert stop(shell, path, "danfoss-fc:3") == 0
    assert running(lines) == {"pump": True, "lift": True, "fan": False, "mill": True}


def test_group_missing_from_a_damaged_file_is_refused(shell, grouped):
    path, lines, _ = grouped
    path.write_text(GROUPED.replace('name = "mill"', 'name = "mill'), encoding="utf-8")
    assert stop(shell, path, "dry") == 2
    assert shell.err.startswith(f"drivecomm: {path}")
    assert shell.err.count("\n") == 1
    assert all(running(lines).values())


def test_fault_entry_of_another_drive_does_not_prevent_a_stop(shell, grouped):
    path, lines, _ = grouped
    path.write_text(GROUPED + '[[fault]]\ndrive = "mill"\ntrip = { code = 5, at_s = 9000 }\n', encoding="utf-8")
    assert stop(shell, path, "vabus:*") == 0
    assert stop(shell, path, "wet") == 0
    assert running(lines) == {"pump": False, "lift": False, "fan": True, "mill": False}


def test_group_of_a_single_drive_is_stopped(shell, tmp_path):
    line = shell.line(virtual_drive("vabus", 1))
    assert shell("start", "vabus:1", "--link-loss", "hold") == 0
    path = tmp_path / "plant.toml"
    text = 'format = 1\n[[line]]\nname = "hall"\nport = "line"\n[[drive]]\ndrive = "vabus:1"\ngroups = ["wet"]\n'
    path.write_text(text, encoding="utf-8")
    assert stop(shell, path, "wet") == 0
    assert shell.out == "hall: vabus:1  stop (ramp) confirmed\n"
    assert motors({"line": line}) == [False]


def damaged():
    """Yield the plant file cut off at many places, and with each line removed, cut in half or wrongly quoted."""
    lines = GROUPED.splitlines(keepends=True)
    for end in range(0, len(GROUPED), 23):
        yield GROUPED[:end]
    for number, line in enumerate(lines):
        for instead in ("", line[: len(line) // 2] + "\n", line.replace('"', "'", 1)):
            yield "".join((*lines[:number], instead, *lines[number + 1 :]))


def test_stop_of_a_group_succeeds_only_by_an_intact_plant_file(shell, grouped):
    path, _, _ = grouped
    codes = Counter()
    for text in damaged():
        path.write_text(text, encoding="utf-8")
        code = stop(shell, path, "wet")
        try:
            members = [drive.name for drive in read_plant(path).group("wet")]
        except DriveCommError:
            members = []
        if members:
            # A drive does not answer if the line settings or the echo of its line are lost.
            assert code in (0, 5), text
            assert code == 5 or shell.out.count("confirmed") == len(members), text
        else:
            assert code in (2, 5), text
            assert shell.err
        codes[code] += 1
    assert codes[0] > 10
    assert codes[5] > 30
