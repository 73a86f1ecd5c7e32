"""Where the packages lie, which pyproject.toml cannot say: configs/ is salframe.configs."""

from setuptools import find_packages, setup

PARENTS = (".", "plugins", "baselines")
packages = {
    name: f"{parent}/{name.replace('.', '/')}"
    for parent in PARENTS
    for name in find_packages(parent, include=["salframe*"])
}
packages["salframe.configs"] = "configs"

setup(packages=list(packages), package_dir=packages)
