"""Wide scans find drives at unusual settings, try likely settings first, and move no motor."""

import dataclasses

import pytest

import drivecomm
from drivecomm.bus import Asking, Found, LineChoices, Search, likely_settings
from drivecomm.errors import UsageError
from drivecomm.models import load_model
from drivecomm.protocol import LineSettings, installed
from drivecomm.virtual import VirtualLine, virtual_drive

ODD = {
    "danfoss-fc": (7, LineSettings(baudrate=38400, bytesize=8, parity="N")),
    "fuji": (2, LineSettings(baudrate=4800, bytesize=7, parity="E")),
    "vabus": (5, LineSettings(baudrate=9600, bytesize=7, parity="E")),
    "vlt3500": (1, LineSettings(baudrate=2400, bytesize=8, parity="N")),
}


def odd_drive(protocol, address, settings):
    return virtual_drive(
        protocol,
        address,
        baudrate=settings.baudrate,
        bytesize=settings.bytesize,
        parity=settings.parity,
        stopbits=settings.stopbits,
    )


def odd_line(**options):
    return VirtualLine([odd_drive(name, address, settings) for name, (address, settings) in ODD.items()], **options)


class Sent:
    """A trace function that collects the sent telegrams."""

    def __init__(self):
        self.events = []

    def __call__(self, event):
        if event.what == "sent":
            self.events.append(event)


@pytest.mark.soak
def test_wide_scan_finds_four_makers_at_odd_settings_and_moves_nothing():
    line, sent = odd_line(), Sent()
    before = [dataclasses.replace(drive.settings) for drive in line.drives]
    with drivecomm.open_bus(line.port, trace=sent) as bus:
        found = list(bus.scan(addresses=range(1, 8), choices=LineChoices()))
    # A VABus drive answers the probes for WEG drives; both packages document that they look alike.
    assert {(one.protocol, one.address): one.settings for one in found if one.sound and one.protocol != "weg"} == {
        (name, address): settings for name, (address, settings) in ODD.items()
    }
    assert [drive.settings for drive in line.drives] == before
    assert not any(drive.motor.running or drive.motor.output_hz for drive in line.drives)
    assert len(sent.events) > 1000
    for event in sent.events:
        assert installed[event.drive.partition(":")[0]].intent(event.message).only_asks, event


def test_found_drive_can_be_used():
    line = odd_line()
    with drivecomm.open_bus(line.port) as bus:
        wanted = LineChoices(baudrates=(38400,), parities=("N",))
        (found,) = bus.scan(["danfoss-fc"], choices=wanted)
        drive = found.drive.build(bus.drive)
        assert not drive.status().running
        assert drive.facts.settings == ODD["danfoss-fc"][1]


def test_wide_scan_tries_the_usual_settings_first():
    order = [(asking.protocol, asking.settings) for asking in Search(choices=LineChoices())]
    first = list(dict.fromkeys(order))[: len(installed)]
    assert first == [(name, installed[name].facts.settings) for name in installed]


def test_likely_settings_of_all_protocols_come_before_unlikely_ones():
    search = Search(choices=LineChoices())
    place = {}
    for number, asking in enumerate(search):
        place.setdefault((asking.protocol, asking.settings), number)
    for name in installed:
        own = [number for (protocol, _), number in place.items() if protocol == name]
        for other in installed:
            theirs = [number for (protocol, _), number in place.items() if protocol == other]
            # The third-best setting of each protocol comes before the tenth-best of any.
            assert sorted(own)[2] < sorted(theirs)[9]


def test_baud_rates_named_by_a_model_come_before_others():
    plugin = installed["vabus"]
    models = [packaged_model("vabus", "agile")]
    rates = list(dict.fromkeys(each.settings.baudrate for each in likely_settings(plugin, models)))
    assert rates[0] == 19200
    assert set(rates[1:4]) == {9600, 4800, 2400}
    assert {38400, 57600, 115200} <= set(rates[4:])


def packaged_model(protocol, name):
    return load_model(installed[protocol].package, protocol, name)


def test_seven_bits_are_not_tried_for_eight_bit_telegrams():
    sizes = {
        name: {asking.settings.bytesize for asking in Search([name], [1], LineChoices())}
        for name in ("danfoss-fc", "vabus", "fuji")
    }
    assert sizes == {"danfoss-fc": {8}, "vabus": {7, 8}, "fuji": {7, 8}}


def test_only_the_chosen_settings_are_tried():
    choices = LineChoices(baudrates=(9600, 300), parities=("E", "M"))
    tried = {(each.settings.baudrate, each.settings.parity) for each in Search(["vabus"], [1], choices)}
    assert tried == {(9600, "E"), (300, "E"), (9600, "M"), (300, "M")}
    with pytest.raises(UsageError, match="parity 'X'"):
        LineChoices(parities=("X",))
    with pytest.raises(UsageError, match="baud rate of 3"):
        LineChoices(baudrates=(9600, 3))


def test_found_drive_moves_its_settings_and_protocol_forward():
    search = Search(["vabus", "fuji"], range(1, 8), LineChoices())
    met = LineSettings(baudrate=4800, bytesize=7, parity="E")
    asked = []
    for asking in search:
        asked.append(asking)
        there = asking.settings == met and asking.protocol == "vabus" and asking.address == 2
        search.heard(asking, Found(protocol="vabus", address=2, sound=True, settings=met) if there else None)
        if there:
            break
    first = [next(iter(search)) for _ in range(5)]
    assert {(each.protocol, each.settings) for each in first} == {("vabus", met)}
    left = search.left
    assert (left[0].settings, left[0].protocol) == (met, "fuji")
    assert not any(each.protocol == "vabus" and each.address == 2 for each in left)
    assert len({(each.protocol, each.address, each.settings) for each in [*asked, *first, *left]}) == len(
        [*asked, *first, *left]
    )


def test_damaged_reply_moves_its_address_forward_and_is_reported_at_the_end():
    search = Search(["vabus"], [1, 2], LineChoices())
    first = next(iter(search))
    spoilt = Found(protocol="vabus", address=first.address, sound=False, detail="checksum")
    assert search.heard(first, spoilt) is None
    assert next(iter(search)).address == first.address
    assert search.damaged() == [spoilt]
    met = Found(protocol="vabus", address=first.address, sound=True)
    assert search.heard(Asking(protocol="vabus", address=first.address), met) is met
    assert search.damaged() == []


class TestIdentification:
    def found(self, identity):
        return Found(protocol="danfoss-fc", address=1, identity=identity, sound=True)

    def search(self, *models):
        search = Search([], [])
        search._models["danfoss-fc"] = list(models)
        return search

    def model(self, name, **rules):
        plain = packaged_model("danfoss-fc", "fc101")
        return dataclasses.replace(plain, name=name, identified_by=rules)

    def test_model_is_chosen_by_its_identity_rules(self):
        search = self.search(self.model("one", plate="FC-1.*"), self.model("two", plate="FC-2.*"), self.model("none"))
        assert search.model_of(self.found({"plate": "FC-202"})).model == "two"
        assert search.model_of(self.found({"plate": "FC-302"})).model == ""
        assert search.model_of(self.found({})).model == ""

    def test_ambiguous_identity_names_no_model(self):
        search = self.search(self.model("one", plate="FC.*"), self.model("two", plate="FC-2.*"))
        assert search.model_of(self.found({"plate": "FC-202"})).model == ""

    def test_invalid_model_file_does_not_end_a_scan(self, tmp_path, monkeypatch):
        folder = tmp_path / "vabus"
        folder.mkdir()
        (folder / "broken.toml").write_text("format = 9")
        monkeypatch.setenv("DRIVECOMM_MODELS", str(tmp_path))
        line = VirtualLine([virtual_drive("vabus", 1)])
        with drivecomm.open_bus(line.port) as bus:
            assert [one.name for one in bus.scan(["vabus"], [1])] == ["vabus:1"]

    @pytest.mark.parametrize("model", ["fc101", "fc102", "fc202", "fc302", "vlt5000", "vlt6000"])
    def test_scan_recognises_models_by_the_name_plate(self, model):
        line = VirtualLine([virtual_drive("danfoss-fc", 3, model=model)])
        with drivecomm.open_bus(line.port) as bus:
            (found,) = bus.scan(["danfoss-fc"], [3])
        assert found.model == model
        assert found.drive.options["model"] == model

    def test_scan_recognises_a_user_model(self, tmp_path, monkeypatch):
        # A name plate that matches no packaged model.
        folder = tmp_path / "danfoss-fc"
        folder.mkdir()
        (folder / "mine.toml").write_text(
            'format = 1\nprotocol = "danfoss-fc"\nname = "mine"\nextends = "fc101"\n'
            '[identified_by]\n"FC type" = "FC-99."\n'
        )
        monkeypatch.setenv("DRIVECOMM_MODELS", str(tmp_path))
        drive = virtual_drive("danfoss-fc", 3, model="fc101")
        drive.poke("15-40", "FC-999")
        with drivecomm.open_bus(VirtualLine([drive]).port) as bus:
            (found,) = bus.scan(["danfoss-fc"], [3])
        assert found.model == "mine"


class TestModelsThatFit:
    @pytest.mark.parametrize(
        ("model", "fits", "fits_not"),
        [
            ("invt", ["invt"], ["delta", "gs2"]),
            ("delta", ["delta"], ["invt", "delta-vfd-e"]),
            ("delta-vfd-e", ["delta-vfd-e"], ["delta", "delta-vfd-b"]),
        ],
    )
    def test_scan_names_all_models_that_fit_the_registers_of_a_drive(self, model, fits, fits_not):
        drive, sent = virtual_drive("modbus", 1, model=model), []
        with drivecomm.open_bus(VirtualLine([drive]).port, trace=sent.append) as bus:
            (found,) = bus.scan(["modbus"], [1])
        assert set(found.candidates) >= set(fits)
        assert not set(found.candidates) & set(fits_not)
        assert not found.model, "registers alone are no proof"
        asked = [each.data for each in sent if each.what == "sent"]
        assert len(asked) <= len(set(asked)) + 1, "only function 2BH is asked again"
        assert all(data[1] in (1, 2, 3, 4, 0x11, 0x2B) for data in asked)

    def test_drive_that_answers_one_register_only_does_not_hold_up_a_scan(self):
        drive = virtual_drive("modbus", 1, model="delta")
        line, hear = VirtualLine([drive]), drive.hear
        first = []

        def deaf(find, now):
            first.append(find.data)
            return hear(find, now) if find.data == first[0] else None

        drive.hear = deaf
        with drivecomm.open_bus(line.port) as bus:
            (found,) = bus.scan(["modbus"], [1])
        assert found.candidates == ()
        assert line.time < 120
