"""The page in a browser: nothing fails, nothing in a name is run, filters and drill-down work."""

from __future__ import annotations

from itertools import combinations

import pytest
import yaml

from evaluation.report.browser import CHROMIUM, Page
from salframe.evaluation.finished_runs import write_report
from salframe.evaluation.runs.request import Request
from salframe.evaluation.studies.study import ablate
from salframe.evaluation.tasks.localization.task import compare
from salframe.evaluation.tasks.navigation.task import navigate

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium is at hand")

ODD = ["<!--<script>", "</script><img src=x onerror=alert(1)>", """it's "quoted" & 100 %"""]
ROWS = "[...document.querySelectorAll('#queries tbody tr')]"


@pytest.fixture
def page(odd, tmp_path):
    with Page(write_report(odd, tmp_path / "page.html").path, tmp_path / "profile") as page:
        yield page
        assert page.problems == []


def texts(page, selector):
    return page.run(f"[...document.querySelectorAll({selector!r})].map(one => one.textContent)")


def choose(page, label, value):
    """Choose in the menu of the queries that is called so."""
    page.run(
        f"""(() => {{
          const labels = [...document.querySelectorAll("#queries label")];
          const select = labels.find(one => one.firstChild.textContent === "{label}").lastChild;
          select.selectedIndex = [...select.options].findIndex(one => one.text.startsWith({value!r}));
          select.dispatchEvent(new Event("change"));
        }})()"""
    )


def test_names_are_text_and_nothing_else(page):
    wrong_first = [1, 0, 2]
    assert texts(page, "#queries tbody td:nth-child(2)") == [ODD[k] for k in wrong_first]
    assert texts(page, "#queries tbody td:nth-child(1)") == [f"<b>query</b> {k}" for k in wrong_first]
    assert page.run("document.querySelectorAll('img, #queries b').length") == 0


def test_figures_are_drawn(page):
    page.run("document.getElementById('figures').scrollIntoView()")
    page.wait_for("document.querySelectorAll('#figures .js-plotly-plot').length >= 4")
    page.run("document.getElementById('floor').scrollIntoView()")
    page.wait_for("document.querySelectorAll('#floor .js-plotly-plot .points path').length >= 6")


def test_what_was_not_scrolled_to_is_drawn_for_print_and_screenshots(page):
    page.run("dispatchEvent(new Event('beforeprint'))")
    page.wait_for("document.querySelectorAll('#floor .js-plotly-plot .points path').length >= 6")
    assert set(ODD) <= set(texts(page, "#floor .annotation-text"))


def test_a_query_without_a_pose_is_a_dot_on_the_floor_plan(plugins, tmp_path):
    """Each of the three queries has a dot, and each of the two with a pose also has the head of an arrow."""
    plugins("odd_plugin", "salframe_engines", folders=("evaluation",))
    run = compare(Request(("weigher",), "odd", settings=("mistaken=9", "no_pose=2"), engine="inline")).run
    with Page(write_report([run], tmp_path / "page.html").path, tmp_path / "profile") as page:
        page.run("document.getElementById('floor').scrollIntoView({behavior: 'instant'})")
        page.wait_for("document.querySelectorAll('#floor .points path').length")
        boxes = page.run(
            "[...document.querySelectorAll('#floor .points path')].map(one => one.getBoundingClientRect())"
            ".map(box => [box.width, box.height, (box.left + box.right) / 2, (box.top + box.bottom) / 2])"
        )
        drawn = [box for box in boxes if min(box[:2]) > 2]
        assert len(drawn) == 5
        last = max(drawn, key=lambda box: box[2])  # the room without a pose is the one with the largest x
        page.move_to(*last[2:])
        page.wait_for("document.querySelector('#floor .hovertext') !== null")
        assert "<b>query</b> 2" in page.run("document.querySelector('#floor .hovertext').textContent")
        page.click(*last[2:])
        page.wait_for("document.getElementById('detail').open")
        assert texts(page, "dialog h2") == [f"<b>query</b> 2, true place: {ODD[2]}"]
        assert page.problems == []


@pytest.mark.parametrize(("width", "names"), [(1280, 3), (390, 1)])
def test_names_of_rooms_do_not_overlap(odd, tmp_path, width, names):
    with Page(write_report(odd, tmp_path / "page.html").path, tmp_path / "profile", width=width) as page:
        page.run("dispatchEvent(new Event('beforeprint'))")
        page.wait_for("document.querySelector('#floor .annotation') !== null")
        boxes = page.run(
            "[...document.querySelectorAll('#floor .annotation')].map(one => one.getBoundingClientRect())"
            ".map(box => [box.left, box.right, box.top, box.bottom])"
        )
        assert len(boxes) >= names
        for one, other in combinations(boxes, 2):
            apart = max(one[0], other[0]) >= min(one[1], other[1]) or max(one[2], other[2]) >= min(one[3], other[3])
            assert apart


def test_curves_are_chosen(page):
    page.wait_for("document.querySelectorAll('#figures .js-plotly-plot .barlayer .point').length === 2")
    page.run("document.querySelectorAll('#figures .menu input')[0].click()")
    page.wait_for("document.querySelectorAll('#figures .js-plotly-plot .barlayer .point').length === 1")
    assert texts(page, "#figures .legend span") == ["mistaken=9"]


def test_queries_are_filtered_by_method_outcome_and_room(page):
    assert page.run(f"{ROWS}.map(row => row.cells[3].textContent)") == ["wrong place", "correct", "correct"]
    choose(page, "outcome", "wrong place (1)")
    assert texts(page, "#queries tbody td:nth-child(3)") == [ODD[0]]
    choose(page, "method", "mistaken=9")
    assert page.run(f"{ROWS}.length") == 0
    choose(page, "outcome", "all")
    assert page.run(f"{ROWS}.map(row => row.cells[3].textContent)") == ["correct"] * 3
    choose(page, "room", ODD[1][:9])
    assert texts(page, "#queries tbody td:nth-child(2)") == [ODD[1]]


def test_the_confusion_of_rooms_leads_to_its_queries(page):
    title = f"{ODD[1]}, answered {ODD[0]}: 1"
    assert title in texts(page, "#rooms title")
    page.run(
        "[...document.querySelectorAll('#rooms .cell')]"
        f".find(one => one.textContent === {title!r}).dispatchEvent(new Event('click'))"
    )
    assert texts(page, "#queries tbody td:nth-child(1)") == ["<b>query</b> 1"]


def test_a_correct_rejection_is_not_confused_with_a_place(plugins, tmp_path):
    """The query in the room without a reference frame is rejected. Its answer also ranks the other rooms."""
    plugins("odd_plugin", "salframe_engines", folders=("evaluation",))
    settings = ("data.unmapped=2", "mistaken=9", "rejected=2")
    run = compare(Request(("weigher",), "odd", settings=settings, engine="inline")).run
    with Page(write_report([run], tmp_path / "page.html").path, tmp_path / "profile") as page:
        assert page.run(f"{ROWS}.map(row => row.cells[3].textContent)") == ["correct", "correct", "correct out-of-map"]
        pairs = [title for title in texts(page, "#rooms title") if ", answered " in title]
        assert pairs == [
            f"{room}, answered {answer}: 1" for room, answer in zip(ODD, [*ODD[:2], "no place"], strict=True)
        ]
        assert "No query has a wrong place." in page.run("document.getElementById('rooms').textContent")
        assert page.problems == []


def test_a_query_is_opened_and_left_by_keys(page):
    page.run(f"{ROWS}[1].focus()")
    page.press("ArrowUp")
    page.press("Enter")
    page.wait_for("document.getElementById('detail').open")
    assert texts(page, "dialog h2") == [f"<b>query</b> 1, true place: {ODD[1]}"]
    assert page.run("document.querySelectorAll('dialog .pair image').length") == 2
    assert page.run("document.querySelectorAll('dialog .pair > line').length") == 2  # lamp with lamp, table with table
    assert "2 of 2 objects matched" in page.run("document.querySelector('dialog .tools').textContent")
    parts = page.run("[...document.querySelector('dialog .columns table').rows].map(row => row.innerText.split('\\t'))")
    assert parts[1] == ["near", "2.00", "4.00", "8.00", "3.00", "6.00"]
    assert parts[2] == ["far", "-1.00", "0.00", "0.00", "0.50", "-0.50"]
    assert parts[3][::2] == ["sum", "", ""]
    assert (parts[3][3], parts[3][5]) == ("8.00", "5.50")
    page.press("ArrowRight")
    assert texts(page, "dialog h2") == [f"<b>query</b> 0, true place: {ODD[0]}"]
    page.press("Escape")
    page.wait_for("!document.getElementById('detail').open")


def test_both_graphs_from_above_meet_under_the_right_pose(page):
    """Under the estimated pose, which is right, objects of the query lie on those of the map."""
    page.run(f"{ROWS}[1].click()")
    centres = page.run(
        "[...document.querySelectorAll('dialog .plan circle')]"
        ".map(one => [+one.getAttribute('cx'), +one.getAttribute('cy')])"
    )
    of_map, of_query = centres[:2], centres[2:]
    for one, other in zip(of_map, of_query, strict=True):
        assert one == pytest.approx(other, abs=0.5)


def test_a_wrong_answer_is_compared_with_the_truth(page):
    page.run(f"{ROWS}[0].click()")
    matched = "document.querySelector('dialog .tools span').textContent"
    assert page.run(matched).startswith("Matched with map <0>")
    page.run("document.querySelectorAll('dialog .tools button')[1].click()")
    assert page.run(matched).startswith("Matched with map <1>")


@pytest.mark.parametrize(("width", "dark"), [(1280, True), (390, False)])
def test_it_fits_the_screen(odd, tmp_path, width, dark):
    path = write_report(odd, tmp_path / "page.html").path
    with Page(path, tmp_path / "profile", width=width, dark=dark) as page:
        assert page.run("document.documentElement.scrollWidth") <= width
        assert page.run("document.documentElement.classList.contains('dark')") is dark
        assert page.problems == []


def test_an_ablation_of_16_rows_fits_a_laptop(fakes, tmp_path):
    vary = {"reader.offset": [0, 1, 2, 3], "reader.wrong_from": [99, 1, 2, 3]}
    content = {"methods": ["reader"], "data": "rooms", "set": {"data.rooms": 5}, "vary": vary}
    (tmp_path / "sixteen.yaml").write_text(yaml.safe_dump(content))
    study = ablate(tmp_path / "sixteen.yaml", Request((), engine="inline"))
    with Page(write_report(study.runs, tmp_path / "page.html").path, tmp_path / "profile", width=1280) as page:
        page.run("document.getElementById('figures').scrollIntoView()")
        page.wait_for("document.querySelectorAll('#figures .js-plotly-plot').length >= 4")
        assert page.run("document.documentElement.scrollWidth") <= 1280
        rows = "[...document.querySelectorAll('table')].map(one => one.tBodies[0].rows.length)"
        assert page.run(f"Math.max(...{rows})") >= 16
        plots = "[...document.querySelectorAll('#figures .bglayer .bg')].map(one => one.getBoundingClientRect().width)"
        assert len(page.run(plots)) >= 2
        assert min(page.run(plots)) > 250
        assert page.problems == []


def test_a_thousand_queries_are_listed_as_they_are_reached(fakes, tmp_path):
    settings = ("data.rooms=250", "data.queries=4")
    run = compare(Request(("reader",), "rooms", settings=settings, engine="inline")).run
    with Page(write_report([run], tmp_path / "page.html").path, tmp_path / "profile") as page:
        assert page.run(f"{ROWS}.length") < 200
        down = "document.documentElement.scrollTo({top: 1e9, behavior: 'instant'})"
        page.wait_for(f"new Promise(done => {{ {down}; setTimeout(() => done({ROWS}.length === 1000), 60); }})", 120)
        assert page.problems == []


def test_trajectories_are_drawn(apartment, tmp_path):
    run = navigate(Request(("seer",), "apartment", engine="inline"), episodes=2).run
    with Page(write_report([run], tmp_path / "page.html").path, tmp_path / "profile", dark=True) as page:
        assert page.run("document.querySelectorAll('.trajectory polyline').length") >= 2
        assert "m walked" in page.run("document.getElementById('trajectories').textContent")
        assert page.problems == []
