"""The backup, compare and restore commands."""

import json
import re
from pathlib import Path

import pytest

from drivecomm.plant import FaultPlan, LineFault
from drivecomm.virtual import virtual_drive

MAXIMUM = '"419[1]" = { name = "maximum_frequency", value = 50.00'
PUMP = ("vabus:1", "--model", "agile")


@pytest.fixture(autouse=True)
def _in_a_folder_of_its_own(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def saved(shell):
    """Put a drive on a line and back its parameters up to pump.toml; return the line."""
    line = shell.line()
    assert shell("backup", *PUMP, "pump.toml") == 0
    return line


class TestBackup:
    @pytest.mark.usefixtures("saved")
    def test_backup_file_is_text_with_names_values_and_units(self, shell):
        share = "76 of the 105 values that model agile knows (72 %)"
        assert shell.out == f"vabus:1  76 parameters in pump.toml, {share}\n"
        assert "--everything saves them all" in shell.err
        lines = Path("pump.toml").read_text(encoding="utf-8").splitlines()
        assert '"481[1]" = { name = "fixed_frequency_2", value = 10.00, unit = "Hz", raw = "000003E8" }' in lines
        assert '"412[1]" = { name = "local_remote", value = 1, raw = "0001" } # state machine' in lines
        assert lines.index("[communication]") < next(n for n, text in enumerate(lines) if text.startswith('"394"'))
        assert not any("control_word" in text for text in lines), "commands are no parameters"

    @pytest.mark.usefixtures("saved")
    def test_second_backup_changes_only_the_time(self, shell):
        before = Path("pump.toml").read_text(encoding="utf-8").splitlines()
        assert shell("backup", *PUMP, "pump.toml") == 0
        after = Path("pump.toml").read_text(encoding="utf-8").splitlines()
        assert all(line.startswith("time = ") for old, line in zip(before, after, strict=True) if old != line)
        assert [path.name for path in Path().iterdir()] == ["pump.toml"]

    @pytest.mark.usefixtures("saved")
    def test_backup_holds_measured_values_only_with_all(self, shell):
        assert "[measured]" not in Path("pump.toml").read_text(encoding="utf-8")
        assert shell("backup", *PUMP, "pump.toml", "--all", "--json") == 0
        assert '"210" = { name = "stator_frequency"' in Path("pump.toml").read_text(encoding="utf-8")

    def test_backup_lists_refused_parameters(self, shell):
        line = shell.line()
        line.drives[0].store._infos.pop(481)
        assert shell("backup", *PUMP, "pump.toml") == 0
        assert "vabus:1  481[1]  not read: the drive refused parameter 481[1] with code 11" in shell.out
        assert '[not_read]\n"481[1]" = "the drive refused' in Path("pump.toml").read_text(encoding="utf-8")

    def test_backup_without_a_model_is_refused(self, shell):
        shell.line()
        assert shell("backup", "vabus:1", "pump.toml") == 2
        assert "its parameters are not known without a model" in shell.err
        assert not list(Path().iterdir())

    def test_backup_writes_no_file_if_the_drive_falls_silent(self, shell):
        line = shell.line()
        line.call_at(1.0, lambda: line.power_off(line.drives[0]))
        assert shell("backup", *PUMP, "pump.toml") == 4
        assert not list(Path().iterdir())

    @pytest.mark.usefixtures("saved")
    def test_backup_does_not_replace_other_files(self, shell):
        Path("notes.toml").write_text("a = 1\n")
        assert shell("backup", *PUMP, "notes.toml") == 2
        assert "not a parameter set; give another name" in shell.err
        shell.line(virtual_drive("vabus", 2))
        assert shell("backup", "vabus:2", "pump.toml", "-m", "agile") == 2
        assert "the parameter set of vabus:1, not of vabus:2" in shell.err
        assert shell("backup", *PUMP, "nowhere/pump.toml") == 2
        assert "there is no folder nowhere" in shell.err


class TestCompare:
    def test_compare_shows_changes_of_a_drive_since_its_backup(self, shell, saved):
        assert shell("compare", "vabus:1", "pump.toml") == 0
        share, last = shell.out.splitlines()
        assert share == "  pump.toml holds 76 of the 105 values that model agile knows (72 %)"
        assert re.fullmatch(r"0 differences, \d+ equal, by address", last)
        saved.drives[0].poke("482", 1500)
        assert shell("compare", "vabus:1", "pump.toml") == 1
        assert [line.split() for line in shell.out.splitlines()][1] == [
            "482[1]", "fixed_frequency_3", "15.00", "Hz", "25.00", "Hz",
        ]  # fmt: skip

    def test_compare_prints_json(self, shell, saved):
        saved.drives[0].poke("482[3]", 1500)
        assert shell("compare", "vabus:1", "pump.toml", "--json") == 1
        assert shell.objects[0]["left"] == {"value": "15.00", "unit": "Hz", "raw": "000005DC"}
        told = shell.objects[-1]
        assert (told["same"], told["differences"], told["by"], told["remarks"]) == (False, 1, "address", [])

    @pytest.mark.usefixtures("saved")
    def test_compare_of_two_files_needs_no_line(self, shell):
        text = Path("pump.toml").read_text(encoding="utf-8")
        Path("other.toml").write_text(text.replace("value = 10.00", "value = 12.5"), encoding="utf-8")
        assert shell("compare", "pump.toml", "pump.toml", port=None) == 0
        assert shell("compare", "pump.toml", "other.toml", port=None) == 1
        assert shell("compare", "pump.toml", "vanished.toml", port=None) == 2
        assert "there is no such file" in shell.err

    def test_compare_of_two_drives_leaves_communication_settings_out(self, shell):
        shell.line(virtual_drive("vabus", 1), virtual_drive("vabus", 2))
        assert shell("compare", "vabus:1", "vabus:2", "--model", "agile") == 0
        assert shell("compare", "vabus:1", "vabus:2", "--model", "agile", "--communication") == 1
        assert "394 node" in shell.out

    @pytest.mark.usefixtures("saved")
    def test_compare_of_two_makers_goes_by_common_names(self, shell):
        # Two models of the user give a parameter of both makers the same common name.
        own = 'format = 1\nprotocol = "{}"\nname = "own"\nextends = "{}"\n[quantities]\nmaximum_frequency = "{}"\n'
        for protocol, model, address in (("vabus", "agile", "419"), ("fuji", "frenic", "F03")):
            Path(f"{protocol}.toml").write_text(own.format(protocol, model, address), encoding="utf-8")
        shell.line(virtual_drive("vabus", 1), virtual_drive("fuji", 3))
        shell("compare", "vabus:1,model=vabus.toml", "fuji:3,model=fuji.toml", "--json")
        assert "maximum_frequency" not in [one.get("parameter") for one in shell.objects]
        assert shell.objects[-1]["equal"] >= 1
        assert shell.objects[-1]["by"] == "common name"
        assert "not compared, because there is no common name" in shell.objects[-1]["remarks"][-1]
        line = shell.line(virtual_drive("vabus", 1), virtual_drive("fuji", 3))
        line.drives[1].poke("F03", 600)
        assert shell("compare", "vabus:1,model=vabus.toml", "fuji:3,model=fuji.toml") == 1
        assert re.search(r"maximum_frequency 419 maximum_frequency +50\.00 Hz +60\.0 Hz", shell.out)

    def test_compare_aligns_columns_and_lists_missing_parameters_apart(self, shell):
        shell.line(virtual_drive("danfoss-fc", 3), virtual_drive("fuji", 5, model="frenic"))
        assert shell("compare", "danfoss-fc:3,model=fc300", "fuji:5,model=frenic") == 1
        lines = shell.out.splitlines()
        rows = lines[: next(place for place, line in enumerate(lines) if line.startswith("  only in"))]
        assert len(rows) == 4
        assert len({len(row) for row in rows}) == 1, "both values end under each other"
        assert "  only in danfoss-fc:3,model=fc300: current_limit 4-18 current_limit, jog_frequency 3-11" in shell.out
        assert "motor_rated_power" not in "".join(rows)
        assert lines[-1] == "3 differences, 2 equal, 8 in one only, by common name"

    @pytest.mark.usefixtures("saved")
    def test_compare_does_not_count_a_missing_parameter_as_a_difference(self, shell):
        text = Path("pump.toml").read_text(encoding="utf-8")
        kept = [line for line in text.splitlines() if not line.startswith('"48')]
        Path("part.toml").write_text("\n".join(kept), encoding="utf-8")
        assert shell("compare", "pump.toml", "part.toml", port=None) == 0
        assert "only in pump.toml: 481[1] fixed_frequency_2, " in shell.out
        assert re.search(r"^0 differences, \d+ equal, \d+ in one only, by address$", shell.out, re.MULTILINE)
        assert shell("compare", "part.toml", "pump.toml", "--json", port=None) == 0
        assert (shell.objects[0]["kind"], shell.objects[-1]["same"]) == ("missing", True)

    def test_compare_with_factory_shows_changed_settings(self, shell):
        line = shell.line(virtual_drive("danfoss-fc", 3))
        assert shell("compare", "danfoss-fc:3", "factory", "-m", "fc300", "--json") == 1
        assert {one["parameter"] for one in shell.objects[:-1]} >= {"3-10[1]"}
        line.drives[0].poke("3-11", 77)
        shell("compare", "danfoss-fc:3", "factory", "-m", "fc300")
        assert "3-11 jog_speed" in shell.out

    @pytest.mark.usefixtures("saved")
    def test_compare_with_factory_is_refused_if_the_drive_does_not_report_it(self, shell):
        assert shell("compare", "vabus:1", "factory", "-m", "agile") == 2
        assert "back the drive up right after a reset" in shell.err
        assert shell("compare", "pump.toml", "factory", port=None) == 2


class TestRestore:
    def test_restore_writes_changed_settings_and_stores_them(self, shell, saved):
        saved.drives[0].poke("482", 1500)
        saved.drives[0].poke("418[2]", 100)
        assert shell("restore", "vabus:1", "pump.toml") == 0
        assert re.search(r"5 written and stored, \d+ equal before", shell.out)
        saved.drives[0].power_cycle(saved.time)
        assert shell("compare", "vabus:1", "pump.toml") == 0

    def test_restore_dry_run_writes_nothing(self, shell, saved):
        saved.drives[0].poke("482[1]", 1500)
        assert shell("restore", "vabus:1", "pump.toml", "--dry-run") == 0
        assert "482[1] fixed_frequency_3" in shell.out
        assert "15.00 -> 25.00 Hz" in shell.out
        assert re.search(r"1 to write, \d+ equal, \d+ left alone; nothing was written", shell.out)
        assert "communication settings are only written with --communication" in shell.out
        assert saved.drives[0].peek("482[1]", 0.0) == "000005DC"
        assert shell("restore", "vabus:1", "pump.toml", "--dry-run", "--json") == 0
        assert shell.objects[-1]["write"] == 1
        assert {one["action"] for one in shell.objects[:-1]} == {"write", "equal", "skip"}

    def test_restore_of_named_parameters_leaves_others_alone(self, shell, saved):
        saved.drives[0].poke("482", 1500)
        saved.drives[0].poke("481", 1500)
        assert shell("restore", "vabus:1", "pump.toml", "--only", "fixed_frequency_3", "--only", "481[2]") == 0
        assert "5 written" in shell.out
        assert saved.drives[0].peek("481[1]", 0.0) == "000005DC"
        assert shell("restore", "vabus:1", "pump.toml", "--only", "nonsense") == 2
        assert "has no 'nonsense'" in shell.err

    def test_volatile_restore_is_lost_at_power_off(self, shell, saved):
        saved.drives[0].poke("482", 1500)
        assert shell("restore", "vabus:1", "pump.toml", "--volatile") == 0
        assert "without a storage request" in shell.out
        saved.drives[0].power_cycle(saved.time)
        assert saved.drives[0].peek("482", 0.0) == "000005DC"

    def test_restore_writes_communication_settings_only_on_request(self, shell, saved):
        saved.drives[0].poke("10", 3)
        assert shell("restore", "vabus:1", "pump.toml") == 0
        assert saved.drives[0].peek("10", 0.0) == "0003"
        assert shell("restore", "vabus:1", "pump.toml", "--communication", "--json") == 0
        assert shell.objects[0]["written"] == ["10"]

    def test_restore_of_the_address_reports_that_the_drive_stops_answering(self, shell):
        line = shell.line(virtual_drive("vlt3500", 5))
        assert shell("backup", "vlt3500:5", "fan.toml", "-m", "vlt3500") == 0
        line.drives[0].poke("500", 9)
        assert shell("restore", "vlt3500:9", "fan.toml", "--another-drive", "--communication") == 4
        assert "500 written: it no longer answers at its old settings" in shell.out
        assert shell("compare", "vlt3500:5", "fan.toml", "--communication") == 0

    def test_restore_is_refused_while_the_motor_runs(self, shell, saved):
        assert shell("start", "vabus:1", "--model", "agile", "--link-loss", "hold") == 0
        saved.drives[0].poke("481", 1500)
        assert shell("restore", "vabus:1", "pump.toml") == 5
        assert "the motor runs" in shell.err
        assert saved.drives[0].peek("481", 0.0) == "000005DC"

    @pytest.mark.parametrize(
        ("change", "sentence"),
        [
            ({'drive = "vabus:1"': 'drive = "vabus:2"'}, "it is of vabus:2, and the drive is vabus:1"),
            ({'model = "agile"': 'model = "acu"'}, "it is of model acu, and vabus:1 is opened as agile"),
            ({'protocol = "vabus"': 'protocol = "fuji"'}, "it is of a fuji drive"),
            (
                {MAXIMUM: MAXIMUM.replace("50.00", "5000.00")},
                "419[1] maximum_frequency: 5000.00 for parameter 419 is out",
            ),
            ({MAXIMUM: MAXIMUM.replace("50.00", "50.001")}, "not rounded"),
            ({MAXIMUM: MAXIMUM.replace("50.00", '"fast"')}, "not a number"),
            ({MAXIMUM: f"{MAXIMUM}, colour = 1"}, "unknown key 'colour'"),
        ],
    )
    def test_restore_refuses_a_wrong_set_before_writing(self, shell, saved, change, sentence):
        text = Path("pump.toml").read_text(encoding="utf-8")
        ((old, new),) = change.items()
        assert old in text
        Path("pump.toml").write_text(text.replace(old, new), encoding="utf-8")
        saved.drives[0].poke("482", 1500)
        assert shell("restore", "vabus:1", "pump.toml", "-m", "agile") == 2
        assert sentence in shell.err
        assert shell.err.count("\n") == 1
        assert saved.drives[0].peek("482", 0.0) == "000005DC"
        assert [path.name for path in Path().iterdir()] == ["pump.toml"]

    @pytest.mark.usefixtures("saved")
    def test_another_drive_flag_restores_to_another_drive(self, shell):
        line = shell.line(virtual_drive("vabus", 2))
        line.drives[0].poke("482", 1500)
        assert shell("restore", "vabus:2", "pump.toml", "--another-drive") == 0
        assert "from another drive: it is of vabus:1, and the drive is vabus:2" in shell.out
        assert line.drives[0].peek("482", 0.0) == "000009C4"
        assert line.drives[0].peek("394", 0.0) == "0002"

    def test_restore_reports_refused_parameters(self, shell, saved):
        saved.drives[0].poke("482[1]", 1500)
        saved.drives[0].store._infos.pop(482)
        assert shell("restore", "vabus:1", "pump.toml") == 5
        assert "482[1] does not hold the restored value: the drive refused parameter 482" in shell.out

    @pytest.mark.usefixtures("saved")
    def test_restore_lists_written_values_with_their_old_values(self, shell, saved):
        saved.drives[0].poke("482[1]", 1500)
        saved.drives[0].poke("418[2]", 100)
        assert shell("restore", "vabus:1", "pump.toml") == 0
        told = [line.split() for line in shell.out.splitlines()]
        assert ["vabus:1", "482[1]", "fixed_frequency_3", "15.00", "->", "25.00", "Hz"] in told
        assert len([row for row in told if "->" in row]) == 2
        assert (
            len({line.index(row[3], 30) for line, row in zip(shell.out.splitlines(), told, strict=True) if "->" in row})
            == 1
        )

    def test_restore_refuses_a_read_only_drive(self, shell, saved):
        saved.drives[0].poke("482", 1500)
        plant = 'format = 1\n[[line]]\nname = "hall"\nport = "line"\n[[drive]]\nname = "pump"\ndrive = "vabus:1"\n'
        Path("plant.toml").write_text(plant, encoding="utf-8")
        for more in ([], ["--dry-run"]):
            assert shell("restore", "pump", "pump.toml", *more, port=None) == 2
            assert "pump is read-only in plant.toml" in shell.err
            assert "nothing was written" in shell.err
            assert shell.out == ""
        assert saved.drives[0].peek("482", 0.0) == "000005DC"

    def test_refused_parameters_count_in_the_last_line_and_the_exit_code(self, shell, saved):
        saved.drives[0].poke("482[1]", 1500)
        saved.drives[0].store._infos.pop(482)
        assert shell("restore", "vabus:1", "pump.toml") == 5
        assert re.search(
            r"0 written and stored, \d+ equal before, 4 refused by the drive, \d+ left alone\n\Z", shell.out
        )

    @pytest.mark.soak
    def test_unrestored_parameters_count_in_the_last_line_and_the_exit_code(self, shell, saved):
        path = Path("pump.toml")
        path.write_text(path.read_text(encoding="utf-8").replace("fixed_frequency_2", "renamed"), encoding="utf-8")
        for more, code in ((["--dry-run"], 1), ([], 1), (["--only", "482"], 0)):
            assert shell("restore", "vabus:1", "pump.toml", *more) == code
        saved.drives[0].poke("482", 1500)
        assert shell("restore", "vabus:1", "pump.toml") == 1
        assert "not restored, it is renamed in the set and fixed_frequency_2 on this drive: 481[1] " in shell.out
        assert re.search(r"4 written and stored, \d+ equal before, 4 not restored, \d+ left alone\n\Z", shell.out)
        assert shell("restore", "vabus:1", "pump.toml", "--json") == 1
        assert shell.objects[0]["missed"] == ["481[1]", "481[2]", "481[3]", "481[4]"]
        assert not shell.objects[0]["complete"]

    def test_restored_watchdog_time_does_not_switch_the_watchdog_on(self, shell):
        line = shell.line(virtual_drive("danfoss-fc", 3), virtual_drive("fuji", 5, model="frenic"))
        assert shell("backup", "danfoss-fc:3", "fan.toml", "-m", "fc300") == 0
        assert shell("restore", "fuji:5", "fan.toml", "-m", "frenic", "--another-drive", "--only", "link_timeout") == 0
        assert "0 written and stored, 2 equal before" in shell.out
        assert line.drives[1].peek("y08", 0.0) == 0
        line.drives[0].poke("8-04", 2)
        assert shell("backup", "danfoss-fc:3", "fan.toml", "-m", "fc300") == 0
        assert shell("restore", "fuji:5", "fan.toml", "-m", "frenic", "--another-drive", "--only", "8-03") == 1
        assert "not restored, the watchdog of fuji:5 (parameter y08 and y02) cannot ramp" in shell.out


class TestCutOff:
    @pytest.fixture
    def cut(self, saved):
        """Give the drive other settings; the tests interrupt the line while they are restored."""
        for address in ("481", "482", "418", "419", "421"):
            saved.drives[0].poke(address, 1)
        return saved

    def test_restore_resumes_after_a_lost_line(self, shell, cut):
        cut.call_at(cut.time + 2.6, lambda: setattr(cut, "faults", FaultPlan(rate=1.0, kinds=[LineFault.DROP])))
        assert shell("restore", "vabus:1", "pump.toml") == 4
        assert "parameters were written; repeat the command with --resume to continue" in shell.err
        journal = Path("pump.toml.vabus-1.journal")
        before = [json.loads(line) for line in journal.read_text().splitlines()][1:]
        cut.faults = FaultPlan(rate=0.0)
        cut.advance(10)
        assert shell("restore", "vabus:1", "pump.toml") == 2
        assert "continue it (--resume)" in shell.err
        assert shell("restore", "vabus:1", "pump.toml", "--resume", "--json") == 0
        assert not journal.exists()
        assert not {line["wrote"] for line in before} & set(shell.objects[0]["written"])
        assert shell("compare", "vabus:1", "pump.toml") == 0

    def test_restore_resumes_after_ctrl_c(self, shell, cut):
        def interrupt():
            raise KeyboardInterrupt

        cut.call_at(cut.time + 2.6, interrupt)
        assert shell("restore", "vabus:1", "pump.toml") == 130
        assert "repeat the command with --resume to continue" in shell.err
        assert shell.err.endswith("drivecomm: interrupted\n")
        assert shell("restore", "vabus:1", "pump.toml", "--resume") == 0

    def test_resume_refuses_a_set_changed_after_the_interruption(self, shell, cut):
        cut.call_at(cut.time + 2.6, lambda: cut.power_off(cut.drives[0]))
        assert shell("restore", "vabus:1", "pump.toml") == 4
        path = Path("pump.toml")
        path.write_text(path.read_text(encoding="utf-8").replace("value = 25.00", "value = 31.00"), encoding="utf-8")
        assert shell("restore", "vabus:1", "pump.toml", "--resume") == 2
        assert "the set was changed since" in shell.err
