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
from pathlib import Path
from typing import NamedTuple

import jinja2

from stagectl.gap.effects.library import label
from stagectl.gap.result.diagnosis import BLOCKS, DiagnosisResult
from stagectl.number_format import percent
from stagectl.report.constants import BLOCK_CHARACTERS, BLOCK_LINES
from stagectl.report.page import Picture

WIDTH, HEIGHT = 980, 268  # px
_LEFT, _TOP, _WIDE, _HIGH, _SPACE = 108, 46, 174, 152, 36
SIGNALS = ("command", "current", "position", "measured")  # after each block: where the loop is cut
_WHY: Mapping[str, str] = {  # reason for a cut that was not possible, where the diagnosis gives none
    "controller": "not judged: no controller or no command is known",
    "drive": "not judged: no measured current, or a slow log",
    "mechanics": "not judged",
    "sensor": "not judged",
}
_AFTER_CONTROLLER = "not judged: the controller is not the one described"


class _Box(NamedTuple):
    """One block of the drawing."""

    left: int
    name: str
    signal: str  # after it
    share: float | None
    fill: str
    lines: list[str]

    @property
    def right(self) -> int:
        """Right edge."""
        return self.left + _WIDE

    @property
    def middle(self) -> float:
        """Where its words are centred."""
        return self.left + 0.5 * _WIDE

    @property
    def percent(self) -> str:
        """Its share in words."""
        return "?" if self.share is None else percent(self.share)


def chain(result: DiagnosisResult) -> Picture:
    """The signal chain as a picture of the page."""
    text = base64.b64encode(drawing(result).encode()).decode()
    caption = "Share of the known causes that each block holds, and the effects found in it."
    hatched = " Hatched: not judged." if None in result.blocks.values() else ""
    worst = max(_boxes(result), key=lambda box: box.share or 0.0)
    return Picture(f"data:image/svg+xml;base64,{text}", f"{caption}{hatched}", 760, middle=worst.middle / WIDTH)


def drawing(result: DiagnosisResult) -> str:
    """The same as SVG text."""
    source = Path(__file__).with_name("chain.svg.jinja").read_text(encoding="utf-8")
    environment = jinja2.Environment(autoescape=True, trim_blocks=True, undefined=jinja2.StrictUndefined)
    sizes = {"width": WIDTH, "height": HEIGHT, "top": _TOP, "high": _HIGH, "space": _SPACE}
    return environment.from_string(source).render(boxes=_boxes(result), **sizes)


def _boxes(result: DiagnosisResult) -> list[_Box]:
    strength = 0.0 if result.verdict == "none" else 1.0  # shares of a gap within the noise colour no block
    boxes = []
    for number, (name, signal) in enumerate(zip(BLOCKS, SIGNALS, strict=True)):
        share, lines = result.blocks.get(name), _lines(result, name)
        if len(lines) > BLOCK_LINES:
            lines = [*lines[: BLOCK_LINES - 1], "..."]
        fill = "url(#hatch)" if share is None else _shade(strength * share)
        boxes.append(_Box(_LEFT + number * (_WIDE + _SPACE), name, signal, share, fill, lines))
    return boxes


def _lines(result: DiagnosisResult, block: str) -> list[str]:
    """The effects of a block; why it was not judged, where it was not."""
    if result.blocks.get(block) is None:
        why = _AFTER_CONTROLLER if result.verdict == "controller" else _WHY[block]
        return textwrap.wrap(dict(result.impossible).get(block, why), BLOCK_CHARACTERS)
    effects = [label(effect.name) for effect in result.named if effect.block == block]
    return [line for effect in effects for line in textwrap.wrap(effect, BLOCK_CHARACTERS)]


def _shade(share: float) -> str:
    """From white to amber; letters on it stay readable."""
    part = min(max(share, 0.0), 1.0) if math.isfinite(share) else 0.0
    return "rgb({},{},{})".format(*(round(255 + part * (end - 255)) for end in (245, 176, 65)))
