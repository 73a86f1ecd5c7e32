"""The documentation keeps up with the code: generated pages, commands, components and links."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path

import pytest
import typer
import yaml
from command_line import run

from salframe.cli import app
from salframe.framework.presets import CONFIGS
from salframe.framework.registry import registry

REPOSITORY = Path(__file__).parent.parent
DOCS = REPOSITORY / "docs"
PAGES = sorted(DOCS.rglob("*.md"))
LINK = re.compile(r"\]\(([^)\s]+)\)")


def generator():
    spec = importlib.util.spec_from_file_location("generate_reference", DOCS / "generate_reference.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("page", ["cli.md", "components.md", "furniture-credits.md"])
def test_the_generated_reference_is_up_to_date(page):
    assert (DOCS / "reference" / page).read_text() == generator().PAGES[page](), (
        "run: python docs/generate_reference.py"
    )


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
    text = (DOCS / "reference/components.md").read_text()
    for component, package in registry():
        if package == "salframe":
            role = text.partition(f"\n## {component.role}\n")[2].partition("\n## ")[0]
            section = role.partition(f"\n### {component.name}\n")[2].partition("\n### ")[0]
            assert section, f"{component.role} {component.name}"
            for setting in set(component.Config.model_fields) - {"kind"}:
                assert re.search(rf"\| `{setting}[`.]", section), f"{setting} of {component.role} {component.name}"


def test_every_preset_is_in_the_reference():
    text = (DOCS / "reference/components.md").read_text()
    for folder in ("methods", "data"):
        for preset in (CONFIGS / folder).glob("*.yaml"):
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


def test_every_page_is_in_the_navigation():
    listed = re.findall(r"[\w/-]+\.md", (REPOSITORY / "mkdocs.yml").read_text())
    assert sorted(listed) == [page.relative_to(DOCS).as_posix() for page in PAGES]


def test_the_tutorial_on_your_own_panoramas_works(tmp_path, monkeypatch):
    """Its script and its commands, against the pose that the script gives the query and the output that the page shows."""
    monkeypatch.chdir(tmp_path)
    text = (DOCS / "tutorials/your-own-panoramas.md").read_text()
    exec(re.search(r"```python\n(.*?)```", text, re.DOTALL)[1], {})
    assert run("build", "flat", "-o", "flat.map").code == 0
    assert run("localize", "flat.map", "flat/frames/query-1.range.png").out in text
    answer = run("localize", "flat.map", "query-1", "--data", "flat", "--json").json
    assert answer["places"][0]["place"] == "study"
    pose = [answer["pose"][key] for key in ("x_m", "y_m", "yaw_deg")]
    assert pose == pytest.approx([8.3, 0.4, 90], abs=0.1)


def test_the_site_asks_nobody_else():
    theme = yaml.load((REPOSITORY / "mkdocs.yml").read_text(), yaml.BaseLoader)["theme"]
    assert theme["font"] == "false"
