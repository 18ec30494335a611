"""What follows from the verdicts for whoever plans the line."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.traffic.cohabitation.verdicts import Outcome

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from drivecomm.traffic.cohabitation.drives import Partner
    from drivecomm.traffic.cohabitation.verdicts import Verdict

_TRIED = 12
"""Other addresses of a drive that are looked at, spread over all that it can have."""


def advice(
    partners: Sequence[Partner],
    verdicts: Sequence[tuple[Partner, Partner, Verdict]],
    safe: Callable[[Partner, Partner], bool],
) -> Iterator[str]:
    """Yield sentences that say what to do. safe: whether a speaker's traffic excludes a telegram for a listener."""
    bad = [each for each in verdicts if not each[2].safe]
    if not bad:
        tried = any(each[2].outcome is Outcome.UNHEARD for each in verdicts)
        yield (
            "safe as far as it was tried: drives with different line settings hear each other as noise"
            if tried
            else "safe: these drives can share the line with these addresses and settings"
        )
        return
    told = set()
    for speaker, listener, _ in bad:
        if listener.name in told:
            continue
        told.add(listener.name)
        speakers = [each for each in partners if each is not listener]
        address = _better_address(listener, speakers, safe)
        if address is not None:
            yield f"give {listener.name} another address, such as {address}; no telegram of the others suits that"
        else:
            yield (
                f"no other address helps {listener.name} beside {speaker.name}: put them on lines of their own, or "
                "give them different baud rates, or see from the proof how seldom it happens"
            )


def _better_address(
    listener: Partner, speakers: Sequence[Partner], safe: Callable[[Partner, Partner], bool]
) -> int | None:
    plugin = listener.dialect.plugin
    taken = {each.address for each in speakers if each.dialect.plugin is plugin} | {listener.address}
    free = [address for address in plugin.addresses if address not in taken]
    for address in free[:: max(1, len(free) // _TRIED)]:
        moved = listener.at(address)
        if all(safe(speaker, moved) for speaker in speakers):
            return address
    return None
