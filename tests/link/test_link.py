"""The link alone, carried out by hand: it yields effects, and the test provides the time and the bytes received."""

from collections import Counter

import pytest

from drivecomm.errors import (
    CommandTooOldError,
    DamagedReplyError,
    NoReplyError,
    RefusedError,
    ReplyError,
    TelegramError,
)
from drivecomm.link import Arrival, Configure, HeldBack, Link, Peer, Receive, Send, Wait, taken_apart
from drivecomm.protocol import Ask, LineFacts, LineSettings, Pause, Tell, Timing
from drivecomm_vabus.telegrams import Ack, Enquiry, Eot, Select, Value, mismatch, telegrams

CODEC = telegrams()
SETTINGS = LineSettings(baudrate=10000, bytesize=8)
CHARACTER_S = 0.001
TIMING = Timing(reply_timeout_s=0.1, gap_s=0.02, turnaround_s=0.002, broadcast_pause_s=0.05, late_s=1.0, attempts=3)
ENQUIRY = Enquiry(address=1, parameter=481)
ASKED = CODEC.encode(ENQUIRY)
ANSWER = Value(address=1, parameter=481, data="000003E8")
ANSWERED = CODEC.encode(ANSWER)
OTHER = CODEC.encode(Value(address=1, parameter=482, data="000003E8"))
SELECT = Select(address=1, dataset=5, parameter=480, data="00000001")
SELECTED = CODEC.encode(SELECT)
ACK = b"\x41\x06"


def peer(name="vabus:1", settings=SETTINGS, timing=TIMING):
    return Peer(name=name, codec=CODEC, facts=LineFacts(settings=settings, timing=timing), mismatch=mismatch)


def ask(message=ENQUIRY, **options):
    return (yield Ask(message=message, **options))


class Walk:
    """A runner with a manual clock: `arrivals` lists the bytes that arrive and their times."""

    def __init__(self, begin, exchange, arrivals=(), start=0.0, note=""):
        self.time = start
        self.begin = begin
        self.steps = taken_apart(begin(exchange, start), start)
        self.arrivals = sorted(arrivals)
        self.sent = []
        self.configured = []
        self.configured_at = []
        self.waits = []
        self.receives = []
        self.note = note

    def run(self):
        try:
            effect = next(self.steps)
            while True:
                effect = self.steps.send(self.carry_out(effect))
        except StopIteration as finished:
            return finished.value
        except HeldBack as held:
            self.time = held.until
            self.steps = taken_apart(self.begin(held.exchange, self.time), self.time)
            return self.run()

    def carry_out(self, effect):
        data = b""
        if isinstance(effect, Receive):
            self.receives.append((round(effect.until, 6), effect.at_least))
            data = self.receive(effect)
        elif isinstance(effect, Send):
            self.sent.append((round(self.time, 6), effect.data))
        elif isinstance(effect, Configure):
            self.configured.append(effect.settings)
            self.configured_at.append(round(self.time, 6))
            return Arrival(self.time, b"", self.note)
        else:
            assert isinstance(effect, Wait)
            self.waits.append(round(effect.until, 6))
            self.time = max(self.time, effect.until)
        return Arrival(self.time, data)

    def receive(self, effect):
        came = b""
        while self.arrivals and self.arrivals[0][0] <= effect.until and len(came) < effect.at_least:
            time, data = self.arrivals.pop(0)
            self.time = max(self.time, time)
            came += data
        if len(came) < effect.at_least:
            self.time = max(self.time, effect.until)
        return came


def walk(exchange, arrivals=(), *, link=None, who=None, **options):
    link = link or Link()
    return Walk(lambda rest, now: link.run(who or peer(), rest, now), exchange, arrivals, **options)


def cut_off(steps, kind, time=0.0):
    """Run up to the first effect of this kind, carry it out unless it is Configure, and close the steps there."""
    effect = next(steps)
    while not isinstance(effect, kind):
        effect = steps.send(Arrival(time))
    if kind is not Configure:
        steps.send(Arrival(time))
    steps.close()


@pytest.fixture
def events():
    return []


@pytest.fixture
def link(events):
    return Link(trace=events.append)


def test_request_gets_its_reply(link, events):
    walked = walk(ask(), [(0.030, ANSWERED)], link=link)
    assert walked.run() == ANSWER
    assert walked.configured == [SETTINGS]
    assert walked.sent == [(0.0, ASKED)]
    assert link.counters == {"vabus:1": Counter(requests=1, replies=1)}
    assert [(event.what, event.data, event.drive) for event in events] == [
        ("sent", ASKED, "vabus:1"),
        ("received", ANSWERED, "vabus:1"),
    ]
    assert events[1].message == ANSWER
    assert events[1].time == 0.030


def test_reply_in_pieces_waits_only_for_the_gap(link):
    walked = walk(ask(), [(0.030, ANSWERED[:5]), (0.045, ANSWERED[5:9]), (0.060, ANSWERED[9:])], link=link)
    assert walked.run() == ANSWER
    assert len(walked.sent) == 1
    # The first wait is the reply timeout, after the characters of the request and of a reply of the same length.
    reply_waits = walked.receives[1:]
    assert reply_waits[0] == (0.116, 2)
    # Nine characters of the value are known to be needed, so the port does not wake up for fewer.
    assert reply_waits[1][1] == 4
    assert reply_waits[1][0] == pytest.approx(0.030 + 4 * CHARACTER_S + 0.02)


def test_next_request_waits_for_the_turnaround():
    link = Link()
    walk(ask(), [(0.030, ANSWERED)], link=link).run()
    walked = walk(ask(), [(0.060, ANSWERED)], link=link, start=0.030)
    assert walked.run() == ANSWER
    assert walked.sent == [(0.032, ASKED)]
    assert walked.configured == []


def test_turnaround_that_has_passed_is_not_waited_for():
    link = Link()
    walk(ask(), [(0.030, ANSWERED)], link=link).run()
    walked = walk(ask(), [(0.560, ANSWERED)], link=link, start=0.5)
    walked.run()
    assert walked.sent == [(0.5, ASKED)]


def test_unanswered_request_is_sent_three_times(link):
    walked = walk(ask(), link=link)
    with pytest.raises(NoReplyError, match=r"vabus:1 did not answer within 100 ms \(asked 3 times\)$") as caught:
        walked.run()
    assert isinstance(caught.value, TimeoutError)
    assert [data for _, data in walked.sent] == [ASKED] * 3
    assert link.counters["vabus:1"] == Counter(requests=1, retries=2, timeouts=3)


def test_request_with_one_attempt_is_sent_once():
    walked = walk(ask(attempts=1))
    with pytest.raises(NoReplyError, match=r"within 100 ms$"):
        walked.run()
    assert len(walked.sent) == 1


def test_unanswered_command_raises_with_an_unknown_outcome():
    walked = walk(ask(attempts=1, acts=True))
    with pytest.raises(NoReplyError, match=r"; whether the drive acted on it is not known$"):
        walked.run()


def test_request_may_have_its_own_reply_timeout():
    walked = walk(ask(attempts=1, reply_timeout_s=0.5))
    with pytest.raises(NoReplyError, match="within 500 ms"):
        walked.run()
    assert walked.receives[1] == (0.516, 2)


def test_second_attempt_succeeds(link):
    walked = walk(ask(), [(0.2, ANSWERED)], link=link)
    assert walked.run() == ANSWER
    assert len(walked.sent) == 2
    assert link.counters["vabus:1"] == Counter(requests=1, retries=1, replies=1, timeouts=1)


def test_damaged_reply_is_drained_and_requested_again(link, events):
    damaged = ANSWERED[:-1] + bytes([ANSWERED[-1] ^ 1])
    walked = walk(ask(), [(0.030, damaged), (0.040, b"\x7f\x7f"), (0.12, ANSWERED)], link=link)
    assert walked.run() == ANSWER
    counters = link.counters["vabus:1"]
    assert counters["checksum errors"] == 1
    assert counters["damaged"] == 1
    assert counters["retries"] == 1
    assert any(event.what == "damaged" and "check characters" in event.detail for event in events)
    # The line was quiet for the gap before the next attempt.
    assert walked.sent[1][0] >= 0.040 + 0.02


def test_sender_active_at_the_timeout_may_finish_before_the_retry():
    walked = walk(ask(), [(0.105, OTHER), (0.115, b"\x7f"), (0.2, ANSWERED)])
    assert walked.run() == ANSWER
    assert walked.sent[1][0] >= 0.115 + TIMING.gap_s


def test_persistent_damage_raises_damaged_reply_error():
    damaged = ANSWERED[:-1] + bytes([ANSWERED[-1] ^ 1])
    walked = walk(ask(attempts=1), [(0.030, damaged)])
    with pytest.raises(DamagedReplyError, match=r"^vabus:1 answered with a damaged telegram \(.*check characters"):
        walked.run()


def test_truncated_reply_is_damage_as_soon_as_the_gap_is_over():
    walked = walk(ask(attempts=1), [(0.030, ANSWERED[:7])])
    with pytest.raises(DamagedReplyError):
        walked.run()
    assert walked.time < 0.1


def test_sound_reply_after_damage_is_accepted():
    walked = walk(ask(attempts=1), [(0.030, ANSWERED[:7]), (0.040, ANSWERED)])
    assert walked.run() == ANSWER


def test_noise_alone_is_not_a_reply(link):
    walked = walk(ask(attempts=1), [(0.030, b"\x00\x7f"), (0.05, b"\x00")], link=link)
    with pytest.raises(NoReplyError):
        walked.run()
    assert link.counters["vabus:1"]["noise bytes"] == 3
    assert walked.time >= 0.109


@pytest.mark.parametrize(
    "garbage",
    [
        ANSWERED[:-1] + bytes([ANSWERED[-1] ^ 1]),
        b"\x41\x02\x7f",
        b"\x7f",
        b"\x41\x02\x30\x30\x34\x38\x31\x39\x39",
        OTHER,
    ],
    ids=["damaged replies", "false starts", "noise", "endless telegrams", "strays"],
)
@pytest.mark.parametrize("pause_s", [CHARACTER_S, 0.010, 0.019])
def test_endless_garbage_ends_the_request(garbage, pause_s):
    endless = [(pause_s * number, bytes([garbage[number % len(garbage)]])) for number in range(1, 10_000)]
    walked = walk(ask(attempts=1), endless)
    with pytest.raises(ReplyError):
        walked.run()
    # The reply timeout, time for the longest telegram that began in it, and the draining.
    assert walked.time <= 0.109 + 257 * CHARACTER_S + 0.02 + 0.1 + 0.02


def test_reply_to_another_request_is_skipped_within_the_reply_timeout(link, events):
    walked = walk(ask(), [(0.030, OTHER), (0.090, ANSWERED)], link=link)
    assert walked.run() == ANSWER
    assert len(walked.sent) == 1
    assert link.counters["vabus:1"]["strays"] == 1
    stray = next(event for event in events if event.what == "stray")
    assert (stray.data, stray.detail) == (OTHER, "parameter")


def test_stray_replies_do_not_extend_the_reply_timeout():
    walked = walk(ask(attempts=1), [(0.01 * number, OTHER) for number in range(1, 40)])
    with pytest.raises(NoReplyError, match="the reply that came differs in parameter"):
        walked.run()
    # Draining is limited as well.
    assert walked.time <= 0.109 + 0.1 + 0.02 + 1e-6


def test_exact_copy_of_the_request_is_an_echo_and_not_a_reply(link):
    # Requests and replies of this protocol look alike.
    class Mirror:
        encode = CODEC.encode

        def measure(self, head, direction):
            return CODEC.measure(head, "request" if head[:1] == b"\x04" else direction)

        def decode(self, data, direction):
            return CODEC.decode(data, "request" if data[:1] == b"\x04" else direction)

    who = Peer(name="m:1", codec=Mirror(), facts=LineFacts(settings=SETTINGS, timing=TIMING), mismatch=lambda *_: "")
    walked = walk(ask(attempts=1), [(0.020, ASKED)], link=link, who=who)
    with pytest.raises(NoReplyError, match="open the port with echo on"):
        walked.run()
    assert link.counters["m:1"]["echoes"] == 1


def test_expected_echo_is_dropped(events):
    link = Link(trace=events.append, echo="expect")
    walked = walk(ask(), [(0.008, ASKED[:3]), (0.010, ASKED[3:]), (0.030, ANSWERED)], link=link)
    assert walked.run() == ANSWER
    assert link.counters["vabus:1"]["echo bytes"] == len(ASKED)
    assert [event.what for event in events] == ["sent", "echo", "received"]


def test_echo_and_reply_in_one_piece_are_separated():
    walked = walk(ask(), [(0.030, ASKED + ANSWERED)], link=Link(echo="expect"))
    assert walked.run() == ANSWER


def test_missing_echo_does_not_prevent_the_reply():
    walked = walk(ask(), [(0.030, ANSWERED)], link=Link(echo="expect"))
    assert walked.run() == ANSWER


def test_silence_after_an_echo_raises_no_reply_error():
    walked = walk(ask(attempts=1), [(0.008, ASKED)], link=Link(echo="expect"))
    with pytest.raises(NoReplyError):
        walked.run()


def test_unrequested_data_may_finish_before_the_request(link):
    walked = walk(ask(), [(0.0, OTHER), (0.010, OTHER), (0.080, ANSWERED)], link=link)
    assert walked.run() == ANSWER
    assert walked.sent[0][0] == pytest.approx(0.010 + TIMING.gap_s)
    assert link.counters["vabus:1"]["unasked bytes"] == len(OTHER)
    assert link.counters["vabus:1"]["drained bytes"] == len(OTHER)


def test_aborted_exchange_leaves_the_line_to_be_drained(link, events):
    steps = link.run(peer(), ask(), 0.0)
    effect = next(steps)
    while not isinstance(effect, Send):
        effect = steps.send(Arrival(0.0))
    steps.send(Arrival(0.0))
    steps.close()
    walked = walk(ask(), [(0.010, ANSWERED), (0.080, ANSWERED)], link=link, start=0.005)
    assert walked.run() == ANSWER
    # The reply to the first request does not answer the second one.
    assert walked.sent == [(0.030, ASKED)]
    assert any(event.detail == "drained" for event in events)


def test_closed_exchange_runs_its_cleanup():
    cleaned = []

    def careful():
        try:
            yield Ask(message=ENQUIRY)
        finally:
            cleaned.append(True)

    steps = Link().run(peer(), careful(), 0.0)
    effect = next(steps)
    while not isinstance(effect, Send):
        effect = steps.send(Arrival(0.0))
    steps.close()
    assert cleaned == [True]


def test_exchange_that_fails_by_a_refusal_needs_no_draining():
    link = Link()

    def refused():
        yield Ask(message=ENQUIRY)
        raise RefusedError("481", 1, "value not permitted")

    with pytest.raises(RefusedError):
        walk(refused(), [(0.030, ANSWERED)], link=link).run()
    walked = walk(ask(), [(0.230, ANSWERED)], link=link, start=0.2)
    walked.run()
    assert walked.sent == [(0.2, ASKED)]


def test_message_that_cannot_be_encoded_ends_the_exchange():
    link = Link()
    with pytest.raises(TelegramError):
        walk(ask(Enquiry(address=1, parameter=9999)), link=link).run()
    assert walk(ask(), [(0.030, ANSWERED)], link=link).run() == ANSWER


def test_reopened_forgets_settings_and_unfinished_exchanges():
    link = Link()
    steps = link.run(peer(), ask(), 0.0)
    next(steps)
    steps.send(Arrival(0.0))
    steps.close()
    link.reopened()
    walked = walk(ask(), [(0.030, ANSWERED)], link=link)
    assert walked.run() == ANSWER
    assert walked.configured == [SETTINGS]
    assert walked.sent == [(0.0, ASKED)]


def test_reopened_port_has_nothing_to_drain():
    link = Link()
    cut_off(link.run(peer(), ask(), 0.0), Send)
    link.reopened()
    walked = walk(ask(), [(0.130, ANSWERED)], link=link, start=0.1)
    assert walked.run() == ANSWER
    assert walked.sent == [(0.1, ASKED)]


def test_late_reply_to_an_aborted_request_confirms_nothing_else():
    link = Link()
    cut_off(link.run(peer(), ask(SELECT, attempts=1, acts=True, nameless=True), 0.0), Send)
    other = Select(address=1, dataset=5, parameter=481, data="00000001")
    walked = walk(ask(other, attempts=1, acts=True, nameless=True), [(0.3, ACK), (1.1, ACK)], link=link, start=0.1)
    assert walked.run() == Ack(address=1)
    assert walked.sent[0][0] >= TIMING.late_s
    assert walked.time == 1.1


def test_line_settings_do_not_change_while_a_request_is_on_the_wire():
    link = Link()
    slow = LineSettings(baudrate=9600, parity="E")
    cut_off(link.run(peer(), ask(SELECT), 0.0), Send)
    walked = walk(ask(), [(0.2, ANSWERED)], link=link, who=peer("vabus:2", settings=slow), start=0.001)
    walked.run()
    assert walked.configured_at[0] >= len(SELECTED) * CHARACTER_S


def test_line_settings_do_not_change_before_a_broadcast_is_over():
    link = Link()
    everybody = Select(address=32, parameter=410, data="0002")

    def tell():
        yield Tell(message=everybody)

    walk(tell(), link=link).run()
    slow = LineSettings(baudrate=9600, parity="E")
    walked = walk(ask(), [(0.2, ANSWERED)], link=link, who=peer("vabus:2", settings=slow), start=0.001)
    walked.run()
    assert walked.configured_at[0] >= len(CODEC.encode(everybody)) * CHARACTER_S + TIMING.broadcast_pause_s


def test_line_settings_are_set_again_after_an_aborted_change():
    link = Link()
    walk(ask(), [(0.030, ANSWERED)], link=link).run()
    slow = LineSettings(baudrate=9600, parity="E")
    cut_off(link.run(peer("vabus:2", settings=slow), ask(), 0.0), Configure, time=0.1)
    walked = walk(ask(), [(0.3, ANSWERED)], link=link, start=0.2)
    assert walked.run() == ANSWER
    assert walked.configured == [SETTINGS]


def test_link_error_is_thrown_into_the_exchange():
    def patient():
        try:
            yield Ask(message=ENQUIRY, attempts=1)
        except NoReplyError:
            yield Pause(seconds=0.5)
            return (yield Ask(message=ENQUIRY))
        raise AssertionError

    walked = walk(patient(), [(0.700, ANSWERED)])
    assert walked.run() == ANSWER
    assert walked.sent[1][0] >= 0.6


def test_pauses_pass_time():
    def pausing():
        yield Pause(seconds=0.25)
        yield Pause(seconds=0.0)
        return "done"

    walked = walk(pausing(), start=1.0)
    assert walked.run() == "done"
    assert walked.time == 1.25
    assert walked.sent == []


def test_broadcast_is_followed_by_its_pause():
    link = Link()
    everybody = Select(address=32, parameter=410, data="0002")

    def tell():
        yield Tell(message=everybody)
        return (yield Ask(message=ENQUIRY))

    data = CODEC.encode(everybody)
    walked = walk(tell(), [(0.1, ANSWERED)], link=link)
    assert walked.run() == ANSWER
    assert walked.sent == [(0.0, data), (pytest.approx(len(data) * CHARACTER_S + 0.05), ASKED)]


def test_tell_overrides_the_broadcast_pause():
    def tell():
        yield Tell(message=Eot(), pause_s=0.0)
        yield Tell(message=Eot(), pause_s=0.5)
        yield Tell(message=Eot())

    walked = walk(tell())
    walked.run()
    assert [time for time, _ in walked.sent] == pytest.approx([0.0, 0.001, 0.502])


def test_line_settings_follow_the_drive_with_a_guard_time():
    link = Link(guard_s=0.005)
    slow = LineSettings(baudrate=9600, bytesize=8, parity="E")
    walk(ask(), [(0.030, ANSWERED)], link=link).run()
    walked = walk(ask(), [(0.2, ANSWERED)], link=link, who=peer("vabus:2", settings=slow), start=0.1)
    walked.run()
    assert walked.configured == [slow]
    assert walked.sent == [(0.105, ASKED)]
    back = walk(ask(), [(0.4, ANSWERED)], link=link, start=0.3)
    back.run()
    assert back.configured == [SETTINGS]
    assert set(link.counters) == {"vabus:1", "vabus:2"}


def test_settings_that_the_port_cannot_carry_are_noted(link, events):
    walk(ask(), [(0.030, ANSWERED)], link=link, note="no parity here").run()
    assert (events[0].what, events[0].detail) == ("note", "no parity here")


def test_late_nameless_reply_is_waited_out():
    link = Link()
    with pytest.raises(NoReplyError):
        walk(ask(SELECT, attempts=1, acts=True, nameless=True), link=link).run()
    other = Select(address=1, dataset=5, parameter=481, data="00000001")
    # The acknowledgement of the first write comes late, and must not confirm the second one.
    walked = walk(ask(other, attempts=1, acts=True, nameless=True), [(0.9, ACK), (1.2, ACK)], link=link, start=0.2)
    assert walked.run() == Ack(address=1)
    assert walked.sent[0][0] >= 1.0
    assert walked.time >= 1.2


def test_late_reply_is_waited_out_although_the_waiting_exchange_was_aborted():
    link = Link()
    with pytest.raises(NoReplyError):
        walk(ask(SELECT, attempts=1, nameless=True), link=link).run()
    other, third = (Select(address=1, dataset=5, parameter=each, data="00000001") for each in (481, 482))
    with pytest.raises(HeldBack) as held:
        next(link.run(peer(), ask(other, attempts=1, nameless=True), 0.2))
    held.value.exchange.close()
    with pytest.raises(NoReplyError):
        walk(ask(third, attempts=1, nameless=True), [(0.3, ACK)], link=link, start=0.2).run()


def test_stop_neither_waits_for_a_late_reply_nor_is_confirmed_by_it():
    link = Link()
    with pytest.raises(NoReplyError):
        walk(ask(SELECT, attempts=1, nameless=True), link=link).run()
    stop = Select(address=1, parameter=410, data="0000")
    walked = walk(
        ask(stop, attempts=1, acts=True, nameless=True, urgent=True), [(0.9, ACK), (1.2, ACK)], link=link, start=0.2
    )
    assert walked.run() == Ack(address=1)
    assert walked.sent[0] == (0.2, CODEC.encode(stop))
    assert walked.time == 1.2


@pytest.mark.parametrize("distinct", [True, False])
def test_distinct_request_is_repeated_without_waiting_for_a_late_reply(distinct):
    link = Link()
    with pytest.raises(NoReplyError):
        walk(ask(SELECT, attempts=1, nameless=True), link=link).run()
    stop = ask(ENQUIRY, urgent=True, distinct=distinct)
    walked = walk(stop, [(0.25, ACK), (0.38, ANSWERED), (1.25, ANSWERED)], link=link, start=0.2)
    assert walked.run() == ANSWER
    again = walked.sent[1][0]
    assert again == pytest.approx(0.3, abs=0.1) if distinct else again > 1.0


def test_second_reply_to_a_repeated_command_confirms_no_other():
    link = Link()
    assert walk(ask(distinct=True), [(0.2, ANSWERED)], link=link).run() == ANSWER
    walked = walk(ask(Enquiry(address=1, parameter=482), attempts=1, distinct=True), link=link, start=0.21)
    with pytest.raises(NoReplyError):
        walked.run()
    assert walked.sent[0][0] > 1.0


def test_equal_nameless_request_does_not_wait_for_a_late_reply():
    link = Link()
    with pytest.raises(NoReplyError):
        walk(ask(SELECT, attempts=1, nameless=True), link=link).run()
    walked = walk(ask(SELECT, attempts=1, nameless=True), [(0.3, ACK)], link=link, start=0.2)
    assert walked.run() == Ack(address=1)
    assert walked.sent[0][0] < 0.3


def test_late_reply_that_names_its_request_is_not_waited_out():
    link = Link()
    with pytest.raises(NoReplyError):
        walk(ask(attempts=1), link=link).run()
    other = Enquiry(address=1, parameter=482)
    walked = walk(ask(other), [(0.25, ANSWERED), (0.28, OTHER)], link=link, start=0.2)
    assert CODEC.encode(walked.run()) == OTHER
    assert walked.sent == [(0.2, CODEC.encode(other))]


def test_other_drive_does_not_wait_for_a_late_reply():
    link = Link()
    with pytest.raises(NoReplyError):
        walk(ask(SELECT, attempts=1, nameless=True), link=link).run()
    elsewhere = Select(address=2, dataset=5, parameter=480, data="00000001")
    walked = walk(ask(elsewhere, attempts=1), [(0.3, b"\x42\x06")], link=link, who=peer("vabus:2"), start=0.2)
    assert walked.run() == Ack(address=2)
    assert walked.sent[0][0] == pytest.approx(0.2)


def test_nameless_reply_to_an_earlier_attempt_is_waited_out_after_success():
    link = Link()
    # The reply to the first attempt is so late that it counts as the reply to the second one. The second reply is still
    # to come when the exchange has ended, and must not confirm the next write.
    first = walk(ask(SELECT, nameless=True), [(0.2, ACK)], link=link)
    assert first.run() == Ack(address=1)
    sent_again = first.sent[1][0]
    other = Select(address=1, dataset=5, parameter=481, data="00000001")
    late = sent_again + TIMING.late_s - 0.001
    walked = walk(ask(other, attempts=1, nameless=True), [(late, ACK)], link=link, start=0.21)
    with pytest.raises(NoReplyError):
        walked.run()


def test_second_acknowledgement_of_one_write_does_not_confirm_the_next():
    # The request arrived twice, so the drive acknowledges twice, one request's length apart.
    link = Link()
    link.paced = True
    assert walk(ask(SELECT, nameless=True), [(0.030, ACK)], link=link).run() == Ack(address=1)
    other = Select(address=1, dataset=5, parameter=481, data="00000001")
    second = 0.030 + len(SELECTED) * CHARACTER_S
    walked = walk(ask(other, attempts=1, nameless=True), [(second, ACK)], link=link, start=0.030)
    with pytest.raises(NoReplyError):
        walked.run()


def test_read_does_not_wait_for_a_second_acknowledgement():
    link = Link()
    assert walk(ask(SELECT, nameless=True), [(0.030, ACK)], link=link).run() == Ack(address=1)
    walked = walk(ask(), [(0.040, ACK), (0.060, ANSWERED)], link=link, start=0.030)
    assert walked.run() == ANSWER
    assert walked.sent[0][0] == pytest.approx(0.032)


def test_trace_is_optional():
    assert walk(ask(), [(0.0, b"\x00"), (0.030, b"\x7f" + OTHER + ANSWERED)]).run() == ANSWER


def test_bytes_that_arrive_during_a_later_request_answer_nothing():
    link = Link()
    link.paced = True
    walk(ask(), [(0.030, ANSWERED)], link=link).run()
    with pytest.raises(NoReplyError):
        walk(ask(attempts=1), [(1.002, ANSWERED)], link=link, start=1.0).run()
    assert link.counters["vabus:1"]["unasked bytes"] == len(ANSWERED)


def test_command_is_repeated_only_within_the_watchdog_time():
    link = Link()
    link.repeat_within(peer(), 1.0)
    walk(ask(), [(0.030, ANSWERED)], link=link).run()
    walk(ask(command="new"), [(0.130, ANSWERED)], link=link, start=0.1).run()
    assert walk(ask(command="repeated"), [(0.930, ANSWERED)], link=link, start=0.9).run() == ANSWER
    late = walk(ask(command="repeated"), [(5.030, ANSWERED)], link=link, start=5.0)
    with pytest.raises(CommandTooOldError):
        late.run()
    assert late.sent == []
