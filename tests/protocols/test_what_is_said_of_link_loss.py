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
NOT_ON_THE_PAGE = {"vabus/family", "vabus/unconfirmed", "fuji/family", "vlt3500/published"}
IN_WORDS = {"hold": "goes on", "ramp": "stops down its ramp", "coast": "coasts", "trip": "trips"}


def without_model(plugin, model):
    options = {name: value for name, value in model.options.items() if name in plugin.options.__dataclass_fields__}
    return plugin.operations(plugin.addresses[0], plugin.options(**options), None).capabilities.link_loss


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


@pytest.mark.parametrize(("plugin", "model"), MODELS.values(), ids=MODELS)
def test_without_a_model_the_package_says_the_same(plugin, model):
    told = without_model(plugin, model)
    if model.name == "vlt6000":
        assert "VLT 6000: 556" in told
        return
    if model.watchdog is None:
        assert told == link_loss_of(model) or model.name == "family"
        return
    assert model.watchdog.time in told
    assert model.watchdog.action in told
    if model.watchdog.action:
        values = model.parameters[model.watchdog.action].values
        for code in map(int, re.findall(r"[(, ](\d) it ", told)):
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
    assert without_model(plugin, model).startswith("it trips")
