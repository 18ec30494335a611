"""Panel settings in the doctor command: read over the line, compared with the plant file, and never written."""

import os

import pytest
from serving_threads import served_in_thread

from drivecomm.cli import main
from drivecomm.virtual import Server, VirtualLine, parse_listen, virtual_drive

PLANT = """
format = 1
[[line]]
name = "hall"
port = "HALL"
[[drive]]
name = "pump"
drive = "uss:3"
line = "hall"
armed = true
options = { model = "v20" }
link_loss = { policy = "trip", watchdog_s = 2 }
[[drive]]
name = "fan"
drive = "modbus:5"
line = "hall"
armed = true
options = { model = "hitachi-wj200" }
"""


class Hall:
    """Line with two drives and its plant file; each test chooses the panel settings of the drives."""

    def __init__(self, shell, path):
        self._shell, self._path = shell, path
        self.heard = []
        self.plant = PLANT

    def examined(self, pump=None, fan=None, **options):
        """Run doctor; return its exit code and its lines about panels, each with its remedy."""
        self._path.write_text(self.plant, encoding="utf-8")
        line = VirtualLine(
            [
                virtual_drive("uss", 3, model="v20", values=pump or {}),
                virtual_drive("modbus", 5, model="hitachi-wj200", values=fan or {}),
            ],
            **options,
        )
        line.monitors.append(lambda sent: self.heard.append(sent.data))
        self._shell.lines["HALL"] = line
        code = self._shell("doctor", "--quick", "--plant", str(self._path), port=None)
        whole = self._shell.out.replace("\n                 >", "\0>").splitlines()
        return code, [text.replace("\0", "\n") for text in whole if text[9:14] == "panel"]


@pytest.fixture
def hall(shell, tmp_path):
    return Hall(shell, tmp_path / "plant.toml")


def with_text(found, text):
    (only,) = [each for each in found if text in each]
    return only


def test_panels_that_match_the_plant_file_are_fine(hall):
    code, found = hall.examined(pump={"2014": 2000})
    assert code == 0
    assert [each.partition("\n")[0] for each in found] == [
        "ok       panel   pump (uss:3): 6 of 6 panel settings that it reports match the plant file",
        "ok       panel   fan (modbus:5): 2 of 2 panel settings that it reports match the plant file",
    ]


def test_baud_rate_at_the_panel_that_differs_from_the_plant_is_a_problem(hall):
    code, found = hall.examined(pump={"2010": 7})
    assert code == 1
    wrong = with_text(found, "P2010[0]")
    assert wrong.startswith(
        "PROBLEM  panel   pump (uss:3): P2010[0] (baud rate) is 7 (19200 baud); the plant file says 9600 baud = 6\n"
    )
    assert "> set P2010[0] to 6 at the panel (SINAMICS V20 operating instructions 07/2012 p. 111)" in wrong


def test_armed_drive_that_takes_commands_elsewhere_is_a_problem(hall):
    code, found = hall.examined(fan={"0x1202": 1})
    assert code == 1
    wrong = with_text(found, "A002")
    assert wrong.startswith(
        "PROBLEM  panel   fan (modbus:5): A002 (source of the run command) is 1 (terminal), "
        "so that it obeys no command over the line\n"
    )
    assert "> set A002 to 03 (Modbus) at the panel" in wrong


def test_read_only_drive_that_takes_commands_elsewhere_is_a_note(hall):
    hall.plant = PLANT.replace(
        'armed = true\noptions = { model = "hitachi-wj200" }', 'options = { model = "hitachi-wj200" }'
    )
    code, found = hall.examined(fan={"0x1202": 1})
    assert code == 0
    assert with_text(found, "A002").startswith("note     panel   fan")


def test_different_link_loss_is_a_note_with_the_command_that_sets_it(hall):
    code, found = hall.examined(pump={"2014": 500})
    assert code == 0
    note = with_text(found, "P2014")
    assert note.startswith(
        "note     panel   pump (uss:3): P2014[0] (time until it notices) is 0.5 s; the plant file says"
    )
    assert "> drivecomm start pump sets it; at the panel set P2014[0] to 2000" in note


def test_drive_found_at_another_baud_rate_shows_its_panel_setting(hall, shell):
    hall.plant = PLANT.replace('model = "v20"', 'model = "v20", baudrate = 19200')
    hall._path.write_text(hall.plant, encoding="utf-8")
    shell.lines["HALL"] = VirtualLine([virtual_drive("uss", 3, model="v20")])
    assert shell("doctor", "--protocol", "uss", "-a", "3", "--plant", str(hall._path), port=None) == 1
    assert "PROBLEM  drives  pump (uss:3) answers at 9600 8E1, not at 19200 8E1\n" in shell.out
    assert "P2010[0] (baud rate) is 6 (9600 baud); the plant file says 19200 baud = 7\n" in shell.out


def test_setting_that_the_line_cannot_read_is_left_out(hall, tmp_path):
    row = '[[setup]]\nparameter = "P9998"\nname = "one"\npurpose = "commands"\nvalue = "1"\naddress = "9998"\n'
    fact = '[[parameter]]\naddress = "9998"\nname = "one"\ntype = "U16"\n'
    head = 'format = 1\nprotocol = "uss"\nname = "own"\nextends = "v20"\nsource = "a page"\n'
    path = tmp_path / "own.toml"
    path.write_text(head + row + row.replace("9998", "2023") + fact, encoding="utf-8")
    hall.plant = PLANT.replace('model = "v20"', f'model = "{path}"')
    code, found = hall.examined()
    assert code == 0
    assert "pump (uss:3): 1 of 1 panel settings" in found[0]


def test_json_holds_each_panel_setting(hall, shell):
    hall.examined(pump={"2010": 7})
    assert shell("doctor", "--quick", "--plant", str(hall._path), "--json", port=None) == 1
    *findings, measured = shell.objects
    assert {each["finding"] for each in findings} >= {"panel"}
    assert {"drive": "uss:3", "drive_name": "pump", "setting": "P2010[0]", "shown": "7 (19200 baud)", "wanted": ["6"],
            "agrees": False} in measured["panel"]  # fmt: skip


def test_examination_of_panels_writes_nothing(hall):
    before = {"2010": 7, "2014": 500}
    hall.examined(pump=before, fan={"0x1202": 1})
    drives = hall._shell.lines["HALL"].drives
    assert [drives[0].peek(address, 0) for address in before] == [7, 500]
    assert drives[1].peek("0x1202", 0) == 1
    # Functions 05, 06, 0F and 10 write; 3 is the address of the USS drive, whose telegrams begin with STX.
    modbus = [data for data in hall.heard if data[:1] == b"\x05"]
    assert modbus
    assert not [data for data in modbus if data[1] in (5, 6, 15, 16)]


@pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals are POSIX")
def test_wrong_panel_is_found_over_a_real_port(capsys, tmp_path):
    port = tmp_path / "line"
    drive = virtual_drive("modbus", 5, model="hitachi-wj200", values={"0x1202": 1})
    plant = tmp_path / "plant.toml"
    text = PLANT.replace("HALL", str(port))
    head, pump, fan = text.partition("[[drive]]")[0], *text.split("[[drive]]")[1:]
    assert "uss" in pump
    plant.write_text(f"{head}[[drive]]{fan}", encoding="utf-8")
    with served_in_thread(Server([drive], parse_listen(f"pty:{port}"), paced=True)):
        assert main(["doctor", "--quick", "-a", "5", "--plant", str(plant)]) == 1
    assert "A002 (source of the run command) is 1 (terminal), so that it obeys no command" in capsys.readouterr().out
