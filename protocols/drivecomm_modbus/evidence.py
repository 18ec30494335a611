"""Evidence for the series of a drive: registers and functions that only drives of that series have.

A control word does not identify a drive, and the same register means different things (2000H := 1 stops a Delta and
starts an INVT). So before the first command, a drive is asked for registers that its model has and that models with the
same command registers lack.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING

from drivecomm.profiles import RegisterPlace, views_of
from drivecomm.protocol import cached
from drivecomm_modbus import functions as fn
from drivecomm_modbus.dialect import ModbusDialect
from drivecomm_modbus.options import ModbusOptions

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from drivecomm.profiles import RegisterParameter
    from drivecomm.protocol import Model

_FIRST = ("fault_code", "reference_hz", "reference_percent")
_SURE = ("drive", "printed", "derived", "field")


@dataclass(frozen=True, slots=True, kw_only=True)
class Evidence:
    """Requests that identify the series of a drive.

    present: parameters that it must have. absent: parameters of other series that it must refuse. knows: function that
    must return its identity, 0 for none. lacks: function that it must refuse, 0 for none. open: models that all these
    requests cannot rule out. titled: models by title, its own and the open ones, if function 2BH may return the title.
    """

    present: tuple[RegisterParameter, ...]
    absent: tuple[RegisterParameter, ...] = ()
    knows: int = 0
    lacks: int = 0
    open: tuple[str, ...] = ()
    titled: Mapping[str, str] = field(default_factory=dict, hash=False)


class Series:
    """The registers of one series, as defined by its model.

    options: options of its drives; None for those of the model.
    """

    def __init__(self, model: Model, options: ModbusOptions | None = None) -> None:
        known = {each.name for each in fields(ModbusOptions)}
        own = {name: value for name, value in model.options.items() if name in known}
        self._dialect = dialect = ModbusDialect(0, options or ModbusOptions(**own), model)
        self.model, self.control = model, dialect.control
        targets = [dialect.target(address) for address in model.parameters]
        written = [each for each in targets if each.info is not None and "w" in each.info.access]
        views = views_of(model, dialect.place_of)
        looked_at = {condition.place for condition in self.control.status.values()}
        self.held = frozenset({spot for each in targets for spot in each.spots} | set(views) | looked_at)
        self.writable = frozenset(spot for each in written for spot in each.spots) | self.control.starts

    @property
    def status(self) -> tuple[RegisterParameter, ...]:
        """The register or coil that holds the status."""
        places = [RegisterPlace.named(condition.place) for condition in self.control.status.values()]
        return tuple(self._dialect.target(self._dialect.address_at(place)) for place in places[:1])

    def in_order(self) -> list[RegisterParameter]:
        """Return its readable parameters, first those that every drive of the series has for its commands."""
        control, model = self.control, self.model
        named = [*model.quantities.values(), *(getattr(control, each) for each in _FIRST), *control.needs]
        infos = [info for each in named if each and (info := model.find(each)) is not None]
        for sure in _SURE:
            infos += [info for info in model.parameters.values() if info.sure == sure and info.kind != "command"]
        readable = dict.fromkeys(info.address for info in infos if "r" in info.access)
        found = [self._dialect.target(each) for each in readable]
        return [each for each in found if not each.place.part]

    def may_answer(self, wanted: RegisterParameter) -> bool:
        """Whether drives of this series may answer for a parameter of another series."""
        spots = wanted.spots if self.control.unused != "zero" else wanted.spots[:1]
        return self.held.issuperset(spots)

    def knows(self, function: int) -> bool:
        """Whether drives of this series know a function that returns their identity."""
        listed = self.control.functions
        return function in listed if listed else self.control.identification == function


@cached
def _series(model: Model) -> Series:
    return Series(model)


@cached
def evidence_for(model: Model, options: ModbusOptions, others: tuple[Model, ...]) -> Evidence:
    """Return the requests that distinguish a drive from those of other models that its command words could start.

    The status is always read, whatever the other models are.
    """
    own = Series(model, options)
    chosen, parameters = list(own.status), own.in_order()
    rivals = [each for each in map(_series, others) if each.model.name != model.name]
    rivals = [each for each in rivals if own.writable & each.control.starts and all(map(each.may_answer, chosen))]
    while rivals and parameters:
        best = max(parameters, key=lambda each: sum(not rival.may_answer(each) for rival in rivals))
        left = [each for each in rivals if each.may_answer(best)]
        if len(left) == len(rivals):
            break
        chosen.append(best)
        rivals = left
    told_by = own.control.identification or 0
    silent = [each for each in rivals if told_by and not each.knows(told_by)]
    rivals = [each for each in rivals if each not in silent]
    lacks = next((each.control.identification or 0 for each in rivals), 0)
    if lacks and not own.knows(lacks):
        rivals = [each for each in rivals if each.control.identification != lacks]
    else:
        lacks = 0
    absent: list[RegisterParameter] = []
    for rival in rivals:
        if not any(rival.may_answer(each) for each in absent):
            absent += [each for each in rival.in_order() if not own.may_answer(each)][:1]
    rivals = [each for each in rivals if not any(map(each.may_answer, absent))]
    return Evidence(
        present=tuple(chosen),
        absent=tuple(absent),
        knows=told_by if silent else 0,
        lacks=lacks,
        open=tuple(each.model.name for each in rivals),
        titled=_by_title([own, *rivals]) if rivals and own.knows(fn.IDENTIFICATION) else {},
    )


def _by_title(known: Iterable[Series]) -> Mapping[str, str]:
    return {each.model.title.encode("ascii", "replace").decode(): each.model.name for each in known}


def candidates(
    models: Iterable[Model], answered: Sequence[RegisterParameter], refused: RegisterParameter | None = None
) -> tuple[str, ...]:
    """Return the models that have the status among the answered parameters, and that may lack the refused one.

    Models that may not answer one of the answered parameters are left out. Without an answer no model is returned.
    """
    spots = {spot for each in answered for spot in each.spots}
    known = [_series(each) for each in models]
    fitting = [each for each in known if each.status and spots.issuperset(each.status[0].spots)]
    fitting = [each for each in fitting if all(map(each.may_answer, answered))]
    return tuple(each.model.name for each in fitting if refused is None or not each.may_answer(refused))
