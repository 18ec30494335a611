"""Command `tune`: the shortest pause after a drive's replies, and the time that the drive takes to answer."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from drivecomm.cli import options
from drivecomm.cli.line_command import LineCommand
from drivecomm.cli.output import counted, emit, labels, note, plain, progress_bar, say, tell, times_ms
from drivecomm.cli.values import WHOLE_NUMBER
from drivecomm.commissioning import EXCHANGES, tune as find
from drivecomm.errors import DriveCommError, UsageError
from drivecomm.tomlfile import toml_line

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm import bus
    from drivecomm.cli.line_options import LineArguments
    from drivecomm.commissioning import TuningResult, TuningTrial
    from drivecomm.protocol import DriveConfig

_PERCENTILES = (50, 99)


@click.command(cls=LineCommand)
@options.drive
@options.model
@click.option(
    "--exchanges",
    type=WHOLE_NUMBER,
    metavar="NUMBER",
    default=EXCHANGES,
    help="Number of exchanges without an error that a result requires.",
)
@click.option("--write", is_flag=True, help="Write the result into the plant file.")
def tune(*, drive: str, line: LineArguments, model: str | None, exchanges: int, write: bool) -> int:
    """Find the shortest pause after a drive's replies, and its reply time-out, with requests that cannot move a motor.

    Takes some seconds up to a minute; nothing is written to the drive. A drive that fails with its usual pause gets a
    longer one, or more time for its replies. Exit code 1 if it still fails.
    """
    reached, name = line.reaching(drive)
    place = line.in_plant(drive)
    if write and place is None:
        raise UsageError(f"{drive} is not in a plant file that --write could change; name one: --plant plant.toml")
    reached.must_be_free("tune")
    trials: list[TuningTrial] = []
    with (
        reached.drive_at(name, model) as one,
        progress_bar("asking", shown=not line.json) as progress,
    ):

        def tried(trial: TuningTrial) -> None:
            trials.append(trial)
            if len(trials) == 1 and not trial.error:
                _foretell(trial.rest_s(exchanges, one.facts), as_json=line.json)

        try:
            found = find(one, exchanges, tried=tried, progress=progress)
        except (DriveCommError, KeyboardInterrupt):
            _tell_trials(trials, name, as_json=line.json)
            raise
    _tell(found, name, one, as_json=line.json)
    if found.error:
        return 1
    if not found.options:
        return 0
    options = ", ".join(toml_line(key, value) for key, value in found.options.items())
    if write and place is not None:
        _write(*place, found.options)
        tell(f"written to {place[0]}: {options}", as_json=line.json, **labels(name), written=place[0])
    elif not line.json:
        hint = "; --write adds them to the plant file" if place else ""
        say(f"options of the drive: {options}{hint}")
    return 0


def _write(file: str, number: int, options: Mapping[str, float]) -> None:
    from drivecomm.plant import write_options

    write_options(Path(file), number, options)


def _foretell(seconds: float, *, as_json: bool) -> None:
    if as_json:
        emit(seconds=round(seconds, 1))
    else:
        note(f"this takes {max(1, round(seconds))} s at most")


def _tell_trials(trials: list[TuningTrial], name: DriveConfig, *, as_json: bool) -> None:
    """Print the trials so far after tuning ended early."""
    if as_json:
        for each in trials:
            emit(**labels(name), trial=plain(each))
    elif sound := [each.turnaround_s for each in trials if not each.error]:
        say(
            f"{name.name}  interrupted; the shortest pause that worked so far is {_ms(min(sound))}, nothing was changed"
        )


def _tell(found: TuningResult, name: DriveConfig, drive: bus.Drive, *, as_json: bool) -> None:
    if as_json:
        emit(
            **labels(name),
            before=plain(found.before),
            after=plain(found.after),
            held_s=found.held_s,
            least_s=found.least_s,
            reply_delays=times_ms(found.reply_delays, _PERCENTILES) if found.reply_delays.count else None,
            reply_timeout_before_s=found.reply_timeout_before_s,
            gain=round(found.gain, 3),
            options=dict(found.options),
            error=found.error,
        )
        return
    if found.error:
        pause = _ms(found.after.turnaround_s)
        fails = f"{name.name}  fails with its usual pause of {pause} and with longer ones"
        say(f"{fails}: {found.error}; see drivecomm doctor")
        return
    usual, after = found.before, found.after
    if after.turnaround_s != usual.turnaround_s:
        say(
            f"{name.name}  pause {_ms(usual.turnaround_s)} -> {_ms(after.turnaround_s)}; {_ms(found.held_s)} was enough"
        )
    elif usual.error:
        say(f"{name.name}  pause {_ms(usual.turnaround_s)} stays; it only needs more time for its replies")
    else:
        say(f"{name.name}  pause {_ms(usual.turnaround_s)} stays: {_why(found, drive)}")
    gain = "" if usual.error else f", {found.gain:.2f} times as many"
    rates = f"{usual.per_second:.1f} -> {after.per_second:.1f} exchanges a second{gain}"
    say(f"{counted(after.exchanges, 'exchange')} without an error; {rates}")
    delays = found.reply_delays
    if delays.count:
        between = f"replies begin after {_ms(delays.shortest_s)} to {_ms(delays.longest_s)}"
        say(f"{between}; reply time-out {_ms(found.reply_timeout_before_s)} -> {_ms(found.reply_timeout_s)}")


def _why(found: TuningResult, drive: bus.Drive) -> str:
    if found.least_s < found.before.turnaround_s:
        return f"{_ms(found.held_s)} was enough, which leaves no room for a margin"
    unless = "" if drive.model is not None else " of some models; name the drive's --model"
    return f"the maker requires it{unless}"


def _ms(seconds: float) -> str:
    return f"{seconds * 1000:.4g} ms"
