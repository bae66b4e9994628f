# Each target sets up what it needs in .venv, and no more.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
OUT ?= reproduce
LOCK ?= requirements
# pip with a sign of life every five seconds.
PIP := $(BIN)/python tools/install.py
# Installs an extra by the hashes of its lock file; LOCK=/dev/null installs the newest versions that pyproject.toml admits.
extra = $(if $(filter /dev/null,$(LOCK)),$(PIP) -e ".[$(1)]",$(PIP) --require-hashes -r $(LOCK)/$(1).lock)

# Without bytecode files every process would compile the sources of all libraries anew.
unexport PYTHONDONTWRITEBYTECODE

# Tests of processes on the wall clock run while no other test needs the processor, and the whole emulated chair and the bursts alone: they keep
# two cores busy. A machine that is busy otherwise makes messages late, as the guard rightly says: such a test may be run three times.
REAL_TIME := $(addprefix tests/hardware/test_,arming.py bno055.py drive_contract.py guard_process.py links.py) tests/run/test_loop_watchdog.py
EMULATED := $(addprefix tests/hardware/test_,drive_on_emulator.py tick_in_bursts.py)
RERUN := --reruns 2 --reruns-delay 5

.PHONY: help setup lock reproduce quick publish test fast shapes slow test-ros1 test-ros2 test-gazebo test-browser firmware test-firmware prove check coverage format docs docs-outputs docs-serve schema dist clean

help:
	@echo "make reproduce    run the whole paper and write $(OUT)/report.html"
	@echo "make quick        fewer items of the paper, each at its full length"
	@echo "make publish      run the paper with five seeds and write the headline figures to README.md and docs/evidence/results.json"
	@echo "make setup        install the program and compile its kernels; the targets above and below do so themselves"
	@echo "make test         run all tests"
	@echo "make fast         run the tests that finish within a minute"
	@echo "make shapes       run unit tests and one whole run per direction with array shapes checked"
	@echo "make slow         run the tests of the first run on a machine, with an empty compile cache (minutes)"
	@echo "make test-gazebo  run the tests in Gazebo 11, which they build first (root, once; asks, unless CI=true)"
	@echo "make test-browser run the tests of the viewer in Chromium, which they install from Debian first (root, once; asks, unless CI=true)"
	@echo "make test-ros2    install ROS 2 from pip in build/ros2 and run the nodes on it (Python 3.11 to 3.13, cmake and a C++ compiler)"
	@echo "make test-ros1    install ROS 1 from Debian (root; asks, unless CI=true) and run the graph on a real roscore"
	@echo "make firmware     compile the firmware of the box at the drives and, beside it in build/firmware, the exported heading controller"
	@echo "make test-firmware  run the self-tests of both under the sanitisers; each branch of the firmware must be taken (gcov)"
	@echo "make prove        prove the firmware free of run-time errors and its rules true (Frama-C), and count deviations from MISRA (cppcheck)"
	@echo "make check        formatter, linter, types, import contracts"
	@echo "make coverage     measure that the guard's own tests take each of its branches"
	@echo "make lock         resolve all requirements anew and write their versions and hashes to requirements/"
	@echo "make docs         build the documentation site in site/ (warnings are errors)"
	@echo "make docs-outputs run the commands of the pages and write the outputs and pictures that they show again (minutes)"
	@echo "make docs-serve   show the documentation on a local port while it is edited"
	@echo "make schema       write docs/reference/scenario.schema.json again"
	@echo "make dist         build the source distribution and the wheel in dist/"

$(VENV)/.created:
	@command -v $(PYTHON) >/dev/null || { echo "treadline: $(PYTHON) not found; install Python 3.11 or newer" >&2; exit 2; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "treadline: $(PYTHON) is older than 3.11; call make PYTHON=python3.12" >&2; exit 2; }
	@echo "creating $(VENV) (0.7 GB): the program first, which takes a minute, then its kernels, another minute on two cores"
	$(PYTHON) -m venv $(VENV)
	@touch $@

$(VENV)/.base: pyproject.toml $(wildcard requirements/*.lock) | $(VENV)/.created
	$(call extra,base)
	$(if $(filter /dev/null,$(LOCK)),,$(PIP) --no-deps --no-build-isolation -e .)
	@touch $@

$(VENV)/.test: $(VENV)/.base
	$(call extra,test)
	@touch $@

$(VENV)/.dev: $(VENV)/.test
	$(call extra,dev)
	@touch $@

$(VENV)/.docs: $(VENV)/.base
	$(call extra,docs)
	@touch $@

# The newest versions that the oldest supported Python can install; LOCKED="--constraint FILE" keeps some.
lock: $(VENV)/.created
	$(call extra,uv)
	$(BIN)/python tools/lock.py $(LOCKED)

# Compiles once per machine and version; later calls find the marker and return at once.
setup: $(VENV)/.base
	@$(BIN)/treadline compile

reproduce: setup
	$(BIN)/treadline reproduce --out $(OUT) --force

quick: setup
	$(BIN)/treadline reproduce --quick --out $(OUT) --force

publish: setup
	$(BIN)/treadline reproduce --seeds 5 --out $(OUT) --force
	$(BIN)/python benchmarks/publish.py $(OUT)

test: $(VENV)/.test setup
	$(BIN)/python -m pytest -n 2 --dist loadfile $(patsubst %,--ignore=%,$(REAL_TIME) $(EMULATED))
	$(BIN)/python -m pytest -n 2 --dist loadfile $(RERUN) $(REAL_TIME)
	$(BIN)/python -m pytest $(RERUN) $(EMULATED)

fast: $(VENV)/.test setup
	$(BIN)/python -m pytest -n 2 --dist loadfile -m fast

shapes: $(VENV)/.test setup
	TREADLINE_SHAPES=1 $(BIN)/python -m pytest -n 2 --dist loadfile -m shapes

slow: $(VENV)/.test setup
	TREADLINE_SLOW=1 $(BIN)/python -m pytest -m slow

# Where neither root nor chroot is to be had there is nothing to test: environment.sh says so and answers 77.
test-gazebo: $(VENV)/.test
	@legacy/gazebo/environment.sh >/dev/null; status=$$?; \
	if [ $$status = 77 ]; then echo "test-gazebo: skipped"; exit 0; fi; [ $$status = 0 ] || exit $$status; \
	TREADLINE_TEST_GAZEBO=1 $(BIN)/python -m pytest -n 2 tests/plant/gazebo tests/plant/test_plant_contract.py

$(VENV)/.browser: $(VENV)/.test
	$(call extra,browser)
	@touch $@

# Asks before it installs packages of Debian.
apt = tools/confirm.sh "apt-get installs $(1) as root" && apt-get -q update && \
	DEBIAN_FRONTEND=noninteractive apt-get -q install -y --no-install-recommends $(1)

# Where Chromium is missing and only root could install it there is nothing to test.
test-browser: $(VENV)/.browser
	@command -v chromium >/dev/null && command -v chromedriver >/dev/null || \
		{ [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null; } || \
		{ echo "test-browser: skipped, Chromium is not installed, and only root of a Debian can: apt-get install $(CHROMIUM)"; exit 0; }; \
	command -v chromium >/dev/null && command -v chromedriver >/dev/null || { $(call apt,$(CHROMIUM)); } || exit 2; \
	TREADLINE_TEST_BROWSER=1 $(BIN)/python -m pytest $(RERUN) tests/browser tests/report/test_player.py tests/report/test_touch.py

CHROMIUM := chromium chromium-driver
ROS1 := ros-core python3-rospy python3-rosbag python3-rostest python3-roslaunch python3-rostopic python3-sensor-msgs \
	python3-nav-msgs python3-geometry-msgs python3-diagnostic-msgs python3-tf2-msgs python3-tf2-ros

test-ros1: $(VENV)/.test
	@command -v rostest >/dev/null || { [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null; } || \
		{ echo "treadline: ROS 1 is not installed, and only root of a Debian can: apt-get install $(ROS1)" >&2; exit 2; }
	@command -v rostest >/dev/null || { $(call apt,$(ROS1)); }
	TREADLINE_ROS1=1 $(BIN)/python -m pytest -n 2 tests/ros1

# Where pip has no ROS 2 for this machine there is nothing to test: environment.sh says so and answers 77.
test-ros2: $(VENV)/.test setup
	@folder=$$(ros2/environment.sh); status=$$?; \
	if [ $$status = 77 ]; then echo "test-ros2: skipped"; exit 0; fi; [ $$status = 0 ] || exit $$status; \
	. $$folder/env.sh; TREADLINE_ROS2=1 python -m pytest -W default $(RERUN) tests/ros2 tests/ros/test_transport_contract.py

build/firmware/heading: $(VENV)/.base
	$(BIN)/treadline export src/treadline/data/controllers/wheelchair.json --to c --out $@ --force

firmware test-firmware: build/firmware/heading
	$(MAKE) -C firmware $(if $(filter test-%,$@),test,all) heading

prove:
	$(MAKE) -C firmware prove

check: $(VENV)/.dev
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports

coverage: $(VENV)/.dev
	$(BIN)/coverage run -m pytest -q -p no:cacheprovider tests/guard
	$(BIN)/coverage report

format: $(VENV)/.dev
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

docs: $(VENV)/.docs
	PYTHONPATH=docs/tools $(BIN)/python -m drawings docs/drawings
	$(BIN)/python docs/tools/tree.py docs/drawings/tree.svg
	$(BIN)/python docs/tools/automaton.py docs/drawings
	$(BIN)/python docs/tools/commands.py docs/reference/commands.md
	$(BIN)/python docs/tools/decisions_index.py docs
	$(BIN)/python docs/tools/hazards.py docs/explanation/safety.md
	$(BIN)/python docs/tools/gallery.py docs/gallery
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet
	@echo "documentation: site/index.html (make docs-serve for the search)"

docs-outputs: setup
	$(BIN)/python docs/tools/pages.py docs/tutorials/*.md docs/how-to/*.md

docs-serve: $(VENV)/.docs
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs serve

schema: $(VENV)/.base
	$(BIN)/python docs/tools/scenario_schema.py docs/reference/scenario.schema.json

dist: $(VENV)/.base
	$(BIN)/python -m build --no-isolation --outdir dist .

clean:
	rm -rf $(VENV) reproduce runs site dist build .mypy_cache .ruff_cache .pytest_cache
