"""The prove command: a drive checked against its model, the proof file, and consent before the motor moves."""

import io
import os
import signal
import sys

import pytest

from drivecomm.cli import main, signals
from drivecomm.protocol import MotorCommand
from drivecomm.proving import read_proof
from drivecomm.virtual import virtual_drive

pytestmark = pytest.mark.filterwarnings("error")


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def interruptible(monkeypatch):
    """Install the interrupt handler of a command process; remove it after the test."""
    monkeypatch.setattr(sys, "unraisablehook", sys.unraisablehook)
    before = signal.getsignal(signal.SIGINT)
    signals.interrupt()
    yield
    signal.signal(signal.SIGINT, before)


def typed(monkeypatch, text):
    """Make standard input a terminal at which the text is typed."""
    terminal = io.StringIO(text + "\n")
    terminal.isatty = lambda: True
    monkeypatch.setattr(sys, "stdin", terminal)


def proved_text(folder, name="proof-vabus-agile.toml"):
    return (folder / name).read_text(encoding="utf-8")


def test_proof_over_a_pty_is_written_and_notes_a_virtual_drive(virtual_drive, folder, capsys):
    drive = virtual_drive("vabus:3,model=agile", listen="pty")
    before = {address: drive.holds(address) for address in ("419", "480", "410")}
    assert main(["prove", "vabus:3", "--model", "agile", "--port", drive.port]) == 0
    out = capsys.readouterr().out
    assert "0 contradict, " in out
    assert "written to proof-vabus-agile.toml\n" in out
    assert "the drive is a virtual one: this is not a proof of a real drive\n" in out
    proof = read_proof(folder / "proof-vabus-agile.toml")
    assert proof.virtual
    assert not proof.interrupted
    assert proof.counts()["contradicts"] == 0
    assert {each.kind for each in drive.received} == {"enquiry"}
    assert {address: drive.holds(address) for address in before} == before


def test_proof_over_tcp_finds_a_contradiction_and_exits_with_one(virtual_drive, folder, capsys):
    drive = virtual_drive("danfoss-fc:5,model=fc302", listen="tcp")
    drive.poke("1-22", 4000)
    assert main(["prove", "danfoss-fc:5", "--model", "fc302", "--port", drive.port]) == 1
    assert (
        "contradicts the model: motor_rated_voltage: motor_rated_voltage 4000 is not within" in capsys.readouterr().out
    )
    proof = read_proof(folder / "proof-danfoss-fc-fc302.toml")
    assert not proof.virtual, "what a network port leads to is not known"
    assert proof.identity["FC type"] == "FC-302"


def test_report_leaves_serial_numbers_names_and_addresses_out(shell, folder):
    shell.line(virtual_drive("danfoss-fc", 77, model="fc302"))
    assert shell("prove", "danfoss-fc:77", "--model", "fc302") == 0
    text = proved_text(folder, "proof-danfoss-fc-fc302.toml")
    for private in ("012345G678", "131B0042", "danfoss-fc:77", "77"):
        assert private not in text.replace("16-77", ""), private
    assert shell("prove", "danfoss-fc:77", "--model", "fc302", "--with-names", "--force") == 0
    assert "012345G678" in proved_text(folder, "proof-danfoss-fc-fc302.toml")


@pytest.mark.usefixtures("interruptible")
@pytest.mark.skipif(os.name != "posix", reason="signals are POSIX")
@pytest.mark.parametrize("at_s", [0.3, 1.5, 4.0])
def test_interrupted_proof_is_whole_and_names_where_it_ended(shell, folder, at_s):
    line = shell.line(virtual_drive("vabus", 3, model="agile"))
    line.call_at(at_s, lambda: signal.raise_signal(signal.SIGINT))
    assert shell("prove", "vabus:3", "--model", "agile") == 130
    assert "has the findings so far; it ends at " in shell.err
    proof = read_proof(folder / "proof-vabus-agile.toml")
    assert proof.interrupted.startswith("at ")
    assert proof.interrupted.endswith(": it was interrupted")
    assert not list(folder.glob(".proof*"))
    at = proof.interrupted.removeprefix("at parameter ").partition(":")[0]
    asked = [each.addresses[0] for each in proof.findings if each.kind == "parameter" and each.verdict == "agrees"]
    assert asked or at_s < 0.5, "what was answered before is there"
    assert at not in asked


def test_outage_leaves_a_whole_proof_with_the_reason(shell, folder):
    line = shell.line(virtual_drive("vabus", 3, model="agile"))
    line.call_at(1.0, lambda: line.power_off(line.drives[0]))
    assert shell("prove", "vabus:3", "--model", "agile") == 4
    proof = read_proof(folder / "proof-vabus-agile.toml")
    assert proof.interrupted.startswith("at parameter ")
    assert proof.interrupted.endswith(": the drive fell silent, and stayed so for 8.5 s")


def test_lost_port_leaves_a_whole_proof(shell, folder):
    line = shell.line(virtual_drive("vabus", 3, model="agile"))
    line.call_at(1.0, lambda: setattr(line, "broken", True))
    assert shell("prove", "vabus:3", "--model", "agile") == 3
    assert read_proof(folder / "proof-vabus-agile.toml").interrupted.startswith("at parameter ")


def test_short_outage_neither_ends_nor_contradicts_the_proof(shell, folder):
    line = shell.line(virtual_drive("vabus", 3, model="agile"))
    line.call_at(1.0, lambda: line.power_off(line.drives[0]))
    line.call_at(2.5, lambda: line.power_on(line.drives[0]))
    assert shell("prove", "vabus:3", "--model", "agile") == 0
    assert not read_proof(folder / "proof-vabus-agile.toml").interrupted


def test_dry_run_prints_the_questions_and_sends_nothing(shell, folder):
    line = shell.line(virtual_drive("vabus", 3, model="agile"))
    assert shell("prove", "vabus:3", "--model", "agile", "--dry-run") == 0
    assert "read 419[1] and 419[2] and 419[3] and 419[4] maximum frequency\n" in shell.out
    assert "nothing was sent\n" in shell.out
    assert line.time == 0.0
    assert not list(folder.iterdir())


def test_existing_report_is_not_replaced(shell, folder):
    line = shell.line(virtual_drive("vabus", 3, model="agile"))
    (folder / "proof-vabus-agile.toml").write_text("mine")
    assert shell("prove", "vabus:3", "--model", "agile") == 2
    assert "exists already" in shell.err
    assert line.time == 0.0
    assert proved_text(folder) == "mine"


def test_drive_without_a_model_is_refused(shell):
    shell.line(virtual_drive("vabus", 3))
    assert shell("prove", "vabus:3") == 2
    assert "name one, such as with --model" in shell.err


@pytest.mark.parametrize("text", ["", "yes", "vabus:4"])
def test_motor_does_not_move_unless_the_name_of_the_drive_is_typed(shell, monkeypatch, folder, text):
    line = shell.line(virtual_drive("vabus", 3, model="agile"))
    typed(monkeypatch, text)
    assert shell("prove", "vabus:3", "--model", "agile", "--move") == 2
    assert "so nothing was started" in shell.err
    assert line.time == 0.0
    assert not list(folder.iterdir())


def test_move_without_a_terminal_is_refused(shell, monkeypatch):
    line = shell.line(virtual_drive("vabus", 3, model="agile"))
    monkeypatch.setattr(sys, "stdin", io.StringIO("vabus:3\n"))
    assert shell("prove", "vabus:3", "--model", "agile", "--move") == 2
    assert "there is no terminal" in shell.err
    assert line.time == 0.0


def test_read_only_drive_of_a_plant_is_not_moved(shell, folder, monkeypatch):
    line = shell.line(virtual_drive("vabus", 3, model="agile"))
    (folder / "plant.toml").write_text(
        'format = 1\n[[line]]\nname = "hall"\nport = "line"\n'
        '[[drive]]\nname = "pump"\ndrive = "vabus:3"\noptions = { model = "agile" }\n'
    )
    typed(monkeypatch, "pump")
    assert shell("prove", "pump", "--plant", "plant.toml", "--move", port=None) == 2
    assert "pump is read-only" in shell.err
    assert line.time == 0.0
    assert shell("prove", "pump", "--plant", "plant.toml", port=None) == 0


@pytest.mark.parametrize(
    ("protocol", "model"),
    [("vabus", "agile"), ("danfoss-fc", "fc302"), ("uss", "micromaster4"), ("modbus", "powerflex-520")],
)
def test_moved_motor_proves_its_commands_and_stands_at_the_end(shell, monkeypatch, folder, protocol, model):
    drive = virtual_drive(protocol, 3, model=model)
    shell.line(drive)
    typed(monkeypatch, f"{protocol}:3")
    code = shell("prove", f"{protocol}:3", "--model", model, "--move")
    proof = read_proof(folder / f"proof-{protocol}-{model}.toml")
    moved = {each.about: each for each in proof.findings if each.kind in ("motion", "link loss")}
    assert code == 0, [each.why for each in proof.findings if each.verdict == "contradicts"]
    assert proof.moved
    assert moved["start, and stop down the ramp"].verdict == "agrees"
    assert moved["what the motor does when its master falls silent"].verdict == "agrees"
    assert not drive.motor.running


@pytest.mark.usefixtures("interruptible")
@pytest.mark.skipif(os.name != "posix", reason="signals are POSIX")
def test_ctrl_c_while_the_motor_runs_stops_it_and_leaves_a_whole_proof(shell, monkeypatch, folder):
    drive = virtual_drive("vabus", 3, model="agile")
    line = shell.line(drive)
    typed(monkeypatch, "vabus:3")

    def interrupt():
        if drive.motor.running:
            signal.raise_signal(signal.SIGINT)
        else:
            line.call_at(line.time + 0.05, interrupt)

    line.call_at(0.05, interrupt)
    assert shell("prove", "vabus:3", "--model", "agile", "--move") == 130
    proof = read_proof(folder / "proof-vabus-agile.toml")
    assert proof.interrupted == "at start, reference and stop: it was interrupted"
    assert drive.motor.command is not MotorCommand.RUN
    drive.follow(line.time + 60)
    assert not drive.motor.running


def test_unconfirmed_stop_is_reported(shell, monkeypatch, folder):
    drive = virtual_drive("vabus", 3, model="agile")
    line = shell.line(drive)
    typed(monkeypatch, "vabus:3")

    def cut_off():
        if drive.motor.running:
            line.power_off(drive)
        else:
            line.call_at(line.time + 0.05, cut_off)

    line.call_at(0.05, cut_off)
    assert shell("prove", "vabus:3", "--model", "agile", "--move") == 4
    assert "vabus:3 may be running, because its stop is not confirmed\n" in shell.err
    assert read_proof(folder / "proof-vabus-agile.toml").interrupted
