# Needs bash, flock (util-linux) and either ROS 2 Jazzy in /opt/ros/jazzy or a Python 3.11 to 3.13.
SHELL := bash
.SHELLFLAGS := -peuo pipefail -c
.DEFAULT_GOAL := help

environment := . scripts/environment.sh
PLANT ?= sim

.PHONY: help
help: ## show this
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "  make %-11s %s\n", $$1, $$2}' $(firstword $(MAKEFILE_LIST))

.PHONY: setup
setup: ## prepare everything: packages and the workspace; quick when nothing changed
	@scripts/setup.sh

.PHONY: demo
demo: setup ## optimise a fin of the papers' size: 30 simulated trials, one bag each, results in runs/; PLANT=rehearsal for the robot's path
	@./run fin_bringup bringup plant:=$(PLANT) $(ARGS)

.PHONY: test
test: setup ## unit tests, then graph tests with the real nodes; PYTEST_ARGS="-k name" narrows them
	@# Three at a time on two cores: half of a graph test is waiting. The long files come first, so that none is left last.
	@$(environment) && exec python -m pytest -p xdist -n 3 --dist loadfile --no-loadscope-reorder $(PYTEST_ARGS)

.PHONY: test-long
test-long: setup ## the proofs that take minutes: hundreds of kills, real firmware, exhaustive grids, mutants
	@# A simulated processor wants real time, so the firmware's tests have the machine to themselves; 5: none was asked for.
	@$(environment) && { python -m pytest -m firmware --timeout=1800 $(PYTEST_ARGS) || [[ $$? == 5 ]]; } && \
	exec python -m pytest -p xdist -n 2 --maxschedchunk 1 -m "long and not firmware" --timeout=1800 $(PYTEST_ARGS)

.PHONY: torture
torture: setup ## no trial is ever lost: 200 kills at random moments, ten thousand trials; prints what was lost
	@$(environment) && TRIALS=10000 exec python -m pytest -m long --timeout=3600 -s tests/graph/test_kills.py tests/graph/test_rehearsal_kills.py tests/graph/test_many_trials.py $(PYTEST_ARGS)

.PHONY: validation
validation: setup ## check the physics against every known answer; writes docs/validation.md and its figures
	@./run fin_sim validation

.PHONY: campaign
campaign: setup ## the paper's experiments, figures and numbers, in runs/campaign; ARGS="hill_climber" for one of them
	@./run fin_optimizer campaign $(ARGS)

.PHONY: bench-search
bench-search: setup ## which search finds a hidden fish's best fin in 12 trials; ARGS="--json" for programs
	@./run fin_optimizer bench_search $(ARGS)

.PHONY: bench
bench: setup ## how fast fish swim and trials run, how late the servo driver ticks; ARGS="--quick" for a look
	@$(environment) && python -m pip install --quiet --requirement requirements/bench.txt
	@./run fin_bringup bench $(ARGS)
ifeq ($(filter --json --help -h,$(ARGS)),) # whose output is to stay whole
	@echo
	@./run fin_bringup lateness $(if $(filter --quick,$(ARGS)),--seconds 10)
endif

.PHONY: lint
lint: setup ## ruff, mypy in strict mode, and shellcheck where it is installed
	@$(environment) && ruff check && ruff format --check && mypy
	@if type -P shellcheck >/dev/null; then shellcheck run scripts/*.sh .ci/run; fi

.PHONY: format
format: setup ## let ruff format the code and mend what it can
	@$(environment) && ruff check --fix-only && ruff format

.PHONY: pages
pages: setup ## write docs/parameters.md from the nodes' parameter tables
	@$(environment) && python scripts/write_parameters_page.py

.PHONY: clean
clean: ## remove what the set-up made: packages, the built workspace, caches; runs/ stays
	rm -rf .venv .setup.lock .setup.log ros2_ws/build ros2_ws/install ros2_ws/log
	rm -rf ros2_ws/src/*/build ros2_ws/src/*/*.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find ros2_ws/src tests -name __pycache__ -prune -exec rm -rf {} +
