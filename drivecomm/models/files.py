"""Models as TOML files; `docs/reference/models.md` shows one and explains every key.

An unchanged file is read only once: all drives of a model share the same immutable object.
"""

from __future__ import annotations

import os
import time
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

from drivecomm.errors import FileFormatError, UsageError, shortened, suggestion
from drivecomm.models.proofs import inherited_proofs, with_proofs, without_proofs
from drivecomm.models.schema import EXACT, PARAMETER_KEYS, PLAIN, TEXT_TYPES, Mistake, code_in, mistakes_in, number_in
from drivecomm.protocol import WATCHDOG_PROOF, Model, PanelSetting, ParameterInfo, Watchdog
from drivecomm.tomlfile import LinePositions, parse_toml, read_text_file

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

FOLDERS_VARIABLE = "DRIVECOMM_MODELS"
_LONGEST_NAME = 200
"""Maximum length of a model's name in characters, because file systems allow not many more."""

_EMPTY: Mapping[Any, Any] = MappingProxyType({})
"""The shared empty table, because most tables of most parameters are empty."""

_SETTLED_NS = 50_000_000
"""Minimum age of a file's time in nanoseconds: a newer file may be written again without a change of its time."""


class _CachedModel(NamedTuple):
    """A model in the cache: the state of its file, its base's name, its base, and the model itself."""

    state: tuple[int, ...]
    extends: str | None
    base: Model | None
    model: Model


_model_cache: dict[tuple[Path, str], _CachedModel] = {}


def load_model(package: str, protocol: str, model: str | Path | Model) -> Model:
    """Return a model by its name, from the user's folders or the protocol's package, or from a file of the user.

    Raises UsageError for an unknown name, and FileFormatError for a file that is not a model of this protocol.
    """
    if isinstance(model, Model):
        return model
    if not isinstance(model, str | Path):
        raise UsageError(f"{shortened(model)} is not a model; give its name, a .toml file or a Model")
    if isinstance(model, Path) or model.endswith(".toml"):
        return read_model(Path(model), protocol, package)
    path = next(_files_named(package, protocol, model), None)
    if path is None:
        known = suggestion(model, model_names(package, protocol), "it has")
        raise UsageError(f"{protocol} has no model {shortened(model)}; {known}, or name a .toml file")
    return read_model(path, protocol, package)


def model_names(package: str, protocol: str) -> list[str]:
    """Return the names of the models in the user's folders and in the protocol's package."""
    return sorted(model_paths(package, protocol))


def model_paths(package: str, protocol: str) -> dict[str, Path]:
    """Return the file of each model by name; a file of the user hides one of the package."""
    found: dict[str, Path] = {}
    for folder in _folders(package, protocol):
        for path in sorted(folder.glob("*.toml")):
            found.setdefault(path.stem, path)
    return found


def packaged_models(package: str) -> list[Path]:
    """Return the model files of a protocol's package, regardless of the user's folders."""
    return sorted(_packaged(package).glob("*.toml"))


def read_model(path: Path, protocol: str, package: str = "") -> Model:
    """Return the model of a file; the file is read only if it is new or has changed.

    The model that it extends is searched beside the file, and then in the folders of named models. Raises
    FileFormatError with the file, the line, the key, and the mistake.
    """
    return _read(path, protocol, package, ())


@dataclass(frozen=True, slots=True)
class ModelFile:
    """The TOML content of one file, and the line of each key."""

    path: Path
    content: Mapping[str, Any]
    places: LinePositions

    def line_of(self, mistake: Mistake) -> int:
        """Return the line of a mistake."""
        return self.places.of(mistake.table, mistake.number, mistake.key)

    def refusal(self, mistake: Mistake) -> FileFormatError:
        """Return the error for a mistake, with the file, the line, the key and the mistake."""
        return FileFormatError(f"{self.path}, line {self.line_of(mistake)}: {mistake}")


def open_model_file(path: Path) -> ModelFile:
    """Read a file without checking its content. Raises FileFormatError if the file is missing or not TOML."""
    text = read_text_file(path, "a model")
    return ModelFile(path, parse_toml(text, f"{path}: cannot be read as a model"), LinePositions(text))


def base_of(file: ModelFile, protocol: str, package: str, extended_by: Sequence[Path] = ()) -> Model | None:
    """Return the model that a file extends; None if it extends none.

    extended_by: the files that extend this one. Raises FileFormatError for a missing or unreadable base, and for a
    circle.
    """
    return _base(file.path, file.content.get("extends"), protocol, package, extended_by)


def assembled(content: Mapping[str, Any], base: Model | None) -> Model:
    """Return the model that a file without mistakes forms together with its base."""
    parameters = [parameter_of(entry) for entry in content.get("parameter", [])]
    watchdog = Watchdog(**_frozen(content["watchdog"])) if "watchdog" in content else None
    proved = base
    base = without_proofs(base) if base is not None else None
    # A watchdog or a link_loss of the file replaces both of its base.
    silence = base if base and not content.keys() & {"watchdog", "link_loss"} else None

    def with_base(table: str, own: Mapping[Any, Any]) -> Mapping[Any, Any]:
        return MappingProxyType({**(getattr(base, table) if base else {}), **own})

    quantities = with_base("quantities", content.get("quantities", {}))
    model = Model(
        protocol=content["protocol"],
        name=content["name"],
        title=content.get("title", content["name"]),
        source=content.get("source", ""),
        parameters=with_base("parameters", {known.address: known for known in parameters}),
        faults=with_base("faults", _by_code(content, "faults")),
        warnings=with_base("warnings", _by_code(content, "warnings")),
        options=with_base("options", _frozen(content.get("options", {}))),
        quantities=MappingProxyType({name: address for name, address in quantities.items() if address}),
        watchdog=silence.watchdog if silence else watchdog,
        fault_log=tuple(content.get("fault_log", base.fault_log if base else ())),
        link_loss=silence.link_loss if silence else content.get("link_loss", ""),
        # An identification rule is about one series, so it is not inherited.
        identified_by=_frozen(content.get("identified_by", {})),
        control=with_base("control", _frozen(content.get("control", {}))),
        # Sources are about one series, too, so they are not inherited.
        sources=_frozen(content.get("sources", {})),
        # A set-up sheet is followed as a whole, so rows of another series are not mixed into it.
        setup=_setup(content, base),
        proofs=_EMPTY,
        extends=base.name if base else "",
    )
    own = {known.address for known in parameters}
    known_before = {} if proved is None else inherited_proofs(proved)
    inherited = {address: each for address, each in known_before.items() if address not in own}
    if silence is None:
        inherited.pop(WATCHDOG_PROOF, None)
    return with_proofs(model, {**inherited, **content.get("proofs", {})})


def parameter_of(entry: Mapping[str, Any]) -> ParameterInfo:
    """Return the parameter of a table without mistakes."""
    exact: dict[str, Any] = {key: number_in(entry[key]) for key in EXACT if key in entry}
    plain = {key: entry[key] for key in PLAIN if key in entry}
    start = entry.get("start")
    return ParameterInfo(
        address=entry["address"],
        name=entry["name"],
        values=_by_code(entry, "values"),
        only_with=_frozen(entry.get("only_with", {})),
        start=start if start is None or entry.get("type") in TEXT_TYPES else number_in(start),
        extra=_frozen({key: value for key, value in entry.items() if key not in PARAMETER_KEYS}),
        **{"title": entry["name"], **plain},
        **exact,
    )


def _setup(content: Mapping[str, Any], base: Model | None) -> tuple[PanelSetting, ...]:
    if "setup" not in content:
        return base.setup if base else ()
    usual = {"source": content.get("source", ""), "codes": _EMPTY}
    return tuple(PanelSetting(**{**usual, **_frozen(row)}) for row in content["setup"])


def _read(path: Path, protocol: str, package: str, extended_by: Sequence[Path]) -> Model:
    state = _state(path)
    kept = _model_cache.get((path, protocol))
    if kept is not None and kept.state == state:
        base = _base(path, kept.extends, protocol, package, extended_by)
        if base is kept.base:
            return kept.model
    file = open_model_file(path)
    mistake = next(mistakes_in(file.content, protocol), None)
    if mistake is not None:
        raise file.refusal(mistake)
    base = base_of(file, protocol, package, extended_by)
    model = assembled(file.content, base)
    if state:
        _model_cache[path, protocol] = _CachedModel(state, file.content.get("extends"), base, model)
    return model


def _state(path: Path) -> tuple[int, ...]:
    """Return a value that changes whenever the file does; empty if a change could go unnoticed."""
    try:
        is_now = path.stat()
    except OSError:
        # The error is reported by the code that reads the file.
        return ()
    if 0 <= time.time_ns() - is_now.st_mtime_ns < _SETTLED_NS:
        return ()
    return is_now.st_dev, is_now.st_ino, is_now.st_mtime_ns, is_now.st_ctime_ns, is_now.st_size


def _base(path: Path, name: str | None, protocol: str, package: str, extended_by: Sequence[Path]) -> Model | None:
    if name is None:
        return None
    # A user's model may have the same name as the model that it changes.
    circle = (*extended_by, path)
    what = f"there is no model {name!r} beside this one or among those of {protocol}"
    for found in _bases(path, name, protocol, package):
        if found not in circle:
            return _read(found, protocol, package, circle)
        what = f"extends itself, through {', '.join(each.stem for each in circle)}"
    raise open_model_file(path).refusal(Mistake(key="extends", text=what))


def _bases(path: Path, name: str, protocol: str, package: str) -> Iterator[Path]:
    beside = path.with_name(f"{name}.toml") if name == Path(name).name else None
    if beside is not None and beside.is_file():
        yield beside
    yield from _files_named(package, protocol, name)


def _by_code(table: Mapping[str, Any], name: str) -> Mapping[int, str]:
    codes: Mapping[int, str] = _frozen({code_in(code): text for code, text in table.get(name, {}).items()})
    return codes


def _frozen(value: Any) -> Any:
    """Return a TOML value as an immutable one."""
    if value == {}:
        return _EMPTY
    if isinstance(value, dict):
        return MappingProxyType({key: _frozen(each) for key, each in value.items()})
    return tuple(map(_frozen, value)) if isinstance(value, list) else value


def _folders(package: str, protocol: str) -> Iterator[Path]:
    """Yield the folders of named models: the user's, which DRIVECOMM_MODELS lists, before that of the package."""
    from platformdirs import user_config_path

    listed = [Path(each) for each in os.environ.get(FOLDERS_VARIABLE, "").split(os.pathsep) if each]
    for each in (*listed, user_config_path("drivecomm", appauthor=False) / "models"):
        yield each / protocol
    if package:
        yield _packaged(package)


def _packaged(package: str) -> Path:
    from importlib import resources

    # Packages are installed as files, so this path stays valid; models are extended and named by it.
    with resources.as_file(resources.files(package) / "models") as folder:
        return folder


def _files_named(package: str, protocol: str, name: str) -> Iterator[Path]:
    if name != Path(name).name or len(name) > _LONGEST_NAME:
        return
    for folder in _folders(package, protocol):
        path = folder / f"{name}.toml"
        if path.is_file():
            yield path
