"""Command `report`: the commissioning record of a drive, as text and as a page to print."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from drivecomm.cli import options
from drivecomm.cli.baseline import system_user
from drivecomm.cli.line_command import LineCommand
from drivecomm.cli.output import counted, emit, labels, plain, print_columns, progress_bar, say
from drivecomm.cli.output_files import force_option, must_be_free
from drivecomm.cli.parameter_sets.saved import drive_of_set, entry_content, entry_text, parameter_label
from drivecomm.cli.values import FILE
from drivecomm.commissioning import take_record
from drivecomm.commissioning.drift import baseline_path, drift_between, live_addresses, read_baseline
from drivecomm.commissioning.parameter_sets import subject
from drivecomm.tomlfile import write_atomically

if TYPE_CHECKING:
    from drivecomm.cli.line_options import LineArguments
    from drivecomm.commissioning import CommissioningRecord
    from drivecomm.commissioning.parameter_sets import ParameterSet
    from drivecomm.protocol import DriveConfig

Section = tuple[str, list[tuple[str, str, str]]]
"""Heading and rows of a section; a row has a subject, its value and a remark."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SignedRecord:
    """Commissioning record with its author and time. title: title of the drive's series."""

    name: DriveConfig
    title: str
    record: CommissioningRecord
    baseline: str
    by: str
    time: datetime

    @property
    def sections(self) -> list[Section]:
        """Sections of the record, in reading order."""
        now, watchdog = self.record.now, self.record.watchdog
        drive = [
            ("drive", self.name.full_name, ""),
            ("series", self.title, f"model {now.model}"),
            ("firmware", now.firmware or "not reported", ""),
            *((key, text, "") for key, text in now.identity.items()),
        ]
        motor = [(entry.common, str(entry), entry.address) for entry in self.record.motor]
        silent = [("if the master falls silent", str(watchdog) if watchdog else "cannot be read", "")]
        return [
            ("Drive", drive),
            ("Motor", motor or [("no name plate data can be read", "", "")]),
            ("Loss of the link", silent),
            self._settings(),
            (
                "Approval",
                [("approved set", self.baseline, ""), ("recorded by", self.by, f"{self.time:%Y-%m-%d %H:%M} UTC")],
            ),
        ]

    def _settings(self) -> Section:
        differing = self.record.differing
        if differing is None:
            rows = [
                (f"{entry.address} {entry.name}".rstrip(), str(entry), "")
                for entry in self.record.now.of(("settings",))
            ]
            return f"Settings: all {len(rows)}, since the drive does not report its factory values", rows
        rows = [
            (parameter_label(each), entry_text(each.right), f"factory {entry_text(each.left)}") for each in differing
        ]
        return f"Settings that differ from the factory values: {len(rows)}", rows


@click.command(cls=LineCommand)
@options.drive
@options.model
@click.option(
    "--by", metavar="WHO", help="Name of the person who commissions the drive. Default: the user of this system."
)
@click.option("--html", type=FILE, help="Write the record as a page to print.")
@force_option
def report(
    *, drive: str, line: LineArguments, model: str | None, by: str | None, html: Path | None, force: bool
) -> int:
    """Print the commissioning record of a drive: identity, motor, link loss, settings other than the factory's.

    Nothing is written to the drive.
    """
    must_be_free(html, "--html", force=force)
    signed_by = by or system_user("name the person who takes the record with --by")
    reached, name = line.reaching(drive)
    with (
        drive_of_set(reached, name, model) as one,
        progress_bar("reading", shown=not line.json) as progress,
    ):
        record = take_record(one, progress=progress)
        title = one.model.title if one.model else ""
        live = live_addresses(subject(one))
    signed = SignedRecord(
        name=name,
        title=title,
        record=record,
        baseline=_compared_with_baseline(drive, record.now, live, name, line),
        by=signed_by,
        time=datetime.now(UTC).replace(microsecond=0),
    )
    if line.json:
        emit(**labels(name), **_content(signed))
    else:
        _print(signed)
    if html is not None:
        # Imported late, because text output does not need it.
        from drivecomm.cli.report_page import page

        write_atomically(html, page(signed))
    return 0


def _compared_with_baseline(
    text: str, now: ParameterSet, live: frozenset[str], name: DriveConfig, line: LineArguments
) -> str:
    """Return a text on whether the drive agrees with its approved set, and who approved the set."""
    place = line.in_plant(text)
    path = baseline_path(Path(place[0]), name.name) if place else None
    if path is None or not path.exists():
        return "none"
    approved = read_baseline(path)
    drift = drift_between(approved, now, live)
    by = f"approved by {approved.approved.by} on {approved.approved.time:%Y-%m-%d}" if approved.approved else ""
    if drift.replaced:
        return f"of another drive, {by}"
    apart = len(drift.changed) + len(drift.not_comparable)
    if not apart:
        return f"as {by}"
    return f"{counted(apart, 'parameter')} {'differs' if apart == 1 else 'differ'}, {by}"


def _content(signed: SignedRecord) -> dict[str, Any]:
    """Return a record as JSON content."""
    record, now = signed.record, signed.record.now
    differing = None
    if record.differing is not None:
        differing = [
            {
                "parameter": each.address,
                "quantity": each.name,
                "factory": entry_content(each.left),
                "now": entry_content(each.right),
            }
            for each in record.differing
        ]
    return {
        "model": now.model,
        "title": signed.title,
        "firmware": now.firmware,
        "identity": dict(now.identity),
        "motor": {each.address: {"quantity": each.common, **entry_content(each)} for each in record.motor},
        "link_loss": plain(record.watchdog),
        "differing": differing,
        "not_read": dict(now.not_read),
        "baseline": signed.baseline,
        "by": signed.by,
        "time": signed.time.isoformat(),
    }


def _print(signed: SignedRecord) -> None:
    for heading, rows in signed.sections:
        say(heading)
        print_columns(("  " + what, value, remark) for what, value, remark in rows)
    for address, reason in signed.record.now.not_read.items():
        say(f"not read: {address}  {reason}")
