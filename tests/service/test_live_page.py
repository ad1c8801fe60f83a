"""The live page in a browser before a real server: runs started, watched, left and found again."""

import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from contextlib import contextmanager
from dataclasses import replace
from urllib.parse import urlsplit

import pytest

pytest.importorskip("fastapi")
pytest.importorskip("httpx")
pytest.importorskip("playwright.sync_api", reason="playwright is not installed")

import httpx
from playwright import sync_api
from tests.measuring.conftest import PlateDriver, plate_exposure_plan

from exposight.measuring import measure_adaptively
from exposight.planning import write_exposure_plan
from exposight.plans import write_plan

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
ARGUMENTS = [
    "--no-sandbox", "--disable-background-networking", "--disable-component-update",
    "--disable-sync", "--no-first-run", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
]  # fmt: skip
TOKEN = "a-token-of-many-letters"
LOOPBACK = {"127.0.0.1", "localhost"}
TOUCH_PX = 44


class Server:
    """``exposight serve`` as a process that can be killed and begun again at the same address."""

    def __init__(self, folder, log, token=None):
        with socket.create_server(("127.0.0.1", 0)) as free:
            self.port = free.getsockname()[1]
        self.url, self._folder, self._log = f"http://127.0.0.1:{self.port}", folder, log
        self._environment = {**os.environ, **({"EXPOSIGHT_TOKEN": token} if token else {})}
        self._headers = {"Authorization": f"Bearer {token}"} if token else {}
        self.process = None

    def start(self):
        command = [sys.executable, "-m", "exposight", "serve", str(self._folder)]
        command += ["--port", str(self.port), "--workers", "1"]
        with self._log.open("ab") as log:
            self.process = subprocess.Popen(
                command, stdout=log, stderr=log, env=self._environment, start_new_session=True
            )
        deadline = time.monotonic() + 60
        while not self._answers():
            assert self.process.poll() is None, self._log.read_text()
            assert time.monotonic() < deadline, self._log.read_text()
            time.sleep(0.05)

    def _answers(self):
        try:
            return httpx.get(f"{self.url}/v1/health", headers=self._headers).is_success
        except httpx.TransportError:
            return False

    def kill(self):
        """Kill all of it at once, as a power cut would."""
        os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait(20)

    def stop(self):
        self.process.terminate()
        self.process.wait(20)


@pytest.fixture(scope="module")
def folder(tmp_path_factory, sheet_plan, scene):
    """A plate's plan and recording, and a sheet that the simulated cell measures in seconds."""
    folder = tmp_path_factory.mktemp("live")
    plan = plate_exposure_plan()
    write_exposure_plan(folder / "plan.json", plan)
    measure_adaptively(plan, PlateDriver(light=0.1), folder / "recorded", models=None)
    shutil.copytree(scene, folder / "scene")
    simulated = {**sheet_plan.simulated, "scene": "scene", "rings_only": True}
    for name, exposures_ms in (("sheet", (30.0, 90.0, 330.0)), ("long", range(30, 330, 25))):
        times_ms = tuple(map(float, exposures_ms))
        plane = replace(sheet_plan.planes[0], exposures_ms=times_ms)
        plan = replace(sheet_plan, planes=(plane,), simulated=simulated)
        write_plan(folder / f"{name}.toml", plan)
    return folder


@contextmanager
def serving(folder, log, token=None):
    server = Server(folder, log, token)
    server.start()
    try:
        yield server
    finally:
        server.stop()


@pytest.fixture(scope="module")
def server(folder, tmp_path_factory):
    with serving(folder, tmp_path_factory.mktemp("log") / "server.log") as started:
        yield started


@pytest.fixture(scope="module")
def plate_run(server):
    """A finished run of the plate, which is too dark for two of its holes."""
    driver = {"kind": "replay", "recording": "recorded"}
    request = {"name": "plate", "plan": "plan.json", "driver": driver, "clouds": False}
    assert httpx.post(f"{server.url}/v1/runs", json=request).status_code == 201
    deadline = time.monotonic() + 30
    while (state := httpx.get(f"{server.url}/v1/runs/plate").json())["state"] != "finished":
        assert time.monotonic() < deadline, state
        time.sleep(0.05)
    return state


@pytest.fixture(scope="module")
def browser():
    if CHROMIUM is None:
        pytest.skip("Chromium is not installed (Debian: apt-get install chromium)")
    with sync_api.sync_playwright() as playwright:
        opened = playwright.chromium.launch(executable_path=CHROMIUM, args=ARGUMENTS)
        yield opened
        opened.close()


@pytest.fixture
def visit(browser):
    """Open pages that may ask loopback alone, and whose scripts may not fail."""
    contexts, strangers, faults, allowed = [], [], [], []

    def judge(route):
        address = urlsplit(route.request.url)
        if address.scheme not in {"blob", "data"} and address.hostname not in LOOPBACK:
            strangers.append(route.request.url)
            route.abort()
        else:
            route.continue_()

    def note(message):
        if message.type == "error" and not any(each in message.text for each in allowed):
            faults.append(message.text)

    def opened(url, *, expected=(), **options):
        allowed.extend(expected)
        context = browser.new_context(**{"viewport": {"width": 1440, "height": 900}, **options})
        contexts.append(context)
        context.route("**", judge)
        page = context.new_page()
        page.set_default_timeout(30_000)
        page.on("console", note)
        page.on("pageerror", lambda error: faults.append(str(error)))
        page.goto(url)
        return page

    yield opened
    for context in contexts:
        context.close()
    assert strangers == []
    assert faults == []


def drawn(page, *names):
    for name in names or ("log", "progress", "image", "curve", "part"):
        page.wait_for_selector(f"body[data-{name}]")


def state_is(page, state):
    page.wait_for_selector(f"#state.{state}")


def logged(page):
    """Return the numbers of the events that the log shows, newest first."""
    return page.eval_on_selector_all("#log li", "items => items.map((each) => +each.dataset.seq)")


def whole(log, seq):
    """Tell whether a log has each event once, but for progress, of which the last is shown."""
    return log == sorted(set(log), reverse=True) and log[0] == seq and log[-1] == 1


def begin(page, name, plan):
    page.click("#new")
    page.fill("#start [name=name]", name)
    page.select_option("#start [name=plan]", plan)
    page.click("#start [type=submit]")


def test_a_simulated_run_is_started_paused_left_found_again_and_reported(server, visit):
    page = visit(server.url)
    begin(page, "sheet-1", "sheet.toml")
    page.click("#pause")
    state_is(page, "paused")
    assert "run=sheet-1" in page.url
    page.reload()
    state_is(page, "paused")
    page.click("#continue")
    state_is(page, "finished")
    state = httpx.get(f"{server.url}/v1/runs/sheet-1").json()
    page.wait_for_selector(f'#log li[data-seq="{state["last_seq"]}"]')
    drawn(page)
    assert whole(logged(page), state["last_seq"])
    page.wait_for_selector("#views button:nth-child(3)")
    assert f"{state['n_captures']} captures" in page.inner_text("#verdict")
    with page.expect_navigation():
        page.click("#report")
    assert "sheet" in page.title().lower()


def test_a_finished_run_says_what_failed_and_why(server, plate_run, visit):
    page = visit(f"{server.url}#run=plate")
    drawn(page)
    assert page.inner_text("#verdict") == "2 of 4 features had, 3 captures, 2 failed"
    assert "it reached 0.00, 0.75 is needed" in page.inner_text("#detail")
    rows = page.locator("#features tbody tr")
    assert [row.split("\t")[:2] for row in rows.all_inner_texts()] == [
        ["b1", "had"], ["b2", "had"], ["d1", "failed"], ["d2", "failed"]
    ]  # fmt: skip
    assert page.locator("#camera polygon.ring").count() == 4
    assert page.locator("#curve circle").count() == 2  # of d1 in the near view
    page.click('#views button[data-capture="0"]')
    page.wait_for_selector("#camera svg[aria-label*='near at 1 ms']")
    page.locator('#camera polygon[data-feature="b2"]').click()
    page.wait_for_selector("#curve svg[aria-label^='b2 in near']")


def test_the_keyboard_is_enough(server, plate_run, visit):
    page = visit(f"{server.url}#run=plate&feature=b1")
    drawn(page, "curve")
    for _ in range(40):
        page.keyboard.press("Tab")
        if page.evaluate("document.activeElement.closest('#features tbody tr') !== null"):
            break
    page.keyboard.press("ArrowDown")
    page.wait_for_selector("tr[aria-selected=true] >> text=b2")
    assert page.evaluate("document.activeElement.dataset.name") == "b2"
    page.keyboard.press("End")
    page.wait_for_selector("#curve svg[aria-label^='d2']")
    page.reload()
    page.wait_for_selector("tr[aria-selected=true] >> text=d2")
    page.wait_for_selector("#said:has-text('2 of 4 features had')", state="attached")
    page.focus("#new")
    page.keyboard.press("Enter")
    page.wait_for_selector("#start[open]")
    page.keyboard.press("Escape")
    page.wait_for_selector("#start", state="hidden")


def test_what_happens_while_the_server_is_away_is_caught_up(folder, tmp_path, visit):
    served = shutil.copytree(folder, tmp_path / "served", ignore=shutil.ignore_patterns("runs"))
    with serving(served, tmp_path / "log") as server:
        page = visit(server.url, expected=("ERR_CONNECTION", "ERR_EMPTY_RESPONSE", "ERR_NETWORK"))
        begin(page, "cut", "long.toml")
        page.wait_for_selector("#views button")
        server.kill()
        page.wait_for_selector("#banner:visible")
        server.start()
        page.wait_for_selector("#banner", state="hidden")
        state_is(page, "interrupted")
        page.click("#continue")
        state_is(page, "finished")
        state = httpx.get(f"{server.url}/v1/runs/cut").json()
        page.wait_for_selector(f'#log li[data-seq="{state["last_seq"]}"]')
        assert whole(logged(page), state["last_seq"])


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_a_phone_shows_one_column_that_fingers_can_use(scheme, server, plate_run, visit):
    screen = {"viewport": {"width": 390, "height": 844}, "is_mobile": True, "has_touch": True}
    page = visit(f"{server.url}#run=plate", color_scheme=scheme, **screen)
    drawn(page)
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    small = page.eval_on_selector_all(
        "button, select, a.button, #features tbody tr",
        """(nodes, least) => nodes.map((node) => [node.outerHTML, node.getBoundingClientRect()])
        .filter(([, box]) => box.width && Math.min(box.width, box.height) < least)
        .map(([html]) => html)""",
        TOUCH_PX,
    )
    assert small == []
    brightness = page.evaluate(
        "getComputedStyle(document.body).backgroundColor.match(/[0-9]+/g).map(Number)"
    )
    assert (max(brightness) < 64) == (scheme == "dark")


def test_a_token_is_asked_for_and_kept_for_the_tab(folder, tmp_path, visit):
    with serving(folder, tmp_path / "log", TOKEN) as server:
        page = visit(server.url, expected=("401",))
        page.fill("#token input", "another")
        page.click("#token button")
        page.wait_for_selector("#token .fault:text('not the server')")
        page.fill("#token input", TOKEN)
        page.click("#token button")
        page.wait_for_selector("#new:visible")
        page.wait_for_selector("#token", state="hidden")
        page.reload()
        page.click("#new")
        page.wait_for_selector("#start[open]")


def test_an_empty_folder_says_what_to_do(tmp_path, visit):
    (tmp_path / "served").mkdir()
    with serving(tmp_path / "served", tmp_path / "log") as server:
        page = visit(server.url)
        page.wait_for_selector("#empty >> text=exposight plan")
        assert page.is_disabled("#new")


def test_assets_are_kept_for_ever_and_compressed(server):
    page = httpx.get(server.url)
    assert "default-src 'self'" in page.headers["content-security-policy"]
    assert page.headers["cache-control"] == "no-cache"
    name = page.text.split('href="assets/plotly-')[1].split('"')[0]
    for accepted, encoding in (("gzip", "gzip"), ("identity", None)):
        answer = httpx.get(
            f"{server.url}/assets/plotly-{name}", headers={"Accept-Encoding": accepted}
        )
        assert answer.headers.get("content-encoding") == encoding
        assert "immutable" in answer.headers["cache-control"]
        assert "plotly.js" in answer.text[:400]
    assert httpx.get(f"{server.url}/assets/other.js").status_code == 404
