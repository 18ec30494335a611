"""The cohabitation check: a proof shows telegrams that the other drive really takes, and a safe drive stays silent."""

import re
import sys
from dataclasses import replace
from functools import cache
from importlib import import_module
from pathlib import Path
from random import Random

import pytest
from extents import extents
from hypothesis import given, strategies as st

from drivecomm.errors import AddressError, UnknownProtocolError
from drivecomm.protocol import DriveConfig, Framed, Framer, LineSettings, installed
from drivecomm.protocol.schema import constant
from drivecomm.testing import packaged_vectors
from drivecomm.traffic.cohabitation import (
    Reader,
    Safety,
    arbitrary_telegrams,
    character_map,
    check,
    check_line,
    listen,
    partners_of,
    readable,
    try_out,
    wait_for,
)
from drivecomm.virtual import VirtualLine, heard, virtual_drive

pytestmark = pytest.mark.soak

ROOT = Path(__file__).parents[2]
EIGHT = {"baudrate": 9600, "bytesize": 8, "parity": "N", "stopbits": 1}
SEVEN = {"baudrate": 9600, "bytesize": 7, "parity": "E", "stopbits": 1}

VABUS = DriveConfig(protocol="vabus", address=1, options=SEVEN)
VABUS_8 = DriveConfig(protocol="vabus", address=1, options=EIGHT)
VABUS_2 = DriveConfig(protocol="vabus", address=2, options=SEVEN)
FC = DriveConfig(protocol="danfoss-fc", address=3, options={"baudrate": 9600, "parity": "E"})
FC_8 = DriveConfig(protocol="danfoss-fc", address=3, options={**EIGHT, "address_format": "1-31"})
FC_8_LONG = DriveConfig(protocol="danfoss-fc", address=3, options=EIGHT)
FC_8_OTHER = DriveConfig(protocol="danfoss-fc", address=4, options=EIGHT)
FUJI = DriveConfig(protocol="fuji", address=1, options=EIGHT)
FUJI_2 = DriveConfig(protocol="fuji", address=2, options=EIGHT)
VLT = DriveConfig(protocol="vlt3500", address=1, options=EIGHT)
VLT_2 = DriveConfig(protocol="vlt3500", address=2, options=EIGHT)

USS = DriveConfig(protocol="uss", address=3, options={"baudrate": 9600, "parity": "E"})
FC_LIKE_USS = DriveConfig(
    protocol="danfoss-fc", address=3, options={"baudrate": 9600, "parity": "E", "address_format": "1-31"}
)

MODBUS = DriveConfig(protocol="modbus", address=1, options={**EIGHT, "model": "delta"})
HUANYANG = DriveConfig(protocol="huanyang", address=1, options=EIGHT)

TAKEN = [
    (FC, VABUS),
    (FC_8, VABUS_8),
    (FC_8, FUJI),
    (FC_8, VLT),
    (VLT, VABUS),
    (VLT, FUJI),
    (VLT, FC_8),
    (VLT, FC_8_LONG),
    (VABUS_8, VLT),
    (VABUS, DriveConfig(protocol="vabus", address=1, name="twin", options=SEVEN)),
    (FC_LIKE_USS, USS),
    (USS, FC_LIKE_USS),
    (MODBUS, HUANYANG),
    (HUANYANG, MODBUS),
]
UNHEARD = [(VABUS_8, FC_8), (VABUS_8, FC_8_LONG)]
SAFE = [
    (VABUS_8, FUJI),
    (FUJI, VABUS_8),
    (FUJI, VABUS),
    (VABUS, VLT),
    (FUJI, FC_8),
    (FUJI, VLT),
    (VABUS, VABUS_2),
    (FUJI, FUJI_2),
    (FC_8, FC_8_OTHER),
    (VLT, VLT_2),
]


def named(pair):
    return " to ".join(f"{each.name} {each.options.get('parity')}" for each in pair)


@pytest.fixture(scope="module")
def partner():
    """Return a function that gives the partner of a drive; partners share their protocols' data, as on one line."""
    every = {id(each): each for pair in (*TAKEN, *UNHEARD, *SAFE) for each in pair}
    partners = dict(zip(every, partners_of(every.values()), strict=True))
    return lambda drive: partners[id(drive)]


@pytest.fixture(scope="module")
def verdict(partner):
    return cache(lambda speaker, listener: listen(partner(speaker), partner(listener)))


class Bystander:
    """A virtual drive alone on a virtual line, and the telegrams of foreign traffic that it takes for its own."""

    def __init__(self, drive, speaker):
        self.drive = virtual_drive(drive.protocol, drive.address, **drive.options)
        self.line = VirtualLine([self.drive])
        self.line.configure(speaker.settings)
        self.answered = []
        self.line.monitors.append(lambda sent: self.answered.append(sent.data) if sent.source == "drive" else None)
        self.heard = []
        hear = self.drive.hear

        def spy(find, now):
            self.heard.append(find)
            return hear(find, now)

        self.drive.hear = spy

    def play(self, telegrams):
        for data in telegrams:
            self.line.transmit(data)
            # Less than the silence that ends a telegram.
            self.line.advance(len(data) * 0.0012 + 0.005)

    def took(self, listener):
        return [find.data for find in self.heard if isinstance(find, Framed) and listener.is_meant(find.message)]


@pytest.mark.parametrize("pair", TAKEN, ids=named)
def test_telegrams_of_a_proof_are_taken_by_the_virtual_drive(pair, partner, verdict):
    speaker, listener = map(partner, pair)
    found = verdict(*pair)
    assert found.outcome is Safety.TAKEN
    proof = found.proof
    bystander = Bystander(pair[1], speaker)
    bystander.play(each.data for each in proof.telegrams)
    assert proof.taken in bystander.took(listener)


@pytest.mark.parametrize("pair", TAKEN, ids=named)
def test_telegrams_of_a_proof_are_sound_and_come_from_the_speaker(pair, verdict):
    for each in verdict(*pair).proof.telegrams:
        codec = installed[pair[0].protocol].codec(_options(pair[0]))
        message = codec.decode(each.data, each.direction)
        assert codec.encode(message) == each.data
        address = getattr(message, "address", pair[0].address)
        assert address in (pair[0].address, None, installed[pair[0].protocol].broadcast_address)


def _options(drive):
    plugin = installed[drive.protocol]
    own = plugin.options.__dataclass_fields__
    return plugin.options(**{name: value for name, value in drive.options.items() if name in own})


@pytest.mark.parametrize(
    ("pair", "outcome"),
    [*((pair, Safety.SAFE) for pair in SAFE), *((pair, Safety.UNHEARD) for pair in UNHEARD)],
    ids=lambda value: named(value) if isinstance(value, tuple) else "",
)
@extents(20, 100)
def test_safe_drive_stays_silent_under_random_foreign_traffic(pair, outcome, partner, verdict, extent):
    speaker, listener = map(partner, pair)
    assert verdict(*pair).outcome is outcome
    related = pair[0].protocol == pair[1].protocol
    spoken = [each for each in speaker.spoken if not (related and each.to_all)]
    bystander = Bystander(pair[1], speaker)
    chance = Random(7)
    for _ in range(extent):
        bystander.play(each.data for each in arbitrary_telegrams(spoken, speaker, listener.settings, chance, 20))
        bystander.line.advance(1.0)
    assert not bystander.took(listener)
    assert not bystander.answered


@pytest.mark.parametrize(
    "pair", [each for each in (*SAFE, *UNHEARD) if each[0].protocol != each[1].protocol], ids=named
)
def test_safe_drive_stays_silent_at_the_vectors_of_the_other_protocol(pair, partner):
    """These telegrams were not made from the forms."""
    speaker, listener = map(partner, pair)
    plugin = installed[pair[0].protocol]
    telegrams = [vector.data for vector in packaged_vectors(plugin).vectors if vector.valid]
    bystander = Bystander(pair[1], speaker)
    bystander.play(telegrams)
    assert len(telegrams) > 20
    assert not bystander.took(listener)


@pytest.mark.parametrize("drive", [VABUS, FC, FUJI, VLT], ids=lambda drive: drive.protocol)
def test_places_of_the_forms_hold_every_vector(drive, partner):
    """An exclusion by places also applies to telegrams of other programs."""
    plugin = installed[drive.protocol]
    dialect = partner(drive).dialect
    every = [*dialect.written, *dialect.read]
    seen = 0
    for vector in packaged_vectors(plugin).vectors:
        if not vector.valid or vector.options:
            continue
        seen += 1
        assert any(each.direction == vector.direction and _holds(each, vector.data) for each in every), vector.id
    assert seen > 20


def _holds(outline, data):
    runs = [number for number, place in enumerate(outline.places) if place.repeats]
    size = len(data) - len(outline.places) + len(runs)
    if size < 0 or (size and not runs):
        return False
    allowed = []
    for place in outline.places:
        allowed.extend([place.allowed] * (size if place.repeats else 1))
    return len(allowed) == len(data) and all(code in each for code, each in zip(data, allowed, strict=True))


def test_seven_bit_drive_receives_eight_bit_traffic_without_bit_7(verdict):
    proof = verdict(FC, VABUS).proof
    assert any(each.data != each.heard for each in proof.telegrams)
    assert all(each.heard == bytes(code & 0x7F for code in each.data) for each in proof.telegrams)


def test_eight_bit_drive_receives_the_parity_of_seven_bit_traffic(partner, verdict):
    """`>` has an odd number of ones, so its parity bit turns it into another character, and no VLT telegram ends."""
    hears = character_map(partner(VABUS).settings, partner(VLT).settings)
    assert hears[ord(">")] == ord(">") | 0x80
    assert all(code.bit_count() % 2 == 0 for code in hears)
    assert verdict(VABUS, VLT).outcome is Safety.SAFE
    assert verdict(VABUS_8, VLT).outcome is Safety.TAKEN


def test_address_format_of_a_drive_is_the_one_of_its_requests(partner):
    short, long = ({each.places[2].allowed for each in partner(drive).spoken} for drive in (FC_8, FC_8_LONG))
    assert short == {frozenset([0x03]), frozenset([0x20])}
    assert long == {frozenset([0x83]), frozenset([0x80])}


def test_drives_at_other_baud_rates_are_only_tried_and_reported_so():
    found = check_line([DriveConfig(protocol="vabus", address=1), VABUS_2])
    assert {each.outcome for each in found.drives} == {Safety.UNHEARD}
    assert found.safe
    assert all("arbitrary telegrams" in each.reason for each in found.drives)
    assert "as far as it was tried" in found.advice[0]


def test_equal_lines_give_equal_results():
    line = [VABUS, DriveConfig(protocol="vabus", address=1, name="twin", options=SEVEN)]
    assert check_line(line) == check_line(line)


def test_drives_of_one_protocol_with_different_addresses_are_safe():
    found = check_line([FUJI, FUJI_2])
    assert found.safe
    assert all(each.outcome is Safety.SAFE for each in (*found.drives, *found.master))
    assert found.advice == ("safe: these drives can share the line with these addresses and settings",)


def test_two_drives_with_one_address_are_advised_to_change_it():
    found = check_line([VABUS, DriveConfig(protocol="vabus", address=1, name="twin", options=SEVEN)])
    assert not found.safe
    assert found.drives[0].proof.offset == 0
    assert "another address" in found.advice[0]


def test_late_reply_that_the_master_would_accept_is_proved(partner):
    found = wait_for(partner(VABUS_8), partner(VLT))
    assert found.outcome is Safety.TAKEN
    reply = b"".join(each.heard for each in found.proof.telegrams)
    codec = installed["vabus"].codec(_options(VABUS_8))
    finds = Framer(codec, "reply").feed(reply)
    assert found.proof.taken in [find.data for find in finds if isinstance(find, Framed)]
    assert codec.decode(found.proof.taken, "reply").address == 1


def test_master_waiting_for_a_drive_rejects_replies_of_another(partner):
    assert wait_for(partner(VLT), partner(VLT_2)).outcome is Safety.SAFE


def test_pair_without_proof_or_exclusion_stays_open(partner, monkeypatch):
    monkeypatch.setattr(check, "find_proof", lambda *_: None)
    found = listen(partner(FC), partner(VABUS))
    assert found.outcome is Safety.OPEN
    assert not found.safe
    assert found.proof is None
    assert "leave room for" in found.reason


def test_trial_shows_the_telegram_taken_and_its_place(partner):
    """A VABus drive reads EOT alone as a telegram, and FC telegrams that it cannot parse sometimes contain one."""
    speaker, listener = partner(FC), partner(VABUS)
    settings = LineSettings(baudrate=9600, bytesize=7, parity="N")
    assert character_map(speaker.settings, settings) is None
    reader = Reader(codec=listener.ear, direction="request", means=lambda message: message.kind == "eot")
    proof = try_out(speaker.spoken, speaker, settings, reader, Random(1))
    text = b"".join(each.heard for each in proof.telegrams)
    assert text[proof.offset : proof.offset + len(proof.taken)] == proof.taken == b"\x04"
    assert all(each.heard == heard(each.data, speaker.settings, settings) for each in proof.telegrams)
    assert proof.bits is None


def test_invalid_drives_are_refused():
    with pytest.raises(AddressError):
        check_line([VABUS, DriveConfig(protocol="vabus", address=99)])
    with pytest.raises(UnknownProtocolError):
        check_line([VABUS, DriveConfig(protocol="nobody", address=1)])


SETTINGS = st.builds(
    LineSettings,
    baudrate=st.sampled_from([9600, 19200]),
    bytesize=st.sampled_from([7, 8]),
    parity=st.sampled_from("NEOMS"),
    stopbits=st.sampled_from([1, 2]),
)


@given(SETTINGS, SETTINGS, st.binary(min_size=1, max_size=12))
def test_character_map_predicts_the_characters_received(sender, receiver, data):
    known = character_map(sender, receiver)
    if known is not None:
        assert heard(data, sender, receiver) == data.translate(known)


@pytest.fixture
def toy(tmp_path, monkeypatch):
    """Yield the protocol of the documentation page about writing one, which the check has never seen."""
    page = (ROOT / "docs" / "development" / "write-a-protocol.md").read_text(encoding="utf-8")
    for name, content in re.findall(
        r'^```\w+ title="(drivecomm_toy/[^"]+)"\n(.*?)^```$', page, re.MULTILINE | re.DOTALL
    ):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(content, encoding="utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    protocol = import_module("drivecomm_toy").protocol
    undo = installed.register(protocol)
    yield protocol
    undo()
    for name in [name for name in sys.modules if name.partition(".")[0] == "drivecomm_toy"]:
        del sys.modules[name]


def test_protocol_of_another_package_is_checked_like_ours(toy):
    address, other = toy.addresses[0], toy.addresses[1]
    stranger = DriveConfig(protocol=toy.name, address=address, options=EIGHT)
    found = check_line([stranger, FC_8, DriveConfig(protocol=toy.name, address=other, options=EIGHT)])
    outcomes = {(each.speaker, each.listener): each for each in found.drives}
    assert len(outcomes) == 6
    assert outcomes[stranger.name, f"{toy.name}:{other}"].outcome is Safety.SAFE
    proof = outcomes[FC_8.name, stranger.name].proof
    listener, speaker = partners_of([stranger, FC_8])
    bystander = Bystander(stranger, speaker)
    bystander.play(each.data for each in proof.telegrams)
    assert proof.taken in bystander.took(listener)


def test_constant_of_several_characters_matches_only_itself():
    assert readable(constant(b"\r\n")) == (frozenset(b"\r"), frozenset(b"\n"))


def test_two_modbus_drives_of_one_series_can_share_a_line():
    drives = [replace(MODBUS, address=address, name=f"pump{address}") for address in (1, 2)]
    found = check_line(drives)
    assert found.safe
    assert all(each.outcome is Safety.SAFE for each in (*found.drives, *found.master))
    assert [each for each in found.advice if "safe" not in each] == []
