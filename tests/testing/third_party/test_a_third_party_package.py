"""A third-party protocol package works with all features of drivecomm, which does not know the package.

The package in the folder drivecomm_acme is a separate distribution. It is found by its entry point, like the protocols
that come with drivecomm.
"""

import ast
import os
import sys
import tomllib
from collections import Counter

import pytest
from strangers_distribution import PACKAGE, ROOT

from drivecomm.protocol import installed

posix = pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals and signals are POSIX")

READ = "3A 30 35 52 30 30 31 42 38 0D 0A"  # :05R001B8
WRITE = "3A 30 35 57 30 30 31 30 39 43 34 44 33 0D 0A"  # :05W00109C4D3
CONTRACT = {"drivecomm.protocol", "drivecomm.protocol.schema", "drivecomm.errors"}


def imports_of(path):
    """Return the modules that a file imports at run time; imports for the type checker only are ignored."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    checked = {
        id(inner)
        for node in ast.walk(tree)
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"
        for inner in ast.walk(node)
    }
    nodes = [node for node in ast.walk(tree) if id(node) not in checked]
    plain = {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
    return plain | {node.module for node in nodes if isinstance(node, ast.ImportFrom)}


def test_third_party_package_imports_only_the_contract():
    for path in PACKAGE.glob("*.py"):
        ours = {name for name in imports_of(path) if name.partition(".")[0] == "drivecomm"}
        assert ours <= CONTRACT, path.name
        assert not imports_of(path) & {"time", "socket", "serial", "asyncio", "threading", "select"}, path.name


def test_drivecomm_does_not_mention_the_third_party_package():
    trees = [ROOT / "drivecomm", ROOT / "protocols", ROOT / "pytest_drivecomm"]
    paths = [path for tree in trees for path in tree.rglob("*") if path.suffix in {".py", ".toml", ".md"}]
    assert len(paths) > 100
    assert [path for path in paths if "acme" in path.read_text(encoding="utf-8").lower()] == []


@pytest.mark.soak
def test_new_process_lists_the_third_party_protocol(shell):
    listed = {each["protocol"]: each for each in shell.python("-m", "drivecomm", "protocols", "--json").objects}
    assert set(listed) == {"acme", *(each.name for each in installed.working())}
    assert listed["acme"]["title"] == "Acme A10 line protocol"
    assert listed["acme"]["models"] == ["a10"]


class TestTelegrams:
    def test_decode_detects_the_third_party_protocol(self, shell):
        done = shell("decode", READ)
        assert (done.code, done.out) == (0, "acme request: read address=5 parameter=1\n")

    def test_encode_writes_a_third_party_telegram(self, shell):
        done = shell("encode", "acme", "kind=write", "address=5", "parameter=1", "data=2500")
        assert (done.code, done.out) == (0, WRITE + "\n")

    def test_invalid_third_party_telegram_is_refused_in_one_sentence(self, shell):
        done = shell("encode", "acme", "kind=read", "address=64", "parameter=1")
        assert (done.code, done.out) == (4, "")
        assert done.err.startswith("drivecomm: read telegram, address: ")
        assert done.err.count("\n") == 1


class TestTheKit:
    @pytest.mark.soak
    def test_third_party_package_passes_the_conformance_run(self, shell):
        *checks, whole = (done := shell("conformance", "acme", "--quick", "--json")).objects
        assert [(check["check"], check["reason"]) for check in checks if not check["passed"]] == []
        assert (done.code, whole["protocol"], whole["failed"]) == (0, "acme", 0)
        parts = {check["check"].split("/")[1] for check in checks}
        assert parts == {"contract", "documents", "vectors.toml", "models", "foreign traffic", "properties"}
        vectors = tomllib.loads((PACKAGE / "vectors.toml").read_text(encoding="utf-8"))
        names = {check["check"].split("/")[2] for check in checks if "/vectors.toml/" in check["check"]}
        for kind in ("vector", "stream", "refuse", "exchange"):
            assert {each["id"] for each in vectors[kind]} <= names, kind

    @pytest.mark.soak
    def test_wrong_checksum_of_a_third_party_package_is_found(self, shell, site):
        """The kit runs on the same package with another checksum, and must judge it by its behaviour."""
        other = shell.folder / "drivecomm_acme"
        other.mkdir()
        for path in (site / "drivecomm_acme").rglob("*"):
            if path.is_file() and path.suffix != ".pyc":
                place = other / path.relative_to(site / "drivecomm_acme")
                place.parent.mkdir(exist_ok=True)
                place.write_bytes(path.read_bytes().replace(b"-sum(covered)", b"sum(covered)"))
        done = shell.python(
            "-m", "drivecomm", "conformance", "acme", "--only", "/vectors.toml/read-reference/", "--json"
        )
        failed = {each["check"].rpartition("/")[2] for each in done.objects[:-1] if not each["passed"]}
        assert done.code == 1
        assert {"decode", "encode"} <= failed


@posix
class TestASimulatedDrive:
    @pytest.mark.soak
    def test_command_line_verbs_work_on_a_third_party_drive(self, shell):
        told = shell.serve("simulate", "-d", "acme:5", "-d", "vabus:1", "-l", "pty:line")
        assert told == {"listening": "line", "drives": ["acme:5", "vabus:1"]}

        def on_the_line(*arguments):
            return shell(*arguments, "--port", "line")

        found = on_the_line("scan", "--protocol", "acme", "--addresses", "4-6", "--timeout", "0.05")
        assert (found.code, found.out) == (0, "acme:5  software 2.14\n1 drive found\n")

        [read] = on_the_line("read", "acme:5,model=a10", "speed_trim", "--json").objects
        assert (read["value"], read["unit"], read["raw"]) == ("-1.50", "%", 0xFF6A)
        written = on_the_line("write", "acme:5,model=a10", "speed_trim", "-2.5", "--store")
        assert (written.code, written.out.split()) == (0, ["acme:5", "021", "speed_trim", "-2.50", "%"])
        refused = on_the_line("write", "acme:5,model=a10", "reference", "60")
        assert refused.code == 5
        assert "refused parameter 001 with code 3: value out of range" in refused.err
        assert on_the_line("reference", "acme:5", "50%").code == 2, "it takes its reference in hertz only"

        assert on_the_line("reference", "acme:5", "25Hz").code == 0
        started = on_the_line("start", "acme:5", "--reverse", "--link-loss", "hold").out
        assert "no model is given, so its reaction to a link loss is not known" in started
        [running] = on_the_line("status", "acme:5", "--json").objects
        assert (running["state"], running["reverse"]) == ("running", True)
        assert on_the_line("stop", "acme:5", "--how", "coast").code == 0
        [stopped] = on_the_line("status", "acme:5", "--json").objects
        assert (stopped["state"], stopped["running"]) == ("ready", False)
        assert on_the_line("stop", "acme:*").code == 0

    @pytest.mark.soak
    def test_third_party_traffic_is_recorded_replayed_and_made_into_vectors(self, shell):
        shell.serve("simulate", "-d", "acme:5", "-d", "vabus:1", "-l", "pty:line")
        recorded = shell("read", "acme:5,model=a10", "reference", "--port", "line", "--record", "day.jsonl")
        assert recorded.code == 0
        assert shell("replay", "day.jsonl", "--port", "line").code == 0

        assert shell("write", "acme:5,model=a10", "reference", "25", "--port", "line", "--record", "w.jsonl").code == 0
        again = shell("replay", "day.jsonl", "--port", "line")
        assert again.code == 1
        assert "(acme:5 read)  data was 2000, is 2500" in again.out
        held_back, whole = shell("replay", "w.jsonl", "--port", "line", "--json").objects
        assert (held_back["data"], held_back["sent"]) == (WRITE, False), "a write is not sent unasked"
        assert whole["left_out"] == 1

        shell.serve("replay", "day.jsonl", "-l", "pty:then")
        then = shell("read", "acme:5,model=a10", "reference", "--port", "then", "--json").objects
        assert then[0]["value"] == "20.00"

        assert shell("vectors", "from-capture", "day.jsonl", "--protocol", "acme", "--output", "day.toml").code == 0
        checked = shell("vectors", "check", "day.toml")
        assert checked.code == 0
        assert checked.out.endswith(" 0 failed\n")

    @pytest.mark.soak
    def test_plant_with_a_third_party_drive_is_simulated(self, shell, monkeypatch):
        (shell.folder / "plant.toml").write_text(
            'format = 1\n[[line]]\nname = "hall"\nlisten = "pty:line"\n'
            '[[drive]]\nname = "mixer"\ndrive = "acme:5"\nline = "hall"\nvalues = { "001" = 1234 }\n'
            '[[drive]]\nname = "pump"\ndrive = "vabus:1"\nline = "hall"\n'
            '[[fault]]\nline = "hall"\nkind = "drop"\nof = "reply to a write"\n'
        )
        told = shell.serve("simulate", "plant.toml")
        monkeypatch.setenv("DRIVECOMM_CONTROL", told["control"])
        [read] = shell("read", "acme:5,model=a10", "reference", "--port", "line", "--json").objects
        assert read["value"] == "12.34"
        lost = shell("write", "acme:5,model=a10", "reference", "30", "--port", "line", "--attempts", "1", "--arm")
        assert lost.code == 4, "the fault script knows what a write of this protocol is"
        assert shell("plant", "show", "mixer", "001").out == "mixer 001 is 3000\n"
        assert shell("plant", "trip", "mixer", "7").code == 0
        [tripped] = shell("status", "acme:5,model=a10", "--port", "line", "--json").objects
        assert (tripped["fault_code"], tripped["fault_text"]) == (7, "overvoltage")
        assert shell("plant", "power", "mixer", "off").code == 0
        assert shell("plant", "power", "mixer", "on").code == 0
        assert shell("plant", "show", "mixer", "001").out == "mixer 001 is 1234\n"


MIXED = """
import drivecomm
from drivecomm.virtual import VirtualLine, virtual_drive

line = VirtualLine([virtual_drive("acme", 5), virtual_drive("vabus", 1)])
with drivecomm.open_bus(line.port, record="mixed.jsonl") as bus:
    mixer, pump = bus.drive("acme", 5, model="a10"), bus.drive("vabus", 1, model="agile")
    for hertz in (10, 20, 30):
        mixer.write("reference", hertz)
        pump.read("481")
        mixer.start()
        line.advance(20)
        print(mixer.read("output_frequency"), mixer.status().at_reference)
    line.drives[0].trip(3, line.time)
    print(mixer.status().fault_text)
    try:
        mixer.start()
    except drivecomm.StateError as error:
        print(error)
    mixer.reset()
    print(mixer.status().state.value)
"""


@pytest.mark.soak
def test_third_party_drive_shares_a_line_with_another_protocol(shell):
    """Virtual time, a recording, and a sniffer that separates the two protocols in it."""
    done = shell.python("-c", MIXED)
    assert (done.code, done.err) == (0, "")
    assert done.out.splitlines() == [
        "10.00 Hz True",
        "20.00 Hz True",
        "30.00 Hz True",
        "overcurrent",
        "the drive has a fault (code 3) and cannot start; reset it first",
        "ready",
    ]
    heard = shell("sniff", "mixed.jsonl", "--names")
    assert heard.code == 0
    assert "read address=5 parameter=100 data=3000  100 output_frequency = 30.00 Hz" in heard.out
    assert "481 fixed_frequency_2 = 10.00 Hz" in heard.out
    *events, acme, vabus = shell("sniff", "mixed.jsonl", "--json").objects
    assert {each["drive"] for each in (acme, vabus)} == {"acme:5", "vabus:1"}
    told = Counter((each["what"], each["protocol"]) for each in events)
    assert set(told) == {(what, name) for what in ("request", "reply") for name in ("acme", "vabus")}
    assert told["request", "acme"] == told["reply", "acme"] == acme["counters"]["requests"]
    assert acme["counters"]["requests"] == acme["counters"]["replies"] > vabus["counters"]["requests"] >= 3


@pytest.mark.soak
def test_cohabit_judges_a_third_party_protocol(shell):
    verdicts = shell("cohabit", "-d", "acme:5", "-d", "vabus:1")
    assert verdicts.code == 0, verdicts.out
    assert verdicts.out.count(": safe\n") >= 2


@pytest.mark.soak
def test_pytest_fixtures_support_a_third_party_protocol(shell):
    (shell.folder / "test_mixer.py").write_text(
        "import drivecomm\n\n"
        "def test_mixer(virtual_drive):\n"
        '    drive = virtual_drive("acme:1", model="a10", reply_delay_s=0.02)\n'
        "    with drivecomm.open_bus(drive.line.port) as bus:\n"
        '        bus.drive("acme", 1, model="a10").write("reference", 12.5)\n'
        '    drive.assert_holds("reference", 1250)\n'
        '    drive.assert_received(kind="write", parameter=1, data=1250, times=1)\n\n'
        "def test_fails(virtual_drive):\n"
        '    drive = virtual_drive("acme:1")\n'
        "    with drivecomm.open_bus(drive.line.port) as bus:\n"
        '        bus.drive("acme", 1).read("001")\n'
        "    assert False\n"
    )
    done = shell.python("-m", "pytest", "-q", "-p", "no:cacheprovider", "-W", "error", "test_mixer.py")
    assert done.code == 1
    assert "1 failed, 1 passed" in done.out
    assert "read address=1 parameter=1 data=2000" in done.out, "the trace under a failing test is decoded"


@posix
@pytest.mark.soak
def test_judge_supports_a_third_party_protocol(shell, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", shell.environment["PYTHONPATH"])
    listed = shell("judge", "--drive", "acme:5", "--task", "read", "--list")
    assert "read-other-drive" in listed.out
    cases = ("--case", "read-plain", "--case", "read-damaged", "--case", "read-other-drive")
    master = (sys.executable, "-m", "drivecomm", "read", "acme:5,model=a10", "001", "--port", "{port}")
    judged = shell("judge", "--drive", "acme:5", "--task", "read", *cases, "--", *master)
    assert judged.code == 0, judged.out
    assert "3 passed, 0 failed" in judged.out
