"""Random samples of facts in the packaged models, to be compared with the pages that they name."""

from __future__ import annotations

from random import Random
from typing import TYPE_CHECKING, NamedTuple

from drivecomm.models.support import addresses_behind
from drivecomm.models.sureness import counted_models
from drivecomm.protocol import DOUBTFUL

if TYPE_CHECKING:
    from collections.abc import Iterator

    from drivecomm.protocol import Model, PanelSetting, ParameterInfo


class Fact(NamedTuple):
    """One fact of one model.

    model: PROTOCOL/NAME. says: the content of the fact, in one line. behind: uses of the fact: common names, "a
    command" and "the watchdog". sure, source, second_source: as for parameters.
    """

    model: str
    address: str
    name: str
    says: str
    behind: tuple[str, ...]
    sure: str
    source: str
    second_source: str

    @property
    def has_page(self) -> bool:
        """Whether a page, a program or a drive supports the fact."""
        return self.sure not in DOUBTFUL


def facts() -> list[Fact]:
    """Return one fact for each parameter and panel setting of each packaged model, always in the same order.

    Models that list hearsay are left out. Raises FileFormatError for a packaged model that cannot be read.
    """
    return [fact for model in counted_models() for fact in _facts_of(model)]


def sample_facts(seed: int, count: int = 100) -> list[Fact]:
    """Return `count` random facts, or all if there are fewer.

    The same seed gives the same facts, as long as no model changes. Raises FileFormatError for a packaged model that
    cannot be read.
    """
    all_of_them = facts()
    return Random(seed).sample(all_of_them, min(count, len(all_of_them)))  # noqa: S311 - a fair choice, not a secret


def _facts_of(model: Model) -> Iterator[Fact]:
    commands = set(addresses_behind(model.control))
    watched = {model.watchdog.time, model.watchdog.action} if model.watchdog else set()
    for info in model.parameters.values():
        names = [name for name, address in model.quantities.items() if address.partition(".")[0] == info.address]
        if info.address in commands:
            names.append("a command")
        if info.address in watched:
            names.append("the watchdog")
        yield Fact(
            model=f"{model.protocol}/{model.name}",
            address=info.address,
            name=info.name,
            says=_said(info),
            behind=tuple(names),
            sure=info.sure,
            source=info.source,
            second_source=info.second_source,
        )
    for setting in model.setup:
        yield Fact(
            model=f"{model.protocol}/{model.name}",
            address=f"panel {setting.parameter}",
            name=setting.name,
            says=_set(setting),
            behind=(),
            sure=setting.sure,
            source=setting.source,
            second_source=setting.second_source,
        )


def _set(setting: PanelSetting) -> str:
    codes = ", ".join(f"{said} = {code}" for said, code in setting.codes.items())
    value = " or ".join((setting.value, *setting.also)) or f"made from {setting.made_from}"
    factory = f"factory {setting.factory}" if setting.factory else ""
    return "; ".join(part for part in (setting.purpose, value, setting.means, codes, factory, setting.when) if part)


def _said(info: ParameterInfo) -> str:
    texts = ", ".join(f"{code} {text}" for code, text in info.values.items())
    scale = f"{info.factor} {info.unit}" if info.unit else ""
    limits = "" if info.minimum is None and info.maximum is None else f"{info.minimum} to {info.maximum}"
    return "; ".join(part for part in (info.title, info.type, scale, limits, info.access, texts) if part)
