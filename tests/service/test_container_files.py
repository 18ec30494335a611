"""The Containerfile: rules of a linter, the files that it copies, and its health check.

No image is built here; test_wheel.py tests the same installation without a container.
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
    """Return all statements as pairs of keyword and arguments."""
    text = re.sub(r"^#.*\n", "", (FOLDER / "Containerfile").read_text(encoding="utf-8"), flags=re.MULTILINE)
    lines = text.replace("\\\n", " ").splitlines()
    return [tuple(line.split(None, 1)) for line in lines if line.strip()]


def last_stage():
    found = statements()
    return found[max(place for place, (word, _) in enumerate(found) if word == "FROM") :]


def test_every_statement_of_the_containerfile_is_known():
    assert {word for word, _ in statements()} <= KNOWN


def test_base_images_have_a_registry_and_a_version():
    for word, rest in statements():
        if word == "FROM":
            assert re.fullmatch(r"docker\.io/library/python:3\.\d+-slim-\w+( AS \w+)?", rest)


def test_container_runs_as_a_numeric_user_other_than_root():
    users = [rest for word, rest in last_stage() if word == "USER"]
    assert re.fullmatch(r"[1-9]\d+:[1-9]\d+", users[-1])
    after = last_stage()[[word for word, _ in last_stage()].index("USER") :]
    assert not {"RUN", "COPY"} & {word for word, _ in after}


@pytest.mark.parametrize("word", ["ENTRYPOINT", "CMD", "VOLUME"])
def test_statement_uses_the_exec_form_without_a_shell(word):
    assert isinstance(json.loads(dict(last_stage())[word]), list)


def test_writable_folders_are_volumes():
    volumes = json.loads(dict(last_stage())["VOLUME"])
    environment = dict(pair.split("=", 1) for pair in dict(last_stage())["ENV"].split())
    assert {environment["STATE_DIRECTORY"], environment["RUNTIME_DIRECTORY"]} == set(volumes)


def test_no_secret_is_in_the_image():
    assert not re.search(r"(?i)token|password|secret", (FOLDER / "Containerfile").read_text(encoding="utf-8"))


def test_containerfile_copies_exactly_the_sources_of_the_wheel():
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

    def test_health_check_runs_the_copied_script(self):
        healthcheck = dict(last_stage())["HEALTHCHECK"]
        assert json.loads(healthcheck.partition("CMD ")[2])[1] == "/opt/drivecomm/healthy.py"

    def test_health_check_fails_without_a_server(self, tmp_path):
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
    def test_health_check_follows_the_response_of_the_server(self, tmp_path, answer, code):
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

    def test_health_check_fails_after_the_server_was_killed(self, tmp_path):
        with socket.socket(socket.AF_UNIX) as listening:
            listening.bind(str(tmp_path / "hall-01234567.sock"))
        assert self.asked(tmp_path) == 1
