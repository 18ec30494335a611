"""All that the vectors of a protocol are put through, as named checks.

Names read `protocol/file/id/check`. A check is a plain callable, so that a command, pytest and a stranger's program
can run the same ones.
"""

from __future__ import annotations

from functools import partial
from inspect import getdoc
from typing import TYPE_CHECKING

from drivecomm.errors import FileFormatError
from drivecomm.testing import drive_checks, exchange_checks, framing_checks, schema_checks, telegram_checks
from drivecomm.testing.case import Case
from drivecomm.testing.extent import FULL
from drivecomm.testing.forms import forms_of
from drivecomm.testing.report import Check, carry_out
from drivecomm.testing.vectors import packaged_vectors

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from drivecomm.protocol import Direction, Protocol
    from drivecomm.testing.extent import Extent
    from drivecomm.testing.report import Report
    from drivecomm.testing.vectors import Vector, VectorFile


def run_checks(plugin: Protocol, vectors: VectorFile) -> Report:
    """Put a protocol through all checks that a vector file gives rise to. Raises nothing that a codec does."""
    return carry_out(checks_of(plugin, vectors))


def checks_of(plugin: Protocol, vectors: VectorFile, extent: Extent = FULL) -> Iterator[Check]:
    """Yield every check of every vector, stream, refusal and exchange, and those of the protocol's schemas.

    Where the extent is less than full, the dear ones come for some of the vectors only. Raises FileFormatError for
    vectors of another protocol.
    """
    if vectors.protocol != plugin.name:
        raise FileFormatError(f"{vectors.name}: holds vectors of {vectors.protocol!r}, not of {plugin.name!r}")
    prefix = f"{plugin.name}/{vectors.name}"
    listed = _listed(vectors) | _listed(_packaged(plugin))
    forms = forms_of(plugin)
    cases = [Case(plugin=plugin, vector=vector, listed=listed, forms=forms) for vector in vectors.vectors]
    for case in cases:
        for name, function in _checks_for(case.vector):
            if name not in _DEAR:
                yield _check(f"{prefix}/{case.vector.id}/{name}", function, case)
    for exchange in vectors.exchanges:
        for name in extent.exchange_ways:
            yield _check(f"{prefix}/{exchange.id}/{name}", EXCHANGE_CHECKS[name], plugin, exchange)
    for refuse in vectors.refusals:
        yield _check(f"{prefix}/{refuse.id}/refuse", telegram_checks.refuses_to_encode, plugin, refuse)
    for named in forms:
        yield _check(f"{prefix}/{named.name}/linked", schema_checks.compiles_whole, named.form)
    for stream in vectors.streams:
        yield _check(f"{prefix}/{stream.id}/stream", framing_checks.found_in_stream, plugin, stream)
    for case in cases[:: extent.dear_every]:
        for name, function in _checks_for(case.vector):
            if name in _DEAR:
                yield _check(f"{prefix}/{case.vector.id}/{name}", function, case)


def _check(name: str, function: Callable[..., None], *values: object) -> Check:
    return Check(name, partial(function, *values), (getdoc(function) or "").partition("\n")[0])


_DEAR = frozenset(["compiled", "flipped", "false-starts", "garbage-before", "garbage-after", "truncated-stream"])

EXCHANGE_CHECKS = {
    "exchange": exchange_checks.goes_as_written,
    "awaited": exchange_checks.goes_as_written_awaited,
    "echo": exchange_checks.goes_as_written_with_echo,
    "lumps": exchange_checks.goes_as_written_in_lumps,
    "another-drive": exchange_checks.passes_over_another_drive,
    "noise": exchange_checks.passes_over_noise,
    "script": exchange_checks.goes_as_written_without_a_line,
}
"""The checks of exchanges, by name."""


def _checks_for(vector: Vector) -> Iterator[tuple[str, Callable[[Case], None]]]:
    yield "decode", telegram_checks.decodes
    yield "byte-by-byte", framing_checks.found_byte_by_byte
    yield "compiled", schema_checks.compiled_as_interpreted
    if not vector.valid:
        if vector.direction == "request":
            yield "virtual-drive", drive_checks.survives_damage
        return
    yield "encode", telegram_checks.encodes if vector.canonical else telegram_checks.survives_its_own_encoder
    yield "trailing", telegram_checks.refuses_what_follows
    yield "truncated", telegram_checks.refuses_truncations
    yield "flipped", telegram_checks.refuses_flips
    yield "shortest", framing_checks.is_as_long_as_the_shortest
    yield "five-in-a-row", framing_checks.found_in_a_row
    yield "garbage-before", framing_checks.found_after_garbage
    yield "false-starts", framing_checks.found_after_false_starts
    yield "garbage-after", framing_checks.found_before_garbage
    yield "truncated-stream", framing_checks.nothing_in_truncations
    if vector.answers_to is not None:
        yield "answers", drive_checks.belongs_to_its_request
    if vector.direction == "request" and vector.reply_expected:
        yield "virtual-drive", drive_checks.is_answered_by_the_right_drive
    elif vector.direction == "request":
        yield "silence", drive_checks.stays_silent


def _packaged(plugin: Protocol) -> VectorFile | None:
    try:
        return packaged_vectors(plugin)
    except FileFormatError:
        # Whoever asks for the packaged file itself is told; another file is judged without it.
        return None


def _listed(vectors: VectorFile | None) -> frozenset[tuple[Direction, bytes]]:
    if vectors is None:
        return frozenset()
    return frozenset((vector.direction, vector.data) for vector in vectors.vectors if vector.valid)
