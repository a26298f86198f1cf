# `make run` moves a virtual stage over a CAN bus, `make live` shows one in a browser, `make test` checks everything,
# `make docs` builds the manual.
# What they need goes into .venv of this checkout: the core with the extra `run`, which is what every command of the README
# needs. What tests and manual need beyond it follows when they are first asked for;
# Debian without python3-venv is served, too.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.stamp
DEVELOPER := $(VENV)/.stamp-dev
# Modules are compiled when they are first imported: all of them at once would take half a minute.
PIP := install -q --disable-pip-version-check --no-compile
# Many containers set this: then nothing is kept, and each start of a program compiles its modules anew.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: run live test vm zoo nightly check docs setup clean

run: $(STAMP)
	$(BIN)/stagectl demo

live: $(STAMP)
	$(BIN)/stagectl serve config/ball-screw.yaml

test: $(DEVELOPER)
	tools/check

docs: $(DEVELOPER)
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build -q -f mkdocs.yml
	@echo "the manual: site/index.html"

# The tests that want a real CAN interface, systemd and a real-time kernel, in a virtual machine (see tools/vm).
vm: $(DEVELOPER)
	$(BIN)/python tools/vm

# Every foreign drive in every test (see tests/zoo); `make test` tries a sample of them.
zoo: $(DEVELOPER)
	STAGECTL_ZOO=all $(BIN)/pytest -n 2 tests/zoo

# What takes too long for each change: every foreign drive, 50 second masters, every page of the manual with both papers
# whole, more diagnoses, records, damaged logs and drawn requests, 200 stops under attack, the virtual machine.
nightly: zoo
	STAGECTL_SECOND_MASTERS=50 $(BIN)/pytest tests/test_second_master.py
	STAGECTL_PRINTED=all $(BIN)/pytest tests/test_printed.py
	STAGECTL_LONG=100 $(BIN)/pytest -n 2 tests/gap tests/web/test_openapi.py
	$(BIN)/python tools/bench/stops.py
	$(BIN)/python tools/vm

setup: $(DEVELOPER)

define install
	@echo "setting up $(VENV) for '$(1)' (two minutes, once)"
	@if $(BIN)/python -m pip --version >/dev/null 2>&1; then $(BIN)/python -m pip $(PIP) -e '.[$(1)]' -e tools/studies; \
	else $(PYTHON) -m pip --python $(BIN)/python $(PIP) -e '.[$(1)]' -e tools/studies; fi
	@touch $@
endef

$(STAMP): pyproject.toml tools/studies/pyproject.toml tools/backend/stagectl_build.py
	@$(PYTHON) -c 'import sys; assert sys.version_info >= (3, 11), "stagectl needs Python >= 3.11, this is " + sys.version'
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV) 2>/dev/null || $(PYTHON) -m venv --clear --without-pip $(VENV)
	$(call install,run)

$(DEVELOPER): $(STAMP)
	$(call install,dev)

clean:
	rm -rf $(VENV) demo recordings site build
