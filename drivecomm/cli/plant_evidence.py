"""Read-only `plant` commands: telegrams, violations, counters and states of virtual drives."""

from __future__ import annotations

from typing import Any

import click

from drivecomm.cli import options
from drivecomm.cli.commands import CliCommand
from drivecomm.cli.output import emit, note, print_columns, say
from drivecomm.cli.plant import control_option, given_order
from drivecomm.cli.values import WHOLE_NUMBER

_line_option = click.option("--line", metavar="LINE", default="", help="The line, if the plant has several.")


@click.command(cls=CliCommand)
@click.option("--since", type=WHOLE_NUMBER, metavar="N", default=0, help="Only those after this number.")
@_line_option
@control_option
@options.json
def telegrams(*, since: int, line: str, control: str, json: bool) -> int:
    """Show the telegrams on a line, decoded, with the master's violations; the last 5000 transmissions are kept."""
    while True:
        answer = given_order(control, "telegrams", line=line, since=since)
        since = answer["last"]
        if json:
            emit(**answer)
        elif answer["missing"]:
            note(f"{answer['missing']} earlier transmissions are no longer stored")
        for each in [] if json else answer["telegrams"]:
            remarks = "".join(f"  [{remark}]" for remark in each["remarks"])
            say(f"{each['number']:>6} {each['time_s']:11.4f}  {each['source']:<7}  {each['telegram']}{remarks}")
        if not answer["more"]:
            return 0


@click.command(cls=CliCommand)
@_line_option
@control_option
@options.json
def violations(*, line: str, control: str, json: bool) -> int:
    """Show the rule violations of a line's master. Exit code 1 if it violated a required limit."""
    answer = given_order(control, "violations", line=line)
    if json:
        emit(**answer)
    else:
        for each in answer["violations"]:
            say(f"{each['at_s']:11.4f}  {each['sentence']}")
        failures, notes = (sum(answer[sort].values()) for sort in ("failures", "notes"))
        say(f"{failures} failures, {notes} notes")
    return 1 if answer["failures"] else 0


@click.command(cls=CliCommand)
@control_option
@options.json
def counters(*, control: str, json: bool) -> int:
    """Show the counters of telegrams, faults and violations."""
    answer = given_order(control, "counters")
    if json:
        emit(**answer)
        return 0
    rows = [("drive", "requests", "replies", "damaged", "kinds"), *map(_counted, answer["drives"])]
    print_columns(rows)
    for line in answer["lines"]:
        sorts = {**line["transmissions"], **line["failures"], **_notes(line["notes"]), **line["faults"]}
        say(f"{line['name']}: {', '.join(f'{name} {number}' for name, number in sorts.items()) or 'nothing yet'}")
        for fault in line["script"]:
            say(f"{line['name']}: {fault}")
    return 0


def _counted(drive: dict[str, Any]) -> tuple[str, ...]:
    kinds = ", ".join(f"{kind} {number}" for kind, number in drive["kinds"].items())
    return (drive["name"], *(str(drive[name]) for name in ("requests", "replies", "damaged")), kinds)


def _notes(notes: dict[str, int]) -> dict[str, int]:
    return {f"note: {rule}": number for rule, number in notes.items()}


@click.command(cls=CliCommand)
@control_option
@options.json
def state(*, control: str, json: bool) -> int:
    """Show the present state of each drive: motor, reference, line settings."""
    answer = given_order(control, "state")
    if json:
        emit(**answer)
        return 0
    rows = [("drive", "", "motor", "Hz", "target", "A", "fault", "settings")]
    for each in answer["drives"]:
        motor = "running" if each["running"] else "stopped" if each["powered"] else "no power"
        numbers = (f"{each[name]:.2f}" for name in ("output_hz", "target_hz", "current_a"))
        rows.append((each["name"], each["drive"], motor, *numbers, str(each["fault"] or ""), each["settings"]))
    print_columns(rows)
    return 0
