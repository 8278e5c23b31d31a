# The commands of this project. bootstrap.py makes and mends .venv; everything runs in it.
# Without make: python bootstrap.py needlebench demo

PYTHON ?= $(shell for p in python3 python python3.13 python3.12 python3.11 py; do "$$p" -c "" 2>/dev/null && echo "$$p" && break; done)
BOOTSTRAP = $(or $(PYTHON),python3) bootstrap.py
BIN := .venv/$(if $(filter Windows_NT,$(OS)),Scripts,bin)
UV ?= $(firstword $(wildcard $(BIN)/uv) uv)
ARGS ?=
MOMENTS ?= 50
REQUESTS ?= 10000
CLIENTS ?= 200
SECONDS ?= 60
JOBS ?= 2000
SEED ?= 1

.PHONY: help run env check test test-fast chaos verification models lock image clean

help:  ## this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  make %-12s %s\n", $$1, $$2 }' Makefile

run:  ## install what is missing, then one demo insertion through the service (ARGS="..." for needlebench demo)
	@$(BOOTSTRAP) needlebench demo $(ARGS)

env:  ## only make or mend .venv
	@$(BOOTSTRAP)

check: env  ## lint, format and types
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy simcore service benchmarks needlebench.py bootstrap.py hatch_build.py

test: check  ## everything: lint, format, types and all tests
	$(BIN)/python -m pytest $(ARGS)

test-fast: check  ## the same without the slow tests
	$(BIN)/python -m pytest -m "not slow" $(ARGS)

chaos: env  ## kill, flood and starve real servers; prints a table (MOMENTS=50 REQUESTS=10000 CLIENTS=200 SECONDS=60 JOBS=2000 SEED=1)
	NEEDLEBENCH_CHAOS_MOMENTS=$(MOMENTS) NEEDLEBENCH_CHAOS_REQUESTS=$(REQUESTS) NEEDLEBENCH_CHAOS_CLIENTS=$(CLIENTS) \
	NEEDLEBENCH_CHAOS_SECONDS=$(SECONDS) NEEDLEBENCH_CHAOS_JOBS=$(JOBS) NEEDLEBENCH_CHAOS_SEED=$(SEED) \
	$(BIN)/python -m pytest tests/chaos tests/acceptance/test_disk.py tests/service/api/test_hostile.py $(ARGS)

verification: env  ## run the physics and reproducibility tests and write benchmarks/results/verification.md (SOURCE_DATE=... for its header)
	SOURCE_DATE="$${SOURCE_DATE:-$$(date -u +%Y-%m-%d)}" \
	$(BIN)/python -m pytest tests/simcore tests/acceptance/test_reproducibility.py \
	--verification benchmarks/results/verification.md $(ARGS)

models: env  ## run the training insertions and train the models that come along, in simcore/models (half an hour and more)
	$(BIN)/needlebench dataset --out out/models/data.npz --force
	$(BIN)/needlebench train --data out/models/data.npz --kind elm --out simcore/models/elm.json --force
	$(BIN)/needlebench train --data out/models/data.npz --kind linear --out simcore/models/linear.json --force
	$(BIN)/needlebench train --data out/models/data.npz --kind mlp --out simcore/models/mlp.json --force

lock: env  ## write requirements.lock anew from pyproject.toml (needs uv; ARGS=--upgrade for the newest versions)
	@command -v $(UV) >/dev/null || { echo "make lock needs uv: pipx install uv"; exit 1; }
	$(BIN)/python -c 'import tomllib; print(*tomllib.load(open("pyproject.toml", "rb"))["build-system"]["requires"])' | \
	env -u UV_INDEX -u UV_INDEX_URL -u UV_EXTRA_INDEX_URL -u UV_DEFAULT_INDEX -u UV_FIND_LINKS -u UV_CONFIG_FILE \
	$(UV) pip compile pyproject.toml - --extra dev --universal --python-version 3.11 --fork-strategy fewest \
	--generate-hashes --no-config --no-emit-index-url --no-emit-find-links \
	--custom-compile-command "make lock" --quiet --output-file requirements.lock $(ARGS)

image:  ## the container image, with the commit in it
	docker build --build-arg COMMIT="$$(git rev-parse HEAD)" --tag needlebench .

clean:  ## remove the environment, caches and builds (data folders stay)
	rm -rf .venv dist build .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
