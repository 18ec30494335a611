"""A mutant: one mistake that an author could have made, planted in a copy of a protocol package."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

HERE = Path(__file__).parent
_KEYS = {"id", "mistake", "file", "old", "new"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Mutant:
    """One mistake, and where it is planted.

    id: names it. mistake: what is wrong, in one line. file: of the package. old: a text that stands exactly once in
    that file. new: what stands there instead. same: why nobody could ever notice, for one that changes nothing.
    """

    id: str
    mistake: str
    file: str
    old: str
    new: str
    same: str = ""

    def planted_in(self, text: str) -> str:
        """Return the text of the file with the mistake in it. Raises ValueError unless `old` stands there once."""
        if text.count(self.old) != 1:
            raise ValueError(f"{self.id}: its text stands {text.count(self.old)} times in {self.file}, not once")
        return text.replace(self.old, self.new)


def package_folder(protocol: str) -> Path:
    """Return the folder of the protocol's package as it is installed."""
    spec = find_spec("drivecomm_" + protocol.replace("-", "_"))
    if spec is None or spec.origin is None:
        raise ValueError(f"the package of {protocol} is not installed")
    return Path(spec.origin).parent


def protocols() -> list[str]:
    """Return the names of the protocols that have mutants."""
    return sorted(path.stem for path in HERE.glob("*.toml"))


def mutants_of(protocol: str) -> list[Mutant]:
    """Return the mutants of a protocol in the order of their file. Raises ValueError when one of them is not whole."""
    entries = tomllib.loads((HERE / f"{protocol}.toml").read_text(encoding="utf-8"))["mutant"]
    found: dict[str, Mutant] = {}
    for entry in entries:
        if not entry.keys() >= _KEYS or not entry.keys() <= _KEYS | {"same"}:
            raise ValueError(
                f"{protocol}: {entry.get('id')}: a mutant has {', '.join(sorted(_KEYS))}, and may have same"
            )
        if entry["id"] in found:
            raise ValueError(f"{protocol}: {entry['id']} stands there twice")
        found[entry["id"]] = Mutant(**entry)
    return list(found.values())
