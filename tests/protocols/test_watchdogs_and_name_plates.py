"""Watchdogs of models, which can be set, and name plates, by which models are identified."""

import pytest

import drivecomm
from drivecomm.bus import policies, read_watchdog, set_watchdog
from drivecomm.models import load_model, model_names
from drivecomm.protocol import installed
from drivecomm.virtual import VirtualLine, virtual_drive

MODELS = {
    f"{plugin.name}-{name}": (plugin, load_model(plugin.package, plugin.name, name))
    for plugin in installed.working()
    for name in model_names(plugin.package, plugin.name)
}
WATCHED = {title: model for title, (_, model) in MODELS.items() if model.watchdog}
TOLD = {title: (plugin, model) for title, (plugin, model) in MODELS.items() if model.identified_by}


@pytest.mark.parametrize("model", WATCHED.values(), ids=WATCHED)
def test_watchdog_consists_of_writable_parameters(model):
    watchdog = model.watchdog
    time = model.parameters[watchdog.time]
    assert (time.unit, "r" in time.access, "w" in time.access) == ("s", True, True)
    assert watchdog.source
    assert watchdog.actions
    if not watchdog.action:
        assert len(watchdog.actions) == 1
        return
    action = model.parameters[watchdog.action]
    assert "w" in action.access
    assert set(watchdog.actions.values()) <= set(action.values), "the option texts say what each number does"
    assert watchdog.off is not None or "hold" in watchdog.actions


@pytest.mark.parametrize("model", WATCHED.values(), ids=WATCHED)
def test_watchdog_time_is_mapped_as_link_timeout_unless_unconfirmed(model):
    time = model.parameters[model.watchdog.time]
    assert model.quantities.get("link_timeout") == (None if time.sure == "unconfirmed" else time.address)


# PowerFlex 40 manual 22B-UM001J p. 76; PowerFlex 520 manual 520-UM001O p. 102; INVT e-manual group P14
PRINTED = {
    "powerflex-40": ("106", "105", {"trip": 0, "coast": 1, "hold": 3}),
    "powerflex-520": ("126", "125", {"trip": 0, "coast": 1, "hold": 3}),
    "invt": ("0x0E04", "0x0E05", {"trip": 0, "hold": 1}),
    # WEG CFW-08 manual p. 100
    "weg-cfw08": ("314", "313", {"ramp": 0, "coast": 1, "hold": 2}),
    # WEG CFW-09 manual p. 312; the meaning of the numbers: CFW-08 manual p. 100
    "weg-cfw09": ("314", "313", {"ramp": 0, "coast": 1, "hold": 2}),
    # windtunnel-control, docs/10_commissioning.md and its self-test, on an ACS550-U1
    "abb-acs550": ("43019", "43018", {"trip": 1, "hold": 0}),
}


@pytest.mark.parametrize("name", PRINTED)
def test_watchdog_has_the_printed_parameters_and_actions(name):
    watchdog = load_model("drivecomm_modbus", "modbus", name).watchdog
    assert (watchdog.time, watchdog.action, dict(watchdog.actions)) == PRINTED[name]


@pytest.mark.parametrize(("name", "policy"), [(name, policy) for name in PRINTED for policy in PRINTED[name][2]])
def test_watchdog_setting_is_read_back_and_acts_in_silence(name, policy):
    virtual = virtual_drive("modbus", 1, model=name)
    line = VirtualLine([virtual])
    with drivecomm.open_bus(line.port) as bus:
        drive = bus.drive("modbus", 1, model=name)
        assert policy in policies(drive.model)
        told = set_watchdog(drive, policy, 5)
        assert read_watchdog(drive) == told
        if drive.capabilities.monitoring_only:
            virtual.motor.run(20, line.time)
        else:
            drive.set_reference(**({"hz": 20} if drive.capabilities.reference_hz else {"percent": 40}))
            drive.start()
        for _ in range(8):
            line.advance(1)
            drive.read(PRINTED[name][0])
        motor = virtual.motor
        assert (motor.running, motor.output_hz) == (True, 20)
        line.advance(5.5)
        virtual.follow(line.time)
        motor.advance(line.time)
        assert bool(motor.fault) == (policy == "trip")
        assert motor.running == (policy in ("hold", "ramp"))
        assert (motor.output_hz > 0, motor.output_hz == 20) == (policy in ("hold", "ramp"), policy == "hold")


@pytest.mark.parametrize(
    ("told", "name"),
    [
        ({"FC type": "FC-101"}, "fc101"),
        ({"FC type": "FC-102", "power section": "P7K5T4"}, "fc102"),
        ({"FC type": "FC-202"}, "fc202"),
        ({"FC type": "FC-301"}, "fc300"),
        ({"FC type": "FC-302"}, "fc302"),
        ({"unit type": "VLT 5004"}, "vlt5000"),
        ({"unit type": "VLT6002"}, "vlt6000"),
        ({"unit type": "VLT 8006"}, None),
        ({}, None),
    ],
)
def test_danfoss_identity_matches_at_most_one_model(told, name):
    fitting = [model.name for plugin, model in MODELS.values() if plugin.name == "danfoss-fc" and model.matches(told)]
    assert fitting == ([] if name is None else [name])


# The virtual drive of the series model has the name plate of the drive whose parameter list was captured.
SHOWN_AS = {"danfoss-fc-fc300": "danfoss-fc-fc302"}


@pytest.mark.parametrize("title", TOLD)
def test_name_plate_of_a_virtual_drive_matches_its_model_only(title):
    plugin, model = TOLD[title]
    virtual = virtual_drive(plugin.name, plugin.addresses[0], model=model)
    with drivecomm.open_bus(VirtualLine([virtual]).port) as bus:
        # A scan identifies without a model, except for series whose identity is in registers that only the model knows.
        told_by_registers = model.identified_by.keys() <= model.control.get("identity", {}).keys()
        known = {"model": model} if told_by_registers else {}
        identity = bus.drive(plugin.name, virtual.address, **known).identify()
    fitting = [name for name, (_, each) in TOLD.items() if each.protocol == plugin.name and each.matches(identity)]
    assert fitting == [SHOWN_AS.get(title, title)]
