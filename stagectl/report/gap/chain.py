"""The loop as a chain of blocks, each with its share of the gap and its effects.

::

    reference -> (+) -> controller -> drive -> mechanics -> sensor -> measured
                  ^-                                           |
                  +--------------------------------------------+
"""

import base64
import math
import textwrap
from collections.abc import Mapping
from html import escape
from typing import NamedTuple

from stagectl.gap.effects.library import label
from stagectl.gap.result.diagnosis import BLOCKS, DiagnosisResult
from stagectl.number_format import percent
from stagectl.report.constants import BLOCK_CHARACTERS, BLOCK_LINES
from stagectl.report.page import Picture

WIDTH, HEIGHT = 980, 268  # px
_LEFT, _TOP, _WIDE, _HIGH, _SPACE = 108.0, 46.0, 174.0, 152.0, 36.0
SIGNALS = ("command", "current", "position", "measured")  # after each block: where the loop is cut
_INK, _SOFT, _LINE = "#1e293b", "#64748b", "#94a3b8"
_SMALL = f'font-size="12" fill="{_SOFT}"'
_WHY: Mapping[str, str] = {  # reason for a cut that was not possible, where the diagnosis gives none
    "controller": "not judged: no controller or no command is known",
    "drive": "not judged: no measured current, or a slow log",
    "mechanics": "not judged",
    "sensor": "not judged",
}
_AFTER_CONTROLLER = "not judged: the controller is not the one described"
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


def chain(result: DiagnosisResult) -> Picture:
    """The signal chain as a picture of the page."""
    text = base64.b64encode(drawing(result).encode()).decode()
    caption = "Share of the known causes that each block holds, and the effects found in it."
    hatched = " Hatched: not judged." if None in result.blocks.values() else ""
    worst = max(range(len(BLOCKS)), key=lambda number: result.blocks.get(BLOCKS[number]) or 0.0)
    middle = (_left(worst) + 0.5 * _WIDE) / WIDTH
    return Picture(f"data:image/svg+xml;base64,{text}", f"{caption}{hatched}", 760, middle=middle)


def drawing(result: DiagnosisResult) -> str:
    """The same as SVG text."""
    boxes = [_box(result, number, name) for number, name in enumerate(BLOCKS)]
    strength = 0.0 if result.verdict == "none" else 1.0  # shares of a gap within the noise colour no block
    return "\n".join([_HEAD, *_wires(), *(line for box in boxes for line in _drawn(box, strength)), "</svg>"])


def _box(result: DiagnosisResult, number: int, name: str) -> _Box:
    share = result.blocks.get(name)
    if share is None:
        why = _AFTER_CONTROLLER if result.verdict == "controller" else _WHY[name]
        lines = textwrap.wrap(dict(result.impossible).get(name, why), BLOCK_CHARACTERS)
    else:
        effects = [label(effect.name) for effect in result.named if effect.block == name]
        lines = [line for effect in effects for line in textwrap.wrap(effect, BLOCK_CHARACTERS)]
    if len(lines) > BLOCK_LINES:
        lines = [*lines[: BLOCK_LINES - 1], "..."]
    return _Box(_left(number), name, share, lines)


def _left(number: int) -> float:
    """Left edge of a block."""
    return _LEFT + number * (_WIDE + _SPACE)


def _drawn(box: _Box, strength: float) -> list[str]:
    middle = box.left + 0.5 * _WIDE
    fill = "url(#hatch)" if box.share is None else _shade(strength * box.share)
    dash = ' stroke-dasharray="5 4"' if box.share is None else ""
    share = "?" if box.share is None else percent(box.share)
    size = f'x="{box.left}" y="{_TOP}" width="{_WIDE}" height="{_HIGH}" rx="6"'
    return [
        f'<rect {size} fill="{fill}" stroke="{_LINE}"{dash}/>',
        _text(middle, _TOP + 24.0, box.name, 'font-weight="600" font-size="15"'),
        _text(middle, _TOP + 58.0, share, 'font-size="26" font-weight="600"'),
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
    ends = [_left(number) for number in range(len(BLOCKS))]
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


def _text(x: float, y: float, text: str, style: str = "") -> str:
    return f'<text x="{x}" y="{y}" text-anchor="middle" {style}>{escape(text)}</text>'
