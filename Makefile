# Every target does its own set-up: a .venv beside this file, with pinned and hash-checked packages.
PYTHON ?= python3
BIN := .venv/bin
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check

.PHONY: demo test lint test-peers test-frameworks bench lock clean

demo: .venv/ready ## Simulated scan -> cloud -> depth maps -> the paper's figures, in demo/
	$(BIN)/depthwarp demo --out demo

# A file's tests share what one of them has set up, so files go to the processes as wholes. More than
# four processes would take the machine from the tests that use all its cores.
test: .venv/ready ## All tests but those that need Open3D, torch or JAX
	$(BIN)/python -m pytest -n auto --maxprocesses 4 --dist loadfile --no-loadscope-reorder

lint: .venv/lint-ready ## Style, types
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/pyright

test-peers: .venv/peers-ready ## The tests that compare with Open3D (a 400 MB download)
	$(BIN)/python -m pytest tests/rendering/test_open3d.py

test-frameworks: .venv/frameworks-ready ## The tests with torch, JAX and gymnasium (a 1 GB download)
	$(BIN)/python -m pytest tests/sim tests/examples

bench: .venv/peers-ready ## Splat speed beside Open3D, NumPy and numba
	$(BIN)/python -m benchmarks.splat

.venv/ready: pyproject.toml requirements/test.txt
	@$(PYTHON) -c 'import sys; sys.exit("Python 3.11 or newer is needed, this is %d.%d: make PYTHON=python3.11" % sys.version_info[:2] if sys.version_info < (3, 11) else 0)'
	$(PYTHON) -m venv .venv
	$(PIP) --require-hashes -r requirements/test.txt
	$(PIP) --no-deps --editable .
	@touch $@

.venv/lint-ready: .venv/ready requirements/lint.txt
	$(PIP) --require-hashes -r requirements/lint.txt
	@touch $@

.venv/peers-ready: .venv/ready
	$(PIP) "open3d>=0.20" "numba>=0.60"
	@touch $@

.venv/frameworks-ready: .venv/ready
	$(PIP) torch jax gymnasium
	@touch $@

lock: ## Pin the newest versions again (needs uv)
	uv lock --quiet --upgrade
	uv export --quiet --no-header --no-emit-project --extra viz --extra zarr --group test -o requirements/test.txt
	uv export --quiet --no-header --no-emit-project --extra viz --extra zarr --group test --group lint -o requirements/lint.txt

clean: ## Remove what the targets made
	rm -rf .venv demo .mypy_cache .pytest_cache .ruff_cache .hypothesis
