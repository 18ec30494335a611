"""Detection of the form of a foreign file, by its contents, and reading by the matching reader."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

from drivecomm.commissioning.importing.fluidnc import BUILT_IN, fluidnc_configuration
from drivecomm.commissioning.importing.home_assistant import home_assistant_section
from drivecomm.commissioning.importing.register_lists import register_list
from drivecomm.commissioning.importing.spindles import grblhal_settings, vfdmod_configuration
from drivecomm.commissioning.importing.telegraf import telegraf_section
from drivecomm.commissioning.importing.wirenboard import wirenboard_template
from drivecomm.errors import FileFormatError, UsageError
from drivecomm.tomlfile import no_such_file

if TYPE_CHECKING:
    from pathlib import Path

    from drivecomm.commissioning.importing.addresses import Base
    from drivecomm.commissioning.importing.foreign_contents import ForeignContents

_TELEGRAF = re.compile(r"^\s*\[\[\s*inputs\.modbus\s*\]\]", re.MULTILINE)
_INI = re.compile(r"^\s*\[\s*spindlerpmout\s*\]", re.MULTILINE | re.IGNORECASE)
_YAML = re.compile(rf"^(?:-\s+)?(?:modbus|ModbusVFD|name|type|{'|'.join(sorted(BUILT_IN))})\s*:", re.MULTILINE)
_KNOWN = (
    "register lists as CSV with a heading line, wb-mqtt-serial templates, FluidNC and grblHAL spindles, vfdmod ini "
    "files, and the Modbus sections of Home Assistant and Telegraf"
)


def read_foreign(path: Path, base: Base | None = None) -> ForeignContents:
    """Return the drive data in a file of another program.

    base: numbering of a register list; None to derive it from the addresses. Raises FileFormatError for a file that
    cannot be read or has no known form, and UsageError if a base is given for a form with a numbering of its own.
    """
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        raise FileFormatError(no_such_file(path)) from None
    except OSError as error:
        raise FileFormatError(f"{path}: cannot be read ({error.strerror or error})") from error
    if data.startswith(b"PK"):
        raise FileFormatError(f"{path}: is a workbook or an archive; save the sheet with the registers as CSV")
    found = _other(data.decode("utf-8-sig", errors="replace"), path)
    if found is None:
        found = register_list(data, base)
    elif base is not None:
        raise UsageError(f"{path} is a {found.form}, whose addresses are those of telegrams; leave --register-base out")
    if found is None:
        raise FileFormatError(f"{path}: not a file that can be imported; supported are {_KNOWN}")
    if not found.registers:
        reasons = "; ".join(str(each) for each in found.left[:3])
        raise FileFormatError(
            f"{path}: the {found.form} names no register that can be read ({reasons or 'it is empty'})"
        )
    return found


def _other(text: str, path: Path) -> ForeignContents | None:
    """Return the contents of the file if it has another form than a register list."""
    shown = str(path)
    if text.lstrip().startswith("{"):
        return wirenboard_template(text, shown)
    if _TELEGRAF.search(text):
        return telegraf_section(text, shown)
    if _INI.search(text):
        return vfdmod_configuration(text, shown)
    if path.suffix in (".yaml", ".yml") or (path.suffix != ".csv" and _YAML.search(text)):
        content = _yaml(text, path)
        found = fluidnc_configuration(content) if isinstance(content, dict) else None
        return found or home_assistant_section(content)
    return grblhal_settings(text)


def _yaml(text: str, path: Path) -> Any:
    try:
        import yaml
    except ModuleNotFoundError:
        raise UsageError(
            f"{path} is YAML, for which PyYAML is needed, and it is not installed; install drivecomm[import]"
        ) from None

    # A separate loader class, which reads a tag such as !secret as the text behind it.
    loader: Any = type("Loader", (yaml.SafeLoader,), {})
    loader.add_multi_constructor("!", lambda _, tag, node: f"!{tag} {getattr(node, 'value', '')}")
    try:
        return yaml.load(text, loader)  # noqa: S506 - a SafeLoader
    except yaml.YAMLError as error:
        raise FileFormatError(f"{path}: cannot be read as YAML: {' '.join(str(error).split())}") from error
