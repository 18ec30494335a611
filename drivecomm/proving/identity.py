"""Identity of a drive: findings about whether it belongs to the series of its model."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeVar, cast

from drivecomm.errors import DriveCommError, ReadOnlyError, in_one_line
from drivecomm.line import Job, Rank
from drivecomm.models import packaged_models, read_model
from drivecomm.protocol import KnowsSeries, Pause, with_each_command
from drivecomm.proving.findings import ProofFinding
from drivecomm.proving.private_data import public_identity

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from drivecomm.bus import Bus, Drive
    from drivecomm.protocol import Ask, Exchange, Model, Protocol, SeriesFound, Tell
    from drivecomm.proving.patient_reader import PatientReader

T = TypeVar("T")


def reported_identity(asker: PatientReader, drive: Drive) -> Mapping[str, str] | DriveCommError:
    """Return the identity that a drive reports, without its state, or the error that prevents it."""
    told = asker.answer(drive.identify)
    if isinstance(told, DriveCommError):
        return told
    return {key: text for key, text in told.items() if key != "state"}


def identity_findings(
    told: Mapping[str, str] | DriveCommError, model: Model, plugin: Protocol
) -> Iterator[ProofFinding]:
    """Yield the findings that follow from the drive's own identity."""
    rule = dict(model.identified_by)
    about = "which series it is, by its own word"
    if not rule:
        yield ProofFinding(
            kind="identity", verdict="not asked", about=about, why="the model has no rule for what a drive reports"
        )
        return
    if isinstance(told, DriveCommError):
        why = f"the drive does not report it: {in_one_line(told)}"
        yield ProofFinding(kind="identity", verdict="contradicts", about=about, model=rule, why=why)
        return
    said = {key: told[key] for key in rule if key in told}
    if model.matches(told) or _is_of_its_family(told, model, plugin):
        yield ProofFinding(kind="identity", verdict="agrees", about=about, model=rule, drive=said)
        return
    fitting = [each.name for each in _packaged(plugin) if each.matches(told)]
    could = f"; it is of model {' or '.join(fitting)} by that" if fitting else ""
    why = f"what it reports does not match the rule{could}" if said else "it reports nothing that the rule covers"
    yield ProofFinding(kind="identity", verdict="contradicts", about=about, model=rule, drive=said, why=why)


def series_findings(
    asker: PatientReader, drive: Drive, model: Model, plugin: Protocol, options: Any
) -> Iterator[ProofFinding]:
    """Yield the findings that distinguish the model's series from others, for protocols that can check a series."""
    address = drive.peer.name.rpartition(":")[2]
    operations = plugin.operations(int(address), options, model)
    if not isinstance(operations, KnowsSeries):
        return
    known = _packaged(plugin)
    others = [each for each in known if each.name != model.name] if model in known else []

    def ask() -> SeriesFound:
        found: SeriesFound = cast("Bus", drive.bus).run(
            Job(drive.peer, read_only_exchange(operations.check_series(others), plugin), Rank.READ)
        )
        return found

    about = "which series it is, by what it has and lacks"
    found = asker.answer(ask)
    if isinstance(found, DriveCommError):
        yield ProofFinding(kind="identity", verdict="not asked", about=about, why=in_one_line(found))
        return
    if found.against:
        could = f"; it could be {', '.join(found.candidates)}" if found.candidates else ""
        yield ProofFinding(kind="identity", verdict="contradicts", about=about, why=f"{found.against}{could}")
    elif found.open:
        yield ProofFinding(
            kind="identity",
            verdict="new",
            about=about,
            drive={"fits_as_well": list(found.open)},
            why="drives of these models would answer the same",
        )
    else:
        yield ProofFinding(kind="identity", verdict="agrees", about=about)


def public_part(told: Mapping[str, str] | DriveCommError, model: Model, *, with_names: bool) -> dict[str, str]:
    """Return the part of a drive's identity that goes into a proof."""
    if isinstance(told, DriveCommError):
        return {}
    return dict(told) if with_names else public_identity(told, model.identified_by)


def read_only_exchange(exchange: Exchange[T], plugin: Protocol) -> Exchange[T]:
    """Run an exchange, but raise ReadOnlyError at the first telegram that does more than read."""

    def checked(command: Ask | Tell | Pause) -> Ask | Tell | Pause:
        if not isinstance(command, Pause) and not (plugin.intent and plugin.intent(command.message).moves_nothing):
            raise ReadOnlyError("a proof without --move only reads, and this telegram would do more")
        return command

    return with_each_command(exchange, checked)


def _is_of_its_family(told: Mapping[str, str], model: Model, plugin: Protocol) -> bool:
    return any(each.extends == model.name and each.matches(told) for each in _packaged(plugin))


def _packaged(plugin: Protocol) -> Sequence[Model]:
    return [read_model(path, plugin.name, plugin.package) for path in packaged_models(plugin.package)]
