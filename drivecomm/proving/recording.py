"""File of a proof in progress: complete and valid from the first request on."""

from __future__ import annotations

import os
from dataclasses import replace
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

from drivecomm.proving.report import Proof, proof_text
from drivecomm.tomlfile import write_atomically

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    from drivecomm.bus import Drive
    from drivecomm.proving.proving import Proving

_PSEUDO_TERMINALS = ("/dev/pts/", "/dev/ttys")
"""Paths of pseudo-terminals on Linux and macOS, which have no wire."""


def is_virtual(drive: Drive, port: str, identity: Mapping[str, str]) -> bool:
    """Whether a drive is known to be virtual: on a virtual line, on a pseudo-terminal, or by its own identity.

    A virtual drive behind a network port that does not identify itself is not recognised.
    """
    if not drive.bus.real_time or any("drivecomm" in text for text in identity.values()):
        return True
    return "://" not in port and os.path.realpath(port).startswith(_PSEUDO_TERMINALS)


class ProofRecord:
    """File of one proof: rewritten after each section, and complete whenever the program ends.

    Until the last request is answered, the file names the request that the proof has reached.
    """

    def __init__(
        self,
        path: Path,
        proving: Proving,
        *,
        port: str,
        options: Mapping[str, Any],
        name_plate: str,
        moved: bool,
        private: Mapping[str, str],
        clock: Callable[[], datetime] = lambda: datetime.now(UTC),
    ) -> None:
        self._path, self._proving, self._port = path, proving, port
        self._private = private
        self._proof = Proof(
            protocol=proving.subject.plugin.name,
            model=proving.subject.model.name,
            date=clock().date(),
            options=options,
            name_plate=name_plate,
            moved=moved,
        )

    def write(self, why: str = "") -> Proof:
        """Write the findings so far, and return the proof. why: the reason of an interruption."""
        proving = self._proving
        at = proving.at and f"at {proving.at}: {why or 'it was not finished'}"
        proof = replace(
            self._proof,
            interrupted=self._without_names(at),
            virtual=is_virtual(proving.drive, self._port, proving.identity),
            identity=dict(proving.identity),
            findings=tuple(replace(each, why=self._without_names(each.why)) for each in proving.findings),
        )
        write_atomically(self._path, proof_text(proof))
        return proof

    def _without_names(self, text: str) -> str:
        for name, words in self._private.items():
            text = text.replace(name, words)
        return text
