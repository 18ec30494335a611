"""Set-up sheets: settings for a person to make at the panel of a drive, with the values of its plant.

The rows are data of the model (`drivecomm.protocol.PanelSetting`); nothing here communicates with a drive.
"""

from __future__ import annotations

from dataclasses import dataclass
from decimal import Decimal
from typing import TYPE_CHECKING

from drivecomm.models.quantities import parameter_at
from drivecomm.protocol import USUAL_BAUD_RATES

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from drivecomm.protocol import LineSettings, LinkLossPolicy, MadeFrom, Model, PanelSetting, Purpose

PURPOSES: Mapping[Purpose, str] = {
    "access": "To reach the other settings",
    "line": "So that it talks",
    "commands": "So that it obeys",
    "reference": "So that it takes its reference from the line",
    "link loss": "What it does when its master falls silent",
}
"""Parts of a sheet, in their order, each with its heading."""

_PARITIES = {"N": "no parity", "E": "even parity", "O": "odd parity", "M": "mark parity", "S": "space parity"}


@dataclass(frozen=True, slots=True, kw_only=True)
class SheetRow:
    """One row of a set-up sheet.

    value: the value to set, as the panel shows it; empty if a person must choose it, or it is unknown. made_of: meaning
    of the value, such as "9600 baud = 3". lacks: why the value is unknown; empty if it is known, or none is needed.
    """

    setting: PanelSetting
    value: str = ""
    made_of: str = ""
    lacks: str = ""

    @property
    def right(self) -> tuple[str, ...]:
        """Suitable values, the recommended one first; empty if any value is suitable."""
        return (self.value, *self.setting.also) if self.value else ()

    @property
    def remarks(self) -> tuple[str, ...]:
        """Further remarks for the reader, one sentence each."""
        setting = self.setting
        rates = () if self.lacks else uncovered_rates(setting)
        return tuple(
            part
            for part in (
                f"only {setting.when}" if setting.when else "",
                f"{' or '.join(setting.also)} does as well" if setting.also else "",
                self.lacks,
                f"no value is known for {_listed(map(str, rates))} baud" if rates else "",
                setting.note,
            )
            if part
        )


def setup_sheet(
    model: Model,
    settings: LineSettings,
    *,
    address: int | None = None,
    link_loss: LinkLossPolicy | None = None,
) -> list[SheetRow]:
    """Return the rows of a model's sheet by purpose, filled in for a drive with these line settings.

    address: None for a drive without an address yet. link_loss: None if the plant does not define it.
    """
    rows = []
    for setting in sorted(model.setup, key=lambda setting: list(PURPOSES).index(setting.purpose)):
        if setting.made_from is None:
            rows.append(SheetRow(setting=setting, value=setting.value, made_of=setting.means))
        elif setting.made_from in ("link_loss", "watchdog_s"):
            rows.append(_of_link_loss(setting, model, link_loss))
        elif setting.made_from == "address" and address is None:
            rows.append(SheetRow(setting=setting, made_of="its own address on the line"))
        else:
            rows.append(_made(setting, _said(setting.made_from, settings, address)))
    return rows


def uncovered_rates(setting: PanelSetting) -> tuple[int, ...]:
    """Return the usual baud rates, ascending, for which a setting made from the rate has no value."""
    if setting.made_from not in ("baudrate", "line") or not setting.codes:
        return ()
    covered = {each.partition(" ")[0] for each in setting.codes}
    return tuple(rate for rate in sorted(USUAL_BAUD_RATES) if str(rate) not in covered)


def codes_of(setting: PanelSetting, model: Model) -> Mapping[str, str]:
    """Return the panel's value for each value of the plant; for link loss, by default the values of the watchdog."""
    watchdog = model.watchdog
    if setting.codes or setting.made_from != "link_loss" or watchdog is None:
        return setting.codes
    return {policy: str(code) for policy, code in watchdog.actions.items()}


def held_codes(row: SheetRow, model: Model) -> tuple[int, ...]:
    """Return the numbers that the parameter of a row holds for its suitable values, the recommended one first.

    The result is empty if the parameter cannot be read, or no number is known; times have a scale of their own, and no
    number here.
    """
    info = parameter_at(row.setting.address, model)
    if info is None or row.setting.made_from == "watchdog_s":
        return ()
    if row.setting.hexadecimal:
        return tuple(int(value, 16) for value in row.right)
    texts = {text: code for code, text in info.values.items()}
    found = [texts.get(value, int(value) if value.isdecimal() else None) for value in row.right]
    return tuple(code for code in found if code is not None)


def in_words(made_from: MadeFrom | None, value: str) -> str:
    """Return a value of the plant with its unit or name, such as `9600 baud`."""
    if made_from == "parity":
        return _PARITIES.get(value, value)
    behind = {
        "baudrate": "baud",
        "bytesize": "data bits",
        "stopbits": "stop bit" if value == "1" else "stop bits",
    }.get(made_from or "", "")
    before = "address" if made_from == "address" else ""
    return " ".join(filter(None, (before, value, behind)))


def _said(made_from: MadeFrom, settings: LineSettings, address: int | None) -> str:
    """Return a value of the plant in the notation of a setting's codes."""
    rate, _, characters = str(settings).partition(" ")
    return {
        "address": str(address),
        "baudrate": rate,
        "bytesize": str(settings.bytesize),
        "parity": settings.parity,
        "stopbits": f"{settings.stopbits:g}",
        "format": characters,
        "line": str(settings),
    }[made_from]


def _made(setting: PanelSetting, said: str) -> SheetRow:
    words = in_words(setting.made_from, said)
    if setting.hexadecimal:
        value = f"{int(said):X}"
        return SheetRow(setting=setting, value=value, made_of=f"{words} = {value}, hexadecimal")
    if not setting.codes:
        return SheetRow(setting=setting, value=said, made_of=words)
    code = setting.codes.get(said)
    if code is None:
        return SheetRow(setting=setting, lacks=f"no value is known for {words}, only for {_listed(setting.codes)}")
    return SheetRow(setting=setting, value=code, made_of=words if code == said else f"{words} = {code}")


def _of_link_loss(setting: PanelSetting, model: Model, wanted: LinkLossPolicy | None) -> SheetRow:
    codes, watchdog = codes_of(setting, model), model.watchdog
    never = setting.codes.get("hold", "") or (str(watchdog.off) if watchdog and watchdog.off is not None else "")
    if setting.made_from == "watchdog_s":
        if wanted is None:
            off = f"; {never} is never" if never else ""
            return SheetRow(setting=setting, made_of=f"a time in {setting.unit}, as link_loss in the plant file{off}")
        if wanted.policy == "hold":
            if not never and (watchdog is None or "hold" not in watchdog.actions):
                return SheetRow(setting=setting, lacks="no value is known for hold")
            return SheetRow(setting=setting, value=never, made_of=f"hold = {never}" if never else "any, with hold")
        time = Decimal(str(wanted.watchdog_s)) * (1000 if setting.unit == "ms" else 1)
        return SheetRow(setting=setting, value=f"{time.normalize():f}", made_of=f"{time.normalize():f} {setting.unit}")
    if wanted is None:
        choices = _listed([f"{code} ({policy})" for policy, code in codes.items()], "or")
        return SheetRow(setting=setting, made_of=", ".join(filter(None, (choices, "as link_loss in the plant file"))))
    if wanted.policy in codes:
        code = codes[wanted.policy]
        return SheetRow(setting=setting, value=code, made_of=f"{wanted.policy} = {code}")
    if wanted.policy == "hold" and never:
        return SheetRow(setting=setting, made_of="any, with hold")
    return SheetRow(setting=setting, lacks=f"no value is known for {wanted.policy}, only for {_listed(codes)}")


def _listed(words: Iterable[str], last: str = "and") -> str:
    listed = list(words)
    return f"{', '.join(listed[:-1])} {last} {listed[-1]}" if len(listed) > 1 else "".join(listed)
