"""``treadline bench``, as a caller has it."""

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from .conftest import assert_refused

SHORT = ("--tasks", "Kerb", "--episodes", 1, "--workers", 1, "--physics", "fast")
POLICIES = """
import time
import numpy as np

class Ahead:
    def __init__(self, spaces):
        self.count = len(spaces.action)
    def __call__(self, observation):
        return np.array([0.6, 0.6] + [0.0] * (self.count - 2))

class Raises(Ahead):
    def __call__(self, observation):
        raise ValueError("no idea")

class Nothing(Ahead):
    def __call__(self, observation):
        return None

class Short(Ahead):
    def __call__(self, observation):
        return np.zeros(1)

class Slow(Ahead):
    def __call__(self, observation):
        time.sleep(1.0)
        return np.zeros(self.count)
"""


@pytest.fixture
def policies(tmp_path: Path) -> Path:
    (tmp_path / "needy.py").write_text("import no_such_library\n")
    path = tmp_path / "mine.py"
    path.write_text(POLICIES)
    return path


def test_a_bench_answers_with_one_object_and_writes_a_page(run: Callable, policies: Path, tmp_path: Path) -> None:
    done = run("bench", f"{policies}:Ahead", *SHORT, "--out", tmp_path / "out", "--json")
    assert done.code == 0, done.err
    kerb = done.values["tasks"]["Kerb"]
    assert kerb["episodes"] == sum(kerb["verdicts"].values()) == 1
    assert 0.0 <= kerb["interval"][0] <= kerb["score"] <= kerb["interval"][1] <= 1.0
    page = (tmp_path / "out" / "report.html").read_text()
    assert page.count('<svg class="side"') == 2
    assert (tmp_path / "out" / "scores.json").is_file()
    assert_refused(run("bench", "straight", *SHORT, "--out", tmp_path / "out"), "not empty")


def test_a_policy_has_the_same_scores_again(run: Callable, tmp_path: Path) -> None:
    done = [run("bench", "random", *SHORT, "--out", tmp_path / str(n), "--json").values["tasks"] for n in range(2)]
    assert done[0] == done[1]


@pytest.mark.parametrize(
    ("policy", "words"),
    [
        ("Raises", "raised ValueError at step 0: no idea"),
        ("Nothing", "returned nothing at step 0"),
        ("Short", "shape (1,); wanted (4,)"),
        ("Slow", "s a step; at most 0.1 s"),
    ],
)
def test_a_bad_policy_is_one_line(policy: str, words: str, run: Callable, policies: Path, tmp_path: Path) -> None:
    refused = run("bench", f"{policies}:{policy}", *SHORT, "--out", tmp_path / "out")
    lines = [line for line in refused.err.splitlines() if not line.startswith("[")]  # without progress
    assert (refused.code, refused.out, len(lines)) == (2, "", 1), refused
    assert words in lines[0]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("strait",), ("neither module:Class", "did you mean 'straight'")),
        (("mine.py",), ("mine.py", "give --policy")),
        (("nowhere:Policy",), ("no module 'nowhere'",)),
        (("needy.py:Policy",), ("needy.py", "no_such_library")),
        (("straight", "--tasks", "StairsUp"), ("task is 'StairsUp'", "did you mean 'StairUp'")),
        (("straight", "--episodes", "0"), ("--episodes is 0; at least 1",)),
    ],
)
def test_what_cannot_be_run_is_refused_before_any_run(
    arguments: tuple[str, ...], words: tuple[str, ...], run: Callable, policies: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(policies.parent)
    assert_refused(run("bench", *arguments), *words)


def test_without_gymnasium_the_extra_is_named(run: Callable, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "gymnasium", None)
    for name in [name for name in sys.modules if name.startswith("treadline.bench")]:
        monkeypatch.delitem(sys.modules, name)
    assert_refused(run("bench", "straight"), "pip install 'treadline[bench]'")


def test_an_onnx_file_is_a_policy(run: Callable, tmp_path: Path) -> None:
    onnx, _ = pytest.importorskip("onnx"), pytest.importorskip("onnxruntime")
    helper, kind = onnx.helper, onnx.TensorProto.FLOAT
    weights = helper.make_tensor("w", kind, (23, 4), np.zeros(92))
    node = helper.make_node("MatMul", ["seen", "w"], ["asked"])
    ends = [helper.make_tensor_value_info(name, kind, ("n", size)) for name, size in (("seen", 23), ("asked", 4))]
    model = helper.make_model(
        helper.make_graph([node], "still", ends[:1], ends[1:], [weights]), opset_imports=[helper.make_opsetid("", 17)]
    )
    onnx.save(model, tmp_path / "still.onnx")
    refused = run("bench", tmp_path / "still.onnx", *SHORT, "--vehicle", "wheelchair-fixed", "--out", tmp_path / "fixed")
    assert_refused(refused, "shape (4,)")
    done = run("bench", tmp_path / "still.onnx", *SHORT, "--out", tmp_path / "out", "--json")
    assert done.values["tasks"]["Kerb"]["verdicts"] == {"time_up": 1}
