# PYTHON=python3.12 makes .venv with that interpreter, afresh where it was made with another version.
PY := .venv/bin/python
# Two cores are the smallest machine the tests are meant for; more are used where there are more.
WORKERS ?= $(shell nproc)

.PHONY: setup docs docs-needs docs-pictures demo thesis test test-pages test-services lint bench bench-quick bench-cpd \
	rigid-benchmark fuzz faults server server-down server-needs coverage mutation quality-needs audit clean

setup:
	@./scripts/setup.sh

demo: setup
	@.venv/bin/ctus demo

# Every study of conf/thesis.yaml that has no run yet, the runs exported, and the report (results/index.html).
# trainer=smoke shows that all works, in results/smoke alone; data=FOLDER has carotid/ and usgra/.
trainer ?= cpu
data ?= $(wildcard ../shared/data)
thesis: setup
	OMP_WAIT_POLICY=PASSIVE $(PY) scripts/thesis.py --trainer $(trainer) --data "$(data)"

# Byte code is kept even where the surroundings forbid it: most of what some hundred processes start with is compiling.
test: export PYTHONDONTWRITEBYTECODE =
test: lint
	$(PY) -m pytest -n $(WORKERS) --dist worksteal --durations=40 tests

# Every page in a browser, which this installs on Debian as root; PAGES names a folder that gets the screenshots.
PAGES ?= outputs/pages
test-pages: docs-needs
	command -v chromedriver >/dev/null || apt-get install -y --no-install-recommends chromium chromium-driver
	mkdir -p $(PAGES)
	CTUS_SCREENSHOTS=$(abspath $(PAGES)) $(PY) -m pytest -m pages tests

# What needs programs of the system, which this installs on Debian as root: LaTeX, PostgreSQL, and Slurm on this one
# machine; and nnU-Net's checker, which its test installs into .cache/nnunet.
test-services: server-needs
	command -v pdflatex >/dev/null || apt-get install -y --no-install-recommends \
		texlive-latex-base texlive-latex-recommended
	GPUS=2 ./scripts/slurm_node.sh up >/dev/null
	@trap './scripts/slurm_node.sh down' EXIT; \
		SLURM_CONF=/tmp/ctus-slurm/slurm.conf $(PY) -m pytest -m services tests

# The documentation as a site in build/site; a link that leads nowhere fails.
docs: docs-needs
	NO_MKDOCS_2_WARNING=1 $(PY) -m mkdocs build --strict --quiet
	@echo "Open build/site/index.html; its search needs a server: python3 -m http.server --directory build/site"

docs-needs: setup
	$(PY) -c "import mkdocs, mkdocstrings" 2>/dev/null || \
		$(PY) -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[docs]'

# The pictures of pages that the documentation shows, afresh.
docs-pictures: test-pages
	$(PY) scripts/docs_pictures.py $(PAGES)

lint: setup
	$(PY) -m ruff check .
	$(PY) -m ruff format --check .
	$(PY) -m mypy --num-workers $(WORKERS)

# Every claim of speed beside its peers, in the same minutes: results/benchmarks.md, in a good quarter of an hour.
# ONLY=rigid,hd95 measures some of them, into outputs. Peers that the project itself does not need lie apart; without them the page says so.
PEERS := .cache/bench_peers
bench: setup
	@for name in kiss-matcher pycpd rcpd; do \
		test -e $(PEERS)/$$name || { $(PY) -m pip install --quiet --disable-pip-version-check --no-deps \
			--only-binary :all: --target $(PEERS) $$name && touch $(PEERS)/$$name; } || true; \
	done
	PYTHONPATH=$(PEERS) $(PY) scripts/benchmarks.py $(if $(ONLY),--only $(ONLY) --out outputs/benchmarks)

# Every benchmark on a small budget, one after the other, to see that they run. For figures to quote start one of them
# without --quick; of speeds next to the peers', taken in the same minute, quote the ratios, not the seconds.
BENCHMARKS := bench_metrics bench_networks bench_training bench_phantom bench_centerline bench_reconstruction \
	bench_sweep_faults bench_rigid bench_residual_model bench_deformable bench_known_deformations bench_cpd \
	bench_inference bench_lung bench_tracking benchmarks
bench-quick: setup
	@failed=; for name in $(BENCHMARKS); do \
		printf '\n== %s\n' $$name; \
		$(PY) scripts/$$name.py --quick || failed="$$failed $$name"; \
	done; \
	if [ -n "$$failed" ]; then echo "failed:$$failed"; exit 1; fi

# Deformable registration by size: seconds, memory, residual and true error, beside rustcpd and, if installed, pycpd.
bench-cpd: setup
	$(PY) scripts/bench_cpd.py

# The frozen benchmark of rigid registration, and the page in results/ that it makes.
METHODS := multistart,single_icp,single_icp_plane,gicp,fpfh_ransac,fpfh_fgr
BLOCKS := deforming,wrong_vessel,overlap,noise
BLOCK_METHODS := multistart
rigid-benchmark: setup
	.venv/bin/ctus study=rigid_benchmark subset=test "rigid=[$(METHODS)]" workers=$(WORKERS) \
		out=outputs/rigid_benchmark/test
	.venv/bin/ctus study=rigid_benchmark subset=symmetric "rigid=[$(METHODS)]" workers=$(WORKERS) \
		out=outputs/rigid_benchmark/symmetric
	.venv/bin/ctus study=rigid_benchmark subset=test "blocks=[$(BLOCKS)]" "rigid=[$(BLOCK_METHODS)]" \
		workers=$(WORKERS) out=outputs/rigid_benchmark/blocks
	$(PY) scripts/rigid_benchmark.py outputs/rigid_benchmark

# Damaged files for every reader, each in a process that may die; FUZZ_COUNT files a reader; into the page of faults.
FUZZ_COUNT ?= 10000
fuzz: setup
	$(PY) scripts/fuzz_readers.py --count $(FUZZ_COUNT) --out results/reliability.md

# Processes killed at random, disks full, stores locked or read-only, servers away, clocks set back; ATTEMPTS kills.
# Full disks and read-only folders are mounts, for root alone; without that right they are left out, and the page says so.
ATTEMPTS ?= 100
faults: setup
	$(PY) scripts/faults.py --attempts $(ATTEMPTS) --out results/reliability.md

# A tracking server on this machine: MLflow and PostgreSQL on the loopback, with a password (docs/runs.md).
PORT ?= 5000
server: server-needs
	$(PY) scripts/server.py --port $(PORT)

server-down:
	$(PY) scripts/server.py --down

server-needs: setup
	ls /usr/lib/postgresql/*/bin/initdb >/dev/null 2>&1 || command -v initdb >/dev/null || \
		apt-get install -y --no-install-recommends postgresql
	$(PY) -c 'import psycopg2, flask_wtf' 2>/dev/null || \
		$(PY) -m pip install --quiet --constraint constraints.txt --editable '.[dev,server]'

# Lines of models and registration that their tests run; under 90 % of either is a failure.
coverage: export COVERAGE_FILE := outputs/coverage/data
coverage: quality-needs
	mkdir -p $(dir $(COVERAGE_FILE))
	for package in models registration; do \
		$(PY) -m pytest -n $(WORKERS) --dist worksteal --cov=src/$$package --cov-report=term:skip-covered \
			--cov-fail-under=90 tests/$$package || exit 1; \
	done

# Small changes of metrics, transforms and statistics, and whether a test notices: results/mutation.md.
mutation: quality-needs
	$(PY) scripts/mutation.py --out results

quality-needs: setup
	$(PY) -c 'import mutmut, pytest_cov' 2>/dev/null || \
		$(PY) -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[quality]'

# Known vulnerabilities of the pinned versions, by PyPI's service, which has to be reachable.
audit: setup
	test -x .cache/audit/bin/pip-audit || ($(PY) -m venv .cache/audit && \
		.cache/audit/bin/python -m pip install --quiet --constraint constraints.txt pip-audit)
	.cache/audit/bin/pip-audit --requirement constraints.txt --no-deps --disable-pip --strict

clean:
	rm -rf .venv .cache outputs build dist
