"""Drive models: what the parameters of one drive series mean, as data with a source.

A model is a TOML file:

    format = 1
    protocol = "vabus"
    name = "act"
    title = "Bonfiglioli ACT"
    extends = "family"            # optional: a model in the same folder whose parameters this one takes over
    source = "where the table as a whole comes from"

    [options]                     # defaults for the protocol's drive options and line facts
    ram_datasets = false

    [[parameter]]
    address = "481"               # in the protocol's form
    name = "fixed_frequency_2"    # lower case, words joined by underscores
    title = "fixed frequency 2"
    type = "long"                 # in the words of the protocol's manual
    unit = "Hz"
    factor = "0.01"               # physical value = raw value x factor
    access = "rw"                 # "r", "w", "rw", "rw*" (not while the motor runs)
    values = { 1 = "state machine", 2 = "remote contacts" }
    minimum = "0.00"              # physical, where the source gives them
    maximum = "999.99"
    source = "manual, page"
    sure = "manual"               # "manual", "inferred", "unconfirmed"

    [faults]
    1 = "text"
"""

from __future__ import annotations

from dataclasses import dataclass, field
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, get_args

from drivecomm.errors import FileFormatError, UsageError

if TYPE_CHECKING:
    from collections.abc import Mapping

Access: TypeAlias = Literal["r", "w", "rw", "rw*"]
Sureness: TypeAlias = Literal["manual", "inferred", "unconfirmed"]

_MODEL_FORMAT = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterInfo:
    """What is known about one parameter. `start` is a plausible value for a virtual drive, physical."""

    address: str
    name: str
    title: str
    type: str = ""
    unit: str = ""
    factor: Decimal = Decimal(1)
    access: Access = "rw"
    values: Mapping[int, str] = field(default_factory=dict)
    minimum: Decimal | None = None
    maximum: Decimal | None = None
    start: Decimal | str | None = None
    source: str = ""
    sure: Sureness = "manual"
    extra: Mapping[str, Any] = field(default_factory=dict)
    """Keys of this parameter that only its protocol knows, such as `datasets` or `conversion_index`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Model:
    """The parameters and fault texts of one drive series, and the drive options that suit it."""

    protocol: str
    name: str
    title: str
    source: str
    parameters: Mapping[str, ParameterInfo]
    faults: Mapping[int, str]
    options: Mapping[str, Any]

    def find(self, name_or_address: str) -> ParameterInfo | None:
        """Return the parameter with this address or this name, None when the model does not know it."""
        if name_or_address in self.parameters:
            return self.parameters[name_or_address]
        return next((known for known in self.parameters.values() if known.name == name_or_address), None)


def load_model(package: str, protocol: str, model: str | Path | Model) -> Model:
    """Return a model by its name in the protocol's package, or from a file of the user's.

    Raises UsageError for an unknown name and FileFormatError for a file that is no model of this protocol.
    """
    if isinstance(model, Model):
        return model
    if isinstance(model, Path) or str(model).endswith(".toml"):
        return read_model(Path(model), protocol)
    from importlib import resources  # noqa: PLC0415 - loaded with the first model, not with drivecomm

    known = model_names(package)
    if model not in known:
        raise UsageError(
            f"{protocol} has no model {model!r}; it has {', '.join(known) or 'none'}, or name a .toml file"
        )
    with resources.as_file(resources.files(package) / "models" / f"{model}.toml") as path:
        return read_model(path, protocol)


def model_names(package: str) -> list[str]:
    """Return the names of the models that a protocol package brings."""
    from importlib import resources  # noqa: PLC0415 - as above

    folder = resources.files(package) / "models"
    if not folder.is_dir():
        return []
    return sorted(entry.name.removesuffix(".toml") for entry in folder.iterdir() if entry.name.endswith(".toml"))


def read_model(path: Path, protocol: str) -> Model:
    """Read a model file. Raises FileFormatError with the file's name and what is wrong in it."""
    return _read(path, protocol, ())


def _read(path: Path, protocol: str, extended_by: tuple[str, ...]) -> Model:
    import tomllib  # noqa: PLC0415 - as above

    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise FileFormatError(f"{path}: cannot be read as a model: {error}") from error
    if content.get("format") != _MODEL_FORMAT:
        raise FileFormatError(f"{path}: a model begins with format = {_MODEL_FORMAT}")
    if content.get("protocol") != protocol:
        raise FileFormatError(f"{path}: is a model for {content.get('protocol')!r}, not for {protocol!r}")
    lineage = (*extended_by, path.stem)
    if content.get("extends") in lineage:
        raise FileFormatError(f"{path}: extends itself, by way of {', '.join(lineage)}")
    try:
        base = _read(path.with_name(f"{content['extends']}.toml"), protocol, lineage) if "extends" in content else None
        parameters = [_parameter(entry) for entry in content.get("parameter", [])]
        faults = {int(code): str(text) for code, text in content.get("faults", {}).items()}
        return Model(
            protocol=protocol,
            name=str(content["name"]),
            title=str(content.get("title", content["name"])),
            source=str(content.get("source", "")),
            parameters={**(base.parameters if base else {}), **{known.address: known for known in parameters}},
            faults={**(base.faults if base else {}), **faults},
            options={**(base.options if base else {}), **content.get("options", {})},
        )
    except KeyError as error:
        raise FileFormatError(f"{path}: the key {error} is missing") from error
    except (TypeError, ValueError, InvalidOperation, AttributeError) as error:
        raise FileFormatError(f"{path}: {error}") from error


_WORDS = {"access": get_args(Access), "sure": get_args(Sureness)}
_TEXT_TYPES = ("string", "text")
_KNOWN_KEYS = frozenset(ParameterInfo.__dataclass_fields__) - {"extra"}


def _parameter(entry: Mapping[str, Any]) -> ParameterInfo:
    exact: dict[str, Any] = {key: Decimal(str(entry[key])) for key in ("factor", "minimum", "maximum") if key in entry}
    plain: dict[str, Any] = {key: entry[key] for key in ("type", "unit", "access", "source", "sure") if key in entry}
    for key, value in plain.items():
        allowed = _WORDS.get(key)
        if not isinstance(value, str) or (allowed is not None and value not in allowed):
            raise ValueError(f"parameter {entry['address']}: {key} cannot be {value!r}")
    start = entry.get("start")
    return ParameterInfo(
        address=str(entry["address"]),
        name=str(entry["name"]),
        title=str(entry.get("title", entry["name"])),
        values={int(code): str(text) for code, text in entry.get("values", {}).items()},
        start=start if start is None or entry.get("type") in _TEXT_TYPES else Decimal(str(start)),
        extra={key: value for key, value in entry.items() if key not in _KNOWN_KEYS},
        **exact,
        **plain,
    )
