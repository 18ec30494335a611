"""The door of the page "Write a door", installed from the page and opened by a server process.

`tests/server/doors` tests this door by the rules for every door.
"""

import json
import re
import socket

import pytest
from packages_of_pages import installed_from
from pages import ROOT, blocks_of
from processes import serving

from drivecomm.server import token_hash

PAGE = ROOT / "docs" / "development" / "write-a-door.md"
DOOR = '[[door]]\nkind = "lines"\nlisten = "127.0.0.1:0"\n'
TOKEN = "a token of otto's own, long enough"


@pytest.fixture
def package(tmp_path):
    return installed_from(PAGE, tmp_path / "package")


def test_server_opens_the_door_by_its_entry_point_and_commands_a_drive(tmp_path, package):
    users = tmp_path / "users.toml"
    users.write_text(f'[[user]]\nname = "otto"\nrole = "operate"\ntoken = "{token_hash(TOKEN)}"\n')
    users.chmod(0o600)
    head = '[server]\nstatus_period_s = 0.1\nusers = "users.toml"\n'
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    door = DOOR.replace(":0", f":{port}")
    with serving(tmp_path, head=head, tail=door, PYTHONPATH=str(package)) as server:
        server.until(lambda: server.drive("fan")["reachability"] == "answers")
        with socket.create_connection(("127.0.0.1", port), timeout=20) as connected, connected.makefile("rw") as lines:

            def ask(**content):
                lines.write(json.dumps({"token": TOKEN, **content}) + "\n")
                lines.flush()
                return json.loads(lines.readline())

            assert ask(verb="read", drive="fan", arguments={"parameter": "output_frequency"})["result"]["unit"] == "Hz"
            session = ask(verb="hello")["result"]["session"]
            start = ask(id="1", verb="start", drive="fan", session=session, issued_s=1.0)
            assert start["outcome"] == "refused"
            assert "does not allow start of fan over lines" in start["error"]["text"]


def test_door_imports_only_the_public_interface_of_the_server():
    allowed = {"drivecomm.server", "drivecomm.server.broker", "drivecomm.client", "drivecomm.errors"}
    for block in blocks_of(PAGE):
        if block.title.endswith(".py"):
            assert set(re.findall(r"^from (drivecomm\.[\w.]+) import", block.code, re.MULTILINE)) <= allowed


def test_page_states_the_number_of_lines_of_the_door():
    lines = sum(len(block.code.splitlines()) for block in blocks_of(PAGE) if block.title.endswith(".py"))
    assert f"in about {round(lines, -1)} lines" in PAGE.read_text(encoding="utf-8")
