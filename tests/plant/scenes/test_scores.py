"""``python benchmarks/scenes``: frames with known answers, and scores of any detector's headings."""

import csv
import json
import subprocess
import sys
from pathlib import Path

import pytest
from scenes.known_answers import CONDITIONS
from scenes.scores import HeadingResult, TrueFrame, score, scored_table, wilson

SCENES = Path(__file__).parents[3] / "benchmarks" / "scenes"
TRUTH = "name,scene,heading_deg,share\na/0,up,10.0,0.5\na/1,up,-5.0,0.4\na/2,foot,3.0,0.05\nb/0,shelf,,\nb/1,floor,,\n"


@pytest.fixture
def truth(tmp_path: Path) -> Path:
    path = tmp_path / "truth.csv"
    path.write_text(TRUTH)
    return path


def scenes(*words: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, SCENES, *map(str, words)], capture_output=True, text=True, check=False)


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def test_the_same_seed_gives_the_same_bytes_and_a_perfect_table_scores_100_percent(tmp_path: Path) -> None:
    one, other = tmp_path / "one", tmp_path / "other"
    for folder in (one, other):
        assert scenes("render", "--out", folder, "--count", 1).returncode == 0
    assert contents(one) == contents(other)
    depths = [name for name in contents(one) if name.endswith("_depth.png")]
    assert len(depths) == len(CONDITIONS) == 16

    with (one / "truth.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert {row["name"] for row in rows} == {name.removesuffix("_depth.png") for name in depths}
    results = tmp_path / "results.csv"
    results.write_text("name,heading_deg\n" + "".join(f"{row['name']},{row['heading_deg']}\n" for row in rows))
    values = json.loads(scenes("score", results, "--truth", one / "truth.csv", "--json").stdout)
    assert (values["accepted"]["share"], values["worst_deg"], values["false_accepts"]["hits"]) == (1.0, 0.0, 0)
    assert values["false_accepts"]["count"] == sum(row["heading_deg"] == "" for row in rows) == 4
    assert list(values["conditions"]) == list(CONDITIONS)
    refused = scenes("score", tmp_path / "none.csv", "--truth", one / "truth.csv")
    assert (refused.returncode, refused.stdout, refused.stderr.count("\n")) == (2, "", 1)


def test_scores_count_misses_errors_intervals_and_false_accepts(truth: Path, tmp_path: Path) -> None:
    results = tmp_path / "results.csv"
    # One error of 0.3° outside its interval, one miss, one error of 4° on a small stair without sigma, one false accept.
    results.write_text("name,heading_deg,sigma_deg\na/0,10.3,0.1\na/1,,\na/2,-1.0,\nb/0,,\nb/1,7,1\n")
    values, lines = scored_table(results, truth)
    assert (values["accepted"]["hits"], values["accepted"]["count"]) == (1, 2)
    assert (values["inside_95"]["hits"], values["inside_95"]["count"]) == (0, 1)
    assert (values["false_accepts"]["hits"], values["false_accepts"]["count"]) == (1, 2)
    assert values["worst_deg"] == pytest.approx(4.0)
    assert values["rmse_deg"] == pytest.approx(((0.3**2 + 4.0**2) / 2) ** 0.5)
    assert "1/2 = 50.0 %" in "\n".join(lines)


def test_an_error_is_taken_around_the_circle() -> None:
    scores = score({"a": HeadingResult(heading_deg=-179.0)}, {"a": TrueFrame(heading_deg=179.0, share=1.0)})
    assert scores.worst_deg == pytest.approx(2.0)


def test_wilson_interval_is_the_published_one() -> None:
    # Newcombe, Statistics in Medicine 17 (1998), table I, method 3: 81/263 gives 0.2553 to 0.3662, 0/20 gives 0 to 0.1611.
    assert wilson(81, 263) == pytest.approx((0.2553, 0.3662), abs=1e-4)
    assert wilson(0, 20) == pytest.approx((0.0, 0.1611), abs=1e-4)
    assert wilson(20, 20)[1] == 1.0
