"""Coverage of a protocol by a run: telegrams, refusal codes, states of the motor, parameters."""

from __future__ import annotations

from contextlib import suppress
from threading import Lock
from typing import TYPE_CHECKING, NamedTuple

from drivecomm.errors import DriveCommError
from drivecomm.protocol import MotorCommand

if TYPE_CHECKING:
    from drivecomm.judge.known_drive import KnownDrive
    from drivecomm.judge.trial import CaseContext


class Covered(NamedTuple):
    """Coverage of one kind of item.

    what: the kind, such as telegrams. missing: names of the items that were not covered.
    """

    what: str
    touched: int
    of: int
    missing: tuple[str, ...]

    def __str__(self) -> str:
        return f"{self.touched} of {self.of} {self.what}"


class Coverage:
    """Collector of the items that the cases of a run cover; several threads may add to it."""

    def __init__(self, known: KnownDrive) -> None:
        self._known = known
        self._guard = Lock()
        self._kinds: set[str] = set()
        self._refusals: set[int] = set()
        self._states: set[str] = set()
        self._parameters: set[str] = set()

    def add(self, trial: CaseContext) -> None:
        """Add the requests, replies and motor states of a case."""
        known = self._known
        for stand in trial.stands:
            for heard in stand.drive.since():
                kinds = {heard.find.message.kind}
                if heard.reply is not None:
                    with suppress(DriveCommError):
                        kinds.add(known.codec.decode(heard.reply, "reply").kind)
                parameters = set(known.parameters_read_by(heard.find)) | {known.parameter_written_by(heard.find)}
                with self._guard:
                    self._kinds |= kinds
                    self._parameters |= parameters - {""}
            with self._guard:
                self._refusals |= stand.drive.refused_with
                self._states |= stand.drive.states

    def summary(self) -> list[Covered]:
        """Return the coverage of each kind."""
        known = self._known
        forms = sorted(known.plugin.forms())
        kinds = known.kinds
        codes = sorted(known.refusals)
        parameters = list(known.model.parameters)
        states = [each.value for each in MotorCommand] + ["fault"]
        with self._guard:
            parts = (
                ("telegrams", [each for each in kinds if each in self._kinds], kinds or forms),
                (
                    "refusal codes",
                    [str(each) for each in codes if each in self._refusals],
                    [str(each) for each in codes],
                ),
                ("states of the motor", [each for each in states if each in self._states], states),
                ("parameters", [each for each in parameters if each in self._parameters], parameters),
            )
        return [
            Covered(what, len(touched), len(of), tuple(each for each in of if each not in touched))
            for what, touched, of in parts
            if of
        ]
