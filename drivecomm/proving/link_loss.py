"""Settings of a drive's own watchdog, read and compared with [watchdog] of its model."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from drivecomm.bus import read_watchdog
from drivecomm.errors import DriveCommError, in_one_line
from drivecomm.proving.findings import ProofFinding

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from drivecomm.bus import Drive
    from drivecomm.protocol import Model
    from drivecomm.proving.parameters import ParameterAnswers
    from drivecomm.proving.patient_reader import PatientReader

_LONGEST_S = 3600
"""Longest plausible watchdog timeout in seconds; a longer one indicates another scale or another parameter."""

ABOUT = "what it does when its master falls silent"


def watchdog_facts(model: Model) -> dict[str, Any]:
    """Return the watchdog fact of the model as a proof records it."""
    watchdog = model.watchdog
    if watchdog is None:
        return {}
    said: dict[str, Any] = {"time": watchdog.time, "action": watchdog.action, "actions": dict(watchdog.actions)}
    said["off"] = watchdog.off
    return {key: value for key, value in said.items() if value not in ("", None)}


def link_loss_findings(
    asker: PatientReader, drive: Drive, model: Model, told: Mapping[str, ParameterAnswers]
) -> Iterator[ProofFinding]:
    """Yield the findings about the drive's watchdog settings. told: the answers about parameters read before."""
    if model.watchdog is None:
        yield ProofFinding(
            kind="link loss", verdict="not asked", about=ABOUT, why="the model has no watchdog to be read"
        )
        return
    watchdog, said = model.watchdog, watchdog_facts(model)
    places = tuple(each for each in (watchdog.time, watchdog.action) if each)
    setting = asker.answer(lambda: read_watchdog(drive))
    if isinstance(setting, DriveCommError):
        yield ProofFinding(
            kind="link loss",
            verdict="contradicts",
            about=ABOUT,
            addresses=places,
            model=said,
            why=f"its parameters cannot be read: {in_one_line(setting)}",
        )
        return
    heard: dict[str, Any] = {"setting": str(setting), "time": setting.time_value}
    heard |= {} if setting.action_value is None else {"action": setting.action_value}
    against = list(_against(setting.policy is None, setting.time_s, setting.action_value, places, told))
    # Without an action parameter, a time of 0 proves nothing: many parameters hold 0.
    decisive = not against and bool(setting.action_value or setting.time_value)
    yield ProofFinding(
        kind="link loss",
        verdict="contradicts" if against else "agrees",
        about=ABOUT,
        addresses=places,
        model=said,
        drive=heard,
        shows=("setting",) if decisive else (),
        why="; ".join(against),
    )


def _against(
    unknown: bool, time_s: Any, action: Any, places: tuple[str, ...], told: Mapping[str, ParameterAnswers]
) -> Iterator[str]:
    if unknown:
        yield f"the drive's action is set to {action}, which is not one of the model's actions"
    if time_s is not None and not 0 <= time_s <= _LONGEST_S:
        yield f"a time of {time_s} s is longer than any drive waits"
    for place in places:
        if (one := told.get(place)) is not None:
            for answer in one.readings.values():
                if not isinstance(answer, DriveCommError) and answer.doubt:
                    yield f"{place}: {answer.doubt}"
