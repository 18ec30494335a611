"""Models as files.

A model is a TOML file; `docs/models.md` explains every key:

format = 1
protocol = "vabus"
name = "act"
title = "Bonfiglioli ACT"
extends = "family"            # optional: a model of the same protocol that this one takes over and changes
source = "where the table as a whole comes from"

[options]                     # defaults for the protocol's drive options and line facts
ram_datasets = false

[quantities]                  # common names, and which parameter each is here; "" for one that extends has and this not
output_frequency = "210"

[watchdog]                    # how drives of this model notice that their master has fallen silent
time = "413"
actions = { trip = 0 }
off = 0
source = "manual, page"

[identified_by]               # what a drive of this model tells of itself: regular expressions
"FC type" = "FC-30[12].*"

[faults]
1 = "text"

[warnings]                    # by number, or by bit of the warning word, as the protocol's manual counts
1 = "text"

[[parameter]]
address = "481"               # in the protocol's form
name = "fixed_frequency_2"    # lower case, words joined by underscores
title = "fixed frequency 2"
type = "long"                 # in the words of the protocol's manual
unit = "Hz"
factor = "0.01"               # physical value = raw value x factor
access = "rw"                 # "r", "w", "rw", "rw*" (not while the motor runs)
storage = "stored"            # or "volatile"; left out where nothing says it
values = { 1 = "state machine", 2 = "remote contacts" }
minimum = "0.00"              # physical, where the source gives them
maximum = "999.99"
source = "manual, page"
sure = "printed"              # "printed", "derived", "field", "unconfirmed"
"""

from __future__ import annotations

import os
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn, get_args

from drivecomm.errors import FileFormatError, UsageError
from drivecomm.models import Access, LinkLoss, Model, ParameterInfo, Storage, Sureness, Watchdog
from drivecomm.toml_places import Places

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

_FORMAT = 1
FOLDERS_VARIABLE = "DRIVECOMM_MODELS"


def load_model(package: str, protocol: str, model: str | Path | Model) -> Model:
    """Return a model by its name, from the user's folders or the protocol's package, or from a file of the user's.

    Raises UsageError for an unknown name and FileFormatError for a file that is no model of this protocol.
    """
    if isinstance(model, Model):
        return model
    if isinstance(model, Path) or str(model).endswith(".toml"):
        return read_model(Path(model), protocol, package)
    path = next(_files_named(package, protocol, model), None)
    if path is None:
        known = ", ".join(model_names(package, protocol)) or "none"
        raise UsageError(f"{protocol} has no model {model!r}; it has {known}, or name a .toml file")
    return read_model(path, protocol, package)


def model_names(package: str, protocol: str) -> list[str]:
    """Return the names of the models in the user's folders and in the protocol's package."""
    return sorted({path.stem for folder in _folders(package, protocol) for path in folder.glob("*.toml")})


def read_model(path: Path, protocol: str, package: str = "") -> Model:
    """Read a model file. What it extends is looked for beside it, and then where models with names are.

    Raises FileFormatError with the file, the line, the key, and what is wrong there.
    """
    return _read(path, protocol, package, ())


def user_folders(protocol: str) -> list[Path]:
    """Return the folders with models of the user's own, which go before those of the packages.

    They are the folders `PROTOCOL` in those that DRIVECOMM_MODELS lists, and in the folder `models` of the user's
    configuration.
    """
    from platformdirs import user_config_path  # noqa: PLC0415 - loaded with the first model, not with drivecomm

    listed = [Path(each) for each in os.environ.get(FOLDERS_VARIABLE, "").split(os.pathsep) if each]
    return [each / protocol for each in (*listed, user_config_path("drivecomm", appauthor=False) / "models")]


def _folders(package: str, protocol: str) -> Iterator[Path]:
    from importlib import resources  # noqa: PLC0415 - loaded with the first model, not with drivecomm

    yield from user_folders(protocol)
    if package:
        with resources.as_file(resources.files(package) / "models") as folder:
            yield folder


def _files_named(package: str, protocol: str, name: str) -> Iterator[Path]:
    if name != Path(name).name:
        return
    for folder in _folders(package, protocol):
        path = folder / f"{name}.toml"
        if path.is_file():
            yield path


def _read(path: Path, protocol: str, package: str, extended_by: Sequence[Path]) -> Model:
    import tomllib  # noqa: PLC0415 - as above

    try:
        text = path.read_text(encoding="utf-8")
        content = tomllib.loads(text)
    except (OSError, ValueError, RecursionError) as error:
        raise FileFormatError(f"{path}: cannot be read as a model: {error}") from error
    document = _Document(path, text)
    if content.get("format") != _FORMAT:
        document.refuse("format", f"a model begins with format = {_FORMAT}")
    if content.get("protocol") != protocol:
        document.refuse("protocol", f"is a model for {content.get('protocol')!r}, not for {protocol!r}")
    unknown = sorted(set(content) - _TOP)
    if unknown:
        document.refuse(unknown[0], f"no model has the key {unknown[0]!r}; its keys are {', '.join(sorted(_TOP))}")
    if "name" not in content:
        document.refuse("", "the key 'name' is missing")
    base = _base(content.get("extends"), document, protocol, package, (*extended_by, path))
    options = document.table(content, "options")
    quantities = {**(base.quantities if base else {}), **_quantities(document.table(content, "quantities"), document)}
    parameters = [document.parameter(number, entry) for number, entry in enumerate(document.parameters(content))]
    watchdog = document.watchdog(document.table(content, "watchdog")) if "watchdog" in content else None
    return Model(
        protocol=protocol,
        name=str(content["name"]),
        title=str(content.get("title", content["name"])),
        source=str(content.get("source", "")),
        parameters={**(base.parameters if base else {}), **{known.address: known for known in parameters}},
        faults={**(base.faults if base else {}), **document.texts("faults", content)},
        warnings={**(base.warnings if base else {}), **document.texts("warnings", content)},
        options={**(base.options if base else {}), **options},
        quantities={name: address for name, address in quantities.items() if address},
        watchdog=watchdog or (base.watchdog if base else None),
        # A rule is about one series, so it is not taken over.
        identified_by=document.patterns(document.table(content, "identified_by")),
    )


def _base(name: object, document: _Document, protocol: str, package: str, extended_by: Sequence[Path]) -> Model | None:
    if name is None:
        return None
    if not isinstance(name, str):
        document.refuse("extends", f"{name!r} is no name of a model")
    beside = document.path.with_name(f"{name}.toml")
    found = [beside] if beside.is_file() else []
    found += [path for path in _files_named(package, protocol, name) if path not in found]
    if not found:
        document.refuse("extends", f"there is no model {name!r} beside this one or among those of {protocol}")
    # A user's model may have the name of the one that it changes.
    left = [path for path in found if path not in extended_by]
    if not left:
        document.refuse("extends", f"extends itself, by way of {', '.join(path.stem for path in extended_by)}")
    return _read(left[0], protocol, package, extended_by)


def _quantities(given: Mapping[str, Any], document: _Document) -> dict[str, str]:
    for name, address in given.items():
        if not isinstance(address, str):
            document.refuse(name, f"{address!r} is no parameter address; write it as a text", "quantities")
    return dict(given)


_TOP = frozenset(
    {
        "format", "protocol", "name", "title", "extends", "source",
        "options", "quantities", "watchdog", "identified_by", "faults", "warnings", "parameter",
    }
)  # fmt: skip
_WORDS: dict[str, tuple[str, ...]] = {
    "access": get_args(Access),
    "sure": get_args(Sureness),
    "storage": tuple(word for word in get_args(Storage) if word),
}
_EXACT = ("factor", "minimum", "maximum")
_PLAIN = ("type", "unit", "access", "storage", "source", "sure")
_TEXT_TYPES = ("string", "text")
_WATCHDOG = frozenset(Watchdog.__dataclass_fields__)
_KNOWN_KEYS = frozenset(ParameterInfo.__dataclass_fields__) - {"extra"}


class _Document:
    """One file, whose errors name it, the line and the key."""

    def __init__(self, path: Path, text: str) -> None:
        self.path = path
        self._places = Places(text)

    def refuse(self, key: str, what: str, table: str = "", number: int = 0) -> NoReturn:
        """Raise the error for a key."""
        line = self._places.of(table, number, key)
        raise FileFormatError(f"{self.path}, line {line}: {f'{key}: ' if key else ''}{what}")

    def table(self, content: Mapping[str, Any], name: str) -> dict[str, Any]:
        """Return a table, an empty one where there is none."""
        found = content.get(name, {})
        if not isinstance(found, dict):
            self.refuse(name, f"is no table; write [{name}] and its keys below")
        return found

    def parameters(self, content: Mapping[str, Any]) -> list[dict[str, Any]]:
        """Return the tables of the parameters."""
        found = content.get("parameter", [])
        if not isinstance(found, list) or not all(isinstance(each, dict) for each in found):
            self.refuse("parameter", "parameters are tables; write [[parameter]] and its keys below")
        return found

    def texts(self, name: str, content: Mapping[str, Any]) -> dict[int, str]:
        """Return texts by their codes."""
        return self._by_code(self.table(content, name), name, 0)

    def patterns(self, given: Mapping[str, Any]) -> dict[str, str]:
        """Return regular expressions by the name of what they are for."""
        import re  # noqa: PLC0415 - as above

        for key, pattern in given.items():
            try:
                re.compile(pattern)
            except (TypeError, re.error) as error:
                self.refuse(key, f"{pattern!r} is no regular expression: {error}", "identified_by")
        return dict(given)

    def watchdog(self, given: Mapping[str, Any]) -> Watchdog:
        """Return how a drive notices a master's silence."""
        for key in sorted(set(given) - _WATCHDOG):
            self.refuse(key, f"no watchdog has this key; its keys are {', '.join(sorted(_WATCHDOG))}", "watchdog")
        if not isinstance(given.get("time"), str):
            self.refuse("time", "a watchdog names the parameter with its time", "watchdog")
        actions = given.get("actions", {})
        if not isinstance(actions, dict) or not all(
            key in get_args(LinkLoss) and type(value) is int for key, value in actions.items()
        ):
            self.refuse("actions", f"whole numbers for some of {', '.join(get_args(LinkLoss))}", "watchdog")
        for key, kind in {"action": str, "source": str, "note": str, "off": int}.items():
            if key in given and type(given[key]) is not kind:
                self.refuse(key, f"cannot be {given[key]!r}", "watchdog")
        self._one_of("sure", given, "watchdog", 0)
        return Watchdog(**given)

    def parameter(self, number: int, entry: Mapping[str, Any]) -> ParameterInfo:
        """Return a parameter."""
        for key in ("address", "name"):
            if key not in entry:
                self.refuse("", f"parameter: the key {key!r} is missing", "parameter", number)
            if not isinstance(entry[key], str) or not entry[key]:
                self.refuse(key, f"{entry[key]!r} is no text", "parameter", number)
        exact: dict[str, Any] = {key: self._number(key, entry[key], number) for key in _EXACT if key in entry}
        plain: dict[str, Any] = {key: entry[key] for key in _PLAIN if key in entry}
        for key, value in plain.items():
            if not isinstance(value, str):
                self.refuse(key, f"{value!r} is no text", "parameter", number)
        for key in _WORDS:
            self._one_of(key, entry, "parameter", number)
        values = entry.get("values", {})
        if not isinstance(values, dict):
            self.refuse("values", "is no table of numbers and texts", "parameter", number)
        start = entry.get("start")
        if start is not None and entry.get("type") not in _TEXT_TYPES:
            start = self._number("start", start, number)
        return ParameterInfo(
            address=entry["address"],
            name=entry["name"],
            title=str(entry.get("title", entry["name"])),
            values=self._by_code(values, "parameter", number, "values"),
            start=start,
            extra={key: value for key, value in entry.items() if key not in _KNOWN_KEYS},
            **exact,
            **plain,
        )

    def _one_of(self, key: str, entry: Mapping[str, Any], table: str, number: int) -> None:
        if key in entry and entry[key] not in _WORDS[key]:
            self.refuse(key, f"cannot be {entry[key]!r}; it is one of {', '.join(_WORDS[key])}", table, number)

    def _number(self, key: str, value: Any, number: int) -> Decimal:
        try:
            found = Decimal(str(value))
        except InvalidOperation:
            found = Decimal("nan")
        if not found.is_finite() or isinstance(value, bool):
            self.refuse(key, f"{value!r} is no number", "parameter", number)
        return found

    def _by_code(self, given: Mapping[str, Any], table: str, number: int, inside: str = "") -> dict[int, str]:
        found = {}
        for code, text in given.items():
            try:
                found[int(code)] = str(text)
            except ValueError:
                self.refuse(inside or code, f"{code!r} is no whole number", table, number)
        return found
