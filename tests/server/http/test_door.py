"""The HTTP door: its table, refused settings, start and end."""

import http.client
import os
import pkgutil
import shutil
import signal
import socket
import ssl
import subprocess
import sys
import threading
import time
import tomllib
from decimal import Decimal
from pathlib import Path

import pytest
from fake_plant import Client, FakeHistory, FakePlant, FakeUsers, served, value

from drivecomm.client import json_text, parsed
from drivecomm.errors import DriveCommError, FileFormatError, PortError, UsageError
from drivecomm.server.http import HttpDoor, LocalDoor, description, http_door
from drivecomm.tomlfile import TomlTable


def table(**content):
    return TomlTable({"kind": "http", **content}, "hall.toml", name="door 1")


@pytest.fixture
def certificate(tmp_path):
    if not shutil.which("openssl"):
        pytest.skip("openssl is not installed")
    files = tmp_path / "certificate.pem", tmp_path / "key.pem"
    command = ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", "-subj", "/CN=localhost"]
    subprocess.run([*command, "-out", files[0], "-keyout", files[1]], check=True, capture_output=True)
    return files


def test_http_door_listens_on_loopback_by_default():
    assert http_door(table()).name == "http 127.0.0.1:8080"


@pytest.mark.parametrize(
    ("content", "text"),
    [
        ({"listen": "8080"}, 'write an address and a port, such as "127.0.0.1:8080"'),
        ({"listen": "127.0.0.1:http"}, "write an address and a port"),
        ({"listen": "127.0.0.1:99999"}, "write an address and a port"),
        ({"lisen": "127.0.0.1:80"}, "did you mean 'listen'?"),
        ({"certificate": "c.pem"}, "write both certificate = and key ="),
        ({"anonymous": "operate"}, 'write "view" or "nobody"'),
        ({"names": [1]}, 'write names = ["drives.example.com"]'),
    ],
)
def test_invalid_door_table_is_refused(content, text):
    with pytest.raises(FileFormatError) as caught:
        http_door(table(**content))
    assert text in str(caught.value)
    assert str(caught.value).startswith("hall.toml: door 1: ")


@pytest.mark.parametrize(
    "listen",
    ["0.0.0.0:0", "[::]:0", "192.168.1.2:0", "plant.example:0"],
    ids=["every-address", "every-address-of-6", "one", "a-name"],
)
def test_network_address_needs_tls_and_users(listen, certificate):
    with pytest.raises(FileFormatError, match=r"certificate = and key =, .*, or set insecure = true"):
        http_door(table(listen=listen))
    door = http_door(table(listen=listen, certificate=str(certificate[0]), key=str(certificate[1])))
    with pytest.raises(UsageError, match=r'write users = "users\.toml" in \[server\]'), served(door, FakePlant()):
        pass


def test_insecure_door_still_refuses_anonymous_callers():
    door = http_door(table(listen="0.0.0.0:0", insecure=True))
    with served(door, FakePlant()):
        # Anonymous callers stay locked out unless `anonymous` admits them.
        assert Client(door).get("/api/v1/plant").status == 401


def test_anonymous_callers_view_only_if_the_door_says_so(plant):
    with served(door := http_door(table(listen="127.0.0.1:0", anonymous="nobody")), FakePlant()):
        assert Client(door).get("/api/v1/plant").status == 401
    with served(door := http_door(table(listen="127.0.0.1:0", anonymous="view")), plant):
        assert Client(door).get("/api/v1/plant").content["you"] == {
            "name": "anonymous", "role": "view", "door": f"http 127.0.0.1:{door.port}",
        }  # fmt: skip


def test_http_door_serves_over_tls(plant, certificate):
    door = http_door(table(listen="127.0.0.1:0", certificate=str(certificate[0]), key=str(certificate[1])))
    context = ssl.create_default_context(cafile=str(certificate[0]))
    with served(door, plant):
        client = Client(door, "annaanna")
        plain = client.connect
        client.connect = lambda: context.wrap_socket(plain(), server_hostname="localhost")
        assert client.get("/api/v1/plant").content["you"]["name"] == "anna"
        with client.stream() as stream:
            stream.next("values")
            plant.change(value("pump", amount="12.5"))
            assert str(stream.next("values").data[0]["reading"]["value"]) == "12.5"


def test_invalid_certificate_is_refused(plant, tmp_path):
    (tmp_path / "c.pem").write_text("x")
    door = http_door(table(certificate=str(tmp_path / "c.pem"), key=str(tmp_path / "c.pem"), listen="127.0.0.1:0"))
    with pytest.raises(UsageError, match="cannot be used"), served(door, plant):
        pass


def test_port_in_use_is_reported(plant):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        listen = f"127.0.0.1:{taken.getsockname()[1]}"
        refusal = pytest.raises(PortError, match=f"cannot listen on {listen}: .*; write another listen =")
        with refusal, served(http_door(table(listen=listen)), plant):
            pass


def test_http_door_has_its_entry_point():
    project = tomllib.loads((Path(__file__).parents[3] / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert pkgutil.resolve_name(project["entry-points"]["drivecomm.doors"]["http"]) is http_door


def test_fastapi_is_imported_only_when_a_door_runs():
    program = (
        "import sys, drivecomm, drivecomm.cli, drivecomm.server.fleet.page\n"
        "from drivecomm.server.http import check_place, files_of, guarded, http_door, own_names, serve\n"
        "from drivecomm.tomlfile import TomlTable\n"
        "http_door(TomlTable({}, 'plant.toml'))\n"
        "def loaded(): return {each for each in ('fastapi', 'pydantic', 'opentelemetry') if each in sys.modules}\n"
        "assert not loaded(), loaded()\n"
        "import drivecomm.server.http.application\n"
        "assert 'fastapi' in loaded()\n"
    )
    subprocess.run([sys.executable, "-c", program], check=True, timeout=60)


def test_local_door_names_its_callers_by_their_account(local, plant):
    import pwd

    name = pwd.getpwuid(os.getuid()).pw_name
    assert local.get("/api/v1/plant").content["you"] == {"name": name, "role": "commission", "door": "local"}
    assert local.post("/api/v1/drives/pump/read").content["outcome"] == "done"
    assert plant.commands[0][0].name == name


def test_local_socket_is_accessible_to_its_owner_only(plant, tmp_path):
    path = tmp_path / "hall.sock"
    with served(LocalDoor(path), plant):
        assert path.stat().st_mode & 0o777 == 0o600
    assert not path.exists()


def test_socket_left_by_a_killed_server_is_replaced(plant, tmp_path):
    path = tmp_path / "hall.sock"
    with socket.socket(socket.AF_UNIX) as left:
        left.bind(str(path))
    with served(LocalDoor(path), plant):
        assert Client(path).get("/healthz").status == 200


def test_local_door_without_unix_sockets_needs_its_token(plant, tmp_path, monkeypatch):
    monkeypatch.setattr("drivecomm.server.http.door._HAS_UNIX_SOCKETS", False)
    door = LocalDoor(tmp_path / "hall.sock")
    with served(door, plant):
        assert Client(door, door.token).get("/api/v1/plant").content["you"]["role"] == "commission"
        assert Client(door, "guessed").get("/api/v1/plant").status == 401
        assert Client(door).get("/api/v1/plant").status == 401


def test_http_door_leaves_signal_handlers_alone(plant):
    before = [signal.getsignal(each) for each in (signal.SIGTERM, signal.SIGINT)]
    with served(http_door(table(listen="127.0.0.1:0")), plant):
        assert [signal.getsignal(each) for each in (signal.SIGTERM, signal.SIGINT)] == before


@pytest.mark.soak
def test_open_request_is_answered_while_the_door_closes(plant, tmp_path):
    path = tmp_path / "hall.sock"
    found = []
    with served(LocalDoor(path), plant) as running:
        asking = threading.Thread(target=lambda: found.append(_wait_ended(Client(path))))
        asking.start()
        assert plant.waiting.wait(5)
        running.end()
        asking.join(5)
        assert running.ended_s < 2
    assert found == ["ended"]


def _wait_ended(client):
    try:
        client.post("/api/v1/drives/pump/wait", arguments={"goal": "stopped"})
    except (OSError, DriveCommError, Exception):  # noqa: BLE001 - any error of the client
        return "ended"
    return "answered"


def test_wait_is_cancelled_when_its_client_disconnects(local, plant):
    with local.connect() as connected:
        connected.sendall(b"POST /api/v1/drives/pump/wait HTTP/1.1\r\nHost: x\r\nContent-Length: 2\r\n\r\n{}")
        assert plant.waiting.wait(5)
        assert not plant.cancelled.is_set()
    assert plant.cancelled.wait(5)


def test_connections_are_kept_alive(local):
    connection = http.client.HTTPConnection("localhost")
    connection.sock = connected = local.connect()
    for _ in range(3):
        connection.request("GET", "/healthz")
        assert connection.getresponse().read() == b"ok\n"
        assert connection.sock is connected
    connection.close()


def test_silent_connection_is_closed(plant, tmp_path, monkeypatch):
    monkeypatch.setattr("drivecomm.server.http.serving._FIRST_REQUEST_S", 0.1)
    with served(LocalDoor(tmp_path / "hall.sock"), plant), Client(tmp_path / "hall.sock").connect() as connected:
        assert connected.recv(1) == b""


def test_readyz_reports_a_line_that_is_not_open(local, plant):
    assert local.get("/readyz").content == b"ready\n"
    plant.line_states = [plant.line_states[0].__class__(name="main", port="/dev/ttyUSB0", up=False)]
    found = local.get("/readyz")
    assert (found.status, found.content) == (503, b"1 of 1 lines are not open\n")
    assert local.get("/healthz").status == 200


def test_page_is_revalidated_and_sent_once(local):
    found = local.get("/")
    assert found.headers["Content-Type"].startswith("text/html")
    assert found.headers["Cache-Control"] == "no-cache"
    again = local.get("/", **{"If-None-Match": found.headers["ETag"]})
    assert (again.status, again.content) == (304, b"")
    assert local.get("/page/index.html").content == found.content


def operations(described):
    return {(method.upper(), path) for path, each in described["paths"].items() for method in each}


def test_openapi_of_a_network_door_matches_its_operations(door):
    described = Client(door).get("/openapi.json").content
    assert described == parsed(json_text(description(local=False)))
    assert operations(described) == {each for each in operations(description(local=True)) if "/lines/" not in each[1]}
    for path in ("{verb}", "keep"):
        verb = described["paths"][f"/api/v1/drives/{{name}}/{path}"]["post"]["requestBody"]
        schema = described["components"]["schemas"][
            verb["content"]["application/json"]["schema"]["$ref"].split("/")[-1]
        ]
        assert verb["required"] is True
        assert schema["required"] == ["id"]
        assert schema["additionalProperties"] is False
        assert not {"arm", "options", "by", "start"} & set(schema["properties"])
    assert described["components"]["schemas"]["CarryOut"]["properties"]["arguments"]["additionalProperties"] is True
    # A generated client would send a default value, which needs more rights than its user may have.
    keep = described["components"]["schemas"]["Keep"]
    assert not [name for name, field in keep["properties"].items() if "default" in field]


@pytest.mark.parametrize(
    ("path", "allowed"),
    [
        ("/api/v1/drives/pump/lease", "DELETE, OPTIONS, POST, PUT"),
        ("/api/v1/plant", "GET, HEAD, OPTIONS"),
        ("/api/v1/stream", "GET, OPTIONS"),
        ("/api/v1/drives/pump/read", "OPTIONS, POST"),
        ("/healthz", "GET, HEAD, OPTIONS"),
    ],
)
def test_allow_header_names_all_methods_of_a_path(local, path, allowed):
    assert (local.ask("OPTIONS", path).status, local.ask("OPTIONS", path).headers["Allow"]) == (204, allowed)
    refused = local.ask("PATCH", path)
    assert (refused.status, refused.headers["Allow"]) == (405, allowed)
    assert local.ask("OPTIONS", "/api/v2").status == 404


@pytest.mark.parametrize("every", ["0.05", "5e-2", "3600", "0.050000"])
def test_stream_interval_accepts_any_number_format(local, every):
    with local.stream(f"?every={every}") as stream:
        assert stream.next().name == "hello"


@pytest.mark.parametrize("seconds", ["0.1", "30", "30.0", "1e-1"])
def test_lease_accepts_its_shortest_and_longest_time(local, seconds):
    assert local.ask("POST", "/api/v1/drives/fan/lease", raw=f'{{"seconds": {seconds}}}'.encode()).status == 200


@pytest.mark.parametrize("seconds", ["0.09999999999999999", "30.00000000000001", "0", "1e400", f"0.{'0' * 5000}1"])
def test_lease_time_beyond_the_limits_is_refused_with_its_text(local, seconds):
    refused = local.ask("POST", "/api/v1/drives/fan/lease", raw=f'{{"seconds": {seconds}}}'.encode())
    assert refused.status == 422
    assert "Decimal" not in refused.content["error"]["text"]
    assert len(refused.content["error"]["text"]) < 150


def test_openapi_of_the_local_door_matches_its_description(local):
    described = local.get("/openapi.json").content
    assert described == parsed(json_text(description(local=True)))
    assert described["openapi"] == "3.1.0"
    schema = described["components"]["schemas"]["TakeLease"]
    assert schema["required"] == ["seconds"]
    assert (schema["properties"]["seconds"]["minimum"], schema["properties"]["seconds"]["maximum"]) == (
        Decimal("0.1"),
        30,
    )
    assert "required" not in described["components"]["schemas"]["CarryOut"]
    assert described["paths"]["/api/v1/login"]["post"]["security"] == []
    assert described["security"] == [{"token": []}]
    names = [each["operationId"] for path in described["paths"].values() for each in path.values()]
    assert len(set(names)) == len(names)


ANSWERS = [
    ("GET", "plant"), ("GET", "drives"), ("GET", "drives/pump"), ("GET", "values"), ("GET", "events"),
    ("GET", "leases"), ("POST", "drives/pump/lease"), ("POST", "drives/pump/read"), ("POST", "stop"),
    ("GET", "history?drive=pump&name=output_frequency"), ("GET", "alarms"),
]  # fmt: skip


@pytest.mark.parametrize(("method", "path"), ANSWERS)
def test_responses_match_the_openapi_description(local, plant, method, path):
    plant.history = FakeHistory()
    local.post("/api/v1/drives/fan/lease", seconds=5)
    plant.change(value("fan", quality="bad"), events=[plant.event(1)])
    described = description(local=True)
    operation = described["paths"][
        f"/api/v1/{path}".partition("?")[0].replace("pump", "{name}").replace("read", "{verb}")
    ]
    schema = operation[method.lower()]["responses"]["200"]["content"]["application/json"]["schema"]
    found = local.ask(method, f"/api/v1/{path}", {"seconds": 5} if path.endswith("lease") else None)
    assert found.status == 200
    assert found.content
    fits(found.content, schema, described["components"]["schemas"])


def test_problems_match_the_openapi_description(local, plant):
    schemas = description(local=True)["components"]["schemas"]
    fits(local.get("/api/v1/drives/pumq").content, schemas["Problem"], schemas)
    plant.session = "green-yak-3"
    refused = local.post("/api/v1/drives/pump/start", id="2", session="blue-otter-17")
    assert refused.content["outcome"] == "refused"
    fits(refused.content, schemas["Problem"], schemas)


def fits(content, schema, schemas):
    """Check content against its schema, and that it has no other fields."""
    if "$ref" in schema:
        return fits(content, schemas[schema["$ref"].rpartition("/")[2]], schemas)
    if "anyOf" in schema:
        errors = []
        for each in schema["anyOf"]:
            try:
                return fits(content, each, schemas)
            except AssertionError as error:
                errors.append(error)
        raise errors[0]
    if "enum" in schema:
        assert content in schema["enum"]
    kinds = {
        "string": str, "integer": int, "boolean": bool, "null": type(None), "array": list, "object": dict,
        "number": (int, float, Decimal),
    }  # fmt: skip
    if "type" in schema:
        assert isinstance(content, kinds[schema["type"]])
    for each in content if "items" in schema and "prefixItems" not in schema["items"] else ():
        fits(each, schema["items"], schemas)
    if "properties" in schema:
        assert set(schema["required"]) <= set(content) <= set(schema["properties"])
        for key, each in content.items():
            fits(each, schema["properties"][key], schemas)
    return None


def test_drive_name_may_have_slashes_and_spaces():
    plant = FakePlant(["hall 2/pump", "fan"])
    with served(door := http_door(table(listen="127.0.0.1:0")), plant):
        assert Client(door).get("/api/v1/drives/hall%202%2Fpump").content["name"] == "hall 2/pump"


def test_door_closes_while_it_is_opening(plant):
    door = HttpDoor(table(listen="127.0.0.1:0"))
    began = time.monotonic()
    with served(door, plant) as running:
        running.end()
    assert time.monotonic() - began < 5


def test_users_are_authenticated_by_their_tokens():
    with served(door := http_door(table(listen="127.0.0.1:0")), FakePlant(users=FakeUsers())):
        assert Client(door).get("/api/v1/plant").status == 401
        assert Client(door, "annaanna").get("/api/v1/plant").content["you"]["role"] == "view"
