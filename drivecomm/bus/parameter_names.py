"""Parameters of a drive by name, for completion at a prompt."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

from drivecomm.errors import did_you_mean

if TYPE_CHECKING:
    from drivecomm.protocol import Model, ParameterInfo


class ParameterNames(Mapping[str, "ParameterInfo"]):
    """Data of each parameter in a model, by common name and by name in the model; empty without a model.

    An attribute is the name itself, for reading or writing, so that the prompt completes it:
    `drive.read(drive.parameters.output_frequency)`.
    """

    def __init__(self, drive: str, model: Model | None) -> None:
        self._drive = drive
        self._known: dict[str, ParameterInfo] = {}
        if model is not None:
            self._known = {each.name: each for each in model.parameters.values() if each.name}
            self._known |= {name: model.parameters[address] for name, address in model.quantities.items()}

    def __getattr__(self, name: str) -> str:
        if name.startswith("_"):
            raise AttributeError(name)
        if name in self._known:
            return name
        why = (
            did_you_mean(name, self._known) or "list(drive.parameters) has all of its model"
            if self._known
            else "give a model"
        )
        raise AttributeError(f"no parameter of {self._drive} is named {name}; {why}")

    def __getitem__(self, name: str) -> ParameterInfo:
        return self._known[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._known)

    def __len__(self) -> int:
        return len(self._known)

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self._known]

    def _ipython_key_completions_(self) -> list[str]:
        return list(self._known)

    def __repr__(self) -> str:
        return f"<{type(self).__name__} of {self._drive}: {', '.join(self._known) or 'no model'}>"
