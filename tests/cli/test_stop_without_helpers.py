"""Stops on a real line: sent even if helper functions raise, and whatever files are in the way."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from serving_threads import served_in_thread

import drivecomm
from drivecomm.cli import main
from drivecomm.virtual import Server, parse_listen, virtual_drive

pytestmark = pytest.mark.skipif(os.name != "posix", reason="runtime folders of users are POSIX")

DRIVE = "danfoss-fc:3"
NOBODY = 65534

HELPERS = (
    # Holders of the port, and the folders in which they are looked up
    "drivecomm.cli.stop.stop_ways.unusable_reason",
    "drivecomm.cli.stop.stop_ways.servers_of_port",
    "drivecomm.cli.stop.stop_ways.holders_of_port",
    "drivecomm.client.runtime_folders.users_folder",
    "drivecomm.client.runtime_folders.folder_of_servers",
    "drivecomm.client.runtime_folders.is_private",
    "drivecomm.client.runtime_folders._owner_of_system_folder",
    "drivecomm.client.registration.folders_to_search",
    "drivecomm.client.registration.read_locked_record",
    "drivecomm.client.registration._records",
    "platformdirs.user_runtime_path",
    "os.path.realpath",
    "os.lstat",
    "os.listdir",
    # The plant file and its server
    "drivecomm.cli.drive_names.plant_file",
    "drivecomm.cli.stop.quick.plant_file",
    "drivecomm.cli.stop.one_drive.plant_file",
    "drivecomm.cli.stop.server_drives.server_of_plant",
    "drivecomm.cli.stop.server_drives.servers",
    "drivecomm.cli.stop.everything.server_of_plant",
    "drivecomm.cli.line_options.known_plant",
    "drivecomm.plant.read_plant",
    "drivecomm.plant.salvaged",
    "pathlib.Path.is_file",
    # Output
    "drivecomm.cli.stop.one_drive.tell",
    "drivecomm.cli.stop.safe_lookups.complain",
    "drivecomm.cli.stop.results.say",
    "drivecomm.cli.stop.results.complain",
    "drivecomm.cli.stop.whole_port.say",
    "drivecomm.cli.output.sentence",
)
"""Functions by the names under which a stop calls them; each test makes one of them raise."""


@pytest.fixture(scope="module")
def simulated():
    """Serve a drive on a TCP line of this machine; yield the drive and its port."""
    drive = virtual_drive("danfoss-fc", 3, model="fc300", reply_delay_s=0.0)
    with served_in_thread(Server([drive], parse_listen("tcp:127.0.0.1:0"))) as server:
        yield drive, "socket://" + server.address.partition("://")[2]


@pytest.fixture
def running(simulated, tmp_path, monkeypatch):
    """Start the drive; return it and its port. There is neither a login session nor a plant file."""
    drive, port = simulated
    monkeypatch.delenv("XDG_RUNTIME_DIR", raising=False)
    monkeypatch.delenv("RUNTIME_DIRECTORY", raising=False)
    monkeypatch.delenv("DRIVECOMM_PLANT", raising=False)
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", None)
    monkeypatch.chdir(tmp_path)
    with drivecomm.open_bus(port) as bus:
        fan = bus.drive("danfoss-fc", 3, model="fc300", reply_timeout_s=2)
        fan.stop("coast")
        fan.set_reference(percent=30)
        fan.start()
        assert drive.motor.running
    return drive, port


def raising(error):
    def fall(*_, **__):
        raise error

    return fall


@pytest.mark.parametrize("error", [OSError(5, "no luck"), PermissionError(13, "not yours"), ValueError("nonsense")])
@pytest.mark.parametrize("helper", HELPERS)
def test_stop_is_sent_although_a_helper_raises(running, monkeypatch, helper, error):
    drive, port = running
    with monkeypatch.context() as patch:
        patch.setattr(helper, raising(error))
        code = main(["stop", DRIVE, "--port", port, "--how", "coast"])
    assert (code, drive.motor.running) == (0, False)


@pytest.mark.parametrize("error", [OSError(5, "no luck"), ValueError("nonsense")])
@pytest.mark.parametrize("helper", HELPERS)
def test_stop_all_is_sent_although_a_helper_raises(running, monkeypatch, helper, error):
    drive, port = running
    with monkeypatch.context() as patch:
        patch.setattr(helper, raising(error))
        code = main(["stop", "--all", "--port", port, "--how", "coast"])
    assert (code, drive.motor.running) == (5, False)


PLANT = """
format = 1
[[line]]
name = "hall"
port = "{port}"
[[drive]]
name = "fan"
drive = "danfoss-fc:3"
line = "hall"
options = {{ model = "fc300" }}
"""
OF_THE_FILE = ("read_plant", "plant_file", "known_plant", "salvaged", "realpath")


@pytest.mark.parametrize("words", [("fan",), ("--all",), ("fan", "danfoss-fc:3"), ("danfoss-fc:*",)], ids=" ".join)
@pytest.mark.parametrize("helper", HELPERS)
def test_stop_by_a_plant_file_is_sent_although_a_helper_raises(running, monkeypatch, tmp_path, helper, words):
    drive, port = running
    if helper.rpartition(".")[2] in OF_THE_FILE:
        pytest.skip("without its file there is no such name")
    plant = tmp_path / "hall.toml"
    plant.write_text(PLANT.format(port=port), encoding="utf-8")
    with monkeypatch.context() as patch:
        patch.setattr(helper, raising(PermissionError(13, "not yours")))
        code = main(["stop", *words, "--plant", str(plant), "--how", "coast"])
    assert (code, drive.motor.running) == (0, False)


def test_stop_reports_a_failed_helper_once(running, monkeypatch, capsys):
    _, port = running
    monkeypatch.setattr("platformdirs.user_runtime_path", raising(PermissionError("taken by somebody")))
    assert main(["stop", DRIVE, "--port", port]) == 0
    said = capsys.readouterr()
    assert said.out == f"{DRIVE}  stop (ramp) commanded\n"
    assert said.err.count("\n") == 1
    assert "taken by somebody" in said.err


def a_file(path):
    path.write_text("")


def a_pipe(path):
    os.mkfifo(path)


def a_link(path):
    path.symlink_to("/")


def a_broken_link(path):
    path.symlink_to("/nowhere/at/all")


def an_open_folder(path):
    path.mkdir()
    path.chmod(0o777)


def a_closed_folder(path):
    path.mkdir(mode=0)


def a_strangers_folder(path):
    if os.getuid() != 0:
        pytest.skip("only root can give a folder to another user")
    path.mkdir(mode=0o700)
    os.chown(path, NOBODY, NOBODY)


OBSTACLES = (a_file, a_pipe, a_link, a_broken_link, an_open_folder, a_closed_folder, a_strangers_folder)


@pytest.mark.parametrize("inside", [False, True], ids=["runtime-UID", "its drivecomm"])
@pytest.mark.parametrize("words", [(DRIVE,), ("--all",)], ids=" ".join)
@pytest.mark.parametrize("obstacle", OBSTACLES)
def test_stop_is_sent_despite_foreign_files_in_the_temporary_folder(running, tmp_path, obstacle, words, inside):
    drive, port = running
    folder = tmp_path / f"runtime-{os.getuid()}"
    if inside:
        folder.mkdir(mode=0o700)
        folder /= "drivecomm"
    obstacle(folder)
    assert main(["stop", *words, "--port", port, "--how", "coast"]) == (5 if words == ("--all",) else 0)
    assert not drive.motor.running
    if not folder.is_symlink():
        folder.chmod(0o700)


@pytest.mark.parametrize("obstacle", [an_open_folder, a_strangers_folder, a_link])
def test_command_continues_despite_a_foreign_runtime_folder(running, tmp_path, capsys, obstacle):
    _, port = running
    obstacle(tmp_path / f"runtime-{os.getuid()}")
    assert main(["read", DRIVE, "3-03", "--port", port, "--timeout", "2"]) == 0
    assert "a stop from another program will not get through" in capsys.readouterr().err


def test_stop_is_sent_although_its_recording_cannot_be_opened(running, tmp_path, capsys):
    drive, port = running
    (tmp_path / "folder").mkdir()
    record = str(tmp_path / "folder" / "missing" / "x.jsonl")
    assert main(["stop", DRIVE, "--port", port, "--how", "coast", "--record", record]) == 0
    assert not drive.motor.running
    assert "x.jsonl" in capsys.readouterr().err


IN_A_PROCESS = """
import sys
{before}
from drivecomm_command import main
sys.argv = ["drivecomm", *sys.argv[1:]]
sys.exit(main())
"""

BEGINNINGS = {
    "no home": "import os; os.environ.pop('HOME', None); os.environ['PATH'] = ''",
    "an odd locale": "import os; os.environ.update(LC_ALL='xx_YY.nonsense', LANG='xx', PYTHONIOENCODING='ascii')",
    "no streams": "import os; [os.close(each) for each in (0, 1, 2)]; sys.stdout = sys.stderr = sys.stdin = None",
    "a guard that falls": "import drivecomm.cli.streams as s; s.guard = lambda: 1 / 0",
    "a beginning that falls": "import drivecomm.cli.streams as s; s.begin = lambda **_: 1 / 0",
    "an ending that falls": "import drivecomm.cli.streams as s; s.finished = lambda _: 1 / 0",
    "signals that cannot be": "import drivecomm.cli.signals as s; s.ignore = lambda: 1 / 0",
    "no platformdirs": "sys.modules['platformdirs'] = None",
    "a folder that has gone": "import os; os.mkdir('gone'); os.chdir('gone'); os.rmdir('../gone')",
}


@pytest.mark.soak
@pytest.mark.parametrize("before", BEGINNINGS.values(), ids=BEGINNINGS)
@pytest.mark.parametrize("words", [(DRIVE,), ("--all",)], ids=" ".join)
def test_process_in_a_bad_state_sends_its_stop(running, before, words):
    drive, port = running
    program = [sys.executable, "-c", IN_A_PROCESS.format(before=before), "stop", *words, "--port", port]
    done = subprocess.run([*program, "--how", "coast"], capture_output=True, check=False, timeout=60)
    assert not drive.motor.running
    assert done.returncode == (5 if words == ("--all",) else 0), done.stderr


@pytest.mark.soak
@pytest.mark.skipif(os.getuid() != 0 if os.name == "posix" else True, reason="only root can be another user")
def test_stop_is_sent_although_another_user_owns_the_runtime_folder(running, tmp_path):
    drive, port = running
    shared = tmp_path / "shared"
    shared.mkdir()
    shared.chmod(0o1777)
    for each in (*tmp_path.parents[:3], tmp_path):
        if each != Path("/tmp"):
            each.chmod(each.stat().st_mode | 0o111)
    (shared / f"runtime-{NOBODY}").mkdir(mode=0o755)
    # Other users may not be able to read the installed modules, so load all before switching the user.
    script = (
        "import os, drivecomm\nfrom drivecomm.cli import main\n"
        f"main(['stop', '{DRIVE}', '--port', '{port}'])\n"
        f"with drivecomm.open_bus('{port}') as bus:\n"
        "    fan = bus.drive('danfoss-fc', 3); fan.stop('coast'); fan.set_reference(percent=30)\n"
        "    fan.start(); print('running')\n"
        f"os.setgid({NOBODY}); os.setuid({NOBODY})\n"
        f"raise SystemExit(main(['stop', '{DRIVE}', '--port', '{port}', '--how', 'coast']))"
    )
    environment = {**os.environ, "TMPDIR": str(shared)}
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False, timeout=60, env=environment
    )
    assert (done.returncode, drive.motor.running) == (0, False), done.stderr
    assert "running" in done.stdout
    assert f"runtime-{NOBODY}" in done.stderr
