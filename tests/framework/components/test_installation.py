"""What is installed, what is missing, and what did not load."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from salframe.framework.components.installation import (
    diagnose,
    environment,
    folder_bytes,
    installed_version,
    list_components,
    list_names,
)
from salframe.framework.components.registry import Failure, registry
from salframe.framework.errors import RequirementMissing
from salframe.framework.files.weights import NetworkWeights, WeightsFile
from salframe.framework.hookspecs import Presets
from salframe.graphs.saliency import SaliencyModel


class Model(SaliencyModel):
    """A model whose summary
    takes two lines.

    And more.
    """

    name, version = "model", "3"

    def score(self, detections):
        return detections.scores


class Demanding(Model):
    """Needs what nobody has."""

    name = "demanding"
    requires, extra = ("no_such_package_of_salframe",), "no-such-package[all]"


class Crashing(Model):
    """Its check is broken."""

    name = "crashing"

    @classmethod
    def check(cls, config):
        raise ZeroDivisionError("division by zero")


@pytest.fixture
def models(fakes):
    for component in (Model, Demanding, Crashing):
        registry().add(component, "a-package")


def test_components_are_listed_with_what_they_lack(models):
    found = {one.name: one for one in list_components() if one.role == "saliency"}
    assert found["model"].missing is None
    assert (found["model"].version, found["model"].package) == ("3", "a-package")
    assert found["model"].summary == "A model whose summary takes two lines."
    lacks = (
        "demanding needs the Python package no_such_package_of_salframe, which is not installed: "
        "pip install 'no-such-package[all]'"
    )
    assert found["demanding"].missing == lacks
    assert found["crashing"].missing == "ZeroDivisionError: division by zero"
    with pytest.raises(RequirementMissing):
        Demanding()


def test_names_are_presets_and_components(models, tmp_path):
    (tmp_path / "methods").mkdir()
    (tmp_path / "methods" / "lost.yaml").write_text("kind: reader\noffset: 2\n")
    (tmp_path / "methods" / "orphan.yaml").write_text("kind: oracle\n")
    registry().add(Presets(tmp_path), "a-package")
    found = {one.name: one for one in list_names("localizer")}
    assert found["lost"].package == "a-package"
    assert found["lost"].missing is None
    assert found["reader"].package == "fake_plugin"
    assert found["orphan"].missing.startswith("unknown localizer 'oracle'")
    assert found["weightless"].missing.startswith("weightless.pth is not at hand")


def test_a_diagnosis_changes_nothing_and_tells_what_failed(models, tmp_path):
    assert diagnose().healthy
    registry().failures.append(Failure("oracle", "salframe-oracle", "ImportError: no crystal"))
    (tmp_path / "cache" / "deep").mkdir(parents=True)
    (tmp_path / "cache" / "deep" / "entry").write_bytes(b"12345")
    found = diagnose()
    assert not found.healthy
    assert (found.cache, found.cache_bytes) == (tmp_path / "cache", 5)
    assert [failure.package for failure in found.failures] == ["salframe-oracle"]


def test_the_environment_is_json_with_the_versions_that_matter(models):
    found = json.loads(json.dumps(environment()))
    assert found["packages"]["numpy"] == installed_version("numpy")
    assert "pytest" not in found["packages"]
    assert {"role": "saliency", "name": "model", "version": "3", "package": "a-package"} in found["plugins"]
    assert installed_version("no-such-package-of-salframe") is None


def test_a_folder_that_is_not_there_is_empty():
    assert folder_bytes(Path("/no/such/folder")) == 0


def test_a_file_under_two_paths_takes_its_bytes_once(tmp_path):
    (tmp_path / "one").write_bytes(b"12345")
    (tmp_path / "other").hardlink_to(tmp_path / "one")
    (tmp_path / "copy").write_bytes(b"12345")
    assert folder_bytes(tmp_path) == 10


class Leaving(Model):
    """Ends the process when it is checked."""

    name = "leaving"

    @classmethod
    def check(cls, config):
        raise SystemExit


class Gone:
    """A source that ends the process."""

    def installed(self, file):
        raise SystemExit(0)


class Hidden(Model):
    """Its weights cannot be looked for."""

    name = "hidden"
    weights = (NetworkWeights("hidden", "MIT", (WeightsFile("hidden.pt", "0" * 64, 1),), Gone()),)


def test_a_component_that_ends_the_process_ends_no_listing(fakes):
    registry().add(Leaving, "a-package")
    registry().add(Hidden, "a-package")
    found = {one.name: one for one in (*list_components(), *list_names("saliency"))}
    assert found["leaving"].missing == "SystemExit"
    assert found["hidden"].missing == "SystemExit: 0"
    assert diagnose().weights == {"hidden": "SystemExit: 0"}


def test_an_interrupt_passes_through_a_listing(fakes, monkeypatch):
    def interrupt(config):
        raise KeyboardInterrupt

    monkeypatch.setattr(Leaving, "check", interrupt)
    registry().add(Leaving, "a-package")
    with pytest.raises(KeyboardInterrupt):
        list(list_components())


def test_a_preset_whose_file_is_lost_costs_only_itself(models, tmp_path):
    path = tmp_path / "methods" / "lost.yaml"
    path.parent.mkdir()
    path.write_text("kind: reader\n")
    registry().add(Presets(tmp_path), "a-package")
    path.unlink()
    found = {one.name: one for one in list_names("localizer")}
    assert found["lost"].missing.startswith("cannot read ")
    assert found["reader"].missing is None
