"""Text replies of other drives as a Danfoss FC drive receives them: skipped whole, contents ignored."""

import pytest
from hypothesis import given, settings, strategies as st

from drivecomm.errors import TelegramError
from drivecomm.protocol import Framed, Framer, installed
from drivecomm.virtual import VirtualLine, virtual_drive
from drivecomm_danfoss_fc.hearing import DriveCodec
from drivecomm_danfoss_fc.messages import ProcessRequest, TextReply
from drivecomm_danfoss_fc.telegrams import DanfossFcCodec

PLAIN = DanfossFcCodec()
CODEC = DriveCodec(12)
READY = {"status_word": 0x0607, "main_actual": 0}
AT_3 = {"address_format": "1-126", "address": 3}
TO_ALL = PLAIN.encode(ProcessRequest(address_format="1-31", broadcast=True, control_word=0x47C, reference=0x2000))
WAYS = [(15, 0x0400), (15, 0), (3, 6), (3, 0x0106)]


def reply(text, way):
    ak, ind = way
    return PLAIN.encode(TextReply(**AT_3, ak=ak, pnu=1540, ind=ind, text=text, **READY))


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("split", [0, 1, 2, 5, 6, 7, 12])
def test_telegram_inside_a_text_reply_is_not_framed(way, split):
    data = reply(TO_ALL.decode("latin-1") + "!", way)
    framer = Framer(CODEC, "request")
    finds = [*framer.feed(data[:split]), *framer.feed(data[split:] + TO_ALL)]
    assert [find.data for find in finds if isinstance(find, Framed)] == [data, TO_ALL]
    # A codec that does not know text replies finds the broadcast in the middle.
    assert TO_ALL in [find.data for find in Framer(PLAIN, "request").feed(data) if isinstance(find, Framed)]


@settings(deadline=None)
@given(st.text(st.characters(max_codepoint=255), max_size=40), st.sampled_from(WAYS))
def test_any_text_reply_is_measured_in_full(text, way):
    data = reply(text, way)
    assert CODEC.measure(data, "request") == len(data)


def test_drive_does_not_act_on_a_command_inside_a_foreign_text_reply():
    drive = virtual_drive("danfoss-fc", 4)
    line = VirtualLine([drive])
    line.configure(drive.settings)
    line.transmit(reply(TO_ALL.decode("latin-1") + "!", WAYS[0]))
    line.advance(1.0)
    assert not drive.motor.running
    line.transmit(TO_ALL)
    line.advance(1.0)
    assert drive.motor.running


def test_damaged_text_reply_is_rejected():
    data = reply("FC-302", WAYS[0])
    with pytest.raises(TelegramError):
        CODEC.decode(data[:-1] + bytes([data[-1] ^ 1]), "request")


def test_requests_and_replies_are_read_as_by_the_plain_codec():
    plugin = installed["danfoss-fc"]
    assert CODEC.decode(TO_ALL, "request") == plugin.codec(plugin.options()).decode(TO_ALL, "request")
    data = reply("FC-302", WAYS[2])
    assert CODEC.decode(data, "reply") == PLAIN.decode(data, "reply")
    assert CODEC.measure(b"", "request") == PLAIN.measure(b"", "request")
