"""Server settings in a plant file: defaults, all keys, and errors."""

import os
from pathlib import Path

import pytest

from drivecomm.client import identity
from drivecomm.errors import FileFormatError
from drivecomm.plant import read_plant
from drivecomm.server.rates import Rate
from drivecomm.server.settings import HistorySettings, read_settings
from drivecomm.server.state_paths import audit_file, history_file, state_folder
from drivecomm.tomlfile import TEXT

PLANT = """\
format = 1
[[line]]
name = "hall"
[[drive]]
name = "pump"
drive = "vabus:1"
"""


@pytest.fixture
def file(tmp_path, monkeypatch):
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path / "state"))
    return tmp_path / "plant.toml"


def settings_of(file, text):
    file.write_text(PLANT + text)
    read_plant(file)
    return read_settings(file)


def test_server_settings_have_defaults(file):
    said = settings_of(file, "")
    assert (said.name, said.status_period_s, said.users, said.doors, said.alarms) == ("plant", 1.0, None, (), ())
    assert said.audit == audit_file(file)
    assert said.history == HistorySettings(file=history_file(file), days=30, megabytes=1000)


def test_server_settings_accept_every_key(file):
    said = settings_of(
        file,
        """\
network = { http = ["start"] }
[server]
name = "hall 2"
status_period_s = 0.5
users = "users.toml"
audit = "/var/log/audit.jsonl"
read_rate = { per_s = 2.5 }
history = { file = "history.sqlite", days = 3, megabytes = 10 }
[[door]]
kind = "http"
listen = "127.0.0.1:8080"
[[door]]
kind = "mqtt"
name = "cloud"
[[alarm]]
on = "fault"
""",
    )
    assert (said.name, said.status_period_s, said.users) == ("hall 2", 0.5, file.parent / "users.toml")
    assert said.audit == Path("/var/log/audit.jsonl")
    assert said.read_rate == Rate(2.5, 50)
    assert said.history == HistorySettings(file=file.parent / "history.sqlite", days=3, megabytes=10)
    (http, first), (mqtt, second) = said.doors
    assert (http, first.take({"listen": TEXT})) == ("http", {"listen": "127.0.0.1:8080"})
    assert str(first.error("no", "listen")) == f"{file}, line 17: door 1 (http): no"
    assert (mqtt, second.name, dict(second.content)) == ("mqtt", "door 2 (cloud)", {"name": "cloud"})
    assert [dict(each.content) for each in said.alarms] == [{"on": "fault"}]


def test_levels_of_a_door_take_their_names_from_the_server(file):
    text = '[server]\nname = "hall"\nsite = "Leeds"\narea = "mixing"\n[[door]]\nkind = "mqtt"\nlevels = {}\n'
    ((_, door),) = settings_of(file, text.format('["site", "plant", "line"]')).doors
    assert list(door.content["levels"].items()) == [("site", "Leeds"), ("plant", "hall"), ("line", "")]


def test_history_can_be_switched_off_or_configured(file):
    assert settings_of(file, "[server]\nhistory = false\n").history is None
    assert settings_of(file, "[server]\nhistory = true\n").history.file == history_file(file)
    assert settings_of(file, "[server]\nhistory = { days = 2 }\n").history.file == history_file(file)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("[server]\nnmae = 'x'\n", "line 8: server: unknown key 'nmae'; did you mean 'name'?"),
        ("[server]\nname = ''\n", "line 8: server: name is empty; leave it out"),
        ("[server]\nusers = ''\n", "line 8: server: users is empty; leave it out"),
        ("[server]\nstatus_period_s = 0\n", "line 8: server: invalid status_period_s = 0; write seconds above 0"),
        ("[server]\nstatus_period_s = nan\n", "line 8: server: invalid status_period_s = nan"),
        ("[server]\nhistory = 3\n", "line 8: server: invalid history = 3; write false, or a table"),
        ("[server]\nhistory = { day = 3 }\n", "line 8: server, history: unknown key 'day'; did you mean 'days'?"),
        ("[server]\nread_rate = { per_s = 0 }\n", "line 8: server, read_rate: invalid per_s = 0; write 0.01 or more"),
        ("[server]\nread_rate = { burst = 0.5 }\n", "line 8: server, read_rate: invalid burst = 0.5; write 1 or more"),
        (
            "[server]\nread_rate = { burts = 9 }\n",
            "line 8: server, read_rate: unknown key 'burts'; did you mean 'burst'?",
        ),
        ("[server]\nhistory = { days = 0 }\n", "line 8: server, history: invalid days = 0; write a number above 0"),
        ("[server]\nsite = ''\n", "line 8: server: site is empty; leave it out"),
        (
            "[[door]]\nkind = 'mqtt'\nlevels = ['site']\n",
            "line 9: door 1 (mqtt): levels: the site has no name; write site = in [server]",
        ),
        (
            "[[door]]\nkind = 'mqtt'\nlevels = ['lnie']\n",
            "line 9: door 1 (mqtt): levels: unknown level 'lnie'; did you mean 'line'?",
        ),
        (
            "[[door]]\nkind = 'mqtt'\nlevels = ['line', 'plant']\n",
            "line 9: door 1 (mqtt): list levels from highest to lowest, each once",
        ),
        ("[[door]]\nkind = 'mqtt'\nlevels = 'line'\n", "line 9: door 1 (mqtt): invalid levels = 'line'; write a list"),
        ("[[door]]\nlisten = 'x'\n", 'line 7: door 1: write the kind of door, such as kind = "http"'),
        ("[[door]]\nkind = 3\n", "line 8: door 1: write the kind of door"),
        ("[[door]]\nkind = 'local'\n", "line 8: door 1: the local door is always open; leave this one out"),
        (
            "network = { htpp = ['start'] }\n[[door]]\nkind = 'http'\n",
            "line 7: drive 1 (pump): network: unknown kind of door 'htpp'; did you mean 'http'?",
        ),
    ],
)
def test_invalid_server_setting_is_refused_with_its_line(file, text, sentence):
    with pytest.raises(FileFormatError) as caught:
        settings_of(file, text)
    assert str(caught.value).startswith(f"{file}, {sentence}")


def test_plant_has_one_state_folder_for_all_its_paths(file, tmp_path):
    file.touch()
    (tmp_path / "link.toml").symlink_to(file)
    assert state_folder(tmp_path / "link.toml") == state_folder(Path(os.path.relpath(file))) == state_folder(file)
    assert state_folder(tmp_path / "other" / "plant.toml") != state_folder(file)


def test_state_folder_follows_the_environment(tmp_path, monkeypatch):
    file = tmp_path / "plant.toml"
    monkeypatch.setenv("STATE_DIRECTORY", f"{tmp_path}{os.pathsep}/elsewhere")
    assert state_folder(file) == tmp_path / identity(file)
    monkeypatch.delenv("STATE_DIRECTORY")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "home"))
    if os.name == "posix":
        assert state_folder(file) == tmp_path / "home" / "drivecomm" / identity(file)
