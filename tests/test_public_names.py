"""The public names of drivecomm, and the modules that importing them loads."""

import inspect
import subprocess
import sys
from dataclasses import fields, is_dataclass

import pytest

import drivecomm
from drivecomm import errors
from drivecomm.errors import DriveCommError, TelegramError, UnknownProtocolError, UsageError
from drivecomm.protocol import Protocol, decode, encode, installed

NAMES = {
    "AsyncBroadcast",
    "AsyncBus",
    "AsyncDrive",
    "OpenPlant",
    "keep",
    "keep_async",
    "open_bus_async",
    "open_plant",
    "poll_async",
    "read_watchdog",
    "read_watchdog_async",
    "set_watchdog",
    "set_watchdog_async",
    "AddressError",
    "Broadcast",
    "Bus",
    "Capabilities",
    "CommandCancelledError",
    "CommandTooOldError",
    "DamagedReplyError",
    "DeadlineError",
    "DoubtfulReplyError",
    "Drive",
    "DriveCommError",
    "DriveError",
    "DriveState",
    "DriveStatus",
    "FileFormatError",
    "Found",
    "LineChoices",
    "LineOptions",
    "LineSettings",
    "MachineUnit",
    "LinkDownError",
    "LinkError",
    "NoReplyError",
    "NotAnsweringError",
    "NotSupported",
    "OvertakenError",
    "ParameterAddressError",
    "PollItem",
    "PollResult",
    "LeaseError",
    "HeldBackError",
    "LineBusyError",
    "NotAllowedError",
    "TooOftenError",
    "PortError",
    "ProtocolLoadError",
    "Reading",
    "ReadOnlyError",
    "ServerLostError",
    "RefusedError",
    "ReplyError",
    "StateError",
    "Stop",
    "Telegram",
    "TelegramError",
    "Timing",
    "TraceEvent",
    "UnexpectedReplyError",
    "UnknownProtocolError",
    "UsageError",
    "ValueRefusedError",
    "WrongDriveError",
    "__version__",
    "decode",
    "encode",
    "open_bus",
    "poll",
    "protocols",
}


def test_public_names_exist():
    assert {name for name in NAMES if hasattr(drivecomm, name)} == NAMES


def test_no_other_name_is_public():
    assert {*drivecomm.__all__, "__version__"} == NAMES
    public = {
        name for name, value in vars(drivecomm).items() if not name.startswith("_") and not inspect.ismodule(value)
    }
    assert public <= NAMES


def test_every_error_is_exported_and_in_the_tree():
    for name, value in vars(errors).items():
        if isinstance(value, type) and issubclass(value, Exception):
            assert issubclass(value, DriveCommError)
            assert getattr(drivecomm, name) is value
            assert isinstance(value.exit_code, int)
            assert name in (errors.__doc__ or "")


@pytest.mark.parametrize(
    ("kind", "parent", "exit_code"),
    [
        ("UsageError", ValueError, 2),
        ("NoReplyError", TimeoutError, 4),
        ("NotSupported", errors.UsageError, 2),
        ("ReadOnlyError", errors.UsageError, 2),
        ("LinkDownError", errors.LinkError, 3),
        ("RefusedError", errors.DriveError, 5),
        ("TelegramError", DriveCommError, 4),
        ("DriveCommError", Exception, 1),
    ],
)
def test_error_has_its_base_class_and_exit_code(kind, parent, exit_code):
    assert issubclass(getattr(errors, kind), parent)
    assert getattr(errors, kind).exit_code == exit_code


# From Python 3.14 on, construct loads pdb, which loads asyncio.
IO_MODULES = {"serial", "rich", "click"} | ({"asyncio"} if sys.version_info < (3, 14) else set())


def loaded_by(statement):
    code = f"import sys; before = set(sys.modules); {statement}; print(*sorted(set(sys.modules) - before))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60)
    return done.stdout.split()


def test_importing_drivecomm_loads_no_port_command_line_or_protocol():
    assert [name for name in loaded_by("import drivecomm") if name.startswith("drivecomm")] == ["drivecomm"]
    loaded = loaded_by("import drivecomm; drivecomm.open_bus")
    assert "drivecomm.bus.bus" in loaded
    packages = {name.partition(".")[0] for name in loaded}
    assert packages.isdisjoint({"serial", "rich", "construct", "asyncio", "click", "hypothesis", "pytest"})
    assert not [name for name in loaded if name.startswith("drivecomm_")]
    assert not [
        name for name in loaded if name.startswith(("drivecomm.transport", "drivecomm.cli", "drivecomm.testing"))
    ]


def test_listing_protocols_imports_no_protocol_package():
    loaded = loaded_by("import drivecomm; list(drivecomm.protocols())")
    assert not [name for name in loaded if name.startswith("drivecomm_")]
    assert "construct" not in loaded


def test_using_one_protocol_imports_no_other():
    loaded = loaded_by("import drivecomm; drivecomm.decode('vabus', bytes([4]), direction='request')")
    assert {name.partition(".")[0] for name in loaded if name.startswith("drivecomm_")} == {"drivecomm_vabus"}
    assert not IO_MODULES & {name.partition(".")[0] for name in loaded}


@pytest.mark.parametrize("plugin", list(installed.working()), ids=lambda plugin: plugin.name)
def test_protocol_package_imports_no_io_modules(plugin):
    loaded = loaded_by(f"from drivecomm.protocol.registry import installed; installed[{plugin.name!r}]")
    assert not (IO_MODULES | {"drivecomm.transport"}) & set(loaded)
    others = {name.partition(".")[0] for name in loaded if name.startswith("drivecomm_")}
    assert others == {plugin.package}


@pytest.mark.parametrize("plugin", list(installed.working()), ids=lambda plugin: plugin.name)
def test_plugin_fulfils_the_protocol_contract(plugin):
    assert isinstance(plugin, Protocol)
    unsaid = {field.name for field in fields(Protocol) if getattr(plugin, field.name) is None}
    # Optional parts: a master without memory, addresses of any drive, no broadcast address; the range of
    # parameter addresses is given only if it is known.
    assert unsaid <= {"memory", "addresses_of", "broadcast_address", "address_space"}
    assert is_dataclass(plugin.options)
    assert plugin.options.__dataclass_params__.frozen
    assert all(field.kw_only for field in fields(plugin.options))
    assert plugin.options.__doc__
    for field in fields(plugin.options):
        assert field.name in plugin.options.__doc__, "the docstring must explain each option"
    assert plugin.options()
    assert plugin.title
    assert plugin.facts_source
    assert plugin.parameter_examples
    assert set(plugin.scan_addresses) <= set(plugin.addresses)
    assert plugin.broadcast_address not in plugin.addresses
    assert plugin.forms()
    for form in plugin.forms().values():
        rows = form.describe()
        assert all(len(row) == 3 and all(isinstance(cell, str) for cell in row) for row in rows)
    operations = plugin.operations(plugin.addresses[0], plugin.options(), None)
    assert operations.capabilities.stops
    for verb in ("read", "write", "status", "start", "stop", "reset", "probe", "identify"):
        assert callable(getattr(operations, verb))
    if plugin.broadcast_address is None:
        return
    everybody = plugin.operations(plugin.broadcast_address, plugin.options(), None)
    for verb in ("status", "probe", "identify"):
        with pytest.raises(UsageError):
            next(getattr(everybody, verb)())


def test_decode_and_encode_match_a_telegram_written_by_hand():
    data = bytes.fromhex("0441303034383105")
    telegram = drivecomm.decode("vabus", data, direction="request")
    assert (telegram.protocol, telegram.direction, telegram.data) == ("vabus", "request", data)
    assert telegram.kind == "enquiry"
    assert telegram.fields == {"kind": "enquiry", "address": 1, "sys": 0, "dataset": 0, "parameter": 481}
    assert drivecomm.encode("vabus", telegram.fields, direction="request") == data
    assert decode("vabus", bytearray(data), direction="request") == telegram
    assert decode("vabus", memoryview(data), direction="request") == telegram
    assert encode is drivecomm.encode


def test_decode_accepts_options_of_the_protocol():
    data = drivecomm.encode(
        "vabus", {"kind": "value", "address": 1, "parameter": 520, "data": "03G8"}, direction="reply"
    )
    assert drivecomm.decode("vabus", data, direction="reply").fields["data"] == "03G8"
    with pytest.raises(TelegramError) as caught:
        drivecomm.decode("vabus", data, direction="reply", type="int")
    assert caught.value.category == "field"


@pytest.mark.parametrize(
    ("call", "error", "what"),
    [
        (lambda: drivecomm.decode("profibus", b"", direction="reply"), UnknownProtocolError, "profibus"),
        (lambda: drivecomm.decode("vabus", b"\x04", direction="up"), UsageError, "'request' or 'reply', not 'up'"),
        (lambda: drivecomm.decode("vabus", b"\x04", direction="request", colour=1), UsageError, "no option 'colour'"),
        (lambda: drivecomm.encode("vabus", {}, direction="request", colour=1), UsageError, "no option 'colour'"),
        (lambda: drivecomm.encode("vabus", {}, direction="request"), TelegramError, "kind"),
        (lambda: drivecomm.encode("vabus", {"kind": "ack"}, direction="request"), TelegramError, "kind"),
        (lambda: drivecomm.encode("vabus", {"kind": "ack"}, direction="reply"), TelegramError, "address"),
        (lambda: drivecomm.decode("vabus", b"", direction="request"), TelegramError, "nothing"),
    ],
)
def test_invalid_decode_or_encode_call_raises_an_error(call, error, what):
    with pytest.raises(error, match=what):
        call()
