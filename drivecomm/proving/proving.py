"""Sequence of a proof: its requests in order, and the findings so far.

Nothing here writes or commands: the drive must be a read-only one, whose bus refuses both before anything is sent.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from drivecomm.errors import DriveCommError, UsageError
from drivecomm.protocol import DESCRIBE, installed, resolve_options
from drivecomm.proving.findings import ProofFinding
from drivecomm.proving.identity import identity_findings, public_part, reported_identity, series_findings
from drivecomm.proving.link_loss import link_loss_findings
from drivecomm.proving.name_plate import broken_rules, scale_shown
from drivecomm.proving.parameters import (
    ParameterAnswers,
    asked_addresses,
    model_facts,
    parameter_finding,
    plate_of,
    why_not_asked,
)
from drivecomm.proving.patient_reader import PatientReader
from drivecomm.proving.refusals import absent_codes, provocations, refusal_finding
from drivecomm.proving.timing import timing_findings

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence
    from decimal import Decimal

    from drivecomm.bus import Drive
    from drivecomm.protocol import Model, ParameterInfo, Protocol
    from drivecomm.proving.findings import Verdict


@dataclass(frozen=True, slots=True, kw_only=True)
class ProofSubject:
    """Subject of a proof.

    options: the drive's options for the protocol; the model's if none are given.
    """

    plugin: Protocol
    model: Model
    options: Any

    @classmethod
    def of(cls, protocol: str, model: Model | None, given: Mapping[str, Any]) -> ProofSubject:
        """Return the subject of a drive with these options. Raises UsageError if it has no model."""
        if model is None:
            raise UsageError("a proof compares a drive with its model; name one, such as with --model")
        plugin = installed[protocol]
        return cls(plugin=plugin, model=model, options=resolve_options(plugin, model, given)[1])

    def describes(self) -> bool:
        """Return whether drives of this protocol describe their parameters."""
        return DESCRIBE in self.plugin.operations(self.plugin.addresses[0], self.options, self.model).extra

    def addresses(self, info: ParameterInfo) -> Sequence[str]:
        """Return the element addresses of a parameter to read."""
        return asked_addresses(self.plugin.element_addresses(info, self.options))

    def common_names(self) -> dict[str, str]:
        """Return the common names by the address of their parameter."""
        return {address.partition("[")[0]: name for name, address in self.model.quantities.items()}


def _unseen(_detail: str, _done: int, _total: int) -> None:
    """Ignore the progress."""


@dataclass(slots=True)
class Proving:
    """A proof in progress.

    findings: findings so far. identity: the drive's own identity, without private data. at: the present request, in
    words; empty when all requests are done.
    """

    drive: Drive
    subject: ProofSubject
    with_names: bool = False
    progress: Callable[[str, int, int], None] = _unseen
    on_section: Callable[[], object] = lambda: None
    findings: list[ProofFinding] = field(default_factory=list)
    identity: dict[str, str] = field(default_factory=dict)
    at: str = "the first question"
    _told: dict[str, ParameterAnswers] = field(default_factory=dict)
    _stands: bool = False
    _answers_all: bool = False

    def run(self) -> None:
        """Send all requests. Raises NoReplyError for a drive that stays silent, and LinkError for a lost line.

        The findings so far are in `findings` then, and `at` names the request that failed.
        """
        if not self.drive.read_only_reason:
            raise UsageError(
                "a proof needs a read-only drive, so that nothing can be written; open it with read_only=True",
                says="read_only=True",
            )
        asker = PatientReader(self.drive)
        self._identity(asker)
        self._refusals(asker)
        self._parameters(asker)
        self.at = "the link-loss settings"
        self._add(link_loss_findings(asker, self.drive, self.subject.model, self._told))
        self._timing()
        self.at = ""
        self.on_section()

    def counts(self) -> Counter[Verdict]:
        """Return the number of findings by verdict."""
        return Counter(each.verdict for each in self.findings)

    def _add(self, findings: Iterable[ProofFinding]) -> None:
        self.findings += findings
        self.on_section()

    def _identity(self, asker: PatientReader) -> None:
        subject, self.at = self.subject, "its status and identity"
        status = asker.answer(self.drive.status)
        self._stands = not isinstance(status, DriveCommError) and not status.running
        told = reported_identity(asker, self.drive)
        self.identity = public_part(told, subject.model, with_names=self.with_names)
        self._add(identity_findings(told, subject.model, subject.plugin))
        self._add(series_findings(asker, self.drive, subject.model, subject.plugin, subject.options))

    def _refusals(self, asker: PatientReader) -> None:
        subject, found, told = self.subject, [], 0
        asked = provocations(subject.plugin, subject.model, subject.options)
        absent = absent_codes(subject.plugin, subject.model, subject.options)
        for done, each in enumerate(asked):
            self.at = f"the refusal of {each.address}"
            self.progress(f"to refuse {each.address}", done, len(asked))
            answer = asker.answer(lambda each=each: self.drive.read(each.address))  # type: ignore[misc]
            found.append(refusal_finding(each, answer, absent, self._told))
            told += not each.of and not isinstance(answer, DriveCommError)
        self._answers_all = told > 0 and told == sum(not each.of for each in asked)
        if not asked:
            why = f"the package {subject.plugin.package} does not list the addresses that drives refuse, and how"
            found.append(ProofFinding(kind="refusal", verdict="not asked", about="codes of refusals", why=why))
        self._add(found)

    def _parameters(self, asker: PatientReader) -> None:
        asked = [info for info in self.subject.model.parameters.values() if not why_not_asked(info)]
        self._add(
            _not_asked(info, why) for info in self.subject.model.parameters.values() if (why := why_not_asked(info))
        )
        try:
            for done, info in enumerate(asked):
                self.at = f"parameter {info.address}"
                self.progress(self.at, done, len(asked))
                self._told[info.address] = self._answers(asker, info)
        finally:
            # The proof includes all answers received before an interruption.
            self._hold_against_each_other()

    def _answers(self, asker: PatientReader, info: ParameterInfo) -> ParameterAnswers:
        told = ParameterAnswers(info=info, common=self.subject.common_names().get(info.address, ""))
        for address in self.subject.addresses(info):
            told.readings[address] = asker.answer(lambda address=address: self.drive.read(address))  # type: ignore[misc]
        if self.subject.describes() and not all(isinstance(each, DriveCommError) for each in told.readings.values()):
            told.described = asker.answer(lambda: self.drive.call(DESCRIBE, parameter=info.address, option_texts=0))
        return told

    def _hold_against_each_other(self) -> None:
        quantities, parameters = self.subject.model.quantities, self.subject.model.parameters
        plate = plate_of(self._told, quantities)
        own_address = int(self.drive.peer.name.rpartition(":")[2])
        self._add(self._judged(plate))
        for each in broken_rules(plate, stands=self._stands, address=own_address):
            places = tuple(quantities[name].partition("[")[0] for name in each.names)
            self._add(
                [
                    ProofFinding(
                        kind="name plate",
                        verdict="contradicts",
                        about=" and ".join(each.names),
                        addresses=places,
                        model={place: model_facts(parameters[place]) for place in places if place in parameters},
                        why=each.text,
                    )
                ]
            )

    def _judged(self, plate: Mapping[str, Decimal]) -> Iterable[ProofFinding]:
        names = self.subject.common_names()
        for address, told in self._told.items():
            name = names.get(address, "")
            scale = bool(name) and scale_shown(name, plate, stands=self._stands)
            yield parameter_finding(told, scale=scale, answers_all=self._answers_all, with_names=self.with_names)

    def _timing(self) -> None:
        self.at = "its reply times"
        if not self._stands:
            why = "the motor may run, and measuring feeds no watchdog"
            self._add([ProofFinding(kind="timing", verdict="not asked", about="reply times", why=why)])
            return
        self._add(timing_findings(self.drive, self.progress))


def _not_asked(info: ParameterInfo, why: str) -> ProofFinding:
    return ProofFinding(
        kind="parameter",
        verdict="not asked",
        about=f"parameter {info.address}",
        addresses=(info.address,),
        model=model_facts(info),
        why=why,
    )


def questions(subject: ProofSubject) -> list[str]:
    """Return the requests of a proof without --move, in words; nothing is sent."""
    asked = ["status", "identity: what the drive reports of itself"]
    asked += [
        f"read {each.address}, to be refused" for each in provocations(subject.plugin, subject.model, subject.options)
    ]
    describes = subject.describes()
    for info in subject.model.parameters.values():
        if not why_not_asked(info):
            addresses = " and ".join(subject.addresses(info))
            asked.append(
                f"read {addresses} {info.title}" + (", and how the drive identifies itself" if describes else "")
            )
    if subject.model.watchdog is not None:
        asked.append("read the link-loss settings")
    asked.append("reply times: some hundred probes with shorter and shorter pauses")
    return asked
