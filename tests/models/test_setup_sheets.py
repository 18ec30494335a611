"""Set-up sheets: the values they fill in, and the rules for packaged sheets."""

import pytest

import drivecomm
from drivecomm.models import (
    check_model,
    held_codes,
    in_words,
    load_model,
    packaged_models,
    read_model,
    setup_sheet,
    uncovered_rates,
)
from drivecomm.protocol import (
    USUAL_BAUD_RATES,
    LineSettings,
    LinkLossPolicy,
    Model,
    PanelSetting,
    Watchdog,
    installed,
    resolve_options,
)
from drivecomm.virtual import VirtualLine, virtual_drive

SHEETS = [
    (plugin, model)
    for plugin in installed.working()
    for path in packaged_models(plugin.package)
    if (model := read_model(path, plugin.name, plugin.package)).setup
]
NAMES = [f"{model.protocol}/{model.name}" for _, model in SHEETS]
WITHOUT = {
    *("ei-bisynch/eurotherm-590sp", "ei-bisynch/parker-6513", "fuji/family", "lecom/lenze-smv", "ls-bus/ig5a"),
    *("mitsubishi/shihlin", "modbus/eaton-dc1", "modbus/enc-eds", "modbus/gs2", "modbus/inovance-md500"),
    *("modbus/lenze-tmd", "modbus/ls-ig5a", "modbus/optidrive-plus", "modbus/parker-ac10", "modbus/powtran-pi130"),
    *("modbus/rexroth-efc", "modbus/teco-7300cv", "movilink/movitrac-b"),
}
"""Series whose panel settings were found on no page. Remove an entry when its page is found; add none."""

NEEDED_WITHOUT_A_PANEL = {("modbus/yaskawa", "0x0502"), ("mitsubishi/*", "H7B")}
"""Conditions of a start that no page lists as a panel setting: o1-03, and a mode that is set over the line."""

LINE = LineSettings(baudrate=19200, parity="E")


def model(*settings, **keys):
    return Model(
        protocol="toy", name="own", title="", source="", parameters={}, faults={}, options={}, setup=settings, **keys
    )


def setting(made_from=None, purpose="line", **keys):
    return PanelSetting(parameter="P1", name="one", purpose=purpose, made_from=made_from, source="a page", **keys)


def filled(made_from=None, settings=LINE, address=None, link_loss=None, watchdog=None, **keys):
    purpose = "link loss" if made_from in ("link_loss", "watchdog_s") else "line"
    one = setting(made_from, purpose, **keys)
    (row,) = setup_sheet(model(one, watchdog=watchdog), settings, address=address, link_loss=link_loss)
    return row


# Packaged sheets


def test_packaged_models_without_a_sheet_are_those_of_the_list():
    models = {
        f"{plugin.name}/{path.stem}" for plugin in installed.working() for path in packaged_models(plugin.package)
    }
    assert models - set(NAMES) == WITHOUT


@pytest.mark.parametrize("sheet", SHEETS, ids=NAMES)
def test_packaged_row_has_a_source_and_is_not_unconfirmed(sheet):
    _, known = sheet
    for row in known.setup:
        assert row.source.strip(), row
        assert row.sure in ("printed", "derived", "field"), f"{row.parameter}: leave out what no page says"


@pytest.mark.parametrize("sheet", SHEETS, ids=NAMES)
def test_packaged_sheet_has_a_value_or_a_reason_for_each_usual_baud_rate(sheet):
    _, known = sheet
    for rate in USUAL_BAUD_RATES:
        for row in setup_sheet(known, LineSettings(baudrate=rate), address=1):
            if row.setting.made_from in ("baudrate", "line"):
                assert row.value or f"{rate}" in row.lacks or row.setting.when, row
                assert bool(row.value) == (rate not in uncovered_rates(row.setting)) or row.lacks, row


@pytest.mark.parametrize("sheet", SHEETS, ids=NAMES)
def test_packaged_sheet_has_values_for_the_defaults_of_its_series(sheet):
    plugin, known = sheet
    settings = resolve_options(plugin, known, {})[0].settings
    lacking = {row.setting.parameter for row in setup_sheet(known, settings, address=1) if row.lacks}
    # The models default to 8N1, which these series do not have over Modbus.
    allowed = {"modbus/delta-vfd-b": {"09-04"}, "modbus/vacon10": {"S2.6"}}
    assert lacking == allowed.get(f"{known.protocol}/{known.name}", set())


@pytest.mark.parametrize("sheet", SHEETS, ids=NAMES)
def test_packaged_sheet_lists_the_settings_that_a_start_requires(sheet):
    _, known = sheet
    on_sheet = {row.address: {int(each) for each in (row.value, *row.also) if each.isdecimal()} for row in known.setup}
    for address, raws in known.control.get("needs", {}).items():
        exempt = {(f"{known.protocol}/{known.name}", address), (f"{known.protocol}/*", address)}
        if not exempt & NEEDED_WITHOUT_A_PANEL:
            assert set(raws) <= on_sheet.get(address, set()), address


@pytest.mark.parametrize("options", [{}, {"baudrate": 19200}], ids=["defaults", "19200 baud"])
@pytest.mark.parametrize("sheet", SHEETS, ids=NAMES)
def test_virtual_drive_holds_the_values_of_the_sheet_for_its_line(sheet, options):
    plugin, known = sheet
    address = [each for each in plugin.addresses if each > 0][2]
    line = VirtualLine([virtual_drive(plugin.name, address, model=known, **options)])
    with drivecomm.open_bus(line.port) as bus:
        drive = bus.drive(plugin.name, address, model=known, **options)
        for row in setup_sheet(known, drive.facts.settings, address=address):
            if not row.setting.address or not row.right or row.setting.purpose == "link loss":
                continue
            reading = drive.read(row.setting.address)
            assert reading.value in held_codes(row, known), row


# Values made from the plant


@pytest.mark.parametrize(
    ("made_from", "keys", "value", "made_of"),
    [
        ("baudrate", {"codes": {"9600": "6", "19200": "7"}}, "7", "19200 baud = 7"),
        ("baudrate", {}, "19200", "19200 baud"),
        ("parity", {"codes": {"N": "0", "E": "2"}}, "2", "even parity = 2"),
        ("stopbits", {"codes": {"1": "1", "2": "0"}}, "1", "1 stop bit"),
        ("bytesize", {"codes": {"8": "0", "7": "1"}}, "0", "8 data bits = 0"),
        ("format", {"codes": {"8E1": "4"}}, "4", "8E1 = 4"),
        ("line", {"codes": {"19200 8E1": "6"}}, "6", "19200 8E1 = 6"),
        ("address", {}, "31", "address 31"),
        ("address", {"hexadecimal": True}, "1F", "address 31 = 1F, hexadecimal"),
        (None, {"value": "5", "means": "USS"}, "5", "USS"),
    ],
)
def test_value_is_made_from_the_line_settings_or_the_address(made_from, keys, value, made_of):
    row = filled(made_from, address=31, **keys)
    assert (row.value, row.made_of, row.lacks) == (value, made_of, "")


def test_baud_rate_without_a_code_is_reported_with_the_known_rates():
    row = filled("baudrate", codes={"9600": "6", "38400": "8"})
    assert row.value == ""
    assert row.lacks == "no value is known for 19200 baud, only for 9600 and 38400"


def test_sheet_without_an_address_has_a_placeholder_for_it():
    assert filled("address").made_of == "its own address on the line"


WATCHDOG = Watchdog(time="813", action="812", actions={"ramp": 2, "trip": 5}, off=0)


@pytest.mark.parametrize(
    ("policy", "action", "time"),
    [
        (None, ("", "2 (ramp) or 5 (trip), as link_loss in the plant file"), ""),
        (LinkLossPolicy(policy="trip", watchdog_s=2.5), ("5", "trip = 5"), "2500"),
        (LinkLossPolicy(policy="hold"), ("", "any, with hold"), "0"),
    ],
)
def test_link_loss_setting_follows_the_policy_of_the_drive(policy, action, time):
    row = filled("link_loss", link_loss=policy, watchdog=WATCHDOG)
    assert (row.value, row.made_of) == action
    assert filled("watchdog_s", link_loss=policy, watchdog=WATCHDOG, unit="ms").value == time


def test_watchdog_time_of_hold_comes_from_the_row_or_the_watchdog():
    hold = LinkLossPolicy(policy="hold")
    assert filled("watchdog_s", link_loss=hold, codes={"hold": "9999"}).value == "9999"
    assert filled("watchdog_s", link_loss=hold).lacks == "no value is known for hold"
    by_action = Watchdog(time="813", action="812", actions={"hold": 0, "trip": 5})
    assert filled("watchdog_s", link_loss=hold, watchdog=by_action).made_of == "any, with hold"


def test_unavailable_policy_is_reported_with_the_available_ones():
    row = filled("link_loss", link_loss=LinkLossPolicy(policy="coast"), watchdog=WATCHDOG)
    assert row.lacks == "no value is known for coast, only for ramp and trip"


def test_rows_are_sorted_by_purpose():
    rows = [setting(value="1", purpose=each) for each in ("link loss", "commands", "access", "line")]
    assert [row.setting.purpose for row in setup_sheet(model(*rows), LINE)] == [
        *("access", "line", "commands", "link loss"),
    ]


def test_line_settings_are_spelled_out_in_words():
    assert in_words("stopbits", "2") == "2 stop bits"
    assert in_words("parity", "O") == "odd parity"


def test_file_with_its_own_rows_inherits_none(tmp_path):
    head = 'format = 1\nprotocol = "vabus"\nname = "own"\nextends = "act"\nsource = "a page"\n'
    path = tmp_path / "own.toml"
    path.write_text(head, encoding="utf-8")
    package = installed["vabus"].package
    assert read_model(path, "vabus", package).setup == load_model(package, "vabus", "act").setup != ()
    path.write_text(head + '[[setup]]\nparameter = "394"\nname = "node"\npurpose = "line"\nmade_from = "address"\n')
    (row,) = read_model(path, "vabus", package).setup
    assert (row.parameter, row.source) == ("394", "a page")
    path.write_text(head + "setup = []\n", encoding="utf-8")
    assert read_model(path, "vabus", package).setup == ()


# Mistakes in a model file

ROW = '[[setup]]\nparameter = "394"\nname = "node"\npurpose = "line"\n'


@pytest.mark.parametrize(
    ("text", "line", "key", "what"),
    [
        ("setup = 3\n", 6, "setup", "panel settings are tables; write [[setup]]"),
        (ROW, 6, "", "write either value, or made_from"),
        (ROW + "value = '1'\nmade_from = 'address'\n", 6, "", "write either value, or made_from"),
        (ROW.replace('purpose = "line"\n', "") + "value = '1'\n", 6, "", "the key 'purpose' is missing"),
        (ROW.replace("line", "lime") + "value = '1'\n", 9, "purpose", "it is one of access, line, commands"),
        (ROW + "made_from = 'rate'\n", 10, "made_from", "it is one of address, baudrate"),
        (ROW + "value = 1\n", 10, "value", "1 is not a text"),
        (ROW + "value = '1'\nvalu = '2'\n", 11, "valu", "did you mean 'value'?"),
        (ROW + "value = '1'\nalso = '2'\n", 11, "also", "has further values"),
        (ROW + "made_from = 'baudrate'\ncodes = { 9600 = 3 }\n", 11, "codes", "has the panel's value for each"),
        (ROW + "made_from = 'baudrate'\ncodes = { fast = '3' }\n", 11, "codes", "'fast' cannot be the baudrate of"),
        (ROW + "made_from = 'format'\ncodes = { 8X1 = '3' }\n", 11, "codes", "'8X1' cannot be the format of a plant"),
        (ROW + "value = '1'\ncodes = { 9600 = '3' }\n", 11, "codes", "write made_from"),
        (ROW + "value = '1'\nhexadecimal = 1\n", 11, "hexadecimal", "is true or false"),
        (ROW + "value = '1'\nhexadecimal = true\n", 11, "hexadecimal", "is for an address"),
        (ROW + "value = '1'\nsure = 'drive'\n", 11, "sure", "it is one of printed, derived, field"),
        (ROW + "value = '1'\naddress = '999'\n", 11, "address", "has no parameter '999' that can be read"),
        (ROW + "value = '3'\naddress = '412'\n", 10, "value", "parameter 412 takes no '3'"),
        (ROW + "made_from = 'baudrate'\naddress = '10'\ncodes = { 9600 = '8' }\n", 12, "codes", "takes no '8'"),
        (ROW + "value = '1'\n" + ROW + "value = '1'\n", 12, "parameter", "394 is listed twice"),
    ],
)
def test_mistake_in_a_panel_setting_is_found_with_its_line(tmp_path, text, line, key, what):
    path = tmp_path / "own.toml"
    path.write_text('format = 1\nprotocol = "vabus"\nname = "own"\nsource = "a page"\nextends = "act"\n' + text)
    (finding,) = check_model(path)
    assert (finding.line, finding.key) == (line, key)
    assert what in finding.text


def test_panel_setting_without_a_source_is_found(tmp_path):
    path = tmp_path / "own.toml"
    path.write_text('format = 1\nprotocol = "vabus"\nname = "own"\nextends = "act"\n' + ROW + "value = '1'\n")
    (finding,) = check_model(path)
    assert finding.text == "its source is missing; name the manual and the page under source"


def test_link_loss_without_codes_needs_a_watchdog(tmp_path):
    path = tmp_path / "own.toml"
    head = 'format = 1\nprotocol = "vabus"\nname = "own"\nsource = "a page"\nextends = "act"\nlink_loss = "unknown"\n'
    path.write_text(head + ROW.replace('"line"', '"link loss"') + "made_from = 'link_loss'\n")
    (finding,) = check_model(path)
    assert "neither these nor a watchdog define" in finding.text
