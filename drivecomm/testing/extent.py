"""How much of a protocol is judged."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Extent:
    """How much is tried.

    examples: of each property. dear_every: every so many vectors are put through the checks that cost most: all flips,
    all truncations in a stream, compiled against interpreted. exchange_ways: the names of the ways in which an
    exchange is played. live: how many exchanges are played in real time, in each way. every_model: whether parameters
    and commands are tried with all models of the package, or with its default one.
    """

    examples: int
    dear_every: int
    exchange_ways: tuple[str, ...]
    live: int
    every_model: bool


FULL = Extent(
    examples=40,
    dear_every=1,
    exchange_ways=("exchange", "awaited", "echo", "lumps", "another-drive", "noise", "script"),
    live=2,
    every_model=True,
)
"""Everything: what a maintainer runs before a release, some twenty seconds for each protocol."""

QUICK = Extent(
    examples=12,
    dear_every=4,
    exchange_ways=("exchange", "another-drive", "script"),
    live=0,
    every_model=False,
)
"""A few seconds: what a maintainer runs at every change, and what hunts for mutants run."""
