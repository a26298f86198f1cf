"""The page of a diagnosis: for every verdict it says what was found, in units that its axes name."""

from __future__ import annotations

import base64
import math
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest

from stagectl.gap.result.diagnosis import Coordinate, Spans, Trace
from stagectl.report import interactive
from stagectl.report.constants import MOST_ROWS
from stagectl.report.gap import figures
from stagectl.report.gap.chain import WIDTH, chain, drawing
from stagectl.report.gap.page import page
from stagectl.report.page import typeset, write
from tests.gap.examples import BLOCKS, COGGING, MICRON, PER_UNIT, every, found

FOUND = every()
SVG = "{http://www.w3.org/2000/svg}"


def texts(verdict: str) -> list[str]:
    return [element.text or "" for element in ET.fromstring(drawing(FOUND[verdict])).iter(f"{SVG}text")]


@pytest.mark.parametrize(
    ("verdict", "present", "absent"),
    [
        ("none", "does not exceed the noise significantly", "Next steps"),
        ("parameters", "0.1681 N m s/rad (0.1665 to 0.1697)", "Ambiguities"),
        ("effects", "stagectl gap next captures", "Unexplained"),
        ("effects+unknown", "Unexplained", "does not exceed"),
        ("unknown", "has no known cause", "Parameters"),
        ("controller", "The integral gain looks like 0.5 of the nominal one.", "How far the gap shrinks"),
        ("not-identifiable", "Only one speed was run.", "does not exceed"),
        ("foreign", "no current was logged", "Checked on"),
    ],
)
def test_every_verdict_has_its_page(
    verdict: str, present: str, absent: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if verdict != "effects":  # one page has its images, which take most of the time
        monkeypatch.setattr(interactive, "embedded", lambda figure, dpi: "data:image/png;base64,")
    made = page(FOUND[verdict], "captures", ["stagectl gap diagnose captures"])
    assert made.answer == FOUND[verdict].sentence
    text = write(made, tmp_path / "page.html").read_text()
    assert present in text and absent not in text
    assert "nan" not in text.split("data:image")[0].lower() and "not known %" not in text
    assert text.count("<figure>") + text.count('<figure class="broad">') == text.count("<img src=")


def test_the_next_commands_read_the_stored_answer() -> None:
    """Logs may be single files: `gap apply` reads the folder that the answer is in."""
    made = page(FOUND["effects"], "slow.csv", [], "answer", "my stage.yaml")
    commands = [command for section in made.sections for command in section.commands]
    assert "stagectl gap apply answer 'my stage.yaml'" in commands
    assert not any("slow.csv" in command for command in commands)


def test_the_sentence_keeps_numbers_with_their_units() -> None:
    assert typeset("gap 2.9 -> 0.34 µm, 82 % of it") == "gap 2.9\u00a0→ 0.34\u00a0µm, 82\u00a0% of it"


def test_the_chain_names_blocks_shares_and_effects() -> None:
    said = texts("effects")
    for word in ("controller", "drive", "mechanics", "sensor", "0 %", "3 %", "95 %", "2 %", "reference", "measured"):
        assert word in said
    place = said.index("mechanics")
    assert said[place : place + 3] == ["mechanics", "95 %", "viscous asymmetry"]
    assert "Stribeck friction" not in said  # its probability is 0.21: not named


def test_a_cut_that_was_impossible_is_hatched_and_says_why() -> None:
    diagnosis = FOUND["foreign"]._replace(impossible=(("sensor", "one sensor only"),))
    tree = ET.fromstring(drawing(diagnosis))
    hatched = [rect for rect in tree.iter(f"{SVG}rect") if rect.get("fill") == "url(#hatch)"]
    assert len(hatched) == 3
    words = " ".join(element.text or "" for element in tree.iter(f"{SVG}text"))
    assert "not judged: no measured current, or a slow log" in words and "one sensor only" in words
    assert "Hatched" in chain(diagnosis).caption and "Hatched" not in chain(FOUND["effects"]).caption


def test_nothing_of_the_chain_overlaps() -> None:
    """Seven px a letter at 13 px is the widest of DejaVu Sans; the lines of a block stay inside it."""
    many = tuple(COGGING._replace(name=f"a_rather_long_name_of_an_effect_{n}", block="drive") for n in range(6))
    tree = ET.fromstring(drawing(found("effects", effects=many)))
    boxes = [rect for rect in tree.iter(f"{SVG}rect") if rect.get("rx")]
    assert len(boxes) == len(BLOCKS)
    bottom = float(boxes[1].get("y", 0)) + float(boxes[1].get("height", 0))
    inside = [
        element for element in tree.iter(f"{SVG}text") if "effect" in (element.text or "") or element.text == "..."
    ]
    assert inside and max(float(element.get("y", 0)) for element in inside) < bottom - 4.0
    assert max(7.0 * len(element.text or "") for element in inside) <= float(boxes[1].get("width", 0))


def test_a_narrow_screen_begins_at_the_block_with_the_largest_share() -> None:
    picture = chain(FOUND["effects"])
    (place,) = [t for t in ET.fromstring(drawing(FOUND["effects"])).iter(f"{SVG}text") if t.text == "mechanics"]
    assert picture.middle == pytest.approx(float(place.get("x", 0)) / WIDTH)


def test_the_picture_is_the_drawing() -> None:
    head, data = chain(FOUND["effects"]).image.split(",")
    assert head == "data:image/svg+xml;base64" and base64.b64decode(data).decode() == drawing(FOUND["effects"])


def test_the_waterfall_ends_at_the_whole() -> None:
    (axes,) = figures.shares(FOUND["effects"]).axes
    bars = [patch for patch in axes.patches if patch.get_height() > 0.0]  # type: ignore[attr-defined]
    widths = [bar.get_width() for bar in bars]  # type: ignore[attr-defined]
    assert widths == pytest.approx([2.0, 82.0, 9.0, 5.5, 1.5])
    assert [bar.get_x() for bar in bars] == pytest.approx([0.0, 2.0, 84.0, 93.0, 98.5])  # type: ignore[attr-defined]
    assert [label.get_text() for label in axes.get_yticklabels()][1:3] == ["viscous asymmetry", "cogging"]


def test_spans_are_drawn_where_the_gap_is_open() -> None:
    captures = (Spans("folder/a.csv", ((1.0, 2.5), (4.0, 4.5)), 6.0), Spans("b.csv", (), 3.0))
    (axes,) = figures.spans(found("effects", captures=captures)).axes
    (open_b, open_a) = axes.collections  # from below
    ends = [(path.get_extents().x0, path.get_extents().x1) for path in open_a.get_paths()]
    assert ends == [(1.0, 2.5), (4.0, 4.5)] and not open_b.get_paths()
    assert [label.get_text() for label in axes.get_yticklabels()] == ["b", "a"]


def test_many_captures_are_cut_to_those_that_are_open_longest() -> None:
    captures = tuple(Spans(f"{n}.csv", ((0.0, 0.1 * n),), 9.0) for n in range(60))
    drawn = figures.most_open(found("effects", captures=captures))
    assert [span.file for span in drawn] == [f"{n}.csv" for n in range(60 - MOST_ROWS, 60)]


def test_the_window_holds_the_largest_gap() -> None:
    t = np.arange(0.0, 10.0, 1e-3)
    before = np.where((t > 6.2) & (t < 6.6), 1.0, 0.01)
    part = figures.window(Trace("a", t, t, before, before, 0.0))
    assert t[part][0] < 6.2 and t[part][-1] > 6.6 and t[part][-1] - t[part][0] == pytest.approx(1.0, abs=0.01)
    assert figures.window(Trace("a", t[:50], t[:50], before[:50], before[:50], 0.0)) == slice(None)


def test_a_run_is_drawn_in_micrometres_of_the_table() -> None:
    run = figures.largest_trace(FOUND["effects"])
    assert run is not None and run.file == "held-sine-2.4hz-1.csv"
    above, below = figures.trace(run, FOUND["effects"]).axes
    assert above.get_ylabel() == "reference [mm]" and below.get_ylabel().endswith("[µm]")
    part = figures.window(run)
    before, reference = (np.asarray(axes.lines[0].get_ydata()) for axes in (below, above))
    np.testing.assert_allclose(before, run.before[part] / MICRON, rtol=1e-9)
    np.testing.assert_allclose(reference, 1e3 * PER_UNIT * run.reference[part], rtol=1e-9)


def test_a_coordinate_is_drawn_as_travel() -> None:
    speed = figures.coordinate_scale("speed", np.array([60.0]), FOUND["effects"])
    assert speed.unit == "mm/s" and speed.factor == pytest.approx(1e3 * PER_UNIT)
    turn = figures.coordinate_scale("position_mod_pitch", np.array([1.0]), FOUND["effects"])
    assert turn.unit == "deg of the motor" and turn.factor == pytest.approx(180.0 / math.pi)


def test_coordinates_stand_largest_first() -> None:
    rows = (Coordinate("time", 0.02), Coordinate("speed", 0.8), Coordinate("direction", 0.4))
    (axes,) = figures.coordinates(found("effects", coordinates=rows)).axes
    assert [label.get_text() for label in axes.get_yticklabels()] == ["time", "direction", "speed"]  # from below
