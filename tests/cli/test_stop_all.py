"""stop --all: broadcasts first, then every drive by itself, all lines at once, and no word more than was confirmed."""

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
from drivecomm.cli.stop import lines_at_once
from drivecomm.cli.stop.quick import quick_arguments
from drivecomm.errors import NotSupported, UsageError
from drivecomm.protocol import Framed, Stop
from drivecomm.virtual import virtual_drive

posix = pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals are POSIX")

# The beginnings of VABus selects to the drives 1 and 2.
PUMP, LIFT = b"\x04\x41\x02", b"\x04\x42\x02"


def test_a_plant(shell, plant):
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


def test_in_json(shell, plant):
    path, _, _ = plant
    assert shell("stop", "--all", f"--plant={path}", "--how=quick", "--json", port=None) == 0
    confirmed = {each["drive"]: each["stop"] for each in shell.objects if each["confirmed"]}
    assert confirmed == {"pump": "quick", "lift": "quick", "fan": "quick", "mill": "ramp"}
    assert {each["drive"] for each in shell.objects} - set(confirmed) == {"danfoss-fc:*", "fuji:*"}


def test_what_a_drive_cannot_is_done_otherwise_and_said(shell, plant):
    path, lines, _ = plant
    assert shell("stop", "--all", "--how", "coast", "--plant", str(path), port=None) == 0
    assert "yard: mill  stop (ramp, because it cannot by coast) confirmed" in shell.out
    assert "hall: pump  stop (coast) confirmed" in shell.out
    assert "hall: vabus:*  stop (coast) sent to all" in shell.out
    assert motors(lines) == [False] * 4


def test_one_that_is_silent_keeps_nobody_from_being_stopped(shell, plant):
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


def test_one_that_missed_a_telegram_is_stopped_in_the_end(shell, plant, monkeypatch):
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


def test_a_port_that_takes_long_to_open_keeps_no_other_line_waiting(shell, plant, monkeypatch):
    path, lines, _ = plant
    stopped, opened = threading.Event(), shell.open
    lines["yard"].monitors.append(lambda sent: stopped.set() if sent.source == "drive" else None)

    def slow(name):
        if name == "hall":
            assert stopped.wait(5), "the other line waits for this one"
        return opened(name)

    monkeypatch.setattr(shell, "open", slow)
    assert shell("stop", "--all", "--plant", str(path), port=None) == 0


def test_a_line_that_is_not_there_keeps_no_other_from_being_stopped(shell, plant):
    path, lines, _ = plant
    del shell.lines["hall"]
    assert shell("stop", "--all", "--plant", str(path), port=None) == 5
    assert shell.err.count("port hall does not exist") == 3
    assert "yard: mill  stop (ramp) confirmed" in shell.out
    assert motors({"yard": lines["yard"]}) == [False]


def test_a_drive_that_says_no_is_asked_once(shell, plant):
    path, lines, _ = plant
    lines["hall"].drives[2].machine.local = True
    assert shell("stop", "--all", "--plant", str(path), port=None) == 5
    assert "fan has not confirmed its stop" in shell.err
    assert "local operation" in shell.err


def test_broadcasts_that_cannot_be_keep_no_drive_from_being_stopped(shell, plant, monkeypatch):
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


def test_a_plant_of_one_line_takes_the_port_that_is_given(shell, tmp_path):
    line = shell.line(virtual_drive("vabus", 1))
    shell("start", "vabus:1", "--link-loss", "hold")
    path = tmp_path / "plant.toml"
    path.write_text('format = 1\n[[line]]\nname = "hall"\n[[drive]]\ndrive = "vabus:1"\n', encoding="utf-8")
    assert shell("stop", "--all", "--plant", str(path), port=None) == 5
    assert "no port" in shell.err
    assert shell("stop", "--all", "--plant", str(path)) == 0
    assert motors({"line": line}) == [False]


def test_without_a_plant_everybody_is_told_and_nobody_confirms(shell):
    line = shell.line(virtual_drive("vabus", 1), virtual_drive("danfoss-fc", 3), virtual_drive("fuji", 7))
    for name in ("vabus:1", "danfoss-fc:3", "fuji:7"):
        shell("start", name, "--link-loss", "hold")
    assert shell("stop", "--all") == 5
    assert "vabus:*  stop (coast, because it cannot by ramp) sent to all" in shell.out
    assert "nobody confirms a broadcast, so look at the motors" in " ".join(shell.out.split())
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


def test_ports_that_are_missing(shell, tmp_path):
    assert shell("stop", "--all", port=None) == 2
    assert "give --port" in shell.err
    assert shell("stop", "--all", port="nowhere") == 3
    assert "nowhere does not exist" in shell.err
    path = tmp_path / "plant.toml"
    path.write_text('format = 1\n[[line]]\nname = "hall"\n', encoding="utf-8")
    assert shell("stop", "--all", "--plant", str(path)) == 2
    assert "nothing to stop" in shell.err


def test_recording_of_several_lines_is_left_out_and_holds_up_no_stop(shell, plant, tmp_path):
    path, lines, _ = plant
    assert shell("stop", "--all", "--plant", str(path), "--record", str(tmp_path / "x.jsonl"), port=None) == 0
    assert "--record is for one line" in shell.err
    assert not (tmp_path / "x.jsonl").exists()
    assert motors(lines) == [False] * 4


def test_ctrl_c(shell, monkeypatch):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("drivecomm.cli.stop.everything.stop_all", interrupted)
    assert shell("stop", "--all") == 130
    assert "interrupted" in shell.err


@posix
def test_a_signal_does_not_break_off_the_first_round(shell, plant):
    path, lines, _ = plant
    hall = lines["hall"]
    hall.power_off(hall.drives[0])
    hall.call_at(hall.time + 0.5, lambda: signal.raise_signal(signal.SIGTERM))
    assert shell("stop", "--all", "--plant", str(path), port=None) == 5
    assert "hall: pump has not confirmed its stop: vabus:1 did not answer" in shell.err
    assert shell.out.count("confirmed") == 3
    assert motors(lines)[1:] == [False] * 3


def test_after_a_signal_there_is_no_second_round(shell, plant, monkeypatch):
    path, lines, heard = plant
    hall = lines["hall"]
    hall.power_off(hall.drives[0])
    signalled = Event()
    signalled.set()
    monkeypatch.setattr(lines_at_once, "until_stopped", lambda: nullcontext(signalled))
    assert shell("stop", "--all", "--plant", str(path), port=None) == 5
    assert shell.out.count("confirmed") == 3
    to_pump = [data for name, source, data in heard if (name, source, data[:2]) == ("hall", "master", b"\x04A")]
    assert [data[3:-1] for data in to_pump] == [b"0412", b"00410040000\x03"], (
        "its mode, and without an answer 0000; once"
    )


def test_a_mistake_of_ours_in_a_thread_is_not_swallowed(shell, plant, monkeypatch, capsys):
    path, lines, _ = plant

    stopping_line = lines_at_once.stopping_line

    def fall(bus, line, *others):
        if line.name == "hall":
            raise ZeroDivisionError
        return stopping_line(bus, line, *others)

    monkeypatch.setattr(lines_at_once, "stopping_line", fall)
    with pytest.raises(ZeroDivisionError):
        shell("stop", "--all", "--plant", str(path), port=None)
    # Nor does it keep the other lines from being stopped.
    assert "yard: mill  stop (ramp) confirmed" in capsys.readouterr().out
    assert motors({"yard": lines["yard"]}) == [False]


# The short way and the usual way are one

LONG = ["--all", "--json", "--port", "--plant", "--how", "--how=coast", "--port=line", "--plant=x.toml", "--port="]
SHORT = ["-p", "-pline", "-m", "--model=act", "--al", "--", "-", "--help", "--trace", "--timeout"]
WORDS = st.sampled_from([*LONG, *SHORT, "quick", "ramp", "dc-brake", "line", "vabus:1", "1"])


@settings(max_examples=60, deadline=None)
@given(words=st.lists(WORDS, max_size=6))
def test_what_is_understood_in_haste_is_understood_the_same_way_otherwise(words):
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


def test_the_port_may_come_from_the_environment(shell, monkeypatch):
    shell.line()
    monkeypatch.setenv("DRIVECOMM_PORT", "line")
    assert shell("stop", "--all", port=None) == 5


def test_a_port_of_the_environment_hides_no_plant(shell, monkeypatch, tmp_path):
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
def test_nothing_that_is_not_needed_is_loaded_before_the_motors_are_stopped(tmp_path):
    """Loading is what takes the time of this command."""
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
def test_the_other_stop_loads_no_other_command():
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
