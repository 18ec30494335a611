"""Proof that a drive is of its model's series, before its first write or command.

A word that stops one series starts another. So a drive is checked once on each opened port, and again after it was
away; reading needs no proof, and a stop never waits for it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, TypeVar

from drivecomm.errors import (
    DeadlineError,
    DriveCommError,
    OvertakenError,
    ReplyError,
    UsageError,
    WrongDriveError,
    shortened,
)
from drivecomm.protocol import CONFIRMED, Ask, KnowsSeries, resolve_options, without_repeats

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from drivecomm.protocol import Exchange, Message, Model, Operations, Protocol

T = TypeVar("T")

_MOST_NAMED = 8
"""Maximum number of candidates in a message; a longer list does not help."""


class ProvenDrives:
    """The drives of one bus whose series is proven.

    warn: called with a sentence about a drive of which only the registers support its model. are_real: whether warnings
    make sense; the drives of a virtual line have no name plates.
    """

    def __init__(self, warn: Callable[[str], None]) -> None:
        self.are_real = True
        self._warn = warn
        self._models: dict[str, str] = {}
        self._warned: set[str] = set()

    def has(self, drive: str, model: str) -> bool:
        """Return whether a drive was proven to be of a model's series since the port was opened."""
        return self._models.get(drive) == model

    def add(self, drive: str, model: str) -> None:
        """Record that a drive has been proven."""
        self._models[drive] = model

    def forget(self, drive: str) -> None:
        """Require a new proof of a drive that was away, because it may have been exchanged."""
        self._models.pop(drive, None)

    def warn_once(self, drive: str, text: str) -> None:
        """Report a warning, unless one about this drive was reported before."""
        if self.are_real and drive not in self._warned:
            self._warned.add(drive)
            self._warn(text)


@dataclass(frozen=True, slots=True, kw_only=True)
class SeriesProof:
    """The proof of one drive. confirmed: the model that a person has compared with its name plate; empty if none."""

    name: str
    plugin: Protocol
    model: Model
    operations: Operations
    confirmed: str
    proven: ProvenDrives

    def prove(self) -> Exchange[None]:
        """Check the drive as `check` does, and warn if only its registers support its model."""
        return self._proven_or_warned(self.check())

    def check(self) -> Exchange[str]:
        """Check the drive, unless it was checked since the port was opened; return why the proof is weak, or "".

        The models for the comparison are loaded immediately, not while the exchange has the line. Raises
        WrongDriveError for a drive that is not, or may not be, of the series, and UsageError if the drive is confirmed
        as another model, or if a drive has contradicted a command of its model.
        """
        if self.model.proofs:
            self._must_not_be_contradicted()
        if self._compared is not None and not self.proven.has(self.name, self.model.name):
            packaged(self.plugin)
        return self._checked()

    def _must_not_be_contradicted(self) -> None:
        # Imported here: few models have proofs, and a program that only reads needs no rules for models.
        from drivecomm.models import contradicted_orders

        if against := contradicted_orders(self.model):
            raise UsageError(
                f"a command of model {self.model.name} rests on {against[0]}, which a drive has contradicted; correct "
                f"the model before {self.name} is commanded or written"
            )

    @property
    def _compared(self) -> KnowsSeries | None:
        """Operations that compare the drive with other models; None if its identity or a confirmation decides."""
        operations = self.operations
        told = self.model.identified_by or self.confirmed
        return operations if isinstance(operations, KnowsSeries) and not told else None

    def _proven_or_warned(self, check: Exchange[str]) -> Exchange[None]:
        if weak := (yield from check):
            self.proven.warn_once(self.name, weak)

    def _checked(self) -> Exchange[str]:
        weak = ""
        if self.proven.has(self.name, self.model.name):
            return weak
        if self.confirmed not in ("", self.model.name):
            raise UsageError(
                f"{self.name} is confirmed as {shortened(self.confirmed)}, and its model is {self.model.name}; compare "
                "its name plate, and confirm the model that is right"
            )
        if self.model.identified_by:
            yield from self._identified()
        elif (operations := self._compared) is not None:
            weak = yield from self._evident(operations)
        self.proven.add(self.name, self.model.name)
        return weak

    def _identified(self) -> Exchange[None]:
        identity = yield from self.operations.identify(tuple(self.model.identified_by))
        if self.model.matches(identity):
            return
        told = {key: identity[key] for key in self.model.identified_by if identity.get(key)}
        fitting = [each for each in packaged(self.plugin) if each.matches(identity)]
        if any(each.extends == self.model.name for each in fitting):
            # The model of a whole family is also right for the series that extend it.
            return
        if not told and (self.confirmed or not isinstance(self.operations, KnowsSeries)):
            # The drive does not report its series; if no tables depend on it, the protocol is the same on every drive.
            return
        found = ", ".join(f"{key} {value}" for key, value in told.items()) or "nothing that identifies its series"
        raise self._wrong(f"it reports {found}", [each.name for each in fitting])

    def _evident(self, operations: KnowsSeries) -> Exchange[str]:
        known = packaged(self.plugin)
        # A user's own model file describes the user's own drive, so it is not compared with other models.
        others = known if self.model in known else ()
        found = yield from operations.check_series(others)
        if found.against:
            raise self._wrong(found.against, found.candidates)
        if found.open:
            raise WrongDriveError(
                f"{self.name} answers as a drive of model {self.model.name}, and one of {_listed(found.open)} would "
                "answer the same",
                model=self.model.name,
                candidates=(self.model.name, *found.open),
            )
        return (
            f"{self.name} has the registers of model {self.model.name}, which does not prove its series; compare its "
            f"name plate, and confirm it with {CONFIRMED}={self.model.name}"
        )

    def _wrong(self, found: str, candidates: Sequence[str]) -> WrongDriveError:
        others = [each for each in candidates if each != self.model.name]
        could = f"; it could be {_listed(others)}" if 0 < len(others) <= _MOST_NAMED else ""
        return WrongDriveError(
            f"{self.name} is not a drive of model {self.model.name}, or not set up as one: {found}{could}; nothing was "
            "written",
            model=self.model.name,
            found=found,
            candidates=tuple(others),
        )


def fitting(plugin: Protocol, address: int, models: Iterable[Model]) -> Exchange[tuple[str, ...]]:
    """Return the models with commands of their own that no reply of the drive contradicts.

    Each different request is sent once, without retries. A drive that does not answer the requests of a model does not
    fit that model.
    """
    known: dict[Message, Message | ReplyError] = {}
    found = []
    for model in models:
        operations = plugin.operations(address, resolve_options(plugin, model, {})[1], model)
        if not isinstance(operations, KnowsSeries):
            continue
        proof = SeriesProof(
            name=f"{plugin.name}:{address}",
            plugin=plugin,
            model=model,
            operations=operations,
            confirmed="",
            proven=ProvenDrives(lambda _: None),
        )
        try:
            yield from _each_once(proof.prove(), known)
        except WrongDriveError as error:
            if error.found:
                continue
        except DeadlineError:
            break
        except DriveCommError:
            continue
        found.append(model.name)
    return tuple(found)


def _each_once(exchange: Exchange[T], known: dict[Message, Message | ReplyError]) -> Exchange[T]:
    """Run an exchange without sending known requests again. known: replies and errors, by request."""
    asked_for = without_repeats(exchange)
    try:
        command = next(asked_for)
        while True:
            request = command.message if isinstance(command, Ask) else None
            if request is None or request not in known:
                try:
                    reply = yield command
                except OvertakenError:
                    raise
                except ReplyError as error:
                    reply = error
                if request is not None:
                    known[request] = reply
            else:
                reply = known[request]
            command = asked_for.throw(reply) if isinstance(reply, ReplyError) else asked_for.send(reply)
    except StopIteration as end:
        result: T = end.value
        return result
    finally:
        asked_for.close()


def packaged(plugin: Protocol) -> Sequence[Model]:
    """Return the models of a protocol's package."""
    return _packaged(plugin.package, plugin.name)


@lru_cache
def _packaged(package: str, protocol: str) -> Sequence[Model]:
    from drivecomm.models import packaged_models, read_model

    found = []
    for path in packaged_models(package):
        try:
            found.append(read_model(path, protocol, package))
        except DriveCommError:
            continue
    return tuple(found)


def _listed(names: Iterable[str]) -> str:
    return ", ".join(names)
