"""The schemas of a protocol package, found where they are declared."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from drivecomm.schema.form import Form

if TYPE_CHECKING:
    from collections.abc import Iterator

    from drivecomm.protocol import Protocol


@dataclass(frozen=True, slots=True)
class NamedForm:
    """A schema of a protocol package. name: its module, its variable, its message."""

    name: str
    form: Form[Any]


def forms_of(plugin: Protocol) -> list[NamedForm]:
    """Return the forms that the loaded modules of a protocol package hold, alone or in tuples, lists and mappings."""
    seen: dict[int, NamedForm] = {}
    package = plugin.package
    for module_name, module in sorted(sys.modules.items()):
        if module_name == package or module_name.startswith(f"{package}."):
            short = module_name.removeprefix(package).lstrip(".")
            for variable, value in vars(module).items():
                for name, form in _forms_in(value, f"{short}.{variable}"):
                    seen.setdefault(id(form), NamedForm(f"{name}.{form.message.__name__}", form))
    return list(seen.values())


def _forms_in(value: object, name: str) -> Iterator[tuple[str, Form[Any]]]:
    if isinstance(value, Form):
        yield name, value
    elif isinstance(value, dict | tuple | list):
        entries = value.values() if isinstance(value, dict) else value
        for number, each in enumerate(entries):
            yield from _forms_in(each, f"{name}[{number}]")
