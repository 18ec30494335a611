"""Mutants: single mistakes that an author could have made, planted in a copy of a package."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

HERE = Path(__file__).parent
FRAMEWORK = "framework"
_KEYS = {"id", "mistake", "file", "old", "new"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Mutant:
    """One mistake, and where it is planted.

    id: unique name. mistake: description in one line. file: path within the package. old: a text that occurs exactly
    once in that file. new: its replacement. same: why no test can notice a mutant that changes nothing. tests: tests
    that judge it, as for pytest and from the project's folder; none for a protocol package, which the conformance kit
    judges.
    """

    id: str
    mistake: str
    file: str
    old: str
    new: str
    same: str = ""
    tests: tuple[str, ...] = ()

    def planted_in(self, text: str) -> str:
        """Return the text of the file with the mistake in it. Raises ValueError unless `old` occurs exactly once."""
        if text.count(self.old) != 1:
            raise ValueError(f"{self.id}: its text stands {text.count(self.old)} times in {self.file}, not once")
        return text.replace(self.old, self.new)


def package_folder(protocol: str) -> Path:
    """Return the folder of the installed protocol package."""
    return _folder("drivecomm_" + protocol.replace("-", "_"))


def framework_folder() -> Path:
    """Return the folder of the installed framework."""
    return _folder("drivecomm")


def protocols() -> list[str]:
    """Return the names of the protocols that have mutants."""
    return sorted(path.stem for path in HERE.glob("*.toml"))


def themes() -> list[str]:
    """Return the names of the mutant files of the framework."""
    return sorted(path.stem for path in (HERE / FRAMEWORK).glob("*.toml"))


def mutants_of(protocol: str) -> list[Mutant]:
    """Return the mutants of a protocol in file order. Raises ValueError for an incomplete mutant."""
    return _read(HERE / f"{protocol}.toml", {"same"})


def framework_mutants_of(theme: str) -> list[Mutant]:
    """Return the mutants of one theme in file order. Raises ValueError for an incomplete mutant."""
    found = _read(HERE / FRAMEWORK / f"{theme}.toml", {"same", "tests"})
    if unjudged := [mutant.id for mutant in found if not mutant.tests]:
        raise ValueError(f"{theme}: no tests judge {unjudged[0]}")
    return found


def _read(path: Path, may_have: set[str]) -> list[Mutant]:
    """Return the mutants of a file; those without tests of their own get the tests given at its top."""
    content = tomllib.loads(path.read_text(encoding="utf-8"))
    found: dict[str, Mutant] = {}
    for entry in content["mutant"]:
        if not entry.keys() >= _KEYS or not entry.keys() <= _KEYS | may_have:
            must, may = ", ".join(sorted(_KEYS)), " and ".join(sorted(may_have))
            raise ValueError(f"{path.stem}: {entry.get('id')}: a mutant has {must}, and may have {may}")
        if entry["id"] in found:
            raise ValueError(f"{path.stem}: {entry['id']} stands there twice")
        tests = tuple(entry.get("tests", content.get("tests", ())))
        found[entry["id"]] = Mutant(**{**entry, "tests": tests})
    return list(found.values())


def _folder(package: str) -> Path:
    spec = find_spec(package)
    if spec is None or spec.origin is None:
        raise ValueError(f"the package {package} is not installed")
    return Path(spec.origin).parent
