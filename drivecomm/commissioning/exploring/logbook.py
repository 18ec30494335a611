"""Logbook of an exploration: the answers so far, in a file beside the future result, so that a later run can resume.

The file is JSON Lines: a head with the drive and its model, then one line for each answer. A line that was cut off is
ignored, and its address is requested again.
"""

from __future__ import annotations

from hashlib import sha256
from typing import TYPE_CHECKING, Any, Protocol

from drivecomm.client import json_text, parsed, plain, result_of
from drivecomm.commissioning.exploring.answers import AddressAnswer
from drivecomm.errors import FileFormatError, UsageError

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path
    from typing import TextIO

    from drivecomm.protocol import Model


class AnswerRecord(Protocol):
    """Interface of a record of answers."""

    @property
    def answers(self) -> Mapping[str, AddressAnswer]:
        """Answers by address, including those of an earlier run that was interrupted."""
        ...

    def begin(self, identity: Mapping[str, str]) -> None:
        """Record the identity of the drive. Raises FileFormatError if an earlier run was with another drive."""
        ...

    def add(self, answer: AddressAnswer) -> None:
        """Record an answer."""
        ...

    def over(self) -> None:
        """Record that the exploration is complete and its result is stored."""
        ...


class NoAnswerRecord:
    """Record that keeps no answers: an interrupted exploration starts again from the beginning."""

    def __init__(self) -> None:
        self.answers: Mapping[str, AddressAnswer] = {}

    def begin(self, identity: Mapping[str, str]) -> None:
        """Ignore the identity."""

    def add(self, answer: AddressAnswer) -> None:
        """Ignore the answer."""

    def over(self) -> None:
        """Do nothing."""


def logbook_path(of: Path) -> Path:
    """Return the path of the logbook for a result file: beside it, as `pump.toml.answers`."""
    return of.with_name(f"{of.name}.answers")


class Logbook:
    """Answers of one drive in a file, created with the first answer and removed when the exploration is complete."""

    def __init__(self, path: Path, *, drive: str, model: Model | None, asked: str) -> None:
        """Load the answers of an earlier run, if there are any.

        asked: the kind of request, because answers to another kind are of no use. Raises FileFormatError for a logbook
        of another drive, model or kind of request, and for a file that is not a logbook.
        """
        self.path = path
        self.answers: dict[str, AddressAnswer] = {}
        self._head = {"drive": drive, "model": model.name if model else "", "knows": _digest(model), "asked": asked}
        self._identity: dict[str, str] = {}
        self._file: TextIO | None = None
        if path.exists():
            self._read()

    def begin(self, identity: Mapping[str, str]) -> None:
        """Record the identity of the drive. Raises FileFormatError if an earlier run was with another drive."""
        if self.answers and self._identity != dict(identity):
            told = next(
                (
                    f"its {key} is {identity.get(key, 'unknown')!r} and was {self._identity.get(key, 'unknown')!r}"
                    for key in (*self._identity, *identity)
                    if identity.get(key) != self._identity.get(key)
                ),
                "",
            )
            raise FileFormatError(
                f"{self.path}: these replies are from another drive at the same address: {told}; remove the file to "
                "start again"
            )
        self._identity = dict(identity)

    def add(self, answer: AddressAnswer) -> None:
        """Append an answer and flush it to the operating system. Raises UsageError on failure."""
        try:
            if self._file is None:
                self._file = self.path.open("a", encoding="utf-8")
                if not self._file.tell():
                    self._file.write(json_text({**self._head, "identity": self._identity}) + "\n")
            self._file.write(json_text(_content(answer)) + "\n")
            self._file.flush()
        except OSError as error:
            raise UsageError(f"{self.path}: the replies cannot be stored: {error.strerror or error}") from error
        self.answers[answer.address] = answer

    def over(self) -> None:
        """Close and remove the file."""
        self.close()
        self.path.unlink(missing_ok=True)

    def close(self) -> None:
        """Close the file and keep it for the next run."""
        if self._file is not None:
            self._file.close()
            self._file = None

    def _read(self) -> None:
        try:
            data = self.path.read_bytes()
            whole = data[: data.rfind(b"\n") + 1]
            head, *rest = [parsed(line) for line in whole.decode("utf-8").splitlines()] or [None]
            identity = {} if head is None else {str(key): str(text) for key, text in head.pop("identity").items()}
            answers = [_answer(line) for line in rest]
            if whole != data:
                # New lines must not be appended to a line that was cut off.
                self.path.write_bytes(whole)
        except (OSError, ValueError, KeyError, TypeError, AttributeError, ArithmeticError, RecursionError) as error:
            raise FileFormatError(
                f"{self.path}: this file does not hold replies of a drive; remove the file to start again"
            ) from error
        if head is not None and head != self._head:
            raise FileFormatError(f"{self.path}: {self._differing(head)}; remove the file to start again")
        self._identity = identity
        self.answers = {answer.address: answer for answer in answers}

    def _differing(self, head: Mapping[str, Any]) -> str:
        for key in ("drive", "model"):
            if head.get(key) != self._head[key]:
                return f"these are replies of {key} {head.get(key)!s}, not of {self._head[key]}"
        if head.get("asked") != self._head["asked"]:
            return "these are replies to another command"
        return f"model {self._head['model']} was changed since these replies were stored"


def _content(answer: AddressAnswer) -> dict[str, Any]:
    content: dict[str, Any] = {"address": answer.address}
    if answer.told is not None:
        return {**content, "told": plain(answer.told)}
    if answer.absent:
        content["absent"] = True
    if answer.code is not None:
        content["code"] = answer.code
    return {**content, "reason": answer.reason}


def _answer(content: Mapping[str, Any]) -> AddressAnswer:
    told = content.get("told")
    return AddressAnswer(
        address=str(content["address"]),
        told=None if told is None else result_of(told),
        absent=bool(content.get("absent", False)),
        code=content.get("code"),
        reason=str(content.get("reason", "")),
    )


def _digest(model: Model | None) -> str:
    """Return a hash of the parameters and options of a model."""
    known = [] if model is None else [repr(model.parameters), repr(sorted(model.options.items()))]
    return sha256("\n".join(known).encode()).hexdigest()[:16]
