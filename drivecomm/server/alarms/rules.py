"""Alarm rules, from the `[[alarm]]` tables of a plant file.

[[alarm]]
name = "pump tripped"            # optional: what it watches unless given
drives = ["pump"]                # optional: all drives (with a quantity: all for which it is polled) unless given
on = "fault"                     # fault, warning, silent or changed_since_baseline; or a limit instead:
# quantity = "output_current"    # as it is polled, with above or below
# above = 12.5                   # in the unit of the quantity
# hysteresis = 0.5               # optional: the condition lasts until the value has returned by this amount
for_s = 5                        # optional: seconds for which the condition must hold
over_s = 60                      # optional: seconds for which it must be gone; 60 unless given
remind_s = 3600                  # optional: seconds between reminders, until a user acknowledges the alarm
deliver = ["webhook:https://example.com/hook", "command:/usr/local/bin/page-me", "@mail"]   # optional
"""

from __future__ import annotations

from dataclasses import dataclass
from decimal import Decimal
from math import inf
from typing import TYPE_CHECKING, Literal, TypeAlias, get_args

from drivecomm.errors import UsageError, suggestion
from drivecomm.models import quantities
from drivecomm.server.alarms.receivers import check_entry, label_of
from drivecomm.tomlfile import LIST, NUMBER, SECONDS, TEXT

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    from drivecomm.protocol import DriveConfig
    from drivecomm.tomlfile import TomlTable

Watched: TypeAlias = Literal["fault", "warning", "silent", "changed_since_baseline", "limit"]
OVER_S = 60.0
"""A condition that returns within this time continues the same alarm."""

_STATES = tuple(each for each in get_args(Watched) if each != "limit")
_ONES_OF_STATE = '"fault", "warning", "silent" or "changed_since_baseline"'
_KEYS = {
    "name": TEXT,
    "drives": LIST,
    "on": TEXT,
    "quantity": TEXT,
    "above": NUMBER,
    "below": NUMBER,
    "hysteresis": NUMBER,
    "for_s": SECONDS,
    "over_s": SECONDS,
    "remind_s": SECONDS,
    "deliver": LIST,
}
_LEAST_S = {"for_s": 0.0, "over_s": 1.0, "remind_s": 60.0}


@dataclass(frozen=True, slots=True, kw_only=True)
class AlarmLimit:
    """A limit of a quantity. side: of the alarm, above or below. at, hysteresis: exact."""

    quantity: str
    side: Literal["above", "below"]
    at: Decimal
    hysteresis: Decimal = Decimal(0)

    def passed(self, value: Decimal | float, *, before: bool) -> bool:
        """Return whether a value is beyond the limit. before: whether the value before it was."""
        exact = value if isinstance(value, Decimal) else Decimal(str(value))
        back = self.hysteresis if before else Decimal(0)
        return exact > self.at - back if self.side == "above" else exact < self.at + back

    @property
    def where(self) -> str:
        """The range of the alarm: "above 12.5 A"."""
        return f"{self.side} {self.at}{self._unit}"

    @property
    def where_over(self) -> str:
        """The range in which the alarm is over: "at 12.0 A or below"."""
        back = self.at - self.hysteresis if self.side == "above" else self.at + self.hysteresis
        return f"at {back}{self._unit} or {'below' if self.side == 'above' else 'above'}"

    @property
    def _unit(self) -> str:
        known = quantities().get(self.quantity)
        return f" {known.unit}" if known is not None and known.unit else ""

    def __str__(self) -> str:
        return f"{self.quantity} {self.side} {self.at}"


@dataclass(frozen=True, slots=True, kw_only=True)
class AlarmRule:
    """A rule for alarms. drives: names of all drives that it watches. deliver: as in the plant file."""

    name: str
    on: Watched
    drives: tuple[str, ...]
    limit: AlarmLimit | None = None
    for_s: float = 0.0
    over_s: float = OVER_S
    remind_s: float | None = None
    deliver: tuple[str, ...] = ()

    @property
    def labels(self) -> list[str]:
        """The labels of the receivers, without any secret."""
        return [label_of(entry) for entry in self.deliver]

    def __str__(self) -> str:
        """Return the rule in words."""
        *others, last = self.drives
        drives = f"{', '.join(others)} or {last}" if others else last
        if self.limit is None:
            told = {
                "fault": ("has a fault", "without a fault"),
                "warning": ("has a warning", "without a warning"),
                "changed_since_baseline": ("is not set as its baseline", "as approved"),
            }
            begins, ends = told.get(self.on, ("does not answer", "of answers"))
            condition = f"{drives} {begins}"
        else:
            condition, ends = f"{self.limit.quantity} of {drives} is {self.limit.where}", self.limit.where_over
        held = f" for {self.for_s:g} s" if self.for_s else ""
        reminded = f"; a reminder every {self.remind_s:g} s" if self.remind_s else ""
        return f"alarm when {condition}{held}; cleared after {self.over_s:g} s {ends}{reminded}"


def read_alarms(
    tables: Sequence[TomlTable], drives: Sequence[DriveConfig], backed_up: Collection[str] = ()
) -> tuple[AlarmRule, ...]:
    """Return the rules of a plant file.

    tables: its `[[alarm]]`. drives: all drives of the plant. backed_up: the names of those that the server backs up.
    Raises FileFormatError with the file, the line, the entry and the reason.
    """
    rules: dict[str, AlarmRule] = {}
    for table in tables:
        rule = _rule(table, drives, backed_up)
        if rule.name in rules:
            raise table.error(f"two alarms are named {rule.name!r}; give this one another name", "name")
        rules[rule.name] = rule
    return tuple(rules.values())


def _rule(table: TomlTable, drives: Sequence[DriveConfig], backed_up: Collection[str]) -> AlarmRule:
    given = table.take(_KEYS)
    for key, least in _LEAST_S.items():
        if key in given and not least <= given[key] < inf:
            raise table.error(f"invalid {key} = {given[key]}; write {least:g} seconds or more", key)
    times = {key: float(given[key]) for key in _LEAST_S if key in given}
    limit = _limit(table) if "quantity" in given else None
    if limit is None:
        for key in ("above", "below", "hysteresis"):
            if key in given:
                raise table.error(f'{key} needs a quantity; write quantity = "output_current", for example', key)
        if "on" not in given:
            raise table.error(f"an alarm needs on = {_ONES_OF_STATE}, or a quantity with above or below")
        if given["on"] not in _STATES:
            raise table.error(f"unknown on = {given['on']!r}; {suggestion(given['on'], _STATES, 'use')}", "on")
    elif "on" in given:
        raise table.error("on and quantity define two alarms; write an [[alarm]] for each", "on")
    watched = _drives(table, drives, limit)
    if given.get("on") == "changed_since_baseline":
        watched = _backed_up(table, watched, backed_up)
    deliver = _texts(table, "deliver")
    for entry in deliver:
        try:
            check_entry(entry)
        except UsageError as error:
            raise table.error(str(error), "deliver") from None
    return AlarmRule(
        name=given.get("name") or (str(limit) if limit else given["on"]),
        on="limit" if limit else given["on"],
        drives=watched,
        limit=limit,
        deliver=deliver,
        **times,
    )


def _limit(table: TomlTable) -> AlarmLimit:
    given = table.content
    sides: list[Literal["above", "below"]] = [side for side in ("above", "below") if side in given]
    if len(sides) != 1:
        raise table.error("a quantity needs exactly one limit; write above = 12.5, or below, for example", "quantity")
    for key in (sides[0], "hysteresis"):
        if not -inf < given.get(key, 0) < inf or (key == "hysteresis" and given.get(key, 0) < 0):
            raise table.error(
                f"invalid {key} = {given[key]}; write a number" + " of 0 or more" * (key != sides[0]), key
            )
    # From the text in the file, because a float such as 0.1 is not exact.
    at, hysteresis = Decimal(str(given[sides[0]])), Decimal(str(given.get("hysteresis", 0)))
    return AlarmLimit(quantity=given["quantity"], side=sides[0], at=at, hysteresis=hysteresis)


def _drives(table: TomlTable, drives: Sequence[DriveConfig], limit: AlarmLimit | None) -> tuple[str, ...]:
    by_name = {drive.name: drive for drive in drives}
    named = _texts(table, "drives") if "drives" in table.content else tuple(by_name)
    for name in named:
        if name not in by_name:
            raise table.error(f"unknown drive {name!r}; {suggestion(name, by_name, 'the plant has')}", "drives")
    if limit is None:
        return tuple(dict.fromkeys(named))
    polled = {name: [each for group in by_name[name].poll for each in group.parameters] for name in named}
    with_it = tuple(name for name, each in polled.items() if limit.quantity in each)
    if without := [name for name in polled if name not in with_it]:
        name = without[0]
        if "drives" in table.content or not with_it:
            raise table.error(
                f"{limit.quantity} is not polled of {name}; {suggestion(limit.quantity, polled[name], 'polled are')}",
                "quantity",
            )
    return with_it


def _backed_up(table: TomlTable, drives: tuple[str, ...], backed_up: Collection[str]) -> tuple[str, ...]:
    """Return those of these drives that the server backs up. Raises FileFormatError if a named drive is not."""
    found = tuple(name for name in drives if name in backed_up)
    if len(found) < len(drives) and ("drives" in table.content or not found):
        name = next(each for each in drives if each not in found)
        raise table.error(
            f"the server does not back {name} up, so no change is detected; write backup = true in [server], or for "
            "this drive",
            "on",
        )
    return found


def _texts(table: TomlTable, key: str) -> tuple[str, ...]:
    found = table.content.get(key, [])
    if not all(isinstance(each, str) and each for each in found) or (key == "drives" and not found):
        raise table.error(f'invalid {key} = {found!r}; write a list of texts, such as ["one", "two"]', key)
    return tuple(found)
