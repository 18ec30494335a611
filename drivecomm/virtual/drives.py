"""Making virtual drives of any installed protocol, and speaking to them directly, without a line."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, TypeVar

from drivecomm.errors import DriveCommError, NoReplyError, UsageError
from drivecomm.models import held_codes, load_model, setup_sheet
from drivecomm.protocol import (
    LINE_FACT_NAMES,
    Ask,
    Framed,
    Refusal,
    Tell,
    answered,
    checked_address,
    installed,
    resolve_options,
)
from drivecomm.virtual.line_rules import SET_HERE, LineRules

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from drivecomm.protocol import Codec, Exchange, LineFacts, Message, Model, Protocol, VirtualDrive


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveType:
    """All that a virtual drive is made from. options: of its protocol. facts: of its line, as the drive keeps to them.

    master_facts: the same for its master, who may be more patient. sources: where a number among these stands that is
    demanded of a master, by the name of the fact; it may be set for this drive.
    """

    plugin: Protocol
    address: int
    model: Model
    options: Any
    facts: LineFacts
    master_facts: LineFacts
    sources: Mapping[str, str]

    def rules(self, name: str, *, drive: VirtualDrive | None = None, needs_pause_s: float = 0.0) -> LineRules:
        """Return what a master has to keep to with such a drive. drive: one whose line settings may change."""
        return LineRules(
            name=name,
            address=self.address,
            plugin=self.plugin,
            codec=self.plugin.codec(self.options),
            facts=self.master_facts,
            silence_characters=self.plugin.silence_characters,
            sources=self.sources,
            needs_pause_s=needs_pause_s,
            settings_now=None if drive is None else lambda: drive.settings,
        )

    def new(self, facts: LineFacts | None = None) -> VirtualDrive:
        """Return a drive in its factory state, set up at its panel for these line facts; None for those of this type.

        Raises UsageError for a model of too little.
        """
        facts = facts or self.facts
        try:
            drive = self.plugin.virtual(self.address, self.options, self.model)
        except Refusal as refusal:
            # It was looked for at the start, by the drive itself.
            raise UsageError(
                f"no virtual drive can be made of model {self.model.name}: it lacks parameters that a drive works "
                f"with; take over a model that has them, such as extends = {self.plugin.default_model!r}"
            ) from refusal
        drive.settings = facts.settings
        drive.gap_s = facts.gap_s
        self._set_up(drive)
        return drive

    def _set_up(self, drive: VirtualDrive) -> None:
        """Let the parameters of the line hold what the panel of such a drive would show."""
        for row in setup_sheet(self.model, drive.settings, address=self.address):
            if row.setting.made_from is not None and (held := held_codes(row, self.model)):
                # A drive keeps its start value of what its protocol's store cannot hold.
                with suppress(DriveCommError, ValueError):
                    drive.poke(row.setting.address, held[0])

    @property
    def factory_facts(self) -> LineFacts:
        """The line facts that its protocol and its model give it."""
        return resolve_options(_of_drives(self.plugin), self.model, {})[0]


def _of_drives(plugin: Protocol) -> Protocol:
    """Return a protocol with the line facts of its drives: they may begin anew sooner than a master gives up."""
    if not plugin.silence_characters:
        return plugin
    timing = replace(plugin.facts.timing, gap_s=0.0, gap_characters=plugin.silence_characters)
    return replace(plugin, facts=replace(plugin.facts, timing=timing))


def drive_type(
    protocol: str,
    address: int,
    *,
    model: str | Path | Model | None = None,
    options: Mapping[str, Any],
    for_all: Mapping[str, Any] | None = None,
) -> DriveType:
    """Return the type of a drive with the options of `virtual_drive`, which go before those for all drives of its line.

    Raises UsageError for anything that cannot be.
    """
    plugin = installed[protocol]
    known = load_model(plugin.package, protocol, model or plugin.default_model)
    facts, chosen = resolve_options(_of_drives(plugin), known, options, for_all=for_all)
    own = checked_address(plugin, address, chosen)
    master_facts, _ = resolve_options(plugin, known, options, for_all=for_all)
    set_here = [name for name, value in {**(for_all or {}), **options}.items() if value is not None]
    sources = {name: source for name, source in plugin.line_sources.items() if name not in known.options}
    return DriveType(
        plugin=plugin,
        address=own,
        model=known,
        options=chosen,
        facts=facts,
        master_facts=master_facts,
        sources=sources | dict.fromkeys(LINE_FACT_NAMES.intersection(set_here), SET_HERE),
    )


T = TypeVar("T")


def carry_out(exchange: Exchange[T], drive: VirtualDrive, codec: Codec, now: float) -> T:
    """Carry out an exchange with a drive itself, on no line. Raises what the exchange raises; NoReplyError for silence.

    codec: the master's, for the drive's options.
    """

    def answer(command: Ask | Tell) -> Message | None:
        reply = answer_to(command.message, drive, codec, now)
        if isinstance(command, Ask) and reply is None:
            raise NoReplyError(f"the virtual drive at address {drive.address} does not answer")
        return reply

    return answered(exchange, answer)


def answer_to(request: Message, drive: VirtualDrive, codec: Codec, now: float) -> Message | None:
    """Return what a drive answers to a request, None for silence."""
    data = codec.encode(request)
    reply = drive.hear(Framed(data, drive.codec.decode(data, "request")), now)
    return None if reply is None else codec.decode(reply.data, "reply")
