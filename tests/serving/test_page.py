"""The page in Chromium: query, answer, goal, error, session, reload, hostile names."""

from __future__ import annotations

import re
import time
from pathlib import Path

import numpy as np
import pytest

from salframe.serving.access import AccessRules
from serving.browser import Watch, browser
from serving.rooms_service import TRUTHS, build, serving, upload

pytestmark = pytest.mark.slow
HOSTILE = "<img src=x onerror=alert(1)>\"'&"
TOKEN = "0123456789abcdef-token"


@pytest.fixture(scope="module")
def chromium():
    with browser() as started:
        yield started


@pytest.fixture(scope="module")
def files(tmp_path_factory) -> dict[str, Path]:
    """The images of the query in the bedroom."""
    folder = tmp_path_factory.mktemp("images")
    for name, (_, content, _) in upload("bedroom").items():
        (folder / f"{name}.png").write_bytes(content.getvalue())
    return {name: folder / f"{name}.png" for name in ("image", "range")}


@pytest.fixture
def page(chromium, service):
    context = chromium.new_context(viewport={"width": 1280, "height": 900})
    opened = context.new_page()
    watch = Watch(opened, service.url)
    opened.goto(service.url)
    opened.wait_for_selector("#plan .place")
    yield opened
    context.close()
    assert watch.errors == []


def expect_text(page, selector: str, pattern: str) -> None:
    """Wait until the text of an element matches a pattern."""
    from playwright.sync_api import expect

    expect(page.locator(selector)).to_have_text(re.compile(pattern), timeout=30_000)


def localize(page, files) -> None:
    """Choose the images and wait for the answer."""
    page.set_input_files("#image", files["image"])
    page.wait_for_selector("#send:enabled")
    page.evaluate("document.querySelector('details').open = true")
    page.set_input_files("#range", files["range"])
    page.click("#send")
    page.wait_for_selector("#answer:not([hidden])")
    expect_text(page, "#status", "^Localized")


def arrow(page) -> tuple[float, float]:
    """The position of the arrow on the plan in metres."""
    transform = page.get_attribute("#plan .arrow", "transform")
    x, y = map(float, re.match(r"translate\((\S+) (\S+)\)", transform).groups())
    return x / 100, -y / 100


def test_upload_answer_and_route(page, files):
    assert page.locator("#plan .place").count() == 3
    assert page.locator("#plan .region").count() == 4
    localize(page, files)
    assert page.inner_text("#verdict").startswith("In bedroom")
    assert page.locator("#places li").count() == 3
    assert arrow(page) == pytest.approx(TRUTHS["bedroom"].T_world_pano[:2, 3].tolist(), abs=0.1)
    assert page.locator("#plan .ellipse").count() == 1
    assert page.locator("#plan .link").count() >= 4
    assert page.locator("#outlines polygon").count() >= 7
    assert page.locator("#objects tr").count() == 7
    assert page.evaluate("document.activeElement.id") == "answer-title"
    page.click("#plan .place[data-place=kitchen] circle")
    page.wait_for_selector("#route:not([hidden])")
    assert re.match(r"Route to kitchen: \d+\.\d m", page.inner_text("#route-title"))
    assert "turn" in page.inner_text("#steps li:first-child")
    line = page.get_attribute("#plan .route", "points").split()
    start = np.array(line[0].split(","), float) / (100, -100)
    assert start == pytest.approx(arrow(page), abs=0.06)
    page.select_option("#goal", "lounge")
    page.click("#goal-form button")
    expect_text(page, "#route-title", "^Route to lounge")


def test_a_click_on_the_floor_is_a_goal(page, files):
    localize(page, files)
    box = page.locator("#plan .region").nth(3).bounding_box()  # the hall
    page.mouse.click(box["x"] + 0.8 * box["width"], box["y"] + 0.5 * box["height"])
    expect_text(page, "#route-title", "^Route to the point")
    end = np.array(page.get_attribute("#plan .route", "points").split()[-1].split(","), float) / (100, -100)
    assert end == pytest.approx([0.8 * 9.4, 4.8], abs=0.15)


def test_the_keyboard_reaches_everything(page, files):
    localize(page, files)
    page.focus("#plan .place[data-place=lounge]")
    page.keyboard.press("Enter")
    expect_text(page, "#route-title", "^Route to lounge")
    page.evaluate("document.activeElement.blur(); window.scrollTo(0, 0)")
    reached = set()
    for _ in range(60):
        page.keyboard.press("Tab")
        reached.add(page.evaluate("document.activeElement.id || document.activeElement.getAttribute('aria-label')"))
    assert {"goal", "image", "camera", "send", "session-start", "Route to kitchen", "Objects"} <= reached


def test_an_error_is_shown_and_the_next_query_works(page, files, tmp_path):
    (tmp_path / "bad.png").write_bytes(b"no image")
    page.set_input_files("#image", tmp_path / "bad.png")
    page.wait_for_selector("#send:enabled")
    page.click("#send")
    expect_text(page, "#error", ".")
    assert "not a readable image" in page.inner_text("#error")
    localize(page, files)
    assert page.inner_text("#error") == ""
    assert page.inner_text("#verdict").startswith("In bedroom")


def test_a_session_shows_a_trail(page, files):
    page.click("#session-start")
    page.wait_for_selector("#session-end:not([hidden])")
    localize(page, files)
    expect_text(page, "#session-state", "1 views")
    page.fill("#move-x", "0")
    page.click("#send")
    expect_text(page, "#session-state", "2 views")
    assert page.inner_text("#session-state") == "tracking in bedroom, 2 views"
    assert page.locator("#plan .trail-point").count() == 2
    assert page.locator("#plan .shade").count() >= 1
    page.click("#session-end")
    page.wait_for_selector("#session-start:not([hidden])")


def test_a_dropped_file_is_a_query(page, files):
    content = list(files["image"].read_bytes())
    page.evaluate(
        """(bytes) => {
            const data = new DataTransfer();
            data.items.add(new File([new Uint8Array(bytes)], "dropped.png", { type: "image/png" }));
            document.querySelector("#drop").dispatchEvent(new DragEvent("drop", { dataTransfer: data, bubbles: true }));
        }""",
        content,
    )
    page.wait_for_selector("#send:enabled")
    assert page.inner_text("#chosen") == "dropped.png, 384 x 192"
    assert not page.is_visible("#fov-row")


def test_hostile_names_stay_text(chromium, tmp_path, files):
    with serving(build(tmp_path / "a.map", topology=False, names={"bedroom": HOSTILE})) as running:
        context = chromium.new_context()
        page = context.new_page()
        watch = Watch(page, running.url)
        page.goto(running.url)
        page.wait_for_selector("#plan .place")
        localize(page, files)
        assert page.inner_text("#verdict").startswith(f"In {HOSTILE}")
        assert page.inner_text("#places li .name >> nth=0") == HOSTILE
        assert page.locator("img[src=x]").count() == 0
        context.close()
        assert watch.errors == []


def test_a_changed_map_appears_after_a_reload(chromium, tmp_path, files):
    folder = build(tmp_path / "a.map")
    with serving(folder) as running:
        page = chromium.new_page()
        page.goto(running.url)
        page.wait_for_selector("#plan .place[data-place=bedroom]")
        build(folder, names={"bedroom": "boudoir"})
        end = time.monotonic() + 60
        while running.maps.num_reloads == 0 and time.monotonic() < end:
            time.sleep(0.1)
        page.reload()
        page.wait_for_selector("#plan .place[data-place=boudoir]")
        localize(page, files)
        assert page.inner_text("#verdict").startswith("In boudoir")
        page.close()


def test_the_page_asks_for_the_token(chromium, rooms_map, files):
    with serving(rooms_map, rules=AccessRules(TOKEN)) as running:
        context = chromium.new_context()
        page = context.new_page()
        urls = []
        page.on("request", lambda request: urls.append(request.url))
        page.on("websocket", lambda socket: urls.append(socket.url))
        page.goto(running.url)
        for token in ("wrong", TOKEN):
            page.wait_for_selector("#token-dialog[open]")
            page.fill("#token", token)
            page.click("#token-form button")
        page.wait_for_selector("#plan .place")
        page.click("#session-start")
        localize(page, files)
        expect_text(page, "#session-state", "1 views")
        page.reload()
        page.wait_for_selector("#plan .place")  # the token is stored until the tab closes
        assert not [url for url in urls if TOKEN in url]
        context.close()


def test_examples_of_the_interface_run(chromium, service):
    context = chromium.new_context()
    page = context.new_page()
    watch = Watch(page, service.url)
    page.goto(f"{service.url}/api")
    page.wait_for_selector("#operations section")
    operations = page.locator("#operations section")
    statuses = {}
    for i in range(operations.count()):
        operation = operations.nth(i)
        operation.locator("button").click()
        operation.locator("pre[role=status]").filter(has_text=re.compile(".")).wait_for()
        statuses[operation.locator("code").first.inner_text()] = operation.locator("pre[role=status]").inner_text()[:3]
    assert statuses == {
        "POST /localize": "200",
        "POST /route": "200",
        "POST /sessions": "201",
        "POST /sessions/{session_id}/observations": "200",
        "GET /sessions/{session_id}": "200",
        "DELETE /sessions/{session_id}": "204",
        "GET /map": "200",
        "GET /health": "200",
        "GET /metrics": "200",
    }
    context.close()
    assert watch.errors == []


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [390, 1280])
def test_accessibility_and_width(chromium, service, files, scheme, width, tmp_path):
    """axe-core finds nothing serious, and nothing is wider than the screen. Screenshots are written."""
    axe = pytest.importorskip("axe_playwright_python.sync_playwright")
    context = chromium.new_context(viewport={"width": width, "height": 900}, color_scheme=scheme)
    page = context.new_page()
    page.goto(service.url)
    page.wait_for_selector("#plan .place")
    localize(page, files)
    page.click("#plan .place[data-place=kitchen] circle")
    page.wait_for_selector("#route:not([hidden])")
    page.screenshot(path=tmp_path / f"{width}-{scheme}.png", full_page=True)
    for path in ("/", "/api"):
        if path == "/api":
            page.goto(f"{service.url}/api")
            page.wait_for_selector("#operations section")
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        # axe-core is inserted by the test, which the policy of the page does not allow
        found = axe.Axe().run(page).response["violations"]
        serious = [f"{v['id']}: {v['nodes'][0]['html']}" for v in found if v["impact"] in ("serious", "critical")]
        assert serious == []
    context.close()
