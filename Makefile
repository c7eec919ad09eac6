PYTHON ?= python3
BIN := .venv/bin

.PHONY: setup reproduce test check docs gallery bench profile size audit fuzz clean

setup: .venv/ready

# The stamp is written last, so that an interrupted setup is taken up again.
.venv/ready: pyproject.toml constraints.txt
	@missing=; \
	command -v $(PYTHON) >/dev/null || missing="python3 python3-venv"; \
	if [ -z "$$missing" ]; then \
	  $(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	    { echo "setup: $$($(PYTHON) --version) is too old, Python 3.11 or newer is needed (make PYTHON=python3.11)" >&2; exit 1; }; \
	  $(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || missing="python3-venv"; \
	  case "$$(uname)" in Linux) \
	    $(PYTHON) -c 'import ctypes; ctypes.CDLL("libglib-2.0.so.0")' 2>/dev/null || \
	      missing="$$missing libglib2.0-0$$(. /etc/os-release 2>/dev/null; \
	        case "$$ID$$VERSION_ID" in debian12|ubuntu22.04) ;; *) echo t64;; esac)";; \
	  esac; \
	fi; \
	if [ -n "$$missing" ]; then \
	  echo "setup: system packages are missing, run: apt-get install $$(echo $$missing)" >&2; exit 1; \
	fi
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[dev]'
	@touch $@

# The papers' own figures and tables; `chamfer reproduce --studies` makes what goes beyond them.
reproduce: setup
	$(BIN)/chamfer reproduce

# Each worker takes tests in a row, so that it imports, compiles and runs what they share once, and
# one core; what Python, pytest and Numba compile is kept whatever the environment says.
SKIPPED := slow
EXAMPLES = $(if $(SKIPPED),quick,patient)
test: export PYTHONDONTWRITEBYTECODE =
test: export OPENBLAS_NUM_THREADS = 1
test: setup
	$(BIN)/python -m pytest -n auto --dist worksteal --hypothesis-profile=$(EXAMPLES) -m "$(SKIPPED:%=not %)"

check: setup
	$(BIN)/python -m docs._ext.prose
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

# The site, with the code of its pages run anew; a warning is an error. Sphinx gives pages out in
# chunks: with two processes all that run code would be in one.
docs: setup
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[docs]'
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m sphinx -W --keep-going -q -E -j 8 -d out/docs/doctrees docs out/docs/html

# Stores the results in out/ for the site: figures, checks and replays, after
# `chamfer reproduce --studies`. The still needs chamfer run insertion, and Chromium.
gallery: setup
	$(BIN)/python -m docs._ext.gallery out
	$(BIN)/python -m docs._ext.stills out

bench: setup
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[bench]'
	$(BIN)/python -m chamfer.analysis.benchmarks

# Where the time of an experiment goes: make profile NAME=planar-slide SET=duration=5
profile: setup
	@$(BIN)/python -m chamfer.analysis.benchmarks.profile $(NAME) $(SET)

# Lines of code, docstrings and tests by room.
size: setup
	@$(BIN)/python -m chamfer.analysis.report.size

# Perturbs every field of every experiment: which ones change nothing? Some hours on two cores; of
# one experiment: python -m chamfer.analysis.audit NAME.
audit: setup
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m chamfer.analysis.audit

# Random search, the only one: 10,000 drawn command lines at every command, 10,000 drawn runs of the
# guard, and new examples for every property, of which the tests draw the same few each time.
fuzz: setup
	CHAMFER_FUZZ=10000 $(BIN)/python -m pytest tests/analysis/test_rough_handling.py \
	  tests/systems/robot/test_command_guard.py
	$(BIN)/python -m pytest -n auto --dist worksteal --hypothesis-profile=fuzz -m "not slow"

clean:
	rm -rf out .hypothesis .mypy_cache .pytest_cache .ruff_cache .import_linter_cache *.egg-info
	find models systems diagrams analysis tests -name __pycache__ -type d -prune -exec rm -rf {} +
