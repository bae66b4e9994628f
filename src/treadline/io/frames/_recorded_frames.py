"""Frames of a recording: depth images with their calibration, or point clouds, of an MCAP file, a ROS bag or a run log.

Topics are found by message type. Depth alone makes a frame; colour images are paired with depth images by their time where
pictures or Algorithm 1 need them, and a depth image without a partner is used without colour.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from treadline.core.camera_images import NamedFrame, RgbdFrame, black
from treadline.core.errors import ImageError, LogFormatError, SettingsError
from treadline.io._tables import listed
from treadline.io.decode import Picture, calibration, picture
from treadline.io.frames._cloud_files import POINT_CLOUD, cloud_of, point_cloud
from treadline.io.frames.point_cloud import UNITS, FrameOptions, cloud_image
from treadline.io.mcap_read import BROKEN, RecordedTopic
from treadline.io.messages import IMAGE
from treadline.io.runs import LOG
from treadline.io.topics import (
    PAIR_S,
    TopicSummary,
    color_topic,
    compressed_hint,
    depth_metres,
    depth_topics,
    info_topic,
    packets,
    received,
    rgb_pixels,
    survey,
    with_mount,
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
        self._mount_known |= options.pose is not None
        self._gravity_C = options.gravity_C
        found = survey(self._log, sealed=self._sealed)
        self.topic = _chosen(path, found, options.topic)
        self.is_cloud = found[self.topic].kind == POINT_CLOUD
        self._roles = {self.topic: "cloud" if self.is_cloud else "depth"}
        if not self.is_cloud:
            self._add_image_topics(found)
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
        self._camera = None if self._given is None else self._given.camera
        self._depth: Picture | None = None
        self._colour: Picture | None = None
        self._last_s = -np.inf
        number = 0
        for topic, logged_ns, data in packets(self._log, self._roles.__contains__, sealed=self._sealed):
            try:
                ready = list(self._frames(topic, logged_ns, data))
            except (LogFormatError, *BROKEN) as error:
                raise LogFormatError(f"{self._path}: {topic.name}: {error}") from None
            except ImageError as error:
                raise ImageError(f"{self._path}: {topic.name}: {error}") from None
            for frame, has_colour in ready:
                yield self._named(number, frame, has_colour)
                number += 1
        for frame, has_colour in self._flushed():
            yield self._named(number, frame, has_colour)
            number += 1
        if number == 0:
            raise LogFormatError(
                f"{self._path}: no calibration on {self._info} before the last depth image; give --camera camera.toml"
            )

    def _add_image_topics(self, found: Mapping[str, TopicSummary]) -> None:
        color = color_topic(found, self.topic)
        self._info = info_topic(found, self.topic, color)
        if self._given is None and self._info is None:
            raise LogFormatError(f"{self._path}: no intrinsics: no CameraInfo next to {self.topic}; give --camera camera.toml")
        self._wants_colour = self._options.colour and color is not None
        if self._wants_colour and color is not None:
            self._roles[color] = "colour"
        if self._given is not None:
            size, of = (self._given.width, self._given.height), "the calibration"
        else:
            assert self._info is not None  # noqa: S101 - for the type checker
            self._roles[self._info] = "info"
            size, of = found[self._info].size, self._info
        if size != found[self.topic].size:
            width, height = found[self.topic].size
            raise ImageError(f"{self._path}: {self.topic} is {width}×{height} pixels, {of} is for {size[0]}×{size[1]}")

    def _frames(self, topic: RecordedTopic, logged_ns: int, data: bytes) -> Iterator[tuple[RgbdFrame, bool]]:
        """Yield the frames that a message completes, each with whether it has colour."""
        message = received(topic, data, logged_ns, self._origin_ns)
        match self._roles[topic.name]:
            case "cloud":
                body, t_s = message
                values = point_cloud(body)
                if self._is_later(t_s):
                    yield self._of_cloud(t_s, (body.width, body.height), values)
            case "info":
                camera = calibration(message.body)
                if not (camera.fx_px > 0.0 and camera.fy_px > 0.0):
                    raise ImageError(f"no intrinsics: fx = {camera.fx_px:g} px; the camera was never calibrated: give --camera")
                self._camera = camera
            case "colour":
                self._colour = picture(*message)
                if self._depth is not None and self._colour.t_s >= self._depth.t_s - PAIR_S:
                    yield from self._flushed()
            case _:
                yield from self._flushed()
                self._uncalibrated += self._depth is not None
                image = picture(*message)
                if self._is_later(image.t_s):
                    self._depth = image
                    if not self._wants_colour or self._pair() is not None:
                        yield from self._flushed()

    def _flushed(self) -> Iterator[tuple[RgbdFrame, bool]]:
        """Yield the frame of the waiting depth image, with colour if there is one of its time."""
        depth, camera = self._depth, self._camera
        if depth is None or camera is None:
            return
        self._depth = None
        height, width = depth.pixels.shape[:2]
        if (width, height) != (camera.width_px, camera.height_px):
            raise ImageError(
                f"an image of {width}×{height} pixels at {depth.t_s:.3f} s, the calibration is for "
                f"{camera.width_px}×{camera.height_px}"
            )
        colour = self._pair(depth)
        self._unpaired += self._wants_colour and colour is None
        unit = self._options.unit
        unit_m = UNITS[unit] if unit else 0.001 if self._given is None else self._given.depth_unit_m
        frame = RgbdFrame(
            t_s=depth.t_s,
            rgb=black(height, width) if colour is None else rgb_pixels(colour),
            depth_m=depth_metres(depth, unit_m, "--unit mm"),
            camera=camera,
        )
        yield frame, colour is not None

    def _pair(self, depth: Picture | None = None) -> Picture | None:
        """Return the colour image of the time and size of a depth image, by default the waiting one."""
        depth, colour = depth or self._depth, self._colour
        if depth is None or colour is None or abs(colour.t_s - depth.t_s) > PAIR_S:
            return None
        return colour if colour.pixels.shape[:2] == depth.pixels.shape[:2] else None

    def _of_cloud(self, t_s: float, size: tuple[int, int], values: np.ndarray) -> tuple[RgbdFrame, bool]:
        cloud, options = cloud_of(values, size if min(size) > 1 else None, t_s), self._options
        image = cloud_image(
            f"cloud at {t_s:.3f} s",
            cloud,
            self._camera,
            axes=options.axes,
            unit=options.unit or "m",
            pose=options.pose,
            gravity_F=options.gravity_C,
        )
        self._gravity_C = image.gravity_C
        if image.warning is not None and not self._noted:
            self._noted[image.warning] = None
        return image.frame, image.has_colour

    def _is_later(self, t_s: float) -> bool:
        """Return whether a stamp is later than the one before; count it otherwise."""
        later = t_s > self._last_s
        self._repeated += not later
        self._last_s = max(t_s, self._last_s)
        return later

    def _named(self, number: int, frame: RgbdFrame, has_colour: bool) -> NamedFrame:
        if self._mount is not None and self._options.pose is None:
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
