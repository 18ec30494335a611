"""The cohabit command: its output and its exit codes."""

import json

import pytest

from drivecomm.cli import main
from drivecomm.protocol import installed

SEVEN = "bytesize=7,parity=E,baudrate=9600"


@pytest.fixture
def run(capsys):
    def run(*arguments):
        code = main(["cohabit", *arguments])
        captured = capsys.readouterr()
        return code, captured.out, captured.err

    return run


@pytest.mark.soak
def test_cohabit_exits_with_0_if_drives_can_share_a_line(run):
    code, out, _ = run("-d", f"vabus:1,{SEVEN}", "-d", f"vabus:2,{SEVEN}")
    assert code == 0
    assert "vabus:2 hears vabus:1: safe" in out
    assert out.splitlines()[-1].startswith("safe: these drives can share the line")


@pytest.mark.soak
def test_cohabit_exits_with_1_and_shows_the_proof_if_a_telegram_can_be_mistaken(run):
    code, out, _ = run("-d", f"vabus:1,{SEVEN}", "-d", f"danfoss-fc:3,{SEVEN}")
    assert code == 1
    lines = [line.strip() for line in out.splitlines()]
    at = lines.index("vabus:1 hears danfoss-fc:3: taken")
    taken = next(line for line in lines[at:] if line.startswith("taken"))
    codec = installed["vabus"].codec(installed["vabus"].options())
    message = codec.decode(bytes.fromhex(taken.removeprefix("taken")), "request")
    assert message.address in (1, 32)


@pytest.mark.soak
def test_bits_option_accepts_rare_mistakes(run):
    drives = ("-d", f"vabus:1,{SEVEN}", "-d", f"danfoss-fc:3,{SEVEN}")
    assert run(*drives, "--bits", "8")[0] == 0
    assert run(*drives, "--bits", "200")[0] == 1


def test_json_output_holds_the_verdicts_with_their_proof(run):
    code, out, _ = run("-d", f"vabus:1,{SEVEN}", "-d", f"vabus:1,{SEVEN},sys=3", "--json")
    *verdicts, last = [json.loads(line) for line in out.splitlines()]
    assert code == 1
    assert last["safe"] is False
    assert [each["who"] for each in verdicts] == ["drive", "drive", "master", "master"]
    for each in verdicts[:2]:
        assert each["outcome"] == "taken"
        telegrams = b"".join(bytes.fromhex(telegram["heard"]) for telegram in each["proof"]["telegrams"])
        start = each["proof"]["offset"]
        taken = bytes.fromhex(each["proof"]["taken"])
        assert telegrams[start : start + len(taken)] == taken


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["-d", "vabus:1"], "a single drive cannot be mistaken"),
        (["-d", "vabus:1", "-d", "vabus:77"], "no drive at address 77"),
        (["-d", "vabus:1", "-d", "nobody:1"], "no installed protocol"),
        (["-d", "vabus:1", "-d", "vabus"], "is not a drive"),
        (["-d", "vabus:1", "-d", "vabus:2,colour=red"], "no option 'colour'"),
    ],
)
def test_wrong_call_exits_with_2_and_one_sentence(run, arguments, words):
    code, out, err = run(*arguments)
    assert code == 2
    assert not out
    assert words in err
    assert len(err.splitlines()) == 1
