"""A drive proves to be of its model's series before its first write or command, but never before a stop."""

import logging
from dataclasses import replace

import pytest

import drivecomm
from drivecomm.bus import series_proof
from drivecomm.errors import UsageError, WrongDriveError
from drivecomm.models import load_model
from drivecomm.protocol import MotorCommand
from drivecomm.virtual import VirtualLine, virtual_drive


def opened(drive):
    line, sent = VirtualLine([drive]), []
    return drivecomm.open_bus(line.port, trace=sent.append), sent, line


def telegrams(sent):
    return [each.data[:-2].hex(" ").upper() for each in sent if each.what == "sent"]


COMMANDS = {
    "start": lambda drive: drive.start(),
    "reset": lambda drive: drive.reset(),
    "set_reference": lambda drive: drive.set_reference(hz=20),
    "write": lambda drive: drive.write("0x2000", 1),
}


@pytest.mark.parametrize("command", COMMANDS.values(), ids=COMMANDS)
def test_command_to_a_drive_of_another_series_is_refused_before_any_write(command):
    drive = virtual_drive("modbus", 1, model="invt")
    bus, sent, _ = opened(drive)
    with (
        bus,
        pytest.raises(WrongDriveError, match=r"modbus:1 is not a drive of model delta.*0x2119.*unknown addr") as no,
    ):
        command(bus.drive("modbus", 1, model="delta"))
    assert {each[3:5] for each in telegrams(sent)} == {"03"}
    assert no.value.model == "delta"
    assert "confirmed=" in no.value.remedy


def test_refusal_names_the_series_that_fit():
    bus, _, _ = opened(virtual_drive("modbus", 1, model="delta-vfd-e"))
    with bus, pytest.raises(WrongDriveError, match=r"it could be .*delta-vfd-e") as no:
        bus.drive("modbus", 1, model="delta-vfd-b").start()
    assert "delta-vfd-e" in no.value.candidates
    assert "delta-vfd-b" not in no.value.candidates


def test_series_is_checked_once_per_opened_port():
    drive = virtual_drive("modbus", 1, model="delta-vfd-b")
    bus, sent, line = opened(drive)
    with bus:
        one = bus.drive("modbus", 1, model="delta-vfd-b")
        one.read("0x2103")
        assert len(telegrams(sent)) == 1, "reading needs no proof"
        del sent[:]
        one.write("0x2001", 20)
        assert [each[3:5] for each in telegrams(sent)] == ["03", "03", "06"]
        del sent[:]
        one.write("0x2001", 30)
        bus.drive("modbus", 1, model="delta-vfd-b").write("0x2001", 40)
        # The second object checks again whether its write is echoed.
        assert [each[3:5] for each in telegrams(sent)] == ["06", "06", "03"]
    with drivecomm.open_bus(line.port, trace=sent.append) as again:
        del sent[:]
        again.drive("modbus", 1, model="delta-vfd-b").write("0x2001", 20)
    assert [each[3:5] for each in telegrams(sent)][:3] == ["03", "03", "06"]


def test_series_is_checked_again_after_an_absence_of_the_drive():
    drive = virtual_drive("modbus", 1, model="delta")
    bus, sent, line = opened(drive)
    with bus:
        one = bus.drive("modbus", 1, model="delta", attempts=1)
        one.set_reference(hz=20)
        line.power_off(drive)
        for _ in range(10):
            with pytest.raises(drivecomm.errors.NoReplyError):
                one.status()
        line.power_on(drive)
        line.advance(120)
        one.status()
        del sent[:]
        one.set_reference(hz=20)
    assert [each[3:5] for each in telegrams(sent)] == ["03", "06"]


@pytest.mark.parametrize("model", ["delta", "invt", "schneider-atv", "abb-acs580", "toshiba-vfs11"])
def test_stop_is_the_first_telegram_to_an_unproven_drive(model):
    bus, sent, _ = opened(virtual_drive("modbus", 1, model=model))
    with bus:
        bus.drive("modbus", 1, model=model).stop()
    assert telegrams(sent)[0][3:5] in ("06", "10")


def test_stop_is_sent_to_a_drive_of_another_series():
    for confirmed, error in (({"confirmed": "gs2"}, UsageError), ({}, WrongDriveError)):
        bus, sent, _ = opened(virtual_drive("modbus", 1, model="invt"))
        with bus:
            one = bus.drive("modbus", 1, model="delta", **confirmed)
            with pytest.raises(error):
                one.start()
            del sent[:]
            one.stop()
        assert telegrams(sent)[0] == "01 06 20 00 00 01"


def test_confirmed_model_is_commanded_without_a_check():
    drive = virtual_drive("modbus", 1, model="delta-vfd-e")
    bus, sent, _ = opened(drive)
    with bus:
        one = bus.drive("modbus", 1, model="delta-vfd-b", confirmed="delta-vfd-b")
        one.write("0x2001", 20)
        assert telegrams(sent)[0][3:5] == "06"
        one.start()
    assert drive.motor.command is MotorCommand.RUN


def test_set_up_is_not_written_to_a_drive_of_another_series():
    bus, sent, _ = opened(virtual_drive("modbus", 1, model="invt"))
    with bus, pytest.raises(WrongDriveError):
        bus.drive("modbus", 1, model="delta", set_up={"0x2001": 10}).read("0x2103")
    assert {each[3:5] for each in telegrams(sent)} == {"03"}


def test_danfoss_drive_of_another_type_is_refused_even_if_confirmed():
    bus, _, _ = opened(virtual_drive("danfoss-fc", 1, model="fc101"))
    with bus:
        for confirmed in ({}, {"confirmed": "fc202"}):
            with pytest.raises(WrongDriveError, match=r"model fc202, .*it reports FC type FC-101; it could be fc101"):
                bus.drive("danfoss-fc", 1, model="fc202", **confirmed).start()
        bus.drive("danfoss-fc", 1, model="fc202").stop()


def test_danfoss_family_model_commands_series_that_extend_it():
    drive = virtual_drive("danfoss-fc", 1, model="fc302")
    bus, _, _ = opened(drive)
    with bus:
        one = bus.drive("danfoss-fc", 1, model="fc300")
        one.set_reference(percent=50)
        one.start()
    assert drive.motor.command is MotorCommand.RUN


def test_confirmed_model_with_its_own_identity_rules_is_still_checked():
    model = replace(load_model("drivecomm_modbus", "modbus", "yaskawa"), identified_by={"product": "A1"})
    drive = virtual_drive("modbus", 1, model="yaskawa")
    bus, _, _ = opened(drive)
    with bus:
        one = bus.drive("modbus", 1, model=model, confirmed="yaskawa")
        with pytest.raises(WrongDriveError, match="it reports product A0"):
            one.start()
        drive.poke("0x0034", "A1")
        one.set_reference(hz=20)


def test_drive_without_an_identity_needs_a_confirmed_model():
    named = replace(load_model("drivecomm_modbus", "modbus", "gs2"), identified_by={"vendor": "X.*"})
    bus, _, _ = opened(virtual_drive("modbus", 1, model="gs2"))
    with bus:
        with pytest.raises(WrongDriveError, match="nothing that identifies its series"):
            bus.drive("modbus", 1, model=named).set_reference(hz=20)
        bus.drive("modbus", 1, model=named, confirmed="gs2").set_reference(hz=20)


def test_user_model_is_checked_by_its_status_register_only(tmp_path):
    (tmp_path / "mine.toml").write_text(
        'format = 1\nprotocol = "modbus"\nname = "mine"\nextends = "delta"\n', encoding="utf-8"
    )
    for model, fits in (("delta", True), ("invt", False)):
        bus, _, _ = opened(virtual_drive("modbus", 1, model=model))
        with bus:
            one = bus.drive("modbus", 1, model=tmp_path / "mine.toml")
            if fits:
                one.set_reference(hz=20)
            else:
                with pytest.raises(WrongDriveError):
                    one.set_reference(hz=20)


def test_unproven_drive_on_a_real_port_is_logged_once(caplog, serving):
    with serving([virtual_drive("modbus", 1, model="gs2")], "tcp") as server, caplog.at_level(logging.WARNING):
        with drivecomm.open_bus(server.address) as bus:
            bus.drive("modbus", 1, model="gs2").set_reference(hz=20)
            bus.drive("modbus", 1, model="gs2").set_reference(hz=20)
            assert [each.message.count("confirm it with confirmed=gs2") for each in caplog.records] == [1]
            caplog.clear()
        with drivecomm.open_bus(server.address) as bus:
            bus.drive("modbus", 1, model="gs2", confirmed="gs2").set_reference(hz=20)
            assert not caplog.records


@pytest.mark.parametrize("read_only", [True, False])
def test_verb_that_only_reads_needs_no_series_check(read_only):
    bus, sent, _ = opened(virtual_drive("danfoss-fc", 1, model="fc302"))
    with bus:
        drive = bus.drive("danfoss-fc", 1, model="fc202", read_only=read_only)
        assert drive.call("describe", parameter="3-41", option_texts=0).address == "3-41"
    assert all("0E 81 4" in each for each in telegrams(sent)), "nothing but descriptions is asked for"


def test_models_to_compare_with_are_loaded_before_the_line_is_taken():
    bus, _, _ = opened(virtual_drive("modbus", 1, model="invt"))
    with bus:
        series_proof._packaged.cache_clear()
        check = bus.drive("modbus", 1, model="invt").peer.check_series()
        assert series_proof._packaged.cache_info().misses == 1, "nothing has been asked yet"
        check.close()
