from __future__ import annotations

import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).parent.parent


@pytest.mark.slow
def test_the_wheel_holds_every_package_preset_template_and_network(tmp_path):
    source = tmp_path / "source"
    source.mkdir()
    for name in ("salframe", "plugins", "baselines", "configs", "training", "pyproject.toml", "setup.py", "README.md"):
        path = REPOSITORY / name
        copy = shutil.copytree if path.is_dir() else shutil.copy
        copy(path, source / name, **({"ignore": shutil.ignore_patterns("__pycache__")} if path.is_dir() else {}))
    command = [sys.executable, "-c", "from setuptools.build_meta import build_wheel; build_wheel('.')"]
    subprocess.run(command, cwd=source, check=True, capture_output=True)
    (wheel,) = source.glob("*.whl")
    packed = set(zipfile.ZipFile(wheel).namelist())
    expected = {
        f"salframe/configs/{path.relative_to(REPOSITORY / 'configs')}"
        for path in (REPOSITORY / "configs").rglob("*.yaml")
    }
    expected |= {str(path.relative_to(REPOSITORY)) for path in (REPOSITORY / "salframe").rglob("*.jinja")}
    weights = REPOSITORY / "baselines" / "salframe_keypoints" / "loftr_compact_weights"
    expected |= {f"salframe_keypoints/{weights.name}/{path.name}" for path in weights.iterdir()}
    cards = REPOSITORY / "plugins" / "salframe_segments"
    expected |= {f"salframe_segments/{path.relative_to(cards)}" for path in cards.rglob("*.yaml")}
    expected |= {f"salframe_panoseg/{name}" for name in ("panoseg.onnx", "panoseg.json")}
    for container in (REPOSITORY, REPOSITORY / "plugins", REPOSITORY / "baselines"):
        expected |= {str(path.relative_to(container)) for path in container.glob("salframe*/**/*.py")}
    assert expected - packed == set()
    assert {name.partition("/")[0] for name in packed if not name.startswith("salframe")} == set()


def test_the_import_contracts_are_about_every_package():
    options = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())["tool"]["importlinter"]
    plugins = {path.name for part in ("plugins", "baselines") for path in (REPOSITORY / part).glob("salframe_*")}
    contracts = {contract["type"]: contract for contract in options["contracts"]}
    assert set(options["root_packages"]) == plugins | {"salframe"}
    assert set(contracts["independence"]["modules"]) == set(contracts["forbidden"]["forbidden_modules"]) == plugins
