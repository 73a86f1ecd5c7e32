"""What plugins bring, what is refused, and what a broken one costs."""

from __future__ import annotations

import re
import subprocess
import sys
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from salframe.builtin import salframe_provides
from salframe.framework.component import ComponentConfig, Role
from salframe.framework.components.entry_points import GROUP
from salframe.framework.components.registry import Failure, Registry, registry
from salframe.framework.errors import PluginFailed, SalframeError, UnknownName
from salframe.framework.hookspecs import Presets
from salframe.graphs.saliency import SaliencyModel


class Declared(SaliencyModel):
    """A model that the tests declare differently."""

    name = "declared"
    version = "1"

    def score(self, detections):
        return detections.scores


@pytest.fixture
def found() -> Registry:
    """The core's roles alone."""
    made = Registry()
    for item in salframe_provides():
        made.add(item, "salframe")
    return made


def declared(**attributes) -> type[SaliencyModel]:
    return type("Changed", (Declared,), attributes)


def config(**fields) -> type[ComponentConfig]:
    annotations = {name: kind for name, (kind, _) in fields.items()}
    values = {name: value for name, (_, value) in fields.items() if value is not ...}
    return type("Config", (ComponentConfig,), {"__annotations__": annotations, **values})


class Nameless(SaliencyModel):
    """Says neither what it is called nor which version it is."""

    def score(self, detections):
        return detections.scores


@pytest.mark.parametrize(
    ("component", "message"),
    [
        (
            declared(name="My model"),
            "Changed.name is 'My model', expected words of lower-case letters and digits, joined by",
        ),
        (declared(name="two--hyphens"), "Changed.name is 'two--hyphens'"),
        (declared(name=7), "Changed.name is 7, expected words"),
        (Nameless, "Nameless has no class attribute name and no class attribute version"),
        (declared(version=2), "Changed.version is 2, expected a string"),
        (declared(extra=None), "Changed.extra is None, expected a string"),
        (declared(requires="torch"), "Changed.requires has the type str, expected a tuple"),
        (declared(weights=[]), "Changed.weights has the type list, expected a tuple"),
        (
            declared(weights=("small.pt",)),
            "Changed.weights contains 'small.pt', expected objects of type NetworkWeights",
        ),
        (
            declared(Config=config(labels=(frozenset[str], frozenset("ab")))),
            "Changed.Config has a Python set as the default of labels",
        ),
        (
            declared(Config=config(parts=(dict, {"a": ({1},)}))),
            "Changed.Config has a Python set as the default of parts, expected a tuple",
        ),
        (
            declared(requires=("torch.nn",)),
            "Changed.requires contains 'torch.nn', expected the import name of a top-level package",
        ),
        (declared(requires=("opencv-python",)), "Changed.requires contains 'opencv-python'"),
        (
            declared(Config=config(size_m=(float, ...))),
            "Changed.Config has no default for size_m, expected a default for every",
        ),
        (
            declared(Config=config(tool=(object, object()))),
            "Changed.Config has a default that cannot be written as JSON",
        ),
        (
            Path,
            "is not a component, expected a subclass of one of Dataset, Importer, RangeModel, Detector, SaliencyModel",
        ),
        (Declared(), "is not a component"),
        (SaliencyModel.score, "is not a component"),
    ],
)
def test_a_declaration_that_would_break_a_listing_is_refused(found, component, message):
    before = list(found)
    with pytest.raises(SalframeError, match=message) as caught:
        found.add(component, "a-package")
    assert "\n" not in str(caught.value)
    assert list(found) == before


def test_settings_that_are_no_settings_are_refused(found):
    class Loose(Declared):
        """Its settings are a dict."""

    Loose.Config = dict
    with pytest.raises(SalframeError, match=r"Loose.Config is <class 'dict'>, expected a subclass of ComponentConfig"):
        found.add(Loose, "a-package")


def test_a_name_that_is_taken_names_both_packages(found):
    found.add(Declared, "first-package")
    found.add(Declared, "first-package")  # the same class again is no clash
    with pytest.raises(
        SalframeError,
        match="the package second-package registers the saliency 'declared', a name that the package first-package "
        "already uses",
    ):
        found.add(declared(), "second-package")
    assert found.get("saliency", "declared") is Declared


def test_a_role_that_is_taken_is_refused(found):
    class Saliency(Role):
        """Another role of that name."""

        role = "saliency"

    with pytest.raises(
        SalframeError, match=r"the package a-package registers the role 'saliency', a name that the role class Saliency"
    ):
        found.add(Saliency, "a-package")


@pytest.mark.parametrize(
    ("attribute", "value"), [("role", None), ("role", 3), ("word", None), ("conformance", print), ("presets", 1)]
)
def test_a_role_that_is_declared_badly_is_refused(found, attribute, value):
    role = type("Compass", (Role,), {"role": "compass", attribute: value})
    with pytest.raises(SalframeError, match=rf"Compass\.{attribute} in the package a-package is .*, expected a string"):
        found.add(role, "a-package")
    assert "compass" not in found.roles


RAISING = {
    "at import": ("raise {}", ""),
    "in the hook": ("def stop():\n    raise {}\n", "stop()"),
    "after a component": ("def stop():\n    raise {}\n    yield\n", "*[Even], *stop()"),
}


@pytest.mark.parametrize("code", RAISING.values(), ids=RAISING)
@pytest.mark.parametrize(
    ("error", "reason"),
    [
        ("SystemExit(3)", "SystemExit: 3"),
        ("ImportError('no module named tensorflow')", "ImportError: no module named tensorflow"),
        ("GeneratorExit()", "GeneratorExit"),
    ],
)
def test_a_plugin_that_raises_costs_only_itself(found, plugin, code, error, reason):
    found.load(plugin("a_broken_plugin", code[0].format(error), code[1]))
    found.load(plugin("a_good_plugin", items="Even"))
    assert [(failure.plugin, failure.package) for failure in found.failures] == [("a_broken_plugin", "a_broken_plugin")]
    assert found.failures[0].reason == reason.strip()
    assert found.get("saliency", "even").__module__ == "a_good_plugin"


@pytest.mark.parametrize("code", RAISING.values(), ids=RAISING)
def test_an_interrupt_of_the_user_is_no_failure_of_a_plugin(found, plugin, code):
    with pytest.raises(KeyboardInterrupt):
        found.load(plugin("an_interrupted_plugin", code[0].format("KeyboardInterrupt()"), code[1]))


def test_what_a_plugin_declares_badly_is_its_packages_failure(found, plugin):
    found.load(plugin("a_plugin", "class Loud(Even):\n    name = 'LOUD'\n", "Loud"))
    (failure,) = found.failures
    assert failure.package == "a_plugin"
    assert failure.reason.startswith("the class attribute Loud.name is 'LOUD', expected words of lower-case letters")


def test_a_hook_that_is_not_marked_is_a_failure(found, plugin, tmp_path):
    entry_point = plugin("a_plugin")
    path = tmp_path / "a_plugin.py"
    path.write_text(path.read_text().replace("@salframe.hookimpl", ""))
    found.load(entry_point)
    reason = (
        "the function a_plugin.salframe_provides is not marked as a plugin hook: decorate it with @salframe.hookimpl"
    )
    assert found.failures == [Failure("a_plugin", "a_plugin", reason)]


def test_a_name_that_a_broken_plugin_may_hold_says_how_to_repair_it(found):
    found.failures.append(Failure("even", "salframe-even", "ImportError: no numpy"))
    with pytest.raises(
        PluginFailed, match=r"even of the package salframe-even failed to load \(ImportError: no numpy\); try: pip"
    ):
        found.get("saliency", "even")
    with pytest.raises(UnknownName, match=r"1 plugin failed to load: even \(ImportError: no numpy\)"):
        found.get("saliency", "odd")


@pytest.mark.parametrize("name", [None, 3, ["declared"], {}])
def test_a_name_that_is_no_text_is_an_unknown_name(found, name):
    found.add(Declared, "a-package")
    with pytest.raises(UnknownName, match="expected the name of a saliency: declared"):
        found.get("saliency", name)


def test_a_plugin_brings_a_role_and_its_components(found, plugin):
    code = """
class Compass(Role):
    '''Tells where north is.'''
    role = "compass"

class Needle(Compass):
    '''Points ahead.'''
    name, version = "needle", "1"
"""
    found.load(plugin("a_compass", code, "Compass, Needle"))
    assert found.failures == []
    assert found.names("compass") == ["needle"]
    assert [component.name for component, _ in found][-1] == "needle"  # roles of plugins come after the core's
    assert found.build("compass", found.get("compass", "needle").Config()).config.kind == "needle"

    late = Registry()
    late.load(plugin("a_late_compass", code, "Needle"))  # its role comes with it, whichever plugin loads first
    assert late.failures == []
    assert list(late.roles) == ["compass"]


def test_presets_of_a_plugin_are_found_with_their_package(found, plugin, tmp_path):
    folder = tmp_path / "presets" / "methods"
    folder.mkdir(parents=True)
    (folder / "calm.yaml").write_text("kind: even\n")
    found.load(plugin("a_plugin", items=f"Presets(Path({str(tmp_path / 'presets')!r}))"))
    assert found.failures == []
    assert found.list_presets("methods") == {"calm": "a_plugin"}
    assert found.list_presets("data") == {}
    assert found.find_preset("methods", "calm") == folder / "calm.yaml"
    assert found.find_preset("methods", "wild") is None


def test_a_preset_whose_name_is_taken_is_refused(found, tmp_path):
    for package in ("one", "two"):
        (tmp_path / package / "methods").mkdir(parents=True)
        (tmp_path / package / "methods" / "calm.yaml").write_text("kind: even\n")
    found.add(Presets(tmp_path / "one"), "one")
    with pytest.raises(
        SalframeError,
        match=r"the package two registers the preset .*two/methods/calm\.yaml, which has the same name as the "
        r"preset .*one/methods/calm\.yaml",
    ):
        found.add(Presets(tmp_path / "two"), "two")
    assert found.list_presets("methods") == {"calm": "one"}


def write_presets(folder: Path, **content: str) -> Presets:
    """A collection with these files: `methods__calm` is methods/calm.yaml."""
    for name, text in content.items():
        path = folder / f"{name.replace('__', '/')}.yaml"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return Presets(folder)


@pytest.mark.parametrize(
    ("name", "content", "reason"),
    [
        ("methods__odd", "[kind", "odd.yaml is not valid YAML"),
        ("ablations__odd", "- kind", "odd.yaml contains a list, expected a mapping"),
        ("methods__odd", "offset: 1", "odd.yaml: the key `kind` is missing, expected the name of a localizer"),
        ("data__odd", "kind: [rooms]", r"odd.yaml: the key `kind` is \['rooms'\], expected the name of a dataset"),
        (
            "methods__odd",
            "kind: even\notherwise: [calm]",
            r"odd.yaml: the key `otherwise` is \['calm'\], expected the name",
        ),
        ("methods__odd", "base: odd.yaml", "odd.yaml inherits from itself"),
        ("methods__odd", "base: 3", "odd.yaml: the key `base` is 3, expected the name of a file"),
    ],
)
def test_a_faulty_preset_costs_only_itself(found, tmp_path, name, content, reason):
    found.add(write_presets(tmp_path, **{name: content, "methods__calm": "kind: even"}), "a-package")
    (failure,) = found.failures
    folder = name.partition("__")[0]
    assert (failure.plugin, failure.package) == (f"{folder}/odd.yaml", "a-package")
    assert re.search(reason, failure.reason)
    assert [path.stem for path, _ in found.preset_files()] == ["calm"]
    with pytest.raises(
        PluginFailed, match=f"the preset {folder}/odd.yaml of the package a-package is invalid: .*{reason}"
    ):
        found.find_preset(folder, "odd")


def test_presets_are_listed_whatever_their_folder(found, tmp_path):
    names = ("voices__loud", "reported__paper", "ablations__all", "data__large", "methods__wild", "methods__calm")
    found.add(write_presets(tmp_path, **dict.fromkeys(names, "kind: even")), "a-package")
    listed = [(path.parent.name, path.stem) for path, _ in found.preset_files()]
    assert listed == [tuple(name.split("__")) for name in (names[5], *names[4:1:-1], *names[1::-1])]


def test_presets_may_come_before_their_role(found, tmp_path):
    found.add(write_presets(tmp_path, voices__loud="kind: even", voices__odd="pitch: 3"), "a-package")
    assert found.failures == []
    found.add(type("Voice", (Role,), {"role": "voice", "presets": "voices"}), "another-package")
    assert found.list_presets("voices") == {"loud": "a-package"}
    assert [(failure.plugin, failure.package) for failure in found.failures] == [("voices/odd.yaml", "a-package")]


def test_a_preset_of_another_folder_may_have_the_same_name(found, tmp_path):
    for folder in ("methods", "data"):
        (tmp_path / folder / folder).mkdir(parents=True)
        (tmp_path / folder / folder / "calm.yaml").write_text("kind: even\n")
        found.add(Presets(tmp_path / folder), folder)
    assert found.list_presets("data") == {"calm": "data"}


def test_the_cores_own_plugin_is_there_whatever_else_is_named(fakes, monkeypatch):
    monkeypatch.setenv("SALFRAME_PLUGINS", "fake_plugin")
    registry.cache_clear()
    assert {package for _, package in registry()} == {"salframe", "fake_plugin"}
    assert registry().names("dataset") == ["folder", "rooms"]
    assert registry().names("detector") == []
    assert "planner" in registry().roles


def test_without_the_variable_what_is_installed_is_found(monkeypatch):
    """In a process of its own, for discovery is done once."""
    monkeypatch.delenv("SALFRAME_PLUGINS", raising=False)
    code = (
        "from salframe.framework.components.registry import registry; "
        "print(*sorted({package for _, package in registry()}))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "salframe" in done.stdout.split()


def test_a_package_is_named_by_its_distribution():
    class Installed:
        name = "salframe-even"

    entry_point = EntryPoint("even", "no_such_module_of_even", GROUP)._for(Installed())
    found = Registry()
    found.load(entry_point)
    (failure,) = found.failures
    assert (failure.plugin, failure.package) == ("even", "salframe-even")
    assert failure.reason == "ModuleNotFoundError: No module named 'no_such_module_of_even'"
