"""The documentation keeps up with the code: generated pages, commands, components and links."""

from __future__ import annotations

import ast
import importlib
import importlib.util
import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import typer
import yaml
from command_line import run
from PIL import Image

import salframe
from salframe.cli import app
from salframe.framework.components.registry import registry
from salframe.panoramas.opening import find_dataset

REPOSITORY = Path(__file__).parent.parent
DOCS = REPOSITORY / "docs"
PAGES = sorted(DOCS.rglob("*.md"))
LINK = re.compile(r"\]\(([^)\s]+)\)")


def generator():
    spec = importlib.util.spec_from_file_location("generate_reference", DOCS / "generate_reference.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_generated_reference_is_up_to_date():
    pages = generator().PAGES
    assert {"cli.md", "components/dataset.md", "furniture-credits.md"} <= set(pages)
    assert {f"components/{path.name}" for path in (DOCS / "reference/components").iterdir()} <= set(pages)
    for page, write in pages.items():
        assert (DOCS / "reference" / page).read_text() == write(), f"{page}: run: python docs/generate_reference.py"


def test_every_command_and_option_is_in_the_reference():
    sections = (DOCS / "reference/cli.md").read_text().split("\n## ")
    known = {section.partition("\n")[0]: section for section in sections}
    for name, command in typer.main.get_command(app).commands.items():
        for path, leaf in [
            (name, command),
            *((f"{name} {child}", leaf) for child, leaf in getattr(command, "commands", {}).items()),
        ]:
            assert f"salframe {path}" in known
            for parameter in leaf.params:
                written = (
                    parameter.opts[0]
                    if parameter.param_type_name == "option"
                    else parameter.metavar or parameter.name.upper()
                )
                assert f"`{written}" in known[f"salframe {path}"], f"{written} of salframe {path}"


def test_every_component_and_setting_is_in_the_reference():
    for component, package in registry():
        if package == "salframe":
            page = (DOCS / f"reference/components/{component.role}.md").read_text()
            _, *sections = page.split("\n## ")
            by_title = {section.partition("\n")[0]: section for section in sections}
            assert component.name in by_title, f"{component.role} {component.name}"
            text = by_title[component.name] + by_title.get("Settings of all components", "")
            for setting in set(component.Config.model_fields) - {"kind"}:
                assert re.search(rf"\| `{setting}[`.]", text), f"{setting} of {component.role} {component.name}"


def test_every_preset_is_in_the_reference():
    text = "".join(page.read_text() for page in (DOCS / "reference/components").glob("*.md"))
    shipped = [path for path, package in registry().preset_files() if package == "salframe"]
    assert {path.parent.name for path in shipped} == {"methods", "data", "ablations", "experiments", "reported"}
    for preset in shipped:
        if preset.parent.name in ("methods", "data"):
            assert f"`{preset.stem}`" in text


@pytest.mark.parametrize("page", [*PAGES, REPOSITORY / "README.md"], ids=lambda page: str(page.relative_to(REPOSITORY)))
def test_no_relative_link_is_broken(page):
    for target in LINK.findall(page.read_text()):
        if not re.match(r"[a-z]+:", target):
            file, _, anchor = target.partition("#")
            linked = page.parent / file if file else page
            assert linked.exists(), f"{target} in {page.relative_to(REPOSITORY)}"
            if anchor:
                assert anchor in anchors(linked), f"{target} in {page.relative_to(REPOSITORY)}"


def anchors(page: Path) -> set[str]:
    """The anchors of a page's headings, as GitHub and MkDocs make them."""
    headings = re.findall(r"^#+ (.+)$", page.read_text(), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading).strip().lower().replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", [*PAGES, REPOSITORY / "README.md"], ids=lambda page: str(page.relative_to(REPOSITORY)))
def test_the_yaml_of_pages_can_be_read(page):
    for block in re.findall(r"^( *)```yaml\n(.*?)^ *```", page.read_text(), re.DOTALL | re.MULTILINE):
        assert yaml.safe_load(block[1])


def test_every_page_is_in_the_navigation():
    listed = re.findall(r"[\w/-]+\.md", (REPOSITORY / "mkdocs.yml").read_text())
    assert sorted(listed) == sorted(page.relative_to(DOCS).as_posix() for page in PAGES)


SAMPLE = DOCS / "tutorials" / "apartment"
QUERY_POSES = {"query-0013": ("corridor-01", 8.575, 0.525, -6.16), "query-0014": ("study-01", 2.525, 2.675, 146.55)}
"""Place, x and y in metres and yaw in degrees of the queries of the sample recording, from its renderer."""


def commands(page: str) -> list[list[str]]:
    """The arguments of the commands that a page shows, in its order."""
    return [
        shlex.split(line, comments=True)[1:] for line in re.findall("^salframe .*", (DOCS / page).read_text(), re.M)
    ]


def test_the_tutorial_on_your_own_panoramas_works(tmp_path, monkeypatch, capsys):
    """Its scripts and its three commands on the sample, against the poses of the renderer and the output it shows."""
    monkeypatch.chdir(tmp_path)
    page = "tutorials/your-own-panoramas.md"
    text = (DOCS / page).read_text()
    copy, script = blocks(page, "python")
    exec(copy, {})
    assert sum(path.stat().st_size for path in Path("sample").rglob("*.*")) < 1e6
    imported, build, query, _ = commands(page)
    assert f"{run(*imported, '--dry-run').out.partition('pictures:')[0].strip()}\n```" in text
    assert run(*imported).out.partition(", in ")[0] in text
    built = run(*build)
    assert built.out.splitlines()[0] in text
    assert run(*query).out in text
    for id, (place, *pose) in QUERY_POSES.items():
        answer = run("localize", "apartment.map", f"apartment/frames/{id}.jpg", "--json").json
        assert answer["places"][0]["place"] == place
        assert [answer["pose"]["x_m"], answer["pose"]["y_m"]] == pytest.approx(pose[:2], abs=0.15)
        assert answer["pose"]["yaw_deg"] == pytest.approx(pose[2], abs=6)  # one query is dark
    capsys.readouterr()
    exec(script.replace('"apartment"', '"second"').replace("apartment.map", "second.map"), {})
    assert capsys.readouterr().out.startswith("study-01 [[")


@pytest.mark.slow
def test_the_tutorial_on_a_phone_works(tmp_path, monkeypatch, capsys):
    """Its commands on the pictures of the sample without range, against the pose of the renderer."""
    monkeypatch.chdir(tmp_path)
    page = "tutorials/phone.md"
    copy, script = blocks(page, "python")
    exec(copy, {})
    _, imported, build, localize = commands(page)
    assert run(*imported).code == run(*build).code == 0
    place, *_, yaw_deg = QUERY_POSES["query-0014"]
    answer = run(*localize, "--json").json
    assert answer["places"][0]["place"] == place
    assert answer["pose"]["yaw_deg"] == pytest.approx(yaw_deg, abs=3)
    assert [line.split()[1] for line in run(*localize).out.splitlines()[1:3]] == [place, "kitchen-01"]
    capsys.readouterr()
    exec(script.replace('"home"', '"second"').replace("home.map", "second.map"), {})
    assert capsys.readouterr().out.startswith(place)


@pytest.mark.slow
def test_the_sample_recording_can_be_made_again(cache, tmp_path, monkeypatch):
    """The script renders the files of the sample, and the queries have the poses of the tutorial."""
    monkeypatch.setenv("SALFRAME_CACHE", str(cache))
    spec = importlib.util.spec_from_file_location("make_sample", DOCS / "make_sample.py")
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    script.write_sample(tmp_path)
    names = sorted(path.relative_to(tmp_path) for path in tmp_path.rglob("*.*"))
    assert names == sorted(path.relative_to(SAMPLE) for path in SAMPLE.rglob("*.*"))
    for name in names:
        if name.suffix in (".jpg", ".png"):  # encoders of other versions write other bytes
            made, shipped = (np.asarray(Image.open(root / name), np.float64) for root in (tmp_path, SAMPLE))
            assert np.abs(made - shipped).mean() < 0.5, name
        else:
            assert (tmp_path / name).read_text() == (SAMPLE / name).read_text()
    dataset = find_dataset("house-6", overrides=script.DATA)
    for id, (place, x_m, y_m, yaw_deg) in QUERY_POSES.items():
        truth = dataset.truth(id)
        assert truth.place == place
        expected = salframe.pose_2d(x_m, y_m, np.radians(yaw_deg), truth.T_world_pano[2, 3])
        assert truth.T_world_pano == pytest.approx(expected, abs=0.001)


@pytest.mark.slow
def test_the_walk_from_photographs_to_an_answer_works(cache, tmp_path, monkeypatch, capsys):
    """Its scripts and its commands that need no download, on the stand-ins, against what the renderer knows."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("SALFRAME_CACHE", str(cache))
    page = "how-to/photographs.md"
    render, show, _, dry_run, imported, look, build, localize, *_ = commands(page)
    assert run(*render).code == 0
    stand_ins, show_one, again, ask = blocks(page, "python")
    exec(stand_ins, {})
    assert "study-01-0.objects.png: " in run(*show).out
    exec(show_one, {})
    assert run(*dry_run).code == 0
    assert not Path("home").exists()
    expected = (DOCS / page).read_text().partition("home: 8 reference frames")[2].partition(", in ")[0]
    assert run(*imported).out.startswith(f"home: 8 reference frames{expected}, in ")
    exec(again, {})
    names = sorted(str(path) for path in Path("home/frames").glob("*.jpg"))
    looked = run("show-objects", *names, *look[2:], "--json").json
    assert len(looked["images"]) == 14
    assert not looked["failures"]
    assert sum(len(view["objects"]) for view in looked["images"]) > 50
    assert run(*build).code == 0
    answer = run(*localize, "--json").json
    query = Path(localize[-1]).stem
    truth = find_dataset("house-6", overrides=render[3:][1:]).truth(query)
    assert answer["places"][0]["place"] == truth.place == "study-01"
    assert [answer["pose"]["x_m"], answer["pose"]["y_m"]] == pytest.approx(truth.T_world_pano[:2, 3], abs=0.3)
    assert "study-01  (frame study-01-0)" in run(*localize).out
    capsys.readouterr()
    exec(ask, {})
    assert capsys.readouterr().out.startswith("study-01 [[")


def blocks(page: str, language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", (DOCS / page).read_text(), re.DOTALL)


PYTHON = [page for page in PAGES if "```python" in page.read_text() and page.stem != "write-a-plugin"]
"""Pages that show Python; write-a-plugin.md is run by a test of its own."""


@pytest.mark.parametrize("page", PYTHON, ids=lambda page: page.stem)
def test_what_pages_import_is_there(page):
    for block in blocks(page.relative_to(DOCS).as_posix(), "python"):
        for node in ast.parse(block).body:
            if isinstance(node, ast.Import | ast.ImportFrom):
                exec(compile(ast.Module([node], []), str(page), "exec"), {})


COMMANDS = [
    page
    for page in PAGES
    if re.search(r"^```\nsalframe ", page.read_text(), re.M) and page.stem != "cli" and page.parent.name != "results"
]
"""Pages that show a command, except the reference of all commands and the generated pages of experiments."""


@pytest.mark.parametrize("page", COMMANDS, ids=lambda page: page.stem)
def test_pages_that_show_a_command_show_the_python_beside_it(page):
    """By names that are promised."""
    code = [ast.parse(block) for block in blocks(page.relative_to(DOCS).as_posix(), "python")]
    used = {
        node.attr
        for tree in code
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "salframe"
    }
    assert used
    assert used <= set(salframe.__all__)


def test_every_promised_name_is_in_the_reference_of_the_api():
    named = re.findall(r"^::: salframe\.(\w+)$", (DOCS / "reference/api.md").read_text(), re.M)
    assert sorted(named) == sorted(salframe.__all__)


ESTIMATE = r"(?:0|1|0\.\d+) \([01]\.\d\d-[01]\.\d\d\)"


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    return tmp_path_factory.mktemp("cache")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("page", "said"),
    [
        (
            "tutorials/first-comparison.md",
            rf"proposed {ESTIMATE} .*\nobjects 0\.\d+ .* None .*\nruns/house-6-\w+/report\.html",
        ),
        ("how-to/ablate.md", rf"(proposed\[matcher\.geometry_score=.*\] {{.*}} {ESTIMATE} 0\.\d+\n){{4}}"),
        ("how-to/matching.md", rf"proposed nodes {ESTIMATE} {ESTIMATE}\nusg nodes {ESTIMATE} {ESTIMATE}"),
        ("how-to/navigate.md", rf"proposed {ESTIMATE} {ESTIMATE}"),
        ("how-to/maps.md", r"turn right .*, walk "),
        ("how-to/detectors.md", r"annotations (1\.0|0\.\d+) (1\.0|0\.\d+) \d"),
    ],
)
def test_what_pages_show_in_python_runs(page, said, cache, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("SALFRAME_CACHE", str(cache))
    for content in blocks(page, "yaml")[:1]:
        (tmp_path / "FILE.yaml").write_text(content)
    (script,) = [block for block in blocks(page, "python") if "house-" in block or "FILE.yaml" in block]
    (tmp_path / "script.py").write_text(script)
    done = subprocess.run([sys.executable, "script.py"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert re.search(said, done.stdout), done.stdout


def test_the_site_asks_nobody_else():
    theme = yaml.load((REPOSITORY / "mkdocs.yml").read_text(), yaml.BaseLoader)["theme"]
    assert theme["font"] == "false"


@pytest.mark.parametrize("script", sorted(DOCS.glob("*.py")), ids=lambda path: path.name)
def test_what_scripts_of_the_docs_import_from_salframe_is_there(script):
    """They need more than the tests have, and are run by hand: nothing else would tell that a name has moved."""
    imports = [node for node in ast.walk(ast.parse(script.read_text())) if isinstance(node, ast.ImportFrom)]
    for node in imports:
        if not (node.module or "").startswith("salframe"):
            continue
        module = importlib.import_module(node.module)
        assert [one.name for one in node.names if not hasattr(module, one.name)] == []
