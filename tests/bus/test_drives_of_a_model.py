"""Drives of one model share the loaded model."""

import tracemalloc

import pytest

from drivecomm.bus.roster import Roster
from drivecomm.protocol import installed

KIB_A_DRIVE = 10
PLUGINS = list(installed.working())


@pytest.mark.parametrize("plugin", PLUGINS, ids=lambda plugin: plugin.name)
def test_drives_of_one_model_share_it_on_every_line(plugin):
    line = Roster()
    models = [
        line.member(plugin.name, address, plugin.default_model, None, {}).model for address in plugin.addresses[:2]
    ]
    models.append(Roster().member(plugin.name, plugin.addresses[0], plugin.default_model, None, {}).model)
    if plugin.broadcast_address is not None:
        models.append(line.all_drives(plugin.name, plugin.default_model, {}).model)
    assert models[0] is not None
    assert all(each is models[0] for each in models)


@pytest.mark.parametrize("plugin", PLUGINS, ids=lambda plugin: plugin.name)
def test_additional_drive_of_a_known_model_takes_little_memory(plugin):
    line = Roster()
    line.member(plugin.name, plugin.addresses[0], plugin.default_model, None, {})
    tracemalloc.start()
    try:
        before = tracemalloc.get_traced_memory()[0]
        kept = [line.member(plugin.name, address, plugin.default_model, None, {}) for address in plugin.addresses[1:11]]
        taken = tracemalloc.get_traced_memory()[0] - before
    finally:
        tracemalloc.stop()
    assert taken / len(kept) < KIB_A_DRIVE * 1024
