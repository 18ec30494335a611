"""Conformance run of a protocol: all checks, ordered so that mistakes are found as early as possible.

    from drivecomm.testing import run_conformance
    report = run_conformance(plugin)
    assert report.ok, str(report)

or as pytest tests that `-k` can select, each named as in the report:

    from drivecomm.testing import conformance_tests
    test_conformance = conformance_tests("toy")

A check touches nothing but its own objects, so checks can run in any order and in several processes.
"""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from drivecomm.errors import FileFormatError, UsageError
from drivecomm.models import model_names
from drivecomm.protocol import installed
from drivecomm.testing.checking import Check, VectorCase, known_model, registered
from drivecomm.testing.checks import HAS_PROPERTIES, confusion, exchanges
from drivecomm.testing.checks.monitoring import takes_commands
from drivecomm.testing.report import Report, carry_out, try_out
from drivecomm.testing.unproven import unproven
from drivecomm.testing.vectors import VectorFile, packaged_vectors

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from drivecomm.protocol import Direction, Protocol
    from drivecomm.testing.checking import CheckFunction
    from drivecomm.testing.report import CheckResult


@dataclass(frozen=True, slots=True, kw_only=True)
class Extent:
    """Depth of a conformance run.

    examples: number of examples for each property. costly_every: the slowest checks (all bit flips, all truncations in
    a stream, compiled against interpreted) run on one vector out of this many. every_way: play an exchange in all ways,
    not just one. live: number of exchanges played in real time, in each way. every_model: run the parameter and command
    checks on all models of the package, not just the default one; a model without commands is only monitored.
    """

    examples: int
    costly_every: int
    every_way: bool
    live: int
    every_model: bool


FULL = Extent(examples=40, costly_every=1, every_way=True, live=2, every_model=True)
"""Everything: for use before a release; about twenty seconds for each protocol."""

QUICK = Extent(examples=12, costly_every=4, every_way=False, live=0, every_model=False)
"""A few seconds: for use at every change, and for testing mutants."""


def run_conformance(plugin: Protocol, extent: Extent = FULL, *, only: str = "") -> Report:
    """Run all checks of a protocol, or those whose name contains a text. Raises UsageError if none match.

    A protocol that is not installed counts as installed during the run; if its name is already taken, it is refused.
    """
    return make_report(plugin, results(plugin, extent, only=only), only=only)


def make_report(plugin: Protocol, found: Iterable[CheckResult], *, only: str = "") -> Report:
    """Return the report of these results; unproven commands are listed only if all checks were run."""
    results = tuple(found)
    return Report(results=results, left_out=skipped_checks(), unproven=() if only else unproven(plugin))


def results(plugin: Protocol, extent: Extent = FULL, *, only: str = "") -> Iterator[CheckResult]:
    """Run the checks one by one, as `run_conformance` does, and yield each result; stop iterating to stop early."""
    with _installed(plugin):
        chosen = [check for check in all_checks(plugin, extent) if only in check.name]
        if not chosen:
            raise UsageError(f"no check has {only!r} in its name; run all of them to see their names")
        yield from map(try_out, chosen)


def first_failure(plugin: Protocol, extent: Extent = FULL) -> CheckResult | None:
    """Run the checks up to the first failure and return it; None if all pass."""
    return next((result for result in results(plugin, extent) if not result.passed), None)


def run_checks(plugin: Protocol, vectors: VectorFile) -> Report:
    """Run all checks that a vector file gives rise to. Errors of a codec are reported, not raised."""
    return carry_out(checks_of(plugin, vectors))


def conformance_tests(protocol: str, extent: Extent = FULL) -> Callable[[Check], None]:
    """Return a test function that runs every check of an installed protocol as a separate test.

    extent: depth of the run, `FULL` or `QUICK`. Raises UnknownProtocolError if the protocol is not installed.
    """
    import pytest

    checks = list(all_checks(installed[protocol], extent))

    @pytest.mark.parametrize("check", checks, ids=[check.name for check in checks])
    def test_conformance(check: Check) -> None:
        check.run()

    return test_conformance


def skipped_checks() -> tuple[str, ...]:
    """Return the checks that cannot run on this machine, each with the reason."""
    return () if HAS_PROPERTIES else ("properties need hypothesis; install drivecomm[test]",)


def all_checks(plugin: Protocol, extent: Extent = FULL) -> Iterator[Check]:
    """Yield every check of an installed protocol; quick checks that find most mistakes come first."""
    name = plugin.name
    for theme in ("contract", "documents"):
        yield from (each.on(f"{name}/{theme}", plugin) for each in registered(theme))
    vectors = _vectors(plugin)
    yield from checks_of(plugin, vectors, extent)
    models = [plugin.default_model]
    if extent.every_model:
        models += [other for other in model_names(plugin.package, name) if other != plugin.default_model]
    commanded = {model: takes_commands(plugin, model) for model in models}
    for theme in ("parameters", "commands", "confusion"):
        for model in models:
            for each in registered(theme if theme != "commands" or commanded[model] else "monitoring"):
                yield Check(f"{name}/models/{model}/{each.name}", _with_model(each, plugin, model), each.meaning)
    for other in confusion.other_protocols(plugin):
        prefix = f"{name}/foreign traffic/{other.name}"
        yield from (each.on(prefix, plugin, other) for each in registered("foreign traffic"))
    yield from _properties(plugin, extent)
    for vector in exchanges.sample(vectors.exchanges, extent.live):
        yield from (each.on(f"{name}/{vectors.name}/{vector.id}", plugin, vector) for each in registered("live"))


def checks_of(plugin: Protocol, vectors: VectorFile, extent: Extent = FULL) -> Iterator[Check]:
    """Yield every check of the vectors, streams, refusals, exchanges and schemas of a protocol.

    If the extent is less than full, costly checks run on some of the vectors only. Raises FileFormatError for vectors
    of another protocol.
    """
    if vectors.protocol != plugin.name:
        raise FileFormatError(f"{vectors.name}: holds vectors of {vectors.protocol!r}, not of {plugin.name!r}")
    prefix = f"{plugin.name}/{vectors.name}"
    listed = frozenset(
        (vector.direction, vector.data) for vector in (*vectors.vectors, *_vectors(plugin).vectors) if vector.valid
    )
    cases = [VectorCase(plugin=plugin, vector=vector, listed=listed) for vector in vectors.vectors]
    yield from _checks_of_cases(prefix, cases, costly=False)
    ways = [way for way in registered("exchanges") if extent.every_way or not way.costly]
    for exchange in vectors.exchanges:
        yield from (way.on(f"{prefix}/{exchange.id}", plugin, exchange) for way in ways)
    for refuse in vectors.refusals:
        yield from (each.on(f"{prefix}/{refuse.id}", plugin, refuse) for each in registered("refusals"))
    for title, form in plugin.forms().items():
        yield from (each.on(f"{prefix}/{title}", form) for each in registered("schemas"))
    for stream in vectors.streams:
        yield from (each.on(f"{prefix}/{stream.id}", plugin, stream) for each in registered("streams"))
    yield from _checks_of_cases(prefix, cases[:: extent.costly_every], costly=True)


def _checks_of_cases(prefix: str, cases: Iterable[VectorCase], *, costly: bool) -> Iterator[Check]:
    for case in cases:
        for each in registered("vectors"):
            if each.costly is costly and each.applies_to(case.vector):
                yield each.on(f"{prefix}/{case.vector.id}", case)


def _properties(plugin: Protocol, extent: Extent) -> Iterator[Check]:
    if not HAS_PROPERTIES:
        return
    from drivecomm.testing.checks import properties

    @lru_cache
    def source(direction: Direction) -> properties.Drawn:
        return properties.Drawn(plugin, direction)

    def tries(function: Any, direction: Direction) -> Callable[[], None]:
        return lambda: properties.try_examples(function, source(direction), extent.examples)

    directions: dict[Direction, str] = {"request": "requests", "reply": "replies"}
    for each in registered("properties"):
        for direction, telegrams in directions.items():
            name = f"{plugin.name}/properties/{telegrams}/{each.name}"
            yield Check(name, tries(each.function, direction), each.meaning)


def _with_model(each: CheckFunction, plugin: Protocol, model: str) -> Callable[[], None]:
    # An unreadable model must fail each of its checks, instead of stopping the whole run.
    return lambda: each.function(plugin, known_model(plugin, model))


def _vectors(plugin: Protocol) -> VectorFile:
    try:
        return packaged_vectors(plugin)
    except FileFormatError:
        # The document checks report the missing file; all checks that need no vectors still run.
        return VectorFile(name="vectors.toml", protocol=plugin.name)


@contextmanager
def _installed(plugin: Protocol) -> Iterator[None]:
    if plugin.name in installed:
        if installed[plugin.name] is plugin:
            yield
            return
        raise UsageError(f"another protocol is installed as {plugin.name!r}; test that one, or uninstall it")
    take_away = installed.register(plugin)
    try:
        yield
    finally:
        take_away()
