"""The page in a browser: Debian's chromium, a service on a virtual drive, and whoever looks at it."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stagectl.recording.hdf5 import open_recording
from stagectl.web import assets
from tests.service.serving import Served, free_port, served, within

playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed: pip install playwright")
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
pytestmark = [
    pytest.mark.skipif(CHROMIUM is None, reason="no chromium: apt-get install chromium"),
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
]
PORT = free_port()
PATIENCE = 60_000.0  # ms: the machine is shared
SHOTS = os.environ.get("STAGECTL_SCREENSHOTS")  # a folder, for who wants to look


@pytest.fixture(scope="module")
def machine(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    with served(tmp_path_factory.mktemp("page"), "--tcp", f"127.0.0.1:{PORT}") as service:
        end = time.monotonic() + 30.0
        while assets.available() is None and time.monotonic() < end:
            time.sleep(0.2)
        yield service


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with playwright.sync_playwright() as driver:
        chromium = driver.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox", "--disable-gpu"])
        yield chromium
        chromium.close()


class Viewed:
    """One page, with everything that went wrong in it."""

    def __init__(self, browser: Any, machine: Served, key: str = "key", **context: Any) -> None:
        self.context = browser.new_context(**{"viewport": {"width": 1280, "height": 900}, **context})
        self.page = self.context.new_page()
        self.page.set_default_timeout(PATIENCE)
        self.wrong: list[str] = []
        self.page.on("pageerror", lambda error: self.wrong.append(f"{error}: {error.stack}"))
        secret = (machine.folder / "state" / key).read_text().strip() if key else ""
        self.page.goto(f"http://127.0.0.1:{PORT}/#{secret}" if secret else f"http://127.0.0.1:{PORT}/")

    def live(self) -> Any:
        self.until("#link", "live")
        return self.page

    def until(self, selector: str, words: str | re.Pattern[str]) -> None:
        playwright.expect(self.page.locator(selector)).to_contain_text(words, timeout=PATIENCE)

    def shot(self, name: str) -> None:
        if SHOTS:
            self.page.screenshot(path=str(Path(SHOTS) / f"{name}.png"), full_page=True)

    def end(self) -> None:
        self.context.close()
        assert self.wrong == []


@pytest.fixture
def view(browser: Any, machine: Served) -> Iterator[Any]:
    """``view(key=..., ...)``: a page; those of a test are closed after it, and must have had no error."""
    opened: list[Viewed] = []

    def show(key: str = "key", **context: Any) -> Viewed:
        opened.append(Viewed(browser, machine, key, **context))
        return opened[-1]

    yield show
    for page in opened:
        page.end()


@pytest.fixture(autouse=True)
def ready(machine: Served) -> None:
    """Each test begins with an axis that stands under power."""
    machine.until(lambda axis: axis["state"] != "connecting")
    if machine.axis()["state"] in ("fault", "offline"):
        machine.ask("POST", "faults/reset")
    machine.ask("POST", "stop")
    if machine.axis()["state"] != "standing":
        machine.ask("POST", "enable")


def test_orders_by_keyboard(view: Any, machine: Served) -> None:
    """A move that is typed, begun by Enter, stopped by Escape; what is refused is told in the service's words."""
    shown = view()
    page = shown.live()
    page.focus("#move-how")
    page.keyboard.press("b")  # by
    page.keyboard.press("Tab")
    page.keyboard.type("20 mm")
    page.keyboard.press("Tab")
    page.keyboard.type("2 mm/s")
    page.keyboard.press("Enter")
    shown.until("#state", "moves")
    assert page.is_disabled("#enable") and page.is_enabled("#stop") and page.is_hidden("#unpowered")
    page.keyboard.press("Escape")
    shown.until("#state", "holds its position")
    assert machine.axis()["fault"] == ""
    page.fill("#move-value", "900 mm")
    page.click("#move button")
    shown.until("#said", "limits.travel")
    page.click("#disable")
    shown.until("#state", "without power")
    assert page.is_disabled("#move button") and page.is_enabled("#enable") and page.is_visible("#unpowered")


def place(machine: Served) -> float:
    """The reference (m)."""
    return float(machine.heard()["reference"])


def rests(machine: Served) -> bool:
    """Whether the axis stands, and its reference stays where it is."""
    machine.until(lambda axis: axis["state"] == "standing", 5.0)
    before = place(machine)
    time.sleep(0.6)
    return place(machine) == before and machine.axis()["fault"] == ""


def press(machine: Served, down: Callable[[], object], up: Callable[[], object]) -> float:
    """Hold what jogs until the axis has gone 0.5 mm, and go on holding it; how far (m) it went.

    A sign that a busy computer sends too late ends the press, as it should: press again.
    """
    before = place(machine)
    for _ in range(20):
        down()
        if within(3.0, lambda: abs(place(machine) - before) > 0.5e-3):
            return place(machine) - before
        up()
    raise AssertionError(machine.axis())


RELEASES: dict[str, Callable[[Any], object]] = {
    "the button is let go": lambda shown: shown.page.mouse.up(),
    "the window loses the focus": lambda shown: shown.page.evaluate("window.dispatchEvent(new Event('blur'))"),
    "the page is hidden": lambda shown: shown.page.evaluate(
        "Object.defineProperty(document, 'hidden', {value: true});document.dispatchEvent(new Event('visibilitychange'))"
    ),
    "the network fails": lambda shown: shown.context.set_offline(True),
    "the page is closed": lambda shown: shown.page.close(),
    "Escape": lambda shown: shown.page.keyboard.press("Escape"),
}


@pytest.mark.parametrize("how", RELEASES)
def test_a_jog_ends_when(view: Any, machine: Served, how: str) -> None:
    shown = view()
    page = shown.live()
    page.fill("#jog-speed", "2 mm/s")
    playwright.expect(page.locator("#jog-forth")).to_be_enabled(timeout=PATIENCE)
    page.hover("#jog-forth")
    assert press(machine, page.mouse.down, page.mouse.up) > 0.0
    RELEASES[how](shown)
    assert rests(machine)


def test_a_jog_by_keyboard(view: Any, machine: Served) -> None:
    """Space on the focused button; as the key goes up the axis stands, and other keys move nothing."""
    shown = view()
    page = shown.live()
    playwright.expect(page.locator("#jog-back")).to_be_enabled(timeout=PATIENCE)
    page.focus("#jog-back")
    page.keyboard.press("ArrowLeft")
    assert rests(machine)
    for _ in range(2):  # the button keeps the focus while the axis brakes
        assert press(machine, lambda: page.keyboard.down(" "), lambda: page.keyboard.up(" ")) < 0.0
        page.keyboard.up(" ")
        assert rests(machine)


def test_a_jog_by_touch(view: Any, machine: Served) -> None:
    """A finger on a small screen; it moves as long as the finger lies there."""
    shown = view(has_touch=True, is_mobile=True, viewport={"width": 390, "height": 844})
    page = shown.live()
    playwright.expect(page.locator("#jog-forth")).to_be_enabled(timeout=PATIENCE)
    touch = shown.context.new_cdp_session(page)

    def down() -> None:
        page.evaluate("document.getElementById('jog-forth').scrollIntoView({block: 'center'})")
        box = page.locator("#jog-forth").bounding_box()  # what the page says meanwhile may move it
        assert box["height"] >= 44.0 and box["width"] >= 44.0  # as large as a finger
        point = {"x": box["x"] + box["width"] / 2.0, "y": box["y"] + box["height"] / 2.0}
        touch.send("Input.dispatchTouchEvent", {"type": "touchStart", "touchPoints": [point]})

    def up() -> None:
        touch.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})

    assert press(machine, down, up) > 0.0
    shown.shot("jog-390")
    up()
    assert rests(machine)


def test_a_jog_that_is_refused_is_told(view: Any, machine: Served) -> None:
    shown = view()
    page = shown.live()
    page.fill("#jog-speed", "900 mm/s")
    playwright.expect(page.locator("#jog-forth")).to_be_enabled(timeout=PATIENCE)
    page.focus("#jog-forth")
    page.keyboard.down(" ")
    shown.until("#said", "take a lower speed")
    page.keyboard.up(" ")
    assert machine.heard()["state"] == "standing"


def test_who_may_only_read_sees_no_buttons(view: Any) -> None:
    shown = view("token")
    page = shown.live()
    assert page.is_hidden("#orders") and page.is_hidden("#record")
    assert page.is_visible("#reading") and page.is_visible("#strip-error canvas")
    answer = page.evaluate(
        "fetch('/v1/enable', {method: 'POST', headers: {Authorization: 'Bearer ' + sessionStorage['stagectl-key']}})"
        ".then(found => found.status)"
    )
    assert answer == 403
    assert "#" not in page.url  # the key is not left in the address


def test_without_a_key_it_asks_for_one(view: Any, machine: Served) -> None:
    shown = view("")
    page = shown.page
    page.wait_for_selector("#door:not([hidden])")
    assert page.is_hidden("#content")
    page.fill("#door-key", "x" * 43)
    page.keyboard.press("Enter")
    shown.until("#door-words", "is wrong")
    page.fill("#door-key", (machine.folder / "state" / "token").read_text().strip())
    page.keyboard.press("Enter")
    assert shown.live().is_visible("#strips")


@pytest.mark.parametrize(("scheme", "width"), [("light", 1280), ("dark", 390)])
def test_it_is_whole_on_every_screen(view: Any, machine: Served, scheme: str, width: int) -> None:
    """Painted within a second, nothing beyond the edge, curves in the colours of the theme."""
    machine.ask("POST", "trajectory", yaml="{type: sine, amplitude: 1 mm, frequency: 1 Hz, periods: 60}", wait=False)
    shown = view(color_scheme=scheme, viewport={"width": width, "height": 850})
    page = shown.live()
    shown.until("#state", "moves")
    amber = (
        "() => {const c = document.querySelector('#strip-error canvas'), d = c.getContext('2d')"
        ".getImageData(0, 0, c.width, c.height).data; let n = 0;"
        "for (let k = 0; k < d.length; k += 4) if (d[k + 3] > 200 && d[k] > 200 && d[k + 2] < 100) n++; return n}"
    )
    assert within(30.0, lambda: page.evaluate(amber) > 20)  # the error's amber, in either theme
    shown.shot(f"{scheme}-{width}")
    page.evaluate("document.querySelectorAll('details').forEach((part) => { part.open = true; })")
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    assert page.locator(".plot canvas").count() == 4
    shown.until("#position", re.compile(r"-?\d+\.\d{5} mm"))
    shown.until("#late", re.compile(r"\d+ of \d+ cycles late"))
    shown.until("#bus", re.compile(r"Bus load \d+ %"))
    machine.ask("POST", "stop")


def test_first_paint(view: Any) -> None:
    """Without the browser's own start, which is not ours; the quickest of some: the machine is shared."""
    shown = view()
    shown.live()
    paints = []
    for _ in range(5):
        shown.page.reload()
        shown.live()
        paints += shown.page.evaluate(
            "performance.getEntriesByName('first-contentful-paint').map(one => one.startTime)"
        )
    assert len(paints) == 5 and 0.0 < min(paints) <= 1000.0


def test_the_scope_triggers_zooms_and_saves(view: Any, machine: Served, tmp_path: Path) -> None:
    machine.ask("POST", "trajectory", yaml="{type: sine, amplitude: 1 mm, frequency: 1 Hz, periods: 60}", wait=False)
    shown = view()
    page = shown.live()
    page.click("#scope-picks summary")
    for channel in ("reference", "measured", "current", "state"):
        page.check(f"#scope-channels label:text-is('{channel}') input")
    page.select_option("#scope-source", "current")
    page.fill("#scope-level", "0.5 A")
    page.select_option("#scope-mode", "normal")
    page.fill("#scope-span", "0.3")
    page.keyboard.press("Tab")
    page.click("#scope-single")
    shown.until("#scope-state", "captured")
    assert page.inner_text("#scope-count") == "6"
    assert page.locator("#readout tbody tr").count() == 6
    page.select_option("#scope-lanes", "lanes")
    page.focus("#cursor-a")
    before = page.inner_text("#readout thead")
    page.keyboard.press("ArrowRight")
    playwright.expect(page.locator("#readout thead")).not_to_have_text(before)
    shown.shot("scope")
    with page.expect_download() as caught:
        page.click("#save-csv")
    caught.value.save_as(tmp_path / "scope.csv")
    head, *lines = (tmp_path / "scope.csv").read_text().splitlines()
    assert head == "time_s,error_m,measured_current_A,reference_m,measured_m,current_A,state"
    rows = np.array([[float(number) for number in line.split(",")] for line in lines])
    assert np.allclose(np.diff(rows[:, 0]), 5e-4)
    place = int(np.argmin(np.abs(rows[:, 0])))
    assert rows[place - 1, 5] < 0.5 <= rows[place, 5]  # the trigger is at 0
    page.click("#zoom")
    page.click("#scope-channels label:text-is('late') input")
    page.fill("#scope-level", "1 kg")
    page.keyboard.press("Tab")
    shown.until("#scope-state", "must be a number in A")
    machine.ask("POST", "stop")


def test_the_scope_shows_a_spectrum(view: Any, machine: Served) -> None:
    """The highest line of the position lies at the frequency of the motion, as high as its amplitude."""
    machine.ask(
        "POST", "trajectory", yaml="{type: sine, amplitude: 1 mm, frequency: 4.8828125 Hz, periods: 600}", wait=False
    )
    shown = view()
    page = shown.live()
    shown.until("#state", "moves")
    page.click("#scope-picks summary")
    page.uncheck("#scope-channels label:text-is('error') input")
    page.check("#scope-channels label:text-is('measured') input")
    page.uncheck("#scope-channels label:text-is('measured current') input")
    page.fill("#scope-span", "4.096")
    page.select_option("#scope-view", "frequency")
    highest = page.locator("#readout tbody td").nth(5)

    def amplitude() -> float:
        number, unit = highest.inner_text().split()
        return float(number) * {"mm": 1.0, "µm": 1e-3}[unit]

    page.wait_for_timeout(9000)  # until a capture holds nothing of the beginning; longer on a busy computer
    assert within(30.0, lambda: amplitude() == pytest.approx(1.0, rel=0.02)), amplitude()  # 20 periods in 8192 rows
    shown.shot("spectrum")
    page.click("#scope-run")
    assert page.is_hidden("#zoom") and "Hz" in page.inner_text("#readout thead")
    ranged = "import('/page/views.js').then(({ VIEWS }) => VIEWS.frequency.range(9.963e-10, 9.963e-4))"
    assert page.evaluate(ranged)[0] == 1e-10  # from just below a decade on uPlot has ticks without end
    machine.ask("POST", "stop")


@pytest.mark.parametrize(("scheme", "width"), [("light", 1280), ("dark", 390)])
def test_the_scope_shows_the_error_over_the_position(view: Any, machine: Served, scheme: str, width: int) -> None:
    machine.ask("POST", "trajectory", yaml="{type: sine, amplitude: 1 mm, frequency: 1 Hz, periods: 60}", wait=False)
    shown = view(color_scheme=scheme, viewport={"width": width, "height": 850})
    page = shown.live()
    page.fill("#scope-span", "1")
    page.select_option("#scope-view", "place")
    rows = page.locator("#readout tbody tr")
    playwright.expect(rows).to_have_count(3, timeout=PATIENCE)  # the position is taken with the two that were chosen
    assert width < 900 or within(30.0, lambda: " mm" in page.inner_text("#readout thead"))
    shown.shot(f"place-{scheme}-{width}")
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    table = page.locator("#readout").bounding_box()
    assert table["x"] + table["width"] <= width  # the cursors' values are all on the screen
    machine.ask("POST", "stop")


def test_a_layout_of_the_scope_is_kept(view: Any) -> None:
    """By this browser: it is there after a reload, and goes when it is deleted."""
    shown = view()
    page = shown.live()
    page.click("#layout-form button:text('Keep layout')")
    shown.until("#scope-state", "a name first")
    page.fill("#scope-span", "0.25")
    page.select_option("#scope-source", "current")
    page.click("#scope-picks summary")
    page.check("#scope-channels label:text-is('late') input")
    page.fill("#layout-name", "currents")
    page.keyboard.press("Enter")
    page.reload()
    shown.live()
    assert page.input_value("#scope-span") == "0.5"
    page.select_option("#layout", "currents")
    assert page.input_value("#scope-span") == "0.25" and page.input_value("#scope-source") == "current"
    assert page.inner_text("#scope-count") == "3"
    page.click("#layout-drop")
    assert page.locator("#layout option").count() == 1


def test_a_trigger_that_cannot_come_and_an_empty_save_are_told(view: Any) -> None:
    shown = view()
    page = shown.live()
    page.select_option("#scope-mode", "normal")
    page.select_option("#scope-source", "current")
    page.fill("#scope-level", "50 A")
    page.keyboard.press("Tab")
    shown.until("#scope-state", "so far current lies between")
    page.reload()
    shown.live()
    page.evaluate("document.getElementById('scope-mode').value = 'normal'")
    page.click("#scope-picks summary")
    page.uncheck("#scope-channels label:text-is('error') input")
    page.uncheck("#scope-channels label:text-is('measured current') input")
    shown.until("#scope-state", "at least one channel")


@pytest.mark.parametrize(("scheme", "width"), [("light", 1280), ("dark", 390)])
def test_axes_read_well_at_rest(view: Any, machine: Served, scheme: str, width: int) -> None:
    """Far from 0 the ticks count from an offset that is told; nothing is smaller than what the axis can tell."""
    machine.ask("POST", "move", to={"axis": "9.99995 mm"}, speed="20 mm/s")
    shown = view(color_scheme=scheme, viewport={"width": width, "height": 850})
    page = shown.live()
    page.wait_for_timeout(11_000)  # until the move has left the picture
    shown.until("#strip-position-title", re.compile(r"\[nm\] from 9\.9999\d* mm"))
    shown.until("#error", re.compile(r"^-?\d+\.\d nm$"))
    shown.shot(f"rest-{scheme}-{width}")
    assert "e-" not in page.inner_text("#scope") and "e-" not in page.inner_text("#now")


def test_a_recording_is_made_and_fetched(view: Any, machine: Served, tmp_path: Path) -> None:
    shown = view()
    page = shown.live()
    page.fill("#record-name", "first one")
    page.fill("#record-before", "0.2")
    page.keyboard.press("Enter")
    shown.until("#recording", "recording first one.h5")
    page.click("#sine button")
    shown.until("#state", "moves")
    page.wait_for_timeout(1000)
    page.click("#record-button")
    page.wait_for_selector("#files button[aria-label='Download first one.h5 as h5']")
    with page.expect_download() as caught:
        page.click("#files button[aria-label='Download first one.h5 as h5']")
    caught.value.save_as(tmp_path / "one.h5")
    recording = open_recording(tmp_path / "one.h5")
    assert recording.complete and recording.lost_rows == 0
    time_ = recording.column("time")
    assert np.allclose(np.diff(time_), 5e-4)
    assert recording.meta["steady"] == pytest.approx([time_[0], time_[-1] + 5e-4])
    with page.expect_download() as caught:
        page.click("#files button[aria-label='Download first one.h5 as csv']")
    caught.value.save_as(tmp_path / "one.csv")
    assert len((tmp_path / "one.csv").read_text().splitlines()) == len(time_) + 1
    page.fill("#record-name", "first one")
    page.click("#record-button")
    shown.until("#recording", "exists already")
    machine.ask("POST", "stop")


def test_gains_are_changed_while_it_stands(view: Any, machine: Served) -> None:
    """Without a jump of the current; what the design refuses is told, and changes nothing."""
    shown = view()
    page = shown.live()
    page.click("#gains summary")
    field = page.locator("#gains-fields input[name=bandwidth]")
    playwright.expect(field).to_have_value("40 Hz", timeout=PATIENCE)
    field.fill("35 Hz")
    page.keyboard.press("Enter")
    shown.until("#gains-said", "in force")
    assert machine.ask("GET", "parameters")["axis"]["bandwidth"] == 35.0
    assert machine.heard()["state"] == "standing" and abs(machine.heard()["error"]) < 1e-6
    field.fill("400 Hz")
    page.keyboard.press("Enter")
    shown.until("#gains-said", "margin")
    assert machine.ask("GET", "parameters")["axis"]["bandwidth"] == 35.0
    machine.ask("PATCH", "parameters", control={"bandwidth": "40 Hz"})


def test_a_trajectory_file_is_followed(view: Any, machine: Served, tmp_path: Path) -> None:
    """With the table that it names; a choice without a trajectory is refused at once."""
    (tmp_path / "steps.csv").write_text(
        "time_s,reference_mm\n" + "".join(f"{k * 0.01},{0.5 - 0.5 * np.cos(k * 0.01)}\n" for k in range(629))
    )
    (tmp_path / "steps.yaml").write_text("type: csv\nfile: steps.csv\n")
    shown = view()
    page = shown.live()
    page.click("text=Trajectory file")
    page.set_input_files("#file", [tmp_path / "steps.csv"])
    page.click("#file-form button")
    shown.until("#file-said", "choose one trajectory file")
    page.set_input_files("#file", [tmp_path / "steps.yaml", tmp_path / "steps.csv"])
    page.click("#file-form button")
    shown.until("#file-said", "follows steps")
    shown.until("#state", "moves")
    machine.ask("POST", "stop")


def test_the_virtual_drive_fails_when_it_is_told_to(view: Any, machine: Served, tmp_path: Path) -> None:
    """A fault by its name; the axis ends in it, and the black box names its machine and comes as MCAP."""
    shown = view()
    page = shown.live()
    page.click("#faulty summary")
    page.select_option("#inject-fault", "drive-fault")
    shown.until("#inject-words", "trips")
    page.fill("#inject-parameters", "duration=1 kg")
    page.click("#inject button:text('Inject')")
    shown.until("#inject-said", "duration")
    page.fill("#inject-parameters", "")
    page.click("#inject button:text('Inject')")
    shown.until("#state", "fault")
    shown.shot("fault")
    page.click("#inject-clear")
    shown.until("#inject-said", "no fault acts")
    shown.until("#files", "black box of ball-screw stage A")
    with page.expect_download() as caught:
        page.locator("#files li:has-text('black box') button:text('mcap')").first.click()
    caught.value.save_as(tmp_path / "box.mcap")
    assert re.fullmatch(r"ball-screw-stage-A-axis-\d{8}-\d{6}-[a-z_]+(-\d+)?\.mcap", caught.value.suggested_filename)
    assert (tmp_path / "box.mcap").read_bytes().startswith(b"\x89MCAP")


def test_late_cycles_are_explained(view: Any, machine: Served) -> None:
    """Where they are counted: a loop that is held up for 50 ms has been late."""
    os.kill(machine.child("stagectl.realtime.axes"), signal.SIGSTOP)
    time.sleep(0.05)
    os.kill(machine.child("stagectl.realtime.axes"), signal.SIGCONT)
    shown = view()
    page = shown.live()
    page.click("#why-late summary")
    shown.until("#why-late", "stagectl doctor")
    shown.until("#late-virtual", "do not disturb")


def test_it_comes_back_after_the_service(view: Any, machine: Served) -> None:
    """The real-time process dies, then the service: the page says so, and goes on by itself with the same key."""
    shown = view()
    page = shown.live()
    machine.kill("stagectl.realtime.axes")
    shown.until("#faults", "process died")
    shown.until("#position", "not known")
    shown.shot("died")
    assert machine.process is not None
    machine.process.send_signal(signal.SIGTERM)
    machine.process.wait(60)
    shown.until("#link", "does not answer")
    shown.until("#state", "emergency stop")
    shown.until("#position", "not known")
    page.click("#stop")
    shown.until("#said", "emergency stop")
    shown.shot("gone")
    machine.start()
    shown.live()
    machine.ask("POST", "enable")
    shown.until("#state", "holds its position")
    assert page.is_visible("#orders")


def test_the_terminal_gives_the_address(machine: Served) -> None:
    (key,) = ((machine.folder / "state" / name).read_text().strip() for name in ("key",))
    assert machine.ask("POST", "page") == {"address": f"http://127.0.0.1:{PORT}/#{key}"}
    assert json.loads(json.dumps(machine.ask("GET", "me"))) == {"read": True, "move": True}
