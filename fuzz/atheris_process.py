"""Process in which atheris runs one target: python fuzz/atheris_process.py TARGET CORPUS [libFuzzer options].

libFuzzer ends at the first error, so known errors are ignored to find others behind them.
"""

from __future__ import annotations

import sys
from importlib.metadata import entry_points
from random import Random

import atheris  # type: ignore[import-untyped]
from mutation import mutate_bytes
from outcome import kind_of, known_flaws

# Packages are listed by name: the option takes no patterns, and later imports are not instrumented.
_PROTOCOLS = {entry.module.partition(".")[0] for entry in entry_points(group="drivecomm.protocols")}
with atheris.instrument_imports(include=["drivecomm", "tomllib", *sorted(_PROTOCOLS)]):
    from all_targets import all_targets

    _TARGETS = all_targets()


def main() -> None:
    """Fuzz a target; libFuzzer ends the process."""
    target = _TARGETS[sys.argv.pop(1)]
    known = set(known_flaws(target))

    def check(data: bytes) -> None:
        """Raise unknown errors only."""
        try:
            target.check(data)
        except Exception as error:
            if kind_of(error) not in known:
                raise

    def change(data: bytes, max_size: int, seed: int) -> bytes:
        """Mutate an input, half of the time with the target's mutator and otherwise with libFuzzer's."""
        random = Random(seed)  # noqa: S311 - repeatable on purpose
        if random.random() < 0.5:
            return target.mutate(random, data, target.seeds)[:max_size]
        return bytes(atheris.Mutate(data, max_size))

    # For plain bytes libFuzzer's own mutator is best.
    own = {} if target.mutate is mutate_bytes else {"custom_mutator": change}
    atheris.Setup(sys.argv, check, **own)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
