# Both targets share one virtual environment, .venv, with the versions of constraints.txt.
PYTHON ?= python3
INSTALL = .venv/bin/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt

.PHONY: demo test slow lint benchmark docs

demo: .venv/demo.installed
	.venv/bin/salframe compare --methods proposed,loftr,objects

test: .venv/test.installed
	.venv/bin/python -m pytest

slow: .venv/test.installed
	.venv/bin/python -m pytest -m "slow or not slow"

benchmark: .venv/test.installed
	.venv/bin/python -m pytest tests/benchmarks -m "slow or not slow" --benchmark-only

lint: .venv/test.installed
	.venv/bin/ruff check .
	.venv/bin/mypy
	.venv/bin/lint-imports

docs: .venv/demo.installed
	$(INSTALL) --editable ".[docs]"
	.venv/bin/python docs/generate_reference.py
	.venv/bin/mkdocs build --strict

.venv/bin/python:
	$(PYTHON) -m venv .venv

.venv/demo.installed: .venv/bin/python pyproject.toml constraints.txt
	$(INSTALL) --editable .
	touch $@

.venv/test.installed: .venv/demo.installed
	$(INSTALL) --editable ".[test,keypoints,training,transformers,node2vec,clip,assets,tflite]"
	for name in xfeat xfeat-nn aliked-nn aliked-lightglue disk-lightglue efficientnet-lite0; do .venv/bin/salframe weights fetch $$name || exit 1; done
	touch $@
