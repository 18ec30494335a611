"""Single mistakes planted in built-in packages, and the check that finds each."""

from contextlib import suppress
from dataclasses import dataclass, replace
from decimal import Decimal

import pytest
from altered import Altered

from drivecomm.cli.entry import main
from drivecomm.errors import DriveError
from drivecomm.models import load_model
from drivecomm.protocol import Ask, installed, with_each_command
from drivecomm.testing import QUICK, all_checks, make_report, notes_of, packaged_vectors, try_out
from drivecomm.testing.bench import bench
from drivecomm.testing.unproven import unproven
from drivecomm.virtual import virtual_drive


def reasons(plugin, kind):
    """Return the failure reasons of the checks of this kind."""
    found = [try_out(each) for each in all_checks(plugin, QUICK) if each.kind == kind]
    assert found, f"there is no check {kind!r}"
    return " ".join(each.reason for each in found)


def asking(change):
    """Return a wrapper for verbs that applies a change to each of their requests."""

    def make(verb):
        def carried_out(*values, **options):
            return with_each_command(verb(*values, **options), lambda each: change(each) if type(each) is Ask else each)

        return carried_out

    return make


def with_verbs(with_operations, name, change, *verbs):
    return with_operations(
        name, **{verb: lambda real, verb=verb: asking(change)(getattr(real, verb)) for verb in verbs}
    )


NAMING = "a question that anothers answer fits is declared"


@pytest.mark.parametrize("name", ["modbus", "vlt3500"])
def test_read_missing_the_nameless_mark_is_found(with_operations, name):
    plugin = with_verbs(with_operations, name, lambda ask: replace(ask, nameless=False), "read")
    assert "which is not asked as nameless" in reasons(plugin, NAMING)


@pytest.mark.parametrize("name", ["modbus", "vlt3500"])
def test_read_wrongly_marked_distinct_is_found(with_operations, name):
    plugin = with_verbs(with_operations, name, lambda ask: replace(ask, nameless=False, distinct=True), "read")
    assert "which is asked as distinct" in reasons(plugin, NAMING)


def test_status_missing_the_nameless_mark_is_found(with_operations):
    """Requests of several telegrams, and those that read no parameter, are compared as well."""
    plugin = with_verbs(with_operations, "modbus", lambda ask: replace(ask, nameless=False), "status")
    assert "in status, which is not asked as nameless" in reasons(plugin, NAMING)


def test_write_missing_the_nameless_mark_is_found(with_operations):
    plugin = with_verbs(with_operations, "vabus", lambda ask: replace(ask, nameless=False), "write")
    assert "which is not asked as nameless" in reasons(plugin, NAMING)


def test_anonymous_refusal_is_not_reported():
    assert not reasons(installed["vabus"], NAMING)


# Values


def test_coil_holding_a_number_is_found(monkeypatch):
    real = installed["modbus"].virtual

    def virtual(address, options, model):
        made = real(address, options, model)
        machine = made._machine
        made.poke = lambda parameter, raw: machine.put(made._held(parameter), int(raw))
        return made

    plugin = replace(installed["modbus"], virtual=virtual, default_model="danfoss-fc")
    monkeypatch.setitem(installed._loaded, "modbus", plugin)
    assert "c65 is set to 5, and then the virtual drive raises" in reasons(plugin, "holds only what it can tell")


def test_poke_of_a_coil_refuses_a_number():
    drive = virtual_drive("modbus", 1, model="danfoss-fc")
    with pytest.raises(ValueError, match="c65 is a coil and has no room for 5"):
        drive.poke("c65", 5)
    drive.poke("c65", 1)
    assert drive.peek("c65", 0.0) == 1


@pytest.mark.parametrize("name", ["vabus", "modbus", "vlt3500", "fuji"])
def test_tell_apart_sets_unique_values_within_their_ranges(name):
    plugin = installed[name]
    model = load_model(plugin.package, name, plugin.default_model)
    numbers = [each for each in model.parameters.values() if each.access == "rw" and not each.values]
    with bench(plugin, model, addresses=plugin.addresses[:2]) as on:
        on.set_unique_values(model)
        masters = [on.drive, on.bus.drive(name, plugin.addresses[1], model=model)]
        held = []
        for info in numbers:
            for master in masters:
                with suppress(DriveError):
                    held += [(info, master.read(info.address).value)]
    changed = [(info, value) for info, value in held if value != info.start]
    # Some are measured values, or follow other parameters.
    assert len({value for _, value in changed}) >= max(8, 0.9 * len(changed))
    assert all(info.minimum is None or value >= info.minimum for info, value in changed)
    assert all(info.maximum is None or value <= info.maximum for info, value in changed)


# Commands


@pytest.mark.parametrize(
    ("name", "verb", "said"),
    [
        ("vabus", "start", "a start sends"),
        ("fuji", "stop", "a stop sends"),
        ("vlt3500", "start", "a start sends"),
        ("huanyang", "set_reference_hz", "a reference in hz sends"),
    ],
)
def test_command_missing_the_acts_mark_is_found(with_operations, name, verb, said):
    plugin = with_verbs(with_operations, name, lambda ask: replace(ask, acts=False), verb)
    found = reasons(plugin, "what acts is said to act")
    assert said in found
    assert "without acts=True" in found


@pytest.mark.parametrize("name", ["vabus", "fuji"])
def test_repeated_reset_is_found(with_operations, name):
    plugin = with_verbs(with_operations, name, lambda ask: replace(ask, attempts=3), "reset")
    assert "clears the fault, and is sent 3 times" in reasons(plugin, "a reset is not repeated")


@pytest.mark.parametrize("name", ["fuji", "huanyang"])
def test_rounded_reference_is_found(with_operations, name):
    def rounding(real):
        return lambda hz: real.set_reference_hz(Decimal(round(float(hz) * 10)) / 10)

    plugin = with_operations(name, set_reference_hz=rounding)
    assert "a reference of 20.04 Hz is accepted, and the drive receives 20 Hz" in reasons(plugin, "rounds no reference")


def test_volatile_write_to_a_drive_that_stores_all_is_found(with_operations):
    def writing(real):
        return lambda parameter, value, **options: real.write(parameter, value, **{**options, "store": True})

    plugin = with_operations("huanyang", write=writing)
    found = reasons(plugin, "keeps out of eeprom what is not to be stored")
    assert "is written without store, and every write is stored" in found


# Options and codecs


@dataclass(frozen=True, slots=True, kw_only=True)
class _Raising:
    """Options with an invalid value that raises ValueError instead of a drivecomm error. end: 0 or 1."""

    end: int = 0

    def __post_init__(self):
        if self.end not in (0, 1):
            raise ValueError("end is 0 or 1")


@pytest.fixture
def raising_options(in_place_of):
    real = installed["huanyang"]
    usual = real.options()
    return in_place_of(
        "huanyang",
        options=_Raising,
        codec=lambda _: real.codec(usual),
        operations=lambda address, _, *more: real.operations(address, usual, *more),
        virtual=lambda address, _, model: real.virtual(address, usual, model),
    )


def test_options_raising_a_foreign_error_are_found(raising_options):
    found = reasons(raising_options, "refuses options as usage errors")
    assert "end=-1 raises ValueError: end is 0 or 1" in found


@pytest.mark.usefixtures("raising_options")
def test_command_reports_a_foreign_error_of_options_in_one_sentence(capsys):
    assert main(["simulate", "--drive", "huanyang:4,end=7", "--listen", "tcp:127.0.0.1:0"]) == 2
    said = capsys.readouterr().err
    assert "huanyang refuses its options end" in said
    assert "Traceback" not in said


@pytest.fixture
def failing_codec(in_place_of):
    """Return a protocol whose codec raises TypeError for a text in a number field."""
    real = installed["vabus"].codec

    def codec(options):
        made = real(options)

        def encode(message):
            if isinstance(getattr(message, "parameter", None), str):
                assert message.parameter >= 0
            return made.encode(message)

        return Altered(made, encode=encode)

    return in_place_of("vabus", codec=codec)


def test_codec_raising_a_foreign_error_for_a_text_is_found(failing_codec):
    assert "raise TypeError" in reasons(failing_codec, "refuses odd fields by its own errors")


@pytest.mark.usefixtures("failing_codec")
def test_command_reports_a_foreign_error_of_a_codec_in_one_sentence(capsys):
    assert main(["encode", "vabus", "kind=enquiry", "address=1", "parameter=x"]) == 4
    said = capsys.readouterr().err
    assert "vabus fails at this telegram (TypeError" in said
    assert "Traceback" not in said


def test_option_ignored_by_the_virtual_drive_is_found(in_place_of):
    """The virtual drive ignores the option, so master and drive do not understand each other."""
    real = installed["uss"]
    plugin = in_place_of(
        "uss", virtual=lambda address, options, model: real.virtual(address, replace(options, pkw_words=127), model)
    )
    assert "with pkw_words=3 the drive is not understood" in reasons(plugin, "works with each option")


# Unproven features


def test_command_without_a_printed_exchange_is_unproven():
    found = unproven(installed["huanyang"])
    assert "no printed exchange shows reset" in found
    assert "no printed exchange shows start" not in found


def test_command_is_unproven_without_its_printed_vectors(monkeypatch):
    real = packaged_vectors(installed["huanyang"])
    vectors = [replace(each, printed=False) for each in real.vectors]
    exchanges = [replace(each, printed=False) for each in real.exchanges]
    changed = replace(real, vectors=tuple(vectors), exchanges=tuple(exchanges))
    monkeypatch.setattr("drivecomm.testing.unproven.packaged_vectors", lambda _: changed)
    assert "no printed exchange shows start" in unproven(installed["huanyang"])


def test_preparing_request_without_a_printed_exchange_is_unproven():
    """Master and virtual drive can be wrong together in a preparing request, such as the selection of a page."""
    assert any("parameter=18" in each and "prepares a read" in each for each in unproven(installed["vabus"]))


def test_only_a_full_report_lists_unproven_commands():
    report = make_report(installed["huanyang"], [])
    assert "unproven: no printed exchange shows reset" in notes_of(report)
    assert not make_report(installed["huanyang"], [], only="contract").unproven
