"""Check of model files: reports all mistakes that can be found with the protocol at hand, not only the first.

    for finding in check_model(Path("dryer.toml")):
        print(finding)

The check covers what the loader refuses; whether names, limits, sources, common names and the watchdog agree; and what
the protocol accepts: options, addresses, types, keys, start values, and a virtual drive. A model of a protocol's
package must also have enough support (`drivecomm.models.support`).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from drivecomm.errors import FileFormatError, ProtocolLoadError, UnknownProtocolError
from drivecomm.models.files import ModelFile, assembled, base_of, open_model_file, packaged_models, parameter_of
from drivecomm.models.proofs import broken_proofs
from drivecomm.models.rules import OwnContent, broken_rules
from drivecomm.models.schema import Mistake, mistakes_in
from drivecomm.models.setup_rules import broken_setup
from drivecomm.models.support import unsupported
from drivecomm.models.trials import failed_trials, wrong_control_keys, wrong_keys, wrong_options
from drivecomm.protocol import installed
from drivecomm.tomlfile import no_such_file

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping
    from pathlib import Path

    from drivecomm.protocol import Protocol

_TOML_PLACE = re.compile(r"\(at line (\d+), column \d+\)$")
"""End of the messages of the standard library's reader about invalid TOML."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelFinding:
    """One mistake in a model file.

    line: counted from 1; 0 if there is no such file. key: empty if the mistake concerns a whole table or the file.
    text: the mistake, and its remedy.
    """

    path: Path
    line: int
    key: str
    text: str

    def __str__(self) -> str:
        place = f"{self.path}, line {self.line}" if self.line else f"{self.path}"
        return f"{place}: {f'{self.key}: ' if self.key else ''}{self.text}"


def check_model(path: Path, plugin: Protocol | None = None) -> list[ModelFinding]:
    """Return all mistakes in a model file, sorted by line; an empty list if the file is in order.

    plugin: its protocol; unless given, the installed one that the file names. The content that a file takes over by
    `extends` is checked only in the file where it is written.
    """
    if not path.exists():
        return [ModelFinding(path=path, line=0, key="", text=no_such_file(path).removeprefix(f"{path}: "))]
    try:
        file = open_model_file(path)
    except FileFormatError as error:
        text = str(error).removeprefix(f"{path}: ")
        place = _TOML_PLACE.search(text)
        return [ModelFinding(path=path, line=int(place[1]) if place else 1, key="", text=text)]
    found = [
        ModelFinding(path=path, line=file.line_of(mistake), key=mistake.key, text=mistake.text)
        for mistake in dict.fromkeys(_mistakes(file, plugin))
    ]
    return sorted(found, key=lambda finding: finding.line)


def _mistakes(file: ModelFile, plugin: Protocol | None) -> Iterator[Mistake]:
    protocol = plugin.name if plugin is not None else file.content.get("protocol")
    if not isinstance(protocol, str):
        known_names = ", ".join(sorted(installed)) or "none"
        yield Mistake(key="protocol", text=f"names the protocol that this is a model for; installed are {known_names}")
        return
    refused = list(mistakes_in(file.content, protocol))
    yield from refused
    if any(not mistake.table and mistake.key in ("", "format", "name", "parameter", "protocol") for mistake in refused):
        return
    try:
        known = plugin or installed[protocol]
    except (UnknownProtocolError, ProtocolLoadError) as error:
        yield Mistake(key="protocol", text=str(error))
        return
    options = file.content.get("options", {})
    wrong = list(wrong_options(options, known)) if isinstance(options, dict) else []
    yield from wrong
    content = _without(file.content, [*refused, *wrong])
    refused_parameters = {mistake.number for mistake in refused if mistake.table == "parameter"}
    entries = [
        (number, entry)
        for number, entry in enumerate(file.content.get("parameter", []))
        if number not in refused_parameters
    ]
    yield from wrong_keys(entries, known)
    control = content.get("control", {})
    yield from wrong_control_keys(control if isinstance(control, dict) else {}, known)
    if any(not mistake.table and mistake.key == "extends" for mistake in refused):
        return
    try:
        base = base_of(file, protocol, known.package)
    except FileFormatError as error:
        # Without its base, the model would seem to lack much that it has.
        yield Mistake(key="extends", text=_remark(file, error))
        return
    model = assembled({**content, "parameter": [entry for _, entry in entries]}, base)
    own = [(number, parameter_of(entry)) for number, entry in entries]
    given = OwnContent(
        parameters=own,
        quantities=content.get("quantities", {}),
        watchdog="watchdog" in content,
        fault_log=content.get("fault_log", []),
        source=content.get("source", ""),
    )
    yield from broken_rules(given, model, base)
    yield from broken_setup(content.get("setup", []), model)
    yield from broken_proofs(content.get("proofs", {}), model)
    if file.path in packaged_models(known.package):
        yield from unsupported(file.content, model, base)
    yield from failed_trials(own, model, known)


def _without(content: Mapping[str, Any], mistakes: Iterable[Mistake]) -> dict[str, Any]:
    """Return the content of a file without the keys that are wrong."""
    left = {key: dict(value) if isinstance(value, dict) else value for key, value in content.items()}
    for mistake in mistakes:
        if not mistake.table:
            left.pop(mistake.key, None)
        elif mistake.table in ("watchdog", "setup"):
            # The rest of an incomplete table is meaningless.
            left.pop(mistake.table, None)
        elif mistake.table != "parameter":
            left[mistake.table].pop(mistake.key, None)
    return left


def _remark(file: ModelFile, error: FileFormatError) -> str:
    """Return the mistake in a base; without its place if this file names a wrong base."""
    place = file.refusal(Mistake(key="extends", text=""))
    return str(error).removeprefix(str(place))
