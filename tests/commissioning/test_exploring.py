"""Exploration of all addresses that a drive may hold: answers, refusals, silence, and resumption after a cut."""

import asyncio
import json
import re
from dataclasses import replace
from pathlib import Path

import pytest

import drivecomm
from drivecomm.bus import carry_out, read_parameter
from drivecomm.commissioning import growth_plan, growth_request
from drivecomm.commissioning.exploring import (
    Logbook,
    NoAnswerRecord,
    course,
    explore,
    explore_async,
    exploring,
    forecasting,
    logbook_path,
)
from drivecomm.commissioning.exploring.exploring import PAUSES_S
from drivecomm.commissioning.parameter_sets import (
    PARTS,
    back_up,
    back_up_everything,
    back_up_everything_async,
    backup_plan,
    compare,
    plan_restore,
    read_set,
    share_of,
    subject,
    text_of,
    write_set,
)
from drivecomm.errors import FileFormatError, NoReplyError, NotSupported, RefusedError
from drivecomm.models import load_model
from drivecomm.protocol import Reading, installed
from drivecomm.virtual import VirtualLine, virtual_drive

PAIRS = [
    # protocol, model of the virtual drive, model known to the master, addresses that only the virtual drive has
    ("vabus", "guesses", "agile", {"29", "524"}),
    ("vlt3500", "vlt3500", "vlt2000", {"601[0,0]", "601[19,9]", "602[10,2]"}),
    ("danfoss-fc", "vlt5000", "vlt6000", {"105", "615[10]"}),
    ("fuji", "frenic", "frenic", set()),
]


def line_with(protocol, model, **options):
    return VirtualLine([virtual_drive(protocol, 1, model=model, **options)])


def taken_for(bus, protocol, model, **options):
    return bus.drive(protocol, 1, model=model, **options)


@pytest.fixture
def vabus():
    """Return a line with a drive that holds more parameters than its model knows."""
    return line_with("vabus", "guesses")


@pytest.mark.soak
@pytest.mark.parametrize(("protocol", "real", "model", "more"), PAIRS)
def test_exploration_finds_known_and_unknown_parameters(protocol, real, model, more):
    with drivecomm.open_bus(line_with(protocol, real).port) as bus:
        drive = taken_for(bus, protocol, model)
        known, found = back_up(drive, PARTS), back_up_everything(drive)
    assert {address: entry for address, entry in found.entries.items() if entry.part != "unknown"} == known.entries
    assert found.not_read == known.not_read
    unknown = {entry.address for entry in found.of(["unknown"])}
    assert more <= unknown
    assert found.explored.known == len(known.entries)
    assert found.explored.answered == len(known.entries) + len(unknown)


@pytest.mark.parametrize(("protocol", "real", "model", "more"), PAIRS)
def test_exploration_sends_only_reads(protocol, real, model, more):
    line, sent = line_with(protocol, real), []
    hear = line.drives[0].hear
    line.drives[0].hear = lambda find, now: (sent.append(find.message), hear(find, now))[1]
    with drivecomm.open_bus(line.port) as bus:
        back_up_everything(taken_for(bus, protocol, model), within=list(more))
    assert sent
    assert all(installed[protocol].intent(message).only_asks for message in sent)


def test_differing_data_sets_are_read_one_by_one(vabus):
    for dataset in range(1, 5):
        vabus.drives[0].poke(f"481[{dataset}]", dataset)
    model = load("vabus", "agile", without="481")
    with drivecomm.open_bus(vabus.port) as bus:
        found = back_up_everything(taken_for(bus, "vabus", model), within=["481"])
    assert [entry.address for entry in found.of(["unknown"])] == ["481[1]", "481[2]", "481[3]", "481[4]"]
    assert "481" not in found.not_read


class Scripted:
    """Drive that answers the given addresses and refuses all others."""

    def __init__(self, *answered):
        self.answered, self.asked = answered, []

    def read(self, address):
        self.asked.append(address)
        if not any(re.fullmatch(each, address) for each in self.answered):
            raise RefusedError(address, 3 if "[" in address else 0, "no")
        return Reading(parameter=address, value=1, raw=1)

    def on(self, *rest):
        plugin = installed["danfoss-fc"]
        way = course(plugin, load_model(plugin.package, "danfoss-fc", "vlt6000"), known=[], within=rest)
        answers = carry_out(self, exploring(way, read_parameter, NoAnswerRecord(), lambda _step: None))
        return [answer.address for answer in answers if answer.told is not None]


def test_array_is_read_to_its_end():
    drive = Scripted("215", r"215\[[1-3]\]", "216")
    assert drive.on("215", "216") == ["215", "215[1]", "215[2]", "215[3]", "216"]
    assert drive.asked == ["215", "215[1]", "215[255]", "215[2]", "215[3]", "215[4]", "216", "216[1]"]


def test_array_may_count_from_1():
    assert Scripted(r"216\[[12]\]").on("215", "216") == []
    drive = Scripted(r"215\[[12]\]")
    drive.read = lambda address, read=drive.read: read(address if "[" in address else f"{address}[0]")
    assert drive.on("215") == ["215[1]", "215[2]"]


def test_drive_that_ignores_the_index_has_no_array_elements():
    drive = Scripted("215.*", "216.*")
    assert drive.on("215", "216") == ["215", "216"]
    assert len(drive.asked) == 6


def load(protocol, name, without):
    model = load_model(installed[protocol].package, protocol, name)
    return replace(
        model, parameters={address: info for address, info in model.parameters.items() if address != without}
    )


def test_silent_address_between_answering_ones_counts_as_missing():
    line = line_with("vabus", "guesses", silent_on=(11,))
    with drivecomm.open_bus(line.port) as bus:
        found = back_up_everything(taken_for(bus, "vabus", "agile"), within=["29", "30", "31"])
    assert [entry.address for entry in found.of(["unknown"])] == ["29"]
    assert found.not_read == {}


class TestSilentDrive:
    def test_silent_drive_is_retried_after_pauses(self, vabus):
        with drivecomm.open_bus(vabus.port) as bus:
            drive = taken_for(bus, "vabus", "agile")
            away = _DriveSilencer(vabus, after=120, for_s=sum(PAUSES_S[:2]))
            found = back_up_everything(drive, within=["29"], progress=away)
        assert "29" in found.entries

    def test_lasting_silence_ends_the_run_and_the_next_run_resumes(self, vabus, tmp_path):
        path = tmp_path / "pump.toml.answers"
        with drivecomm.open_bus(vabus.port) as bus:
            drive = taken_for(bus, "vabus", "agile")
            logbook = Logbook(path, drive="vabus:1", model=drive.model, asked="values")
            away = _DriveSilencer(vabus, after=50, for_s=1e9)
            with pytest.raises(NoReplyError, match=r"fell silent before .*, and stayed so for 48 s"):
                back_up_everything(drive, logbook, within=["29"], progress=away)
            logbook.close()
        steps = []
        again = line_with("vabus", "guesses")
        with drivecomm.open_bus(again.port) as bus:
            drive = taken_for(bus, "vabus", "agile")
            logbook = Logbook(path, drive="vabus:1", model=drive.model, asked="values")
            assert len(logbook.answers) == 50
            found = back_up_everything(drive, logbook, within=["29"], progress=steps.append)
            logbook.over()
            whole = back_up_everything(drive, within=["29"])
        assert [step.remembered for step in steps] == [True] * 50 + [False] * (len(steps) - 50)
        assert (found.entries, found.explored) == (whole.entries, whole.explored)
        assert list(tmp_path.iterdir()) == []


class _DriveSilencer:
    """Progress callback that silences the drive for `for_s` seconds after `after` answers."""

    def __init__(self, line, after, for_s):
        self.line, self.after, self.for_s = line, after, for_s
        self.heard = line.drives[0].hear
        self.since = None

    def __call__(self, step):
        if step.asked == self.after:
            self.since = self.line.time
            self.line.drives[0].hear = self.hear

    def hear(self, find, now):
        return None if now < self.since + self.for_s else self.heard(find, now)


class TestLogbook:
    MODEL = load_model(installed["vabus"].package, "vabus", "agile")

    @pytest.fixture
    def path(self, tmp_path, vabus):
        path = tmp_path / "pump.toml.answers"
        with drivecomm.open_bus(vabus.port) as bus:
            logbook = self.opened(path)
            back_up_everything(taken_for(bus, "vabus", "agile"), logbook, within=["29", "30"])
            logbook.close()
        return path

    def opened(self, path, **other):
        return Logbook(path, **{"drive": "vabus:1", "model": self.MODEL, "asked": "values", **other})

    def test_logbook_lies_beside_the_file(self):
        assert logbook_path(Path("saved/pump.toml")) == Path("saved/pump.toml.answers")

    def test_logbook_remembers_answers_exactly(self, path, vabus):
        sent = []
        with drivecomm.open_bus(vabus.port, trace=sent.append) as bus:
            drive = taken_for(bus, "vabus", "agile")
            again = back_up_everything(drive, self.opened(path), within=["29", "30"])
            anew = back_up_everything(drive, within=["29", "30"])
        assert again.entries == anew.entries
        assert text_of(again).partition("[settings]")[2] == text_of(anew).partition("[settings]")[2]

    @pytest.mark.parametrize(
        ("other", "said"),
        [
            ({"drive": "vabus:2"}, "replies of drive vabus:1, not of vabus:2"),
            ({"model": None}, "replies of model agile, not of"),
            ({"model": load_model(installed["vabus"].package, "vabus", "act")}, "of model agile, not of act"),
            ({"asked": "descriptions"}, "replies to another command"),
            ({"model": load("vabus", "agile", without="481")}, "model agile was changed since"),
        ],
    )
    def test_logbook_of_another_drive_model_or_command_is_refused(self, path, other, said):
        with pytest.raises(FileFormatError, match=said):
            self.opened(path, **other)

    def test_logbook_of_another_serial_number_is_refused(self, path):
        logbook = self.opened(path)
        with pytest.raises(FileFormatError, match="another drive at the same address: its serial number is 'B'"):
            logbook.begin({"serial number": "B"})

    @pytest.mark.parametrize("text", ["[]\n", "nonsense\n", '{"drive": "vabus:1"}\n', '{"identity": 3}\n', "\x00\n"])
    def test_malformed_logbook_is_refused(self, path, text):
        path.write_text(text, encoding="utf-8")
        with pytest.raises(FileFormatError):
            self.opened(path)

    def test_cut_off_line_of_a_logbook_is_ignored(self, path):
        whole = path.read_text(encoding="utf-8")
        path.write_text(whole[:-5], encoding="utf-8")
        logbook = self.opened(path)
        assert len(logbook.answers) == whole.count("\n") - 2
        last = json.loads(whole.splitlines()[-1])
        assert last["address"] not in logbook.answers
        path.write_text(whole[:20], encoding="utf-8")
        assert self.opened(path).answers == {}


def test_unknown_values_are_marked_in_the_file_and_never_restored(vabus, tmp_path):
    path = tmp_path / "pump.toml"
    with drivecomm.open_bus(vabus.port) as bus:
        drive = taken_for(bus, "vabus", "agile")
        found = back_up_everything(drive, within=["29"])
        write_set(path, found)
        plan = plan_restore(drive, read_set(path))
    text = path.read_text(encoding="utf-8")
    assert 'never restored.\n[unknown]\n"29" = { value = ' in text
    assert "[explored]\nasked = 106\nanswered = 106\nknown = 105\n" in text
    assert read_set(path) == found
    assert not [item for item in plan.items if item.address == "29"]
    assert "1 value left alone, because model agile does not know their types" in plan.remarks
    assert compare(found, found, PARTS).same


def test_raw_values_equal_those_that_a_better_model_reads(vabus):
    with drivecomm.open_bus(vabus.port) as bus:
        raw = back_up_everything(taken_for(bus, "vabus", "agile"), within=["29", "524"])
        known = back_up(taken_for(bus, "vabus", "guesses"), PARTS)
    found = compare(raw, known, PARTS)
    assert "29" not in [each.address for each in found.differences]
    other = compare(raw, known, PARTS)
    assert other.shares[0].held == 105


def test_share_counts_the_values_that_a_set_holds(vabus):
    with drivecomm.open_bus(vabus.port) as bus:
        drive = taken_for(bus, "vabus", "agile")
        settings, everything = back_up(drive), back_up(drive, PARTS)
    share = share_of(settings, drive.model)
    assert (share.held, share.of) == (len(settings.entries), len(everything.entries))
    assert str(share_of(everything, drive.model)) == "105 of the 105 values that model agile knows (100 %)"


def test_exploration_needs_the_address_space_of_the_package():
    stranger = replace(installed["vabus"], address_space=None)
    with pytest.raises(NotSupported, match="does not list the addresses of a vabus drive"):
        course(stranger, None, known=[])


@pytest.mark.soak
def test_forecast_is_near_the_actual_duration(vabus):
    with drivecomm.open_bus(vabus.port) as bus:
        drive = taken_for(bus, "vabus", "agile")
        way = backup_plan(subject(drive))
        foreseen = carry_out(drive, forecasting(way, remembered=40))
        begun = vabus.time
        back_up_everything(drive)
        took = vabus.time - begun
    assert foreseen.addresses == len(way) - 40
    assert 0.5 < foreseen.seconds / took < 2


def test_logbook_remembers_descriptions(tmp_path):
    path = tmp_path / "own.toml.answers"
    plugin = installed["danfoss-fc"]
    steps, asks = [], growth_request(plugin, None, {"option_texts": 3})
    with drivecomm.open_bus(line_with("danfoss-fc", "fc302").port) as bus:
        drive = bus.drive("danfoss-fc", 1)
        way = growth_plan(plugin, None, ["3-41", "8-04", "15-40", "15-99"])
        logbook = Logbook(path, drive=drive.name, model=None, asked="parameters")
        told = explore(drive, way, asks, logbook)
        logbook.close()
        again = Logbook(path, drive=drive.name, model=None, asked="parameters")
        assert explore(drive, way, asks, again, progress=steps.append) == told
    assert all(step.remembered for step in steps)
    assert [answer.absent for answer in told] == [False, False, False, True]
    assert told[1].told.values[0] == "off"


def test_awaited_exploration_finds_the_same(vabus):
    async def found():
        async with drivecomm.open_bus_async(vabus.port) as bus:
            drive = taken_for(bus, "vabus", "agile")
            way = growth_plan(installed["vabus"], drive.model, ["29", "31"])
            answers = await explore_async(drive, way, read_parameter)
            return await back_up_everything_async(drive, within=["29"]), answers

    saved, answers = asyncio.run(found())
    assert saved.explored.answered == 106
    assert [answer.absent for answer in answers] == [False, True]
