"""Models as TOML files; `docs/reference/models.md` shows one and explains every key."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drivecomm.errors import FileFormatError, UsageError, meant, shortened
from drivecomm.models.schema import EXACT, PARAMETER_KEYS, PLAIN, TEXT_TYPES, Mistake, mistakes_in, number_in
from drivecomm.protocol import Model, ParameterInfo, Watchdog
from drivecomm.tomlfile import Places, parse_toml, read_text_file

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

FOLDERS_VARIABLE = "DRIVECOMM_MODELS"
_LONGEST_NAME = 200
"""Characters of a model's name; no file system takes many more."""


def load_model(package: str, protocol: str, model: str | Path | Model) -> Model:
    """Return a model by its name, from the user's folders or the protocol's package, or from a file of the user's.

    Raises UsageError for an unknown name and FileFormatError for a file that is no model of this protocol.
    """
    if isinstance(model, Model):
        return model
    if not isinstance(model, str | Path):
        raise UsageError(f"{shortened(model)} is no model; give its name, a .toml file or a Model")
    if isinstance(model, Path) or model.endswith(".toml"):
        return read_model(Path(model), protocol, package)
    path = next(_files_named(package, protocol, model), None)
    if path is None:
        known = meant(model, model_names(package, protocol), "it has")
        raise UsageError(f"{protocol} has no model {shortened(model)}; {known}, or name a .toml file")
    return read_model(path, protocol, package)


def model_names(package: str, protocol: str) -> list[str]:
    """Return the names of the models in the user's folders and in the protocol's package."""
    return sorted(model_paths(package, protocol))


def model_paths(package: str, protocol: str) -> dict[str, Path]:
    """Return where each model comes from: its file, the user's before that of the package."""
    found: dict[str, Path] = {}
    for folder in _folders(package, protocol):
        for path in sorted(folder.glob("*.toml")):
            found.setdefault(path.stem, path)
    return found


def packaged_models(package: str) -> list[Path]:
    """Return the model files of a protocol's package, whatever the user's folders hold."""
    return sorted(_packaged(package).glob("*.toml"))


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


@dataclass(frozen=True, slots=True)
class ModelFile:
    """One file as TOML gives it, and in which line each of its keys stands."""

    path: Path
    content: Mapping[str, Any]
    places: Places

    def line_of(self, mistake: Mistake) -> int:
        """Return the line that a mistake is about."""
        return self.places.of(mistake.table, mistake.number, mistake.key)

    def refusal(self, mistake: Mistake) -> FileFormatError:
        """Return the error for a mistake: file, line, key, what is wrong."""
        return FileFormatError(f"{self.path}, line {self.line_of(mistake)}: {mistake}")


def open_model_file(path: Path) -> ModelFile:
    """Read a file without judging what it says. Raises FileFormatError where there is none, or it is no TOML."""
    text = read_text_file(path, "a model")
    return ModelFile(path, parse_toml(text, f"{path}: cannot be read as a model"), Places(text))


def base_of(file: ModelFile, protocol: str, package: str, extended_by: Sequence[Path] = ()) -> Model | None:
    """Return the model that a file extends, None where it extends none.

    extended_by: the files that extend this one. Raises FileFormatError for one that is not there or cannot be read, and
    for a circle.
    """
    name = file.content.get("extends")
    if name is None:
        return None
    beside = file.path.with_name(f"{name}.toml") if name == Path(name).name else None
    found = [beside] if beside is not None and beside.is_file() else []
    found += [path for path in _files_named(package, protocol, name) if path not in found]
    if not found:
        what = f"there is no model {name!r} beside this one or among those of {protocol}"
        raise file.refusal(Mistake(key="extends", text=what))
    # A user's model may have the name of the one that it changes.
    circle = (*extended_by, file.path)
    left = [path for path in found if path not in circle]
    if not left:
        what = f"extends itself, by way of {', '.join(path.stem for path in circle)}"
        raise file.refusal(Mistake(key="extends", text=what))
    return _read(left[0], protocol, package, circle)


def assembled(content: Mapping[str, Any], base: Model | None) -> Model:
    """Return the model that a file without mistakes and what it extends make together."""
    quantities = {**(base.quantities if base else {}), **content.get("quantities", {})}
    parameters = [parameter_of(entry) for entry in content.get("parameter", [])]
    watchdog = Watchdog(**content["watchdog"]) if "watchdog" in content else None
    return Model(
        protocol=content["protocol"],
        name=content["name"],
        title=content.get("title", content["name"]),
        source=content.get("source", ""),
        parameters={**(base.parameters if base else {}), **{known.address: known for known in parameters}},
        faults={**(base.faults if base else {}), **_by_code(content, "faults")},
        warnings={**(base.warnings if base else {}), **_by_code(content, "warnings")},
        options={**(base.options if base else {}), **content.get("options", {})},
        quantities={name: address for name, address in quantities.items() if address},
        watchdog=watchdog or (base.watchdog if base else None),
        link_loss=content.get("link_loss", base.link_loss if base else ""),
        # A rule is about one series, so it is not taken over.
        identified_by=dict(content.get("identified_by", {})),
    )


def parameter_of(entry: Mapping[str, Any]) -> ParameterInfo:
    """Return the parameter that a table without mistakes is about."""
    exact: dict[str, Any] = {key: number_in(entry[key]) for key in EXACT if key in entry}
    plain = {key: entry[key] for key in PLAIN if key in entry}
    start = entry.get("start")
    return ParameterInfo(
        address=entry["address"],
        name=entry["name"],
        values=_by_code(entry, "values"),
        only_with={address: tuple(codes) for address, codes in entry.get("only_with", {}).items()},
        start=start if start is None or entry.get("type") in TEXT_TYPES else number_in(start),
        extra={key: value for key, value in entry.items() if key not in PARAMETER_KEYS},
        **{"title": entry["name"], **plain},
        **exact,
    )


def _read(path: Path, protocol: str, package: str, extended_by: Sequence[Path]) -> Model:
    file = open_model_file(path)
    mistake = next(mistakes_in(file.content, protocol), None)
    if mistake is not None:
        raise file.refusal(mistake)
    return assembled(file.content, base_of(file, protocol, package, extended_by))


def _by_code(table: Mapping[str, Any], name: str) -> dict[int, str]:
    return {int(code): text for code, text in table.get(name, {}).items()}


def _folders(package: str, protocol: str) -> Iterator[Path]:
    yield from user_folders(protocol)
    if package:
        yield _packaged(package)


def _packaged(package: str) -> Path:
    from importlib import resources  # noqa: PLC0415 - as above

    # Packages are installed as files; what is read here is extended and named by its path.
    with resources.as_file(resources.files(package) / "models") as folder:
        return folder


def _files_named(package: str, protocol: str, name: str) -> Iterator[Path]:
    if name != Path(name).name or len(name) > _LONGEST_NAME:
        return
    for folder in _folders(package, protocol):
        path = folder / f"{name}.toml"
        if path.is_file():
            yield path
