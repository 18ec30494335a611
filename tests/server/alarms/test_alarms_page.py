"""Examples on the alarms page, compared with real output."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from alarm_points import ClockedAlarms, pump, rule
from pages import ROOT, blocks_of

from drivecomm.protocol import DriveConfig, PollGroup
from drivecomm.server.alarms import read_alarms
from drivecomm.server.alarms.messages import entry_of, message_of
from drivecomm.server.alarms.receivers import WebhookReceiver
from drivecomm.tomlfile import read_toml

PAGE = ROOT / "docs" / "how-to" / "alarms.md"
BLOCKS = list(blocks_of(PAGE))


def block(language):
    return next(each.code for each in BLOCKS if each.language == language)


def test_rules_on_the_page_match_their_texts(tmp_path):
    (tmp_path / "plant.toml").write_text(block("toml"))
    poll = (PollGroup(parameters=("output_current",)),)
    drives = [DriveConfig(protocol="vabus", address=n, name=name, poll=poll) for n, name in enumerate(["pump", "fan"])]
    rules = read_alarms(read_toml(tmp_path / "plant.toml", "a plant").tables("alarm"), drives)
    shown = f"{rules[0].name}: {rules[0]}; notifies {', '.join(rules[0].labels)}"
    assert shown in block("console")
    assert [each.name for each in rules] == ["tripped", "pump overloaded"]


def test_message_on_the_page_matches_a_real_one():
    clock = ClockedAlarms(rule(name="tripped"))
    (raised,) = clock.alarms.drive_seen(pump("F0400 overload"), 0.0, 0.0)
    message = message_of("hall 2", [entry_of(raised)])
    shown = json.loads(block("json"))
    assert list(message) == list(shown)
    assert list(message["alarms"][0]) == list(shown["alarms"][0])
    same = ("what", "rule", "drive", "title", "times", "acknowledged_by")
    assert [message["alarms"][0][key] for key in same] == [shown["alarms"][0][key] for key in same]
    assert message["title"] == shown["title"]
    assert message["text"].partition("since")[0] == shown["text"].partition("since")[0]


def test_webhook_program_of_the_page_works(tmp_path):
    program = next(each.code for each in BLOCKS if each.title == "receive.py")
    # The program takes a free port and prints its number.
    program = program.replace('HTTPServer(("127.0.0.1", 9000), Hook)', 'server = HTTPServer(("127.0.0.1", 0), Hook)')
    program = program.replace(".serve_forever()", "\nprint(server.server_port, flush=True)\nserver.serve_forever()")
    assert "server_port" in program
    file = Path(tmp_path / "receive.py")
    file.write_text(program)
    with subprocess.Popen([sys.executable, "-u", file], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as process:
        try:
            hook = WebhookReceiver(label="", url=f"http://127.0.0.1:{int(process.stdout.readline())}/hook")
            message = json.loads(block("json"))
            assert [hook.deliver(message, 10), hook.deliver(message, 10)] == ["", ""]
            message["alarms"][0] |= {"message": "k3v9-17.2", "what": "over", "text": "the end"}
            assert hook.deliver(message, 10) == ""
            assert process.stdout.readline().startswith(b"raised pump: tripped: fault F0400 overload")
            assert process.stdout.readline() == b"over the end\n"
        finally:
            process.kill()


@pytest.mark.parametrize("figure", ["for an hour", "with apprise 30 s", "default 60"])
def test_page_states_the_figure(figure):
    assert figure in PAGE.read_text()
