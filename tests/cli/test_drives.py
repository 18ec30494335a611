"""The commands read, write, status, start, stop, reset, reference and call."""

import pytest

from drivecomm.plant import FaultPlan, LineFault
from drivecomm.virtual import virtual_drive


def test_read_prints_value_unit_and_name(shell):
    shell.line()
    assert shell("read", "vabus:1", "481", "fixed_frequency_1", "--model", "agile") == 0
    assert "10.00 Hz" in shell.out
    assert "fixed_frequency_1" in shell.out


def test_read_without_a_type_prints_raw_data_with_a_note(shell):
    shell.line()
    assert shell("read", "vabus:1", "481") == 0
    assert "000003E8" in shell.out
    assert "type not known" in shell.out


def test_read_converts_by_the_type_option(shell):
    shell.line()
    assert shell("read", "vabus:1", "481", "--type", "long", "--json") == 0
    assert shell.objects[0]["value"] == 1000
    assert shell.objects[0]["drive"] == "vabus:1"


def test_exact_decimals_stay_exact_in_json(shell):
    shell.line()
    shell("read", "vabus:1", "481", "--model", "agile", "--json")
    assert shell.objects[0]["value"] == "10.00"
    assert shell.objects[0]["unit"] == "Hz"


def test_one_bad_parameter_does_not_fail_the_others(shell):
    shell.line()
    assert shell("read", "vabus:1", "999", "481", "nonsense", "480", "-m", "agile") == 5
    assert "10.00 Hz" in shell.out
    assert "30.00 Hz" in shell.out
    assert "unknown parameter" in shell.err
    assert "'nonsense' is not a VABus parameter address" in shell.err


def test_json_flag_prints_errors_as_objects(shell):
    shell.line()
    assert shell("read", "vabus:1", "999", "--json") == 5
    assert shell.objects[0]["kind"] == "RefusedError"
    assert shell.objects[0]["exit_code"] == 5
    assert "line" in shell.objects[0]["error"]


def test_line_options_may_follow_the_drive(shell):
    shell.line(virtual_drive("vabus", 1, baudrate=9600))
    assert shell("read", "vabus:1,model=agile,baudrate=9600,attempts=1", "481") == 0
    assert shell("read", "vabus:1,attempts=1", "481") == 4
    assert shell("read", "vabus:1", "481", "--baudrate", "9600", "--parity", "e", "--bytesize", "7") == 0


def test_written_value_is_read_back(shell):
    shell.line()
    assert shell("write", "vabus:1", "480", "-12.50", "--model", "agile") == 0
    assert "480 = -12.50" in shell.out
    shell("read", "vabus:1", "480", "-m", "agile", "--json")
    assert shell.objects[0]["value"] == "-12.50"


def test_stored_write_survives_a_power_cycle(shell):
    line = shell.line()
    assert shell("write", "vabus:1", "481", "20", "--store", "-m", "agile", "--json") == 0
    assert shell.objects[0]["stored"] is True
    line.drives[0].store.power_cycle()
    shell("read", "vabus:1", "481", "-m", "agile")
    assert "20.00 Hz" in shell.out


def test_write_option_selects_the_data_set(shell):
    line = shell.line()
    assert shell("write", "vabus:1", "481", "1500", "--type", "long", "--option", "dataset=3") == 0
    assert line.drives[0].peek("481[3]", 0) == "000005DC"


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("480", "10.001", "-m", "agile"), "not rounded"),
        (("480", "1"), "type"),
        (("394", "77", "-m", "agile"), "outside 1 to 30"),
        (("480", "abc", "-m", "agile"), "not a number"),
        (("480", "1", "-m", "agile", "-o", "speed=3"), "no option 'speed'"),
        (("480", "1", "-m", "agile", "-o", "speed"), "NAME=VALUE"),
        (("480", "1", "-m", "nothing"), "no model 'nothing'"),
    ],
)
def test_write_refuses_invalid_values_before_sending(shell, arguments, sentence):
    line = shell.line()
    assert shell("write", "vabus:1", *arguments) == 2
    assert sentence in shell.err
    assert shell.err.count("\n") == 1
    assert line.time < 0.01


def test_motor_is_started_reported_and_stopped(shell):
    line = shell.line()
    assert shell("reference", "vabus:1", "25Hz") == 0
    assert shell("start", "vabus:1", "--link-loss", "hold") == 0
    assert "no model is given, so its reaction to a link loss is not known" in shell.out
    line.advance(10)
    assert shell("status", "vabus:1", "--json") == 0
    assert shell.objects[0]["state"] == "running"
    assert shell.objects[0]["at_reference"] is True
    assert shell("stop", "vabus:1", "--how", "coast") == 0
    assert not line.drives[0].motor.running
    assert shell("start", "vabus:1", "--link-loss", "hold", "--hz", "10", "--json") == 0
    assert shell("stop", "vabus:1") == 0
    assert shell("reference", "vabus:1", "--percent", "-10") == 2
    assert "reversed by its start" in shell.err
    assert shell("reference", "vabus:1", "50%", "--json") == 0


def test_drive_with_a_fault_refuses_start_until_reset(shell):
    line = shell.line()
    line.drives[0].trip(0x0300, 0.0)
    assert shell("status", "vabus:1") == 5
    assert "fault 768" in shell.out
    assert shell("start", "vabus:1", "--link-loss", "hold") == 5
    assert "reset it first" in shell.err
    line.advance(20)
    assert shell("reset", "vabus:1") == 0
    assert shell("status", "vabus:1") == 0


def test_stop_broadcast_stops_all_drives_of_the_protocol(shell):
    line = shell.line(virtual_drive("vabus", 1), virtual_drive("vabus", 2))
    shell("start", "vabus:1", "--link-loss", "hold")
    shell("start", "vabus:2", "--link-loss", "hold")
    assert shell("stop", "vabus:*", "--how", "quick") == 0
    assert "no drive confirms" in shell.out
    assert shell("stop", "vabus:*", "--how", "quick", "--json") == 0
    assert shell.objects[0]["drive"] == "vabus:*"
    line.advance(5)
    for drive in line.drives:
        drive.motor.advance(line.time)
        assert not drive.motor.running


def test_call_runs_verbs_of_the_protocol(shell):
    shell.line()
    assert shell("call", "vabus:1", "control_word", "word=0") == 0
    assert shell("call", "vabus:1", "fly") == 2
    assert "control_word" in shell.err
    assert shell("call", "vabus:1", "control_word", "speed=6") == 2


@pytest.mark.parametrize(
    ("arguments", "code", "sentence"),
    [
        (("stop", "vabus:1", "--how", "dc-brake"), 2, "dc_brake"),
        (("stop", "vabus:1", "--how", "gently"), 2, "use one of ramp, coast, quick, dc_brake"),
        (("start", "vabus:1,ram_datasets=false", "--link-loss", "hold", "--reverse"), 2, "negative reference"),
        (("reference", "vabus:1", "25"), 2, "25Hz"),
        (("reference", "vabus:1"), 2, "one of percent, hz, rpm and machine"),
        (("reference", "vabus:1", "--hz", "fast"), 2, "'fast' for parameter reference is not a number"),
        (("status", "vabus:2"), 4, "vabus:2 did not answer"),
        (("status", "vabus:31"), 2, "1 to 30"),
        (("status", "vabus:x"), 2, "PROTOCOL:ADDRESS"),
        (("status", "vabus"), 2, "PROTOCOL:ADDRESS"),
        (("status", "profibus:1"), 2, "no installed protocol"),
        (("status", "vabus:1,speed=3"), 2, "no option 'speed'"),
        (("status", "vabus:1,baudrate=3"), 2, "baud rate"),
        (("status", "vabus:1", "--parity", "x"), 2, "parity"),
        (("status",), 2, "no drive and no plant"),
        (("fly", "vabus:1"), 2, "No such command"),
    ],
)
def test_errors_are_one_sentence(shell, arguments, code, sentence):
    shell.line()
    assert shell(*arguments) == code
    assert sentence in shell.err
    assert shell.err.startswith("drivecomm: ")
    assert shell.err.count("\n") == 1
    assert "Traceback" not in shell.err


def test_missing_port_exits_with_2(shell):
    assert shell("status", "vabus:1", port=None) == 2
    assert "DRIVECOMM_PORT" in shell.err


def test_unknown_port_exits_with_3(shell):
    assert shell("status", "vabus:1", port="nowhere") == 3
    assert "port nowhere does not exist" in shell.err


def test_port_is_taken_from_the_environment(shell, monkeypatch):
    shell.line()
    monkeypatch.setenv("DRIVECOMM_PORT", "line")
    assert shell("status", "vabus:1", port=None) == 0


def test_no_answer_names_port_drive_cause_and_remedy(shell):
    shell.line()
    shell("status", "vabus:4", "--attempts", "2", "--timeout", "0.2")
    assert shell.err == (
        "drivecomm: line: vabus:4 did not answer within 200 ms (asked 2 times); check its address, its line settings "
        "and the wiring, or scan the line\n"
    )


def test_damaged_answers_exit_with_4(shell):
    shell.line(faults=FaultPlan(rate=1, kinds=(LineFault.CORRUPT,), requests=False))
    assert shell("status", "vabus:1") == 4
    assert "vabus:1" in shell.err


def test_broken_line_exits_with_3(shell):
    line = shell.line()
    line.broken = True
    assert shell("read", "vabus:1", "481") == 3


def test_trace_prints_telegrams(shell):
    shell.line()
    assert shell("read", "vabus:1", "481", "--trace") == 0
    assert "->  vabus:1  04 41 30 30 34 38 31 05  enquiry address=1" in shell.err
    assert "<-  vabus:1  41 02" in shell.err


def test_trace_prints_json_events(shell):
    import json

    shell.line()
    shell("read", "vabus:1", "481", "--trace", "--json")
    events = [json.loads(text) for text in shell.err.splitlines()]
    assert [event["trace"] for event in events] == ["sent", "received", "sent"]
    assert events[0]["fields"]["parameter"] == 481


def test_read_works_on_an_echoing_line(shell):
    shell.line(echo=True)
    assert shell("read", "vabus:1", "481", "--echo") == 0
