"""Telegrams of single Modbus series and the pitfall of each, over a line of virtual drives."""

from contextlib import contextmanager

import pytest

import drivecomm
from drivecomm.errors import NotSupported, StateError
from drivecomm.models import link_loss_of, load_model, model_names
from drivecomm.protocol import DriveState, Stop
from drivecomm.virtual import VirtualLine, virtual_drive
from drivecomm_modbus.messages import Reply

MODELS = {name: load_model("drivecomm_modbus", "modbus", name) for name in model_names("drivecomm_modbus", "modbus")}
COMMANDED = [name for name, model in MODELS.items() if "stop" in model.control]
MONITORED = [name for name in MODELS if name not in COMMANDED]
ORDERS = {"start", "start_reverse", "stop", "coast", "quick", "dc_brake", "reset", "reference_hz", "reference_percent"}
POWERFLEX = [name for name in MODELS if name.startswith("powerflex")]


@contextmanager
def line_of(name):
    """Yield a virtual drive of a model, its line, the drive object of its master and the events of the bus."""
    virtual = virtual_drive("modbus", 1, model=name)
    line, sent = VirtualLine([virtual]), []
    with drivecomm.open_bus(line.port, trace=sent.append) as bus:
        yield virtual, line, bus.drive("modbus", 1, model=name, confirmed=name), sent


def turns(virtual, line):
    """Advance a minute so that a command is carried out; return the output frequency in Hz."""
    line.advance(60)
    virtual.motor.advance(line.time)
    return virtual.motor.output_hz


def written(sent):
    """Return the writes in a trace, without address and CRC."""
    data = [event.data for event in sent if event.what == "sent" and event.data[1] not in (1, 3, 4)]
    return [each[1:-2].hex(" ").upper() for each in data]


def written_by(name, *calls, tripped=False):
    """Return the writes of some calls to a drive that has been read before, so that no read checks for an echo."""
    with line_of(name) as (virtual, line, drive, sent):
        if tripped:
            virtual.trip(next(iter(MODELS[name].faults), 4), line.time)
        drive.status()
        del sent[:]
        for call in calls:
            call(drive)
        return written(sent)


# Telegrams

STOP_LS, STOP_MCH = ["06 00 06 00 01", "06 00 04 00 01", "06 00 06 00 01"], ["06 00 01 00 04", "06 00 30 00 00"]


@pytest.mark.parametrize(
    ("name", "call", "telegrams"),
    [
        *[(name, lambda drive: drive.start(), ["06 20 00 00 12"]) for name in POWERFLEX],
        *[(name, lambda drive: drive.start(reverse=True), ["06 20 00 00 22"]) for name in POWERFLEX],
        *[(name, lambda drive: drive.stop(), ["06 20 00 00 01"]) for name in POWERFLEX],
        ("powerflex-4", lambda drive: drive.set_reference(hz=20), ["06 20 01 00 C8"]),
        ("powerflex-4m", lambda drive: drive.set_reference(hz=20), ["06 20 01 00 C8"]),
        ("powerflex-40", lambda drive: drive.set_reference(hz=20), ["06 20 01 00 C8"]),
        ("powerflex-40p", lambda drive: drive.set_reference(hz=20), ["06 20 01 07 D0"]),
        ("powerflex-400", lambda drive: drive.set_reference(hz=20), ["06 20 01 07 D0"]),
        ("powerflex-520", lambda drive: drive.set_reference(hz=20), ["06 20 01 07 D0"]),
        ("actech-mch", lambda drive: drive.start(), ["06 00 30 00 00", "06 00 01 00 08"]),
        ("actech-mch", lambda drive: drive.stop(), [*STOP_MCH, "06 00 01 00 04"]),
        ("actech-mch", lambda drive: drive.set_reference(hz=41.2), ["06 00 30 00 00", "06 00 28 10 18"]),
        ("ls-ig5a", lambda drive: drive.start(), ["06 00 04 00 01", "06 00 06 00 02"]),
        ("ls-ig5a", lambda drive: drive.start(reverse=True), ["06 00 04 00 01", "06 00 06 00 04"]),
        ("ls-ig5a", lambda drive: drive.stop(), STOP_LS),
        ("ls-ig5a", lambda drive: drive.set_reference(hz=60), ["06 00 04 00 01", "06 00 05 17 70"]),
        *[(name, lambda drive: drive.start(), ["06 00 00 00 01"]) for name in ("eaton-dc1", "eaton-de1")],
        *[(name, lambda drive: drive.start(reverse=True), ["06 00 00 00 03"]) for name in ("eaton-dc1", "eaton-de1")],
        *[(name, lambda drive: drive.stop(), ["06 00 00 00 00"]) for name in ("eaton-dc1", "eaton-de1")],
        ("eaton-dc1", lambda drive: drive.stop(Stop.COAST), ["06 00 00 00 08"]),
        ("eaton-dc1", lambda drive: drive.stop(Stop.QUICK), ["06 00 00 00 20"]),
        ("eaton-dc1", lambda drive: drive.set_reference(hz=25), ["06 00 01 00 FA"]),
        ("enc-eds", lambda drive: drive.start(), ["06 20 00 00 07"]),
        ("enc-eds", lambda drive: drive.start(reverse=True), ["06 20 00 00 08"]),
        ("enc-eds", lambda drive: drive.stop(), ["06 20 00 00 06"]),
        ("enc-eds", lambda drive: drive.set_reference(hz=50), ["06 20 01 13 88"]),
        ("vt-e5h", lambda drive: drive.start(), ["10 80 00 00 01 02 00 01"]),
        ("vt-e5h", lambda drive: drive.start(reverse=True), ["10 80 00 00 01 02 00 03"]),
        ("vt-e5h", lambda drive: drive.stop(), ["10 80 00 00 01 02 00 00"]),
        ("vt-e5h", lambda drive: drive.set_reference(hz=50), ["10 80 01 00 01 02 13 88"]),
    ],
)
def test_commands_of_a_series_are_its_printed_telegrams(name, call, telegrams):
    assert written_by(name, call) == telegrams


@pytest.mark.parametrize(
    ("name", "telegrams"),
    [
        *[(name, ["06 20 00 00 00", "06 20 00 00 08", "06 20 00 00 00"]) for name in POWERFLEX],
        ("ls-ig5a", ["06 00 04 00 01", "06 00 06 00 08"]),
        ("eaton-dc1", ["06 00 00 00 00", "06 00 00 00 04", "06 00 00 00 00"]),
        ("enc-eds", ["06 20 00 00 09"]),
        ("vt-e5h", [f"10 80 00 00 01 02 00 0{bits}" for bits in (0, 4, 0)]),
    ],
)
def test_reset_of_a_series_is_its_printed_telegrams(name, telegrams):
    assert written_by(name, lambda drive: drive.reset(), tripped=True) == telegrams


@pytest.mark.parametrize("name", COMMANDED)
def test_commanded_series_runs_reverses_stops_and_resets(name):
    with line_of(name) as (virtual, line, drive, _):
        able = drive.capabilities
        drive.set_reference(**({"hz": 20} if able.reference_hz else {"percent": 40}))
        for reverse in (False, True) if able.reverse else (False,):
            drive.start(reverse=reverse)
            assert turns(virtual, line) == pytest.approx(-20 if reverse else 20, abs=0.1)
            status = drive.status()
            assert (status.state, status.reverse in (None, reverse)) == (DriveState.RUNNING, True)
            drive.stop(Stop.COAST if Stop.RAMP not in able.stops else Stop.RAMP)
            line.advance(60)
            assert drive.status().state is not DriveState.RUNNING
            assert not virtual.motor.running
        virtual.trip(next(iter(MODELS[name].faults), 4), line.time)
        assert drive.status().fault
        with pytest.raises(StateError, match="reset it first"):
            drive.start()
        if "reset" in MODELS[name].control:
            line.advance(60)
            drive.reset()
            assert not drive.status().fault
        assert not virtual.motor.running


# Monitored series


@pytest.mark.parametrize("name", MONITORED)
def test_monitored_series_refuses_every_command_unsent(name):
    assert not ORDERS & MODELS[name].control.keys()
    with line_of(name) as (_, _, drive, sent):
        for call in (
            drive.start,
            lambda: drive.start(reverse=True),
            *(lambda how=how: drive.stop(how) for how in Stop),
            drive.reset,
            lambda: drive.set_reference(hz=10),
            lambda: drive.set_reference(percent=10),
        ):
            with pytest.raises(NotSupported):
                call()
        assert sent == []


@pytest.mark.parametrize("name", MONITORED)
def test_monitored_series_reads_all_its_common_names(name):
    with line_of(name) as (_, _, drive, _):
        for common, address in MODELS[name].quantities.items():
            assert drive.read(common).parameter == address
            assert MODELS[name].parameters[address].sure != "unconfirmed"


@pytest.mark.parametrize(
    ("name", "parameter"),
    [
        ("gs4", "0x091B"),
        ("powtran-pi130", "0x2000"),
        ("parker-ac10", "0x2000"),
        ("inovance-md500", "0x2000"),
        ("rexroth-efc", "0x7F00"),
        ("weg-cfw08", "c100"),
        ("weg-cfw09", "c101"),
        ("lenze-smd", "1"),
        ("lenze-tmd", "1"),
        ("danfoss-vlt2800", "c6"),
    ],
)
def test_write_that_may_start_a_monitored_drive_is_recognised(name, parameter):
    with line_of(name) as (_, _, drive, _):
        assert drive.may_start("write", parameter=parameter, value=1)
        settings = [
            each.address for each in MODELS[name].parameters.values() if each.kind == "setting" and each.access != "r"
        ]
        assert not any(drive.may_start("write", parameter=each, value=1) for each in settings)


# PowerFlex


@pytest.mark.parametrize(
    ("name", "raw"),
    [
        ("powerflex-4", 200),
        ("powerflex-4m", 200),
        ("powerflex-40", 200),
        ("powerflex-40p", 200),
        ("powerflex-400", 2000),
        ("powerflex-520", 2000),
    ],
)
def test_powerflex_feedback_has_the_scale_of_its_series(name, raw):
    with line_of(name) as (virtual, line, drive, _):
        drive.set_reference(hz=20)
        drive.start()
        line.advance(30)
        assert virtual.peek("8451", line.time) == raw
        assert float(drive.read("output_frequency").value) == 20


@pytest.mark.parametrize(
    ("name", "parameter", "right"),
    [("powerflex-4", "36", 5), ("powerflex-40", "38", 5), ("powerflex-400", "36", 5), ("powerflex-520", "46", 3)],
)
def test_start_of_a_powerflex_with_another_command_source_is_refused(name, parameter, right):
    with line_of(name) as (virtual, _, drive, sent):
        virtual.poke(parameter, 0)
        with pytest.raises(StateError, match=f"obeys the bus only with {right}"):
            drive.start()
        assert written(sent) == []


def test_powerflex_40p_parameter_write_needs_store():
    with line_of("powerflex-40p") as (_, _, drive, sent):
        with pytest.raises(NotSupported, match="store=True"):
            drive.write("write_mode", 1)
        assert written(sent) == []
        drive.write("write_mode", 1, store=True)


def test_fault_94_of_a_powerflex_400_has_another_meaning():
    texts = {name: MODELS[name].faults.get(94) for name in POWERFLEX}
    assert (texts["powerflex-40p"], texts["powerflex-40"]) == ("encoder lost", None)
    assert "function loss" in texts["powerflex-400"]


# Drives that accept no command until they are unlocked


@contextmanager
def locked(name, key, opens, guarded, code):
    """Yield a drive that refuses writes to the guarded registers until the key register holds `opens`."""
    with line_of(name) as (virtual, line, drive, sent):
        answer, opened = virtual.answer, []

        def guard(message, now):
            if message.function == 6 and message.start == key:
                opened[:] = [message.value == opens]
            elif message.function == 6 and message.start in guarded and opened != [True]:
                return Reply(address=1, function=6, exception=code)
            return answer(message, now)

        virtual.answer = guard
        yield virtual, line, drive, sent


LOCKED = [("ls-ig5a", 4, 1, {5, 6}, 20), ("actech-mch", 48, 0, {1, 40}, 1)]


@pytest.mark.parametrize(("name", "key", "opens", "guarded", "code"), LOCKED, ids=[each[0] for each in LOCKED])
def test_locked_drive_is_unlocked_for_reference_start_and_stop(name, key, opens, guarded, code):
    with locked(name, key, opens, guarded, code) as (virtual, line, drive, _):
        drive.set_reference(hz=20)
        drive.start()
        assert turns(virtual, line) == pytest.approx(20, abs=0.1)
        drive.stop()
        assert turns(virtual, line) == 0


@pytest.mark.parametrize(("name", "key", "opens", "guarded", "code"), LOCKED, ids=[each[0] for each in LOCKED])
def test_running_locked_drive_is_stopped(name, key, opens, guarded, code):
    """The drive was started at its terminals, or locked itself while it ran."""
    with locked(name, key, opens, guarded, code) as (virtual, line, drive, _):
        virtual.motor.run(20.0, line.time)
        line.advance(30)
        drive.stop()
        assert turns(virtual, line) == 0


def test_operation_command_of_0_does_not_stop_an_ls_drive():
    with line_of("ls-ig5a") as (virtual, line, drive, _):
        drive.set_reference(hz=20)
        drive.start()
        drive.write("operation_command", 0)
        assert turns(virtual, line) == pytest.approx(20, abs=0.1)


def test_reverse_and_reset_of_an_actech_drive_are_refused():
    with line_of("actech-mch") as (_, _, drive, sent):
        for call in (lambda: drive.start(reverse=True), drive.reset):
            with pytest.raises(NotSupported):
                call()
        assert sent == []


# Series that use the bits of a register differently


def test_eaton_drive_reverses_by_bit_1_which_its_reset_leaves_clear():
    with line_of("eaton-dc1") as (virtual, line, drive, _):
        drive.set_reference(hz=20)
        drive.start(reverse=True)
        assert turns(virtual, line) == pytest.approx(-20, abs=0.1)
        assert drive.status().reverse
    assert MODELS["optidrive-plus"].control["reset"][0] == ("1", 2, 2), "the reset that would reverse an Eaton"
    assert all(not step[1] & 2 for step in MODELS["eaton-dc1"].control["reset"])


def test_reset_of_an_invt_drive_would_start_an_enc_drive():
    ((register, word),) = MODELS["invt"].control["reset"]
    assert MODELS["enc-eds"].control["start"] == (("0x2000", 7),) == ((register, word),)
    assert written_by("enc-eds", lambda drive: drive.reset(), tripped=True) == ["06 20 00 00 09"]


# Link loss


def test_gs4_has_its_link_loss_time_in_another_register_than_older_deltas():
    assert MODELS["delta-vfd-b"].watchdog.time == "0x0903"
    assert MODELS["gs4"].watchdog is None
    assert "0x0905" in link_loss_of(MODELS["gs4"])
    assert MODELS["gs4"].parameters["0x0903"].name == "link_loss_action"


@pytest.mark.parametrize("name", ["schneider-atv12", "schneider-atv71", "schneider-atv320"])
def test_altivar_watchdog_is_writable_only_while_the_motor_stands(name):
    watchdog = MODELS[name].watchdog
    assert {MODELS[name].parameters[each].access for each in (watchdog.time, watchdog.action)} == {"rw*"}
    assert watchdog.actions == {"hold": 0, "trip": 1}
    assert MODELS[name].faults[5].startswith("SLF1")


# Identity


@pytest.mark.parametrize(
    ("name", "other"),
    [
        ("actech-mch", "lenze-smd"),
        ("lenze-smd", "lenze-tmd"),
        ("lenze-tmd", "actech-mch"),
        ("weg-cfw08", "weg-cfw09"),
        ("weg-cfw09", "weg-cfw08"),
        ("ls-ig5a", "weg-cfw08"),
    ],
)
def test_identity_of_a_family_fits_its_own_model_only(name, other):
    with line_of(name) as (_, _, drive, _):
        told = drive.identify()
    assert MODELS[name].matches(told)
    assert not MODELS[other].matches(told)
