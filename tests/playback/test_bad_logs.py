"""A target that cannot be played is one line that says what, where and what to do."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from treadline.core.errors import LogFormatError, SettingsError, TreadlineError
from treadline.core.signals import OperatorInput
from treadline.io.mcap_log import RunLog
from treadline.playback import read_recording

from .conftest import signals_of_a_run

Written = Callable[..., Path]


def refused(target: Path) -> str:
    with pytest.raises((LogFormatError, SettingsError)) as caught:
        read_recording(target)
    assert isinstance(caught.value, TreadlineError)
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize("signals", [(), (OperatorInput(t_s=0.0),)], ids=["empty", "nothing that moves"])
def test_a_log_without_anything_to_play_is_refused(tmp_path: Path, signals: tuple[OperatorInput, ...]) -> None:
    with RunLog(tmp_path / "quiet.mcap") as log:
        for signal in signals:
            log(signal)
    assert "no signals to play" in refused(tmp_path / "quiet.mcap")


def test_a_missing_target_a_plain_folder_another_kind_and_a_run_without_log_are_refused(written: Written, tmp_path: Path) -> None:
    assert "no such file" in refused(tmp_path / "nowhere")
    (tmp_path / "run.txt").write_text("not a log")
    assert "not a message log" in refused(tmp_path / "run.txt")
    (tmp_path / "plain").mkdir()
    assert "no manifest.json" in refused(tmp_path / "plain")
    folder = written(signals_of_a_run())
    (folder / "log.mcap").unlink()
    assert "no log.mcap" in refused(folder)


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"stair": {"breadth_m": 1.0}}, "another version"),
        ({"robot": []}, "settings.robot names no chair; make the run again"),
        ({"robot": {"mission": {}}}, "settings.robot names no chair; make the run again"),
        ({"robot": {"mission": {"chair": 7}}}, "settings.robot names no chair; make the run again"),
    ],
)
def test_settings_that_cannot_be_read_are_refused_with_the_remedy(written: Written, settings: dict[str, Any], said: str) -> None:
    folder = written(signals_of_a_run())
    manifest = folder / "manifest.json"
    manifest.write_text(json.dumps(json.loads(manifest.read_text()) | {"settings": settings}))
    assert said in refused(folder)
