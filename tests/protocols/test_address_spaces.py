"""Address spaces of each protocol: all addresses that its telegrams can carry, including those of the models."""

from itertools import islice

import pytest
from extents import every

import drivecomm_modbus.parameters as modbus_parameters
from drivecomm.models import load_model, model_names
from drivecomm.protocol import installed, resolve_options

CASES = {
    f"{plugin.name} {model}": (plugin.name, model)
    for plugin in installed.working()
    if plugin.address_space is not None
    for model in model_names(plugin.package, plugin.name)
}


def space_of(protocol, model=None, **given):
    plugin = installed[protocol]
    known = None if model is None else load_model(plugin.package, protocol, model)
    _, options = resolve_options(plugin, known, given)
    return plugin.address_space(options, known)


@pytest.mark.parametrize(
    ("protocol", "model", "given", "shown"),
    [
        ("vabus", "agile", {}, (["0", "1", "2"], "1599", 1600)),
        ("vlt3500", "vlt3500", {}, (["000", "001", "002"], "999", 1000)),
        ("danfoss-fc", "fc300", {}, (["0-01", "0-02", "0-03"], "40-95", 4095)),
        ("danfoss-fc", "vlt5000", {}, (["001", "002", "003"], "990", 990)),
        ("danfoss-fc", None, {}, (["0-01", "0-02", "0-03"], "40-95", 4095)),
        ("fuji", "frenic", {}, (["F00", "F01", "F02"], "T99", 2100)),
        ("fuji", "e11s", {}, (["S00", "S01", "S02"], "A46", 376)),
        ("fuji", "e11s", {"number_check": False}, (["S00", "S01", "S02"], "A99", 800)),
        ("fuji", "g11s", {}, (["F00", "F01", "F02"], "M49", 450)),
        ("fuji", "vg", {}, (["F00", "F01", "F02"], "M99", 1100)),
    ],
)
def test_address_space_lists_each_address_once_in_order(protocol, model, given, shown):
    found = list(space_of(protocol, model, **given).addresses())
    assert (found[:3], found[-1], len(found)) == shown
    assert len(set(found)) == len(found)


@pytest.mark.soak
@pytest.mark.parametrize("case", every(4, CASES))
def test_address_space_is_readable_and_covers_the_model(case):
    protocol, model = CASES[case]
    plugin = installed[protocol]
    known = load_model(plugin.package, protocol, model)
    _, options = resolve_options(plugin, known, {})
    operations = plugin.operations(1, options, known)
    space = plugin.address_space(options, known)
    keys = {operations.address_of(address).partition("[")[0] for address in space.addresses()}
    for address in islice(space.addresses(), 0, None, 37):
        operations.read(address)
    # Parts of a register come with the register; coils and inputs are only read if a model names them.
    whole = [each for each in known.parameters if "." not in each and each[0] not in "cdi"]
    outside = [each for each in whole if operations.address_of(each).partition("[")[0] not in keys]
    assert outside == []
    assert space.source
    assert space.absent


@pytest.mark.parametrize(
    ("protocol", "address", "code", "runs", "beyond"),
    [
        ("vabus", "481", 9, [["481[1]", "481[2]", "481[3]", "481[4]"]], ""),
        ("vabus", "481", None, [], ""),
        ("vabus", "481", 11, [], ""),
        ("fuji", "F01", None, [], ""),
        ("vlt3500", "502", None, [], ""),
        ("danfoss-fc", "3-10", 0, [], ""),
    ],
)
def test_array_elements_depend_on_the_refusal_code(protocol, address, code, runs, beyond):
    found = space_of(protocol).elements(address, code)
    assert ([list(run) for run in found.runs], found.beyond) == (runs, beyond)


def test_vlt_3500_index_starts_at_0_or_1_or_is_a_pair():
    runs = space_of("vlt3500").elements("502", 2).runs
    assert [run[0] for run in runs[:4]] == ["502[0]", "502[1]", "502[0,0]", "502[1,0]"]


def test_danfoss_fc_array_is_searched_for_elements_1_to_254():
    for code in (None, 3):
        found = space_of("danfoss-fc").elements("3-10", code)
        assert (found.runs[0][0], found.runs[0][-1], found.beyond) == ("3-10[1]", "3-10[254]", "3-10[255]")


def test_modbus_address_is_resolved_without_searching_the_model(monkeypatch):
    looked, place_of = [], modbus_parameters.place_of
    monkeypatch.setattr(modbus_parameters, "place_of", lambda *given: looked.append(given) or place_of(*given))
    known = load_model("drivecomm_modbus", "modbus", "danfoss-fc")
    plugin = installed["modbus"]
    operations = plugin.operations(1, resolve_options(plugin, known, {})[1], known)
    assert operations.address_of("0x3F02") == "16130"
    looked.clear()
    for address in range(1, 1001):
        operations.address_of(str(address))
    assert len(looked) == 1000
