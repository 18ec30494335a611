"""Rest of a reply that comes in pieces, on the short path of the link."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.link.port import Receive
from drivecomm.link.reply_matching import LONGEST_TELEGRAM

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from drivecomm.link.line_state import LineState
    from drivecomm.link.peer import Peer
    from drivecomm.link.port import Arrival, LinkSteps, Transaction


def rest_of_reply(
    line: LineState, peer: Peer, talk: Transaction, first: Arrival, needed: int, *, stop_waits: Callable[[], bool]
) -> LinkSteps[tuple[Sequence[Arrival], bytes, int]]:
    """Return the pieces of a reply, all their bytes, and the number of bytes that such a telegram has.

    The last piece is empty if the rest does not come. The waits are the same as on the long path, which receives all
    the pieces if something is irregular. stop_waits: returns whether a stop waits for the line.
    """
    codec, gap_s, gives_way, character_s = peer.codec, peer.gap_s, talk.gives_way, peer.character_s
    latest = talk.until + LONGEST_TELEGRAM * character_s + gap_s
    pieces, came = [first], first.data
    while needed > len(came) and pieces[-1].data and line.now < latest and not (gives_way and stop_waits()):
        missing = needed - len(came)
        arrival = yield Receive(line.now + missing * character_s + gap_s, missing, gives_way)
        line.now = arrival.time
        pieces.append(arrival)
        came += arrival.data
        needed = codec.measure(came, "reply")
    return pieces, came, needed
