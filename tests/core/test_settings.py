"""Settings files: error, location and allowed values on one line."""

import re
from pathlib import Path
from typing import Annotated, Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import Field

from treadline.core.errors import SettingsError
from treadline.core.settings import Settings, parse_toml, read_toml, settings_of


class Inner(Settings):
    name: str
    share: Annotated[float, Field(gt=0.0, le=1.0)] = 0.5


class Outer(Settings):
    real: Annotated[float, Field(ge=-1.0, le=2.5)] = 0.0
    above: Annotated[float, Field(gt=0.0)] = 1.0
    free: float = 0.0
    count: Annotated[int, Field(ge=2, le=9)] = 3
    flag: bool = False
    word: str = "a"
    choice: Literal["red", "green", "blue"] = "red"
    number_choice: Literal[240, 480] = 240
    maybe: Annotated[float, Field(ge=5.0, le=45.0)] | None = None
    point: tuple[float, float, float] = (0.0, 0.0, 0.0)
    indices: tuple[Annotated[int, Field(ge=0)], ...] = ()
    tilt_deg: Annotated[float, Field(ge=5.0, le=45.0)] = 20.0
    wide_m: Annotated[float, Field(gt=0.0, le=2.0)] = 1.0
    pace_m_s: Annotated[float, Field(gt=0.0, le=0.3)] = 0.2
    pause_s: Annotated[float, Field(ge=0.0, le=60.0)] = 1.0
    push_n_m: Annotated[float, Field(gt=0.0, le=1.0)] = 1.0
    inner: Inner = Inner(name="x")
    items: tuple[Inner, ...] = ()


def refusal(text: str, tmp_path: Path) -> str:
    path = tmp_path / "some.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(SettingsError) as refused:
        read_toml(path, Outer)
    message = str(refused.value)
    assert message.startswith(f"{path}:")
    assert message.isprintable()  # one line, and nothing that moves a terminal's cursor
    return re.sub(r"^\d+: ", "", message.removeprefix(f"{path}:")).removeprefix(" ")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("real = 3", "real: must be a number from -1 to 2.5 (got 3)"),
        ("real = nan", "real: must be a number from -1 to 2.5 (got nan)"),
        ("free = -inf", "free: must be a number (got -inf)"),
        ("above = 0", "above: must be a number > 0 (got 0)"),
        ("real = true", "real: must be a number from -1 to 2.5 (got true)"),
        ("real = 2026-01-01", "real: must be a number from -1 to 2.5 (got 2026-01-01)"),
        ("count = 3.0", "count: must be a whole number from 2 to 9 (got 3.0)"),
        ("flag = 1", "flag: must be true or false (got 1)"),
        ("word = 1", "word: must be text (got 1)"),
        ('choice = "pink"', "choice: must be 'red', 'green' or 'blue' (got 'pink')"),
        ("number_choice = 300", "number_choice: must be 240 or 480 (got 300)"),
        ("maybe = 90", "maybe: must be a number from 5 to 45 (got 90)"),
        ("point = [1, 2]", "point: must be three numbers (got [1, 2])"),
        ('point = [1, "2", 3]', "point.1: must be a number (got '2')"),
        ("indices = 4", "indices: must be a list of whole numbers ≥ 0 (got 4)"),
        ("indices = [4, -1]", "indices.1: must be a whole number ≥ 0 (got -1)"),
        ("inner = 3", "inner: must be a table, [inner] (got 3)"),
        ("inner = {name = 'x', share = 0}", "inner.share: must be a number > 0 and ≤ 1 (got 0)"),
        ("[inner]\nshare = 0.1", "inner.name: missing; give text"),
        ("[items]\nname = 'x'", "items: must be a list of tables, [[items]] (got a table)"),
        ("items = [3]", "items.0: must be a table (got 3)"),
        ("cuont = 1", "cuont: unknown key; did you mean count?"),
        ("[inner]\nname = 'x'\nweight = 1", "inner.weight: unknown key; known here: name, share"),
        ("[iner]\nname = 'x'", "iner: unknown table; did you mean [inner]?"),
        ("[[item]]\nname = 'x'", "item: unknown table; did you mean [[items]]?"),
        ("share = 0.2", "share: unknown key here; it belongs to [inner] or [[items]]"),
        ("[inner]\nnmae = 'x'", "inner.nmae: unknown key; did you mean name? (and 1 more)"),
        ('choice = "gren"', "choice: must be 'red', 'green' or 'blue' (got 'gren'); did you mean 'green'?"),
        ("tilt_deg = 0.49", "tilt_deg: must be a number from 5 to 45 (got 0.49); did you mean 28.1, for 0.49 rad?"),
        ("tilt_deg = 0.01", "tilt_deg: must be a number from 5 to 45 (got 0.01)"),  # 0.6°
        ("wide_m = 950", "wide_m: must be a number > 0 and ≤ 2 (got 950); did you mean 0.95, for 950 mm?"),
        ("wide_m = 5", "wide_m: must be a number > 0 and ≤ 2 (got 5); did you mean 0.05, for 5 cm?"),
        ("pace_m_s = 200", "pace_m_s: must be a number > 0 and ≤ 0.3 (got 200); did you mean 0.2, for 200 mm/s?"),
        ("pace_m_s = 0.5", "pace_m_s: must be a number > 0 and ≤ 0.3 (got 0.5)"),
        ("pause_s = 2500", "pause_s: must be a number from 0 to 60 (got 2500); did you mean 2.5, for 2500 ms?"),
        ('"two\\nlines" = 1', f"'two\\nlines': unknown key; known here: {', '.join(Outer.model_fields)}"),
        ("real = 9\ncount = 99\nflag = 2", "real: must be a number from -1 to 2.5 (got 9) (and 2 more)"),
    ],
)
def test_a_wrong_value_is_named_with_its_key_and_all_that_is_allowed(text: str, message: str, tmp_path: Path) -> None:
    assert refusal(text, tmp_path) == message


def test_a_decimal_comma_and_a_file_of_another_kind_are_named(tmp_path: Path) -> None:
    assert refusal("real = 0,16", tmp_path).endswith("; decimals have a point")
    (tmp_path / "model.json").write_text('{"A": [1,2]}')
    with pytest.raises(SettingsError, match=r"not TOML: .*; give a \.toml file"):
        parse_toml(tmp_path / "model.json")


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("# first\n\nreal = 3", 3),
        ("inner.share = 0\ninner.name = 'x'", 1),
        ("[[items]]\nname = 'x'\n[[items]]\nname = 'y'\nshare = 2", 5),
        ("indices = [\n  4,\n  -1,\n]", 1),
        ("inner = {name = 'x', share = 0}", 1),
        ("real = 0\n[inner]\nshare = 0.1", 2),  # what is missing is missing in its table
        ("real = 0\n[iner]\nname = 'x'", 2),
    ],
)
def test_what_is_wrong_is_named_with_its_line(text: str, line: int, tmp_path: Path) -> None:
    path = tmp_path / "some.toml"
    path.write_text(text)
    with pytest.raises(SettingsError, match=rf"some\.toml:{line}: "):
        read_toml(path, Outer)


@pytest.mark.parametrize(
    ("text", "start"),
    [
        ("a = ", "not TOML: "),
        ("real = 1\nreal = 2", "not TOML: "),
        ("count = " + "9" * 5000, "not TOML: "),
        ("x = " + "[" * 5000, "not TOML: "),
    ],
)
def test_what_is_not_toml_is_refused(text: str, start: str, tmp_path: Path) -> None:
    assert refusal(text, tmp_path).startswith(start)


def test_a_long_value_is_cut(tmp_path: Path) -> None:
    assert len(refusal(f'real = "{"x" * 10_000}"', tmp_path)) < 200


def test_a_file_that_cannot_be_read_says_why(tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match="no such file"):
        parse_toml(tmp_path / "none.toml")
    with pytest.raises(SettingsError, match="folder"):
        parse_toml(tmp_path)
    latin = tmp_path / "latin.toml"
    latin.write_bytes(b'word = "caf\xe9"\n')
    with pytest.raises(SettingsError, match=r"not UTF-8 \(byte 11\)"):
        parse_toml(latin)


def test_whole_numbers_stand_for_real_ones_and_lists_for_tuples() -> None:
    read = settings_of({"real": 2, "point": [1, 2, 3], "items": [{"name": "a"}]}, Outer, where="here")
    assert read.real == 2.0
    assert isinstance(read.real, float)
    assert read.point == (1.0, 2.0, 3.0)
    assert read.items == (Inner(name="a"),)


def test_settings_cannot_be_changed() -> None:
    with pytest.raises(ValueError, match="frozen"):
        Outer().real = 1.0  # type: ignore[misc]


toml_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=6,
)


@given(tables=st.dictionaries(st.sampled_from([*Outer.model_fields, "colour"]), toml_values, max_size=4))
def test_any_tables_give_settings_or_one_line(tables: dict[str, object]) -> None:
    try:
        read = settings_of(tables, Outer, where="here")
    except SettingsError as refused:
        message = str(refused)
        assert message.startswith("here: ")
        assert "\n" not in message
    else:
        assert -1.0 <= read.real <= 2.5
