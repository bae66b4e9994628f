"""Small recording of a run, for ``treadline demo``: ``run folder -> run folder of a few hundred kilobytes``.

``treadline climb up-28 --out RUN && python docs/tools/demo_recording.py RUN src/treadline/data/recordings/up-28`` makes the
shipped one.
The log keeps what a recording holds, without images: ground truth at 25 Hz, the rate of the viewer, the rest at 12.5 Hz, numbers in
single precision, and every event, stair map and frame stamp.
"""

import argparse
import json
from collections import Counter
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from treadline.core.files import read_json, write_whole
from treadline.core.ports import Truth
from treadline.core.signals import FlipperReading, HeadingEstimate, TrackCommand
from treadline.io.mcap_log import RunLog
from treadline.io.mcap_read import LogDecoder, mcap_messages
from treadline.io.messages import messages_of
from treadline.io.runs import LOG, MANIFEST, RUN_CONTROLLER

EVERY = {Truth: 4, HeadingEstimate: 8, TrackCommand: 8, FlipperReading: 8}
"""Decimation of the signals at 100 Hz."""
TOPICS = (
    "/truth",
    "/stair/heading/detail",
    "/tracks/cmd",
    "/flipper/state",
    "/diagnostics",
    "/stair/map/detail",
    "/camera/quality",
)
"""Topics that a recording needs."""
RESULTS = ("verdict", "cause", "seed", "duration_s")
"""Keys of the result that are kept."""


def rounded(signal: Any) -> Any:
    """Return a signal with its numbers in single precision, which a log compresses to half; stamps stay."""
    values = {item.name: getattr(signal, item.name) for item in fields(signal) if item.name != "t_s"}
    numbers = {name: value for name, value in values.items() if isinstance(value, float | np.ndarray)}
    single = {name: np.asarray(value, dtype=np.float32).astype(float) for name, value in numbers.items()}
    return replace(signal, **{name: value if value.ndim else float(value) for name, value in single.items()})


def write_demo(run: Path, folder: Path) -> None:
    """Write the small recording of a run folder."""
    folder.mkdir(parents=True, exist_ok=True)
    counts: Counter[str] = Counter()
    with RunLog(folder / LOG, messages=lambda signal: [item for item in messages_of(signal) if item[0] in TOPICS]) as log:
        decoder = LogDecoder()
        for topic, logged_ns, data in mcap_messages(run / LOG, TOPICS.__contains__, sealed=True):
            signal = decoder.signal(topic.name, topic.kind, data)
            if signal is not None and counts[topic.name] % EVERY.get(type(signal), 1) == 0:
                log(rounded(signal), 1e-9 * logged_ns)
            counts[topic.name] += 1
    result = read_json(run / "result.json")
    write_whole(folder / "result.json", json.dumps({name: result[name] for name in RESULTS}, indent=1) + "\n")
    for name in (MANIFEST, RUN_CONTROLLER):
        write_whole(folder / name, (run / name).read_text(encoding="utf-8"))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0] if __doc__ else "")
    parser.add_argument("run", type=Path, help="run folder")
    parser.add_argument("folder", type=Path, help="folder to write")
    arguments = parser.parse_args()
    write_demo(arguments.run, arguments.folder)
