"""Statements on the reaction of a drive to a silent master, which are made in several places and must agree."""

import re
from pathlib import Path

import pytest

import drivecomm
from drivecomm.bus import policies, read_watchdog
from drivecomm.cli import main
from drivecomm.models import link_loss_of, load_model, model_names
from drivecomm.protocol import installed
from drivecomm.virtual import VirtualLine, virtual_drive

MODELS = {
    f"{plugin.name}/{name}": (plugin, load_model(plugin.package, plugin.name, name))
    for plugin in installed.working()
    for name in model_names(plugin.package, plugin.name)
}
PAGE = (Path(__file__).parents[2] / "docs" / "how-to" / "link-loss-and-stopping.md").read_text(encoding="utf-8")
# The page names series, so models shared by a whole series or known by reputation only are not on it.
NOT_ON_THE_PAGE = {"vabus/family", "vabus/guesses", "fuji/family"}
IN_WORDS = {"hold": "keeps running", "ramp": "stops down its ramp", "coast": "coasts", "trip": "trips"}


@pytest.mark.parametrize(("plugin", "model"), MODELS.values(), ids=MODELS)
def test_link_loss_in_the_capabilities_is_that_of_the_model(plugin, model):
    address = plugin.addresses[0]
    with drivecomm.open_bus(VirtualLine([virtual_drive(plugin.name, address)]).port) as bus:
        said = bus.drive(plugin.name, address, model=model).capabilities.link_loss
    assert said == link_loss_of(model)
    if model.watchdog is None:
        return
    assert model.watchdog.time in said
    assert model.watchdog.action in said
    for policy in model.watchdog.actions:
        assert IN_WORDS[policy] in said


@pytest.mark.parametrize("plugin", [*installed.working()], ids=lambda plugin: plugin.name)
def test_link_loss_without_a_model_is_unknown(plugin):
    address = plugin.addresses[0]
    assert not plugin.operations(address, plugin.options(), None).capabilities.link_loss
    with drivecomm.open_bus(VirtualLine([virtual_drive(plugin.name, address)]).port) as bus:
        said = bus.drive(plugin.name, address).capabilities.link_loss
    assert said == "no model is given, so its reaction to a link loss is not known"


@pytest.mark.parametrize("name", [name for name, (_, model) in MODELS.items() if model.watchdog])
def test_option_texts_of_the_action_agree_with_the_link_loss_text(name):
    _, model = MODELS[name]
    if not model.watchdog.action:
        return
    values = model.parameters[model.watchdog.action].values
    told = link_loss_of(model)
    codes = [int(code) for code in re.findall(r"[(, ](\d) it ", told)]
    assert set(codes) == set(model.watchdog.actions.values())
    for code in codes:
        goes_on = "keeps running" in told.partition(f"{code} it ")[2].split(",")[0]
        assert goes_on == (values[code] in ("go on", "off"))


@pytest.mark.parametrize(("plugin", "model"), MODELS.values(), ids=MODELS)
def test_row_of_the_link_loss_page_agrees_with_the_model(plugin, model):
    if f"{plugin.name}/{model.name}" in NOT_ON_THE_PAGE:
        return
    (row,) = [line for line in PAGE.splitlines() if line.startswith("|") and f"`{model.name}`" in line]
    _, _, time, action, offered, *_ = [cell.strip() for cell in row.split("|")]
    if model.watchdog is None:
        assert offered.startswith("none")
        assert ("trips" in action) == ("trips" in link_loss_of(model))
        return
    assert model.watchdog.time in time
    assert model.watchdog.action in action
    assert set(re.findall(r"`(\w+)`", offered)) == set(policies(model))


@pytest.mark.parametrize("name", ["fuji/g11s", "fuji/e11s", "danfoss-fc/vlt6000", "vlt3500/vlt3500"])
def test_refusal_without_a_watchdog_and_models_show_state_the_link_loss(name, capsys):
    plugin, model = MODELS[name]
    address = plugin.addresses[0]
    with drivecomm.open_bus(VirtualLine([virtual_drive(plugin.name, address)]).port) as bus:
        drive = bus.drive(plugin.name, address, model=model)
        with pytest.raises(drivecomm.NotSupported) as refused:
            read_watchdog(drive)
    assert link_loss_of(model) in str(refused.value)
    assert "obeys the last command" not in str(refused.value)
    assert main(["models", "show", name]) == 0
    assert link_loss_of(model) in capsys.readouterr().out


def test_link_loss_of_a_g11s_is_a_trip_in_all_places():
    plugin, model = MODELS["fuji/g11s"]
    assert link_loss_of(model).startswith("it trips")
    with drivecomm.open_bus(VirtualLine([virtual_drive(plugin.name, 1)]).port) as bus:
        assert bus.drive(plugin.name, 1, model=model).capabilities.link_loss == link_loss_of(model)


def test_link_loss_of_a_vlt_6000_refers_to_parameter_556():
    _, model = MODELS["danfoss-fc/vlt6000"]
    assert link_loss_of(model).startswith("as set by 556")


def test_action_2_of_frenic_and_vg_is_described_equally():
    for name, action, time in (("fuji/frenic", "y02", "y03"), ("fuji/vg", "H32", "H33")):
        _, model = MODELS[name]
        assert f"{action} = 2 trips only if the silence lasts longer than {time}" in link_loss_of(model)
