"""Forty differences between a drive and its model, each planted in a virtual drive."""

from dataclasses import dataclass, replace
from decimal import Decimal
from typing import Any

from proved_drives import drive_of, model


@dataclass(frozen=True)
class Lie:
    """One planted difference.

    tell: makes the drive's own model from the honest one, or changes the finished drive. about: the address, or part of
    the text, of a finding that reveals the lie.
    """

    kind: str
    of: str
    about: str
    tell: Any
    by_drive: bool = False

    def honest(self):
        return model(*self.of.split("/"))

    def drive(self):
        protocol, honest = self.of.partition("/")[0], self.honest()
        drive = drive_of(protocol, honest)
        if not self.by_drive:
            # A drive of another series with the line settings of this one.
            settings, drive = drive.settings, drive_of(protocol, self.tell(honest))
            drive.settings = settings
            return drive
        self.tell(drive.inner)
        return drive

    def __str__(self):
        return f"{self.kind} {self.of} {self.about}"


def changed(address, **keys):
    """Return a change of one parameter in a model; with a changed factor, the start value stays the same."""

    def tell(honest):
        info = honest.parameters[address]
        extra = {**info.extra, **keys.pop("extra", {})} if "extra" in keys else info.extra
        return replace(honest, parameters={**honest.parameters, address: replace(info, extra=extra, **keys)})

    return tell


def scaled(address, times):
    return lambda honest: changed(address, factor=honest.parameters[address].factor * Decimal(times))(honest)


def missing(*addresses):
    def tell(honest):
        left = {address: info for address, info in honest.parameters.items() if address not in addresses}
        names = {name: address for name, address in honest.quantities.items() if address in left}
        return replace(honest, parameters=left, quantities=names, watchdog=None)

    return tell


def swapped(one, other):
    def tell(honest):
        first, second = honest.parameters[one], honest.parameters[other]
        tables = {one: replace(second, address=one), other: replace(first, address=other)}
        places = {one: other, other: one}
        names = {name: places.get(address, address) for name, address in honest.quantities.items()}
        return replace(honest, parameters={**honest.parameters, **tables}, quantities=names)

    return tell


def series(protocol, name):
    return lambda _: model(protocol, name)


def store_code(code):
    """Return a change of a drive's refusal code for unknown parameters."""

    def tell(drive):
        drive.store._codes = {**drive.store._codes, "unknown": code}

    return tell


def dialect_code(code):
    def tell(drive):
        drive._dialect.codes = {**drive._dialect.codes, "unknown": code}

    return tell


def pokes(address, raw):
    return lambda drive: drive.poke(address, raw)


LIES = [
    Lie("wrong scale", "danfoss-fc/fc302", "16-30", changed("16-30", extra={"conversion_index": -1})),
    Lie("wrong scale", "vabus/agile", "motor_rated_frequency", scaled("375", "0.1")),
    Lie("wrong scale", "vabus/agile", "motor_rated_speed", scaled("372", 10)),
    Lie("wrong scale", "uss/micromaster4", "motor_rated_frequency", scaled("310", 10)),
    Lie("wrong scale", "modbus/schneider-atv320", "9601", scaled("9601", 10)),
    Lie("wrong scale", "modbus/powerflex-520", "motor_rated_power", scaled("37", "0.1")),
    Lie("wrong scale", "modbus/yaskawa", "dc_link_voltage", scaled("0x0031", "0.1")),
    Lie("wrong scale", "huanyang/hy", "maximum_frequency", scaled("PD005", 10)),
    Lie("wrong scale", "fuji/frenic", "motor_rated_voltage", changed("F05", type="[3]")),
    Lie("missing parameter", "danfoss-fc/fc302", "1-23", missing("1-23")),
    Lie("missing parameter", "vabus/agile", "419", missing("419")),
    Lie("missing parameter", "uss/micromaster4", "311", missing("311")),
    Lie("missing parameter", "modbus/schneider-atv320", "9603", missing("9603")),
    Lie("missing parameter", "fuji/frenic", "F03", missing("F03")),
    Lie("missing parameter", "vlt3500/vlt2000", "107", missing("107")),
    Lie("missing parameter", "huanyang/hy", "PD141", missing("PD141")),
    Lie("missing parameter", "movilink/movidrive-b", "8470", missing("8470")),
    Lie("wrong type", "danfoss-fc/fc302", "1-24", changed("1-24", type="uint16")),
    Lie("wrong type", "vabus/agile", "418", changed("418", type="uint")),
    Lie("wrong size", "uss/micromaster4", "304", changed("304", type="Float")),
    Lie("wrong size", "modbus/abb-acs580", "420222", changed("420222", type="u16")),
    Lie("wrong type", "lecom/lenze-82xx", "C0011", changed("C0011", type="u16")),
    Lie("wrong limit", "danfoss-fc/fc302", "8-31", changed("8-31", maximum=Decimal(31))),
    Lie("wrong limit", "vlt3500/vlt2000", "202", changed("202", maximum=Decimal(1000), start=Decimal(800))),
    Lie("wrong limit", "huanyang/hy", "PD143", changed("PD143", maximum=Decimal(48), start=Decimal(24))),
    Lie("wrong limit", "hitachi/sj700", "F002", changed("F002", maximum=Decimal(9999), start=Decimal(5000))),
    Lie("wrong limit", "mitsubishi/fr700", "1", changed("1", maximum=Decimal(590), start=Decimal(400))),
    Lie("wrong name plate", "uss/micromaster4", "motor_rated_speed", pokes("311", 2000), by_drive=True),
    Lie("wrong name plate", "modbus/powerflex-520", "motor_rated_current", pokes("34", 4000), by_drive=True),
    Lie("wrong identity", "danfoss-fc/fc302", "identity", series("danfoss-fc", "fc202")),
    Lie("wrong identity", "lecom/lenze-smv", "identity", changed("P494", start=Decimal("1.40"))),
    Lie("wrong identity", "modbus/abb-acs355", "identity", series("modbus", "schneider-atv320")),
    Lie("wrong link-loss place", "vabus/agile", "link loss", missing("413")),
    Lie(
        "wrong link-loss place", "danfoss-fc/fc302", "8-04", changed("8-04", start=Decimal(9), values={9: "x", 0: "y"})
    ),
    Lie("wrong link-loss place", "modbus/schneider-atv320", "link loss", pokes("7010", 9), by_drive=True),
    Lie("wrong error code", "vabus/agile", "refusal", store_code(4), by_drive=True),
    Lie("wrong error code", "danfoss-fc/fc302", "refusal", store_code(17), by_drive=True),
    Lie("wrong error code", "modbus/yaskawa", "refusal", dialect_code(4), by_drive=True),
    Lie("swapped parameters", "modbus/powerflex-520", "31", swapped("31", "34")),
    Lie("swapped parameters", "uss/micromaster4", "310", swapped("310", "311")),
]
