"""Modules that commands load: only the needed ones, because loading takes most of the time of a short command."""

import os
import subprocess
import sys
from tempfile import gettempdir

import pytest
from serving_threads import served_in_thread

from drivecomm.virtual import Server, parse_listen, virtual_drive

pytestmark = pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals are POSIX")

COMMAND = """
import sys
from drivecomm_command import main
sys.argv[0] = "drivecomm"
code = main()
print("loaded", *sorted(sys.modules))
sys.exit(code)
"""
PROGRAM = """
import sys, drivecomm
with drivecomm.open_bus(sys.argv[1]) as bus:
    bus.drive("vabus", address=1).read("481")
print("loaded", *sorted(sys.modules))
"""
UNNEEDED_MODULES = {
    *("asyncio", "email", "importlib.metadata", "logging", "pydantic", "pyarrow", "rich", "serial.rfc2217", "textual"),
    *("drivecomm.bus.async_bus", "drivecomm.bus.scanning", "drivecomm.bus.watchdog", "drivecomm.capture.files"),
    *("drivecomm.commissioning", "drivecomm.models.files", "drivecomm.plant.plant", "drivecomm.line.schedule"),
    *("drivecomm.testing", "drivecomm.traffic.sniffer", "drivecomm.transport.rfc2217_client", "drivecomm.virtual"),
    *("drivecomm.transport.socket_channel", "drivecomm_danfoss_fc", "drivecomm_fuji", "drivecomm_vlt3500"),
    *("serial.tools.list_ports",),
}
"""Modules that neither a reading program needs nor a command that reads or stops."""
# From Python 3.14 on, construct loads these by way of pdb.
LOADED_BY_PDB = {"asyncio", "logging", "json"} if sys.version_info >= (3, 14) else set()
UNNEEDED_MODULES -= LOADED_BY_PDB

SHARED = (
    *("app", "commands", "drive_names", "entry", "line_command", "line_options", "options", "values"),
    *("output", "signals", "stops_from_others", "streams"),
)


@pytest.fixture
def port(tmp_path):
    """Serve a VABus drive at a pseudo-terminal; yield its port."""
    with served_in_thread(
        Server([virtual_drive("vabus", 1, reply_delay_s=0.0)], parse_listen(f"pty:{tmp_path / 'line'}"))
    ) as server:
        yield server.address


def loaded_by(program, *arguments, code=0):
    done = subprocess.run(
        [sys.executable, "-c", program, *arguments],
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
        # A login session names the runtime folder, so that no library is loaded to find it.
        env={**os.environ, "XDG_RUNTIME_DIR": gettempdir()},
    )
    assert done.returncode == code, done.stderr
    last = done.stdout.splitlines()[-1].split()
    assert last[0] == "loaded"
    return set(last[1:])


def commands_in(loaded):
    """Return the loaded modules that belong to a single command or a command group."""
    return {name for name in loaded if name.startswith("drivecomm.cli.")} - {f"drivecomm.cli.{name}" for name in SHARED}


def test_reading_program_loads_no_unneeded_module(port):
    loaded = loaded_by(PROGRAM, port)
    assert not loaded & (
        {*UNNEEDED_MODULES, "click", "drivecomm.cli", "platformdirs", "tomllib", "json"} - LOADED_BY_PDB
    )


def test_read_loads_only_its_own_command(port):
    loaded = loaded_by(COMMAND, "read", "vabus:1", "481", "--port", port)
    assert not loaded & {*UNNEEDED_MODULES, "platformdirs", "tomllib"}
    assert commands_in(loaded) == {"drivecomm.cli.one_drive"}


@pytest.mark.soak
def test_stop_loads_fewer_modules_than_read(port):
    loaded = loaded_by(COMMAND, "stop", "vabus:1", "--port", port)
    # tomllib is allowed: the control profile with the stop of the drive is a TOML file.
    assert not loaded & {*UNNEEDED_MODULES, "click", "platformdirs"}
    assert commands_in(loaded) == {
        *("drivecomm.cli.stop", "drivecomm.cli.stop.safe_lookups"),
        *("drivecomm.cli.stop.one_drive", "drivecomm.cli.stop.quick", "drivecomm.cli.stop.stop_ways"),
    }
    assert len(loaded) < len(loaded_by(COMMAND, "read", "vabus:1", "481", "--port", port))


@pytest.mark.soak
def test_stop_of_a_group_loads_no_more_modules_than_a_stop_of_drives(port, tmp_path):
    plant = tmp_path / "plant.toml"
    line = f'[[line]]\nname = "hall"\nport = "{port}"\n'
    plant.write_text(f'format = 1\n{line}[[drive]]\nname = "pump"\ndrive = "vabus:1"\ngroups = ["wet"]\n')
    loaded = loaded_by(COMMAND, "stop", "wet", "--plant", str(plant))
    assert loaded & {*UNNEEDED_MODULES, "click", "platformdirs"} == {"drivecomm.plant.plant"}
    assert loaded <= loaded_by(COMMAND, "stop", "pump", "vabus:1", "--plant", str(plant))


def test_status_loads_only_its_own_command(port):
    loaded = loaded_by(COMMAND, "status", "vabus:1", "--port", port)
    assert not loaded & UNNEEDED_MODULES
    assert commands_in(loaded) == {"drivecomm.cli.one_drive", "drivecomm.cli.status"}


def test_version_flag_loads_no_command():
    loaded = loaded_by(COMMAND, "--version")
    assert not loaded & {*UNNEEDED_MODULES, "click", "drivecomm.bus", "drivecomm.link", "drivecomm.protocol", "json"}
    assert commands_in(loaded) == set()


def test_list_of_commands_loads_no_command():
    loaded = loaded_by(COMMAND, "--help")
    assert not {name.partition(".")[0] for name in loaded} & {"serial", "construct", "drivecomm_vabus", "pydantic"}
    assert not {name for name in loaded if name.startswith(("drivecomm.bus", "drivecomm.link.", "drivecomm.protocol."))}
    assert commands_in(loaded) == set()
