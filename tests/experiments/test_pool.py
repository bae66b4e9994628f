"""Jobs on workers that stay, and in this process: the same results in the same order."""

from dataclasses import dataclass

import pytest

from treadline.experiments.pool import Pool, run_jobs


@dataclass(frozen=True)
class Square:
    """A job in one line."""

    number: int

    @property
    def name(self) -> str:
        return str(self.number)

    def run(self) -> int:
        if self.number < 0:
            raise ArithmeticError(f"{self.number} has no root")
        return self.number**2


@pytest.mark.parametrize("workers", [1, 2])
def test_results_come_in_the_order_of_the_jobs_and_every_end_is_told(workers: int) -> None:
    told: list[str] = []
    with Pool(workers, told.append) as pool:
        first, second = pool.begin([Square(3), Square(2)]), pool.begin([Square(1)])
        assert second() == [1]
        assert first() == [9, 4]
    assert sorted(told) == ["1", "2", "3"]


def test_one_job_needs_no_worker() -> None:
    told: list[str] = []
    assert run_jobs([Square(5)], workers=8, done=told.append) == [25]
    assert told == ["5"]
    assert run_jobs([], workers=8, done=told.append) == []


def test_a_job_that_fails_ends_the_pool_with_its_error_and_is_not_told() -> None:
    told: list[str] = []
    with pytest.raises(ArithmeticError, match="-1 has no root"), Pool(2, told.append) as pool:
        pool.begin([Square(-1)])()
    assert told == []
