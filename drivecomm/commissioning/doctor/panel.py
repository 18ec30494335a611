"""Panel settings that drives report, compared with the plant; writes nothing."""

from __future__ import annotations

from dataclasses import dataclass
from decimal import Decimal
from typing import TYPE_CHECKING, Any

from drivecomm.errors import DriveCommError, LineBusyError, LinkError, OvertakenError, ReplyError
from drivecomm.models import codes_of, converted, held_codes, in_words, setup_sheet

if TYPE_CHECKING:
    from collections.abc import Iterator

    from drivecomm.models import SheetRow
    from drivecomm.protocol import DriveConfig, LineSettings, Model, Reading

_TRIES = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class PanelReading:
    """One setting of a drive's panel, as the drive reports it.

    row: row of the drive's set-up sheet, with the value that the plant requires. shown: the reported value, in words.
    agrees: whether the reported value is the required one.
    """

    drive: DriveConfig
    row: SheetRow
    shown: str
    agrees: bool


def panel_readings(drive: Any, config: DriveConfig, settings: LineSettings) -> Iterator[PanelReading]:
    """Yield each setting of the drive's sheet that the plant determines and that can be read from the drive.

    settings: line settings of the plant. Settings that the drive does not report are left out.
    """
    model: Model | None = drive.model
    if model is None:
        return
    for row in setup_sheet(model, settings, address=config.address, link_loss=config.link_loss):
        if row.setting.address and row.right:
            reading = _read(drive, row.setting.address)
            agrees = None if reading is None else _agrees(row, reading, model)
            if reading is not None and agrees is not None:
                yield PanelReading(drive=config, row=row, shown=_shown(row, reading, model), agrees=agrees)


def _read(drive: Any, address: str) -> Reading | None:
    tries = _TRIES
    while tries:
        try:
            reading: Reading = drive.read(address)
        except (OvertakenError, LineBusyError):
            # No request was sent, so this try does not count.
            continue
        except ReplyError:
            tries -= 1
        except LinkError:
            raise
        except DriveCommError:
            return None
        else:
            return reading
    return None


def _agrees(row: SheetRow, reading: Reading, model: Model) -> bool | None:
    """Return whether a drive holds one of the right values; None if they cannot be compared."""
    setting = row.setting
    if setting.made_from == "watchdog_s":
        return _seconds(reading) == Decimal(row.value) / (1000 if setting.unit == "ms" else 1)
    codes = held_codes(row, model)
    return reading.value in codes if codes else None


def _seconds(reading: Reading) -> Decimal | None:
    return None if isinstance(reading.value, str) else converted(Decimal(reading.value), reading.unit, "s")


def _shown(row: SheetRow, reading: Reading, model: Model) -> str:
    """Return the value in a drive as text, such as `6 (9600 baud)` or `1 (keypad)`."""
    exact = reading.value if isinstance(reading.value, str) else f"{Decimal(reading.value).normalize():f}"
    value = f"{exact} {reading.unit}".rstrip()
    said = [said for said, code in codes_of(row.setting, model).items() if _number(code) == reading.value]
    words = in_words(row.setting.made_from, said[0]) if said else reading.text
    return f"{value} ({words})" if words else value


def _number(code: str) -> int | None:
    return int(code) if code.isdecimal() else None
