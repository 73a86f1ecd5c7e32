"""Virtual environments of their own, for tests that use salframe as a stranger would."""

from __future__ import annotations

import os
import site
import subprocess
import sys
import venv
from pathlib import Path


def make_environment(home: Path) -> Path:
    """The interpreter of a new, empty environment in `home`."""
    venv.create(home, with_pip=False)
    return home / ("Scripts" if os.name == "nt" else "bin") / "python"


def see_packages(python: Path) -> None:
    """Let an environment see the packages of this one behind its own, editable installations too."""
    packages = Path(
        output(python.parent, python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))").strip()
    )
    (packages / "outside.pth").write_text(
        "".join(f"import site; site.addsitedir({folder!r})\n" for folder in site.getsitepackages())
    )


def pip_install(python: Path, *arguments: object) -> None:
    """`pip install ARGUMENTS` into an environment, by the pip of this one."""
    pip = [sys.executable, "-m", "pip", "--python", str(python), "install", "--quiet", *map(str, arguments)]
    done = subprocess.run(pip, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def strangers_variables(folder: Path) -> dict[str, str]:
    """The environment variables of someone who has set none for salframe; what it caches goes to `folder`."""
    kept = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "SALFRAME_PLUGINS")}
    return {**kept, "SALFRAME_CACHE": str(folder / "cache"), "COLUMNS": "200"}


def output(folder: Path, *command: object) -> str:
    """What a command prints that a stranger runs in `folder`; it has to succeed."""
    done = subprocess.run(
        [*map(str, command)], cwd=folder, env=strangers_variables(folder), capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, f"{done.stdout}\n{done.stderr}"
    return done.stdout
