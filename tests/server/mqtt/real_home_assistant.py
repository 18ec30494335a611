"""Home Assistant in a separate process, set up and queried over its HTTP API as its web page does.

DRIVECOMM_HOME_ASSISTANT names a Python that has it installed: `.ci/home-assistant FOLDER` makes one.
"""

import contextlib
import json
import os
import re
import socket
import subprocess
import time
import urllib.error
import urllib.request
from urllib.parse import urlencode

import pytest

PYTHON = os.environ.get("DRIVECOMM_HOME_ASSISTANT", "")

needs_home_assistant = pytest.mark.skipif(
    not PYTHON,
    reason="Home Assistant is not installed: DRIVECOMM_HOME_ASSISTANT=... (made by .ci/home-assistant FOLDER)",
)

SETTINGS = """\
http:
  server_host: 127.0.0.1
  server_port: {port}
logger:
  default: warning
"""
_COMPLAINT = re.compile(r"^\S+ \S+ (WARNING|ERROR|CRITICAL) ", re.MULTILINE)


class HomeAssistant:
    """Home Assistant on a loopback port, with all its files in one folder."""

    def __init__(self, folder):
        with socket.create_server(("127.0.0.1", 0)) as free:
            self.port = free.getsockname()[1]
        self.folder = folder
        self.log = folder / "said.txt"
        (folder / "configuration.yaml").write_text(SETTINGS.format(port=self.port))
        self.process = None
        self.token = ""
        # Position in the log. The log begins with complaints about missing optional parts, which do not concern drives.
        self._read = 0

    def start(self):
        with self.log.open("ab") as log:
            self.process = subprocess.Popen(
                [PYTHON, "-m", "homeassistant", "--skip-pip", "--config", str(self.folder)], stdout=log, stderr=log
            )
        self.until(self._is_there, 120)
        return self

    def end(self):
        if self.process is not None and self.process.poll() is None:
            self.process.terminate()
            try:
                self.process.wait(30)
            except subprocess.TimeoutExpired:
                self.process.kill()
                self.process.wait(10)

    def _is_there(self):
        assert self.process.poll() is None, self.log.read_text()[-3000:]
        try:
            if not self.token:
                return self.ask("/api/onboarding")
            return self.ask("/api/config")["state"] == "RUNNING"
        except OSError:
            return False

    def ask(self, path, content=None, *, form=None):
        """Return the reply to a GET request, or to a POST request if `content` or `form` is given."""
        headers = {"Authorization": f"Bearer {self.token}"} if self.token else {}
        data = None if form is None else urlencode(form).encode()
        if content is not None:
            data, headers["Content-Type"] = json.dumps(content).encode(), "application/json"
        request = urllib.request.Request(f"http://127.0.0.1:{self.port}{path}", data, headers)
        try:
            with urllib.request.urlopen(request, timeout=30) as response:
                return json.loads(response.read())
        except urllib.error.HTTPError as error:
            raise AssertionError(f"{path}: {error.code} {error.read().decode()}") from None

    def begin(self, broker):
        """Create the owner account, and configure the broker."""
        client = f"http://127.0.0.1:{self.port}/"
        owner = {"name": "otto", "username": "otto", "password": "otto's own", "language": "en"}
        code = self.ask("/api/onboarding/users", {**owner, "client_id": client})["auth_code"]
        form = {"grant_type": "authorization_code", "code": code, "client_id": client}
        self.token = self.ask("/auth/token", form=form)["access_token"]
        self.until(self._is_there, 60)
        self.no_complaints(seen=True)
        flow = self.ask("/api/config/config_entries/flow", {"handler": "mqtt"})["flow_id"]
        place = {"broker": "127.0.0.1", "port": broker.port}
        done = self.ask(
            f"/api/config/config_entries/flow/{flow}",
            {**place, "other_settings": {"set_client_cert": False, "set_ca_cert": "off"}},
        )
        assert done["type"] == "create_entry", done

    def states(self):
        """Return the states of drive entities by their names."""
        found = {each["entity_id"]: each for each in self.ask("/api/states")}
        return {name: each for name, each in found.items() if ".drivecomm_" in name}

    def state(self, entity):
        """Return the state of one entity, None if it does not exist."""
        return self.states().get(entity, {}).get("state")

    def template(self, text):
        """Return the text that Home Assistant renders from a template."""
        headers = {"Authorization": f"Bearer {self.token}", "Content-Type": "application/json"}
        data = json.dumps({"template": text}).encode()
        request = urllib.request.Request(f"http://127.0.0.1:{self.port}/api/template", data, headers)
        with urllib.request.urlopen(request, timeout=30) as response:
            return response.read().decode()

    def device(self, entity):
        """Return the device of an entity: its name, model, version and area."""
        parts = ("name", "model", "manufacturer")
        said = [f"{{{{ device_attr('{entity}', '{part}') }}}}" for part in parts]
        return self.template("|".join([*said, f"{{{{ area_name('{entity}') }}}}"])).split("|")

    def call(self, service, entity, **fields):
        self.ask(f"/api/services/{service.replace('.', '/')}", {"entity_id": entity, **fields})

    def no_complaints(self, *, seen=False):
        """Check that the log has no new complaints since the last check. seen: ignore the new complaints."""
        news = self._news()
        self._read += len(news.encode())
        if not seen:
            assert not _COMPLAINT.search(news), news[-4000:]

    def _news(self):
        return self.log.read_bytes()[self._read :].decode()

    def until(self, condition, seconds=20.0):
        end = time.monotonic() + seconds
        while not (found := condition()):
            assert time.monotonic() < end, (self.token and self.states(), self._news()[-3000:])
            time.sleep(0.1)
        return found


@contextlib.contextmanager
def home_assistant(folder):
    """Run Home Assistant during the block; yield it."""
    folder.mkdir()
    one = HomeAssistant(folder)
    try:
        yield one.start()
    finally:
        one.end()
