"""Pictures of the traffic through each door: drives on the left, users on the right."""

from __future__ import annotations

from dataclasses import dataclass
from html import escape

_DRIVES = (("pump", "VABus"), ("fan", "Danfoss FC"), ("mixer", "Modbus RTU"))
_WIDTH, _HEIGHT = 860, 250
_ROWS = (30, 100, 170)
_BOX = 50


@dataclass(frozen=True, slots=True, kw_only=True)
class Picture:
    """Traffic through one door.

    door: its name. through: the intermediate program between the door and its users, or empty. out, back: the data to
    the users, and the data from them, one line each.
    """

    door: str
    users: tuple[str, str, str]
    out: tuple[str, str]
    back: tuple[str, str]
    through: str = ""


PICTURES = {
    "door-mqtt.svg": Picture(
        door="MQTT door",
        through="MQTT broker",
        users=("Home Assistant", "historian", "your programs"),
        out=("values, retained;", "missed values"),
        back=("commands with id,", "session and time"),
    ),
    "door-sparkplug.svg": Picture(
        door="Sparkplug door",
        through="MQTT broker",
        users=("primary host", "SCADA", "historian"),
        out=("births, deaths,", "data, history"),
        back=("rebirth, commands", "of this session"),
    ),
    "door-opcua.svg": Picture(
        door="OPC UA door",
        users=("SCADA", "UaExpert", "your programs"),
        out=("values with unit, status and", "source time; events; history"),
        back=("methods with a result,", "under a lock"),
    ),
    "door-modbus-tcp.svg": Picture(
        door="Modbus TCP door",
        users=("PLC", "HMI", "SCADA"),
        out=("a unit a drive: float32 values,", "quality, age; exception 11 if stale"),
        back=("heartbeat, sequence,", "start, stop, reference"),
    ),
    "door-fleet.svg": Picture(
        door="MQTT door",
        through="MQTT broker",
        users=("drivecomm fleet", "its web page", "your programs"),
        out=("values, state,", "of each plant"),
        back=("", ""),
    ),
}


def door_pictures() -> dict[str, str]:
    """Return all pictures as SVG, by file name."""
    return {name: _drawn(picture) for name, picture in PICTURES.items()}


def _drawn(picture: Picture) -> str:
    middle = _ROWS[1] + _BOX / 2
    parts = [f'<rect width="{_WIDTH}" height="{_HEIGHT}" rx="8" fill="#ffffff"/>']
    for row, (name, protocol) in zip(_ROWS, _DRIVES, strict=True):
        parts += [_box((15, row, 110, _BOX), "#e8f0fe", protocol, name), _line(125, row + _BOX / 2, 190)]
    parts.append(_box((190, 30, 140, 190), "#f1f3f4", ""))
    parts.append(_text(260, 60, "drivecomm serve", bold=True))
    parts.append(_text(260, 80, "owns the lines"))
    parts.append(_box((200, 95, 120, 44), "#fef7e0", picture.door))
    parts.append(_box((200, 160, 120, 44), "#ffffff", "history"))
    begin, end = 330, 640
    if picture.through:
        parts.append(_box((530, _ROWS[1], 110, _BOX), "#e6f4ea", picture.through))
        end = 530
    parts.append(_arrow(begin, middle - 8, end - 4))
    if any(picture.back):
        parts.append(_arrow(end, middle + 8, begin + 4))
    centre = (begin + end) / 2
    for number, text in enumerate(picture.out):
        parts.append(_text(centre, middle - 34 + 16 * number, text))
    for number, text in enumerate(picture.back):
        parts.append(_text(centre, middle + 30 + 16 * number, text))
    for row, user in zip(_ROWS, picture.users, strict=True):
        parts.append(_line(640, middle, 700, row + _BOX / 2))
        parts.append(_box((700, row, 145, _BOX), "#fce8e6", user))
    inside = "\n".join(parts)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH} {_HEIGHT}" '
        f'font-family="sans-serif" font-size="13" text-anchor="middle">\n'
        '<defs><marker id="head" orient="auto" markerWidth="8" markerHeight="8" refX="6" refY="3">'
        '<path d="M0,0 L6,3 L0,6 z" fill="#3c4043"/></marker></defs>\n'
        f"{inside}\n</svg>\n"
    )


def _box(place: tuple[float, float, float, float], colour: str, text: str, title: str = "") -> str:
    x, y, width, height = place
    drawn = f'<rect x="{x}" y="{y}" width="{width}" height="{height}" rx="6" fill="{colour}" stroke="#5f6368"/>'
    centre, middle = x + width / 2, y + height / 2
    if title:
        return drawn + _text(centre, middle - 4, title, bold=True) + _text(centre, middle + 14, text)
    return drawn + _text(centre, middle + 5, text)


def _text(x: float, y: float, text: str, *, bold: bool = False) -> str:
    weight = ' font-weight="bold"' if bold else ""
    return f'<text x="{x}" y="{y}" fill="#202124"{weight}>{escape(text)}</text>' if text else ""


def _line(x: float, y: float, to_x: float, to_y: float | None = None) -> str:
    return f'<line x1="{x}" y1="{y}" x2="{to_x}" y2="{y if to_y is None else to_y}" stroke="#5f6368"/>'


def _arrow(x: float, y: float, to_x: float) -> str:
    return f'<line x1="{x}" y1="{y}" x2="{to_x}" y2="{y}" stroke="#3c4043" stroke-width="1.5" marker-end="url(#head)"/>'
