"""The Containerfile: what a linter would say, what it copies is there, and how it finds out whether a server is well.

Nothing here builds it; the same installation, without a container, is in test_wheel.py.
"""

import json
import os
import re
import socket
import subprocess
import sys
import threading
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / "packaging" / "container"
KNOWN = {"FROM", "COPY", "RUN", "USER", "ENV", "VOLUME", "HEALTHCHECK", "STOPSIGNAL", "ENTRYPOINT", "CMD"}


def statements():
    """The statements of the last stage, after those of the stages before it."""
    text = re.sub(r"^#.*\n", "", (FOLDER / "Containerfile").read_text(encoding="utf-8"), flags=re.MULTILINE)
    lines = text.replace("\\\n", " ").splitlines()
    return [tuple(line.split(None, 1)) for line in lines if line.strip()]


def last_stage():
    found = statements()
    return found[max(place for place, (word, _) in enumerate(found) if word == "FROM") :]


def test_every_statement_is_known():
    assert {word for word, _ in statements()} <= KNOWN


def test_images_have_a_registry_and_a_version():
    for word, rest in statements():
        if word == "FROM":
            assert re.fullmatch(r"docker\.io/library/python:3\.\d+-slim-\w+( AS \w+)?", rest)


def test_it_runs_as_a_numbered_user_who_is_not_root():
    users = [rest for word, rest in last_stage() if word == "USER"]
    assert re.fullmatch(r"[1-9]\d+:[1-9]\d+", users[-1])
    after = last_stage()[[word for word, _ in last_stage()].index("USER") :]
    assert not {"RUN", "COPY"} & {word for word, _ in after}


@pytest.mark.parametrize("word", ["ENTRYPOINT", "CMD", "VOLUME"])
def test_no_shell_stands_between(word):
    assert isinstance(json.loads(dict(last_stage())[word]), list)


def test_what_is_written_to_is_a_volume():
    volumes = json.loads(dict(last_stage())["VOLUME"])
    environment = dict(pair.split("=", 1) for pair in dict(last_stage())["ENV"].split())
    assert {environment["STATE_DIRECTORY"], environment["RUNTIME_DIRECTORY"]} == set(volumes)


def test_no_secret_is_in_the_image():
    assert not re.search(r"(?i)token|password|secret", (FOLDER / "Containerfile").read_text(encoding="utf-8"))


def test_what_the_wheel_is_made_of_is_copied_and_nothing_else():
    with (ROOT / "pyproject.toml").open("rb") as file:
        hatch = tomllib.load(file)["tool"]["hatch"]["build"]["targets"]["wheel"]
    needed = {Path(name).parts[0] for name in [*hatch["packages"], *hatch["shared-data"]]}
    copied = set()
    for word, rest in statements():
        if word == "COPY" and not rest.startswith("--from="):
            *sources, _ = rest.split()
            assert all((ROOT / source).exists() for source in sources)
            copied.update(sources)
    others = {"pyproject.toml", "README.md", "LICENSE", "constraints.txt", "packaging/container/healthy.py"}
    assert copied == needed | others


@pytest.mark.skipif(sys.platform == "win32", reason="containers are Linux")
class TestHealthcheck:
    def asked(self, folder):
        done = subprocess.run(
            [sys.executable, str(FOLDER / "healthy.py")],
            env={**os.environ, "RUNTIME_DIRECTORY": str(folder)},
            timeout=30,
            check=False,
        )
        return done.returncode

    def test_it_is_the_script_that_is_copied(self):
        healthcheck = dict(last_stage())["HEALTHCHECK"]
        assert json.loads(healthcheck.partition("CMD ")[2])[1] == "/opt/drivecomm/healthy.py"

    def test_without_a_server_it_is_not_well(self, tmp_path):
        assert self.asked(tmp_path) == 1

    @pytest.mark.parametrize(
        ("answer", "code"),
        [
            (b"HTTP/1.1 200 OK\r\nContent-Length: 0\r\n\r\n", 0),
            (b"HTTP/1.1 503 Service Unavailable\r\nContent-Length: 0\r\n\r\n", 1),
            (b"nonsense\r\n\r\n", 1),
            (b"", 1),
        ],
    )
    def test_it_is_as_well_as_the_server_says(self, tmp_path, answer, code):
        with socket.socket(socket.AF_UNIX) as listening:
            listening.bind(str(tmp_path / "hall-01234567.sock"))
            listening.listen()
            asked = []

            def serve():
                connection, _ = listening.accept()
                with connection:
                    asked.append(connection.recv(4096))
                    connection.sendall(answer)

            server = threading.Thread(target=serve)
            server.start()
            assert self.asked(tmp_path) == code
            server.join(5)
        assert asked[0].startswith(b"GET /healthz HTTP/1.1\r\n")

    def test_a_server_that_was_killed_is_not_well(self, tmp_path):
        with socket.socket(socket.AF_UNIX) as listening:
            listening.bind(str(tmp_path / "hall-01234567.sock"))
        assert self.asked(tmp_path) == 1
