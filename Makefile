# Both targets share one virtual environment, .venv, with the versions of constraints.txt.
PYTHON ?= python3
# Python compiles what it imports; pip would compile all of torch and transformers.
unexport PYTHONDONTWRITEBYTECODE  # else each of the processes that tests start compiles anew
INSTALL = .venv/bin/python -m pip install --quiet --disable-pip-version-check --no-compile --constraint constraints.txt
EXTRAS = test,keypoints,training,transformers,node2vec,fast,floors,clip,words,assets,tflite,colmap,ros,rerun,serve,text
WEIGHTS = xfeat xfeat-nn aliked-nn aliked-lightglue disk-lightglue efficientnet-lite0
# A module's tests run in one process, a process a core, of one thread each: threads that wait for each other cost more.
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

# The newest versions of what demo, test and docs install, under the header that constraints.txt has.
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
