"""What a drive does when its master falls silent is said in many places, and they all say the same."""

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
# Of all that a series shares, and of what is known by reputation only; the page names the series themselves.
NOT_ON_THE_PAGE = {"vabus/family", "vabus/guesses", "fuji/family"}
IN_WORDS = {"hold": "goes on", "ramp": "stops down its ramp", "coast": "coasts", "trip": "trips"}


@pytest.mark.parametrize(("plugin", "model"), MODELS.values(), ids=MODELS)
def test_a_drive_says_what_its_model_says(plugin, model):
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
def test_without_a_model_nothing_is_claimed(plugin):
    address = plugin.addresses[0]
    assert not plugin.operations(address, plugin.options(), None).capabilities.link_loss
    with drivecomm.open_bus(VirtualLine([virtual_drive(plugin.name, address)]).port) as bus:
        said = bus.drive(plugin.name, address).capabilities.link_loss
    assert said == "no model is given, so what it does when its master falls silent is not known"


@pytest.mark.parametrize("name", [name for name, (_, model) in MODELS.items() if model.watchdog])
def test_the_values_that_go_on_are_those_that_the_parameter_calls_so(name):
    _, model = MODELS[name]
    if not model.watchdog.action:
        return
    values = model.parameters[model.watchdog.action].values
    told = link_loss_of(model)
    codes = [int(code) for code in re.findall(r"[(, ](\d) it ", told)]
    assert set(codes) == set(model.watchdog.actions.values())
    for code in codes:
        goes_on = "goes on" in told.partition(f"{code} it ")[2].split(",")[0]
        assert goes_on == (values[code] in ("go on", "off"))


@pytest.mark.parametrize(("plugin", "model"), MODELS.values(), ids=MODELS)
def test_the_page_has_a_row_that_says_the_same(plugin, model):
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
def test_where_no_watchdog_can_be_set_the_refusal_and_the_command_line_say_what_is_known(name, capsys):
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


def test_the_g11s_trips_wherever_it_is_asked():
    plugin, model = MODELS["fuji/g11s"]
    assert link_loss_of(model).startswith("it trips")
    with drivecomm.open_bus(VirtualLine([virtual_drive(plugin.name, 1)]).port) as bus:
        assert bus.drive(plugin.name, 1, model=model).capabilities.link_loss == link_loss_of(model)


def test_a_vlt_6000_does_what_556_says():
    _, model = MODELS["danfoss-fc/vlt6000"]
    assert link_loss_of(model).startswith("what 556 says")


def test_what_a_frenic_does_with_2_is_told_alike_of_both_generations():
    for name, action, time in (("fuji/frenic", "y02", "y03"), ("fuji/vg", "H32", "H33")):
        _, model = MODELS[name]
        assert f"{action} = 2 trips only if the silence lasts longer than {time}" in link_loss_of(model)
