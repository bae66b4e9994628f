# make reproduce · make test · make check · make docs : each sets up what it needs in .venv.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
OUT ?= reproduce

.PHONY: help setup reproduce quick publish test test-ros1 test-gazebo check coverage format docs clean

help:
	@echo "make reproduce   run the whole paper and write $(OUT)/report.html"
	@echo "make quick       the same, shortened (figures are marked as such)"
	@echo "make publish     write the headline figures of $(OUT) to README.md and docs/evidence/results.json"
	@echo "make test        run the tests"
	@echo "make test-gazebo run the tests in Gazebo 11, which they build first (root, once)"
	@echo "make test-ros1   install ROS 1 from Debian (root) and run the graph on a real roscore"
	@echo "make check       formatter, linter, types, import contracts"
	@echo "make coverage    every branch of the guard is taken by its own tests"
	@echo "make docs        redraw the drawings of docs/"

setup: $(VENV)/.installed

$(VENV)/.installed: pyproject.toml
	@command -v $(PYTHON) >/dev/null || { echo "treadline: $(PYTHON) not found; install Python 3.11 or newer" >&2; exit 2; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "treadline: $(PYTHON) is older than 3.11; call make PYTHON=python3.12" >&2; exit 2; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e ".[dev]"
	@touch $@

reproduce: setup
	$(BIN)/treadline reproduce --out $(OUT)

quick: setup
	$(BIN)/treadline reproduce --quick --out $(OUT)

publish: setup
	$(BIN)/python benchmarks/publish.py $(OUT)

test: setup
	$(BIN)/python -m pytest -n 2 --dist loadfile

# Where neither root nor chroot is to be had there is nothing to test: environment.sh says so and answers 77.
test-gazebo: setup
	@ros/gazebo/environment.sh >/dev/null; status=$$?; \
	if [ $$status = 77 ]; then echo "test-gazebo: skipped"; exit 0; fi; [ $$status = 0 ] || exit $$status; \
	TREADLINE_TEST_GAZEBO=1 $(BIN)/python -m pytest -n 2 tests/gazebo tests/devices/test_plant_contract.py

ROS1 := ros-core python3-rospy python3-rosbag python3-rostest python3-roslaunch python3-rostopic python3-sensor-msgs \
	python3-nav-msgs python3-geometry-msgs python3-diagnostic-msgs python3-tf2-msgs python3-tf2-ros

test-ros1: setup
	@command -v rostest >/dev/null || { [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null; } || \
		{ echo "treadline: ROS 1 is not installed, and only root of a Debian can: apt-get install $(ROS1)" >&2; exit 2; }
	@command -v rostest >/dev/null || { apt-get -q update && \
		DEBIAN_FRONTEND=noninteractive apt-get -q install -y --no-install-recommends $(ROS1); }
	TREADLINE_ROS1=1 $(BIN)/python -m pytest -n 2 tests/ros1

check: setup
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports

coverage: setup
	$(BIN)/coverage run -m pytest -q -p no:cacheprovider tests/mission/test_guard*.py
	$(BIN)/coverage report

format: setup
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

docs: setup
	$(BIN)/python -m treadline.report.drawings docs/drawings

clean:
	rm -rf $(VENV) reproduce runs .mypy_cache .ruff_cache .pytest_cache
