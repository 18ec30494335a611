"""Stopping one drive, or all of a protocol: nothing that is wrong besides keeps a motor running."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, TypeVar

from drivecomm.cli.control.client import StopRequest, stop_by_holder
from drivecomm.cli.drive_names import plant_file
from drivecomm.cli.line_options import naming
from drivecomm.cli.output import complain, labels, tell
from drivecomm.cli.stop.served import one_stopped_by_server
from drivecomm.errors import FileFormatError, ServerLostError, UsageError
from drivecomm.protocol import LINE_FACT_NAMES, DriveConfig, parse_drive

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from contextlib import AbstractContextManager

    from drivecomm.bus import Bus
    from drivecomm.cli.control.client import StopResult
    from drivecomm.cli.line_options import LineOptions
    from drivecomm.protocol import Stop

T = TypeVar("T")


def stop_one(line: LineOptions, drive: str, model: str | None, how: Stop) -> None:
    """Stop a drive, or with PROTOCOL:* all of a protocol, and say so.

    The `start` that holds the line does it where there is one. Raises the error that the drive or its line answered
    with.
    """
    chosen = {"model": model} if model else {}
    protocol, colon, address = drive.partition(":")
    if colon and address == "*":
        request = StopRequest(how=how, protocols=((protocol, chosen),))
        if _stopped_by_holder(line, line, request):
            return
        try:
            _stop_all_of(line.bus(), protocol, chosen, how)
        except ServerLostError as error:
            complain(f"{error}; the port itself is tried now", as_json=line.json)
            _stop_all_of(line.own_bus(), protocol, chosen, how)
        done = f"stop ({how.value}) sent to all; nobody confirms a broadcast"
        tell(f"{drive}  {done}", as_json=line.json, drive=drive, drive_name=drive, done=done)
        return
    reached, name, broken = reached_for_stopping(line, drive)
    options = {**name.options, **chosen}
    request = StopRequest(how=how, drives=((name.name, name.protocol, name.address, options),))
    without = ""
    with reached.named_in_errors(), naming(name):
        by_server = one_stopped_by_server(reached.named_port, name, how, line.said_facts, as_json=line.json)
    if not by_server:
        if _stopped_by_holder(line, reached, request):
            return
        with reached.own_bus() as bus:
            one, without = as_far_as_possible(partial(bus.drive, name.protocol, name.address), options)
            with naming(name):
                one.stop(how)
    done = f"stop ({how.value}) commanded"
    tell(f"{name.name}  {done}", as_json=line.json, **labels(name), done=done, result=None)
    if broken or without:
        complain(broken or without, as_json=line.json)


def _stop_all_of(opening: AbstractContextManager[Bus], protocol: str, options: Mapping[str, Any], how: Stop) -> None:
    with opening as bus:
        everybody, _ = as_far_as_possible(partial(bus.broadcast, protocol), options)
        everybody.stop(how)


def as_far_as_possible(make: Callable[..., T], options: Mapping[str, Any]) -> tuple[T, str]:
    """Return what is made with these options, or without those that are invalid, and then why.

    A model whose file is missing is not needed for a stop. What raises without any options, too, is raised.
    """
    try:
        return make(**options), ""
    except Exception as error:  # noqa: BLE001 - whatever it is, a motor must still be stopped
        why = str(error)
    facts = {name: value for name, value in options.items() if name in LINE_FACT_NAMES}
    try:
        return make(**facts), f"without its options: {why}"
    except Exception:  # noqa: BLE001 - as above
        return make(), f"without its options: {why}"


def reached_for_stopping(line: LineOptions, text: str) -> tuple[LineOptions, DriveConfig, str]:
    """Return the line of a drive, the drive, and what is wrong with the plant file, empty if nothing is.

    --arm is not needed for it, and does no harm.
    """
    line = replace(line, arm=False)
    try:
        return (*line.reaching(text), "")
    except FileFormatError as error:
        file = plant_file(line.plant, port_given=False)
        if file is None:
            raise
        # Only a broken plant file takes the reader of such.
        from drivecomm.plant import salvaged  # noqa: PLC0415

        try:
            plant, _ = salvaged(file)
            drive = plant.drive(text.partition(",")[0])
        except UsageError:
            if ":" not in text.partition(",")[0] or line.port is None:
                raise error from None
            return replace(line, given=line.given | {"port"}), replace(parse_drive(text), line=line.port), str(error)
        return line.on(plant.line(drive.line), str(file)), drive, str(error)


def _stopped_by_holder(line: LineOptions, reached: LineOptions, request: StopRequest) -> bool:
    """Have the `start` that holds the line stop; False when there is none."""
    answers: list[StopResult] = []
    holder = stop_by_holder(reached.named_port, request, answers.append, reached.opening)
    if holder is None:
        return False
    for answer in answers:
        if answer.error is not None:
            raise answer.error
        told = "commanded" if answer.drive else "sent to all; nobody confirms a broadcast"
        instead = "" if answer.how is request.how else f", because it cannot by {request.how.value}"
        done = f"stop ({answer.how.value}{instead}) {told}"
        who = answer.drive or f"{answer.protocol}:*"
        tell(
            f"{who}  {done}, by {holder}",
            as_json=line.json,
            drive=who,
            drive_name=who,
            done=done,
            result=None,
            by=str(holder),
        )
    return True
