"""Text from callers, brokers and drives: no terminal control characters in terminals, logs, journals or events."""

import json
import logging
import unicodedata

import pytest
from fake_plant import FakeUsers
from hypothesis import HealthCheck, given, settings, strategies as st
from processes import QUICK, serving
from served_core import OPERATOR, awaited, core_of, until

from drivecomm.client import error_content, json_text
from drivecomm.errors import UsageError, in_one_line, printable
from drivecomm.server import Caller, CommandAnswer, CommandRequest, Event, Role
from drivecomm.server.audit import Audit
from drivecomm.server.logs import RotatingFile, WaitingHandler
from drivecomm.server.plant_service import PlantForDoors
from drivecomm.server.table import ValueTable

ESCAPES = "4\x1b[2J\x07\x9b31m\u202egnirts\u2028\r\nfake line\x7f\x00\udc80"
FOREIGN = st.text(st.characters() | st.sampled_from(ESCAPES), max_size=60)


def commands_a_terminal(text):
    """Return the characters of a line that are not plain text: controls, directions, separators, surrogates."""
    return [each for each in text if unicodedata.category(each) in ("Cc", "Cf", "Cs", "Zl", "Zp")]


@given(FOREIGN)
def test_printable_text_has_no_controls_and_keeps_plain_characters(text):
    shown = printable(text)
    assert not commands_a_terminal(shown)
    assert [each for each in shown if each in text] == [each for each in text if each.isprintable()] or "\\" in shown
    assert printable(shown) == shown


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("pump 2, 10.00 °C ok", "pump 2, 10.00 °C ok"),
        ("4\x1b[2J", r"4\x1b[2J"),
        ("a\u202eb\u2066c", r"a\u202eb\u2066c"),
        ("one\ntwo\x85three", r"one\ntwo\x85three"),
        ("\x9b31m\x7f", r"\x9b31m\x7f"),
    ],
)
def test_printable_text_shows_escapes(text, expected):
    assert printable(text) == expected


@given(FOREIGN)
def test_error_text_has_no_control_characters(text):
    assert not commands_a_terminal(in_one_line(UsageError(text)))
    assert not commands_a_terminal(error_content(UsageError(text))["text"])


@settings(max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(FOREIGN, min_size=1, max_size=5))
def test_log_has_one_plain_line_for_each_message(tmp_path, texts):
    file = tmp_path / "server.log"
    file.unlink(missing_ok=True)
    handler = WaitingHandler(RotatingFile(file))
    for number, text in enumerate(texts):
        handler.handle(logging.LogRecord("drivecomm", logging.INFO, "", 0, "%d from %s", (number, text), None))
    handler.close()
    lines = file.read_bytes().decode().split("\n")
    assert len(lines) == len(texts) + 1
    assert not any(map(commands_a_terminal, lines))


def test_log_has_plain_lines_for_the_text_of_an_exception(tmp_path):
    handler = WaitingHandler(RotatingFile(tmp_path / "server.log"))
    error = RuntimeError(ESCAPES)
    handler.handle(logging.LogRecord("drivecomm", 40, "", 0, "message", None, (RuntimeError, error, None)))
    handler.close()
    lines = (tmp_path / "server.log").read_bytes().decode().split("\n")
    assert any("RuntimeError" in line for line in lines)
    assert not any(map(commands_a_terminal, lines))


@given(FOREIGN, FOREIGN, FOREIGN)
def test_event_text_has_no_control_characters(text, drive, who):
    event = ValueTable(lambda _, call: call()).record_event("door", text, drive=drive, who=who)
    assert isinstance(event, Event)
    assert not any(map(commands_a_terminal, (event.text, event.drive, event.who)))


@given(FOREIGN)
def test_json_text_has_no_control_characters(text):
    told = json_text({text: [text, {"text": text}]})
    assert not commands_a_terminal(told)
    assert json.loads(told) == {text: [text, {"text": text}]}


@awaited
async def test_audit_lines_have_no_control_characters(tmp_path):
    audit = Audit(tmp_path / "audit.jsonl", print)
    caller = Caller(name=ESCAPES, role=Role.VIEW, door=ESCAPES)
    command = CommandRequest(drive=ESCAPES, verb=ESCAPES, id=ESCAPES, arguments={ESCAPES: ESCAPES})
    number = audit.record_stop(caller, command)
    audit.outcome(caller, command, number, CommandAnswer(id="", outcome="failed", error=UsageError(ESCAPES)))
    audit.refused(caller, command, ESCAPES)
    await audit.close()
    lines = (tmp_path / "audit.jsonl").read_bytes().decode().split("\n")
    assert len(lines) == 4
    assert not any(map(commands_a_terminal, lines))


@awaited
async def test_event_of_a_command_has_no_control_characters(tmp_path):
    async with core_of(tmp_path) as (core, _):
        plant = PlantForDoors(core, "hall", users=FakeUsers())
        await until(lambda: core.drive("pump").reachability == "answers")
        await plant.command(
            OPERATOR, CommandRequest(drive="pump", verb="set_reference", arguments={"percent": ESCAPES})
        )
        await plant.command(OPERATOR, CommandRequest(drive="pump", verb="stop", arguments={"how": ESCAPES}))
        await plant.command(OPERATOR, CommandRequest(drive="pump", verb="start", arguments={ESCAPES: ESCAPES}))
        plant.tell(f"a message on {ESCAPES}", who=ESCAPES)
        await until(lambda: any("a message on" in each.text for each in core.table.events()))
        said = [text for each in core.table.events() for text in (each.text, each.drive, each.who)]
        assert any(r"\x1b[2J" in text for text in said if "set_reference" in text)
        assert not any(map(commands_a_terminal, said))


@pytest.mark.parametrize("name", ["pump\x1b[2J", "pump\n", "\u202epmup"])
def test_drive_name_with_control_characters_is_refused(tmp_path, name):
    with (
        pytest.raises(UsageError, match="has unprintable characters"),
        serving(
            tmp_path,
            head="",
            tail=f'[[drive]]\nname = {json.dumps(name)}\nline = "hall"\ndrive = "vabus:9"\n',
            start=False,
        ),
    ):
        pass


def test_server_log_has_no_control_characters_of_a_caller(tmp_path):
    head = f'[[door]]\nkind = "http"\nlisten = "127.0.0.1:0"\n{QUICK}'
    with serving(tmp_path, head=head) as served:
        served.until(lambda: served.drive("fan")["reachability"] == "answers")
        asked = {"id": ESCAPES[:2], "arguments": {"percent": "4\x1b[2J\u202e"}}
        served.ask("/api/v1/drives/fan/set_reference", asked)
        served.until(lambda: "set_reference" in served.log.read_text())
        assert r"4\x1b[2J\u202e" in served.log.read_text()
        assert not commands_a_terminal(served.log.read_text().replace("\n", ""))
