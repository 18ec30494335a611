"""The verbs of a VABus master: read, write, control, status."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Any

from drivecomm import profiles
from drivecomm.errors import NotSupported, ParameterAddressError, RefusedError, UsageError
from drivecomm.protocol import Capabilities, Stop
from drivecomm_vabus import states
from drivecomm_vabus.conversation import Conversation
from drivecomm_vabus.memory import VabusMemory
from drivecomm_vabus.motion import Motion
from drivecomm_vabus.parameters import Target, characters_for, reading_of, target
from drivecomm_vabus.references import References
from drivecomm_vabus.states import profile
from drivecomm_vabus.telegrams import BROADCAST

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping

    from drivecomm.protocol import DriveStatus, Exchange, Model, Reading, Value as ParameterValue
    from drivecomm_vabus.options import VabusOptions

# A poll plan asks for the same parameters again and again; more of them than this are not kept in mind.
_KEPT = 512


class VabusOperations:
    """The verbs of one VABus drive, or of all drives at address 32."""

    def __init__(
        self, address: int, options: VabusOptions, model: Model | None, memory: VabusMemory | None = None
    ) -> None:
        self._address = address
        self._options = options
        self._model = model
        self._memory = memory or VabusMemory()
        self._talk = Conversation(address, options, self._memory)
        self._references = References(self._talk, options, model)
        self._motion = Motion(
            self._talk, self._references, self._memory, model, state_timeout_s=options.state_timeout_s
        )
        # Model and options of a drive do not change, so that an address always means the same.
        self._known = lru_cache(_KEPT)(lambda name, kind: target(name, model, kind, None))

    @property
    def capabilities(self) -> Capabilities:
        """What a VABus drive can be asked to do."""
        return Capabilities(
            stops=frozenset(self._stops),
            reverse=self._options.ram_datasets,
            reference_percent=self._options.ram_datasets,
            reference_hz=self._options.ram_datasets,
            stored_writes=True,
            volatile_writes=self._options.ram_datasets,
            broadcast=True,
        )

    @property
    def extra(self) -> Mapping[str, Callable[..., Exchange[Any]]]:
        """One more verb: control_word(word=) writes parameter 410 as it stands, once."""
        return {"control_word": self._motion.command}

    def read(self, parameter: str, *, type: str = "", dataset: int | None = None) -> Exchange[Reading]:
        """Read a parameter. type: uint, int, long or string. dataset: 0 to 4."""
        wanted = self._known(parameter, type) if dataset is None else target(parameter, self._model, type, dataset)
        if wanted.dataset is not None and wanted.dataset > 4:
            raise ParameterAddressError(
                f"data set {wanted.dataset} can only be written, it is the RAM side of {wanted.dataset - 5}"
            )
        self._must_be_one_drive("read")
        return self._read_target(wanted)

    def write(
        self,
        parameter: str,
        value: ParameterValue | float,
        *,
        store: bool = False,
        type: str = "",
        dataset: int | None = None,
    ) -> Exchange[None]:
        """Write a parameter. type: uint, int, long or string. dataset: 0 to 4, or 5 to 9 for their RAM side."""
        wanted = target(parameter, self._model, type, dataset)
        attempts = 1 if wanted.number == states.CONTROL_WORD else None
        dataset_sent = self._write_dataset(wanted, store=store)
        return self._talk.select(wanted.number, dataset_sent, characters_for(wanted, value), attempts=attempts)

    def address_of(self, parameter: str, *, dataset: int | None = None, **_: Any) -> str:
        """Return number and data set of a parameter; data set 0 is the one that is meant without any."""
        wanted = target(parameter, self._model, "", dataset)
        return wanted.address if wanted.dataset else str(wanted.number)

    def status(self) -> Exchange[DriveStatus]:
        """Read the state word, and the fault code if it says fault."""
        self._must_be_one_drive("status")
        return self._motion.status()

    def start(self, *, reverse: bool = False) -> Exchange[None]:
        """Walk the state machine to "operation enabled": 0006, 0007, 000F, each state awaited.

        The control word has no bit for the direction, the sign of the references says it (Agile VABus manual p. 41), so
        they get the sign of this direction first, in RAM. Raises StateError where the state machine is not in charge
        (parameter 412), or where the motor would turn the other way all the same.
        """
        self._must_be_one_drive("start")
        if reverse and not self._options.ram_datasets:
            raise NotSupported(
                "this drive has no RAM data sets, and a reversed reference would go to EEPROM; "
                "write a negative reference with store=True, and its control words with control_word",
                says="store=True",
            )
        return self._motion.start(reverse=reverse)

    def stop(self, how: Stop = Stop.RAMP) -> Exchange[None]:
        """Stop: 0007 (disable operation), 0000 (coast) or 0002 (quick stop).

        In remote contacts (parameter 412), and where the drive does not tell, 0007 and 0002 could start a motor: every
        stop is 0000 then, and how the motor runs down is up to the drive. So it is for all drives at once, who cannot
        be asked.
        """
        if how not in profile().stops:
            raise NotSupported(f"a VABus drive cannot stop by {how.value}; it can by ramp, coast and quick")
        return self._motion.stop_all() if self._address == BROADCAST else self._motion.stop(how)

    def reset(self) -> Exchange[None]:
        """Acknowledge a fault with a rising edge of bit 7; does nothing on a drive without a fault."""
        self._must_be_one_drive("reset")
        return self._motion.reset()

    def set_reference_percent(self, percent: ParameterValue | float) -> Exchange[None]:
        """Turn at a share of the maximum frequency, 0.01 % steps; the reference frequency is set to zero.

        It is written to RAM and has no sign: the motor goes on turning the way it was started. What the drive makes of
        it is read back, with StateError when that is another frequency.
        """
        self._must_be_one_drive("set_reference")
        return self._references.set_percent(percent)

    def set_reference_hz(self, hz: ParameterValue | float) -> Exchange[None]:
        """Turn at a frequency, 0.01 Hz steps; the reference percentage is set to zero. Else as by a percentage."""
        self._must_be_one_drive("set_reference")
        return self._references.set_hz(hz)

    def probe(self) -> Exchange[None]:
        """Ask for the state word once; a NAK proves a drive as well as a value does."""
        self._must_be_one_drive("probe")
        return self._talk.probe(states.STATE_WORD)

    def identify(self) -> Exchange[Mapping[str, str]]:
        """Read the state; no manual that was read names a parameter with the drive's type."""
        self._must_be_one_drive("identify")
        return self._identify()

    # Conversations

    def _read_target(self, wanted: Target) -> Exchange[Reading]:
        reply = yield from self._talk.enquire(wanted.number, wanted.dataset or 0, wanted.address)
        return reading_of(wanted, reply.data, lower_case_hex=self._options.lower_case_hex)

    def _identify(self) -> Exchange[Mapping[str, str]]:
        try:
            words = yield from self._motion.look()
        except RefusedError:
            return {}
        state = profile().state_of(words)
        return {"state": state.name if state else f"0x{words[profiles.ONLY]:04X}"}

    def _write_dataset(self, wanted: Target, *, store: bool) -> int:
        dataset = wanted.dataset or 0
        if dataset > 4:
            if store:
                raise UsageError(f"data set {dataset} is in RAM; to store, write data set {dataset - 5}")
            return dataset
        if store or wanted.number == states.CONTROL_WORD:
            return dataset
        if not self._options.ram_datasets:
            raise NotSupported(
                f"this drive keeps every write in EEPROM, so {wanted.address} is only written with store=True",
                says="store=True",
            )
        return dataset + 5

    @property
    def _stops(self) -> Collection[Stop]:
        return (Stop.COAST,) if self._address == BROADCAST else tuple(profile().stops)

    def _must_be_one_drive(self, verb: str) -> None:
        if self._address == BROADCAST:
            raise NotSupported(f"{verb} needs an answer, and nobody answers a broadcast")
