"""A proof under way, kept as a whole file from its first question on."""

from __future__ import annotations

import os
from dataclasses import replace
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

from drivecomm.proving.report import Proof, proof_text
from drivecomm.tomlfile import write_whole

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    from drivecomm.bus import Drive
    from drivecomm.proving.proving import Proving

_PSEUDO_TERMINALS = ("/dev/pts/", "/dev/ttys")
"""Linux, macOS: serial ports that no wire leads from."""


def is_virtual(drive: Drive, port: str, identity: Mapping[str, str]) -> bool:
    """Whether a drive is known to be a virtual one: on a virtual line or a pseudo-terminal, or by its own word.

    A virtual drive behind a network port that does not name itself is not recognised.
    """
    if not drive.bus.real_time or any("drivecomm" in text for text in identity.values()):
        return True
    return "://" not in port and os.path.realpath(port).startswith(_PSEUDO_TERMINALS)


class ProofRecord:
    """The file of one proof: written again after each section, and whole whatever ends the program.

    Until the last question is answered, the file says at which question the proof is.
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
        """Write what was found so far, and return it. why: what has ended it before its last question."""
        proving = self._proving
        at = proving.at and f"at {proving.at}: {why or 'it was not finished'}"
        proof = replace(
            self._proof,
            interrupted=self._without_names(at),
            virtual=is_virtual(proving.drive, self._port, proving.identity),
            identity=dict(proving.identity),
            findings=tuple(replace(each, why=self._without_names(each.why)) for each in proving.findings),
        )
        write_whole(self._path, proof_text(proof))
        return proof

    def _without_names(self, text: str) -> str:
        for name, words in self._private.items():
            text = text.replace(name, words)
        return text
