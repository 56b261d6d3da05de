# make demo     set up, then run the main job on the first scene
# make test     set up, then run the tests
# make numerics run the tests of numbers at their extremes, and write docs/numerics.md
# make install  set up alone, into .venv

PYTHON ?= python3
CORES ?= 2
BIN := .venv/bin
INSTALLED := .venv/.installed
KERNELS := src/egosplat/rasterize/kernels
RAYS := src/egosplat_apartments/rays
COMPILED := $(KERNELS)/libegosplat_generic.so
PAGES := contact_sheet.png instances.png crops.png transient.png splats.png language.png queries.png scene.html story.html

# Some distributions leave ensurepip out of Python: then the pip at hand fills the environment.
WITHOUT_ENSUREPIP = { $(PYTHON) -m venv --clear --without-pip .venv && $(PYTHON) -m pip --python $(BIN)/python install --quiet pip; }

.PHONY: install demo test numerics lint lock

install: $(COMPILED)

# sam2 needs torch while it is built: in a build environment of its own that would be a second download of torch.
$(INSTALLED): requirements.lock pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(not (3, 11) <= sys.version_info < (3, 13) and "egosplat needs Python 3.11 or 3.12 (projectaria-tools has no later wheel); set PYTHON=")'
	@echo "Setting up .venv: about 7 GB and a few minutes, once."
	test -x $(BIN)/pip || $(PYTHON) -m venv .venv || $(WITHOUT_ENSUREPIP)
	grep -v '^sam2==' requirements.lock > .venv/first.txt
	$(BIN)/python -m pip install --quiet --requirement .venv/first.txt
	SAM2_BUILD_CUDA=0 $(BIN)/python -m pip install --quiet --no-build-isolation --no-deps $$(grep -o '^sam2==[^ ;]*' requirements.lock)
	touch $@

# Without a compiler the file stays away, and each call tries again.
$(COMPILED): $(INSTALLED) setup.py $(addprefix $(KERNELS)/,targets.py compiling.py) $(RAYS)/library.py $(wildcard $(KERNELS)/source/* $(RAYS)/source/*)
	@echo "Compiling the C++ kernels: about a minute."
	$(BIN)/python -m pip install --quiet --no-build-isolation --no-deps --editable .
	@$(BIN)/python -c 'from egosplat.rasterize.kernels.library import why_not; print(why_not() or "The C++ kernels are ready.")'

demo: install
	$(BIN)/snakemake --cores $(CORES) results/adt/scene1/metrics.json $(addprefix results/adt/scene1/,$(PAGES))
	$(BIN)/egosplat query results/adt/scene1 "desk lamp" television elephant
	@echo
	@echo "Done. Pictures of each step are in results/adt/scene1: $(PAGES) query.png"
	@echo "Next, after  source $(BIN)/activate"
	@echo "  egosplat view results/adt/scene1                                  walk through the scene, ask it, click on things"
	@echo "  egosplat query results/adt/scene1 couch \"coffee table\" cup         where is it? draws results/adt/scene1/query.png"
	@echo "  snakemake --cores $(CORES) results/adt/scene2/metrics.json              the next apartment, to its scores"

# One process more than cores, because some tests wait for SLURM or a browser. One thread each. The longest files come first.
test: install
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest --numprocesses $$(( $(CORES) + 1 )) --dist loadfile --no-loadscope-reorder

numerics: install
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest tests/numerics --numerics-table docs/numerics.md

lint: install
	$(BIN)/ruff check setup.py src tests benchmarks training
	$(BIN)/ruff format --check setup.py src tests benchmarks training
	$(BIN)/snakefmt --check workflow
	$(BIN)/snakemake --lint --config container=image.sif
	$(BIN)/python -m tests.support.lines

# The lock file anew, from the ranges in pyproject.toml.
lock: $(BIN)/python
	$(BIN)/pip-compile --quiet --extra dev --allow-unsafe --strip-extras --no-header --no-annotate \
	    --no-emit-index-url --no-emit-find-links --no-emit-trusted-host --output-file requirements.lock pyproject.toml
