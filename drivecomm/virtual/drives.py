"""Virtual drives of any installed protocol, and exchanges with a drive directly, without a line."""

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
    checked_address,
    installed,
    resolve_options,
    run_with_answers,
)
from drivecomm.virtual.line_rules import SET_HERE, LineRules

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from drivecomm.protocol import Codec, Exchange, LineFacts, Message, Model, Protocol, VirtualDrive


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveType:
    """The data from which a virtual drive is made.

    options: options of its protocol. facts: line facts of the drive. master_facts: line facts of its master, which may
    allow longer pauses. sources: by the name of a fact, the source that demands its value from a master, or a remark
    that it was set for this drive.
    """

    plugin: Protocol
    address: int
    model: Model
    options: Any
    facts: LineFacts
    master_facts: LineFacts
    sources: Mapping[str, str]

    def rules(self, name: str, *, drive: VirtualDrive | None = None, needs_pause_s: float = 0.0) -> LineRules:
        """Return the rules that a master must keep with such a drive. drive: one whose line settings may change."""
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
        """Return a drive in its factory state, with these line facts set at its panel; None for the facts of this type.

        Raises UsageError if the model lacks parameters that the drive needs.
        """
        facts = facts or self.facts
        try:
            drive = self.plugin.virtual(self.address, self.options, self.model)
        except Refusal as refusal:
            # The drive itself looks up these parameters when it is made.
            raise UsageError(
                f"no virtual drive can be made of model {self.model.name}: it lacks parameters that a drive works "
                f"with; extend a model that has them, such as extends = {self.plugin.default_model!r}"
            ) from refusal
        drive.settings = facts.settings
        drive.gap_s = facts.gap_s
        self._set_up(drive)
        return drive

    def _set_up(self, drive: VirtualDrive) -> None:
        """Set the parameters of the line to the values that the panel of such a drive would show."""
        for row in setup_sheet(self.model, drive.settings, address=self.address):
            if row.setting.made_from is not None and (held := held_codes(row, self.model)):
                # If the protocol's store cannot hold the value, the parameter keeps its start value.
                with suppress(DriveCommError, ValueError):
                    drive.poke(row.setting.address, held[0])

    @property
    def factory_facts(self) -> LineFacts:
        """The line facts that the protocol and the model define."""
        return resolve_options(_of_drives(self.plugin), self.model, {})[0]


def _of_drives(plugin: Protocol) -> Protocol:
    """Return a protocol with the line facts of its drives, which end a telegram after a shorter gap than a master."""
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
    """Return the type of a drive with the options of `virtual_drive`; they override those for all drives of its line.

    Raises UsageError for invalid arguments.
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
    """Carry out an exchange with a drive itself, without a line.

    codec: the master's codec, for the drive's options. Raises the errors of the exchange, and NoReplyError if the drive
    does not answer.
    """

    def answer(command: Ask | Tell) -> Message | None:
        reply = answer_to(command.message, drive, codec, now)
        if isinstance(command, Ask) and reply is None:
            raise NoReplyError(f"the virtual drive at address {drive.address} does not answer")
        return reply

    return run_with_answers(exchange, answer)


def answer_to(request: Message, drive: VirtualDrive, codec: Codec, now: float) -> Message | None:
    """Return the answer of a drive to a request; None for silence."""
    data = codec.encode(request)
    reply = drive.hear(Framed(data, drive.codec.decode(data, "request")), now)
    return None if reply is None else codec.decode(reply.data, "reply")
