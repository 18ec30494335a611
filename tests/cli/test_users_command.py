"""The users commands: a token is shown once, and only its hash is stored."""

import io
import json
import sys

import pytest

from drivecomm.cli import main
from drivecomm.server import Role, Users, read_users


@pytest.fixture
def run(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def call(*arguments):
        code = main(["users", *arguments])
        captured = capsys.readouterr()
        return code, captured.out, captured.err

    return call


@pytest.mark.soak
def test_user_is_added_listed_and_removed(run, tmp_path):
    code, out, _ = run("add", "anna", "--role", "operate")
    assert code == 0
    said, token = out.splitlines()
    assert said == "anna has the role operate in users.toml now. The access token, which is shown only once:"
    file = tmp_path / "users.toml"
    assert token not in file.read_text()
    assert Users(file).caller(token, "http").role is Role.OPERATE
    assert run("list") == (0, "anna  operate  token\n", "")
    assert run("remove", "anna") == (0, "anna removed from users.toml\n", "")
    assert run("list") == (0, "", "")


@pytest.mark.soak
def test_password_is_read_from_a_pipe(run, monkeypatch):
    monkeypatch.setattr(sys, "stdin", io.StringIO("correct horse\nanything\n"))
    code, out, _ = run("add", "ben", "--role", "view", "--password", "--file", "other.toml", "--json")
    content = json.loads(out)
    assert (code, content.pop("token") != "") == (0, True)
    assert content == {"name": "ben", "role": "view", "file": "other.toml"}
    assert run("list", "--file", "other.toml", "--json")[1] == (
        '{"name": "ben", "role": "view", "token": true, "password": true}\n'
    )


@pytest.mark.soak
def test_password_is_typed_twice_and_not_shown(run, monkeypatch, tmp_path):
    asked = []
    monkeypatch.setattr(sys, "stdin", io.StringIO())
    monkeypatch.setattr(sys.stdin, "isatty", lambda: True, raising=False)
    monkeypatch.setattr("click.prompt", lambda text, **how: asked.append((text, how)) or "correct horse")
    assert run("add", "ben", "--role", "view", "--password")[0] == 0
    assert asked == [("Password", {"hide_input": True, "confirmation_prompt": True, "err": True})]
    assert read_users(tmp_path / "users.toml")[0].password


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("add", "anna", "--role", "opreate"), "unknown role 'opreate'; did you mean 'operate'? Use view, operate"),
        (("add", "a b", "--role", "view"), "'a b' cannot be a user's name"),
        (("add", "anonymous", "--role", "view"), "anonymous is reserved for callers without a login"),
        (("list",), "users.toml: there is no such file"),
        (("remove", "anna"), "users.toml: there is no such file"),
        (("list", "--file", "."), ".: cannot be read as a file of users"),
    ],
)
def test_users_commands_refuse_wrong_arguments(run, tmp_path, arguments, sentence):
    tmp_path.chmod(0o700)
    code, out, error = run(*arguments)
    assert (code, out) == (2, "")
    assert error.startswith(f"drivecomm: {sentence}")
    assert not (tmp_path / "users.toml").exists()


def test_short_password_changes_nothing(run, monkeypatch, tmp_path):
    monkeypatch.setattr(sys, "stdin", io.StringIO("short\n"))
    code, _, error = run("add", "ben", "--role", "view", "--password")
    assert (code, error) == (2, "drivecomm: a password has 8 to 200 characters; choose another one\n")
    assert not (tmp_path / "users.toml").exists()
