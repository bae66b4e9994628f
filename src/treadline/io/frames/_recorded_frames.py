"""Frames of a recording: depth images with their calibration, or point clouds, of an MCAP file, a ROS bag or a run log.

Topics are found by message type. Depth alone makes a frame; colour images are paired with depth images by their time where
pictures or Algorithm 1 need them, and a depth image without a partner is used without colour.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from treadline.core.camera_images import NamedFrame
from treadline.core.errors import LogFormatError, SettingsError
from treadline.io._tables import listed
from treadline.io.frames._cloud_files import POINT_CLOUD, cloud_of, point_cloud
from treadline.io.frames.point_cloud import UNITS, FrameOptions, cloud_image
from treadline.io.images import MILLIMETRE, PAIR_S, Paired, Pairing, with_mount
from treadline.io.mcap_read import RecordedTopic
from treadline.io.messages import IMAGE
from treadline.io.runs import LOG
from treadline.io.topics import (
    TopicSummary,
    compressed_hint,
    damaged_message,
    depth_topics,
    image_topics,
    packets,
    received,
    survey,
)


class FramesOfLog:
    """Frames of one recording, in the order of the file.

    Raises:
        LogFormatError: If the log is missing, damaged, empty, or without depth.
        SettingsError: If a topic must be named, or is not in the log.
    """

    def __init__(self, path: Path, options: FrameOptions) -> None:
        """Survey a log.

        Args:
            options: ``camera`` is calibration and mount in place of the log's; ``topic`` is needed where several topics hold depth.
        """
        self._path = path
        self._sealed = (path / LOG).is_file()
        self._log = path / LOG if self._sealed else path
        self._options, self._given = options, options.camera
        self._mount = options.mount if options.camera is None else options.camera.camera
        self._mount_known = options.mount is not None if options.camera is None else options.camera.mount_known
        self._gravity_C = options.gravity_C
        found = survey(self._log, sealed=self._sealed)
        self.topic = _chosen(path, found, options.topic)
        self.is_cloud = found[self.topic].kind == POINT_CLOUD
        self._roles = {self.topic: "cloud" if self.is_cloud else "depth"}
        color = self._info = None
        if not self.is_cloud:
            color, self._info = image_topics(path, found, self.topic, {}, calibrated=self._given is not None)
        if self._info is not None and self._given is None:
            self._roles[self._info] = "info"
        self._wants_colour = self._options.colour and color is not None
        if color is not None and self._wants_colour:
            self._roles[color] = "color"
        self._origin_ns = found[self.topic].stamp_ns
        self.count: int | None = found[self.topic].count
        self._noted: dict[str, None] = {}
        self._unpaired = self._repeated = self._uncalibrated = 0

    @property
    def warnings(self) -> list[str]:
        """Properties of the log that a user has to know."""
        counted = [
            (
                self._unpaired,
                f"of {self.count} depth images have no colour image within {1e3 * PAIR_S:.0f} ms and were used without",
            ),
            (self._repeated, f"of {self.count} messages on {self.topic} have no later stamp than the one before and were left out"),
            (self._uncalibrated, f"of {self.count} depth images come before the first calibration and were left out"),
        ]
        return [*self._noted, *(f"{count} {what}" for count, what in counted if count)]

    def __iter__(self) -> Iterator[NamedFrame]:
        given, unit = self._given, self._options.unit
        self._pairing = Pairing(
            has_colour=self._wants_colour,
            unit_m=UNITS[unit] if unit else MILLIMETRE if given is None else given.depth_unit_m,
            calibrate=lambda logged: logged if given is None else given.camera,
            lost=self._lost,
            is_alone_enough=True,
            is_ours=self._sealed,
        )
        self._last_s = -np.inf
        number = -1
        for number, paired in enumerate(self._paired()):
            yield self._named(number, paired)
        if number < 0:
            raise LogFormatError(
                f"{self._path}: no calibration on {self._info} before the last depth image; give --camera camera.toml"
            )

    def _paired(self) -> Iterator[Paired]:
        for topic, logged_ns, data in packets(self._log, self._roles.__contains__, sealed=self._sealed):
            with damaged_message(self._path, topic.name):
                frames = self._frames(topic, logged_ns, data)
            yield from frames
        yield from self._pairing.rest()

    def _frames(self, topic: RecordedTopic, logged_ns: int, data: bytes) -> list[Paired]:
        """Return the frames that a message completes."""
        message, role = received(topic, data, logged_ns, self._origin_ns), self._roles[topic.name]
        if role in ("depth", "cloud"):
            if message.t_s <= self._last_s:
                self._repeated += 1
                return []
            self._last_s = message.t_s
        if role != "cloud":
            return self._pairing.take(role, *message)
        values, size = point_cloud(message.body), (message.body.width, message.body.height)
        return [self._of_cloud(message.t_s, size, values)]

    def _lost(self, t_s: float, reason: str) -> None:
        del t_s, reason
        self._uncalibrated += 1

    def _of_cloud(self, t_s: float, size: tuple[int, int], values: np.ndarray) -> Paired:
        named, warning = cloud_image(f"cloud at {t_s:.3f} s", cloud_of(values, size if min(size) > 1 else None, t_s), self._options)
        self._gravity_C = named.gravity_C
        if warning is not None and not self._noted:
            self._noted[warning] = None
        assert named.frame is not None  # noqa: S101 - for the type checker
        return Paired(named.frame, named.has_colour)

    def _named(self, number: int, paired: Paired) -> NamedFrame:
        frame, has_colour = paired
        self._unpaired += self._wants_colour and not has_colour
        if self._mount is not None:
            frame = replace(frame, camera=with_mount(frame.camera, self._mount))
        return NamedFrame(
            name=f"{number:06d}",
            frame=frame,
            mount_known=self._mount_known,
            gravity_C=self._gravity_C,
            has_colour=has_colour,
            t_s=frame.t_s,
        )


def _chosen(path: Path, found: Mapping[str, TopicSummary], topic: str | None) -> str:
    """Return the topic of depth images or clouds: the named one, the only one of depth images, or the only one of clouds."""
    if not found:
        raise LogFormatError(f"{path}: no messages; was anything recorded?")
    images = depth_topics(found)
    clouds = [name for name, item in found.items() if item.kind == POINT_CLOUD]
    if topic is not None:
        if topic not in found:
            raise SettingsError(f"--topic {topic}: no such topic in {path} (there are: {listed(found)})")
        if topic not in images and topic not in clouds:
            held = found[topic].kind + (f" '{found[topic].pixels}'" if found[topic].kind == IMAGE else "")
            raise SettingsError(
                f"--topic {topic}: holds {held}; depth images or {POINT_CLOUD} are needed: {listed(images + clouds)}"
            )
        return topic
    candidates = images or clouds
    if not candidates:
        hint = compressed_hint(found) or "; treadline climb keeps its frames with --log-images"
        raise LogFormatError(f"{path}: neither depth images nor point clouds{hint} (there are: {listed(found)})")
    if len(candidates) > 1:
        raise SettingsError(f"{path}: several topics hold depth: {listed(candidates)}; choose one: --topic {candidates[0]}")
    return candidates[0]
