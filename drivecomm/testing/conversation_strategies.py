"""Hypothesis strategies for whole conversations with a drive of any installed protocol.

A model lists parameters, but rarely everything that a drive accepts. So each call is tried once on a virtual drive
before the first example: reads must be answered, and writes must be accepted.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from hypothesis import strategies as st

from drivecomm.errors import DriveCommError
from drivecomm.models import load_model
from drivecomm.protocol import installed
from drivecomm.testing.bench import bench

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping
    from decimal import Decimal

    from hypothesis.strategies import SearchStrategy

    from drivecomm.bus import Drive
    from drivecomm.protocol import Model, ParameterInfo, Protocol, Value


@dataclass(frozen=True, slots=True)
class VerbCall:
    """A call of one verb of a drive: `carry_out(drive)` makes the call and returns the verb's result."""

    verb: str
    values: tuple[Any, ...] = ()
    options: Mapping[str, Any] = field(default_factory=dict)

    def carry_out(self, drive: Any) -> Any:
        """Call the verb of a Drive, or of an AsyncDrive, whose result must be awaited."""
        return getattr(drive, self.verb)(*self.values, **self.options)

    def __repr__(self) -> str:
        options = (f"{name}={value!r}" for name, value in self.options.items())
        return f"{self.verb}({', '.join([*map(repr, self.values), *options])})"


def verb_calls(protocol: str, *, model: str | None = None) -> SearchStrategy[VerbCall]:
    """Return a strategy for calls with arguments that a drive of this protocol accepts.

    A drive that has just been switched on refuses none of the reads and writes. Later it may refuse them with
    DriveError: a running motor or another parameter can lock a parameter. None raises UsageError, and none goes without
    a reply on an undisturbed line. Verbs that only one protocol has are not included. model: the drive's model in the
    package; the protocol's default model if absent.
    """
    plugin = installed[protocol]
    return st.deferred(lambda: _verb_calls(plugin.name, model or plugin.default_model))


def conversations(
    protocol: str, *, model: str | None = None, min_size: int = 1, max_size: int = 12
) -> SearchStrategy[list[VerbCall]]:
    """Return a strategy for lists of such calls, to be carried out in order."""
    return st.lists(verb_calls(protocol, model=model), min_size=min_size, max_size=max_size)


# Trying a hundred parameters takes longer than drawing examples, so the result is cached.
@lru_cache
def _verb_calls(protocol: str, model: str) -> SearchStrategy[VerbCall]:
    plugin = installed[protocol]
    known = load_model(plugin.package, plugin.name, model)
    groups = [list(_reads(plugin, known)), list(_writes(plugin, known)), list(_commands(plugin, known))]
    # Draw commands as often as reads and writes, however many parameters the model has.
    return st.sampled_from([st.one_of(group) for group in groups if group]).flatmap(lambda group: group)


def _reads(plugin: Protocol, model: Model) -> Iterator[SearchStrategy[VerbCall]]:
    with bench(plugin, model) as on:
        calls = [VerbCall("read", (info.address,)) for info in model.parameters.values() if "r" in info.access]
        readable = [call for call in calls if _takes(on.drive, call)]
    if readable:
        yield st.sampled_from(readable)


def _writes(plugin: Protocol, model: Model) -> Iterator[SearchStrategy[VerbCall]]:
    for info in model.parameters.values():
        if "r" in info.access and "w" in info.access:
            # A new bench for each parameter: after a change of address, a drive no longer answers later calls.
            with bench(plugin, model) as on:
                yield from _writes_of(info, on.drive)


def _writes_of(info: ParameterInfo, drive: Drive) -> Iterator[SearchStrategy[VerbCall]]:
    try:
        held = drive.read(info.address).value
    except DriveCommError:
        return
    ways = [
        options for options in ({}, {"store": True}) if _takes(drive, VerbCall("write", (info.address, held), options))
    ]
    if not ways or not _answers(drive):
        return

    def takes(value: Value) -> bool:
        return _takes(drive, VerbCall("write", (info.address, value), ways[0]))

    values: SearchStrategy[Value]
    if isinstance(held, str | bool):
        values = st.just(held)
    elif info.values:
        named: list[Value] = [number for number in info.values if takes(number) and _answers(drive)]
        values = st.sampled_from(named or [held])
    else:
        lowest, highest = _steps(info, held, takes)
        # A drive that accepts a value and then stops answering has changed its address, for example.
        if not _answers(drive):
            return
        values = st.integers(lowest, highest).map(lambda step: held + step * info.factor)
    yield st.builds(lambda value, way: VerbCall("write", (info.address, value), way), values, st.sampled_from(ways))


_FLOAT_HOLDS_ALL = 1 << 23
"""Number of steps up to which a 32-bit float represents every integer, with a factor of two to spare."""


def _steps(info: ParameterInfo, held: int | Decimal, takes: Callable[[Value], bool]) -> tuple[int, int]:
    """Return how many steps the parameter can go down and up from its present value."""
    if info.minimum is not None and info.maximum is not None and takes(info.minimum) and takes(info.maximum):
        return int((info.minimum - held) / info.factor), int((info.maximum - held) / info.factor)

    steps_held = abs(held / info.factor)

    def takes_step(step: int) -> bool:
        if not takes(held + step * info.factor):
            return False
        if abs(step) + steps_held < _FLOAT_HOLDS_ALL:
            return True
        # A larger 32-bit float represents only every second number, so try the neighbouring step as well.
        beside = step - 1 if step > 0 else step + 1
        return takes(held + beside * info.factor)

    return limits(0, takes_step)


def _commands(plugin: Protocol, model: Model) -> Iterator[SearchStrategy[VerbCall]]:
    with bench(plugin, model) as on:
        can = on.drive.capabilities
        asking = [VerbCall(verb) for verb in ("status", "probe", "identify")]
        # A drive whose model is monitoring only may not report a status.
        yield st.sampled_from([call for call in asking if _takes(on.drive, call)])
        if can.monitoring_only:
            return
        if _takes(on.drive, reset := VerbCall("reset")):
            yield st.just(reset)
        yield st.sampled_from([VerbCall("stop", (how,)) for how in sorted(can.stops, key=lambda how: how.value)])
        yield st.sampled_from([VerbCall("start"), *([VerbCall("start", (), {"reverse": True})] if can.reverse else [])])
        for unit in ("percent", "hz"):
            if getattr(can, f"reference_{unit}"):
                yield _references(unit, on.drive)


def _references(unit: str, drive: Drive) -> SearchStrategy[VerbCall]:
    def call(number: int) -> VerbCall:
        return VerbCall("set_reference", (), {unit: number})

    lowest, highest = limits(0, lambda number: abs(number) <= 1000 and _takes(drive, call(number)))
    return st.integers(lowest, highest).map(call)


def _takes(drive: Drive, call: VerbCall) -> bool:
    try:
        call.carry_out(drive)
    except DriveCommError:
        return False
    return True


def _answers(drive: Drive) -> bool:
    return _takes(drive, VerbCall("probe"))


FARTHEST = 1 << 33
"""Search limit: no field of a drive telegram has more than 32 bits."""


def limits(start: int, accepts: Callable[[int], bool]) -> tuple[int, int]:
    """Return the lowest and the highest accepted number, if all numbers in between are accepted as well.

    start: a number that is accepted.
    """
    return start - _reach(lambda distance: accepts(start - distance)), start + _reach(
        lambda distance: accepts(start + distance)
    )


def _reach(accepts: Callable[[int], bool]) -> int:
    sound, step = 0, 1
    while step < FARTHEST and accepts(step):
        sound, step = step, step * 2
    refused = step
    while refused - sound > 1:
        middle = (sound + refused) // 2
        sound, refused = (middle, refused) if accepts(middle) else (sound, middle)
    return sound
