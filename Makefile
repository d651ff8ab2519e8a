# Needs Python 3.11 or later and make; with cargo of Rust 1.89 or later the inner loops are compiled.

PYTHON ?= python3
PYTEST_FLAGS ?= -n auto
BENCHMARK_FLAGS ?= --quick

VENV := .venv
BIN := $(VENV)/bin
# Without the build backend's warnings about editable installs.
INSTALL := PYTHONWARNINGS=ignore $(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt
MANIFEST := --manifest-path kernels/Cargo.toml
BUILD_TOOLS := 'setuptools>=77,<84' 'setuptools-rust>=1.11,<2'
SOURCES := pyproject.toml setup.py constraints.txt kernels/Cargo.toml kernels/Cargo.lock $(wildcard kernels/src/*.rs kernels/src/*/*.rs)
SAY_WHAT_IS_DONE := echo "installing the packages and, where Rust is found, compiling the kernel: one to two minutes on two cores ..."
# True where the kernel was compiled: setup.py says whether Rust is there and new enough.
HAS_KERNEL := $(BIN)/python -c "import sys, pricing_core; sys.exit(pricing_core.kernel_name() != 'rust')"
SAY_KERNEL := $(BIN)/python -c "import pricing_core as p; name = p.kernel_name(); print('kernel:', name, \
	'' if name == 'rust' else '- NOT COMPILED, 100 times slower and more: it needs Rust 1.89 or later')"

# Threads of the linear algebra gain nothing on small matrices, and wait for each other where other work fills the cores.
ONE_THREAD := OPENBLAS_NUM_THREADS=1

# cargo and the build backend must agree on the interpreter, or each would recompile the other's work.
export PYO3_PYTHON := $(abspath $(BIN)/python)

.PHONY: help demo test check check-python check-crate benchmark figures examples docs nightly wheels image lock clean
.DEFAULT_GOAL := help

help:  ## show this list
	@awk -F ':.*## ' '/^[a-z]+:.*## / {printf "make %-9s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

demo: $(VENV)/.installed  ## price the example book and draw an exercise boundary
	$(BIN)/python examples/demo.py

test: $(VENV)/.installed-for-tests  ## run the Rust tests (where the kernel is compiled), the Python tests and the doctests
	if $(HAS_KERNEL); then cargo test --quiet --locked $(MANIFEST); fi
	$(BIN)/python -m pytest $(PYTEST_FLAGS)

check: check-python check-crate  ## what is checked before the tests: style, types, import contract

check-python: $(VENV)/.packages
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/hadolint Dockerfile
	$(BIN)/check-jsonschema --builtin-schema vendor.github-workflows .github/workflows/*.yml
	$(BIN)/check-jsonschema --builtin-schema vendor.citation-file-format CITATION.cff
	$(BIN)/zizmor --quiet --offline --persona pedantic .github

check-crate: $(VENV)/.installed-for-tests
	if $(HAS_KERNEL); then cargo fmt $(MANIFEST) --check; fi
	if $(HAS_KERNEL); then cargo clippy --quiet --locked $(MANIFEST) --all-targets --features python -- --deny warnings; fi

benchmark: $(VENV)/.installed  ## run every benchmark quickly, into build/benchmarks; BENCHMARK_FLAGS= measures in full
	$(ONE_THREAD) $(BIN)/pricing benchmark $(BENCHMARK_FLAGS) --output build/benchmarks

examples: $(VENV)/.installed  ## run every example; each asserts what it shows, and writes its output and its picture into examples/out
	$(BIN)/python examples/run_all.py

figures: $(VENV)/.installed  ## measure the figures of README and docs anew into docs/figures, and write them into the texts
	$(INSTALL) 'QuantLib>=1.44,<2'
	$(ONE_THREAD) $(BIN)/python -m benchmarks.figures

docs: $(VENV)/.installed-for-docs examples  ## build the documentation into site and follow its links, without the network; a warning is an error
	rm -rf jupyter_execute site
	$(BIN)/sphinx-build --quiet --fail-on-warning --keep-going docs site
	$(BIN)/python .ci/links.py

nightly: $(VENV)/.installed-for-tests  ## run the long accuracy tests
	$(BIN)/python -m pytest $(PYTEST_FLAGS) -m nightly

wheels: $(VENV)/.installed-for-release  ## build the sdist and the abi3 wheel into dist, and try them on each installed Python
	$(BIN)/python .ci/wheels.py

image:  ## run the steps of the Dockerfile in an empty folder, up to a priced contract over HTTP
	$(PYTHON) .ci/image.py

.PHONY: licenses release
licenses:  ## collect the licence texts of what is compiled into the kernel; needs cargo
	$(PYTHON) .ci/licenses.py

release: $(VENV)/.installed-for-release $(VENV)/.installed-for-docs  ## make every check of a release, and say which pass
	$(BIN)/python .ci/release.py

lock:  ## write constraints.txt and requirements.txt anew: the newest versions that pyproject.toml allows
	scratch=$$(mktemp -d) && trap 'rm -rf "$$scratch"' EXIT && \
	$(PYTHON) -m venv "$$scratch" && \
	"$$scratch/bin/python" -m pip install --quiet --upgrade pip && \
	PRICING_CORE_KERNEL=none "$$scratch/bin/python" -m pip install --quiet --editable '.[all]' --group test --group docs --group release \
		$(BUILD_TOOLS) && \
	{ echo '# Exact versions of everything that is installed; written by `make lock`.'; \
	  "$$scratch/bin/python" -m pip freeze --all --exclude-editable; } > "$$scratch/constraints.txt" && \
	mv "$$scratch/constraints.txt" constraints.txt && \
	{ echo '# What the image installs, with the hashes of the files; written by `make lock`.'; \
	  "$$scratch/bin/uv" pip compile pyproject.toml --quiet --extra all --constraint constraints.txt --generate-hashes \
		--universal --python-version 3.11 --no-header --no-annotate; } > "$$scratch/requirements.txt" && \
	mv "$$scratch/requirements.txt" requirements.txt

clean:  ## remove the virtual environment and everything that was built or written
	rm -rf $(VENV) build dist jupyter_execute site *.egg-info kernels/target examples/out
	rm -rf .pytest_cache .mypy_cache .ruff_cache .hypothesis .import_linter_cache
	rm -f pricing_core/_kernels*.so
	find app benchmarks examples pricing_core tests -name __pycache__ -prune -exec rm -rf {} +

# The build tools are pinned too: hence no build isolation.
$(VENV)/.build-tools: constraints.txt
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(INSTALL) pip $(BUILD_TOOLS)
	touch $@

# What the tests and checks need, without the kernel: `make --jobs 2 check` compiles that beside the checks of Python.
$(VENV)/.packages: $(VENV)/.build-tools pyproject.toml setup.py constraints.txt
	PRICING_CORE_KERNEL=none $(INSTALL) --no-build-isolation --editable '.[all]' --group test
	touch $@

$(VENV)/.installed: $(VENV)/.build-tools
$(VENV)/.installed-for-tests: $(VENV)/.packages
$(VENV)/.installed $(VENV)/.installed-for-tests: $(SOURCES)
	@$(SAY_WHAT_IS_DONE)
	$(INSTALL) --no-build-isolation --editable '.[all]'
	@$(SAY_KERNEL)
	touch $(VENV)/.installed $@

$(VENV)/.installed-for-docs: $(VENV)/.installed
	$(INSTALL) --group docs
	touch $@

$(VENV)/.installed-for-release: $(VENV)/.build-tools
	$(INSTALL) --group release
	touch $@
