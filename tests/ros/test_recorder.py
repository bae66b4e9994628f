"""What the recorder keeps for the identification, where rows are missed."""

from pathlib import Path

import numpy as np
import pytest
from world import estimate

from treadline.core.errors import SettingsError
from treadline.core.signals import TrackCommand
from treadline.io.records import read_record
from treadline.io.runs import INPUTS, OUTPUTS, RECORD
from treadline.ros import channels as on
from treadline.ros.lockstep import InProcess
from treadline.ros.recorder import RecorderNode, open_bag


@pytest.mark.parametrize(
    ("missed", "rows", "beyond"), [((), 39, 0), ((37,), 36, 1), ((3,), 35, 2), ((20,), 19, 18), ((10, 30), 18, 17)]
)
def test_of_the_stretches_between_missed_rows_the_longest_is_kept(
    tmp_path: Path, missed: tuple[int, ...], rows: int, beyond: int
) -> None:
    """Test: 40 periods, some ticks at their ends never came. Expected result: the longest stretch, and a word of the rest."""
    recorder, air = RecorderNode(tmp_path, 0.25), InProcess()
    recorder.listen(air)
    for k in range(40):
        air.publish(on.TRACKS_CMD, TrackCommand(t_s=0.25 * k, left_m_s=float(k), right_m_s=0.0))
        air.publish(on.ESTIMATE, estimate(0.25 * k, 0.01 * k))
        if k not in missed:
            recorder.tick(0.25 * k)
    recorder.close()
    record = read_record(tmp_path / RECORD, inputs=INPUTS, outputs=OUTPUTS)
    assert np.all(np.diff(record.u[:, 0]) == 1.0)
    assert record.u.shape[0] == rows
    declared = f"record.csv holds the longest stretch, {rows} rows: {beyond} more lie beyond rows that were missed"
    assert recorder.left_out == (declared if missed else None)


@pytest.mark.parametrize(
    ("name", "said"),
    [("x.csv", r"'.csv' is no bag that is written: .mcap, .bag \(ROS 1\), .db3 \(ROS 2\)"), ("there.bag", "is there already")],
)
def test_a_bag_that_cannot_be_written_is_refused(tmp_path: Path, name: str, said: str) -> None:
    (tmp_path / "there.bag").touch()
    with pytest.raises(SettingsError, match=said):
        open_bag(tmp_path / name)
