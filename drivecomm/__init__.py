"""One interface to variable-frequency drives of different makers over serial lines."""

from typing import TYPE_CHECKING as _TYPE_CHECKING
from typing import Any as _Any

from drivecomm.bus import (
    Bus as Bus,
)
from drivecomm.bus import (
    open_bus as open_bus,
)
from drivecomm.decoding import decode as decode
from drivecomm.decoding import encode as encode
from drivecomm.drive import Broadcast as Broadcast
from drivecomm.drive import Drive as Drive
from drivecomm.errors import (
    AddressError as AddressError,
)
from drivecomm.errors import (
    CommandCancelledError as CommandCancelledError,
)
from drivecomm.errors import (
    CommandTooOldError as CommandTooOldError,
)
from drivecomm.errors import (
    DamagedReplyError as DamagedReplyError,
)
from drivecomm.errors import (
    DeadlineError as DeadlineError,
)
from drivecomm.errors import (
    DriveCommError as DriveCommError,
)
from drivecomm.errors import (
    DriveError as DriveError,
)
from drivecomm.errors import (
    FileFormatError as FileFormatError,
)
from drivecomm.errors import (
    LinkDownError as LinkDownError,
)
from drivecomm.errors import (
    LinkError as LinkError,
)
from drivecomm.errors import (
    NoReplyError as NoReplyError,
)
from drivecomm.errors import (
    NotAnsweringError as NotAnsweringError,
)
from drivecomm.errors import (
    NotSupported as NotSupported,
)
from drivecomm.errors import (
    OvertakenError as OvertakenError,
)
from drivecomm.errors import (
    ParameterAddressError as ParameterAddressError,
)
from drivecomm.errors import (
    PortError as PortError,
)
from drivecomm.errors import (
    ProtocolLoadError as ProtocolLoadError,
)
from drivecomm.errors import (
    RefusedError as RefusedError,
)
from drivecomm.errors import (
    ReplyError as ReplyError,
)
from drivecomm.errors import (
    StateError as StateError,
)
from drivecomm.errors import (
    TelegramError as TelegramError,
)
from drivecomm.errors import (
    UnexpectedReplyError as UnexpectedReplyError,
)
from drivecomm.errors import (
    UnknownProtocolError as UnknownProtocolError,
)
from drivecomm.errors import (
    UsageError as UsageError,
)
from drivecomm.errors import (
    ValueRefusedError as ValueRefusedError,
)
from drivecomm.likely_settings import LineChoices as LineChoices
from drivecomm.line import LineSettings as LineSettings
from drivecomm.line import Timing as Timing
from drivecomm.link import TraceEvent as TraceEvent
from drivecomm.poll_loops import poll as poll
from drivecomm.polling import PollItem as PollItem
from drivecomm.polling import PollResult as PollResult
from drivecomm.protocol import Capabilities as Capabilities
from drivecomm.reading import Reading as Reading
from drivecomm.registry import protocols as protocols
from drivecomm.scanning import Found as Found
from drivecomm.status import DriveState as DriveState
from drivecomm.status import DriveStatus as DriveStatus
from drivecomm.status import Stop as Stop
from drivecomm.telegram import Telegram as Telegram
from drivecomm.version import __version__ as __version__

if _TYPE_CHECKING:
    from drivecomm.async_bus import AsyncBus as AsyncBus
    from drivecomm.async_bus import open_bus_async as open_bus_async
    from drivecomm.async_drive import AsyncBroadcast as AsyncBroadcast
    from drivecomm.async_drive import AsyncDrive as AsyncDrive
    from drivecomm.keeping import keep as keep
    from drivecomm.keeping import keep_async as keep_async
    from drivecomm.plant.opened import OpenPlant as OpenPlant
    from drivecomm.plant.opened import open_plant as open_plant
    from drivecomm.poll_loops import poll_async as poll_async
    from drivecomm.watchdog import read_watchdog as read_watchdog
    from drivecomm.watchdog import read_watchdog_async as read_watchdog_async
    from drivecomm.watchdog import set_watchdog as set_watchdog
    from drivecomm.watchdog import set_watchdog_async as set_watchdog_async

_ON_DEMAND = {
    "AsyncBroadcast": "drivecomm.async_drive",
    "AsyncBus": "drivecomm.async_bus",
    "AsyncDrive": "drivecomm.async_drive",
    "OpenPlant": "drivecomm.plant.opened",
    "open_bus_async": "drivecomm.async_bus",
    "keep": "drivecomm.keeping",
    "keep_async": "drivecomm.keeping",
    "open_plant": "drivecomm.plant.opened",
    "poll_async": "drivecomm.poll_loops",
    "read_watchdog": "drivecomm.watchdog",
    "read_watchdog_async": "drivecomm.watchdog",
    "set_watchdog": "drivecomm.watchdog",
    "set_watchdog_async": "drivecomm.watchdog",
}


def __getattr__(name: str) -> _Any:
    # asyncio, threads and the reader of plants are loaded by those who use them, not by those who import drivecomm.
    if name not in _ON_DEMAND:
        raise AttributeError(f"module 'drivecomm' has no attribute {name!r}")
    from importlib import import_module  # noqa: PLC0415

    return getattr(import_module(_ON_DEMAND[name]), name)
