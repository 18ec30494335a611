"""The option --record: drive commands write sent and received bytes to a file."""

import pytest

from drivecomm.capture import read_capture
from drivecomm.traffic.replay import recorded_exchanges
from drivecomm.virtual import virtual_drive


@pytest.mark.parametrize("suffix", [".jsonl", ".pcapng"])
def test_read_records_its_exchange(shell, tmp_path, suffix):
    shell.line()
    path = tmp_path / f"a{suffix}"
    assert shell("read", "vabus:1", "481", "--record", str(path)) == 0
    capture = read_capture(path)
    assert capture.provenance.port == "line"
    assert capture.provenance.drives == ("vabus:1",)
    assert recorded_exchanges(capture)[0].request == bytes.fromhex("04 41 30 30 34 38 31 05")
    assert recorded_exchanges(capture)[0].reply


def test_scan_and_stats_record_their_exchanges(shell, tmp_path):
    shell.line()
    path = tmp_path / "a.jsonl"
    assert shell("scan", "--protocol", "vabus", "--addresses", "1-3", "--record", str(path)) == 0
    assert {each.request[1:2] for each in recorded_exchanges(read_capture(path))} >= {b"A", b"B", b"C"}
    path.unlink()
    assert shell("stats", "vabus:1", "--for", "1", "--record", str(path)) == 0
    assert {each.request[1:2] for each in recorded_exchanges(read_capture(path))} <= {b"A", b""}


def test_wrong_file_name_is_refused_in_one_sentence(shell, tmp_path):
    shell.line()
    assert shell("read", "vabus:1", "481", "--record", str(tmp_path / "a.txt")) == 2
    assert shell.err.count("\n") == 1
    assert "name it .jsonl, or .pcapng for Wireshark" in shell.err


def test_command_that_cannot_record_refuses_the_option(shell, tmp_path):
    shell.line()
    path = tmp_path / "a.jsonl"
    assert shell("doctor", "--record", str(path)) == 2
    assert "does not record" in shell.err
    assert not path.exists()


def test_record_of_several_lines_is_refused(shell, tmp_path):
    shell.line(virtual_drive("vabus", 1), name="one")
    shell.line(virtual_drive("vabus", 2), name="two")
    plan = tmp_path / "plan.toml"
    plan.write_text(
        "format = 1\n"
        '[[line]]\nname = "hall"\nport = "one"\n'
        '[[line]]\nname = "yard"\nport = "two"\n'
        '[[drive]]\nname = "a"\ndrive = "vabus:1"\nline = "hall"\npoll = [{ parameters = ["481"] }]\n'
        '[[drive]]\nname = "b"\ndrive = "vabus:2"\nline = "yard"\npoll = [{ parameters = ["481"] }]\n'
    )
    poll = ["poll", "--plan", str(plan), "--cycles", "1"]
    assert shell(*poll, port=None) == 0
    assert shell(*poll, "--record", str(tmp_path / "a.jsonl"), port=None) == 2
    assert "--record is for one line" in shell.err
