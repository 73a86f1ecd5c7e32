# All targets use one virtual environment, .venv, with the versions of constraints.txt.
PYTHON ?= python3
# --no-compile: Python compiles only the modules that it imports. pip would compile all of torch and transformers.
unexport PYTHONDONTWRITEBYTECODE  # if it were set, each process that tests start would compile the modules again
INSTALL = .venv/bin/python -m pip install --quiet --disable-pip-version-check --no-compile --constraint constraints.txt
EXTRAS = test,keypoints,training,transformers,node2vec,fast,floors,clip,words,assets,tflite,colmap,ros,rerun,serve,text
WEIGHTS = xfeat xfeat-nn aliked-nn aliked-lightglue disk-lightglue efficientnet-lite0
# One process per core with one thread each, because more threads slow each other down. --dist loadfile: all tests of a
# file run in the same process.
PYTEST = OMP_NUM_THREADS=1 .venv/bin/python -m pytest --numprocesses auto --dist loadfile --benchmark-disable

.PHONY: demo test slow lint benchmark docs wheel constraints

demo: .venv/demo.installed
	.venv/bin/salframe compare --methods proposed,usg,sovs,objects,loftr

test: .venv/test.installed
	$(PYTEST)

slow: .venv/test.installed
	$(PYTEST) -m "slow or not slow"

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

wheel: .venv/test.installed
	.venv/bin/python -m build --outdir dist .

# Write the newest versions of the packages of demo, test and docs to constraints.txt. Its header stays.
constraints:
	rm -rf build/newest
	$(PYTHON) -m venv build/newest
	build/newest/bin/python -m pip install --quiet --editable ".[$(EXTRAS),docs]"
	sed '/^[^#]/d' constraints.txt > build/constraints.txt
	build/newest/bin/python -m pip freeze --all --exclude pip --exclude-editable | sed 's/+cpu$$//' >> build/constraints.txt
	mv build/constraints.txt constraints.txt

.venv/bin/python:
	$(PYTHON) -m venv .venv

.venv/demo.installed: .venv/bin/python pyproject.toml constraints.txt
	$(INSTALL) --editable .
	touch $@

.venv/test.installed: .venv/demo.installed
	$(INSTALL) --editable ".[$(EXTRAS)]"
	echo $(WEIGHTS) | xargs -n 1 -P 2 .venv/bin/salframe weights fetch
	touch $@
