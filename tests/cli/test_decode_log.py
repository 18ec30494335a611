"""Logs that other programs printed, decoded by decode --log and replayed by replay."""

from pathlib import Path

import pytest

from drivecomm.virtual import virtual_drive

LOGS = Path(__file__).parents[1] / "capture" / "logs"
REQUEST_LINE = "modbus request: read_registers address=5 function=3 start=8451 count=2"
REPLY_LINE = "modbus reply: read_registers address=5 function=3 values=[5000, 123]"
SHORT = ("minimalmodbus.log", "qmodmaster.log", "modbus-poll.txt", "strace.txt", "interceptty.log", "modbus-tk.log")


@pytest.fixture
def decoded(shell):
    return lambda *arguments: shell("decode", *map(str, arguments), port=None)


@pytest.mark.parametrize("name", [*SHORT, "mbpoll.log", "pymodbus.log"])
def test_log_of_a_program_is_decoded_line_by_line(decoded, shell, name):
    assert decoded("--log", LOGS / name) == 0
    said = [line.partition(" s  ")[2] for line in shell.out.splitlines()]
    assert said.index(REQUEST_LINE) < said.index(REPLY_LINE)
    assert "refused" not in shell.out


def test_noise_around_a_telegram_is_found_and_named(decoded, shell):
    assert decoded("--log", LOGS / "minimalmodbus.log") == 0
    lines = shell.out.splitlines()
    assert lines[-3].endswith("noise: 00")
    assert lines[-3].startswith("line 4 ")
    assert lines[-1].startswith("2 telegrams in 2 pieces of")


def test_unreadable_line_of_a_log_is_reported(decoded, shell):
    decoded("--log", LOGS / "strace.txt")
    assert "line 6 is not read: strace cut the bytes off; record with -s 300" in shell.out


def test_damaged_telegram_of_a_log_is_refused_with_its_line(decoded, shell, tmp_path):
    path = tmp_path / "a.log"
    path.write_text("TX: 05 03 21 03 00 02 3F B3\nRX: 05 03 04 13 88 00 7B 7E 7B\n", encoding="utf-8")
    assert decoded("--log", path, "--json") == 0
    assert shell.objects[-1]["line"] == 2
    assert shell.objects[-1]["valid"] is False
    assert "its two check bytes are in the wrong order" in shell.objects[-1]["reason"]


def test_log_of_a_slave_program_has_requests_received_and_replies_sent(decoded, shell, tmp_path):
    path = tmp_path / "slave.log"
    path.write_text("RX: 05 03 21 03 00 02 3F B3\nTX: 05 03 04 13 88 00 7B 7B 7E\n", encoding="utf-8")
    assert decoded("--log", path) == 0
    assert REQUEST_LINE in shell.out
    assert REPLY_LINE in shell.out


def test_log_without_directions_is_decoded_as_requests_and_replies(decoded, shell, tmp_path):
    path = tmp_path / "tap.txt"
    path.write_text("05 03 21 03 00 02 3F B3\n05 03 04 13 88 00 7B 7B 7E\n", encoding="utf-8")
    assert decoded("--log", path, "--protocol", "modbus") == 0
    assert REQUEST_LINE in shell.out
    assert REPLY_LINE in shell.out


def test_log_without_telegrams_exits_with_4(decoded, shell, tmp_path):
    path = tmp_path / "a.log"
    path.write_text("TX: 11 22 33 44 55 66\n", encoding="utf-8")
    assert decoded("--log", path) == 4
    assert "refused" in shell.out


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ([], "give one of them"),
        (["01", "--log", "a.log"], "give one of them"),
        (["--log", "a.log", "-d", "reply"], "--direction is for one telegram"),
        (["--log", "none.log"], "none.log"),
    ],
)
def test_decode_takes_either_bytes_or_a_log(decoded, shell, arguments, says):
    assert decoded(*arguments) == 2
    assert says in shell.err


@pytest.fixture
def fan(shell, tmp_path):
    """Put a drive on the line whose first register agrees with the logs and whose second one differs."""
    path = tmp_path / "fan.toml"
    path.write_text(
        'format = 1\nprotocol = "modbus"\nname = "fan"\nsource = "this test"\n'
        '[[parameter]]\naddress = "8451"\nname = "one"\nstart = "5000"\n'
        '[[parameter]]\naddress = "8452"\nname = "two"\nstart = "124"\n'
        '[[parameter]]\naddress = "8193"\nname = "three"\nstart = "7"\n',
        encoding="utf-8",
    )
    drive = virtual_drive("modbus", 5, model=str(path))
    shell.line(drive)
    return drive


def test_log_is_replayed_from_the_masters_side_without_writes(shell, fan):
    assert shell("replay", str(LOGS / "modbus-poll.txt")) == 1
    assert "values was [5000, 123], is [5000, 124]" in shell.out
    assert "1 not sent, because they could command or write" in shell.out
    assert fan.peek("8193", 0.0) == 7


def test_log_of_a_slave_program_is_replayed_from_the_masters_side(shell, fan, tmp_path):
    path = tmp_path / "slave.log"
    path.write_text("RX: 05 03 21 03 00 02 3F B3\nTX: 05 03 04 13 88 00 7C 3A BC\n", encoding="utf-8")
    shell("replay", str(path))
    assert "1 requests repeated" in shell.out
    assert fan.peek("8193", 0.0) == 7
