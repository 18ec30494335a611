"""The history command and plots of a history: recorded values as text, JSON, CSV, Parquet and curves."""

import json
import os
import time
from contextlib import closing
from decimal import Decimal

import pytest

from drivecomm.cli import main
from drivecomm.cli.history import history_file
from drivecomm.errors import UsageError
from drivecomm.plant.value_log import read_rows
from drivecomm.protocol import Reading
from drivecomm.server import Caller, CommandAnswer, CommandRequest, CurrentValue, Event, Role
from drivecomm.server.history import HistoryWriter

NOON = 1_795_000_000.0


def value(drive, name, number, time_s, unit="Hz", **reading):
    given = {"parameter": "241", "value": Decimal(number), "raw": 1, "unit": unit, "time_s": time_s, **reading}
    return CurrentValue(drive=drive, name=name, reading=Reading(**given), quality="good", time_s=time_s)


@pytest.fixture
def file(tmp_path, monkeypatch):
    """Write a history with values at noon of one day and in the last minute; yield its path.

    The local time zone is that of New York.
    """
    monkeypatch.setenv("TZ", "America/New_York")
    time.tzset()
    path = tmp_path / "plant.sqlite"
    journal = HistoryWriter(path)
    for n in range(10):
        journal.add_values([value("pump", "output_frequency", f"{n}.50", NOON + n)])
        journal.add_values([value("fan", "output_current", f"{n}.1", NOON + n, unit="A")])
    silent = CurrentValue(
        drive="pump", name="output_frequency", reading=None, quality="bad", cause="no reply", time_s=NOON + 10
    )
    state = value("pump", "status", 0, time.time() - 60, unit="", raw=8, text="F5 overcurrent")
    journal.add_values([silent, value("fan", "output_current", "7.7", time.time() - 60, unit="A"), state])
    journal.add_events(
        [
            Event(number=1, time_s=NOON, kind="fault", text="F0507", drive="pump", who="status"),
            Event(number=2, time_s=NOON + 5, kind="line", text="lost", line="hall"),
        ]
    )
    mary = Caller(name="mary", role=Role.OPERATE, door="http")
    asked = CommandRequest(drive="pump", verb="set_reference", arguments={"percent": Decimal("40.0")})
    journal.add_command(mary, asked, CommandAnswer(id="a", outcome="done"), asked_s=NOON, done_s=NOON + 1)
    journal.add_fault_log("pump", [Reading(parameter="15-30[0]", value=14, raw=14, text="earth fault")], time_s=NOON)
    journal.close()
    yield path
    monkeypatch.undo()
    time.tzset()


@pytest.fixture
def run(file, capsys):
    def call(*arguments, file=file):
        code = main(["history", *arguments, *(["--file", str(file)] if file else [])])
        captured = capsys.readouterr()
        return code, captured.out, captured.err

    return call


def test_history_without_arguments_shows_the_latest_values(run):
    code, out, _ = run()
    assert code == 0
    assert [line.split()[2:4] for line in out.splitlines()] == [
        ["fan", "output_current"], ["pump", "output_frequency"], ["pump", "status"],
    ]  # fmt: skip
    assert "-  bad: no reply" in out
    assert "0 (F5 overcurrent)  good" in out


def test_history_of_a_drive_shows_the_last_hour(run):
    code, out, _ = run("fan")
    assert code == 0
    assert len(out.splitlines()) == 1
    assert "7.7 A  good" in out


def test_times_are_local_with_their_zone(run):
    code, out, _ = run("pump", "output_frequency", "--from", "2026-11-18 06:06:42", "--to", "2026-11-18T11:06:43Z")
    assert code == 0
    assert out.splitlines() == [
        "2026-11-18 06:06:42.000-05:00  pump  output_frequency                2.50 Hz  good",
        "2026-11-18 06:06:43.000-05:00  pump  output_frequency                3.50 Hz  good",
    ]


def test_history_prints_json(run):
    code, out, _ = run("pump", "output_frequency", "--from", "2026-01-01", "--json")
    assert code == 0
    first, *_, last = map(json.loads, out.splitlines())
    assert (first["time_s"], first["value"], first["unit"], first["quality"]) == (NOON, "0.50", "Hz", "good")
    assert (last["value"], last["quality"], last["note"]) == (None, "bad", "no reply")


def test_events_flag_lists_events(run):
    code, out, _ = run("--events", "--from", "2026-01-01")
    assert code == 0
    assert out.splitlines() == [
        "2026-11-18 06:06:40.000-05:00  fault       pump: F0507, by status",
        "2026-11-18 06:06:45.000-05:00  line        (line hall): lost",
    ]
    code, out, _ = run("pump", "--events", "--from", "2026-01-01", "--json")
    assert [json.loads(line)["kind"] for line in out.splitlines()] == ["fault"]


def test_commands_flag_lists_commands_with_their_callers(run):
    code, out, _ = run("--commands", "--last", "9999d")
    assert code == 0
    assert out == "2026-11-18 06:06:40.000-05:00  pump  set_reference 40.0 %, by mary (http): done\n"


def test_fault_logs_flag_lists_the_fault_memory_of_a_drive(run):
    code, out, _ = run("--fault-logs", "--last", "9999d")
    assert code == 0
    assert out == "2026-11-18 06:06:40.000-05:00  pump   1  15-30[0]   14 (earth fault)\n"


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_history_is_exported_to_csv_and_parquet(run, tmp_path, ending):
    target = tmp_path / f"values.{ending}"
    code, out, _ = run("pump", "output_frequency", f"--{ending}", str(target))
    assert (code, out) == (0, f"{target}: 11 values\n")
    rows = list(read_rows(target))
    assert [row.value for row in rows] == [*(f"{n}.50" for n in range(10)), ""]
    assert (rows[0].drive, rows[0].unit, rows[0].address) == ("pump", "Hz", "241")
    assert (rows[-1].quality, rows[-1].note) == ("bad", "no reply")
    assert os.name != "posix" or target.stat().st_mode & 0o777 == 0o600
    code, _, err = run("pump", f"--{ending}", str(target))
    assert (code, err) == (
        2,
        f"drivecomm: {target} exists already; name another file, or write --force to replace it\n",
    )


@pytest.mark.soak
def test_plot_draws_a_history(file, tmp_path, capsys):
    output = tmp_path / "values.svg"
    assert main(["plot", str(file), "--drive", "pump", "-o", str(output)]) == 0
    assert capsys.readouterr().out == f"{output}: 1 curve\n"
    some = ["--from", "2026-11-18 06:06", "--to", "2026-11-18 06:07", "--force"]
    assert main(["plot", str(file), "-o", str(output), *some]) == 0
    assert "2 curves" in capsys.readouterr().out


def test_plot_finds_the_history_by_the_plant_file(file, tmp_path, capsys):
    plant = tmp_path / "hall.toml"
    kept = f'[server]\nhistory = {{ file = "{file.name}" }}\n'
    plant.write_text(f'format = 1\n{kept}[[line]]\nname = "hall"\nlisten = "tcp:127.0.0.1:0"\n')
    output = tmp_path / "values.svg"
    assert main(["plot", "--plant", str(plant), "--drive", "pump", "-o", str(output)]) == 0
    assert capsys.readouterr().out == f"{output}: 1 curve\n"
    assert main(["plot", str(file), "--plant", str(plant), "-o", str(output), "--force"]) == 2


def test_rows_are_aligned_and_in_recorded_order(run):
    when = ("--from", "2026-11-18 06:06:40", "--to", "2026-11-18 06:06:45")
    code, out, _ = run("pump", "output_frequency", "status", *when, "--json")
    assert code == 0
    rows = [json.loads(line)["row"] for line in out.splitlines()]
    assert rows == sorted(rows)
    _, out, _ = run(*when)
    assert len({line.index("output_") for line in out.splitlines()}) == 1
    assert {line.split()[2] for line in out.splitlines()} == {"pump", "fan"}


@pytest.mark.usefixtures("file")
def test_times_of_a_plot_are_local(tmp_path):
    tripped = CurrentValue(
        drive="pump",
        name="status",
        reading=Reading(parameter="status", name="status", value="fault", raw=8, text="F5", time_s=NOON),
        quality="good",
        time_s=NOON,
    )
    path, output = tmp_path / "tripped.sqlite", tmp_path / "tripped.html"
    with closing(HistoryWriter(path)) as journal:
        journal.add_values([tripped, value("pump", "output_frequency", "1.0", NOON)])
    assert main(["plot", str(path), "-o", str(output)]) == 0
    assert "2026-11-18 06:06:40-05:00" in output.read_text()


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("pmp",), "has no drive 'pmp'; did you mean 'pump'? It has pump, fan"),
        (("pump", "current", "--last", "2h"), "has no 'current' of pump; it has output_frequency, status"),
        (("--last", "2 weeks"), "invalid --last '2 weeks'; write a number and s, min, h, d or w, such as 2h"),
        (("--from", "noon"), "invalid --from 'noon'; write a local time such as \"2026-11-22 10:00\", or 10:00"),
        (("--last", "2h", "--to", "10:00"), "--last reaches to the present; give it alone, or --from and --to"),
        (("--from", "2026-02-02", "--to", "2026-01-01"), "--from 2026-02-02 is after --to 2026-01-01; swap them"),
        (("--events", "--commands"), "--events and --commands exclude each other; give one of them"),
        (("pump", "status", "--events"), "--events lists drives, not quantities; leave status out"),
        (("--plant", "x.toml"), "--file names the history itself, so --plant has no effect; leave it out"),
    ],
)
def test_history_refuses_wrong_arguments(run, arguments, says):
    code, out, err = run(*arguments)
    assert (code, out) == (2, "")
    assert says in err


def test_missing_history_file_exits_with_2(run, tmp_path):
    code, _, err = run(file=tmp_path / "none.sqlite")
    assert code == 2
    assert err == f"drivecomm: {tmp_path / 'none.sqlite'}: no such history; a server writes it while it runs\n"


def test_history_is_found_by_the_plant_file(run, file, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("DRIVECOMM_PLANT", raising=False)
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path / "state"))
    with pytest.raises(
        UsageError, match=r"there is no plant file here; give --plant plant\.toml, or the history itself"
    ):
        history_file(None)
    plant = 'format = 1\n[server]\nhistory = {}\n[[line]]\nname = "hall"\n[[drive]]\nname = "pump"\ndrive = "vabus:1"\n'
    (tmp_path / "plant.toml").write_text(plant.replace("{}", f'{{ file = "{file.name}" }}'))
    assert run(file=None)[0] == 0
    (tmp_path / "plant.toml").write_text(plant)
    assert history_file(None).is_relative_to(tmp_path / "state")
    (tmp_path / "plant.toml").write_text(plant.replace("{}", "false"))
    assert "history = false switches the history off" in run(file=None)[2]
