"""Drives by their names in a plant file, in every command; status of the whole plant; scan --write."""

from pathlib import Path

import pytest

import drivecomm.bus.bus
from drivecomm.plant import read_plant
from drivecomm.protocol import LineSettings
from drivecomm.transport import same_port
from drivecomm.virtual import VirtualLine, VirtualPlant, virtual_drive

PLANT = """
format = 1

[[line]]
name = "hall"
port = "HALL"

[[line]]
name = "yard"
port = "YARD"
echo = true

[[drive]]
name = "pump"
drive = "vabus:1"
line = "hall"
options = { model = "agile" }
armed = true
poll = [{ parameters = ["480"], period_s = 0 }]

[[drive]]
name = "fan"
title = "exhaust fan"
drive = "danfoss-fc:3"
line = "hall"
options = { model = "fc300" }

[[drive]]
name = "mixer"
drive = "fuji:2"
line = "yard"
"""

EXTRA = """
[[drive]]
name = "attic"
drive = "vabus:7"
line = "hall"
"""


@pytest.fixture
def plant(shell, tmp_path, monkeypatch):
    """Create a plant file, and its lines as ports of the shell; return the virtual plant."""
    monkeypatch.delenv("DRIVECOMM_PLANT", raising=False)
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "hall.toml"
    path.write_text(PLANT)
    virtual = VirtualPlant(read_plant(path))
    shell.lines.update({line.upper(): virtual.line(line) for line in ("hall", "yard")})
    virtual.path = str(path)
    return virtual


def test_drive_is_read_by_its_plant_name(shell, plant):
    assert shell("read", "pump", "480", "--plant", plant.path, port=None) == 0
    assert shell.out == "pump  480 fixed_frequency_1                    30.00 Hz\n"
    # The plant file also says that the line of the mixer echoes.
    assert shell("read", "mixer", "M14", "--plant", plant.path, port=None) == 0


def test_plant_file_is_found_by_the_environment_and_in_the_current_folder(shell, plant, monkeypatch):
    assert shell("status", "pump", port=None) == 2
    assert "'pump' is not a drive" in shell.err
    assert "--plant plant.toml" in shell.err
    monkeypatch.setenv("DRIVECOMM_PLANT", plant.path)
    assert shell("status", "pump", port=None) == 0
    monkeypatch.delenv("DRIVECOMM_PLANT")
    Path(plant.path).rename("plant.toml")
    assert shell("status", "pump", port=None) == 0
    # Named by its address, the drive is still that of the plant: read-only.
    assert shell("status", "danfoss-fc:3", port=None) == 0
    assert shell("reset", "danfoss-fc:3", port=None) == 2
    assert "fan is read-only in plant.toml" in shell.err


def test_address_on_a_given_port_is_not_the_drive_of_the_plant(shell, plant):
    Path(plant.path).rename("plant.toml")
    shell.line(virtual_drive("vabus", 1), virtual_drive("danfoss-fc", 3))
    shell.lines["line"].drives[0].poke("480", 1111)
    assert shell("read", "vabus:1,model=agile", "480") == 0
    assert "11.11 Hz" in shell.out
    assert shell("reset", "danfoss-fc:3") == 0
    # A plant name includes the port of its line, so another port is refused.
    assert shell("read", "pump", "480") == 2
    assert "pump is on line hall, at HALL; leave --port line out" in shell.err
    assert shell("read", "pump", "480", port="HALL") == 0
    assert "30.00 Hz" in shell.out


def test_port_from_the_environment_applies_to_addresses_and_not_to_names(shell, plant, monkeypatch):
    Path(plant.path).rename("plant.toml")
    shell.line(virtual_drive("danfoss-fc", 3))
    monkeypatch.setenv("DRIVECOMM_PORT", "line")
    assert shell("reset", "danfoss-fc:3", port=None) == 0
    assert shell("reset", "fan", port=None) == 2
    assert shell("read", "pump", "480", port=None) == 0
    assert "30.00 Hz" in shell.out


def sent_on(line):
    """Return a list that collects the telegrams sent on a line from now on."""
    sent, transmit = [], line.transmit
    line.transmit = lambda data: (sent.append(data), transmit(data))
    return sent


@pytest.mark.parametrize("how", ["port", "environment", "plant and port"])
@pytest.mark.parametrize("command", [("start", "--link-loss", "hold"), ("reset",), ("write", "3-41", "5")])
def test_read_only_drive_stays_read_only_by_its_port_and_address(shell, plant, monkeypatch, how, command):
    Path(plant.path).rename("plant.toml")
    verb, *further = command
    sent = sent_on(plant.line("hall"))
    call = [verb, "danfoss-fc:3", *further]
    if how == "environment":
        monkeypatch.setenv("DRIVECOMM_PORT", "HALL")
    elif how == "plant and port":
        call += ["--plant", "plant.toml"]
    assert shell(*call, port=None if how == "environment" else "HALL") == 2
    assert "fan is read-only in plant.toml" in shell.err
    assert sent == []
    # Reading and stopping stay allowed; on a line outside the plant the same address is another drive.
    assert shell("status", "danfoss-fc:3", port="HALL") == 0
    assert shell("stop", "danfoss-fc:3", port="HALL") == 0
    shell.line(virtual_drive("danfoss-fc", 3))
    assert shell("reset", "danfoss-fc:3") == 0


def test_port_of_the_plant_is_recognised_by_a_symbolic_link(shell, plant, tmp_path):
    (tmp_path / "HALL").touch()
    (tmp_path / "adapter").symlink_to(tmp_path / "HALL")
    Path(plant.path).rename("plant.toml")
    assert shell("reset", "danfoss-fc:3", port=str(tmp_path / "adapter")) == 2
    assert "fan is read-only in plant.toml" in shell.err


@pytest.mark.parametrize(
    ("one", "other", "same"),
    [
        ("socket://localhost:4001", "rfc2217://127.0.0.1:4001", True),
        ("socket://Hall:4001", "socket://hall:4001", True),
        ("socket://hall:4001", "socket://hall:4002", False),
        ("socket://hall:x", "socket://hall:x", True),
        ("modbus-tcp://localhost", "MODBUS-TCP://127.0.0.1:502", True),
        ("modbus-tcp://hall", "modbus-tcp://hall:5020", False),
        ("/dev/../dev/null", "/dev/null", True),
        ("COM1", "COM2", False),
        ("", "", False),
    ],
)
def test_same_port_recognises_other_spellings_of_a_port(one, other, same):
    assert same_port(one, other) is same


def test_broken_plant_file_does_not_prevent_a_stop(shell, plant):
    Path(plant.path).unlink()
    Path("plant.toml").write_text("no plant")
    assert shell("reset", "danfoss-fc:3", port="HALL") == 2
    assert "plant.toml: cannot be read as a plant" in shell.err
    assert shell("stop", "danfoss-fc:3", port="HALL") == 0
    assert "commanded" in shell.out


def test_misspelt_name_gets_a_suggestion(shell, plant):
    assert shell("status", "pmup", "--plant", plant.path, port=None) == 2
    assert "there is no drive 'pmup' in this plant; did you mean 'pump'? It has pump, fan, mixer" in shell.err
    assert shell("read", "pump", "output_frequncy", "--plant", plant.path, port=None) == 2
    assert "did you mean 'output_frequency'?" in shell.err
    assert shell("status", "pump", "--model", "agil", "--plant", plant.path, port=None) == 2
    assert "vabus has no model 'agil'; did you mean 'agile'?" in shell.err
    assert shell("status", "vabsu:1", port="HALL") == 2
    assert "no installed protocol is named 'vabsu'; did you mean 'vabus'?" in shell.err
    assert shell("call", "fan", "jgo", "--plant", plant.path, port=None) == 2
    assert "did you mean 'jog'?" in shell.err
    assert shell("status", "pump,modle=agile", "--plant", plant.path, port=None) == 2
    assert "no option 'modle'" in shell.err


@pytest.mark.parametrize(
    "call",
    [
        ("read", "pump", "480"),
        ("write", "pump", "480", "12"),
        ("reference", "pump", "10Hz"),
        ("stop", "pump"),
        ("reset", "pump"),
        ("status", "pump"),
        ("wait", "pump", "not_ready"),
        ("start", "pump", "--link-loss", "hold"),
        ("call", "pump", "control_word", "word=0"),
        ("backup", "pump", "pump.toml"),
        ("restore", "pump", "pump.toml", "--dry-run"),
    ],
)
def test_output_of_every_command_names_the_plant_drive(shell, plant, call):
    if call[0] == "restore":
        shell("backup", "pump", "pump.toml", "--plant", plant.path, port=None)
    shell(*call, "--plant", plant.path, "--json", port=None)
    assert shell.objects
    for told in shell.objects:
        assert (told["name"], told["drive"], told["line"]) == ("pump", "vabus:1", "hall"), told
    if call[0] != "backup":
        shell(*call, "--plant", plant.path, port=None)
        assert shell.out.startswith("pump  ") or "drivecomm: HALL: pump: " in shell.err
    if call[0] in ("read", "status"):
        shell(*call[:1], "vabus:1", *call[2:], "--json", port="HALL")
        assert (shell.objects[0]["name"], shell.objects[0]["line"]) == ("vabus:1", "HALL")


@pytest.mark.usefixtures("plant")
def test_line_without_a_port_takes_the_given_port(shell, tmp_path):
    path = tmp_path / "bare.toml"
    path.write_text('format = 1\n[[line]]\nname = "hall"\n[[drive]]\nname = "pump"\ndrive = "vabus:1"\n')
    assert shell("status", "pump", "--plant", str(path), port=None) == 2
    assert "line hall has no port" in shell.err
    assert shell("status", "pump", "--plant", str(path), port="HALL") == 0


@pytest.mark.usefixtures("plant")
def test_given_line_settings_override_those_of_the_plant(shell, tmp_path):
    path = tmp_path / "fast.toml"
    path.write_text(PLANT.replace('port = "HALL"', 'port = "HALL"\nbaudrate = 38400'))
    assert shell("status", "pump", "--plant", str(path), port=None) == 4
    assert shell("status", "pump", "--plant", str(path), "--baudrate", "19200", port=None) == 0


@pytest.mark.parametrize(
    "command",
    [
        ("write", "fan", "3-41", "5"),
        ("reset", "fan"),
        ("reference", "fan", "10%"),
        ("call", "fan", "jog"),
    ],
)
def test_read_only_drive_is_commanded_only_with_arm(shell, plant, command):
    sent = []
    line = plant.line("hall")
    transmit = line.transmit
    line.transmit = lambda data: (sent.append(data), transmit(data))
    assert shell(*command, "--plant", plant.path, port=None) == 2
    assert f"fan is read-only in {plant.path}; write armed = true there, or give --arm for this command" in shell.err
    assert sent == []
    policy = ("--link-loss", "hold") if command[0] == "call" else ()
    assert shell(*command, *policy, "--plant", plant.path, "--arm", port=None) == 0
    assert sent


def test_read_only_drive_may_be_stopped(shell, plant):
    assert shell("stop", "fan", "--plant", plant.path, port=None) == 0
    assert "commanded" in shell.out


def test_armed_drive_may_be_written(shell, plant):
    assert shell("write", "pump", "480", "12.5", "--plant", plant.path, port=None) == 0
    assert plant.get("pump", "480") == "000004E2"


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("door", "there is no drive 'door' in this plant; it has pump, fan, mixer"),
        ("fuji:9", "there is no drive 'fuji:9' in this plant"),
        ("pump,speed=3", "no option 'speed'"),
    ],
)
def test_unknown_drive_name_is_refused(shell, plant, name, sentence):
    assert shell("status", name, "--plant", plant.path, port=None) == 2
    assert sentence in shell.err
    assert shell.err.count("\n") == 1


@pytest.mark.usefixtures("plant")
def test_broken_plant_file_is_refused_with_its_line(shell, tmp_path):
    path = tmp_path / "wrong.toml"
    path.write_text("format = 1\n[[line]]\nname = 'hall'\narmed = true\n")
    assert shell("status", "pump", "--plant", str(path), port=None) == 2
    assert f"{path}, line 4: line 1 (hall): unknown key 'armed'" in shell.err


class TestOtherCommands:
    def test_stats_shows_named_drives_and_the_total(self, shell, plant):
        assert shell("stats", "pump", "fan", "--for", "0.5", "--plant", plant.path, port=None) == 0
        assert {"pump", "fan", "all"} <= {row.split("|")[1].strip() for row in shell.out.splitlines() if "|" in row}

    def test_stats_shows_several_lines_apart(self, shell, plant, tmp_path):
        assert shell("stats", "pump", "mixer", "--for", "0.5", "--plant", plant.path, port=None) == 0
        assert "HALL\n" in shell.out
        assert "YARD\n" in shell.out
        assert shell("stats", "--for", "0.5", "--plant", plant.path, "--json", port=None) == 0
        pump, fan, hall, mixer, yard = shell.objects
        assert [(one["name"], one["drive"], one["line"]) for one in (pump, fan, mixer)] == [
            ("pump", "vabus:1", "HALL"),
            ("fan", "danfoss-fc:3", "HALL"),
            ("mixer", "fuji:2", "YARD"),
        ]
        assert (hall["bus"], yard["bus"]) == ("HALL", "YARD")
        assert shell.err == "", "the plant says who is there, so that nobody is looked for"
        record = ("--record", str(tmp_path / "a.jsonl"))
        assert shell("stats", "pump", "mixer", *record, "--plant", plant.path, port=None) == 2
        assert "--record is for one line" in shell.err

    def test_doctor_examines_each_line(self, shell, plant):
        assert shell("doctor", "--quick", "--plant", plant.path, port=None) == 0
        assert shell.out.count("hall, HALL\n") == shell.out.count("yard, YARD\n") == 1
        for text in (
            "pump (vabus:1) answers at 19200 7E1\n",
            "fan (danfoss-fc:3) answers at 9600 8E1\n",
            "mixer (fuji:2) answers at 9600 8N1\n",
            "as --echo expect says",
        ):
            assert text in shell.out
        assert shell.out.count("no problems found\n") == 2

    @pytest.mark.parametrize("named", ["hall", "HALL"])
    def test_doctor_expects_each_drive_at_its_own_line_settings(self, shell, plant, named):
        file = Path(plant.path)
        file.write_text(PLANT.replace('model = "agile"', 'model = "agile", baudrate = 9600') + EXTRA)
        virtual = [virtual_drive("vabus", 1, baudrate=9600), virtual_drive("danfoss-fc", 3, baudrate=38400)]
        shell.lines["HALL"] = VirtualLine([*virtual, virtual_drive("vabus", 4)])
        options = ("--protocol", "vabus", "--protocol", "danfoss-fc", "--plant", plant.path)
        assert shell("doctor", named, *options, port=None) == 1
        assert "ok       drives  pump (vabus:1) answers at 9600 7E1\n" in shell.out
        assert "PROBLEM  drives  fan (danfoss-fc:3) answers at 38400 8E1, not at 9600 8E1\n" in shell.out
        assert "> write baudrate = 38400 in its options in the plant file, or set the drive to 9600\n" in shell.out
        assert "PROBLEM  drives  attic (vabus:7) does not answer at 19200 7E1: " in shell.out
        (stranger,) = [text for text in shell.out.splitlines() if "vabus:4 answers" in text]
        assert stranger.startswith("note     drives")
        assert stranger.endswith("it is not in the plant file")
        assert shell.out.endswith("2 problems found\n")
        assert shell("doctor", named, *options, "--quick", "--json", port=None) == 1
        measured = shell.objects[-1]
        assert (measured["line"], measured["port"]) == ("hall", "HALL")
        assert [(one["name"], one["answers"]) for one in measured["expected"]] == [
            ("pump", True),
            ("fan", False),
            ("attic", False),
        ]
        assert [one["drive"] for one in measured["replies"]] == ["pump", "vabus:4"]
        assert all(one["line"] == "hall" for one in shell.objects)

    def test_given_baud_rate_overrides_that_of_the_plant_in_doctor(self, shell, plant):
        Path(plant.path).write_text(PLANT.replace('model = "agile"', 'model = "agile", baudrate = 9600'))
        options = ("--protocol", "vabus", "--quick", "--plant", plant.path)
        assert shell("doctor", "hall", *options, port=None) == 1
        assert shell("doctor", "hall", *options, "--baudrate", "19200", port=None) == 0

    def test_doctor_examines_other_lines_if_one_cannot_be_opened(self, shell, plant):
        del shell.lines["HALL"]
        assert shell("doctor", "--quick", "--plant", plant.path, port=None) == 1
        assert "PROBLEM  port    port HALL does not exist; plug the adapter in" in shell.out
        assert "mixer (fuji:2) answers" in shell.out
        assert shell("doctor", "hall", "--quick", "--plant", plant.path, port=None) == 3

    def test_doctor_examines_a_port_outside_the_plant(self, shell, plant):
        shell.line(virtual_drive("fuji", 3))
        assert shell("doctor", "line", "--quick", "--protocol", "fuji", "--plant", plant.path, port=None) == 0
        assert "ok       drives  fuji:3 answers" in shell.out

    def test_poll_reads_drives_by_name(self, shell, plant):
        words = ("poll", "pump", "480", "481", "mixer", "M14", "--cycles", "1", "--plant", plant.path, "--json")
        assert shell(*words, port=None) == 0
        # Both lines are polled concurrently, so the order of rows is not fixed.
        assert sorted((one["drive"], one["parameter"], one["quality"]) for one in shell.objects) == [
            ("mixer", "M14", "good"),
            ("pump", "480", "good"),
            ("pump", "481", "good"),
        ]
        assert shell("poll", "door", "480", "--plant", plant.path, port=None) == 2
        assert "'door' is not a drive" in shell.err

    def test_poll_by_address_reads_the_drive_of_the_plant(self, shell, plant):
        assert shell("poll", "vabus:1", "480", "--cycles", "1", "--plant", plant.path, "--json", port=None) == 0
        assert [(one["drive"], one["quality"]) for one in shell.objects] == [("pump", "good")]

    def test_options_after_a_name_override_those_of_the_plant(self, shell, plant, monkeypatch):
        words = ("poll", "pump,model=act", "480", "--cycles", "1", "--plant", plant.path, "--json")
        # A plant name includes the port of its line, so --port is refused.
        assert shell(*words, port="nowhere") == 2
        assert "--port has no effect" in shell.err
        monkeypatch.setenv("DRIVECOMM_PORT", "nowhere")
        assert shell(*words, port=None) == 0
        assert shell.objects[0]["quality"] == "good"

    def test_poll_without_arguments_reads_the_poll_lists_of_the_plant(self, shell, plant, tmp_path):
        assert shell("poll", "--cycles", "2", "--plant", plant.path, "--json", port=None) == 0
        assert [(one["drive"], one["parameter"]) for one in shell.objects] == [("pump", "480")] * 2
        # A plant file also serves as a plan.
        assert shell("poll", "--cycles", "1", "--plan", plant.path, "--json", port=None) == 0
        assert [(one["drive"], one["parameter"]) for one in shell.objects] == [("pump", "480")]
        path = tmp_path / "idle.toml"
        path.write_text(PLANT.replace("poll =", "# poll ="))
        assert shell("poll", "--plant", str(path), port=None) == 2
        assert f"{path}: nothing is polled; write poll = [{{ parameters" in shell.err

    def test_poll_refuses_a_plant_with_unreadable_parameters(self, shell, plant):
        file = Path(plant.path)
        file.write_text(file.read_text().replace('["480"], period_s = 0', '["480", "output_colour", "1999"]'))
        assert shell("poll", "--plant", plant.path, port=None) == 2
        assert shell.err.startswith("drivecomm: the plan has what can never be read, take it out: pump ")
        assert "pump output_colour (" in shell.err
        assert "pump 1999 (" in shell.err

    def test_forecast_of_a_plant_names_its_port(self, shell, plant):
        assert shell("forecast", "--plant", plant.path, "--json", port=None) == 0
        assert shell.objects[0]["port"] == "HALL"

    def test_forecast_served_counts_polls_statuses_and_usual_values(self, shell, plant):
        with Path(plant.path).open("a") as file:
            file.write("[server]\nstatus_period_s = 0.5\n")
        assert shell("forecast", "--served", "--plant", plant.path, "--json", port=None) == 0
        asked = {
            (item["drive"], item["parameter"], item["period_s"]) for line in shell.objects for item in line["items"]
        }
        # A drive without a poll list is polled for those of the usual values that it has.
        usual = {("fan", "output_frequency", 1.0), ("fan", "output_current", 1.0)}
        statuses = {(name, "status", 0.5) for name in ("pump", "fan", "mixer")}
        assert asked == {("pump", "480", 0), *usual, *statuses}
        assert shell("forecast", "--served", "vabus:1", "481", "--plant", plant.path, port=None) == 2
        assert "without drives and parameters" in shell.err

    def test_forecast_of_a_plant_with_a_server_counts_its_requests(self, shell, plant):
        with Path(plant.path).open("a") as file:
            file.write("[server]\nstatus_period_s = 0.5\n")
        assert shell("forecast", "--plant", plant.path, port=None) == 0
        assert "as a server polls it: its polls, and the status of each drive every 0.5 s" in shell.out
        assert shell("forecast", "--plan", plant.path, "--json", port=None) == 0
        assert {item["parameter"] for line in shell.objects for item in line["items"]} == {
            "480", "status", "output_frequency", "output_current",
        }  # fmt: skip
        # Named parameters are counted alone, even if the plant has a server.
        assert shell("forecast", "fan", "3-41", "--plant", plant.path, "--json", port=None) == 0
        assert {item["parameter"] for line in shell.objects for item in line["items"]} == {"3-41"}


class TestServeCheck:
    def test_check_passes_for_a_plant_that_fits(self, shell, plant):
        assert shell("serve", "--check", plant.path, port=None) == 0
        assert "need" in shell.out
        assert shell.out.splitlines()[-1].endswith("; fit")

    def test_check_exits_with_1_if_a_line_is_too_full(self, shell, plant):
        with Path(plant.path).open("a") as file:
            file.write("[server]\nstatus_period_s = 0.01\n")
        assert shell("serve", "--check", plant.path, "--json", port=None) == 1
        assert False in {each["fits"] for each in shell.objects}

    def test_check_refuses_an_unreadable_users_file(self, shell, plant):
        with Path(plant.path).open("a") as file:
            file.write('[server]\nusers = "users.toml"\n')
        assert shell("serve", "--check", plant.path, port=None) == 2
        assert "users.toml" in shell.err

    def test_check_refuses_a_quantity_that_the_model_lacks(self, shell, plant):
        file = Path(plant.path)
        file.write_text(file.read_text().replace('["480"], period_s = 0', '["480", "output_colour"]'))
        assert shell("serve", "--check", plant.path, port=None) == 2
        assert "drive pump cannot be polled for output_colour: " in shell.err


class TestStatus:
    def status(self, shell, plant, *options):
        return shell("status", "--plant", plant.path, *options, port=None)

    def test_status_shows_the_whole_plant(self, shell, plant):
        assert self.status(shell, plant) == 0
        head, pump, fan, mixer, count = shell.out.splitlines()
        assert head.split() == ["name", "drive", "model", "state", "output", "current", "reference", "age"]
        assert pump.split()[:3] == ["pump", "vabus:1", "agile"]
        assert "not ready" in pump
        assert "0.00 Hz" in pump
        assert fan.split()[:3] == ["fan", "danfoss-fc:3", "fc300"]
        assert mixer.split()[:3] == ["mixer", "fuji:2", "ready"]
        assert count == "3 drives: no fault"
        assert max(map(len, shell.out.splitlines())) <= 80

    def test_fault_outranks_a_silent_drive_in_the_exit_code(self, shell, plant):
        plant.power_off("mixer")
        assert self.status(shell, plant) == 4
        assert "no answer" in shell.out
        assert "fuji:2 did not answer" in shell.out
        assert shell.out.splitlines()[-1] == "3 drives: 1 not answering"
        plant.trip("fan", 14)
        assert self.status(shell, plant) == 5
        assert "    fault 14 earth fault" in shell.out.splitlines()
        assert shell.out.splitlines()[-1] == "3 drives: 1 with a fault, 1 not answering"
        assert max(map(len, shell.out.splitlines())) <= 80

    def test_status_of_the_plant_prints_json(self, shell, plant):
        plant.power_off("mixer")
        plant.trip("fan", 14)
        assert self.status(shell, plant, "--json") == 5
        pump, fan, mixer = shell.objects
        assert (pump["name"], pump["drive"], pump["state"], pump["output_hz"]) == (
            "pump",
            "vabus:1",
            "not_ready",
            "0.00",
        )
        assert (fan["fault"], fan["fault_code"], fan["fault_text"]) == (True, 14, "earth fault")
        assert (fan["title"], fan["armed"]) == ("exhaust fan", False)
        assert (mixer["answers"], mixer["state"]) == (False, None)
        assert "did not answer" in mixer["error"]

    def test_status_exits_with_3_if_a_port_is_missing(self, shell, plant):
        del shell.lines["YARD"]
        assert self.status(shell, plant) == 3
        assert "port YARD does not exist" in shell.out

    def test_status_refuses_to_record_several_lines(self, shell, plant, tmp_path):
        assert self.status(shell, plant, "--record", str(tmp_path / "all.jsonl")) == 2
        assert "--record is for one line" in shell.err

    @pytest.mark.usefixtures("plant")
    def test_name_that_equals_the_address_is_shown_once(self, shell, tmp_path):
        path = tmp_path / "bare.toml"
        path.write_text('format = 1\n[[line]]\nname = "hall"\nport = "HALL"\n[[drive]]\ndrive = "vabus:1"\n')
        assert shell("status", "--plant", str(path), port=None) == 0
        assert shell.out.split()[:5] == ["name", "state", "output", "current", "reference"]
        assert shell.out.count("vabus:1") == 1

    @pytest.mark.usefixtures("plant")
    def test_columns_are_dropped_to_make_room_for_long_names(self, shell, tmp_path):
        path = tmp_path / "long.toml"
        path.write_text(PLANT.replace('"pump"', '"circulating pump of the cooling water"'))
        assert shell("status", "--plant", str(path), port=None) == 0
        assert max(map(len, shell.out.splitlines())) <= 80
        assert "age" not in shell.out.splitlines()[0]

    def test_status_without_a_plant_is_refused(self, shell, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        monkeypatch.delenv("DRIVECOMM_PLANT", raising=False)
        assert shell("status", port=None) == 2
        assert "drivecomm scan --write plant.toml" in shell.err
        (tmp_path / "plant.toml").write_text('format = 1\n[[line]]\nname = "hall"\n')
        assert shell("status", port=None) == 2
        assert "no drive in this plant" in shell.err


class TestScan:
    def odd_line(self, shell):
        return shell.line(
            virtual_drive("vabus", 2, baudrate=9600),
            virtual_drive("danfoss-fc", 3, baudrate=19200, parity="N"),
        )

    def test_wide_scan_finds_drives_at_other_line_settings(self, shell):
        line = self.odd_line(shell)
        wide = ("scan", "--wide", "--protocol", "vabus", "--protocol", "danfoss-fc", "-a", "1-4")
        assert shell(*wide) == 0
        assert "vabus:2  9600 7E1" in shell.out
        assert "danfoss-fc:3  19200 8N1" in shell.out
        assert "2 drives found" in shell.out
        assert "the likely ones first" in shell.err
        assert not any(drive.motor.running for drive in line.drives)

    def test_several_setting_values_scan_their_combinations(self, shell):
        self.odd_line(shell)
        asked = ("scan", "--protocol", "vabus", "-a", "1-3", "--baudrate", "9600,19200", "--parity", "e", "--json")
        assert shell(*asked, "--bytesize", "7", "--stopbits", "1") == 0
        foretold, found = shell.objects
        assert (foretold["questions"], foretold["settings"]) == (6, 2)
        assert found["settings"] == "9600 7E1"

    def test_wide_scan_is_refused_on_a_port_without_line_settings(self, shell):
        shell.line(name="socket://hall:4001")
        assert shell("scan", "--wide", port="socket://hall:4001") == 2
        assert "socket://hall:4001 carries no line settings" in shell.err
        assert shell("scan", "--protocol", "vabus", "-a", "1", port="socket://hall:4001") == 0

    def test_single_setting_value_applies_to_the_whole_scan(self, shell):
        self.odd_line(shell)
        assert shell("scan", "--protocol", "vabus", "-a", "1-3", "--baudrate", "9600") == 0
        assert shell.out.startswith("vabus:2  state")

    @pytest.mark.parametrize(
        ("option", "value", "sentence"),
        [
            ("--baudrate", "fast", "'fast' is not a baud rate"),
            ("--baudrate", "9600,3", "a baud rate of 3"),
            ("--parity", "E,X", "parity 'X'"),
            ("--stopbits", "1,two", "'two' is not a number of stop bits"),
            ("--bytesize", "7,9", "9 data bits"),
        ],
    )
    def test_scan_refuses_invalid_line_settings(self, shell, option, value, sentence):
        shell.line()
        assert shell("scan", option, value) == 2
        assert sentence in shell.err

    def test_wide_scan_writes_a_plant_file(self, shell, tmp_path):
        self.odd_line(shell)
        path = tmp_path / "plant.toml"
        wide = ("scan", "--wide", "--protocol", "vabus", "--protocol", "danfoss-fc", "-a", "1-4", "--write", str(path))
        assert shell(*wide) == 0
        assert f"written to {path}" in shell.out
        plant = read_plant(path)
        assert {drive.name for drive in plant.drives} == {"vabus:2", "danfoss-fc:3"}
        assert plant.lines[0].port == "line"
        assert shell("status", "--plant", str(path), port=None) == 0
        assert "2 drives: no fault" in shell.out
        before = path.read_text()
        assert shell(*wide) == 2
        assert "exists already; name another file, or write --force" in shell.err
        assert path.read_text() == before
        assert shell(*wide, "--force") == 0

    def test_commented_names_in_a_written_plant_file_can_be_used(self, shell, tmp_path):
        """Uncomment the names in each file, as the file itself proposes."""
        for port, number in (("line", 1), ("/dev/ttyUSB0", 2)):
            shell.line(virtual_drive("vabus", 1), virtual_drive("vabus", 2), name=port)
            path = tmp_path / f"{number}.toml"
            assert shell("scan", "--protocol", "vabus", "-a", "1-3", "--write", str(path), port=port) == 0
            text = path.read_text().replace("# name", "name")
            path.write_text(text)
            assert [drive.name for drive in read_plant(path).drives] == ["pump1", "pump2"]
            assert shell("status", "pump2", "--plant", str(path), port=None) == 0
            assert shell.out.startswith("pump2  ")
        assert read_plant(path).lines[0].name == "ttyUSB0"

    def test_scan_refuses_flags_without_effect(self, shell, plant):
        assert shell("scan", "--force") == 2
        assert "--force has no effect without --write" in shell.err
        assert shell("scan", "--plant", plant.path) == 2
        assert "--plant has no effect" in shell.err
        assert shell("scan", "--protocol", "vabus", "-a", "99") == 2
        assert "no drive of these protocols can have the address 99" in shell.err

    def test_scan_writes_nothing_if_no_drive_answers(self, shell, tmp_path):
        shell.line()
        path = tmp_path / "plant.toml"
        assert shell("scan", "--protocol", "vabus", "-a", "7", "--write", str(path)) == 1
        assert not path.exists()
        assert f"{path} is not written" in shell.out

    @pytest.mark.parametrize(
        ("trouble", "code"), [(KeyboardInterrupt(), 130), (drivecomm.LinkDownError("the adapter has gone"), 3)]
    )
    def test_interrupted_scan_writes_the_drives_found_so_far(self, shell, tmp_path, monkeypatch, trouble, code):
        line = self.odd_line(shell)
        path = tmp_path / "plant.toml"
        asked = drivecomm.bus.bus.Bus.scan

        def scan(bus, *arguments, **options):
            for one in asked(bus, *arguments, **options):
                yield one
                raise trouble

        monkeypatch.setattr(drivecomm.bus.bus.Bus, "scan", scan)
        assert shell("scan", "--wide", "--protocol", "vabus", "-a", "1-3", "--write", str(path)) == code
        assert "1 drive found" in shell.out
        assert shell.err.count("\n") == 2
        (drive,) = read_plant(path).drives
        assert drive.address == 2
        assert LineSettings(**read_plant(path).lines[0].settings) == line.drives[0].settings


@pytest.mark.parametrize("port", [None, "line"])
@pytest.mark.parametrize("words", [["read", "uus:4", "700"], ["stop", "uus:4"], ["scan", "--protocol", "uus"]])
def test_misspelt_protocol_is_reported_before_a_missing_port(shell, words, port):
    shell.line()
    if port is None and words[0] == "scan":
        pytest.skip("a scan has no drive that could be wrong before there is a port")
    assert shell(*words, port=port) == 2
    assert shell.err.startswith("drivecomm: no installed protocol is named 'uus'; did you mean 'uss'?")


PUMP_AND_BLOWER = {"pump": "vabus:1", "blower": "modbus:12"}


def test_drive_that_cannot_be_read_is_not_reported_as_silent(shell, tmp_path):
    shell.line(virtual_drive("vabus", 1))
    path = tmp_path / "plant.toml"
    drives = "".join(f'[[drive]]\nname = "{name}"\ndrive = "{at}"\n' for name, at in PUMP_AND_BLOWER.items())
    path.write_text(f'format = 1\n[[line]]\nname = "hall"\nport = "line"\n{drives}', encoding="utf-8")
    assert shell("status", "--plant", str(path), port=None) == 2
    (row,) = (line for line in shell.out.splitlines() if line.startswith("blower"))
    assert "not asked" in row
    assert "no answer" not in shell.out
    assert shell.out.splitlines()[-1] == "2 drives: 1 that cannot be polled"
