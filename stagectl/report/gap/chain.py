"""The map of where: the loop as a chain of blocks, each with its share of the gap and the effects that sit in it.

::

    reference -> (+) -> controller -> drive -> mechanics -> sensor -> measured
                  ^-                                           |
                  +--------------------------------------------+
"""

from __future__ import annotations

import base64
import math
import textwrap
from collections.abc import Mapping
from html import escape
from typing import NamedTuple

from stagectl.gap.effects import library
from stagectl.gap.result.diagnosis import BLOCKS, DiagnosisResult
from stagectl.gap.result.gap_numbers import percent
from stagectl.report.page import Picture

WIDTH, HEIGHT = 980, 268  # px
_LEFT, _TOP, _WIDE, _HIGH, _SPACE = 108.0, 46.0, 174.0, 152.0, 36.0
SIGNALS = ("command", "current", "position", "measured")  # behind each block: where the loop is cut
_INK, _SOFT, _LINE = "#1e293b", "#64748b", "#94a3b8"
_SMALL = f'font-size="12" fill="{_SOFT}"'
_LINES = 4  # of effects in a block
_CHARACTERS = 23  # of one line in a block
_WHY: Mapping[str, str] = {  # a cut that was not possible, where nothing else is said of it
    "controller": "not judged: no controller or no command is known",
    "drive": "not judged: no measured current",
    "mechanics": "not judged",
    "sensor": "not judged",
}
_BEHIND = "not judged before the controller is the one described"
_HEAD = f"""<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}" height="{HEIGHT}"
 font-family="system-ui, 'DejaVu Sans', sans-serif" font-size="13" fill="{_INK}">
<defs><marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="8" markerHeight="8" orient="auto">
<path d="M0 0 8 4 0 8z" fill="{_LINE}"/></marker>
<pattern id="hatch" width="9" height="9" patternTransform="rotate(45)" patternUnits="userSpaceOnUse">
<rect width="9" height="9" fill="#f8fafc"/><rect width="2" height="9" fill="#e2e8f0"/></pattern></defs>
"""


class _Box(NamedTuple):
    """One block of the drawing."""

    left: float
    name: str
    share: float | None
    lines: list[str]


def chain(found: DiagnosisResult) -> Picture:
    """The signal chain as a picture of the page."""
    text = base64.b64encode(drawing(found).encode()).decode()
    return Picture(f"data:image/svg+xml;base64,{text}", _caption(found), 760)


def _caption(found: DiagnosisResult) -> str:
    told = "Each block's share of the excess over noise, and the effects that were found in it."
    return f"{told} Hatched: this cut of the loop was not possible." if None in found.blocks.values() else told


def drawing(found: DiagnosisResult) -> str:
    """The same as SVG text."""
    boxes = [_box(found, number, name) for number, name in enumerate(BLOCKS)]
    strength = 0.0 if found.verdict == "none" else 1.0  # shares of next to nothing colour no block
    return "\n".join([_HEAD, *_wires(), *(line for one in boxes for line in _drawn(one, strength)), "</svg>"])


def _box(found: DiagnosisResult, number: int, name: str) -> _Box:
    share = found.blocks.get(name)
    if share is None:
        why = _BEHIND if found.verdict == "controller" else _WHY[name]
        lines = textwrap.wrap(dict(found.impossible).get(name, why), _CHARACTERS)
    else:
        effects = [one for one in found.named if one.block == name]
        lines = [line for one in effects for line in textwrap.wrap(library.label(one.name), _CHARACTERS)]
    if len(lines) > _LINES:
        lines = [*lines[: _LINES - 1], "..."]
    return _Box(_LEFT + number * (_WIDE + _SPACE), name, share, lines)


def _drawn(box: _Box, strength: float) -> list[str]:
    middle = box.left + 0.5 * _WIDE
    fill = "url(#hatch)" if box.share is None else _shade(strength * box.share)
    dash = ' stroke-dasharray="5 4"' if box.share is None else ""
    told = "?" if box.share is None else percent(box.share)
    size = f'x="{box.left}" y="{_TOP}" width="{_WIDE}" height="{_HIGH}" rx="6"'
    return [
        f'<rect {size} fill="{fill}" stroke="{_LINE}"{dash}/>',
        _text(middle, _TOP + 24.0, box.name, 'font-weight="600" font-size="15"'),
        _text(middle, _TOP + 58.0, told, 'font-size="26" font-weight="600"'),
        *(_text(middle, _TOP + 84.0 + 17.0 * row, line) for row, line in enumerate(box.lines)),
    ]


def _shade(share: float) -> str:
    """From white to amber; letters on it stay readable."""
    part = min(max(share, 0.0), 1.0) if math.isfinite(share) else 0.0
    colour = (round(255 + part * (end - 255)) for end in (245, 176, 65))
    return f"rgb({','.join(map(str, colour))})"


def _wires() -> list[str]:
    """Arrows from block to block, the sum, and the feedback."""
    y, low = _TOP + 0.5 * _HIGH, _TOP + _HIGH + 36.0
    ends = [_LEFT + number * (_WIDE + _SPACE) for number in range(len(BLOCKS))]
    last = ends[-1] + _WIDE
    arrows = [_arrow(f"M8 {y}H68"), _arrow(f"M90 {y}H{_LEFT}"), _arrow(f"M{last} {y}H{WIDTH - 4}")]
    arrows += [_arrow(f"M{end - _SPACE} {y}H{end}") for end in ends[1:]]
    arrows.append(_arrow(f"M{last + 16} {y}V{low}H79V{y + 12}"))
    labels = [
        _text(end + _WIDE + 0.5 * _SPACE, _TOP - 14.0, name, _SMALL) for end, name in zip(ends, SIGNALS, strict=True)
    ]
    ticks = [
        f'<path d="M{end + _WIDE + 0.5 * _SPACE} {_TOP - 8.0}V{y - 7}" stroke="#cbd5e1" stroke-dasharray="2 3"/>'
        for end in ends
    ]
    circle = f'<circle cx="79" cy="{y}" r="11" fill="#fff" stroke="{_LINE}" stroke-width="1.5"/>'
    signs = [_text(79.0, y + 4.5, "+"), _text(66.0, y + 26.0, "−"), _text(34.0, y - 9.0, "reference", _SMALL)]
    return [*arrows, *ticks, *labels, circle, *signs]


def _arrow(path: str) -> str:
    return f'<path d="{path}" fill="none" stroke="{_LINE}" stroke-width="1.5" marker-end="url(#tip)"/>'


def _text(x: float, y: float, words_: str, style: str = "") -> str:
    return f'<text x="{x}" y="{y}" text-anchor="middle" {style}>{escape(words_)}</text>'
