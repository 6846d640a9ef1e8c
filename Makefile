# make setup      .venv with everything (done by the others when needed)
# make demo       the service and its client, from photographs to ranked next views: make demo IMAGES=path/to/photographs
#                 (without any: kermit in FVS_DATA, else a simulated courtyard); KEEP=1 leaves its page open until Ctrl-C
# make demo-flight  a simulated copter photographs a courtyard on its own, from view to view
# make test       all checks and the quick tests of everything: make test WORKERS=6 for more than four processes at once
# make unit       the tests that start no process and read no photograph
# make test-system  whole flights, services, clients and experiments, from end to end; CI runs them after `make test`
# make test-slow  the long checks, most of them on real photographs, and the tests in one process with more examples
# make container-test  builds the images and takes a scene through the compose files, as root on Debian 12, with Podman
# make coverage   branch coverage of `make test test-system`, with the processes that tests start
# make docs       the documentation as a site in site/ (make docs && python -m http.server --directory site)
# make generate   what is made from other code: the synchronous client from clients/python/fvs_client/_async, the
#                 messages of gRPC from proto/, and the console from clients/web
# make lint       format and fix what can be fixed, then lint
# make bench      the benchmarks of the kernels: raster, score, selection, train (those that take longer: docs/results.md)

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed
GENERATED := tests/clients/generated
CONSOLE := clients/web
CONSOLE_INSTALLED := $(CONSOLE)/node_modules/.installed
GENERATORS := $(VENV)/generators/.installed
FVS_DATA ?= ../shared/data
IMAGES ?= $(wildcard $(FVS_DATA)/kermit)
OUT ?= out/demo
# Two more than the two cores: the tests often wait, for processes and deadlines.
WORKERS ?= 4

# Python keeps what it compiled even where the environment forbids it: the tests start many processes.
export PYTHONDONTWRITEBYTECODE :=

.PHONY: setup demo demo-flight docs test unit check check-console kernels generate lint test-system test-slow container-test coverage bench clean

setup: $(INSTALLED) $(GENERATORS)

# torch goes first and by its pin: it is then the CPU build where one is offered, and stays.
$(INSTALLED): pyproject.toml clients/python/pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade 'pip>=25.1'
	$(BIN)/python -m pip install --quiet --constraint constraints.txt torch
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable . --editable ./clients/python --group dev
	touch $@

# The console's libraries and tools; Node.js comes with Python's development dependencies.
$(CONSOLE_INSTALLED): $(CONSOLE)/package-lock.json $(INSTALLED)
	PATH="$(CURDIR)/$(BIN):$$PATH" npm ci --prefix $(CONSOLE) --silent --no-audit --no-fund
	touch $@

# Generators of clients, for a test: in an environment of their own, since they want other versions than ours.
$(GENERATORS): $(GENERATED)/requirements.txt
	$(PYTHON) -m venv $(VENV)/generators
	$(VENV)/generators/bin/python -m pip install --quiet --requirement $(GENERATED)/requirements.txt
	touch $@

demo: setup
	$(BIN)/python demo/run.py $(if $(IMAGES),"$(IMAGES)") --out "$(OUT)" $(if $(KEEP),--keep)

demo-flight: setup
	$(BIN)/python demo/fly.py

docs: setup
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict

check: setup
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/deptry fvs_engine services --package-module-name-map "fvs-client=fvs_schema|fvs_client" --known-first-party fvs_engine --known-first-party fvs_service --per-rule-ignores "DEP002=tbb|httptools|psycopg"
	$(BIN)/python clients/generate_sync.py --check
	$(BIN)/python proto/generate.py --check
	cd clients/python && ../../$(BIN)/deptry . --known-first-party fvs_client --known-first-party fvs_schema --per-rule-ignores "DEP002=pyserial"

# Sources, types and tests of the console, and that what the service sends was built from them.
check-console: export PATH := $(CURDIR)/$(BIN):$(PATH)
check-console: setup $(CONSOLE_INSTALLED)
	cd $(CONSOLE) && npx --no-install biome ci . && npx --no-install tsc && npx --no-install vitest run --silent
	$(BIN)/python $(CONSOLE)/build.py --check

# The kernels are compiled beside the checks: each takes one core.
test: setup
	$(MAKE) --no-print-directory --jobs=2 check check-console kernels
	$(BIN)/python -m pytest -n $(WORKERS) -m "not system and not slow"

unit: setup
	$(BIN)/python -m pytest -n 2 -m "unit and not system and not slow"

test-system: setup kernels $(CONSOLE_INSTALLED)
	$(BIN)/python -m pytest -n $(WORKERS) -m "system and not slow"

kernels: setup
	@$(BIN)/python -c "from fvs_engine.score.log_magnitude_median import compile_kernels as score; \
		from fvs_engine.splat.raster import create_rasterizer as rasterizer; score(), rasterizer('cpu')"

test-slow: setup
	$(BIN)/python -m pytest -m slow
	HYPOTHESIS_PROFILE=thorough $(BIN)/python -m pytest -n $(WORKERS) -m "(unit or integration) and not slow"

container-test: setup
	$(BIN)/python tests/deploy/containers/run.py $(if $(IMAGES),"$(IMAGES)")

# Child processes write their data beside the first one's, wherever they run.
coverage: export COVERAGE_FILE := $(CURDIR)/.coverage
coverage: setup kernels $(CONSOLE_INSTALLED)
	$(BIN)/python -m coverage erase
	$(BIN)/python -m coverage run -m pytest -n $(WORKERS) -m "not slow"
	$(BIN)/python -m coverage combine --quiet
	$(BIN)/python -m coverage report

generate: setup $(CONSOLE_INSTALLED)
	$(BIN)/python clients/generate_sync.py
	$(BIN)/python proto/generate.py
	$(BIN)/python $(CONSOLE)/build.py

lint: setup $(CONSOLE_INSTALLED)
	cd $(CONSOLE) && PATH="$(CURDIR)/$(BIN):$$PATH" npx --no-install biome check --write .
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

bench: setup
	$(BIN)/python benchmarks/raster.py
	$(BIN)/python benchmarks/score.py
	$(BIN)/python benchmarks/selection.py
	@test -d "$(FVS_DATA)/fox" -a -d "$(FVS_DATA)/bonsai" || \
		{ echo "The training benchmark needs fox and bonsai: make bench FVS_DATA=path/to/them"; exit 2; }
	$(BIN)/fvs reconstruct "$(FVS_DATA)/fox/images" --out out/fox --iterations 1
	$(BIN)/python benchmarks/train.py \
		--scene "fox=out/fox/sfm/sparse,$(FVS_DATA)/fox/images,960" \
		--scene "bonsai=$(FVS_DATA)/bonsai/reference,$(FVS_DATA)/bonsai/images,800"

clean:
	rm -rf $(VENV) .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache .coverage* out site $(CONSOLE)/node_modules
