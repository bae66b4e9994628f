"""Jobs on workers that stay, and in this process: the same results in the same order."""

import os
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import pytest
from processes import alive, wait_for

from treadline.experiments._job_pool import JobPool


@dataclass(frozen=True)
class Square:
    """A job in one line."""

    number: int

    @property
    def title(self) -> str:
        return str(self.number)

    def run(self) -> int:
        if self.number < 0:
            raise ArithmeticError(f"{self.number} has no root")
        return self.number**2


@pytest.mark.parametrize("workers", [1, 2])
def test_results_come_in_the_order_of_the_jobs_and_every_end_is_reported(workers: int) -> None:
    titles: list[str] = []
    with JobPool(workers, titles.append) as pool:
        first, second = pool.begin([Square(3), Square(2)]), pool.begin([Square(1)])
        assert second() == [1]
        assert first() == [9, 4]
        assert pool.begin([])() == []
    assert sorted(titles) == ["1", "2", "3"]


def test_a_job_that_fails_ends_the_pool_with_its_error_and_is_not_reported() -> None:
    titles: list[str] = []
    with pytest.raises(ArithmeticError, match="-1 has no root"), JobPool(2, titles.append) as pool:
        pool.begin([Square(-1)])()
    assert titles == []


@dataclass(frozen=True)
class Sleeper:
    """A job that says which process does it, and takes its time."""

    note: Path
    title: str = "sleeper"

    def run(self) -> None:
        self.note.with_suffix(f".{os.getpid()}").touch()
        time.sleep(60.0)


PARENT = """
import sys
from pathlib import Path
from tests.experiments.test_job_pool import Sleeper
from treadline.experiments._job_pool import JobPool
if __name__ == "__main__":
    with JobPool(2, print) as pool:
        pool.begin([Sleeper(Path(sys.argv[1])), Sleeper(Path(sys.argv[1]))])()
"""


def test_workers_of_a_killed_parent_end_by_themselves(tmp_path: Path) -> None:
    """Test: kill -9 on the parent while two workers are busy. Expected result: no worker is left."""
    script = tmp_path / "parent.py"
    script.write_text(PARENT)
    root = Path(__file__).parents[2]
    environment = os.environ | {"PYTHONPATH": f"{root}{os.pathsep}{root / 'tests' / 'builders'}"}
    parent = subprocess.Popen([sys.executable, script, tmp_path / "worker"], env=environment)
    wait_for(lambda: len(list(tmp_path.glob("worker.*"))) == 2)
    workers = [int(note.suffix[1:]) for note in tmp_path.glob("worker.*")]
    parent.send_signal(signal.SIGKILL)
    parent.wait(30.0)
    wait_for(lambda: not any(alive(worker) for worker in workers))
