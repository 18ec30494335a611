"""Protection against strangers; docs/reference/security-checklist.md lists these tests point by point."""

import logging
import re
import socket
import time
from pathlib import Path

import pytest
from fake_plant import Client, FakePlant, served

from drivecomm.server.http import HttpDoor, description, guard
from drivecomm.tomlfile import TomlTable

ROOT = Path(__file__).resolve().parents[3]
START = "/api/v1/drives/pump/start"
HEADERS = {
    "Content-Security-Policy": "default-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'self'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "X-Frame-Options": "DENY",
}


def in_words(text):
    """Return a test id of letters, digits and hyphens, which any shell accepts."""
    return "-".join(re.findall(r"[A-Za-z0-9]+", str(text)))[:40] or "empty"


DESCRIBED = description(local=True)["paths"]
OPERATIONS = [(method.upper(), path) for path, methods in DESCRIBED.items() for method in methods]


def routed(method, path):
    filled = path.format(name="pump", verb="read", line="main", drive="vabus:9", id="pump-fault")
    needed = [each for each in DESCRIBED[path][method.lower()].get("parameters", ()) if each["required"]]
    query = "&".join(f"{each['name']}=1" for each in needed if each["in"] == "query")
    return f"{filled}?{query}"


def asked(client, method, path):
    return client.ask(method, path, None if method == "GET" else {"id": "1"})


@pytest.mark.parametrize(
    ("method", "path"), [each for each in OPERATIONS if not each[1].endswith("login")], ids=in_words
)
@pytest.mark.parametrize("token", ["", "wrong", "annaotto"])
def test_missing_or_wrong_token_is_refused_on_every_path(door, plant, method, path, token):
    found = asked(Client(door, token), method, routed(method, path))
    assert found.status == 401
    assert found.content["error"]["kind"] == "NotAllowedError"
    assert found.headers["WWW-Authenticate"] == "Bearer"
    assert [plant.commands, plant.stops, plant.held] == [[], [], {}]


def test_basic_authorization_is_refused(door):
    assert Client(door, Authorization="Basic YW5uYTphbm5h").get("/api/v1/plant").status == 401


def test_starting_needs_the_role_operate(door, plant):
    refused = Client(door, "annaanna").post(START, id="1").content
    assert (refused["outcome"], refused["error"]["kind"]) == ("refused", "NotAllowedError")
    assert not plant.acted
    assert Client(door, "ottootto").post(START, id="1").content["outcome"] == "done"


def test_anonymous_callers_may_only_view():
    plant = FakePlant()
    door = HttpDoor(TomlTable({"kind": "http", "listen": "127.0.0.1:0"}, "hall.toml"))
    with served(door, plant):
        assert Client(door).get("/api/v1/plant").content["you"]["role"] == "view"
        assert Client(door, "guessed").get("/api/v1/plant").status == 401
        for path in (
            "drives/pump/stop",
            "drives/pump/read",
            "stop",
            "drives/pump/lease",
            "alarms/pump-fault/acknowledge",
        ):
            assert Client(door).post(f"/api/v1/{path}", id="1").status == 401
    assert [plant.commands, plant.stops] == [[], []]


@pytest.mark.parametrize("field", ["arm", "options"])
def test_network_door_refuses_operations_of_the_local_door(door, local, plant, field):
    given = {"arm": True, "options": {"model": "agile"}}[field]
    assert Client(door, "carlcarl").post(START, id="1", **{field: given}).status == 403
    assert Client(door, "carlcarl").post("/api/v1/lines/main/drives/vabus:9/stop", id="1").status == 403
    assert Client(door, "carlcarl").post("/api/v1/lines/main/scan").status == 403
    assert not plant.commands
    assert local.post(START, **{field: given}).content["outcome"] == "done"
    assert getattr(plant.commands[0][1], field) == given


@pytest.mark.parametrize("method", ["GET", "POST"])
@pytest.mark.parametrize(
    "origin", ["http://evil.example", "null", "http://localhost:1", "https://localhost.evil.example"], ids=in_words
)
def test_request_with_a_foreign_origin_is_refused(door, local, plant, method, origin):
    for client in (Client(door, "ottootto"), local):
        path = START if method == "POST" else "/api/v1/plant"
        found = client.ask(method, path, {"id": "1"} if method == "POST" else None, Origin=origin)
        assert found.status == 403
        assert "Access-Control-Allow-Origin" not in found.headers
    assert not plant.commands


@pytest.mark.parametrize(
    "twice",
    [
        "Host: localhost",
        "Origin: http://localhost",
        "Authorization: Bearer ottootto",
        "Content-Type: application/json",
        "Content-Length: 9",
        "Transfer-Encoding: chunked",
    ],
    ids=in_words,
)
def test_request_with_a_repeated_header_is_refused(door, local, plant, twice):
    lines = [
        "Host: localhost",
        "Authorization: Bearer ottootto",
        "Content-Type: application/json",
        "Content-Length: 10",
    ]
    name = twice.partition(":")[0]
    lines += [twice] if name in "Host Authorization Content-Type Content-Length Transfer-Encoding" else [twice, twice]
    for client in (Client(door), local):
        with client.connect() as connected:
            connected.sendall("\r\n".join([f"POST {START} HTTP/1.1", *lines, "", '{"id":"1"}']).encode())
            assert connected.recv(1 << 16).startswith(b"HTTP/1.1 400")
    assert not plant.commands


def test_request_from_the_page_of_the_server_is_accepted(door):
    host = f"127.0.0.1:{door.port}"
    client = Client(door, "ottootto")
    assert client.ask("POST", START, {"id": "1"}, Host=host, Origin=f"http://{host}").status == 200


@pytest.mark.parametrize(
    "host",
    [
        "evil.example",
        "evil.example:8080",
        "127.0.0.1.evil.example",
        "",
        "a b",
        "[::1",
        "evil@127.0.0.1",
        "a:b@localhost",
        "127.0.0.1/x",
        "127.0.0.1?x",
        "localhost#x",
        "[127.0.0.1]x",
        "localhost:x",
    ],
    ids=in_words,
)
def test_request_for_a_foreign_host_name_is_refused(door, plant, host):
    found = Client(door, "ottootto").ask("POST", START, {"id": "1"}, Host=host)
    assert found.status in (400, 403)
    assert not plant.commands


@pytest.mark.parametrize(
    "host", ["127.0.0.1", "localhost:8080", "[::1]:80", "192.168.3.4", socket.gethostname()], ids=in_words
)
def test_request_for_an_address_or_own_host_name_is_accepted(door, host):
    assert Client(door, "annaanna").get("/api/v1/plant", Host=host).status == 200


def test_request_for_a_host_name_of_the_plant_file_is_accepted(plant):
    door = HttpDoor(TomlTable({"kind": "http", "listen": "127.0.0.1:0", "names": ["Drives.example"]}, "hall.toml"))
    with served(door, plant):
        assert Client(door, "annaanna").get("/api/v1/plant", Host="drives.example").status == 200


def test_responses_have_no_cors_headers(door):
    found = Client(door, "annaanna").ask("OPTIONS", "/api/v1/plant", **{"Access-Control-Request-Method": "POST"})
    assert found.status == 204
    assert not [name for name in found.headers if name.lower().startswith("access-control")]


@pytest.mark.parametrize("method", ["PUT", "DELETE", "PATCH", "TRACE", "POST"])
def test_unsupported_method_is_refused(door, method):
    found = Client(door, "carlcarl").ask(method, "/api/v1/plant")
    assert found.status == 405
    assert found.content["error"]["text"] == f"{method} is not supported at /api/v1/plant"


@pytest.mark.parametrize(
    "path", ["/", "/api/v1/plant", "/nothing", "/healthz", "/metrics", "/openapi.json"], ids=in_words
)
def test_every_response_has_security_headers(door, path):
    found = Client(door, "annaanna").get(path).headers
    assert {name: found[name] for name in HEADERS} == HEADERS
    assert found["Cache-Control"] in ("no-store", "no-cache")
    assert "Server" not in found


def test_released_lease_starts_no_motor(door, plant):
    otto = Client(door, "ottootto")
    lease = otto.post("/api/v1/drives/pump/lease", seconds=5).content
    assert otto.ask("DELETE", "/api/v1/drives/pump/lease", {"key": lease["key"]}).status == 200
    found = otto.post(START, id="1", lease=lease["key"]).content
    assert (found["outcome"], found["error"]["kind"]) == ("refused", "LeaseError")
    assert not plant.acted


def test_lease_of_another_caller_is_neither_usable_nor_visible(door, local):
    first = local.post("/api/v1/drives/pump/lease", seconds=5).content
    otto = Client(door, "ottootto")
    found = otto.post("/api/v1/drives/pump/lease", seconds=5)
    assert (found.status, found.content["error"]["kind"]) == (409, "LeaseError")
    assert otto.ask("PUT", "/api/v1/drives/pump/lease", {"key": "guessed", "seconds": 5}).status == 409
    for path in ("/api/v1/leases", "/api/v1/drives/pump", "/api/v1/drives"):
        assert first["key"] not in str(otto.get(path).content)
    assert otto.get("/api/v1/leases").content[0]["yours"] is False


@pytest.mark.parametrize(
    ("body", "text"),
    [
        (b'{"id": "1", "leese": "x"}', "unknown key 'leese'; did you mean 'lease'?"),
        (b'{"id": 1}', "invalid id = 1: it should be a valid string"),
        (b'{"id": 1.50}', "invalid id = 1.50: it should be a valid string"),
        (b'{"id": {"a": [true]}}', 'invalid id = {"a":[true]}: it should be a valid string'),
        (b'{"id": "1", "valid_s": 11}', "invalid valid_s = 11: it should be less than or equal to 10"),
        (b'{"id": "1", "valid_s": NaN}', "not JSON"),
        (b'{"id": "1", "valid_s": 1e999999}', "invalid valid_s = "),
        (b'{"id": "1", "issued_s": true}', "invalid issued_s = true"),
        (b'{"id": "1", "arguments": []}', "invalid arguments = []: it should be a valid object"),
        (b'["id"]', "not a JSON object"),
        (b"id=1", "not JSON"),
        (b"\xff\xfe", "not JSON"),
        (b"[" * 60_000, "not JSON"),
        (b'{"id": "%s"}' % (b"x" * 5000), "it should have at most 4096 characters"),
        (b'{"id": "1", "a%s": 1}' % (b"x" * 60_000), "unknown key"),
    ],
    ids=in_words,
)
def test_invalid_body_is_refused_and_sends_no_command(door, plant, body, text):
    found = Client(door, "ottootto").ask("POST", START, raw=body)
    assert found.status == (400 if text == "not JSON" else 422)
    assert text in found.content["error"]["text"]
    assert not plant.commands


@pytest.mark.parametrize(
    ("query", "text"),
    [
        ("?evry=1", "did you mean 'every'?"),
        ("?every=0", "it should be greater than or equal to 0.05"),
        ("?every=soon", "it should be a valid number"),
        ("?every=1&every=2", "twice"),
    ],
    ids=in_words,
)
def test_invalid_query_is_refused(door, query, text):
    found = Client(door, "annaanna").get(f"/api/v1/stream{query}")
    assert found.status == 422
    assert text in found.content["error"]["text"]


def test_body_beyond_the_limit_is_refused(door, plant):
    client = Client(door, "ottootto")
    found = client.ask("POST", START, raw=b'{"id": "1"}'.ljust(guard.LARGEST_BODY + 1))
    assert found.status == 413
    with client.connect() as connected:
        connected.sendall(
            b"POST /api/v1/drives/pump/start HTTP/1.1\r\nHost: localhost\r\nAuthorization: Bearer ottootto\r\n"
            b"Transfer-Encoding: chunked\r\n\r\n" + (b"1000\r\n" + b" " * 0x1000 + b"\r\n") * 17
        )
        assert b" 413 " in connected.recv(4096).splitlines()[0]
    assert not plant.commands


def test_missing_body_times_out(door, plant, monkeypatch):
    monkeypatch.setattr(guard, "BODY_TIMEOUT_S", 0.2)
    with Client(door).connect() as connected:
        connected.sendall(
            b"POST /api/v1/drives/pump/start HTTP/1.1\r\nHost: localhost\r\nAuthorization: Bearer ottootto\r\n"
            b"Content-Length: 100\r\n\r\n{"
        )
        assert b" 408 " in connected.recv(4096).splitlines()[0]
    assert not plant.commands


def test_endless_headers_are_refused(door):
    with Client(door).connect() as connected:
        connected.sendall(b"GET / HTTP/1.1\r\nHost: localhost\r\nX-Long: " + b"x" * 100_000)
        assert b" 400 " in connected.recv(4096).splitlines()[0]


def test_login_attempts_are_rate_limited(plant, door):
    client = Client(door)
    good = client.post("/api/v1/login", name="anna", password="anna's password")
    assert good.content["token"] == "annaanna"
    guesses = [client.post("/api/v1/login", name=f"user{number}", password="x") for number in range(8)]
    assert [each.status for each in guesses] == [401] * 5 + [429] * 3
    assert 0 < int(guesses[-1].headers["Retry-After"]) <= 61
    assert plant.users.asked == 6
    # A token still works during the limit, so that login attempts cannot block a stop.
    assert Client(door, "annaanna").post("/api/v1/stop").status == 200


@pytest.mark.parametrize(
    "path",
    [
        "/page/../door.py", "/page/%2e%2e/door.py", "/page/..%2fdoor.py", "/page//etc/passwd", "/page/%2fetc%2fpasswd",
        "/page/..%5cdoor.py", "/page/%00", "/page/index.html%00.js", "/page/" + "x" * 5000, "/page", "/page/",
        "/../../etc/passwd",
    ], ids=in_words)  # fmt: skip
def test_only_files_of_the_page_are_served(door, path):
    found = Client(door).get(path)
    assert found.status == 404
    assert found.content["error"]["kind"] == "UsageError"


def test_internal_error_reveals_no_details(door, caplog):
    with caplog.at_level(logging.ERROR):
        found = Client(door, "ottootto").post("/api/v1/drives/pump/break", id="1")
    assert found.status == 500
    assert found.content["error"]["text"] == "internal error of the server; see its log"
    until = time.monotonic() + 5
    while "secret inside" not in caplog.text and time.monotonic() < until:
        time.sleep(0.01)
    assert "secret inside" in caplog.text


def test_errors_quote_paths_as_json(door):
    found = Client(door, "annaanna").get("/api/v1/drives/%3Cscript%3E")
    assert found.status == 404
    assert found.headers["Content-Type"] == "application/problem+json"


def test_history_request_beyond_the_limits_is_refused(door, plant):
    anna = Client(door, "annaanna")
    assert anna.get("/api/v1/history?drive=pump&name=output_frequency&points=1000000").status == 422
    assert anna.get("/api/v1/history/events?limit=1000000").status == 422
    assert anna.get("/api/v1/events?limit=0").status == 422
    assert not plant.history.asked


def test_each_point_of_the_checklist_has_a_test():
    page = (ROOT / "docs" / "reference" / "security-checklist.md").read_text(encoding="utf-8")
    named = set(re.findall(r"`(test_\w+)`", page))
    here = {name for name in globals() if name.startswith("test_")}
    elsewhere = set(re.findall(r"^ *(?:async )?def (test_\w+)", "".join(
        each.read_text(encoding="utf-8") for each in (ROOT / "tests").rglob("test_*.py")
    ), re.MULTILINE))  # fmt: skip
    assert named <= elsewhere
    assert here - named <= {"test_each_point_of_the_checklist_has_a_test"}
    assert all(f"API{number}:2023" in page for number in range(1, 11))
