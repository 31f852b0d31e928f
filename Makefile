# Make targets for Roundel; `make help` lists them. Recipes are POSIX sh; everything runs from .venv.

PYTHON ?= python3
PYTEST_FLAGS ?=
# Two processes, each with whole files: their fixtures are costly and are made once.
PYTEST_JOBS ?= 2
GATE_JOBS ?= 2
BENCH_FLAGS ?=
BENCH_PYTHON ?= python3.11
FUZZ_SECONDS ?= 300
DIST ?= dist
REPOSITORY ?=
TAG ?=
BIN = .venv/bin
PACKAGES = configs scenes render datasets solver validate cli
# Rewritten when the environment is complete; older than what it was made from, it is made again.
STAMP = .venv/.roundel-stamp

.PHONY: help env clients-env demo docs test test-slow coverage check links gate bench bench-env bench-gate bench-solver peers-env league fuzz fuzz-env dist clean distclean

help: ## list the targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  make %-12s %s\n", $$1, $$2 }' Makefile

env: $(STAMP) ## the virtual environment .venv, with Roundel installed editable

$(STAMP): pyproject.toml constraints.txt
	@if ! $(BIN)/python -m pip --version >/dev/null 2>&1; then \
	    $(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null || { \
	        echo "error: Roundel needs Python 3.11 or newer; '$(PYTHON)' is not: try make PYTHON=python3.12" >&2; exit 1; }; \
	    $(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || { \
	        echo "error: '$(PYTHON)' cannot make environments: install its venv package (Debian: apt-get install python3-venv)" >&2; exit 1; }; \
	    echo "$(PYTHON) -m venv .venv" && $(PYTHON) -m venv .venv || exit 1; \
	fi
	$(BIN)/python -m pip install --disable-pip-version-check --quiet -c constraints.txt -e '.[dev]'
	@touch $@

demo: env ## render, solve and validate configs/demo.yaml into out/demo
	$(BIN)/roundel run configs/demo.yaml out/demo

test: env ## the tests, without those marked slow
	$(BIN)/python -m pytest -m 'not slow' -n $(PYTEST_JOBS) --dist loadfile $(PYTEST_FLAGS)

test-slow: env ## only the tests marked slow
	$(BIN)/python -m pytest -m slow $(PYTEST_FLAGS)

# What decides whether a number is right; 95 % of its branches are asked for.
SCORED = metrics/pose_errors metrics/bop statistics/intervals scores/run_statistics scores/comparisons statistics/paired_tests scores/scores metrics/sweeps metrics/cramer_rao scores/assignment metrics/ground_truth scores/summary metrics/uncertainty scores/stated_uncertainty scores/false_positives
coverage: env ## branch coverage of the code that scores, by its own tests
	$(BIN)/python -m coverage run --branch --data-file=.coverage \
	    --include="$$(printf 'validate/%s.py,' $(SCORED))" -m pytest -m 'not slow' -q $(PYTEST_FLAGS) \
	    tests/validate/metrics/test_pose_errors.py tests/validate/metrics/test_bop.py tests/validate/statistics/test_intervals.py tests/validate/scores/test_run_statistics.py \
	    tests/validate/statistics/test_paired_tests.py tests/validate/scores/test_scores.py tests/validate/metrics/test_sweeps.py tests/validate/metrics/test_cramer_rao.py tests/validate/report/test_report.py \
	    tests/validate/metrics/test_uncertainty.py tests/validate/scores/test_coverage.py tests/validate/scores/test_false_positives.py
	$(BIN)/python -m coverage report --data-file=.coverage --show-missing --fail-under=95

check: env links ## ruff, mypy --strict, import-linter
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	cd .links && ../$(BIN)/lint-imports --no-logo --config ../pyproject.toml

# Static checkers cannot follow the editable mapping of folders to `roundel.*`, and import-linter follows no links to
# folders: .links/roundel has the folders, with a link for each file. Made anew each time, so that no old link is left.
links:
	@rm -rf .links
	@for folder in $$(find $(PACKAGES) -type d ! -name __pycache__) .; do mkdir -p ".links/roundel/$$folder"; done
	@for file in $$(find $(PACKAGES) -name '*.py' -o -name py.typed); do ln -s "$(CURDIR)/$$file" ".links/roundel/$$file"; done
	@for file in __init__.py py.typed; do ln -s "$(CURDIR)/roundel/$$file" ".links/roundel/$$file"; done

gate: env ## render, solve and score configs/benchmark.yaml, and compare with benchmarks/baseline.parquet
	$(BIN)/roundel run configs/benchmark.yaml out/benchmark --jobs $(GATE_JOBS)
	$(BIN)/roundel gate out/benchmark/report --baseline benchmarks/baseline.parquet --junit out/benchmark/gate.xml

bench: env ## speed and accuracy against peers
	$(BIN)/python benchmarks/render/run.py $(BENCH_FLAGS)

bench-env: ## .venv-bench with Cycles (bpy), for `make bench`; needs Python 3.11
	@$(BENCH_PYTHON) -c 'import sys; sys.exit(sys.version_info[:2] != (3, 11))' 2>/dev/null || { \
	    echo "error: bpy needs Python 3.11; '$(BENCH_PYTHON)' is not: try make bench-env BENCH_PYTHON=..." >&2; exit 1; }
	$(BENCH_PYTHON) -m venv .venv-bench
	.venv-bench/bin/python -m pip install --disable-pip-version-check --quiet --upgrade 'pip>=25.1'
	.venv-bench/bin/python -m pip install --disable-pip-version-check --quiet --group bench

bench-gate: env ## error rates of the gate: false alarms, a loss of 5 %, planted bugs (an hour or two; continues where it stopped)
	$(BIN)/python benchmarks/gate/gate.py $(BENCH_FLAGS)

bench-solver: env ## the solver against simittag, pycalib and OpenCV (make peers-env first)
	$(BIN)/python benchmarks/solver/peers_solver.py $(BENCH_FLAGS)

clients-env: env ## .venv-clients with programs that read exports, for `make test-slow`
	$(BIN)/python -m venv .venv-clients
	.venv-clients/bin/python -m pip install --disable-pip-version-check --quiet --upgrade 'pip>=25.1'
	.venv-clients/bin/python -m pip install --disable-pip-version-check --quiet --group clients

# A .pth file puts the folder at the end of the search path: Roundel's own OpenCV and NumPy come first.
peers-env: env ## .bench-peers with published programs, as methods of `roundel solve`
	$(BIN)/python -m pip install --disable-pip-version-check --quiet --upgrade 'pip>=25.1'
	rm -rf .bench-peers
	$(BIN)/python -m pip install --disable-pip-version-check --quiet --no-deps --target .bench-peers --group peers ./benchmarks/peers
	$(BIN)/python -c 'import pathlib, sysconfig; pathlib.Path(sysconfig.get_path("purelib"), "roundel-peers.pth").write_text("$(CURDIR)/.bench-peers\n")'

docs: env ## the documentation site: out/docs/index.html; runs the commands of the tutorials and the notebooks, once
	@$(BIN)/python -c 'import sphinx, furo, numpydoc, myst_parser, myst_nb, sphinx_copybutton, pandas' 2>/dev/null || \
	    $(BIN)/python -m pip install --disable-pip-version-check --quiet -c constraints.txt -e '.[docs]'
	@echo "building the site; tutorials and notebooks that changed, or all if Roundel's code changed, are run: a few minutes"
	$(BIN)/python -m sphinx -W --keep-going -q -b html docs out/docs
	@echo "out/docs/index.html"

league: env ## every related system on the same images (make peers-env first): out/league, and its page in docs/league
	$(BIN)/roundel league run out/league
	$(BIN)/python docs/league/make.py out/league/league

fuzz: env ## fuzz the reading of images and photographs, for FUZZ_SECONDS in all
	$(BIN)/python fuzz/run.py --seconds $(FUZZ_SECONDS)

fuzz-env: env ## atheris, for `make fuzz`; without it, only hypothesis fuzzes
	$(BIN)/python -m pip install --disable-pip-version-check --quiet --upgrade 'pip>=25.1'
	$(BIN)/python -m pip install --disable-pip-version-check --quiet --group fuzz

dist: ## wheel and sdist in dist/, checked; REPOSITORY=https://HOST/OWNER/NAME gives them links (packaging/)
	@if ! [ .venv-dist/.stamp -nt pyproject.toml ]; then \
	    $(PYTHON) -m venv .venv-dist || exit 1; \
	    .venv-dist/bin/python -m pip install --disable-pip-version-check --quiet --upgrade 'pip>=25.1' || exit 1; \
	    .venv-dist/bin/python -m pip install --disable-pip-version-check --quiet --group dist || exit 1; \
	    touch .venv-dist/.stamp; \
	fi
	.venv-dist/bin/python packaging/make_dist.py --out '$(DIST)' --repository '$(REPOSITORY)' --tag '$(TAG)'

clean: ## remove caches, links, build products and out/demo
	rm -rf .links .mypy_cache .pytest_cache .ruff_cache .import_linter_cache .hypothesis build dist roundel.egg-info out/demo
	find $(PACKAGES) tests -name __pycache__ -type d -prune -exec rm -rf {} +

distclean: clean ## clean, and remove .venv and the other environments too
	rm -rf .venv .venv-bench .venv-clients .venv-dist .bench-peers benchmarks/peers/build
