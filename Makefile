# Two commands: `make run` moves a virtual stage over a CAN bus, `make test` checks everything.
# All they need goes into .venv of this checkout; Debian without python3-venv is served, too.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.stamp

.PHONY: run test check setup clean

run: $(STAMP)
	$(BIN)/stagectl demo

test: $(STAMP)
	tools/check

setup: $(STAMP)

$(STAMP): pyproject.toml
	@$(PYTHON) -c 'import sys; assert sys.version_info >= (3, 11), "stagectl needs Python >= 3.11, this is " + sys.version'
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV) 2>/dev/null || $(PYTHON) -m venv --clear --without-pip $(VENV)
	@echo "setting up $(VENV) (a minute, once)"
	@if $(BIN)/python -m pip --version >/dev/null 2>&1; then $(BIN)/python -m pip install -q --disable-pip-version-check -e '.[dev]'; \
	else $(PYTHON) -m pip --python $(BIN)/python install -q --disable-pip-version-check -e '.[dev]'; fi
	@touch $@

clean:
	rm -rf $(VENV) demo recordings
