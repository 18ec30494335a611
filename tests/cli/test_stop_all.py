"""stop --all: broadcasts, then a stop for each drive, all lines concurrently; only confirmed stops count."""

import os
import signal
import subprocess
import sys
import threading
from contextlib import nullcontext
from threading import Event

import pytest
from hypothesis import given, settings, strategies as st
from running_plant import motors

from drivecomm.bus import Bus
from drivecomm.cli import entry
from drivecomm.cli.stop import concurrent_lines
from drivecomm.cli.stop.quick import quick_arguments
from drivecomm.errors import NotSupported, UsageError
from drivecomm.protocol import Framed, Stop
from drivecomm.virtual import virtual_drive

posix = pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals are POSIX")

# First bytes of VABus select telegrams to drives 1 and 2.
PUMP, LIFT = b"\x04\x41\x02", b"\x04\x42\x02"


def test_stop_all_stops_every_drive_of_the_plant(shell, plant):
    path, lines, heard = plant
    assert shell("stop", "--all", "--plant", str(path), port=None) == 0
    assert sorted(shell.out.splitlines()) == [
        "hall: danfoss-fc:*  stop (ramp) sent to all",
        "hall: fan  stop (ramp) confirmed",
        "hall: lift  stop (ramp) confirmed",
        "hall: pump  stop (ramp) confirmed",
        "yard: fuji:*  stop (ramp) sent to all",
        "yard: mill  stop (ramp) confirmed",
    ]
    assert motors(lines) == [False] * 4
    first = [data for name, source, data in heard if name == "hall" and source == "master"][:2]
    assert first[0].startswith(b"\x02\x06\x80"), "Danfoss, to all; VABus drives would coast all at once, not ramp down"


def test_stop_all_prints_json(shell, plant):
    path, _, _ = plant
    assert shell("stop", "--all", f"--plant={path}", "--how=quick", "--json", port=None) == 0
    confirmed = {each["drive"]: each["stop"] for each in shell.objects if each["confirmed"]}
    assert confirmed == {"pump": "quick", "lift": "quick", "fan": "quick", "mill": "ramp"}
    assert {each["drive"] for each in shell.objects} - set(confirmed) == {"danfoss-fc:*", "fuji:*"}


def test_drive_that_lacks_the_kind_of_stop_is_stopped_another_way(shell, plant):
    path, lines, _ = plant
    assert shell("stop", "--all", "--how", "coast", "--plant", str(path), port=None) == 0
    assert "yard: mill  stop (ramp, because coast is not supported) confirmed" in shell.out
    assert "hall: pump  stop (coast) confirmed" in shell.out
    assert "hall: vabus:*  stop (coast) sent to all" in shell.out
    assert motors(lines) == [False] * 4


def test_silent_drive_does_not_delay_the_stop_of_others(shell, plant):
    path, lines, heard = plant
    hall = lines["hall"]
    hall.power_off(hall.drives[0])
    began = hall.time
    assert shell("stop", "--all", "--plant", str(path), port=None) == 5
    assert "hall: pump has not confirmed its stop: vabus:1 did not answer" in shell.err
    assert shell.err.count("\n") == 1
    assert "hall: lift  stop (ramp) confirmed" in shell.out
    order = [line.split()[1] for line in shell.out.splitlines() if line.startswith("hall:")]
    assert order == ["danfoss-fc:*", "lift", "fan"]
    assert hall.time - began < 5
    said = [data for name, source, data in heard if name == "hall" and source == "master"]
    pump, lift = ([number for number, data in enumerate(said) if data.startswith(head)] for head in (PUMP, LIFT))
    assert sum(number < lift[0] for number in pump) == 1, "once before the others, and again after them"
    assert len(pump) == 5, "412 and 0000 in each round, the last with its second attempt"


def test_drive_that_missed_a_telegram_is_stopped_by_a_retry(shell, plant, monkeypatch):
    path, lines, _ = plant
    pump = lines["hall"].drives[0]
    hear, missed = pump.hear, []

    def hear_badly(find, now):
        if isinstance(find, Framed) and find.data.startswith(PUMP) and not missed:
            missed.append(find)
            return None
        return hear(find, now)

    monkeypatch.setattr(pump, "hear", hear_badly)
    assert shell("stop", "--all", "--plant", str(path), port=None) == 0
    assert missed
    assert "hall: pump  stop (ramp) confirmed" in shell.out


def test_slow_port_does_not_delay_other_lines(shell, plant, monkeypatch):
    path, lines, _ = plant
    stopped, opened = threading.Event(), shell.open
    lines["yard"].monitors.append(lambda sent: stopped.set() if sent.source == "drive" else None)

    def slow(name):
        if name == "hall":
            assert stopped.wait(5), "the other line waits for this one"
        return opened(name)

    monkeypatch.setattr(shell, "open", slow)
    assert shell("stop", "--all", "--plant", str(path), port=None) == 0


def test_missing_port_does_not_prevent_the_stop_of_other_lines(shell, plant):
    path, lines, _ = plant
    del shell.lines["hall"]
    assert shell("stop", "--all", "--plant", str(path), port=None) == 5
    assert shell.err.count("port hall does not exist") == 3
    assert "yard: mill  stop (ramp) confirmed" in shell.out
    assert motors({"yard": lines["yard"]}) == [False]


def test_drive_in_local_operation_is_reported_as_not_confirmed(shell, plant):
    path, lines, _ = plant
    lines["hall"].drives[2].machine.local = True
    assert shell("stop", "--all", "--plant", str(path), port=None) == 5
    assert "fan has not confirmed its stop" in shell.err
    assert "local operation" in shell.err


def test_failed_broadcast_does_not_prevent_the_stop_of_each_drive(shell, plant, monkeypatch):
    path, lines, _ = plant
    broadcast = Bus.broadcast

    def some(bus, protocol, **options):
        if protocol == "vabus":
            raise NotSupported("vabus has no broadcast")
        if protocol == "fuji":
            raise UsageError("fuji cannot be told")
        return broadcast(bus, protocol, **options)

    monkeypatch.setattr(Bus, "broadcast", some)
    assert shell("stop", "--all", "--plant", str(path), port=None) == 0
    assert "vabus:*" not in shell.out + shell.err
    assert "yard: fuji:* has not confirmed its stop: fuji cannot be told" in shell.err
    assert shell.out.count("confirmed") == 4
    assert motors(lines) == [False] * 4
    assert shell("stop", "--all", port="hall") == 5
    assert "vabus: not stopped, because" in shell.out


def test_plant_of_one_line_takes_the_given_port(shell, tmp_path):
    line = shell.line(virtual_drive("vabus", 1))
    shell("start", "vabus:1", "--link-loss", "hold")
    path = tmp_path / "plant.toml"
    path.write_text('format = 1\n[[line]]\nname = "hall"\n[[drive]]\ndrive = "vabus:1"\n', encoding="utf-8")
    assert shell("stop", "--all", "--plant", str(path), port=None) == 5
    assert "no port" in shell.err
    assert shell("stop", "--all", "--plant", str(path)) == 0
    assert motors({"line": line}) == [False]


def test_stop_all_without_a_plant_broadcasts_without_confirmation(shell):
    line = shell.line(virtual_drive("vabus", 1), virtual_drive("danfoss-fc", 3), virtual_drive("fuji", 7))
    for name in ("vabus:1", "danfoss-fc:3", "fuji:7"):
        shell("start", name, "--link-loss", "hold")
    assert shell("stop", "--all") == 5
    assert "vabus:*  stop (coast, because ramp is not supported) sent to all" in shell.out
    assert "no drive confirms a broadcast, so look at the motors" in " ".join(shell.out.split())
    assert motors({"line": line}) == [False] * 3
    assert shell("stop", "--all", "--json") == 5
    assert not any(each["confirmed"] for each in shell.objects)


@pytest.mark.parametrize(
    ("arguments", "code", "sentence"),
    [
        (["--all", "vabus:1"], 2, "leave vabus:1 out"),
        ([], 2, "no drive given"),
        (["--all", "--how", "gently"], 2, "unknown kind of stop 'gently'"),
        (["--all", "--plant", "nowhere.toml"], 2, "nowhere.toml: there is no such file"),
        (["--all", "--sideways"], 2, "No such option"),
    ],
)
def test_errors_are_one_sentence(shell, arguments, code, sentence):
    shell.line()
    assert shell("stop", *arguments) == code
    assert sentence in shell.err
    assert shell.err.count("\n") == 1


def test_stop_all_reports_missing_ports(shell, tmp_path):
    assert shell("stop", "--all", port=None) == 2
    assert "give --port" in shell.err
    assert shell("stop", "--all", port="nowhere") == 3
    assert "nowhere does not exist" in shell.err
    path = tmp_path / "plant.toml"
    path.write_text('format = 1\n[[line]]\nname = "hall"\n', encoding="utf-8")
    assert shell("stop", "--all", "--plant", str(path)) == 2
    assert "nothing to stop" in shell.err


def test_recording_of_several_lines_is_left_out_and_prevents_no_stop(shell, plant, tmp_path):
    path, lines, _ = plant
    assert shell("stop", "--all", "--plant", str(path), "--record", str(tmp_path / "x.jsonl"), port=None) == 0
    assert "--record is for one line" in shell.err
    assert not (tmp_path / "x.jsonl").exists()
    assert motors(lines) == [False] * 4


def test_interrupted_stop_all_exits_with_130(shell, monkeypatch):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("drivecomm.cli.stop.everything.stop_all", interrupted)
    assert shell("stop", "--all") == 130
    assert "interrupted" in shell.err


@posix
def test_signal_does_not_end_the_first_round(shell, plant):
    path, lines, _ = plant
    hall = lines["hall"]
    hall.power_off(hall.drives[0])
    hall.call_at(hall.time + 0.5, lambda: signal.raise_signal(signal.SIGTERM))
    assert shell("stop", "--all", "--plant", str(path), port=None) == 5
    assert "hall: pump has not confirmed its stop: vabus:1 did not answer" in shell.err
    assert shell.out.count("confirmed") == 3
    assert motors(lines)[1:] == [False] * 3


def test_signal_prevents_the_second_round(shell, plant, monkeypatch):
    path, lines, heard = plant
    hall = lines["hall"]
    hall.power_off(hall.drives[0])
    signalled = Event()
    signalled.set()
    monkeypatch.setattr(concurrent_lines, "until_stopped", lambda: nullcontext(signalled))
    assert shell("stop", "--all", "--plant", str(path), port=None) == 5
    assert shell.out.count("confirmed") == 3
    to_pump = [data for name, source, data in heard if (name, source, data[:2]) == ("hall", "master", b"\x04A")]
    assert [data[3:-1] for data in to_pump] == [b"0412", b"00410040000\x03"], (
        "its mode, and without an answer 0000; once"
    )


def test_programming_error_in_a_thread_is_not_hidden(shell, plant, monkeypatch, capsys):
    path, lines, _ = plant

    stopping_line = concurrent_lines.stopping_line

    def fall(bus, line, *others):
        if line.name == "hall":
            raise ZeroDivisionError
        return stopping_line(bus, line, *others)

    monkeypatch.setattr(concurrent_lines, "stopping_line", fall)
    with pytest.raises(ZeroDivisionError):
        shell("stop", "--all", "--plant", str(path), port=None)
    # The other lines are stopped all the same.
    assert "yard: mill  stop (ramp) confirmed" in capsys.readouterr().out
    assert motors({"yard": lines["yard"]}) == [False]


# The quick parser of the stop arguments agrees with the usual one

LONG = ["--all", "--json", "--port", "--plant", "--how", "--how=coast", "--port=line", "--plant=x.toml", "--port="]
SHORT = ["-p", "-pline", "-m", "--model=act", "--al", "--", "-", "--help", "--trace", "--timeout"]
WORDS = st.sampled_from([*LONG, *SHORT, "quick", "ramp", "dc-brake", "line", "vabus:1", "1"])


@settings(max_examples=60, deadline=None)
@given(words=st.lists(WORDS, max_size=6))
def test_quick_parser_agrees_with_the_usual_parser(words):
    understood = quick_arguments(words)
    if understood is None:
        return
    came = []
    with pytest.MonkeyPatch.context() as patch:
        patch.delenv("DRIVECOMM_PORT", raising=False)
        patch.setattr(
            "drivecomm.cli.stop.one_drive.stop_one",
            lambda line, drive, model, how: came.append(((line.port, (line.plant, drive, model), how), line.json)) or 0,
        )
        patch.setattr(
            "drivecomm.cli.stop.everything.stop_all",
            lambda line, plant, how: came.append(((line.port, plant, how), line.json)) or 0,
        )
        patch.setattr(
            "drivecomm.cli.stop.several.stop_several",
            lambda line, names, model, how: (
                came.append(((line.port, (line.plant, *names, model), how), line.json)) or 0
            ),
        )
        assert entry.main(["stop", *words]) == 0
        assert entry.run(["stop", *words]) == 0
    assert len(came) == 2
    assert came[0] == came[1]
    assert came[0][0][2] is Stop(understood.get("how", "ramp"))


def test_port_may_come_from_the_environment(shell, monkeypatch):
    shell.line()
    monkeypatch.setenv("DRIVECOMM_PORT", "line")
    assert shell("stop", "--all", port=None) == 5


def test_port_of_the_environment_does_not_hide_the_plant(shell, monkeypatch, tmp_path):
    shell.line()
    monkeypatch.chdir(tmp_path)
    (tmp_path / "plant.toml").write_text(
        'format = 1\n[[line]]\nname = "hall"\nport = "line"\n[[drive]]\ndrive = "vabus:1"\n', encoding="utf-8"
    )
    monkeypatch.setenv("DRIVECOMM_PORT", "nowhere")
    assert shell("stop", "--all", port=None) == 0
    assert "vabus:1" in shell.out


@pytest.mark.soak
@posix
def test_stop_all_loads_no_unneeded_modules(tmp_path):
    """Loading modules takes most of the time of this command."""
    path = tmp_path / "plant.toml"
    path.write_text(
        'format = 1\n[[line]]\nname = "hall"\nport = "nowhere"\n[[drive]]\ndrive = "vabus:1"\n', encoding="utf-8"
    )
    program = (
        "import sys; from drivecomm.cli import main; code = main(sys.argv[1:]);"
        "print(code, *(m for m in ('click', 'rich', 'asyncio', 'drivecomm_fuji', 'drivecomm.testing',"
        "'drivecomm.traffic.sniffer', 'hypothesis') if m in sys.modules))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program, "stop", "--all", "--plant", str(path)],
        capture_output=True,
        text=True,
        check=True,
        cwd=tmp_path,
    )
    assert done.stdout.split() == ["5"]
    assert "port nowhere does not exist" in done.stderr


@posix
def test_stop_of_one_drive_loads_no_other_command():
    program = (
        "import sys; from drivecomm.cli import main; code = main(sys.argv[1:]);"
        "commands = {'demo', 'scan', 'doctor', 'read', 'write', 'start', 'status', 'poll', 'watch', 'sniff', 'models'};"
        "print(code, *(m for m in sys.modules if m == 'drivecomm.testing' or m.startswith('drivecomm.cli.')"
        " and m.split('.')[2] in commands))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program, "stop", "vabus:1", "--port", "nowhere"],
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.split() == ["3"]
