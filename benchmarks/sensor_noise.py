"""Depth images of three kinds of sensors from exact ones: active stereo, structured light and time of flight.

The models come from publications on the sensors. They share neither code nor constants with the detector, or with the simulated
sensors (``treadline.plant.sensors``), whose noise the detector was developed on.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import binary_dilation, gaussian_filter, grey_dilation, maximum_filter, minimum_filter, zoom

Image = Float[np.ndarray, "h w"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ExactImage:
    """Exact depth image with what sensors depend on."""

    depth_m: Image
    rays: Float[np.ndarray, "h w 3"]
    """Rays of unit depth, in any axes."""
    normals: Float[np.ndarray, "h w 3"]
    """Unit normals of what they meet, in the same axes."""
    focal_px: float


STEREO_BASELINE_M, KINECT_BASELINE_M = 0.05, 0.075
"""Distance of the imagers of a D435 (data sheet), and of projector and imager of a Kinect 1 (Khoshelham and Elberink) [m]."""
STEREO_PX, STEREO_STEP_PX, STEREO_WINDOW_PX = 0.08, 1.0 / 32.0, 7
"""Standard deviation of the disparity of active stereo, its unit and the matching window [px]. The tuning guide of the D400 series
(Grunnet-Jepsen, Sweetser and Woodfill) has 0.05 px on textured walls; with the pattern alone 0.08 px is usual."""
KINECT_PX, KINECT_STEP_PX = 0.0625, 1.0 / 8.0
"""The same for a Kinect 1: half of its unit of 1/8 px (Khoshelham and Elberink, Sensors 12, 2012)."""
PATCHES_PX = (2.5, 10.0, 40.0)
"""Scales of the errors of a disparity [px]: a matching window, bumps of flat walls in recordings, and what calibration leaves."""
GRAZING = (0.05, 0.25)
"""Cosines of the angle between ray and normal at which no pixel, and every pixel, of structured light has a depth."""
TOF_SHARE, TOF_BASE_M, ALBEDO, CELL_PX = 0.0025, 0.002, 0.3, 20
"""Range noise of time of flight per metre and at no range [m] (Tölgyessy et al., Sensors 21, 2021: 2 to 8 mm at 1 to 3 m), share of
light reflected by carpet and concrete, whose biases become 20 mm, 50 mm in corners, and size of the patches that reflect [px]."""
JUMP_SHARE = 0.03
"""Least relative change of depth between neighbouring pixels of an edge: three times that of a floor seen at 10° with 400 px."""


def smooth_noise(shape: tuple[int, int], sigma_px: float, rng: np.random.Generator) -> Image:
    """Return noise of unit deviation that neighbouring pixels share."""
    coarse = max(1, int(0.5 * sigma_px))
    noise = gaussian_filter(rng.standard_normal([-(-side // coarse) for side in shape]), sigma_px / coarse)
    return (zoom(noise, coarse, order=1) if coarse > 1 else noise)[: shape[0], : shape[1]] / noise.std()


def patchy_noise(shape: tuple[int, int], rng: np.random.Generator) -> Image:
    """Return noise of unit deviation, a third of whose variance is alike over a matching window, over patches and over regions."""
    return np.asarray(sum(smooth_noise(shape, scale_px, rng) for scale_px in PATCHES_PX) / np.sqrt(len(PATCHES_PX)))


def hidden_from_second(disparity_px: Image) -> Bool[np.ndarray, "h w"]:
    """Return the pixels that the second optic, to the right of the first, cannot see: a nearer one further right hides them."""
    columns = np.arange(disparity_px.shape[1]) - np.nan_to_num(disparity_px)
    nearest = np.minimum.accumulate(columns[:, ::-1], axis=1)[:, ::-1]
    return columns > nearest + 0.5


def edges_of(depth_m: Image) -> Bool[np.ndarray, "h w"]:
    """Return the pixels within one pixel of a jump of depth."""
    return np.asarray(maximum_filter(depth_m, 3) > (1.0 + JUMP_SHARE) * minimum_filter(depth_m, 3) + 0.02)


def active_stereo(image: ExactImage, rng: np.random.Generator) -> Image:
    """Return the depth of active stereo.

    The matching window makes what is near grow over what is behind, by up to half of its size and by another amount from place to
    place; disparities share their errors over a window, and come in steps; what one imager sees alone is missing.
    """
    depth_m = image.depth_m
    disparity = STEREO_BASELINE_M * image.focal_px / depth_m
    grown = grey_dilation(disparity, size=(STEREO_WINDOW_PX - 2, STEREO_WINDOW_PX))
    is_fat = smooth_noise(depth_m.shape, 2.0, rng) > 0.0
    seen = np.where(is_fat & edges_of(grey_dilation(depth_m, 3)), grown, disparity)
    hidden = hidden_from_second(disparity)
    seen = seen + STEREO_PX * patchy_noise(depth_m.shape, rng)
    seen = np.round(seen / STEREO_STEP_PX) * STEREO_STEP_PX
    return np.where(hidden | (seen < 1.0), np.nan, STEREO_BASELINE_M * image.focal_px / np.maximum(seen, 1.0))


def structured_light(image: ExactImage, rng: np.random.Generator) -> Image:
    """Return the depth of a Kinect 1.

    Disparities come in steps of 1/8 px with errors alike over a window; the projector's shadow lies at the left of what is near,
    edges lose a pixel, and surfaces at a grazing angle reflect too little.
    """
    depth_m = image.depth_m
    disparity = KINECT_BASELINE_M * image.focal_px / depth_m
    seen = disparity + KINECT_PX * patchy_noise(depth_m.shape, rng)
    seen = np.round(seen / KINECT_STEP_PX) * KINECT_STEP_PX
    facing = np.abs(np.sum(image.rays * image.normals, axis=-1)) / np.linalg.norm(image.rays, axis=-1)
    lost = (facing - GRAZING[0]) / (GRAZING[1] - GRAZING[0]) < rng.random(depth_m.shape)
    shadow = binary_dilation(hidden_from_second(disparity), iterations=1)
    lost |= shadow | (edges_of(depth_m) & (rng.random(depth_m.shape) < 0.5)) | (depth_m < 0.45)
    return np.where(lost, np.nan, KINECT_BASELINE_M * image.focal_px / np.maximum(seen, 1.0))


def multipath_m(points: np.ndarray, normals: np.ndarray) -> Float[np.ndarray, " n"]:
    """Return by how much light that was reflected once more makes the range of patches longer.

    Patches are Lambertian. Patch j is lit from the camera, and reflects to patch i the share ``albedo cos_i cos_j A_j / (π d²)``
    relative to the light that i returns directly, over a detour; the phase of the sum is about that of the weighted mean.

    Args:
        points: Centres of the patches from the camera [m], n × 3.
    """
    ranges = np.linalg.norm(points, axis=1)
    area = ranges**2 / np.maximum(np.abs(np.sum(points * normals, axis=1)) / ranges, 0.1) * (CELL_PX / 450.0) ** 2
    between = points[None] - points[:, None]
    distance = np.maximum(np.linalg.norm(between, axis=2), 0.03)
    leaving = np.maximum(np.einsum("ijk,ik->ij", between, normals) / distance, 0.0)
    arriving = np.maximum(-np.einsum("ijk,jk->ij", between, normals) / distance, 0.0)
    weight = (
        ALBEDO
        * leaving
        * arriving
        * area[None]
        / (np.pi * np.maximum(distance**2, area[None]))
        * (ranges[:, None] / ranges[None]) ** 2
    )
    detour = 0.5 * (ranges[None] + distance - ranges[:, None])
    return np.sum(weight * detour, axis=1) / (1.0 + np.sum(weight, axis=1))


def time_of_flight(image: ExactImage, rng: np.random.Generator) -> Image:
    """Return the depth of a time-of-flight sensor.

    Ranges have noise that grows with them and are too long in corners, where light is reflected twice (Jiménez et al., Image and
    Vision Computing 32, 2014); pixels on an edge mix near and far.
    """
    depth_m = image.depth_m
    length = np.linalg.norm(image.rays, axis=-1)
    middle = CELL_PX // 2
    coarse = (depth_m[..., None] * image.rays)[middle::CELL_PX, middle::CELL_PX]
    bias = multipath_m(coarse.reshape(-1, 3), image.normals[middle::CELL_PX, middle::CELL_PX].reshape(-1, 3)).reshape(
        coarse.shape[:2]
    )
    bias = zoom(gaussian_filter(bias, 1.0), np.array(depth_m.shape) / bias.shape, order=1, mode="nearest", grid_mode=True)
    mixing = rng.random(depth_m.shape)
    mixed = mixing * minimum_filter(depth_m, 3) + (1.0 - mixing) * maximum_filter(depth_m, 3)
    flying = edges_of(depth_m) & (rng.random(depth_m.shape) < 0.5)
    ranges = np.where(flying, mixed, depth_m) * length + bias
    ranges = ranges + (TOF_BASE_M + TOF_SHARE * ranges) * rng.standard_normal(depth_m.shape)
    return np.where(ranges > 7.0, np.nan, ranges / length)


def exact(image: ExactImage, _: np.random.Generator) -> Image:
    """Return the depth without an error."""
    return image.depth_m


NOISES: dict[str, Callable[[ExactImage, np.random.Generator], Image]] = {
    "stereo": active_stereo,
    "kinect1": structured_light,
    "tof": time_of_flight,
    "exact": exact,
}
"""Measured depth image by kind of sensor."""
FOCAL_PX = {"stereo": {640: 385.0, 848: 425.0}, "kinect1": {640: 575.0}, "tof": {640: 504.0}, "exact": {640: 525.0}}
"""Focal lengths by width [px]: D435 at 640×480 and 848×480, Kinect 1, and the narrow field of view of an Azure Kinect."""
