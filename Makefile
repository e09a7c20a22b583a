# lostlink: `make demo` flies the default scenario, `make test` runs the tests. Both set up what they need.
# Further options of `lostlink run`: make demo ARGS="--seed 2", make view ARGS="--view-port 0".
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# Caches of Python and matplotlib stay in .venv, too; without them each process of a run compiles all it imports.
unexport PYTHONDONTWRITEBYTECODE
export PYTHONPYCACHEPREFIX := $(CURDIR)/$(VENV)/pycache
export MPLCONFIGDIR := $(CURDIR)/$(VENV)/matplotlib

# Tests that wait leave a core idle: one worker more than cores.
WORKERS := $(shell $(PYTHON) -c "import os; print(min((os.cpu_count() or 1) + 1, 5))")
PYTEST := --numprocesses $(WORKERS) --dist worksteal
# Files with tests that take long: each worker imports what it collects, and there are five times as many.
SLOW = $$(grep -rlw slow tests --include='test_*.py')

.PHONY: demo view test test-slow test-long repeat check docs bench bench-fdm bench-channel bench-aps schema lock api-docs clean help

help:  ## Show the targets.
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 12

demo: $(VENV)/.run  ## Fly two UA on one radio and write runs/<time>-separation/.
	$(BIN)/lostlink run --first-slot auto $(ARGS)

view: $(VENV)/.view  ## Fly two UA in real time and show them on http://127.0.0.1:8080/.
	$(BIN)/lostlink run --first-slot auto --speed 1 --view $(ARGS)

test: $(VENV)/.dev  ## Run the tests.
	$(BIN)/python -m pytest -m "not slow and not long" $(PYTEST)

test-slow: $(VENV)/.dev  ## Run the tests that take long.
	$(BIN)/python -m pytest -m "slow and not long" $(PYTEST) $(SLOW)

test-long: $(VENV)/.dev  ## Run the tests that take minutes, one after the other.
	$(BIN)/python -m pytest -m long

repeat: $(VENV)/.dev  ## Fly each kind of run again and again, and see that it repeats byte for byte.
	$(BIN)/python -m benchmarks.repeat

check: $(VENV)/.dev docs  ## Format, lint, types, layers, docs.
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports

# Always the whole: of a page that it does not build anew Sphinx repeats no warning.
docs: $(VENV)/.dev  ## Build the docs into site/; a broken link or docstring is an error.
	$(BIN)/sphinx-build --fresh-env --write-all --fail-on-warning --quiet --jobs auto docs site

bench: $(VENV)/.dev  ## Run the benchmarks.
	$(BIN)/python -m benchmarks

bench-fdm: $(VENV)/.dev  ## Run the benchmarks of the flight dynamics (ARDUPILOT_HOME adds those with arducopter).
	$(BIN)/python -m benchmarks fdm fdm_ardupilot fdm_placement fdm_fleet fdm_fuzz

bench-aps: $(VENV)/.dev  ## Run the benchmarks of the MAVLink daemon.
	$(BIN)/python -m benchmarks aps aps_fairness aps_routers

bench-channel: $(VENV)/.dev  ## Run the benchmarks of the channel.
	$(BIN)/python -m benchmarks channel fit

# The build backend is in both locks, so that an install asks the registry for nothing that is not pinned.
$(VENV)/.run: requirements/run.txt pyproject.toml
	@$(PYTHON) -c 'import sys; is_fit = (3, 11) <= sys.version_info < (3, 15); sys.exit(0 if is_fit else "lostlink is installed with Python 3.11 to 3.14 (what requirements/ pins has no builds for others); this is " + sys.version.split()[0] + ": try make PYTHON=python3.14")'
	@echo "installs into $(VENV), for a minute or two"
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements/run.txt
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation --editable .
	touch $@

$(VENV)/.dev: $(VENV)/.run requirements/dev.txt
	@echo "installs what tests and checks need into $(VENV)"
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements/dev.txt
	touch $@

schema: $(VENV)/.dev  ## Write the JSON Schema of scenario files anew.
	$(BIN)/lostlink schema > sitl_configs/scenario.schema.json.new
	mv sitl_configs/scenario.schema.json.new sitl_configs/scenario.schema.json

$(VENV)/.view: $(VENV)/.run requirements/view.txt
	@echo "installs what the live view needs into $(VENV)"
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements/view.txt
	touch $@

lock:  ## Pin requirements/*.txt anew from pyproject.toml (needs uv).
	uv pip compile --quiet --universal --python-version 3.11 --generate-hashes --no-emit-index-url --no-annotate --no-header -o requirements/run.txt pyproject.toml requirements/build.in
	uv pip compile --quiet --universal --python-version 3.11 --generate-hashes --no-emit-index-url --no-annotate --no-header --extra dev -c requirements/run.txt -o requirements/dev.txt pyproject.toml requirements/build.in
	uv pip compile --quiet --universal --python-version 3.11 --generate-hashes --no-emit-index-url --no-annotate --no-header --extra view -c requirements/dev.txt -o requirements/view.txt pyproject.toml requirements/build.in

api-docs: $(VENV)/.dev  ## Write docs/reference/aps-api.md from the API's OpenAPI document.
	$(BIN)/python -m aps.api.reference

clean:  ## Remove what make set up (not runs/).
	rm -rf $(VENV) build dist .mypy_cache .pytest_cache .ruff_cache .import_linter_cache .hypothesis
