# `make demo` and `make test` do everything: each installs what it needs, and no more, into the
# environment.
# Needed before: make, and Python 3.11 or 3.12 with pip (or a sourced ROS 2 Jazzy).

VENV := .venv
# Used when the environment is made; empty: the first that fits of python3, python3.12, python3.11.
PYTHON ?=
DEMO_ARGS ?=
TEST_ARGS ?=
# One more than cores: many tests wait, such as for nodes.
WORKERS ?= $(shell echo $$(($$(env -u OMP_NUM_THREADS -u OMP_THREAD_LIMIT nproc) + 1)))
# Seconds of each campaign.
SECONDS_EACH ?= 30
# More arguments for pip install; .ci/run uses it.
MORE :=

ifeq ($(ROS_DISTRO),jazzy)
  SOURCED := $(shell $(or $(PYTHON),python3) -c 'import rclpy' 2>/dev/null && echo yes)
endif

ifneq ($(SOURCED),)
  # The distribution's rclpy, numpy and scipy stay; pip adds only what is missing.
  PYTHONS := python3
  VENV_FLAGS := --system-site-packages
  RUNTIME := plot,viewer,progress,bags
  MADE := $(VENV)/.made-sourced
else
  PYTHONS := python3 python3.12 python3.11
  RUNTIME := ros,plot,viewer,progress,bags
  MADE := $(VENV)/.made-wheels
  # Only Fast DDS comes as a wheel. Another ROS in the calling shell must not mix with the wheels,
  # nor may the library path of other wheels, which comes with their guard variable.
  unexport RMW_IMPLEMENTATION
  ifneq ($(ROS_DISTRO)$(_ROS_WHEELS_BOOTSTRAP_COMPLETE),)
    unexport ROS_DISTRO AMENT_PREFIX_PATH PYTHONPATH LD_LIBRARY_PATH _ROS_WHEELS_BOOTSTRAP_COMPLETE
  endif
endif

# Nothing leaves this machine, nothing is written to the home directory.
export ROS_AUTOMATIC_DISCOVERY_RANGE := LOCALHOST
unexport ROS_STATIC_PEERS ROS_LOCALHOST_ONLY
export ROS_LOG_DIR := $(CURDIR)/build/ros_log
export MPLCONFIGDIR := $(CURDIR)/build/matplotlib
# Processes are started by the hundred: without compiled modules each takes a second longer.
unexport PYTHONDONTWRITEBYTECODE
export PYTHONPYCACHEPREFIX := $(CURDIR)/build/pycache

.PHONY: help demo test golden coverage campaigns lint docs env clean
.DEFAULT_GOAL := help

help:  ## list the targets
	@sed -n 's/^\([a-z]*\):.*## /make \1\t/p' $(firstword $(MAKEFILE_LIST)) | expand -t 12

demo: $(MADE)-demo  ## simulator and track initiator as two processes; DEMO_ARGS="--help" lists options
	$(VENV)/bin/python -m tsepm_ros.tools.demo $(DEMO_ARGS)

test: $(MADE)-test  ## the tests but the long ones; TEST_ARGS="test/tracker -k merging" for others
ifdef TEST_ARGS
	$(VENV)/bin/python -m pytest $(TEST_ARGS)
else
	$(VENV)/bin/python -m pytest -n $(WORKERS) --dist worksteal
endif

golden: $(MADE)-test  ## store the golden outputs of this code, and print what has changed
	$(VENV)/bin/python test/golden/golden_outputs.py renew

# Branches too; processes that the tests start are measured as well, by coverage's own .pth file.
COVERAGE := $(CURDIR)/build/coverage
coverage: $(MADE)-test  ## lines and branches that all tests run, also the long ones; less than promised fails
	rm -rf $(COVERAGE)
	mkdir -p $(COVERAGE)
	COVERAGE_FILE=$(COVERAGE)/data \
	  $(VENV)/bin/python -m coverage run -m pytest -q -m "" -n $(WORKERS) --dist worksteal $(TEST_ARGS)
	$(VENV)/bin/python -m coverage combine -q --data-file=$(COVERAGE)/data $(COVERAGE)
	@for part in all core; do \
	  omit=$$([ $$part = all ] || echo '--omit=tsepm_ros/nodes/*,tsepm_ros/tools/demo.py,tsepm_ros/tools/live_commands.py,tsepm_ros/tools/players/*,tsepm_ros/tools/viewer/track_viewer.py'); \
	  echo "== $$part"; \
	  $(VENV)/bin/python -m coverage report --data-file=$(COVERAGE)/data $$omit --skip-covered; \
	  $(VENV)/bin/python -m coverage json -q --data-file=$(COVERAGE)/data $$omit -o $(COVERAGE)/$$part.json; \
	done
	$(VENV)/bin/python -m coverage html -q --data-file=$(COVERAGE)/data -d $(COVERAGE)/html
ifndef TEST_ARGS
	$(VENV)/bin/python .ci/check_coverage.py $(COVERAGE)
endif

campaigns: $(MADE)-test  ## each campaign for half a minute; test/campaigns/README.md for more
	@for name in messages sensors images bridge parameters files middleware processes kills; do \
	  echo "== $$name"; \
	  $(VENV)/bin/python test/campaigns/$$name.py --fresh --seconds $(SECONDS_EACH) > build/campaigns-$$name.log 2>&1; \
	  code=$$?; \
	  grep -a '^FOUND\|findings;\|, seed' build/campaigns-$$name.log; \
	  [ $$code = 0 ] || { tail -n 40 build/campaigns-$$name.log; exit 1; }; \
	done

lint: $(MADE)-test  ## ruff and mypy
	$(VENV)/bin/python -m ruff check .
	$(VENV)/bin/python -m ruff format --check .
	$(VENV)/bin/python -m mypy

docs: $(MADE)-docs  ## the documentation as a site in build/site; a warning is an error
	$(VENV)/bin/python -m mkdocs build --strict -f .ci/mkdocs.yml

env: $(MADE)-demo $(MADE)-test $(MADE)-docs  ## only the environment of all of these, in .venv

clean:  ## remove the environment and everything built
	rm -rf $(VENV) build dist *.egg-info .mypy_cache .pytest_cache .ruff_cache
	find . -name __pycache__ -prune -exec rm -rf {} +

# A candidate must really run: a version manager's shim may exist and fail.
FITS := import sys, venv; sys.exit(sys.version_info[:2] not in ((3, 11), (3, 12)))
# What the sourced distribution has of these stays, whatever pip would prefer.
KEEP := from importlib.metadata import distributions as d; \
  print(*{f"{p.name}=={p.version}" for p in d() if p.name in ("numpy", "scipy")}, sep="\n")

# Where the interpreter cannot put pip into an environment (Debian without python3-venv), its own pip
# installs from outside. A changed setup.py makes the environment anew.
$(MADE): setup.py package.xml
	@for python in $(or $(PYTHON),$(PYTHONS)) none; do \
	  "$$python" -c '$(FITS)' 2>/dev/null && break; \
	done; \
	if [ "$$python" = none ]; then \
	  echo 'No Python 3.11 or 3.12 found; name one: make PYTHON=/path/to/python3.12' >&2; exit 1; \
	fi; \
	echo "Making $(VENV) with $$("$$python" -V)"; \
	set -e; \
	if "$$python" -c 'import ensurepip' 2>/dev/null; then \
	  "$$python" -m venv --clear $(VENV_FLAGS) $(VENV); pip="$(VENV)/bin/python -m pip"; \
	else \
	  "$$python" -m venv --clear --without-pip $(VENV_FLAGS) $(VENV); \
	  pip="$$python -m pip --python $(VENV)/bin/python"; \
	fi; \
	echo "exec $$pip" '"$$@"' > $(VENV)/pip; \
	$(if $(SOURCED),$(VENV)/bin/python -c '$(KEEP)',:) > $(VENV)/constraints.txt
	@mkdir -p $(ROS_LOG_DIR) $(MPLCONFIGDIR)
	@touch $@

# What a target needs beyond the runtime is the extra of its name, if any. Editable, so that it never
# goes stale; modules are compiled when they are imported, which saves time and space.
NOTHING :=
COMMA := ,
LIST = $(subst $(NOTHING) $(NOTHING),$(COMMA),$(strip $(RUNTIME) $(filter-out demo,$*)))
$(MADE)-%: $(MADE) $(filter %.txt,$(MORE))
	@echo "Installing $(LIST) in $(VENV): about a minute"
	@sh $(VENV)/pip install -qq --disable-pip-version-check --no-compile \
	  -c $(VENV)/constraints.txt -e '.[$(LIST)]' $(MORE)
	@touch $@
