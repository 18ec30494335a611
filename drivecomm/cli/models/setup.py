"""Command `models setup`: the settings to make at the panel of a drive, with the values of its plant."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import click

from drivecomm.cli import options
from drivecomm.cli.commands import CliCommand
from drivecomm.cli.drive_names import known_plant
from drivecomm.cli.models.named import model_named
from drivecomm.cli.output import emit, print_columns, say
from drivecomm.cli.output_files import force_option, must_be_free
from drivecomm.cli.values import FILE
from drivecomm.errors import UsageError
from drivecomm.models import PURPOSES, load_model, setup_sheet
from drivecomm.protocol import CERTAIN, installed, parse_drive, resolve_options
from drivecomm.tomlfile import write_atomically

if TYPE_CHECKING:
    from pathlib import Path

    from drivecomm.models import SheetRow
    from drivecomm.protocol import DriveConfig, LineSettings, Model


@dataclass(frozen=True, slots=True, kw_only=True)
class FilledSheet:
    """Set-up sheet with the values filled in. drive: None for the defaults of the series."""

    model: Model
    drive: DriveConfig | None
    settings: LineSettings
    rows: tuple[SheetRow, ...]

    @property
    def about(self) -> str:
        """Subject of the sheet, as one line."""
        whose = f"for {self.drive.full_name}" if self.drive else "for any drive of the series"
        return f"{self.model.title}, {whose}, at {self.settings}"


@click.command(cls=CliCommand)
@click.argument("series", required=False, help="NAME, PROTOCOL/NAME, or a .toml file. Default: that of the drive.")
@click.option(
    "--for",
    "drive",
    metavar="DRIVE",
    shell_complete=options.complete_drive,
    help="Fill in the values of this drive: a name from the plant file, or PROTOCOL:ADDRESS.",
)
@click.option("--plant", type=FILE, help="Plant file that names the drives. Default: $DRIVECOMM_PLANT or plant.toml.")
@click.option("--html", type=FILE, help="Write the sheet as a page to print.")
@force_option
@options.json
def setup(
    *, series: str | None, drive: str | None, plant: Path | None, html: Path | None, force: bool, json: bool
) -> int:
    """Show the panel settings that a drive needs to communicate and to obey commands.

    With --for, the address, line settings and link loss of that drive are filled in; without, the series' defaults.
    """
    must_be_free(html, "--html", force=force)
    if plant is not None and drive is None:
        raise UsageError("--plant has no effect without --for; leave it out")
    sheet = filled_sheet(series, _drive(drive, plant) if drive else None)
    show_sheet(sheet, as_json=json)
    if html is not None:
        # Imported late, because text output does not need it.
        from drivecomm.cli.models.setup_page import page

        write_atomically(html, page(sheet))
    return 0


def _drive(text: str, plant: Path | None) -> DriveConfig:
    """Return a drive of the plant with the settings of its line, or a drive named by its protocol and address."""
    known = known_plant(plant, port_given=False)
    named = {each.name for each in known.drives} if known else set()
    if known is None or (":" in text and text not in named and text not in map(str, known.drives)):
        return parse_drive(text)
    found = known.drive(text)
    return known.line(found.line).reached(found)


def filled_sheet(series: str | None, drive: DriveConfig | None) -> FilledSheet:
    """Return the sheet of a series, or of the series of a drive. Raises UsageError."""
    chosen = dict(drive.options) if drive else {}
    own = chosen.pop("model", None)
    if drive is None:
        if series is None:
            raise UsageError("name a series, or a drive with --for; drivecomm models list shows the series")
        model = model_named(series, None)
    elif series is None:
        if own is None:
            raise UsageError(f"{drive.full_name} has no model; name its series")
        model = load_model(installed[drive.protocol].package, drive.protocol, own)
    else:
        model = model_named(series, None if series.endswith(".toml") or "/" in series else drive.protocol)
        if model.protocol != drive.protocol:
            raise UsageError(f"{series} is a series of {model.protocol}, and {drive.full_name} speaks {drive.protocol}")
    settings = resolve_options(installed[model.protocol], model, chosen)[0].settings
    address, link_loss = (drive.address, drive.link_loss) if drive else (None, None)
    rows = setup_sheet(model, settings, address=address, link_loss=link_loss)
    return FilledSheet(model=model, drive=drive, settings=settings, rows=tuple(rows))


def show_sheet(sheet: FilledSheet, *, as_json: bool) -> None:
    """Print the panel settings of a sheet, by purpose."""
    if as_json:
        for row in sheet.rows:
            emit(value=row.value, made_of=row.made_of, lacks=row.lacks, setting=row.setting)
        return
    say(f"{sheet.model.protocol}/{sheet.model.name}  {sheet.about}")
    if not sheet.rows:
        say("no panel setting of this series is documented in our sources")
    for purpose, heading in PURPOSES.items():
        rows = [row for row in sheet.rows if row.setting.purpose == purpose]
        if rows:
            say()
            say(heading)
            print_columns(_columns(row) for row in rows)


def _columns(row: SheetRow) -> tuple[str, ...]:
    setting = row.setting
    factory = f"factory {setting.factory}" if setting.factory else ""
    return (
        f"  {setting.parameter}",
        setting.name,
        row.value or "-",
        row.made_of,
        factory,
        "" if setting.sure in CERTAIN else setting.sure,
        "; ".join((*row.remarks, setting.source)),
    )
