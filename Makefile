# Everything that a developer, or somebody who is curious, does with a checkout.
# It needs Python 3.11 or newer and make; the rest goes into .venv, here.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check install --quiet

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PHONY: help install pinned lock audit demo demo-live test lint types unit coverage acceptance fuzz system-test benchmark seeds deb deb-test dist hardware-report next-python clean

help: ## Show this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "  make %-11s %s\n", $$1, $$2}' \
		$(MAKEFILE_LIST)

install: $(VENV)/.installed ## Make the environment .venv and install imu-tracker there

# The stamps are younger than what was installed from: nothing is asked of any index
# as long as nothing changed.
$(VENV)/.installed: pyproject.toml $(VENV)/.made
	@echo "installing imu-tracker and its tools into $(VENV)"
	@$(PIP) --editable '.[dev]'
	@touch $@

pinned: $(VENV)/.made ## The same by requirements-dev.txt: these versions, these hashes
	@$(PIP) --require-hashes --requirement requirements-dev.txt
	@$(PIP) --no-deps --no-build-isolation --editable .
	@touch $(VENV)/.installed

# Their tools live apart: they bring a hundred packages, and want a pip of their own.
AUDIT := $(VENV)/audit
$(AUDIT)/.installed: $(VENV)/.made
	@$(PYTHON) -m venv $(AUDIT)
	@$(AUDIT)/bin/python -m pip --disable-pip-version-check install --quiet \
		'pip-tools>=7.4,<8' 'pip-audit>=2.7,<3'
	@touch $@

lock: $(AUDIT)/.installed ## Choose the versions of requirements-dev.txt anew
	@CUSTOM_COMPILE_COMMAND='make lock' $(AUDIT)/bin/pip-compile --quiet --upgrade \
		--generate-hashes --allow-unsafe --strip-extras --extra dev \
		--all-build-deps --no-emit-index-url --no-emit-trusted-host \
		--no-emit-find-links --output-file requirements-dev.txt pyproject.toml

audit: $(AUDIT)/.installed ## Ask whether anything pinned has a known vulnerability
	@$(AUDIT)/bin/pip-audit --progress-spinner off --disable-pip --require-hashes \
		--requirement requirements-dev.txt >$(AUDIT)/report 2>&1; code=$$?; \
	if [ $$code != 0 ] && grep -Eq 'ConnectionError|Max retries|ServiceError|timed out' \
		$(AUDIT)/report; then echo "audit: skipped, there is no network"; \
	else cat $(AUDIT)/report; unknown=$$(grep -c 'not be audited' $(AUDIT)/report); \
		[ $$unknown = 0 ] || echo "audit: $$unknown of the pins could not be looked up"; \
		exit $$code; fi

$(VENV)/.package: $(VENV)/.installed
	@$(PIP) --editable '.[package]'
	@touch $@

$(VENV)/.benchmark: $(VENV)/.installed
	@$(PIP) --editable '.[benchmark]'
	@touch $@

$(VENV)/.fuzz: $(VENV)/.installed
	@$(PIP) --editable '.[fuzz]'
	@touch $@

$(VENV)/.made:
	@command -v $(PYTHON) >/dev/null || { \
		echo "$(PYTHON) is missing; on Debian and Raspberry Pi OS:" \
			"sudo apt install python3 python3-venv" >&2; exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
		echo "imu-tracker needs Python 3.11 or newer, and $(PYTHON) is" \
			"$$($(PYTHON) -V 2>&1); name another: make PYTHON=python3.11" >&2; exit 1; }
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || { \
		echo "Python's venv is missing; on Debian and Raspberry Pi OS:" \
			"sudo apt install python3-venv" >&2; exit 1; }
	@rm -rf $(VENV)
	@$(PYTHON) -m venv $(VENV)
	@touch $@

demo: install ## Track a simulated drive with a tunnel, and draw it: half a minute
	@rm -rf demo
	@echo "ten minutes of driving at 20 times their speed; meanwhile, elsewhere:"
	@echo "  $(BIN)/imu-tracker status --watch --config config/demo.toml"
	@$(BIN)/imu-tracker run --config config/demo.toml
	@echo
	@echo "the end of the log, demo/latlong.csv:"
	@head -n 1 demo/latlong.csv
	@tail -n 5 demo/latlong.csv
	@echo
	@$(BIN)/imu-tracker plot --quiet demo/latlong.csv --output demo/latlong.png
	@echo "the picture of the track: $(CURDIR)/demo/latlong.png"

demo-live: install ## The same drive in real time, with the live page to look at
	@rm -rf demo
	@$(BIN)/imu-tracker run --quiet --config config/demo.toml --set source.speed=1 & \
	run=$$!; trap 'kill $$run 2>/dev/null' EXIT; trap 'exit 0' INT TERM; \
	(sleep 3; command -v xdg-open >/dev/null && \
		xdg-open http://localhost:8086/ >/dev/null 2>&1) & \
	echo "open http://localhost:8086/ in a browser; Ctrl-C ends it"; \
	$(BIN)/imu-tracker serve --config config/demo.toml

test: lint types unit ## Check everything: style, types, the tests

lint: install ## Check style and format
	$(BIN)/ruff check
	$(BIN)/ruff format --check

types: install ## Check types
	$(BIN)/mypy

unit: install ## Run the tests alone
	$(BIN)/pytest --numprocesses=auto --dist=worksteal --durations=10 --durations-min=2

coverage: install ## The same, and which lines they never reach; twice the time
	$(BIN)/pytest --numprocesses=auto --cov --cov-report=term --cov-fail-under=90

acceptance: install ## Run the long tests: all seeds, all drives; takes hours
	$(BIN)/pytest -m acceptance --numprocesses=auto

system-test: install ## Test on a real kernel and systemd, under QEMU: as root, 20 minutes
	@tests/system/build_image.sh
	$(BIN)/pytest -m system -v tests/system

fuzz: $(VENV)/.fuzz ## Feed every reader a million hostile cases; takes hours
	PYTHONPATH=tests $(BIN)/python -m fuzz

benchmark: $(VENV)/.benchmark ## Measure the speed, beside others
	$(BIN)/python -m benchmarks

seeds: install ## Beat the figures of the thesis that it starts from, and draw them
	$(BIN)/python -m benchmarks.seeds --pictures seeds

DEBIANS := 12 13
ARCHES := arm64 amd64
deb: $(VENV)/.package ## Build the Debian packages into dist/ (DEBIANS=13 ARCHES=arm64: one)
	@for debian in $(DEBIANS); do for arch in $(ARCHES); do \
		PYTHON=$(BIN)/python packaging/build_deb.sh $$debian $$arch || exit 1; \
	done; done

deb-test: ## Try the amd64 packages of dist/ in a Debian of their own: as root
	@for debian in $(DEBIANS); do \
		packaging/try_deb.sh $$debian dist/imu-tracker_*+deb$${debian}_amd64.deb || exit 1; \
	done

dist: deb ## Make everything of a release in dist/: sdist, wheel, packages, checksums
	@$(BIN)/python -m build --outdir dist >/dev/null
	@$(BIN)/python packaging/release_notes.py >dist/RELEASE_NOTES.md
	@cd dist && sha256sum *.tar.gz *.whl *.deb >SHA256SUMS && ls -l

next-python: ## Run the unit tests on Python 3.13, in a Debian 13 of its own: as root
	@.ci/next_python

hardware-report: install ## On a Pi: measure bus, chip and receiver for ten minutes, to one file
	@$(BIN)/imu-tracker hardware-report --output hardware-report.json

clean: ## Remove what was made here, the environment too
	rm -rf $(VENV) demo seeds build dist htmlcov .coverage .coverage.* .hypothesis \
		.mypy_cache .pytest_cache .ruff_cache
