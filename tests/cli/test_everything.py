"""backup --everything and models grow --everything: forecast, progress, resumption and refused calls."""

from pathlib import Path

import pytest

from drivecomm.cli import exploring
from drivecomm.commissioning.parameter_sets import read_set
from drivecomm.models import check_model
from drivecomm.virtual import virtual_drive

PUMP = ("vabus:1", "--model", "agile")
NARROW = ("--everything", "--within", "28..31", "--within", "524")
ANSWERS = Path("pump.toml.answers")


@pytest.fixture(autouse=True)
def _in_a_folder_of_its_own(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def line(shell):
    """Put a drive on the line that answers for more parameters than its model knows."""
    return shell.line(virtual_drive("vabus", 1, model="guesses"))


def files_here():
    """Return the names of the files in the current folder."""
    return sorted(path.name for path in Path().iterdir())


def interrupt():
    """Interrupt the command as Ctrl-C does."""
    raise KeyboardInterrupt


def at_telegram(line, count, then):
    """Call `then` when the drive receives its telegram number `count`."""
    drive, heard = line.drives[0], []
    hear = drive.hear

    def counted(find, now):
        heard.append(find)
        if len(heard) == count:
            then()
        return hear(find, now)

    drive.hear = counted


@pytest.mark.usefixtures("line")
class TestBackup:
    def test_backup_holds_every_answered_address(self, shell):
        assert shell("backup", *PUMP, "pump.toml", *NARROW) == 0
        assert shell.out == (
            "vabus:1  107 parameters in pump.toml, 105 of the 105 values that model agile knows (100 %)\n"
            "vabus:1  the drive answers 107 of 109 addresses; model agile knows 105 of them (98 %), 2 are raw values "
            "that are never restored\n"
        )
        assert shell.err.startswith("drivecomm: 109 requests to the drive, about ")
        assert shell.err.endswith(" s; Ctrl-C stops it, and the same command resumes it\n")
        assert sorted(entry.address for entry in read_set(Path("pump.toml")).of(["unknown"])) == ["29", "524"]
        assert files_here() == ["pump.toml"]

    def test_backup_prints_forecast_answers_and_progress_as_json(self, shell, monkeypatch):
        monkeypatch.setattr(exploring, "_EVERY_S", 0.0)
        assert shell("backup", *PUMP, "pump.toml", *NARROW, "--json") == 0
        forecast, *events, last = shell.objects
        assert (forecast["event"], forecast["addresses"], forecast["remembered"]) == ("forecast", 109, 0)
        answers = [each for each in events if each["event"] == "answer"]
        assert len(answers) == 107
        assert {"event": "answer", "parameter": "481[1]", "value": "10.00", "unit": "Hz", "raw": "000003E8",
                "type": "long"} in answers  # fmt: skip
        progress = [each for each in events if each["event"] == "progress"]
        assert (progress[-1]["asked"], progress[-1]["of"], progress[-1]["found"]) == (109, 109, 107)
        assert last["explored"] == {"asked": 109, "answered": 107, "known": 105}
        assert last["share"] == {"model": "agile", "held": 105, "of": 105}

    def test_backup_prints_progress(self, shell, monkeypatch):
        monkeypatch.setattr(exploring, "_EVERY_S", 0.0)
        assert shell("backup", *PUMP, "pump.toml", *NARROW) == 0
        assert "drivecomm: 108 of 109 asked for, 106 found, " in shell.err
        assert " a second, " in shell.err

    @pytest.mark.parametrize(
        ("flags", "said"),
        [
            (["--everything", "--all"], "--everything includes measured values"),
            (["--within", "29"], "give --everything, too"),
            (["--everything", "--within", "9..1"], "range '9..1'"),
        ],
    )
    def test_backup_refuses_invalid_options(self, shell, flags, said):
        assert shell("backup", *PUMP, "pump.toml", *flags) == 2
        assert said in shell.err
        assert files_here() == []


class TestResumption:
    def test_backup_resumes_after_ctrl_c(self, shell, line):
        at_telegram(line, 130, interrupt)
        assert shell("backup", *PUMP, "pump.toml", *NARROW) == 130
        assert "answers stored in pump.toml.answers; run the same command again to continue" in shell.err
        assert files_here() == [str(ANSWERS)]
        kept = ANSWERS.read_text(encoding="utf-8").count("\n") - 1
        assert kept > 50
        assert shell("backup", *PUMP, "pump.toml", *NARROW) == 0
        assert f"{109 - kept} requests to the drive" in shell.err
        assert f"{kept} were answered before" in shell.err
        assert "the drive answers 107 of 109 addresses" in shell.out
        assert files_here() == ["pump.toml"]

    def test_backup_resumes_after_a_silent_drive(self, shell, line):
        hear = line.drives[0].hear

        def be_gone():
            line.drives[0].hear = lambda _find, _now: None

        at_telegram(line, 130, be_gone)
        assert shell("backup", *PUMP, "pump.toml", *NARROW) == 4
        assert "fell silent" in shell.err
        assert "run the same command again to continue" in shell.err
        line.drives[0].hear = hear
        assert shell("backup", *PUMP, "pump.toml", *NARROW) == 0

    def test_backup_refuses_answers_of_another_model_or_drive(self, shell, line):
        at_telegram(line, 130, interrupt)
        shell("backup", *PUMP, "pump.toml", *NARROW)
        assert shell("backup", "vabus:1", "--model", "act", "pump.toml", *NARROW) == 2
        assert "these are replies of model agile, not of act; remove the file to start again" in shell.err
        shell.line(virtual_drive("vabus", 2))
        assert shell("backup", "vabus:2", "--model", "agile", "pump.toml", *NARROW) == 2
        assert "these are replies of drive vabus:1, not of vabus:2" in shell.err
        assert ANSWERS.exists()


class TestGrow:
    @pytest.mark.usefixtures("line")
    def test_grow_adds_parameters_from_plain_answers(self, shell):
        grow = ("models", "grow", "vabus:1", "29", "31", "524", "481", "--model", "agile", "--write", "own.toml")
        assert shell(*grow) == 0
        assert "vabus:1  3 parameters written to own.toml" in shell.out
        assert "left out: the drive refused parameter 31" in shell.out
        text = Path("own.toml").read_text(encoding="utf-8")
        assert 'address = "29"\nname = "parameter_29"\ntitle = "parameter 29"\naccess = "r"\n' in text
        assert 'source = "answered by vabus:1"\nsure = "unconfirmed"\n' in text
        assert shell("read", "vabus:1", "29", "--model", "own.toml") == 0
        assert shell("write", "vabus:1", "29", "1", "--store", "--model", "own.toml") == 2

    @pytest.mark.soak
    @pytest.mark.usefixtures("line")
    def test_grow_covers_every_answered_address(self, shell):
        assert shell("models", "grow", "vabus:1", "--everything", "--model", "agile", "--write", "own.toml") == 0
        assert "requests to the drive" in shell.err
        assert files_here() == ["own.toml"]
        assert check_model(Path("own.toml")) == []
        text = Path("own.toml").read_text(encoding="utf-8")
        assert text.count('sure = "unconfirmed"\n') >= 42
        assert shell("backup", "vabus:1", "--model", "own.toml", "pump.toml", "--all") == 0

    @pytest.mark.soak
    def test_grow_resumes_after_ctrl_c(self, shell, line):
        grow = ("models", "grow", "vabus:1", "--everything", "--model", "agile", "--write", "own.toml")
        at_telegram(line, 130, interrupt)
        assert shell(*grow) == 130
        assert files_here() == ["own.toml.answers"]
        assert shell(*grow) == 0
        assert "were answered before" in shell.err
        assert files_here() == ["own.toml"]

    @pytest.mark.soak
    def test_grow_reads_descriptions_from_a_drive_that_has_them(self, shell):
        shell.line(virtual_drive("danfoss-fc", 1, model="vlt5000"))
        grow = ("models", "grow", "danfoss-fc:1", "--everything", "--model", "vlt6000", "--write", "own.toml")
        assert shell(*grow, "-o", "option_texts=0") == 0
        text = Path("own.toml").read_text(encoding="utf-8")
        assert 'source = "read from the drive, AK 4"\nsure = "field"\n' in text
        # 518 is the output frequency of this drive, the DC link voltage of a VLT 6000; 213 calls itself jog frequency.
        assert [finding.key for finding in check_model(Path("own.toml"))] == ["dc_link_voltage", "name"]

    @pytest.mark.usefixtures("line")
    def test_grow_refuses_invalid_options(self, shell):
        grow = ("models", "grow", "vabus:1", "--model", "agile", "--write", "own.toml")
        assert shell(*grow, "29", "--everything") == 2
        assert "name parameters or give --everything" in shell.err
        assert shell(*grow, "29", "-o", "option_texts=3") == 2
        assert "do not describe their parameters" in shell.err
        assert shell(*grow, "31") == 5
        assert files_here() == []
