"""Parameter names and values of the drives in sniffed traffic."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from drivecomm.errors import DriveCommError
from drivecomm.models import load_model
from drivecomm.protocol import DriveConfig, checked_address, installed, resolve_options
from drivecomm.traffic.sniffer import HeardParameterNames, HeardTelegram

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from drivecomm.protocol import LineSettings, ParameterInfo, Reading
    from drivecomm.traffic.sniffer import LineEvent


@dataclass(frozen=True, slots=True, kw_only=True)
class Meaning:
    """Meaning of a telegram: the parameter, and in a reply its value or the refusal."""

    parameter: ParameterInfo | None = None
    reading: Reading | None = None
    refusal: str = ""


_NOTHING = Meaning()


@dataclass(slots=True)
class Naming:
    """Naming of the parameters of drives with a known model.

    drives: drives given with --drive. everybody: whether other drives get their protocol's default model.
    """

    drives: Sequence[DriveConfig]
    everybody: bool = False
    _known: dict[str, HeardParameterNames | None] = field(default_factory=dict)

    def check(self) -> None:
        """Raise UsageError for an invalid drive."""
        for drive in self.drives:
            _, options = _sorted_out(drive)
            checked_address(installed[drive.protocol], drive.address, options)

    @property
    def options(self) -> Mapping[str, Any]:
        """Drive options of each protocol, from its first drive."""
        chosen: dict[str, Any] = {}
        for drive in self.drives:
            chosen.setdefault(drive.protocol, _sorted_out(drive)[1])
        return chosen

    @property
    def settings(self) -> LineSettings | None:
        """Line settings of the first drive."""
        return _sorted_out(self.drives[0])[0] if self.drives else None

    def meaning(self, event: LineEvent) -> Meaning:
        """Return the meaning of a telegram, as far as the drive's model contains it."""
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

    def _make(self, drive: str) -> HeardParameterNames | None:
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
        return HeardParameterNames(plugin, int(address), model, _sorted_out(chosen)[1])


def _sorted_out(drive: DriveConfig) -> tuple[LineSettings, Any]:
    """Return line settings and protocol options of a drive. Raises UsageError for an unknown option."""
    plugin = installed[drive.protocol]
    given = {name: value for name, value in drive.options.items() if name != "model"}
    name = drive.options.get("model")
    model = load_model(plugin.package, drive.protocol, name) if name else None
    facts, options = resolve_options(plugin, model, given)
    return facts.settings, options
