# `make run` moves a virtual stage over a CAN bus, `make live` shows one in a browser, `make test` checks everything,
# `make docs` builds the manual.
# All they need goes into .venv of this checkout; Debian without python3-venv is served, too.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.stamp

.PHONY: run live test vm check docs setup clean

run: $(STAMP)
	$(BIN)/stagectl demo

live: $(STAMP)
	$(BIN)/stagectl serve config/ball-screw.yaml

test: $(STAMP)
	tools/check

docs: $(STAMP)
	$(BIN)/mkdocs build -q -f .mkdocs.yml
	@echo "the manual: site/index.html"

# The tests that want a real CAN interface, systemd and a real-time kernel, in a virtual machine (see tools/vm).
vm: $(STAMP)
	$(BIN)/python tools/vm

setup: $(STAMP)

$(STAMP): pyproject.toml tools/backend/stagectl_build.py
	@$(PYTHON) -c 'import sys; assert sys.version_info >= (3, 11), "stagectl needs Python >= 3.11, this is " + sys.version'
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV) 2>/dev/null || $(PYTHON) -m venv --clear --without-pip $(VENV)
	@echo "setting up $(VENV) (a minute, once)"
	@if $(BIN)/python -m pip --version >/dev/null 2>&1; then $(BIN)/python -m pip install -q --disable-pip-version-check -e '.[dev]'; \
	else $(PYTHON) -m pip --python $(BIN)/python install -q --disable-pip-version-check -e '.[dev]'; fi
	@touch $@

clean:
	rm -rf $(VENV) demo recordings site build
