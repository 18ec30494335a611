"""Stops through servers: a server is found by a drive's name or by its port, whatever the plant file holds."""

import asyncio
import os
import shutil
import tempfile
from pathlib import Path

import pytest
from fake_server import FakeServer, serving
from running_server import running_server
from serving_threads import served_in_thread

import drivecomm
from drivecomm.cli import main
from drivecomm.client import Registration, error_content, register, server_of_plant
from drivecomm.errors import LinkDownError, PortError, UsageError
from drivecomm.plant import read_plant
from drivecomm.server import Serving
from drivecomm.virtual import PlantServer, VirtualPlant

pytestmark = pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals are POSIX")

PLANT = """
format = 1

[[line]]
name = "hall"
listen = "pty:{folder}/hall"
paced = false

[[drive]]
name = "pump"
drive = "vabus:1"
groups = ["wet"]
options = {{ model = "agile", reply_timeout_s = 1 }}
armed = true
reply_delay_s = 0.0

[[drive]]
name = "fan"
drive = "danfoss-fc:3"
groups = ["air", "wet"]
options = {{ model = "fc300", reply_timeout_s = 1 }}
armed = true
reply_delay_s = 0.0
"""


class Place:
    """Plant with running motors. file: its plant file. another: a plant file with a link to the same port."""

    def __init__(self, folder, plant):
        self.folder = folder
        self.file = folder / "hall.toml"
        self.another = folder / "another.toml"
        self._plant = plant

    def motors(self):
        return {name: each.motor.running for name, each in self._plant.drives.items()}


@pytest.fixture
def place(request, tmp_path, monkeypatch):
    # The path of a Unix socket has at most about a hundred characters.
    runtime = Path(tempfile.mkdtemp(prefix="dc"))
    request.addfinalizer(lambda: shutil.rmtree(runtime, ignore_errors=True))  # noqa: PT021 - runs even if a later step fails
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(runtime))
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    for name in ("DRIVECOMM_PORT", "DRIVECOMM_PLANT", "RUNTIME_DIRECTORY"):
        monkeypatch.delenv(name, raising=False)
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    file = tmp_path / "hall.toml"
    file.write_text(PLANT.format(folder=tmp_path), encoding="utf-8")
    plant = VirtualPlant(read_plant(file))
    with served_in_thread(PlantServer(plant)):
        (tmp_path / "link").symlink_to(tmp_path / "hall")
        another = PLANT.format(folder=tmp_path).replace(f'listen = "pty:{tmp_path}/hall"', f'port = "{tmp_path}/link"')
        (tmp_path / "another.toml").write_text(another, encoding="utf-8")
        with drivecomm.open_plant(file, own_ports=True) as opened:
            for name in ("pump", "fan"):
                opened.drive(name).set_reference(percent=30)
                opened.drive(name).start()
        one = Place(tmp_path, plant)
        assert one.motors() == {"pump": True, "fan": True}
        yield one


def damaged(place):
    place.file.write_text("][ half saved")


def removed(place):
    place.file.unlink()


def closed(place):
    place.file.unlink()
    place.file.mkdir()


@pytest.mark.parametrize("spoil", [damaged, removed, closed])
@pytest.mark.parametrize(
    "words",
    [("fan",), ("danfoss-fc:3",), ("fan", "pump"), ("--all",), ("air",), ("air", "danfoss-fc:3"), ("fan", "wet")],
    ids=" ".join,
)
def test_stop_needs_no_plant_file_while_its_server_runs(place, capsys, spoil, words):
    with running_server(place.file):
        spoil(place)
        assert main(["stop", *words, "--plant", str(place.file), "--how", "coast"]) == 0
        said = capsys.readouterr()
        assert place.motors() == {"fan": False, "pump": not {"pump", "--all", "wet"} & {*words}}
        assert said.out.count("fan") == 1
        assert said.err.count(str(place.file)) == 1


def test_stop_of_a_protocol_needs_no_plant_file_while_its_server_runs(place):
    with running_server(place.file):
        damaged(place)
        assert main(["stop", "danfoss-fc:*", "--plant", str(place.file), "--how", "coast"]) == 0
        assert place.motors() == {"fan": False, "pump": True}


@pytest.mark.parametrize("words", [("fan",), ("fan", "pump"), ("air",), ("air", "wet")], ids=" ".join)
def test_stop_without_any_plant_file_finds_the_server_that_knows_the_drive(place, words):
    with running_server(place.file):
        assert main(["stop", *words, "--how", "coast"]) == 0
        assert place.motors()["fan"] is False


def test_stop_of_a_name_known_to_two_servers_is_refused(place, tmp_path, capsys):
    other = tmp_path / "other.toml"
    line = '[[line]]\nname = "yard"\nport = "/dev/ttyUSB99"\n'
    other.write_text(f'format = 1\n{line}[[drive]]\nname = "fan"\ndrive = "fuji:1"\n')
    with serving(place.file), serving(other):
        assert main(["stop", "fan"]) == 2
        said = capsys.readouterr().err
        assert f"{place.file}: fan" in said
        assert f"{other}: fan" in said
        assert main(["stop", "fan", "--plant", str(place.file), "--how", "coast"]) == 0
    assert place.motors() == {"fan": False, "pump": True}


def test_stop_of_a_group_known_to_two_servers_is_refused(place, tmp_path, capsys):
    other = tmp_path / "other.toml"
    line = '[[line]]\nname = "yard"\nport = "/dev/ttyUSB99"\n'
    other.write_text(f'format = 1\n{line}[[drive]]\nname = "air"\ndrive = "fuji:1"\n')
    with serving(place.file), serving(other):
        assert main(["stop", "air"]) == 2
        said = capsys.readouterr().err
        assert f"{place.file}: group air" in said
        assert f"{other}: air" in said
        assert place.motors()["fan"] is True
        assert main(["stop", "air", "--plant", str(place.file), "--how", "coast"]) == 0
    assert place.motors() == {"fan": False, "pump": True}


def test_group_of_the_plant_file_outranks_a_drive_of_another_server(place, tmp_path, monkeypatch):
    other = tmp_path / "other.toml"
    line = '[[line]]\nname = "yard"\nport = "/dev/ttyUSB99"\n'
    other.write_text(f'format = 1\n{line}[[drive]]\nname = "air"\ndrive = "fuji:1"\n')
    monkeypatch.setenv("DRIVECOMM_PLANT", str(place.file))
    with serving(other):
        assert main(["stop", "air", "--how", "coast"]) == 0
    assert place.motors() == {"fan": False, "pump": True}


def test_damaged_group_is_stopped_by_file_and_server_and_exits_with_5(place, capsys):
    with running_server(place.file):
        # The fan can no longer be read from the file, and only the server knows that it belongs to the group "wet".
        place.file.write_text(place.file.read_text().replace('"danfoss-fc:3"', '"danfoss-fc'))
        assert main(["stop", "wet", "--plant", str(place.file), "--how", "coast"]) == 5
        said = capsys.readouterr()
        assert place.motors() == {"fan": False, "pump": False}
        assert said.out.count("confirmed") == 2
        assert "drive 2 (fan) cannot be read, so it is not stopped by itself" in said.err
        assert "the group 'wet' may have more drives" in said.err


def test_damaged_group_is_not_extended_by_a_group_of_another_plant(place, tmp_path, monkeypatch):
    other = tmp_path / "other.toml"
    line = '[[line]]\nname = "yard"\nport = "/dev/ttyUSB99"\n'
    other.write_text(f'format = 1\n{line}[[drive]]\nname = "mill"\ndrive = "fuji:1"\ngroups = ["air"]\n')
    place.file.write_text(place.file.read_text() + "\nnonsense = 1\n")
    monkeypatch.setenv("DRIVECOMM_PLANT", str(place.file))
    asked = []
    monkeypatch.setattr(FakeServer, "command", lambda *args: asked.append(args))
    with serving(other):
        assert main(["stop", "air", "--how", "coast"]) == 5
    assert asked == []
    assert place.motors() == {"fan": False, "pump": True}


def test_group_of_another_plant_exits_with_5_if_the_plant_file_is_unreadable(place, tmp_path, monkeypatch, capsys):
    torn = tmp_path / "torn.toml"
    torn.write_text("][ half saved")
    monkeypatch.setenv("DRIVECOMM_PLANT", str(torn))
    with running_server(place.file):
        assert main(["stop", "air", "--how", "coast"]) == 5
    assert "the group 'air' may have more drives" in capsys.readouterr().err
    assert place.motors() == {"fan": False, "pump": True}


def test_stop_of_an_unknown_name_is_refused(place, capsys):
    with running_server(place.file):
        assert main(["stop", "mill", "--plant", str(place.file)]) == 2
        assert "mill" in capsys.readouterr().err


@pytest.mark.parametrize("words", [("fan",), ("fan", "pump"), ("--all",), ("danfoss-fc:*",)], ids=" ".join)
def test_stop_by_another_plant_file_goes_through_the_server_of_the_port(place, capsys, words):
    with running_server(place.file):
        assert main(["stop", *words, "--plant", str(place.another), "--how", "coast"]) == 0
        assert place.motors()["fan"] is False
        assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ("/dev/null", "/dev/null"),
        ("socket://127.0.0.1:4001", "rfc2217://localhost:4001"),
        ("socket://[::1]:4001", "socket://127.0.0.1:4001"),
        ("socket://[::ffff:127.0.0.1]:4001", "rfc2217://LOCALHOST.:4001?timeout=1"),
        ("socket://MOXA.example:4001", "socket://moxa.example:4001"),
    ],
)
def test_second_server_of_a_port_is_refused_under_any_name_of_the_port(place, first, second):
    one = Registration(plant=str(place.file), lines={"hall": first})
    two = Registration(plant=str(place.another), lines={"yard": "/dev/ttyUSB98", "again": second})
    refused = rf"line again is at .*, which drivecomm serve {place.file} \(pid {os.getpid()}\) has"
    with register(one), pytest.raises(UsageError, match=refused), register(two):
        pass
    with register(two):
        pass


def test_second_server_of_a_port_does_not_start(place):
    refused = r"which drivecomm serve .*hall.toml .* has"
    with running_server(place.file):
        with pytest.raises(UsageError, match=refused):
            asyncio.run(Serving(place.another).run(print))
        assert server_of_plant(place.another) is None


@pytest.mark.skipif(os.name == "posix" and os.getuid() != 0, reason="only root can make a node of a device")
def test_two_nodes_of_one_device_are_one_port(tmp_path):
    node = tmp_path / "node"
    try:
        os.mknod(node, 0o600 | 0o020000, Path("/dev/null").stat().st_rdev)
    except PermissionError:
        pytest.skip("no nodes can be made here")
    assert drivecomm.transport.same_port(str(node), "/dev/null")
    assert not drivecomm.transport.same_port(str(node), "/dev/zero")


@pytest.mark.parametrize("error", [PortError("port is in use"), LinkDownError("the line is down")])
@pytest.mark.parametrize("words", [("fan",), ("--all",)], ids=" ".join)
def test_stop_opens_the_port_if_its_server_does_not_hold_it(place, monkeypatch, words, error):
    """The server of a port does not hold it while the line is down; the stop then opens the port itself."""

    def command(*_):
        return {"id": "", "outcome": "open", "result": None, "error": error_content(error)}

    with serving(place.file):
        monkeypatch.setattr(FakeServer, "line_drive", lambda *_: None)
        monkeypatch.setattr(FakeServer, "command", command)
        assert main(["stop", *words, "--plant", str(place.file), "--how", "coast"]) == 0
    assert place.motors()["fan"] is False
