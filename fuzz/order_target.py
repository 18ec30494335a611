"""Fuzz target for orders to a running plant, as other programs send them through its control door."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

from mutation import mutate_json
from target import FuzzTarget, expect

from drivecomm.models import load_model
from drivecomm.plant import Plant, PlantLine
from drivecomm.protocol import DriveConfig
from drivecomm.virtual import VirtualPlant, answer_order

if TYPE_CHECKING:
    from drivecomm.protocol import Protocol

_FAULTS = (
    "drive = 'pump'\nkind = 'drop'",
    "line = 'hall'\nkind = 'corrupt'\nevery = 3",
    "drive = 'pump'\npower = { off_at_s = 20, back_at_s = 35 }",
    "drive = 'pump'\ntrip = { code = 5, at_s = 40 }",
    "line = 'hall'\ninject = { data = '04 41 FF', at_s = 3 }",
)


def order_target(plugin: Protocol) -> FuzzTarget:
    """Return the target for orders to a plant with one drive of this protocol; each input gets a new plant."""
    # Read the model once: reading it takes a hundred times as long as an order.
    model = load_model(plugin.package, plugin.name, plugin.default_model)
    drive = DriveConfig(
        protocol=plugin.name, address=plugin.addresses[0], line="hall", name="pump", options={"model": model}
    )
    plan = Plant(lines=(PlantLine(name="hall"),), drives=(drive,))
    parameter = plugin.parameter_examples[0]

    def check(data: bytes) -> None:
        plant = VirtualPlant(plan)
        for line in data.split(b"\n")[:4]:
            answer = answer_order(plant, line)
            expect(answer.count(b"\n") == 1, "an answer is not one line")
            expect(answer.endswith(b"\n"), "an answer has no end")
            expect(type(json.loads(answer)["ok"]) is bool, "an answer does not say whether it was done")

    orders = [
        {"order": "trip", "drive": "pump", "code": 5},
        {"order": "power", "drive": "pump", "state": "off"},
        {"order": "set", "drive": "pump", "parameter": parameter, "value": 1000},
        {"order": "inject", "line": "hall", "data": "04 41 FF"},
        {"order": "show", "drive": "pump", "parameters": [parameter]},
        {"order": "show"},
        *({"order": "fault", "text": text} for text in _FAULTS),
    ]
    written = [json.dumps(order).encode() for order in orders]
    pairs = [one + b"\n" + other for one in written for other in written[:3]]
    return FuzzTarget(name=f"{plugin.name}-orders", check=check, seeds=(*written, *pairs), mutate=mutate_json)
