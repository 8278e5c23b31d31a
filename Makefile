# The commands of this project. bootstrap.py makes and mends .venv, with what running needs or with what testing needs on
# top; everything runs in it. Without make: python bootstrap.py needlebench demo

PYTHON ?= $(shell for p in python3 python python3.13 python3.12 python3.11 py; do "$$p" -c "" 2>/dev/null && echo "$$p" && break; done)
BOOTSTRAP = $(or $(PYTHON),python3) bootstrap.py
BIN := .venv/$(if $(filter Windows_NT,$(OS)),Scripts,bin)
UV ?= $(firstword $(wildcard $(BIN)/uv) uv)
ARGS ?=
MOMENTS ?= 50
REQUESTS ?= 10000
MESHES ?= 2000
CLIENTS ?= 200
SECONDS ?= 60
JOBS ?= 2000
SEED ?= 1
CORES ?= auto
PARALLEL = -n $(CORES) --dist loadgroup --no-loadscope-reorder

# The build backend is locked too: bootstrap.py and the container build this project with it.
BUILD_REQUIRES = $(BIN)/python -c 'import tomllib; print(*tomllib.load(open("pyproject.toml", "rb"))["build-system"]["requires"])'
COMPILE = env -u UV_INDEX -u UV_INDEX_URL -u UV_EXTRA_INDEX_URL -u UV_DEFAULT_INDEX -u UV_FIND_LINKS -u UV_CONFIG_FILE \
	$(UV) pip compile --universal --python-version 3.11 --fork-strategy fewest --generate-hashes --no-config \
	--no-emit-index-url --no-emit-find-links --custom-compile-command "make lock" --quiet

# Hundreds of processes that would each compile the code again: tests keep bytecode whatever the environment says.
test test-fast test-long test-python chaos verification: export PYTHONDONTWRITEBYTECODE :=

.PHONY: help run env env-dev check kernels checked test test-fast test-long test-python chaos docs verification golden pictures models lock hooks image clean

help:  ## this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  make %-12s %s\n", $$1, $$2 }' Makefile

run:  ## install what running needs, then one demo insertion through the service (ARGS="..." for needlebench demo)
	@$(BOOTSTRAP) needlebench demo $(ARGS)

env:  ## only make or mend .venv, with what running needs
	@$(BOOTSTRAP)

env-dev:  ## the same with what testing needs
	@$(BOOTSTRAP) --dev

check: env-dev  ## lint, formatting, the direction of imports, types
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports --no-logo
	$(BIN)/mypy simcore service benchmarks needlebench tests bootstrap.py bootstrap_python.py hatch_build.py

kernels: env  ## compile the simulator's kernels, once for these sources
	$(BIN)/python -c "from simcore.rollout.rollout import compile_kernels; compile_kernels()"

# Tests in several processes would each compile the kernels; so they are compiled before, beside the checks.
checked: env-dev
	@$(MAKE) --no-print-directory -j2 check kernels

test: checked  ## everything that a change must pass: lint, formatting, types and the tests, on every core (CORES=4 for four processes)
	$(BIN)/python -m pytest -m "not long" $(PARALLEL) $(ARGS)

test-fast: checked  ## the same without the slow tests
	$(BIN)/python -m pytest -m "not slow and not long" $(PARALLEL) $(ARGS)

test-long: env-dev kernels  ## every test, property tests ten times as long, with coverage; then a sample of mutants
	NEEDLEBENCH_TESTS=long $(BIN)/python -m coverage run -m pytest $(PARALLEL) $(ARGS)
	$(BIN)/python -m coverage combine --quiet
	$(BIN)/python -m coverage report
	$(BIN)/python -m tests.mutants --each 3 --seed $(SEED)

test-python:  ## the fast tests on another Python, in an environment of its own (PYTHON=python3.13)
	@version="$$($(PYTHON) -c 'import sys; print("%d.%d" % sys.version_info[:2])')" && \
	BOOTSTRAP_VENV=".venv-$$version" $(PYTHON) bootstrap.py --dev python -m pytest -m "not slow and not long" $(ARGS)

chaos: env-dev  ## kill, flood and starve real servers; prints a table (MOMENTS=50 REQUESTS=10000 MESHES=2000 CLIENTS=200 SECONDS=60 JOBS=2000 SEED=1)
	NEEDLEBENCH_CHAOS_MOMENTS=$(MOMENTS) NEEDLEBENCH_CHAOS_REQUESTS=$(REQUESTS) NEEDLEBENCH_CHAOS_MESHES=$(MESHES) \
	NEEDLEBENCH_CHAOS_CLIENTS=$(CLIENTS) \
	NEEDLEBENCH_CHAOS_SECONDS=$(SECONDS) NEEDLEBENCH_CHAOS_JOBS=$(JOBS) NEEDLEBENCH_CHAOS_SEED=$(SEED) \
	$(BIN)/python -m pytest tests/chaos tests/acceptance/test_disk.py tests/service/api/test_hostile.py $(ARGS)

docs: env-dev  ## build the documentation in build/docs; a warning is an error
	$(BIN)/sphinx-build -W --keep-going -b html docs build/docs

verification: env-dev  ## run the physics and reproducibility tests and write benchmarks/results/verification.md (SOURCE_DATE=... for its header)
	SOURCE_DATE="$${SOURCE_DATE:-$$(date -u +%Y-%m-%d)}" \
	$(BIN)/python -m pytest tests/simcore tests/acceptance/test_reproducibility.py \
	--verification benchmarks/results/verification.md $(ARGS)

golden: env-dev  ## measure golden numbers and pinned digests of suites again, and write the README's tables (say why in CHANGELOG.md)
	$(BIN)/python -m tests.benchmarks.golden
	$(BIN)/python -m tests.benchmarks.paper.test_suites
	$(BIN)/python docs/refresh_readme.py

pictures: env-dev  ## take the pictures of the service's pages that the documentation shows, in benchmarks/pictures (needs chromium)
	$(BIN)/python -m tests.browser.pictures

models: env-dev  ## run the training insertions and train the bundled models, in simcore/models (half an hour and more)
	$(BIN)/needlebench dataset --out out/models/data.npz --force
	$(BIN)/needlebench train --data out/models/data.npz --kind elm --out simcore/models/elm.json --force
	$(BIN)/needlebench train --data out/models/data.npz --kind linear --out simcore/models/linear.json --force
	$(BIN)/needlebench train --data out/models/data.npz --kind mlp --out simcore/models/mlp.json --force

lock: env  ## write the three requirements*.lock again from pyproject.toml (needs uv; ARGS=--upgrade for the newest versions)
	@command -v $(UV) >/dev/null || { echo "make lock needs uv: pipx install uv"; exit 1; }
	$(BUILD_REQUIRES) | $(COMPILE) pyproject.toml - --group dev --output-file requirements-dev.lock $(ARGS)
	$(BUILD_REQUIRES) | $(COMPILE) pyproject.toml - --constraint requirements-dev.lock --output-file requirements.lock
	$(BUILD_REQUIRES) | $(COMPILE) - --group core --constraint requirements-dev.lock --output-file requirements-core.lock

hooks: env-dev  ## let git run lint, formatting and types before every commit
	$(BIN)/pre-commit install

image:  ## the container image, with the commit in it
	docker build --build-arg COMMIT="$$(git rev-parse HEAD)" --tag needlebench .

clean:  ## remove the environments, caches and builds (data folders stay)
	rm -rf .venv .venv-* dist build .coverage .coverage.* .pytest_cache .mypy_cache .ruff_cache .hypothesis .schemathesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
