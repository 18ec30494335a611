"""All checks of a protocol in one row, and judging it by them.

    from drivecomm.testing import judge
    report = judge(plugin)
    assert report.ok, str(report)

Checks come in the order in which a mistake is found soonest, so who only wants to know whether there is one may stop
at the first failure: `first_failure`. A check touches nothing but its own objects, so they may be run in any order
and by several processes.
"""

from __future__ import annotations

from contextlib import contextmanager
from functools import lru_cache, partial
from importlib.util import find_spec
from inspect import getdoc
from typing import TYPE_CHECKING, TypeAlias

from drivecomm.errors import FileFormatError, UsageError
from drivecomm.models import model_names
from drivecomm.protocol import installed
from drivecomm.testing import (
    confusion_checks,
    contract_checks,
    document_checks,
    foreign_checks,
    guarding_checks,
    live_checks,
    motion_checks,
    parameter_checks,
    purpose_checks,
    silence_checks,
)
from drivecomm.testing.checks import checks_of
from drivecomm.testing.extent import FULL
from drivecomm.testing.known_models import known_model
from drivecomm.testing.report import Check, Report, Verdict, try_out
from drivecomm.testing.vectors import VectorFile, packaged_vectors

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator
    from typing import Any

    from drivecomm.protocol import Direction, Protocol
    from drivecomm.testing.extent import Extent

_Checks: TypeAlias = "tuple[Callable[..., None], ...]"

_CONTRACT: _Checks = (
    contract_checks.has_all_fields,
    contract_checks.has_addresses,
    contract_checks.has_frozen_options,
    contract_checks.operations_are_whole,
    contract_checks.virtual_drives_are_whole,
    contract_checks.finds_its_examples,
    contract_checks.refuses_what_cannot_be,
    contract_checks.speaks_to_all_without_waiting,
    contract_checks.judges_every_pair,
    contract_checks.is_honest_about_blind_spots,
)

_DOCUMENTS: _Checks = (
    document_checks.has_a_readme,
    document_checks.names_the_source_of_its_facts,
    document_checks.has_a_source_for_every_vector,
    document_checks.has_vectors_for_everything,
    document_checks.has_a_source_for_every_parameter,
    document_checks.has_models_in_order,
    document_checks.explains_its_options,
)

_PARAMETERS: _Checks = (
    parameter_checks.reads_what_the_drive_holds,
    parameter_checks.is_found_by_name,
    parameter_checks.writes_what_was_given,
    parameter_checks.stores_nothing_where_it_cannot,
)

_COMMANDS: _Checks = (
    motion_checks.runs_at_the_reference,
    motion_checks.runs_backwards,
    motion_checks.stops_in_every_way,
    motion_checks.tells_its_faults,
    motion_checks.is_reset_and_stands,
    motion_checks.asking_moves_nothing,
    motion_checks.does_not_repeat_an_old_command,
    silence_checks.a_lost_answer_is_asked_for_again,
    silence_checks.a_start_is_not_repeated,
    silence_checks.a_stop_is_repeated,
    silence_checks.a_deaf_drive_is_reported,
    purpose_checks.tells_asking_from_acting,
    purpose_checks.tells_what_requests_are_for,
    purpose_checks.what_only_asks_moves_no_drive,
    guarding_checks.guards_its_limits,
    guarding_checks.forgets_what_was_not_stored,
    guarding_checks.heeds_the_sign_of_a_reference,
)

_CONFUSION: _Checks = (
    confusion_checks.an_answer_answers_its_question_only,
    confusion_checks.another_drive_is_not_believed,
    confusion_checks.a_write_is_not_confirmed_by_another,
    confusion_checks.a_disturbed_line_tells_no_lies,
)

_FOREIGN: _Checks = (
    foreign_checks.is_not_believed,
    foreign_checks.is_not_answered,
    foreign_checks.does_not_spoil_a_reading,
)

_DIRECTIONS: dict[Direction, str] = {"request": "requests", "reply": "replies"}

_LIVE = {
    "terminal": live_checks.goes_as_written_over_a_terminal,
    "terminal-awaited": live_checks.goes_as_written_over_a_terminal_awaited,
    "socket": live_checks.goes_as_written_over_a_socket,
    "thread": live_checks.goes_as_written_in_a_thread,
}


def all_checks(plugin: Protocol, extent: Extent = FULL) -> Iterator[Check]:
    """Yield every check of a protocol that is installed, the quick ones that find most first."""
    name = plugin.name
    for function in _CONTRACT:
        yield _check(f"{name}/contract", function, plugin)
    for function in _DOCUMENTS:
        yield _check(f"{name}/documents", function, plugin)
    vectors = _vectors(plugin)
    yield from checks_of(plugin, vectors, extent)
    models = _models(plugin, extent)
    for theme in (_PARAMETERS, _COMMANDS, _CONFUSION):
        for model in models:
            for function in theme:
                title = f"{name}/models/{model}/{_title(function)}"
                yield Check(title, _with_model(function, plugin, model), _first(function))
    for other in foreign_checks.others(plugin):
        for function in _FOREIGN:
            yield _check(f"{name}/foreign traffic/{other.name}", function, plugin, other)
    yield from _properties(plugin, extent)
    for exchange in live_checks.sample(vectors.exchanges, extent.live):
        for title, play in _LIVE.items():
            yield Check(f"{name}/{vectors.name}/{exchange.id}/{title}", partial(play, plugin, exchange), _first(play))


def judge(plugin: Protocol, extent: Extent = FULL, *, only: str = "") -> Report:
    """Judge a protocol by all checks, or by those whose name contains a text. Raises UsageError if there is none.

    A protocol that is not installed is, for as long as it takes; one whose name another has is refused.
    """
    with _installed(plugin):
        chosen = matching(all_checks(plugin, extent), only)
        return Report(verdicts=tuple(map(try_out, chosen)), left_out=left_out())


def verdicts(plugin: Protocol, extent: Extent = FULL, *, only: str = "") -> Iterator[Verdict]:
    """Judge a protocol check by check; who has heard enough stops asking."""
    with _installed(plugin):
        yield from map(try_out, matching(all_checks(plugin, extent), only))


def first_failure(plugin: Protocol, extent: Extent = FULL) -> Verdict | None:
    """Judge a protocol up to the first check that fails; None when all hold."""
    return next((verdict for verdict in verdicts(plugin, extent) if not verdict.passed), None)


def matching(checks: Iterable[Check], only: str) -> list[Check]:
    """Return the checks whose name contains a text. Raises UsageError when none does."""
    found = [check for check in checks if only in check.name]
    if not found:
        raise UsageError(f"no check has {only!r} in its name; run all of them to see their names")
    return found


def left_out() -> tuple[str, ...]:
    """Return what cannot be checked here, and why."""
    if find_spec("hypothesis") is None:
        return ("properties need hypothesis; install drivecomm[test]",)
    return ()


@contextmanager
def _installed(plugin: Protocol) -> Iterator[None]:
    if plugin.name in installed:
        if installed[plugin.name] is plugin:
            yield
            return
        raise UsageError(f"another protocol is installed as {plugin.name!r}; judge that one, or uninstall it")
    take_away = installed.register(plugin)
    try:
        yield
    finally:
        take_away()


def _vectors(plugin: Protocol) -> VectorFile:
    try:
        return packaged_vectors(plugin)
    except FileFormatError:
        # The checks of the documents say so; all that needs no vectors is judged all the same.
        return VectorFile(name="vectors.toml", protocol=plugin.name)


def _models(plugin: Protocol, extent: Extent) -> list[str]:
    others = [name for name in model_names(plugin.package, plugin.name) if name != plugin.default_model]
    return [plugin.default_model, *(others if extent.every_model else ())]


def _with_model(function: Callable[..., None], plugin: Protocol, model: str) -> Callable[[], None]:
    # A model that cannot be read is a failure of each of its checks, and not of all of them at once.
    return lambda: function(plugin, known_model(plugin, model))


def _properties(plugin: Protocol, extent: Extent) -> Iterator[Check]:
    if left_out():
        return
    from drivecomm.testing import property_checks  # noqa: PLC0415 - needs hypothesis, which not everybody has

    @lru_cache
    def source(direction: Direction) -> property_checks.Drawn:
        return property_checks.drawn(plugin, direction)

    def holds(function: Any, direction: Direction) -> None:
        property_checks.try_examples(function, source(direction), extent.examples)

    for function in property_checks.PROPERTIES:
        for direction, telegrams in _DIRECTIONS.items():
            title = f"{plugin.name}/properties/{telegrams}/{_title(function)}"
            yield Check(title, partial(holds, function, direction), _first(function))


def _check(prefix: str, function: Callable[..., None], *values: object) -> Check:
    return Check(f"{prefix}/{_title(function)}", partial(function, *values), _first(function))


def _title(function: Callable[..., None]) -> str:
    return function.__name__.replace("_", " ")


def _first(function: Callable[..., None]) -> str:
    """Return the first line of a docstring: what must hold."""
    return (getdoc(function) or "").partition("\n")[0]
