"""What a check is, and what came out of many of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from drivecomm.errors import DriveCommError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable


class CheckFailure(AssertionError):  # noqa: N818 - a verdict about a codec, not an error of this program
    """The codec does not do what the vector says; the text says what it does instead."""


@dataclass(frozen=True, slots=True)
class Check:
    """One thing that must hold. name: `protocol/file/id/check`. run: raises CheckFailure when it does not hold."""

    name: str
    run: Callable[[], None]


@dataclass(frozen=True, slots=True)
class Failure:
    """A check that did not hold, and why."""

    name: str
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Report:
    """The outcome of a number of checks."""

    passed: tuple[str, ...]
    failed: tuple[Failure, ...]

    @property
    def ok(self) -> bool:
        """Whether all checks held; a report about nothing is not good news."""
        return bool(self.passed) and not self.failed

    def __str__(self) -> str:
        lines = [f"{len(self.passed)} checks passed, {len(self.failed)} failed"]
        return "\n".join([*lines, *(f"{failure.name}: {failure.reason}" for failure in self.failed)])


def carry_out(checks: Iterable[Check]) -> Report:
    """Run checks and return what came out; whatever a codec raises ends only its own check."""
    passed: list[str] = []
    failed: list[Failure] = []
    for check in checks:
        try:
            check.run()
        except CheckFailure as failure:
            failed.append(Failure(check.name, str(failure)))
        except DriveCommError as error:
            failed.append(Failure(check.name, f"refused: {error}"))
        except Exception as error:  # noqa: BLE001 - a stranger's codec may raise anything, and that is the finding
            failed.append(Failure(check.name, f"{type(error).__name__} outside the error tree: {error}"))
        else:
            passed.append(check.name)
    return Report(passed=tuple(passed), failed=tuple(failed))
