"""All that the vectors of a protocol are put through, as named checks.

Names read `protocol/file/id/check`. A check is a plain callable, so that a command, pytest and a stranger's program
can run the same ones.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from drivecomm.conformance import drive_checks, framing_checks, schema_checks, telegram_checks
from drivecomm.conformance.case import Case
from drivecomm.conformance.forms import forms_of
from drivecomm.conformance.report import Check, carry_out
from drivecomm.conformance.vectors import packaged_vectors
from drivecomm.errors import FileFormatError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from drivecomm.conformance.report import Report
    from drivecomm.conformance.vectors import Vector, VectorFile
    from drivecomm.protocol import Protocol
    from drivecomm.telegram import Direction


def run_checks(plugin: Protocol, vectors: VectorFile) -> Report:
    """Put a protocol through all checks that a vector file gives rise to. Raises nothing that a codec does."""
    return carry_out(checks_of(plugin, vectors))


def checks_of(plugin: Protocol, vectors: VectorFile) -> Iterator[Check]:
    """Yield every check of every vector, stream and refusal, and those of the protocol's schemas.

    Raises FileFormatError for vectors of another protocol.
    """
    if vectors.protocol != plugin.name:
        raise FileFormatError(f"{vectors.name}: holds vectors of {vectors.protocol!r}, not of {plugin.name!r}")
    prefix = f"{plugin.name}/{vectors.name}"
    listed = _listed(vectors) | _listed(_packaged(plugin))
    forms = forms_of(plugin)
    for vector in vectors.vectors:
        case = Case(plugin=plugin, vector=vector, listed=listed, forms=forms)
        for name, check in _checks_for(vector):
            yield Check(f"{prefix}/{vector.id}/{name}", partial(check, case))
    for stream in vectors.streams:
        yield Check(f"{prefix}/{stream.id}/stream", partial(framing_checks.found_in_stream, plugin, stream))
    for refuse in vectors.refusals:
        yield Check(f"{prefix}/{refuse.id}/refuse", partial(telegram_checks.refuses_to_encode, plugin, refuse))
    for named in forms:
        yield Check(f"{prefix}/{named.name}/linked", partial(schema_checks.compiles_whole, named.form))


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
