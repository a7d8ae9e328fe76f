PY := .venv/bin/python
# Two cores are the smallest machine the tests are meant for; more are used where there are more.
WORKERS ?= $(shell nproc)

.PHONY: setup demo test lint bench clean

setup:
	@./scripts/setup.sh

demo: setup
	@./scripts/demo.sh

test: lint
	$(PY) -m pytest -n $(WORKERS) --dist worksteal tests

lint: setup
	$(PY) -m ruff check .
	$(PY) -m ruff format --check .
	$(PY) -m mypy

# Speed beside the peers, in the same minute: quote the ratios, not the seconds.
bench: setup
	$(PY) scripts/bench_metrics.py

clean:
	rm -rf .venv .cache outputs build dist
