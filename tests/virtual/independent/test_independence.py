"""The independent programs import nothing of drivecomm, answer as printed in the manuals, and detect wrong values."""

from __future__ import annotations

import ast
import subprocess
import sys
import time
from decimal import Decimal
from pathlib import Path
from random import Random

import pytest
from campaign import Campaign
from drives import DanfossDrive, DriveLine, FujiDrive, Mischief, VabusDrive, Vlt3500Drive
from masters import DanfossMaster, FujiMaster, Line, NoAnswerError, Talk, VabusMaster, Vlt3500Master
from uss import UssDrive, UssMaster

HERE = Path(__file__).parent
PAIRS = {
    "vabus": (VabusDrive, VabusMaster, "480"),
    "danfoss": (DanfossDrive, DanfossMaster, "3-10[2]"),
    "vlt3500": (Vlt3500Drive, Vlt3500Master, "516"),
    "fuji": (FujiDrive, FujiMaster, "S05"),
    "uss": (lambda address: UssDrive(address, Random(address), hesitates=0), UssMaster, "2014[1]"),
}
OWN = {"uss": {"masters"}}
"""Other independent programs that one imports."""


@pytest.mark.parametrize("program", ["masters", "drives", "uss"])
def test_independent_program_imports_nothing_of_the_project(program):
    tree = ast.parse((HERE / f"{program}.py").read_text(encoding="utf-8"))
    named = {
        name.split(".")[0]
        for each in ast.walk(tree)
        if isinstance(each, ast.Import | ast.ImportFrom)
        for name in ([alias.name for alias in each.names] if isinstance(each, ast.Import) else [each.module or "."])
    }
    assert named <= {*sys.stdlib_module_names, "serial", *OWN.get(program, ())}
    look = f"import sys; sys.path.insert(0, {str(HERE)!r}); import {program}; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", look], check=True, capture_output=True, text=True).stdout.split()
    assert program in loaded
    assert not [name for name in loaded if name.startswith(("drivecomm", "construct"))]


def heard_by(drive, *telegrams):
    return [drive.hear(bytes.fromhex(telegram)) for telegram in telegrams]


def test_independent_drives_answer_as_printed_in_the_manuals():
    vabus = VabusDrive(1)
    vabus.values["481"] = [1000] * 4
    assert heard_by(vabus, "04 41 30 30 34 38 31 05")[0] == bytes.fromhex(
        "41 02 30 30 34 38 31 30 38 30 30 30 30 30 33 45 38 03 48"
    )
    assert heard_by(vabus, "04 41 02 30 30 34 38 30 30 38 46 46 46 46 44 31 32 30 03 40") == [b"A\x06"]
    assert vabus.holds("480") == -12000
    fuji = FujiDrive(1)
    assert heard_by(fuji, "01 30 31 05 57 53 30 35 20 32 45 45 30 03 38 34")[0][3] == 6
    assert fuji.holds("S05") == 12000
    vlt = Vlt3500Drive(1)
    asked = b"01UOGD@0516+800001"
    assert vlt.hear(b"<%s%02d>" % (asked, sum(asked) % 100))[8:19] == b"0516+800001"
    danfoss = DanfossDrive(1)
    danfoss.values[341, 0] = 1000
    reply = heard_by(danfoss, "02 0E 81 11 55 00 00 00 00 00 00 00 00 00 00 C9")[0]
    assert reply[:11] == bytes.fromhex("02 0E 81 21 55 00 00 00 00 03 E8")
    uss = UssDrive(0, Random(1), hesitates=0)
    uss.values[1082, 0] = 0x42480000
    reply = heard_by(uss, "02 0E 00 14 3A 00 00 00 00 00 00 00 00 00 00 22")[0]
    assert reply[:11] == bytes.fromhex("02 0E 00 24 3A 00 00 42 48 00 00")


@pytest.mark.parametrize("name", PAIRS)
@pytest.mark.parametrize("damage", ["changed", "lost", "cut"])
def test_damaged_request_sets_no_value_of_an_independent_drive(name, damage):
    """Each request of a master has one character changed or lost, or its end cut off: the drive keeps its values."""
    kind, master, parameter = PAIRS[name]
    sent = []
    line = Recording(sent, kind(3))
    master(line, 3).write(parameter, Decimal(1234))
    request = next(telegram for telegram in sent if len(telegram) > 8)
    random = Random(5)
    # The address is outside of the block check of VABus: a select for another node is sound.
    for at in range(2 if name == "vabus" else 0, len(request)):
        drive = kind(3)
        before = drive.holds(parameter)
        kept = {"changed": bytes([request[at] ^ 1 << random.randrange(7)]), "lost": b"", "cut": b""}[damage]
        rest = b"" if damage == "cut" else request[at + 1 :]
        drive.hear(request[:at] + kept + rest)
        drive.silence()
        assert drive.holds(parameter) == before, (at, damage)
        assert master(Recording([], drive), 3).read(parameter) == before


class Recording:
    """A line without wires: a drive answers immediately."""

    def __init__(self, sent, drive):
        self.sent, self.drive, self.heard = sent, drive, []

    def tell(self, data, *_):
        self.drive.hear(data)

    def ask(self, request, _settings, *, missing, **_times):
        self.sent.append(request)
        self.drive.silence()
        reply = self.drive.hear(request)
        came = b""
        while wanted := missing(came):
            came, before = reply[: len(came) + wanted], len(came)
            if len(came) < before + wanted:
                return came
        return came

    def fall_silent(self):
        pass


class Forgetful(Mischief):
    """A fault: the drive changes its values after each reply; its telegrams are sound."""

    drive = None
    parameter = ""

    def with_answer(self, answer):
        held = self.drive.values
        for place, value in list(held.items()):
            if not isinstance(value, list):
                held[place] = value + 1
            else:
                held[place] = [each + 1 for each in value]
        return 0.0, answer


@pytest.mark.parametrize("name", PAIRS)
def test_campaign_detects_a_wrong_value(name):
    kind, master, _ = PAIRS[name]
    drive = kind(3)
    lie = Forgetful(random=Random(1))
    lie.drive = drive
    with DriveLine([drive], lie, where="pty") as standing:
        line = Line(standing.url)
        talk = Talk(master(line, 3), line, Random(2))
        until = time.monotonic() + 10
        while not talk.wrong and time.monotonic() < until:
            talk.turn()
        line.close()
    assert "can be" in talk.wrong[0]


def test_unconfirmed_write_leaves_both_values_possible():
    class Silent:
        name, unknown, unknown_code, repeats = "silent", "0", 0, 0
        writable = {"x": [Decimal(2)]}  # noqa: RUF012

        def write(self, *_):
            raise NoAnswerError

    class Wire:
        heard = ()

    talk = Talk(Silent(), Wire(), Random(1), possible={"x": {Decimal(1)}})
    with pytest.raises(NoAnswerError):
        talk._write("x", Decimal(2))
    assert talk.possible["x"] == {Decimal(1), Decimal(2)}


@pytest.mark.soak
def test_campaign_detects_a_hang_and_an_error():
    class Hanging:
        name, exchanges, failed, wrong = "hanging", 0, 0, ()

        def turn(self):
            time.sleep(0.6)

    class Broken(Hanging):
        def turn(self):
            raise ValueError("broken")

    campaign = Campaign([[Hanging()], [Broken()]], most_silent_s=0.2)
    campaign.run(0.4)
    assert campaign.hangs[0].startswith("line 0 has been silent")
    assert campaign.errors == ["hanging: ValueError: broken"]
    with pytest.raises(AssertionError):
        campaign.judge(most_failed=1.0)
