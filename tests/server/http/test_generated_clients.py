"""Clients made from the server's description by third-party generators compile, and command a drive."""

import json
import os
import shutil
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from processes import QUICK, serving

from drivecomm.server import Role, User, add_user, password_hash

HERE = Path(__file__).parent
HEAD = QUICK + 'users = "users.toml"\n[[door]]\nkind = "http"\nlisten = "127.0.0.1:{port}"\n'
SAW = """
[[drive]]
name = "saw"
drive = "danfoss-fc:4"
line = "yard"
armed = true
options = { model = "fc302" }
link_loss = { policy = "ramp", watchdog_s = 1 }
network = { http = ["start", "reference"] }
"""
EXPECTED = {"refused": [403, "refused", "NotAllowedError"], "done": ["done", "done"], "armed": True}

pytestmark = [pytest.mark.foreign, pytest.mark.soak, pytest.mark.timeout(300)]


@pytest.fixture
def server(tmp_path):
    folder = tmp_path / "plant"
    folder.mkdir()
    for name, role in (("anna", Role.VIEW), ("otto", Role.OPERATE)):
        add_user(folder / "users.toml", User(name=name, role=role, password=password_hash(f"{name}'s password")))
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    with serving(folder, head=HEAD.format(port=port), tail=SAW) as one:
        one.url = f"http://127.0.0.1:{port}"
        one.until(lambda: one.drive("saw")["reachability"] == "answers")
        yield one


def run(*command, folder):
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, f"{done.stdout[-3000:]}{done.stderr[-3000:]}"
    return done.stdout


def check_motor(server, printed):
    assert json.loads(printed) == EXPECTED
    server.until(lambda: server.runs("saw"))
    server.ask("/api/v1/drives/saw/stop", {"id": "the end"})
    server.until(lambda: not server.runs("saw"))


@pytest.fixture
def node_modules():
    """Return the folder of Node packages; skip the test unless it has the TypeScript generator."""
    found = Path(os.environ.get("DRIVECOMM_NODE_MODULES", ""))
    needed = ("openapi-typescript", "openapi-fetch", "typescript")
    if not shutil.which("node") or not all((found / each).is_dir() for each in needed):
        pytest.skip(f"node, or one of {', '.join(needed)}, is not in DRIVECOMM_NODE_MODULES")
    return found


def test_typescript_client_commands_a_drive(server, node_modules, tmp_path):
    folder = tmp_path / "client"
    folder.mkdir()
    (folder / "node_modules").symlink_to(node_modules.resolve())
    (folder / "package.json").write_text('{"type": "module"}')
    shutil.copy(HERE / "generated_client.ts", folder)
    generator, compiler = "node_modules/openapi-typescript/bin/cli.js", "node_modules/typescript/bin/tsc"
    run("node", generator, f"{server.url}/openapi.json", "-o", "api.d.ts", folder=folder)
    options = ("--strict", "--exactOptionalPropertyTypes", "--module", "nodenext", "--target", "es2022")
    run("node", compiler, *options, "--lib", "es2022,dom,dom.iterable", "generated_client.ts", folder=folder)
    check_motor(server, run("node", "generated_client.js", server.url, folder=folder))


def test_python_client_commands_a_drive(server, tmp_path):
    python = os.environ.get("DRIVECOMM_OPENAPI_PYTHON", "")
    if not python:
        pytest.skip("openapi-python-client is not installed; name a Python that has it in DRIVECOMM_OPENAPI_PYTHON")
    folder = tmp_path / "client"
    folder.mkdir()
    generate = ("generate", "--url", f"{server.url}/openapi.json", "--meta", "none", "--output-path", "hall")
    run(python, "-m", "openapi_python_client", *generate, folder=folder)
    shutil.copy(HERE / "generated_client.py", folder)
    run(sys.executable, "-W", "error", "-m", "compileall", "-q", "hall", folder=folder)
    check_motor(server, run(python, "generated_client.py", server.url, folder=folder))
