"""Findings of a diagnosis for the person at the adapter: one sentence each, with a remedy."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Literal, TypeAlias

from drivecomm.commissioning.doctor.panel_findings import panel_findings

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from drivecomm.commissioning.doctor.measurements import Measurements, NoiseRecord, Replies, SearchedDrive
    from drivecomm.commissioning.doctor.panel_findings import Weight
    from drivecomm.transport import PortReport

_About: TypeAlias = Literal["port", "noise", "echo", "drives", "panel", "time"]
_Found: TypeAlias = "tuple[Weight, str, str]"
"""Weight, text and remedy of one finding."""

# Beyond this share of the reply timeout, a slow reply soon becomes a timeout.
_CLOSE_TO_TIMEOUT = 0.7
_SHOWN_BYTES = 12
_BIAS = "check the bias (fail-safe) resistors, and whether a transmitter is switched on late or off early"
_LOW_LATENCY = (
    "let drivecomm set low-latency mode (--low-latency says why it cannot); "
    "on Windows set the latency timer in the port's advanced settings to 1 ms"
)


@dataclass(frozen=True, slots=True, kw_only=True)
class DoctorFinding:
    """One finding of a diagnosis. weight: whether action is needed. remedy: the action, empty if none is needed."""

    weight: Weight
    about: _About
    text: str
    remedy: str = ""


def judge(measurements: Measurements, report: PortReport | None) -> list[DoctorFinding]:
    """Return the findings, in the best order to work through them. report: None if nothing is known of the port."""
    found: dict[_About, Iterator[_Found]] = {
        "port": _port(report, measurements),
        "noise": _noise(measurements),
        "echo": _echo(measurements),
        "drives": _drives(measurements),
        "panel": panel_findings(measurements.panel, carries_settings=measurements.carries_settings),
        "time": _times(measurements, report),
    }
    return [
        DoctorFinding(weight=weight, about=about, text=text, remedy=remedy)
        for about, several in found.items()
        for weight, text, remedy in several
    ]


def _port(report: PortReport | None, measurements: Measurements) -> Iterator[_Found]:
    if report is None:
        yield "note", "only the measurements of this port are known", ""
        return
    if report.kind != "serial port":
        unknown = "what adapter there is, its latency and the direction of its transmitter cannot be known from here"
        remedy = "run this on the machine that has the adapter" if report.kind in ("raw TCP", "RFC 2217") else ""
        yield "note", f"{report.url} is {_a(report.kind)}: {unknown}", remedy
        if report.kind == "raw TCP":
            text = "the server sets the line settings, so those given here have no effect"
            yield "note", text, "set them at the server, or use rfc2217:// if it can"
        return
    parts = [f"{report.url} is a serial port"]
    parts += [f"driver {report.driver}"] if report.driver else []
    parts += [f"USB {report.usb}"] if report.usb else []
    parts += [f"RS-485 direction control {report.rs485}"]
    yield "fine", ", ".join(parts), ""
    timer = report.latency_timer_ms
    if timer is not None and timer > 1:
        text = f"the adapter holds received bytes back for up to {timer} ms"
        yield "problem", text, _LOW_LATENCY
    elif report.low_latency == "on":
        yield "fine", "low-latency mode is on", ""
    elif report.usb is not None:
        text = "whether the adapter holds received bytes back does not show; see the reply times"
        yield "note", text, ""
    for note in report.notes:
        # The latency timer is reported above, with its remedy.
        if "low-latency" not in note:
            yield "note", note, ""
    if measurements.replies and report.stable_name != report.url:
        text = f"after it was unplugged it is opened again as {report.stable_name}"
        yield "fine", text, ""


def _noise(measurements: Measurements) -> Iterator[_Found]:
    heard = [one for one in measurements.noise if one.data]
    if not heard:
        seconds = sum(one.seconds for one in measurements.noise)
        yield "fine", f"the line is quiet: no bytes came unrequested in {seconds:g} s", ""
    for one in heard:
        text = f"{_bytes(len(one.data))} came unrequested in {one.seconds:g} s at {one.settings}: {_hex(one.data)}"
        what, remedy = _source_of(one)
        yield "problem", text + what, remedy


def _source_of(heard: NoiseRecord) -> tuple[str, str]:
    if heard.telegrams:
        who = " and ".join(heard.telegrams)
        return f"; there are sound telegrams of {who} among them", "stop the other master: a line has room for one only"
    if not any(heard.data):
        remedy = "check whether the two signal wires are swapped, and the bias and termination of the line"
        return "; zeros only, as from a line that is held at the wrong level", remedy
    remedy = "check the 0 V connection, termination and bias, and whether another master speaks at other line settings"
    return "", remedy


def _echo(measurements: Measurements) -> Iterator[_Found]:
    trials, said = measurements.echo, measurements.echo_said
    if not trials:
        return
    kinds = [trial.kind for trial in trials]
    if "whole" in kinds:
        text = "the adapter echoes what it sends"
        if kinds.count("whole") < len(kinds):
            text += f", though not always whole ({kinds.count('whole')} of {len(kinds)} times)"
        if said == "off":
            remedy = 'use --echo expect, in a program echo="expect"; or switch the echo off at the adapter'
            yield "problem", text, remedy
        else:
            yield "fine", f"{text}, as --echo {said} says", ""
    elif "changed" in kinds:
        trial = trials[kinds.index("changed")]
        text = (
            f"{trial.sent.hex(' ').upper()} came back as {trial.came[:_SHOWN_BYTES].hex(' ').upper()}: "
            "noise, or an echo that is disturbed while it is sent"
        )
        remedy = "if the line is quiet otherwise, use --echo expect, and check whether two transmitters are on at once"
        yield "problem", text, remedy
    elif said == "expect":
        text = "the adapter does not echo, although --echo expect is given"
        yield "note", text, "leave --echo out"
    else:
        yield "fine", "the adapter does not echo what it sends", ""


def _drives(measurements: Measurements) -> Iterator[_Found]:
    for each in measurements.sought:
        yield _expected(each)
    for one in measurements.found:
        if one.sound:
            told = ", ".join(f"{name} {value}" for name, value in one.identity.items())
            text = f"{one.name} answers at {measurements.asked[one.protocol]}" + (f": {told}" if told else "")
            if measurements.sought:
                text += "; it is not in the plant file"
            yield "note" if measurements.sought else "fine", text, ""
        else:
            text = f"{one.name} answers, but damaged: {one.detail}"
            remedy = "check baud rate and parity, termination, and whether two drives have the same address"
            yield "problem", text, remedy
    for found, settings in measurements.elsewhere:
        if settings == measurements.asked[found.protocol]:
            yield "problem", f"{found.name} answers at {settings}, but late", "give it more time with --timeout 3"
            continue
        text = f"{found.name} answers at {settings}, not at {measurements.asked[found.protocol]}"
        remedy = (
            f"use --baudrate {settings.baudrate}, or set the drive to {measurements.asked[found.protocol].baudrate}"
        )
        yield "problem", text, remedy
    if measurements.unclear_bytes:
        text = f"{_bytes(measurements.unclear_bytes)} came while drives were polled, and were not part of a reply"
        remedy = "check baud rate and parity of the drives, and look at the bytes with --trace"
        yield "problem", text, remedy
    if measurements.found or measurements.elsewhere or measurements.sought:
        return
    at = ", ".join(f"{name} at {settings}" for name, settings in measurements.asked.items())
    remedy = (
        "check that the drives have power, their address, protocol and baud rate (--baudrate, --parity), "
        "and whether the two signal wires are swapped"
    )
    yield "problem", f"no drive answers at {measurements.addresses} addresses ({at})", remedy


def _expected(sought: SearchedDrive) -> _Found:
    if not sought.error:
        return "fine", f"{sought.drive.full_name} answers at {sought.settings}", ""
    if sought.elsewhere is not None:
        rates = sought.elsewhere.baudrate, sought.settings.baudrate
        text = f"{sought.drive.full_name} answers at {sought.elsewhere}, not at {sought.settings}"
        remedy = f"write baudrate = {rates[0]} in its options in the plant file, or set the drive to {rates[1]}"
        return "problem", text, remedy
    name, settings = sought.drive.full_name, sought.settings
    if sought.needs:
        return "problem", f"{name} answers at {settings} only {_with(sought.needs)}", _option(sought.needs)
    if sought.answered_by is not None and sought.answered_by != sought.drive.address:
        text = f"{name} does not answer at {settings}, but the drive of address {sought.answered_by} does in its place"
        return "problem", text, f"use address {sought.answered_by}, or set the drive to {sought.drive.address}"
    remedy = (
        "check its power supply and wiring, and whether its address, protocol and line settings match "
        "the plant file; drivecomm scan --wide finds it at others"
    )
    came = f" (received: {_hex(sought.came[0])})" if sought.came else ""
    return "problem", f"{name} does not answer at {settings}: {sought.error}{came}", remedy


def _with(needs: Mapping[str, float]) -> str:
    if "turnaround_s" in needs:
        return f"with a pause of {needs['turnaround_s'] * 1000:g} ms before each request"
    return f"with a reply time-out of {needs['reply_timeout_s']:g} s"


def _option(needs: Mapping[str, float]) -> str:
    return f"write {', '.join(f'{name} = {value:g}' for name, value in needs.items())} in its options"


def _times(measurements: Measurements, report: PortReport | None) -> Iterator[_Found]:
    for one in measurements.replies:
        lost = one.asked - len(one.times_s)
        if lost and one.needs:
            text = f"{one.drive} answered {len(one.times_s)} of {one.asked} times, and always {_with(one.needs)}"
            yield "problem", text, _option(one.needs)
        elif one.damaged:
            yield _damaged(one)
        elif lost:
            text = f"{one.drive} answered {len(one.times_s)} of {one.asked} times"
            remedy = "check termination, screen and the 0 V connection, or give it more time with --timeout"
            yield "problem", text, remedy
        if 2 * len(one.noise) >= one.asked:
            usual = Counter(one.noise).most_common(1)[0][0]
            text = f"{_bytes(len(usual))} of noise ({_hex(usual)}) with nearly every reply of {one.drive}"
            yield "problem", text, _BIAS
        if one.times_s:
            yield "fine", _reply_time(one, paced=measurements.paced), ""
            yield from _too_slow(one)
            yield from _latency_timer(one, report)


def _damaged(one: Replies) -> _Found:
    text = f"{len(one.damaged)} of {one.asked} replies of {one.drive} were damaged, such as {_hex(one.damaged[0])}"
    if one.damage is None:
        return "problem", text, "check termination, screen and the 0 V connection"
    return "problem", f"{text}; probably {one.damage.cause}", one.damage.remedy


def _hex(data: bytes) -> str:
    return data[:_SHOWN_BYTES].hex(" ").upper() + (" ..." if len(data) > _SHOWN_BYTES else "")


def _reply_time(one: Replies, *, paced: bool) -> str:
    ordered = sorted(one.times_s)
    shortest, middle, longest = (f"{time * 1000:.1f}" for time in (ordered[0], ordered[len(ordered) // 2], ordered[-1]))
    text = f"{one.drive} is done {shortest} to {longest} ms after a request begins (median {middle} ms)"
    wire, delay = min(one.wire_s) * 1000, min(one.delays_s) * 1000
    if delay > 0:
        return f"{text}; {wire:.1f} ms are the characters, so drive and adapter take {delay:.1f} ms at least"
    where = "at the adapter" if paced else "here"
    return f"{text}; the characters alone would take {wire:.1f} ms on a line, so they take no time {where}"


def _too_slow(one: Replies) -> Iterator[_Found]:
    slowest = max(one.delays_s)
    if slowest > _CLOSE_TO_TIMEOUT * one.reply_timeout_s:
        text = f"{one.drive} takes up to {slowest * 1000:.0f} ms of the {one.reply_timeout_s * 1000:.0f} ms it is given"
        remedy = f"give it more: --timeout {2 * slowest:.2g}"
        yield "note", text, remedy


def _latency_timer(one: Replies, report: PortReport | None) -> Iterator[_Found]:
    step = latency_timer_s(one.arrivals_s)
    if step is None:
        return
    text = f"replies of {one.drive} come in steps of {step * 1000:.0f} ms, as from an adapter with a latency timer"
    remote = report is not None and report.kind in ("raw TCP", "RFC 2217")
    remedy = "set the latency timer of the server's adapter to 1 ms" if remote else _LOW_LATENCY
    yield "problem", text, remedy


def _bytes(number: int) -> str:
    return f"{number} byte{'' if number == 1 else 's'}"


def _a(kind: str) -> str:
    return {
        "raw TCP": "a raw TCP connection",
        "RFC 2217": "an RFC 2217 connection",
        "other": "no port of this machine",
    }.get(kind, f"a {kind}")


_LEAST_INTERVALS = 7
_OFF_TICK_S = 0.0008
_USUAL_TIMERS_S = (0.016, 0.008)


def latency_timer_s(arrivals_s: Sequence[float]) -> float | None:
    """Return the period in seconds of the latency timer at whose ticks replies came, or None if they fit no timer.

    A USB adapter with such a timer hands over received bytes only at its ticks. The requests must have been sent at
    uneven intervals.
    """
    intervals = [later - earlier for earlier, later in pairwise(arrivals_s)]
    if len(intervals) < _LEAST_INTERVALS:
        return None
    for timer in _USUAL_TIMERS_S:
        off = sum(abs(interval - round(interval / timer) * timer) > _OFF_TICK_S for interval in intervals)
        if off <= len(intervals) // 10:
            return timer
    return None
