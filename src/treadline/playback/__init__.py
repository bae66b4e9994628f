"""A run as arrays, complete or still growing, and what its log does not name: ``run folder, log or signals -> Recording``.

``read_recording`` reads a run, and ``RecordingBuilder`` takes its signals while it is under way; ``findings_of`` returns moments,
holds, perceived nosings and the least tip-over margin.
"""

from treadline.playback._builder import RecordingBuilder, SignalCollector
from treadline.playback._moments import (
    Findings,
    Hold,
    Moment,
    findings_of,
    holding_at,
    least_margin,
    on_flight,
    support_at,
)
from treadline.playback._nosings import (
    HALF_LINE_M,
    FrameNosings,
    NosingComparison,
    comparison_of,
    in_runs,
    missed_text,
    perceived_text,
    pixels_of,
)
from treadline.playback._read_run import bag_origin_ns, manifest_of, read_frames, read_recording, run_folder_of
from treadline.playback._recording import Limits, PerceivedStair, PhaseSpan, Recording, phases_at, staircase_of
