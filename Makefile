# Two commands: `make demo` watches robots learn, `make test` proves it. Both do all set-up.
SHELL := /bin/bash
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
# The robots alone need neither the tools of tests and checks nor what only some extras use.
DEMO_READY := $(VENV)/.demo-ready
# Of what pip says, the packages of 10 MB and more as they are downloaded: else minutes pass in silence.
LARGE := 's,^ *Downloading \(.*/\)\{0\,1\}\([A-Za-z0-9_.]*\)-[0-9].*(\([0-9][0-9][0-9.]* MB\).*,  fetching \2\, \3,p'
# Open3D and the off-screen renderer link against these; nothing else is needed from the system.
SYSTEM_PACKAGES := python3-venv libgl1 libegl1 libusb-1.0-0 libgomp1 libx11-6

# Two processes of tests more than two cores: while tests wait for servers, others run.
WORKERS ?= 4
IN_PARALLEL := -n $(WORKERS) --dist loadscope --no-loadscope-reorder
# Compiled modules are kept even where the environment says otherwise: each of the some hundred
# processes that tests start would compile what it imports, a third of its time.
test test-quick test-deep test-night check: export PYTHONDONTWRITEBYTECODE :=
# What programs write and how files are read does not hang on the locale of whoever runs the tests.
test test-quick test-deep test-night check: export LC_ALL := C.UTF-8

.PHONY: help setup system pages demo test test-quick test-deep test-night coverage check conformance bench site dist clean

help:  ## list the targets
	@grep -hE '^[a-z-]+:.*##' Makefile | sed -E 's/:.*## /\t/' | expand -t 14

setup: $(READY)  ## create .venv and install everything

system:
	@missing=""; \
	if command -v dpkg-query >/dev/null; then \
	  for package in $(SYSTEM_PACKAGES); do \
	    dpkg-query -W -f='$${Status}' $$package 2>/dev/null | grep -q 'ok installed' || missing="$$missing $$package"; \
	  done; \
	  if $(PYTHON) -c 'import ensurepip' 2>/dev/null; then missing="$${missing/ python3-venv/}"; fi; \
	fi; \
	if [ -z "$$missing" ]; then exit 0; fi; \
	if [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null; then \
	  echo "installing system packages:$$missing"; \
	  apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends $$missing; \
	else \
	  echo "system packages are missing; install them with:  sudo apt-get install$$missing"; exit 1; \
	fi

$(READY): EXTRAS := dev,browser
$(DEMO_READY): EXTRAS := simulate
$(READY) $(DEMO_READY): pyproject.toml
	@$(MAKE) --no-print-directory system
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "RTASK needs Python 3.11 or newer: make PYTHON=python3.11 setup")'
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	@echo "installing Python packages (a few minutes the first time)"
	@set -o pipefail; $(BIN)/python -m pip install --disable-pip-version-check --progress-bar off -e '.[$(EXTRAS)]' \
	  | sed -un -e $(LARGE) -e 's/^Installing collected packages.*/  all are here: unpacking/p'
	@echo "compiling numeric kernels (about a minute, once; some go on in the background)"
	@$(MAKE) --no-print-directory pages & \
	$(BIN)/rtask doctor --warm-up --background --quiet; status=$$?; wait; exit $$status
	@touch $@
	@echo "ready: source $(BIN)/activate puts the command rtask into the PATH"

# The query editor and the 3D view of clouds. Without npm the pages do without both.
pages:  ## bundle the libraries of two pages, if npm is installed
	@if command -v npm >/dev/null; then \
	  echo "bundling the editor and the 3D view"; \
	  cd endpoint/pages && npm ci --silent --ignore-scripts --no-audit --no-fund && npm run --silent build \
	    || echo "npm could not fetch them: pages use a plain text area and flat views"; \
	else \
	  echo "npm is not installed: pages use a plain text area and flat views"; \
	fi

demo: $(if $(wildcard $(READY)),$(READY),$(DEMO_READY))  ## robots learn to grasp and share it; ARGS="--seed 3" passes options
	@$(BIN)/rtask demo $(ARGS)

test: $(READY)  ## run the tests but for the deep ones; ARGS="-k name" passes options
	@$(BIN)/python -m pytest $(IN_PARALLEL) $(ARGS)

test-quick: $(READY)  ## run the tests that are not slow; ARGS as above
	@$(BIN)/python -m pytest -q $(IN_PARALLEL) -p no:schemathesis -m "not slow and not deep and not browser" $(ARGS)

test-deep: $(READY)  ## run the tests of large sizes and many draws, which `make test` leaves out
	@$(BIN)/python -m pytest $(IN_PARALLEL) --timeout 900 -m "deep and not night" tests $(ARGS)

test-night: $(READY)  ## run whole studies, which `make test-deep` leaves out: an hour
	@$(BIN)/python -m pytest $(IN_PARALLEL) --timeout 900 -m night tests $(ARGS)

coverage: $(READY)  ## which lines of each room its tests run; ARGS="reasoner grasp" for some rooms
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check 'coverage>=7.10'
	@$(BIN)/python -m tests.covered $(ARGS)

check: $(READY)  ## lint, types, import layers, docs
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/mypy
	@$(BIN)/lint-imports
	@$(BIN)/python -m pytest -q -n $(WORKERS) --dist worksteal -m '' tests/docs
	@$(MAKE) --no-print-directory site

conformance: $(READY)  ## the standards' own test suites, one line each
	@$(BIN)/python tests/conformance/report.py

bench: $(READY)  ## every benchmark, both sides and the ratio
	@ended=; for script in tests/benchmarks/*/bench_*.py; do \
	  echo "== $$script"; $(BIN)/python $$script || ended="$$ended $$script"; \
	done; \
	if [ -n "$$ended" ]; then echo "failed, or lacked their data:$$ended"; exit 1; fi

site: $(READY)  ## build the documentation as a site with search, in site/
	@NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet --strict

dist: $(READY)  ## build sdist and wheel in dist/, the wheel from the sdist, and check both
	@$(BIN)/python -m tests.packaging.distributions dist

clean:  ## remove everything that the targets made
	rm -rf $(VENV) dist build rtask-demo rtask-recorded .pytest_cache .mypy_cache .ruff_cache .import_linter_cache .hypothesis .coverage-rooms
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
