# Everything a newcomer needs: `make demo` and `make test`. Both install what they use into .venv.
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin

.PHONY: install dev demo test thorough lint docs format bench fmus clean

install: $(VENV)/.installed
dev: $(VENV)/.installed-dev

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "fieldlink needs Python 3.11 or newer; name one: make PYTHON=python3.11 $(MAKECMDGOALS)" >&2; exit 2; }
	$(PYTHON) -m venv $(VENV)

# The plants need a C compiler to become FMUs: the machine's own, or zig from PyPI.
# The warm-up compiles the numeric kernels once, into the cache beside their sources.
$(VENV)/.installed: pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --quiet --editable '.[all]'
	@command -v cc >/dev/null 2>&1 || command -v gcc >/dev/null 2>&1 || $(BIN)/python -m pip install --quiet --editable '.[build]'
	$(BIN)/python -m fmu_models.build
	$(BIN)/fieldlink warm-up
	@touch $@

$(VENV)/.installed-dev: pyproject.toml $(VENV)/.installed
	$(BIN)/python -m pip install --quiet --editable '.[dev]'
	$(BIN)/python -m benchmarks.compile_families
	@touch $@

# The page stays open afterwards: make demo HOLD=600, in seconds.
demo: install
	$(BIN)/fieldlink demo $(if $(HOLD),--hold $(HOLD))

# Four workers, a file at a time: the daemon's tests wait for clocks more than they compute. The order
# is that of tests/conftest.py, which begins with the slow files.
test: dev
	$(BIN)/python -m pytest -n 4 --dist loadfile --no-loadscope-reorder

# What the suite leaves out: many seeds, whole commands, kernels compiled for other processors.
thorough: dev
	$(BIN)/python -m pytest -m thorough -n 2

lint: dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python -m tools.words

# A site that works from its folder, without a network: build/docs/index.html.
docs: dev
	$(BIN)/python -m tools.reference_pages
	$(BIN)/sphinx-build -q -E -W --keep-going -b html docs build/docs

format: dev
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

# About an hour on two cores, and nothing else running; each line alone prints its own table.
bench: dev
	$(BIN)/python -m benchmarks.settings_page --out docs
	$(BIN)/python -m benchmarks.house_picture --images docs/images
	$(BIN)/python -m benchmarks.estimator_evidence --out docs/benchmarks --images docs/images
	$(BIN)/python -m benchmarks.diagnosis --out docs/benchmarks
	$(BIN)/python -m benchmarks.compensation --out docs/benchmarks --images docs/images
	$(BIN)/python -m benchmarks.compensation_apart --out docs/benchmarks
	$(BIN)/python -m benchmarks.demo_course --first 1001 --out docs/benchmarks
	$(BIN)/python -m benchmarks.fmu --out docs/benchmarks
	$(BIN)/python -m benchmarks.fmu_zoo --out docs/benchmarks
	$(BIN)/python -m benchmarks.link --out docs/benchmarks
	$(BIN)/python -m benchmarks.load --out docs/benchmarks
	$(BIN)/python -m benchmarks.upward --out docs/benchmarks
	$(BIN)/python -m benchmarks.opcua --out docs/benchmarks
	$(BIN)/python -m benchmarks.web_page --out docs/benchmarks
	$(BIN)/python -m benchmarks.web_pictures --images docs/images
	$(BIN)/python -m benchmarks.kills --runs 50 --out docs/benchmarks
	$(BIN)/python -m benchmarks.assess_fleet --out docs/benchmarks

fmus: install
	$(BIN)/python -m fmu_models.build

clean:
	rm -rf $(VENV) build *.egg-info fieldlink-demo .mypy_cache .ruff_cache .pytest_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
