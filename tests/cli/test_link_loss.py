"""The option start --link-loss: required, set before the start, renewed until Ctrl-C, in force after SIGKILL."""

import json
import os
import signal
import subprocess
import sys
import time

import pytest

import drivecomm
from drivecomm.bus import Drive, read_watchdog
from drivecomm.virtual import ControlClient, virtual_drive

posix = pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals and signals are POSIX")


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (
            ["vabus:1"],
            "hold (keeps running); with --model, also trip, ramp or coast if its watchdog can",
        ),
        (
            ["vabus:1", "-m", "agile"],
            "vabus:1: choose what the motor does if this line goes dead: --link-loss trip (the",
        ),
        (["danfoss-fc:3", "-m", "fc300"], "goes dead: --link-loss ramp or --link-loss trip"),
        (
            ["vlt3500:5", "-m", "vlt3500"],
            "hold (keeps running); its model has no watchdog for another policy",
        ),
        (["vabus:1", "--link-loss", "jump"], "'jump' is not a policy"),
        (["vabus:1", "--link-loss", "trip"], "has no model"),
        (["vabus:1", "-m", "agile", "--link-loss", "ramp"], "cannot ramp; it can hold or trip"),
        (["vabus:1", "-m", "agile", "--link-loss", "trip", "--watchdog", "2.5"], "steps of 1 s"),
        (["vabus:1", "-m", "agile", "--link-loss", "trip", "--watchdog", "soon"], "not a number"),
        (["vabus:1", "--link-loss", "hold", "--watchdog", "3"], "leave --watchdog out"),
        (["vlt3500:5", "-m", "vlt3500", "--link-loss", "trip"], "has no watchdog"),
    ],
)
def test_start_refuses_an_impossible_policy_before_sending(shell, arguments, sentence):
    line = shell.line()
    assert shell("start", *arguments) == 2
    assert sentence in shell.err
    assert shell.err.count("\n") == 1
    assert line.time == 0


def test_start_with_hold_ends_and_the_motor_keeps_running(shell):
    line = shell.line(virtual_drive("danfoss-fc", 3, model="fc300"))
    assert shell("start", "danfoss-fc:3", "--link-loss", "HOLD", "-m", "fc300", "--percent", "50") == 0
    assert shell.out == (
        "danfoss-fc:3  started, runs to 50.0 %; "
        "it keeps running without this program until drivecomm stop danfoss-fc:3\n"
    )
    line.advance(1000)
    assert line.drives[0].motor.running
    assert shell("start", "danfoss-fc:3", "--link-loss", "hold", "--json") == 0
    assert shell.objects == [
        {
            "name": "danfoss-fc:3",
            "drive": "danfoss-fc:3",
            "line": "line",
            "drive_name": "danfoss-fc:3",
            "done": "started",
            "link_loss": "hold",
            "watchdog_s": None,
        }
    ]


def test_hold_is_refused_if_the_watchdog_is_on(shell):
    line = shell.line(virtual_drive("vabus", 1, model="agile"))
    line.drives[0].poke("413", 10)
    assert shell("start", "vabus:1", "--link-loss", "hold", "-m", "agile") == 5
    assert "the watchdog of vabus:1 is on (trip after 10 s), which differs from hold" in shell.err
    assert not line.drives[0].motor.running


@posix
@pytest.mark.parametrize(("number", "code"), [("SIGINT", 130), ("SIGTERM", 143), ("SIGHUP", 129)])
def test_interrupted_hold_stops_the_motor_and_reports_it(shell, monkeypatch, number, code):
    line = shell.line(virtual_drive("vabus", 1))
    start = Drive.start

    def interrupted(drive, **how):
        start(drive, **how)
        assert line.drives[0].motor.running
        os.kill(os.getpid(), signal.Signals[number])

    monkeypatch.setattr(Drive, "start", interrupted)
    assert shell("start", "vabus:1", "--link-loss", "hold") == code
    assert shell.out == ""
    assert shell.err.splitlines() == [
        "drivecomm: vabus:1 received a stop, because its start was interrupted",
        "drivecomm: interrupted",
    ]
    line.advance(60)
    line.drives[0].motor.advance(line.time)
    assert not line.drives[0].motor.running


@posix
def test_interrupted_hold_reports_an_unconfirmed_stop(shell, monkeypatch):
    line = shell.line(virtual_drive("vabus", 1))

    def interrupted(*_, **__):
        line.power_off(line.drives[0])
        os.kill(os.getpid(), signal.SIGINT)

    monkeypatch.setattr(Drive, "start", interrupted)
    assert shell("start", "vabus:1", "--link-loss", "hold") == 130
    assert "vabus:1 may be running, because its stop is not confirmed: vabus:1 did not answer" in shell.err


@posix
def test_hold_interrupted_before_the_start_commands_nothing(shell):
    line = shell.line(virtual_drive("vabus", 1, model="agile"))
    heard = []
    line.monitors.append(lambda sent: heard.append(sent.data))
    line.call_at(0.001, lambda: os.kill(os.getpid(), signal.SIGINT))
    assert shell("start", "vabus:1", "--link-loss", "hold", "-m", "agile") == 130
    assert shell.err == "drivecomm: interrupted\n"
    # The watchdog was read, and nothing was written.
    assert not any(data[:1] == b"\x04" and b"\x02" in data for data in heard)


@posix
@pytest.mark.parametrize("number", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_start_with_trip_stays_until_a_signal_stops_it(shell, number):
    line = shell.line(virtual_drive("vabus", 1, model="agile"))
    line.call_at(100, lambda: os.kill(os.getpid(), signal.Signals[number]))
    given = ("start", "vabus:1", "--link-loss", "trip", "--watchdog", "3", "-m", "agile", "--hz", "10")
    assert shell(*given) == 0
    assert shell.out.splitlines() == [
        "vabus:1  watchdog: trip after 3 s without this program",
        "vabus:1  started, runs to 10.00 Hz; Ctrl-C stops it and restores the watchdog",
        "vabus:1  stop commanded; watchdog restored",
    ]
    assert line.time > 100
    line.advance(1000)
    line.drives[0].follow(line.time)
    assert (line.drives[0].motor.running, line.drives[0].motor.fault) == (False, 0)
    assert line.drives[0].peek("413", line.time) == "0000"


@posix
def test_start_reports_a_silent_drive_once_and_its_return(shell):
    line = shell.line(virtual_drive("vabus", 1, model="agile"))
    virtual = line.drives[0]
    hear = virtual.hear
    line.call_at(50, lambda: setattr(virtual, "hear", lambda *_: None))
    line.call_at(60, lambda: setattr(virtual, "hear", hear))
    line.call_at(90, lambda: os.kill(os.getpid(), signal.SIGTERM))
    assert shell("start", "vabus:1", "--link-loss", "trip", "--watchdog", "30", "-m", "agile") == 0
    assert shell.err.count("did not answer") == 1
    assert shell.out.count("answers again") == 1


def test_start_with_trip_ends_on_a_fault(shell):
    line = shell.line(virtual_drive("vabus", 1, model="agile"))
    line.call_at(50, lambda: line.drives[0].trip(0x0300, 50))
    assert shell("start", "vabus:1", "--link-loss", "trip", "--watchdog", "3", "-m", "agile", "--json") == 5
    assert [each["done"] for each in shell.objects] == ["watchdog set", "started", "fault", "stop commanded"]
    assert shell.objects[2]["fault_code"] == 0x0300
    assert line.time < 60


def test_failed_start_leaves_the_watchdog_off(shell):
    line = shell.line(virtual_drive("vabus", 1, model="agile"))
    line.drives[0].trip(0x0300, 0)
    assert shell("start", "vabus:1", "--link-loss", "trip", "-m", "agile") == 5
    assert "reset it first" in shell.err
    assert line.drives[0].peek("413", line.time) == "0000"


# Killed programs

WATCHDOG_S = 2
KILLED = {
    "vabus-trip": ("vabus:1", "agile", "trip", 0x2010),
    "vabus-hold": ("vabus:1", "agile", "hold", None),
    "fc-ramp": ("danfoss-fc:3", "fc300", "ramp", 0),
    "fc-trip": ("danfoss-fc:3", "fc300", "trip", 17),
    "fc-hold": ("danfoss-fc:3", "fc300", "hold", None),
    "fuji-trip": ("fuji:7", "frenic", "trip", 38),
    "fuji-hold": ("fuji:7", "frenic", "hold", None),
    "command": ("danfoss-fc:3", "fc300", "ramp", 0),
}
"""Line name: drive, model, policy, and the fault code of the stopped motor (None if the motor keeps running)."""

PROGRAM = """
import sys, threading, drivecomm
from drivecomm.bus import keep
for words in sys.argv[1:]:
    port, name, model, policy, seconds = words.split(",")
    protocol, _, address = name.partition(":")
    drive = drivecomm.open_bus(port).drive(protocol, int(address), model=model)
    keep(drive, policy, watchdog_s=seconds).__enter__()
    drive.set_reference(percent=20)
    drive.start()
print("turning", flush=True)
threading.Event().wait()
"""


@pytest.fixture
def plant(tmp_path):
    """Serve a line with a drive for each case.

    Yields the folder of the ports and a function that returns the states of the drives by name.
    """
    lines = [
        f'[[line]]\nname = "{name}"\nlisten = "pty:{tmp_path / name}"\n'
        f'[[drive]]\nname = "{name}"\nline = "{name}"\ndrive = "{drive}"\noptions = {{ model = "{model}" }}\n'
        for name, (drive, model, _, _) in KILLED.items()
    ]
    path = tmp_path / "plant.toml"
    path.write_text("format = 1\n" + "".join(lines), encoding="utf-8")
    with subprocess.Popen(
        [sys.executable, "-m", "drivecomm", "simulate", str(path), "--json"], stdout=subprocess.PIPE, text=True
    ) as process:
        with ControlClient(json.loads(process.stdout.readline())["control"]) as control:
            yield tmp_path, lambda: {each["name"]: each for each in control.order("show")["drives"]}
        process.kill()


@pytest.mark.soak
@posix
def test_killed_programs_leave_their_motors_to_the_watchdogs(plant):
    folder, states = plant
    words = [
        f"{folder / name},{drive},{model},{policy},{WATCHDOG_S}"
        for name, (drive, model, policy, _) in KILLED.items()
        if name != "command"
    ]
    given = ["danfoss-fc:3", "-m", "fc300", "--link-loss", "ramp", "--watchdog", str(WATCHDOG_S), "--percent", "20"]
    running = {"stdout": subprocess.PIPE, "text": True}
    with (
        subprocess.Popen([sys.executable, "-c", PROGRAM, *words], **running) as program,
        subprocess.Popen(
            [sys.executable, "-m", "drivecomm", "start", *given, "--port", str(folder / "command")], **running
        ) as command,
    ):
        try:
            assert program.stdout.readline() == "turning\n"
            assert "ramp after 2.0 s" in command.stdout.readline()
            assert "started" in command.stdout.readline()
            time.sleep(WATCHDOG_S + 0.5)
            for name, state in states().items():
                assert (state["running"], state["fault"]) == (True, 0), f"{name} is spoken to"
        finally:
            # Kill both even if the test has failed.
            program.send_signal(signal.SIGKILL)
            command.send_signal(signal.SIGKILL)
    killed_at = time.monotonic()
    standing = {name for name, (*_, fault) in KILLED.items() if fault is not None}
    while any(states()[name]["running"] for name in standing):
        assert time.monotonic() - killed_at < 20, states()
        time.sleep(0.05)
    assert time.monotonic() - killed_at > WATCHDOG_S / 2
    time.sleep(0.2)
    found = states()
    assert {name: found[name]["fault"] for name in standing} == {name: KILLED[name][3] for name in standing}
    for name in set(KILLED) - standing:
        assert (found[name]["running"], found[name]["fault"]) == (True, 0), f"{name} goes on"
    with drivecomm.open_bus(str(folder / "command")) as bus:
        left = read_watchdog(bus.drive("danfoss-fc", 3, model="fc300"))
    assert str(left) == "ramp after 2.0 s", "who is killed cannot set it as it was"


JOG = ["call", "danfoss-fc:3", "jog", "-m", "fc300"]
RUN_WORD = ["call", "danfoss-fc:3", "control_word", "word=0x047C", "-m", "fc300"]
VABUS_WORD = ["write", "vabus:1", "410", "6", "-m", "agile"]
S06 = ["write", "fuji:2", "S06", "1", "-m", "frenic"]
MODBUS_COMMAND = ["write", "modbus:4", "0x2000", "18", "-m", "delta"]
BY_EFFECT = [JOG, RUN_WORD, VABUS_WORD, [*VABUS_WORD, "--read-back"], S06, MODBUS_COMMAND]


def every_drive(shell):
    return shell.line(
        virtual_drive("vabus", 1, model="agile"),
        virtual_drive("danfoss-fc", 3, model="fc300"),
        virtual_drive("fuji", 2, model="frenic"),
        virtual_drive("modbus", 4, model="delta"),
    )


@pytest.mark.parametrize("command", BY_EFFECT)
def test_command_that_may_start_a_motor_is_refused_without_a_policy(shell, command):
    line = every_drive(shell)
    assert shell(*command) == 2
    assert "this may start the motor; choose what the motor does if this line goes dead: --link-loss" in shell.err
    assert line.time == 0
    assert shell(*command, "--link-loss", "jump") == 2
    assert line.time == 0


@pytest.mark.parametrize(
    "command",
    [
        ["write", "fuji:2", "S05", "20", "-m", "frenic"],
        ["write", "fuji:2", "S06", "0", "-m", "frenic"],
        ["write", "vabus:1", "480", "20", "-m", "agile"],
        ["write", "vabus:1", "410", "0", "-m", "agile"],
        ["write", "modbus:4", "0x2000", "1", "-m", "delta"],
        ["call", "danfoss-fc:3", "control_word", "word=0x043C", "-m", "fc300"],
        ["reference", "vabus:1", "20Hz", "-m", "agile"],
    ],
)
def test_command_that_starts_no_motor_needs_no_policy(shell, command):
    line = every_drive(shell)
    assert shell(*command) == 0
    line.advance(30)
    assert not any(drive.motor.running for drive in line.drives)
    if command[0] != "reference":
        assert shell(*command, "--link-loss", "hold") == 2
        assert "--link-loss only applies to a start of the motor, which this is not; leave it out" in shell.err


def test_jog_with_hold_prints_the_speed_and_the_stop_command(shell):
    line = every_drive(shell)
    assert shell(*JOG, "--link-loss", "hold") == 0
    assert shell.out == (
        "danfoss-fc:3  commanded, turns at 5.0 Hz; "
        "it keeps running without this program until drivecomm stop danfoss-fc:3\n"
    )
    line.advance(100)
    assert [drive.motor.running for drive in line.drives] == [False, True, False, False]


def test_reference_to_a_motor_started_elsewhere_prints_the_start_command(shell):
    line = shell.line(virtual_drive("danfoss-fc", 3, model="fc300"))
    assert shell("start", "danfoss-fc:3", "-m", "fc300", "--link-loss", "hold", "--percent", "20") == 0
    assert shell("reference", "danfoss-fc:3", "30%", "-m", "fc300") == 5
    given = "drivecomm start danfoss-fc:3 --link-loss hold --percent 30"
    assert f"give the new speed with the start: {given}\n" in shell.err
    assert shell(*given.split()[1:], "-m", "fc300") == 0
    line.advance(30)
    assert shell("read", "danfoss-fc:3", "output_frequency", "-m", "fc300") == 0
    assert "15.0 Hz" in shell.out


@pytest.mark.parametrize(
    ("protocol", "model", "parameter"), [("danfoss-fc", "fc300", "3-03"), ("modbus", "danfoss-fc", "3030")]
)
def test_reference_in_hertz_without_a_range_prints_the_range_of_the_drive(shell, protocol, model, parameter):
    shell.line(virtual_drive(protocol, 3, model=model))
    assert shell("reference", f"{protocol}:3", "30Hz", "-m", model) == 2
    option = f"{protocol}:3,reference_maximum_hz=50"
    assert f"which is 50 (parameter {parameter}); if its unit is Hz, give {option}\n" in shell.err
    assert shell("reference", option, "30Hz", "-m", model) == 0
