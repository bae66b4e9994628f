"""Settings files: error, location and allowed values on one line."""

import re
import tomllib
from pathlib import Path
from typing import Annotated, Any, Literal

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


REFUSED = tomllib.loads(Path(__file__).with_name("settings.toml").read_text(encoding="utf-8"))["refused"]
"""Texts, the line that is named, and what is said."""


def refusal(text: str, tmp_path: Path) -> tuple[str, int | None]:
    """Return what is said of a text, and the line that it names, if any."""
    path = tmp_path / "some.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(SettingsError) as refused:
        read_toml(path, Outer)
    message = str(refused.value)
    assert message.isprintable()  # one line, and nothing that moves a terminal's cursor
    named = re.fullmatch(rf"{re.escape(str(path))}:(?:(\d+):)? (.*)", message)
    assert named is not None
    return named[2], None if named[1] is None else int(named[1])


@pytest.mark.parametrize("case", REFUSED, ids=[case["text"] for case in REFUSED])
def test_what_is_wrong_is_named_with_its_line_its_key_and_all_that_is_allowed(case: dict[str, Any], tmp_path: Path) -> None:
    message, line = refusal(case["text"], tmp_path)
    assert message.startswith(case["says"])
    assert message == case["says"] or case["says"] == "not TOML: "
    assert line == case.get("line")


def test_a_decimal_comma_and_a_file_of_another_kind_are_named(tmp_path: Path) -> None:
    assert refusal("real = 0,16", tmp_path)[0].endswith("; decimals have a point")
    (tmp_path / "model.json").write_text('{"A": [1,2]}')
    with pytest.raises(SettingsError, match=r"not TOML: .*; give a \.toml file"):
        parse_toml(tmp_path / "model.json")


@pytest.mark.parametrize("text", ["count = " + "9" * 5000, "x = " + "[" * 5000], ids=["long number", "deep list"])
def test_what_is_too_long_for_toml_is_refused(text: str, tmp_path: Path) -> None:
    assert refusal(text, tmp_path)[0].startswith("not TOML: ")


def test_a_long_value_is_cut(tmp_path: Path) -> None:
    assert len(refusal(f'real = "{"x" * 10_000}"', tmp_path)[0]) < 200


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
