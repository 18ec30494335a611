"""Records of servers: found by plant and by port, stale records are ignored, one server per plant."""

import errno
import json
import os
import signal
import subprocess
import sys
from types import SimpleNamespace

import pytest

from drivecomm.client import Registration, identity, local_socket, register, server_of_plant, server_of_port, servers
from drivecomm.client.locked_records import HeldRecord
from drivecomm.client.registration import rewrite_record
from drivecomm.errors import UsageError

pytestmark = pytest.mark.skipif(os.name != "posix", reason="flock is POSIX")

HOLD = """
import sys, time
from drivecomm.client import Registration, register
with register(Registration(plant=sys.argv[1], lines={"hall": "/dev/ttyUSB7"}, started_s=time.time())):
    print("there", flush=True)
    time.sleep(60)
"""


@pytest.fixture
def file(tmp_path):
    """Create an empty plant file; only its name matters."""
    (tmp_path / "hall.toml").write_text("")
    return tmp_path / "hall.toml"


@pytest.fixture
def elsewhere(file):
    """Register a server of the plant in a process of its own; yield the process."""
    with subprocess.Popen([sys.executable, "-c", HOLD, str(file)], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "there\n"
        yield process
        process.kill()


def record_of(file, folder):
    return folder / f"{identity(file)}.server.json"


def test_server_refuses_to_start_if_its_record_cannot_be_written(file, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(HeldRecord, "write", full)
    told = r"hall.toml cannot be served: commands would not find the server.*\(No space left on device\); make room"
    with pytest.raises(UsageError, match=told), register(Registration(plant=str(file))):
        pass
    monkeypatch.undo()
    with register(Registration(plant=str(file))):
        assert server_of_plant(file) is not None


def test_server_is_found_while_it_is_registered(file):
    about = Registration(plant=str(file), name="hall 2", socket="/x.sock", lines={"hall": "/dev/ttyUSB7"}, history="h")
    assert server_of_plant(file) is None
    with register(about) as record:
        assert record.stat().st_mode & 0o777 == 0o600
        assert server_of_plant(file) == about
        assert [*servers()] == [about]
    assert server_of_plant(file) is None
    assert not record.exists()


def test_server_of_a_plant_is_found_by_any_name_of_its_file(file, tmp_path, monkeypatch):
    (tmp_path / "link.toml").symlink_to(file)
    monkeypatch.chdir(tmp_path)
    with register(Registration(plant=str(file))):
        assert server_of_plant(tmp_path / "link.toml")
        assert server_of_plant("hall.toml")
        assert server_of_plant("other.toml") is None
    assert identity(tmp_path / "link.toml") == identity(file)
    assert local_socket(file).name.endswith(f"{identity(file)[-8:]}.sock")


def test_line_is_found_by_any_name_of_its_port(file, tmp_path):
    (tmp_path / "port").symlink_to("/dev/null")
    lines = {"hall": "/dev/null", "yard": "socket://localhost:4001"}
    with register(Registration(plant=str(file), lines=lines)):
        assert server_of_port(str(tmp_path / "port"))[1] == "hall"
        assert server_of_port("rfc2217://127.0.0.1:4001")[1] == "yard"
        assert server_of_port("/dev/zero") is None


def test_second_server_of_a_plant_is_refused_and_names_the_first(file, elsewhere):
    already = rf"hall.toml has a server already \(pid {elsewhere.pid}, since 2\d\d\d-"
    with pytest.raises(UsageError, match=already), register(Registration(plant=str(file))):
        pass
    assert server_of_plant(file).pid == elsewhere.pid


def test_record_of_a_killed_server_is_ignored(file, elsewhere, runtime_folder):
    assert server_of_port("/dev/ttyUSB7")[0].pid == elsewhere.pid
    elsewhere.send_signal(signal.SIGKILL)
    elsewhere.wait()
    assert record_of(file, runtime_folder).exists()
    assert server_of_plant(file) is None
    assert server_of_port("/dev/ttyUSB7") is None
    with register(Registration(plant=str(file), name="again")):
        assert server_of_plant(file).name == "again"


def test_record_without_a_holder_is_ignored(file, runtime_folder):
    runtime_folder.mkdir(mode=0o700)
    record_of(file, runtime_folder).write_text(json.dumps({"plant": str(file), "pid": os.getpid(), "lines": {}}))
    assert server_of_plant(file) is None


@pytest.mark.parametrize("content", ["", "{", "[]", '{"plant": 1}', '{"pid": "x", "plant": "y"}'])
def test_malformed_record_is_ignored(file, content):
    with register(Registration(plant=str(file))) as record:
        record.write_text(content)
        assert server_of_plant(file) is None
        assert [*servers()] == []


def test_unknown_keys_of_a_record_are_ignored(file):
    with register(Registration(plant=str(file))) as record:
        record.write_text(json.dumps({**json.loads(record.read_text()), "colour": "blue"}))
        assert server_of_plant(file).plant == str(file)


def test_rewritten_record_replaces_the_lines(file):
    with register(Registration(plant=str(file), lines={"hall": "/dev/ttyUSB0", "yard": "/dev/ttyUSB1"})) as record:
        rewrite_record(record, Registration(plant=str(file), lines={"hall": "/dev/ttyUSB7"}))
        assert server_of_plant(file).lines == {"hall": "/dev/ttyUSB7"}


def test_folder_in_which_others_can_write_is_not_trusted(file, runtime_folder):
    with register(Registration(plant=str(file))):
        runtime_folder.chmod(0o777)
        assert server_of_plant(file) is None
        with (
            pytest.raises(PermissionError, match="not private to this user"),
            register(Registration(plant=str(file))),
        ):
            pass
        runtime_folder.chmod(0o700)


def test_service_uses_its_own_runtime_folder(file, tmp_path, monkeypatch):
    (tmp_path / "service").mkdir(mode=0o700)
    monkeypatch.setenv("RUNTIME_DIRECTORY", f"{tmp_path / 'service'}:/else")
    assert local_socket(file).parent == tmp_path / "service"
    with register(Registration(plant=str(file))) as record:
        assert record.parent == tmp_path / "service"
        assert server_of_plant(file)


def test_text_of_a_registration_hides_the_token(file):
    assert "secret" not in repr(Registration(plant=str(file), token="secret"))
    assert str(Registration(plant="hall.toml", pid=7)) == "drivecomm serve hall.toml (pid 7)"


def test_socket_lies_elsewhere_if_the_folder_has_a_long_path(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / ("long" * 30)))
    monkeypatch.delenv("RUNTIME_DIRECTORY", raising=False)
    socket = local_socket(tmp_path / "plant.toml")
    assert len(str(socket)) <= 100
    assert socket.parent.stat().st_mode & 0o077 == 0


def test_record_is_locked_by_a_byte_where_flock_is_missing(file, monkeypatch):
    fcntl = pytest.importorskip("fcntl")

    def locking(descriptor, mode, _count):
        assert os.lseek(descriptor, 0, os.SEEK_CUR) > 1 << 20
        fcntl.flock(descriptor, mode)

    windows = SimpleNamespace(LK_NBLCK=fcntl.LOCK_EX | fcntl.LOCK_NB, LK_UNLCK=fcntl.LOCK_UN, locking=locking)
    monkeypatch.setitem(sys.modules, "msvcrt", windows)
    monkeypatch.setitem(sys.modules, "fcntl", None)
    about = Registration(plant=str(file), port=4711, token="secret")
    with register(about) as record:
        assert server_of_plant(file) == about
        with pytest.raises(UsageError, match="has a server already"), register(about):
            pass
        left = record.read_bytes()
    assert server_of_plant(file) is None
    # A killed server leaves its record behind.
    record.write_bytes(left)
    assert server_of_plant(file) is None
    with register(about):
        assert server_of_plant(file) == about
