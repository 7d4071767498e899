"""The page as a browser shows it: Debian's chromium, no network."""

import shutil
import threading
import time
from contextlib import contextmanager
from types import SimpleNamespace

import pytest

from windsysid.live.page.access import Access
from windsysid.live.page.app import app, streams_of
from windsysid.live.sources.folder import FolderSource
from windsysid.live.sources.replay import Replay
from windsysid.live.sources.source import SourceState
from windsysid.live.store import open_store
from windsysid.live.store.contents import Commit

from . import sample

PATIENCE = 60_000  # ms
CHROMIUM = shutil.which("chromium")

pytest.importorskip("playwright", reason="playwright is not installed")
uvicorn = pytest.importorskip("uvicorn", reason="the page needs the extra live")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="there is no chromium: apt-get install chromium")


@contextmanager
def serving(page):
    """The address of a page that is served until the end."""
    config = uvicorn.Config(page, host="127.0.0.1", port=0, log_level="error", timeout_graceful_shutdown=2)
    server = uvicorn.Server(config)
    thread = threading.Thread(target=server.run)
    thread.start()
    until = time.monotonic() + 60.0
    while not server.started and time.monotonic() < until:
        time.sleep(0.02)
    yield f"http://127.0.0.1:{server.servers[0].sockets[0].getsockname()[1]}"
    streams_of(page).close()
    server.should_exit = True
    thread.join(30.0)
    assert not thread.is_alive()  # an open stream does not keep a server that was told to end


@pytest.fixture(scope="module")
def store():
    store = open_store(":memory:")
    sample.fill(store, days=0.5)
    yield store
    store.close()


@pytest.fixture(scope="module")
def served(store):
    """A store, and the address of its page."""
    with serving(app(store)) as address:
        yield store, address


@pytest.fixture(scope="module")
def browser():
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox", "--disable-gpu"])
        yield browser
        browser.close()


@pytest.fixture
def tab(browser):
    """A tab in which anything that goes wrong is told: scripts' errors, what the policy refused, requests elsewhere."""
    wrong = []
    context = browser.new_context(viewport={"width": 390, "height": 800})
    tab = context.new_page()
    tab.set_default_timeout(PATIENCE)
    tab.on("pageerror", lambda error: wrong.append(str(error)))
    tab.on("console", lambda said: wrong.append(said.text) if said.type == "error" else None)
    tab.on("request", lambda asked: None if "//127.0.0.1:" in asked.url else wrong.append(asked.url))
    yield tab
    context.close()
    assert not wrong


def test_an_event_updates_the_page_and_an_operator_acknowledges(served, tab):
    store, address = served
    tab.goto(address)
    tab.get_by_role("link", name="T02").wait_for()
    tab.get_by_text("live", exact=True).wait_for()
    fresh = sample.alarms(0, 100)[0]._replace(
        key="T01/k_side_side/2", turbine="T01", about="k_side_side", text="k_side_side fell by 5 %: <img src=x>"
    )
    store.submit(Commit(alarms=[fresh])).result(60)
    tab.locator("#announcement", has_text="New alarm of T01: k_side_side fell by 5 %: <img src=x>").wait_for(
        state="attached"
    )
    tab.goto(f"{address}/#/alarms")
    tab.get_by_role("button", name="Acknowledge stiffness, side-side of T01").click()
    tab.get_by_label("Your name").fill("A. Nord")
    tab.get_by_role("dialog").get_by_role("button", name="Acknowledge").click()
    tab.get_by_text("Acknowledged by A. Nord").wait_for()
    [known] = [one for one in store.alarms() if one.key == fresh.key]
    assert known.by == "A. Nord"
    assert tab.locator("img").count() == 0


def test_every_chart_has_its_table_and_fits_a_phone(served, tab):
    _, address = served
    tab.goto(f"{address}/#/turbine/T02")
    tab.locator("figure canvas").first.wait_for()
    figures = tab.locator("figure")
    for i in range(figures.count()):
        assert "The table below" in (figures.nth(i).locator("[role=img]").get_attribute("aria-label") or "")
        figures.nth(i).locator("summary").click()
        figures.nth(i).locator("tbody tr").nth(10).wait_for()  # the table is filled after it was opened
    assert tab.evaluate("document.documentElement.scrollWidth") <= 390
    tab.get_by_role("button", name="6 h").press("Enter")
    tab.locator("#range-0[aria-pressed=true]").wait_for()
    rows = tab.locator("#stiffness-and-damping figure").first.locator("tbody tr").count()
    assert 30 <= rows <= 40


def test_panels_are_arranged_and_folded_by_keyboard_and_stay_so(served, tab):
    _, address = served
    tab.goto(f"{address}/#/turbine/T01")
    tab.locator("figure canvas").first.wait_for()
    names = "[...document.querySelectorAll('.panel')].map((one) => one.dataset.panel)"
    assert tab.evaluate(names)[:3] == ["spectrum", "waterfall", "stiffness-and-damping"]
    tab.get_by_role("button", name="Move Stiffness and damping up").press("Enter")
    tab.locator("#status", has_text="Stiffness and damping: panel 2 of").wait_for(state="attached")
    assert tab.evaluate("document.activeElement.getAttribute('aria-label')") == "Move Stiffness and damping up"
    tab.locator("#waterfall-title").press("Enter")
    tab.locator("#waterfall:not([open])").wait_for()
    tab.reload()
    tab.locator("figure canvas").first.wait_for()
    assert tab.evaluate(names)[:3] == ["spectrum", "stiffness-and-damping", "waterfall"]
    assert tab.locator("#waterfall").get_attribute("open") is None


def test_plots_zoom_by_keyboard_overlay_conditions_and_are_saved(served, tab):
    _, address = served
    tab.goto(f"{address}/#/turbine/T02")
    chart = tab.locator("#stiffness-and-damping figure").first
    chart.locator("canvas").wait_for()
    chart.locator(".plot-canvas").press("+")  # its range is read again, for all charts
    tab.locator("#range-0[aria-pressed=false]").wait_for()
    tab.get_by_label("Overlay on the charts").select_option("rotor_speed")
    chart.get_by_role("button", name="rotor speed").wait_for()
    with tab.expect_download() as saved:
        chart.get_by_role("button", name="Save the shown values as CSV").press("Enter")
    lines = saved.value.path().read_text(encoding="utf-8").splitlines()
    assert lines[0].startswith('time [UTC],"window, [MN/m]"')
    assert lines[0].endswith(",rotor speed [rpm]")
    assert lines[1][10] == "T"
    with tab.expect_download() as saved:
        tab.locator("#waterfall").get_by_role("button", name="Save the picture as PNG").press("Enter")
    assert saved.value.path().read_bytes()[:4] == b"\x89PNG"
    tab.get_by_role("button", name="◀ earlier").last.press("Enter")
    tab.locator("#spectrum-newest:not([disabled])").wait_for()


def test_a_page_says_that_equations_are_compiled_and_what_a_source_lacks(store, tab):
    seconds: dict[str, float] = {}
    state = SimpleNamespace(turbines={}, samples=0, rate=0.0, seconds=seconds, compiling=True)
    source = FolderSource("/nowhere", "T01")
    source.state = SourceState("failed", "it is <b>broken</b>")
    over = Replay("record.nc", "T01")
    over.state = SourceState("ended")
    with serving(app(store, SimpleNamespace(state=lambda: state), sources=[source, over])) as address:
        tab.goto(address)
        tab.get_by_text("A source has ended; its estimates remain. replay of").wait_for()
        tab.get_by_text("Equations are being compiled").wait_for()
        tab.get_by_text("folder /nowhere of T01: it is <b>broken</b>").wait_for()


def test_a_reader_finds_the_way_by_keyboard(served, tab):
    _, address = served
    tab.goto(address)
    tab.get_by_role("link", name="T02").wait_for()
    tab.keyboard.press("Tab")
    assert tab.evaluate("document.activeElement.textContent") == "Skip to the content"
    tab.keyboard.press("Enter")
    tab.wait_for_function("document.activeElement.id === 'main'")
    tab.keyboard.press("Tab")
    tab.wait_for_function("document.activeElement.id === 'turbine-T02'")
    tab.keyboard.press("Enter")
    tab.get_by_role("heading", level=1, name="T02").wait_for()


def test_a_reader_logs_in_by_the_form_and_out_again(store, browser):
    with serving(app(store, access=Access("r" * 20, "o" * 20))) as address:
        tab = browser.new_page()
        tab.set_default_timeout(PATIENCE)
        tab.goto(address)
        for token in ("x" * 20, "r" * 20):
            tab.get_by_label("Token").fill(token)
            tab.get_by_role("button", name="Log in").click()
            if token.startswith("x"):
                tab.get_by_text("Unknown token.").wait_for()
        tab.get_by_role("link", name="T02").wait_for()
        tab.get_by_role("link", name="Alarms").click()
        tab.get_by_text("Acknowledging requires the operator's token.").first.wait_for()
        assert tab.get_by_role("button", name="Acknowledge").count() == 0
        tab.get_by_role("button", name="Log out").click()
        tab.get_by_label("Token").wait_for()
        tab.close()
