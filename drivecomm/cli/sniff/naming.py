"""Parameter names and values for the drives that are heard."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from drivecomm.errors import DriveCommError
from drivecomm.models import load_model
from drivecomm.protocol import DriveConfig, checked_address, installed, resolve_options
from drivecomm.traffic.sniffer import HeardTelegram, ParameterNames

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from drivecomm.protocol import LineSettings, ParameterInfo, Reading
    from drivecomm.traffic.sniffer import LineEvent


@dataclass(frozen=True, slots=True, kw_only=True)
class Meaning:
    """What a telegram is about: the parameter, and in a reply its value or why there is none."""

    parameter: ParameterInfo | None = None
    reading: Reading | None = None
    refusal: str = ""


_NOTHING = Meaning()


@dataclass(slots=True)
class Naming:
    """Names the parameters of drives whose model is known.

    drives: as given with --drive. everybody: whether other drives are taken for their protocol's default model.
    """

    drives: Sequence[DriveConfig]
    everybody: bool = False
    _known: dict[str, ParameterNames | None] = field(default_factory=dict)

    def check(self) -> None:
        """Raise UsageError unless all drives can be."""
        for drive in self.drives:
            _, options = _sorted_out(drive)
            checked_address(installed[drive.protocol], drive.address, options)

    @property
    def options(self) -> Mapping[str, Any]:
        """The protocols' drive options, from the first drive of each."""
        chosen: dict[str, Any] = {}
        for drive in self.drives:
            chosen.setdefault(drive.protocol, _sorted_out(drive)[1])
        return chosen

    @property
    def settings(self) -> LineSettings | None:
        """The line settings of the first drive."""
        return _sorted_out(self.drives[0])[0] if self.drives else None

    def meaning(self, event: LineEvent) -> Meaning:
        """Return what a telegram is about, as far as the drive's model says."""
        if not isinstance(event.item, HeardTelegram):
            return _NOTHING
        request = event.pair.request if event.pair else event.item
        if request is None or request.direction != "request":
            return _NOTHING
        if request.drive not in self._known:
            self._known[request.drive] = self._make(request.drive)
        names = self._known[request.drive]
        if names is None:
            return _NOTHING
        parameter = names.parameter(request.message)
        if event.pair is None:
            return Meaning(parameter=parameter)
        try:
            return Meaning(parameter=parameter, reading=names.reading(request.message, event.item.message))
        except DriveCommError as error:
            return Meaning(parameter=parameter, refusal=str(error))

    def _make(self, drive: str) -> ParameterNames | None:
        protocol, _, address = drive.partition(":")
        if not address.isdigit():
            return None
        chosen = next((one for one in self.drives if str(one) == drive), None)
        if chosen is None:
            if not self.everybody:
                return None
            chosen = DriveConfig(protocol=protocol, address=int(address))
        plugin = installed[protocol]
        name = chosen.options.get("model") or plugin.default_model
        model = load_model(plugin.package, protocol, name)
        return ParameterNames(plugin, int(address), model, _sorted_out(chosen)[1])


def _sorted_out(drive: DriveConfig) -> tuple[LineSettings, Any]:
    """Return line settings and protocol options. Raises UsageError for an option that the protocol does not have."""
    plugin = installed[drive.protocol]
    given = {name: value for name, value in drive.options.items() if name != "model"}
    name = drive.options.get("model")
    model = load_model(plugin.package, drive.protocol, name) if name else None
    facts, options = resolve_options(plugin, model, given)
    return facts.settings, options
