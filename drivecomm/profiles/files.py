"""Control profiles as TOML: the profiles that come with drivecomm, and the keys of a profile.

    name = "drivecom"           extends = "...", to begin with all keys of another one; [bits] and [flags] key by key
    title = ""  source = ""     valid = 0x0400  idle = 0  off = 0x0007  reverse = 0x8000  full = 16384
    runs = { mask = 0, value = 0 }   condition of each control word that lets a motor run
    follows = { mask = 0, value = 0 }   condition of each control word with which a motor follows its reference
    [[start]]                   one step each: word, and unless, until, repeats, pause_s, mask, place
    [stop]                      ramp, coast, quick, dc_brake: a list of such steps
    [[reset]]                   as in [[start]]
    [[refused]]                 when, say
    named_states = false        whether a status shows the state by name, too
    [[state]]                   name, mask and value, means, shows, motor, stands; the first one that fits counts
    [[transition]]              from, to, and mask and value, or rising
    [bits]                      running, fault, warning, at_reference, reverse, remote: the condition of each
    [flags]                     names of bits of the status word, by their number

A condition is the number of a bit, the name of a state, or a table with mask and value, or with bit and active. A list
of conditions may be given instead of one; one of them must hold.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drivecomm.errors import UsageError, suggestion
from drivecomm.profiles.profile import (
    SOLE_PLACE,
    BitCondition,
    ControlProfile,
    ControlStep,
    StartRefusal,
    State,
    StateTransition,
)
from drivecomm.protocol import DriveState, Stop
from drivecomm.tomlfile import CHOICE, LIST, NUMBER, TABLE, TABLES, TEXT, WHOLE, Kind, TomlTable, read_toml

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

_TABLES = Path(__file__).parent / "tables"
_WHEN = Kind((int, str, dict, list), "the number of a bit, the name of a state, or { mask = 0, value = 0 }")
_VALUES = ("valid", "off", "reverse", "full")
_BITS = ("running", "fault", "warning", "at_reference", "reverse", "remote")
_MOTOR = ("off", "run", "ramp", "quick", "dc_brake", "hold")
KEYS = {
    "name": TEXT, "extends": TEXT, "title": TEXT, "source": TEXT, "idle": WHOLE, **dict.fromkeys(_VALUES, WHOLE),
    "runs": _WHEN, "follows": _WHEN, "start": TABLES, "start_reverse": TABLES, "stop": TABLE, "reset": TABLES,
    "refused": TABLES, "state": TABLES, "named_states": CHOICE, "transition": TABLES, "bits": TABLE, "flags": TABLE,
}  # fmt: skip
"""Keys of a control profile, with the kinds of their values."""
_STEP = {
    "word": WHOLE, "place": TEXT, "mask": WHOLE, "unless": _WHEN, "until": _WHEN, "repeats": CHOICE, "pause_s": NUMBER,
}  # fmt: skip
_STATE = {
    "name": TEXT, "mask": WHOLE, "value": WHOLE, "means": TEXT, "shows": WHOLE, "motor": TEXT, "stands": TEXT,
}  # fmt: skip
_CONDITION = {"mask": WHOLE, "value": WHOLE, "values": LIST, "bit": WHOLE, "active": WHOLE, "place": TEXT}
_TRANSITION = {"from": LIST, "to": TEXT, "mask": WHOLE, "value": WHOLE, "rising": WHOLE}


def control_profiles() -> tuple[str, ...]:
    """Return the names of the profiles that come with drivecomm."""
    return tuple(sorted(each.stem for each in _TABLES.glob("*.toml")))


@cache
def control_profile(name: str) -> ControlProfile:
    """Return a profile that comes with drivecomm. Raises UsageError for another name."""
    return control_profile_from(_content(name))


def control_profile_from(table: TomlTable) -> ControlProfile:
    """Return the profile that a table describes. Raises FileFormatError that names the key and the mistake."""
    given = table.take(KEYS, "name")
    states = tuple(_state(each) for each in table.tables("state"))
    read = _Reader({state.name: state.known_by for state in states})
    return ControlProfile(
        name=given["name"],
        title=given.get("title", ""),
        source=given.get("source", ""),
        **{key: given[key] for key in (*_VALUES, "named_states") if key in given},
        # If every word commands, there is no idle word, even if the extended profile has one.
        idle=given.get("idle") if given.get("valid") else None,
        runs=next(iter(read.conditions(table, "runs")), None),
        follows=next(iter(read.conditions(table, "follows")), None),
        start=read.steps(table.tables("start")),
        start_reverse=read.steps(table.tables("start_reverse")),
        stops={how: read.steps(_stops(table).tables(how.value)) for how in Stop if how.value in _stops(table).content},
        reset=read.steps(table.tables("reset")),
        refusals=tuple(read.refusal(each) for each in table.tables("refused")),
        states=states,
        bits={
            key: read.conditions(table.table("bits"), key)
            for key in table.table("bits").take(dict.fromkeys(_BITS, _WHEN))
        },
        flags=_flags(table.table("flags")),
        transitions=tuple(_transition(each, read.states) for each in table.tables("transition")),
    )


class _Reader:
    """Reader of entries that refer to states by name."""

    def __init__(self, states: Mapping[str, BitCondition]) -> None:
        self.states = states

    def steps(self, tables: Iterable[TomlTable]) -> tuple[ControlStep, ...]:
        return tuple(self._step(each) for each in tables)

    def refusal(self, table: TomlTable) -> StartRefusal:
        given = table.take({"when": _WHEN, "say": TEXT}, "when", "say")
        return StartRefusal(when=self.conditions(table, "when"), say=given["say"])

    def conditions(self, table: TomlTable, key: str) -> tuple[BitCondition, ...]:
        given = table.content.get(key, [])
        each_given = given if isinstance(given, list) else [given]
        return tuple(self._condition(table, key, each) for each in each_given)

    def _step(self, table: TomlTable) -> ControlStep:
        given = table.take(_STEP, "word")
        awaited = {key: self.conditions(table, key) for key in ("unless", "until")}
        return ControlStep(**{**given, **awaited})

    def _condition(self, table: TomlTable, key: str, given: Any) -> BitCondition:
        if isinstance(given, str):
            if given not in self.states:
                raise table.error(
                    f"{key}: there is no state {given!r}; {suggestion(given, self.states, 'there are')}", key
                )
            return self.states[given]
        if isinstance(given, int) and not isinstance(given, bool):
            return BitCondition(mask=1 << given, values=(1 << given,))
        if not isinstance(given, dict):
            raise table.error(f"invalid {key} = {given!r}; write {_WHEN.words}", key)
        said = TomlTable(given, "", None, key).take(_CONDITION)
        if "bit" in said:
            mask = 1 << said["bit"]
            return BitCondition(mask=mask, values=(mask * said.get("active", 1),), place=said.get("place", SOLE_PLACE))
        if "mask" not in said or not {"value", "values"} & said.keys():
            raise table.error(f"{key}: write mask and value, or bit and active", key)
        values = tuple(said["values"]) if "values" in said else (said["value"],)
        return BitCondition(mask=said["mask"], values=values, place=said.get("place", SOLE_PLACE))


def _stops(table: TomlTable) -> TomlTable:
    stops = table.table("stop")
    stops.take({how.value: TABLES for how in Stop})
    return stops


def _state(table: TomlTable) -> State:
    given = table.take(_STATE, "name", "mask", "value", "means")
    if given["means"] not in {each.value for each in DriveState}:
        raise table.error(f"means {given['means']!r}: write {' or '.join(each.value for each in DriveState)}", "means")
    if given.get("motor", "off") not in _MOTOR:
        raise table.error(f"motor {given['motor']!r}: write {' or '.join(_MOTOR)}", "motor")
    return State(
        name=given["name"],
        known_by=BitCondition(mask=given["mask"], values=(given["value"],)),
        means=DriveState(given["means"]),
        shows=given.get("shows", given["value"]),
        motor=given.get("motor", "off"),
        stands=given.get("stands", ""),
    )


def _transition(table: TomlTable, states: Mapping[str, BitCondition]) -> StateTransition:
    given = table.take(_TRANSITION, "from", "to")
    for name in (*given["from"], given["to"]):
        if name not in states:
            raise table.error(f"there is no state {name!r}; {suggestion(str(name), states, 'there are')}")
    return StateTransition(
        origins=frozenset(given["from"]),
        mask=given.get("mask", 0),
        value=given.get("value", 0),
        rising=given.get("rising", 0),
        goal=given["to"],
    )


def _flags(table: TomlTable) -> dict[int, str]:
    given = table.take({str(bit): TEXT for bit in range(32)})
    return {int(bit): given[bit] for bit in sorted(given, key=int)}


def _content(name: str) -> TomlTable:
    """Return the table of a profile, merged over the table of the profile that it extends."""
    if name not in control_profiles():
        raise UsageError(f"there is no control profile {name!r}; {suggestion(name, control_profiles(), 'there are')}")
    own = read_toml(_TABLES / f"{name}.toml", "a control profile", shown=f"control profile {name}")
    below = own.content.get("extends")
    if not isinstance(below, str):
        return own
    base = _content(below).content
    single = {key: {**base.get(key, {}), **own.content.get(key, {})} for key in ("bits", "flags")}
    content = {**base, **own.content, **single}
    return TomlTable({key: value for key, value in content.items() if key != "extends"}, f"control profile {name}")
