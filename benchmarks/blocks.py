"""Gain of reading registers in blocks, in virtual time: no emulator, no noise."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from report import Figure, Section

import drivecomm
from drivecomm.models import load_model
from drivecomm.protocol import ParameterInfo
from drivecomm.virtual import VirtualLine, virtual_drive

if TYPE_CHECKING:
    from equipment import Equipment

    from drivecomm.protocol import Model

_REGISTERS = 40
_BAUDRATE = 19200
_ROUNDS = 5
_PROMISE = 5.0


def measure(_equipment: Equipment) -> list[Section]:
    """Measure a poll plan of one drive, register by register and in blocks."""
    section = Section(
        title="Blocks of registers",
        about=(
            f"A poll plan of {_REGISTERS} registers that stand side by side, on one Modbus drive at {_BAUDRATE} baud; "
            "virtual time. Seconds for a round, one register at a time and in blocks."
        ),
        head=("registers in a telegram", "one at a time", "in blocks", "times as fast"),
    )
    for most in (16, 40):
        model = _model(most)
        alone, together = (_round_s(model, options) for options in ({"type": "u16"}, {}))
        section.rows.append((str(most), f"{alone:.3f}", f"{together:.3f}", f"{alone / together:.1f}"))
        section.figures.append(
            Figure(
                name=f"times as fast as one register at a time, blocks of {most}",
                value=alone / together,
                promise=_PROMISE,
                floor=_PROMISE,
                exact=True,
            )
        )
    return [section]


def _model(most: int) -> Model:
    base = load_model("drivecomm_modbus", "modbus", "delta")
    infos = [
        ParameterInfo(address=f"0x{0x3000 + number:04X}", name=f"register_{number}", title="a register", type="u16")
        for number in range(_REGISTERS)
    ]
    options = {**base.options, "max_registers": most, "baudrate": _BAUDRATE}
    return replace(base, parameters={**base.parameters, **{info.address: info for info in infos}}, options=options)


def _round_s(model: Model, options: dict[str, str]) -> float:
    """Return the duration of one round in seconds. options: if not empty, each item is read separately."""
    line = VirtualLine([virtual_drive("modbus", 1, model=model)])
    with drivecomm.open_bus(line.port) as bus:
        drive = bus.drive("modbus", 1, model=model)
        items = [
            drivecomm.PollItem(drive=drive, parameter=f"0x{0x3000 + number:04X}", period_s=0, options=options)
            for number in range(_REGISTERS)
        ]
        for result in bus.poll(items, cycles=_ROUNDS):
            if result.error is not None:
                raise result.error
    return line.time / _ROUNDS
