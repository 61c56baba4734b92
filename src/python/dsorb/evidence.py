# SPDX-License-Identifier: BSD-3-Clause
"""What the images without a pose show: measured on some of them, so that advice can name numbers. Needs OpenCV's Python
module; where it or the images are not there, there is no evidence."""
from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Optional

import numpy as np

from ._dsorb import Rectifier
from .pictures import calibration_of, decoded, opencv
from .run_folder import Run

WINDOWS, LENGTH = 8, 10  # looked at; images of each
FARTHEST = 3000  # image of a video that is looked at: all before it are decoded
MOST_CORNERS, QUALITY, DISTANCE = 300, 0.01, 8  # of OpenCV's goodFeaturesToTrack; [px]
LEAST_CONTRAST = 4  # [grey levels] standard deviation of an image; below it corners are those of noise
BACK = 0.7  # [px] that a corner followed there and back may be off
LEAST_TRACKS = 15
DARK = 16  # mean grey level of 255; the rendered rooms are at 90 to 130, and start no more at 7
FEW_CORNERS = 60
STILL = 1.0  # [px] over a window; corners are found again to a tenth of that
TURN_DEG, LEFT_SHARE = 1.0, 0.05  # a turn, and the share of the flow that it leaves: rendered turns 0.01, walks 0.35 and more
FAST_SHARE, KEPT_SHARE = 0.08, 0.6  # as in Evidence; a room crossed at 12 times a walk's speed, blurred, has 0.03 and 0.8


@dataclass
class Evidence:
    """Medians over the windows; None where too few corners could be followed."""
    images: int
    grey: float  # mean grey level
    brightest: float  # mean grey level of the brightest
    corners: float
    neighbour_share: Optional[float] = None  # of the width, that corners move by between neighbours
    kept_share: Optional[float] = None  # of the corners, found again in the neighbour
    flow: Optional[float] = None  # [px] over LENGTH images
    turn_deg: Optional[float] = None  # that explains the flow best
    left: Optional[float] = None  # [px] of the flow without that turn

    @property
    def dark_throughout(self) -> bool:
        return self.brightest < DARK


def windows_of(run: Run) -> list[list[int]]:
    """Indices of stretches of neighbouring images without a pose, spread over all of them."""
    posed = {frame.index for segment in run.segments for frame in segment.frames}
    files = any(row.image for row in run.rows)
    places = [p for p, row in enumerate(run.rows) if row.index not in posed and (files or row.index < FARTHEST)]
    begins = [begin for begin, end in zip(places, places[LENGTH - 1:]) if end - begin == LENGTH - 1]
    chosen = sorted({begins[k] for k in np.linspace(0, len(begins) - 1, WINDOWS).astype(int)}) if begins else []
    return [[row.index for row in run.rows[begin:begin + LENGTH]] for begin in chosen]


def follow(cv2: Any, first: np.ndarray, second: np.ndarray, corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where corners, (n, 1, 2), are in the next image, and which were found there and back."""
    there, found, _ = cv2.calcOpticalFlowPyrLK(first, second, corners, None)
    back, found_back, _ = cv2.calcOpticalFlowPyrLK(second, first, there, None)
    off = np.linalg.norm((back - corners).reshape(-1, 2), axis=1)
    return there, (found.ravel() == 1) & (found_back.ravel() == 1) & (off < BACK)


def turn_of(rays: np.ndarray, later: np.ndarray) -> np.ndarray:
    """(3, 3) rotation from unit vectors to later ones, without the half that fits worse."""
    keep = np.ones(len(rays), bool)
    for _ in range(4):
        u, _, v = np.linalg.svd(later[keep].T @ rays[keep])
        rotation = u @ np.diag([1, 1, np.linalg.det(u @ v)]) @ v
        off = np.linalg.norm(rays @ rotation.T - later, axis=1)
        keep = off <= np.median(off)
    return rotation


def motion(camera: Any, begin: np.ndarray, end: np.ndarray) -> tuple[float, float, float]:
    """Flow [px], turn [degrees], what the turn leaves of the flow [px]; of pixels, (n, 2), at two times."""
    def rays_of(pixels: np.ndarray) -> np.ndarray:
        rays = np.c_[(pixels - [camera.cx, camera.cy]) / [camera.fx, camera.fy], np.ones(len(pixels))]
        return rays / np.linalg.norm(rays, axis=1, keepdims=True)
    rotation = turn_of(rays_of(begin), rays_of(end))
    turned = rays_of(begin) @ rotation.T
    left = turned[:, :2] / turned[:, 2:] * [camera.fx, camera.fy] + [camera.cx, camera.cy] - end
    angle = np.degrees(np.arccos(np.clip((np.trace(rotation) - 1) / 2, -1, 1)))
    return tuple(float(x) for x in (np.median(np.linalg.norm(end - begin, axis=1)), angle, np.median(np.linalg.norm(left, axis=1))))


def corners_of(cv2: Any, image: np.ndarray) -> np.ndarray:
    if image.std() < LEAST_CONTRAST:
        return np.zeros((0, 1, 2), np.float32)
    found = cv2.goodFeaturesToTrack(image, MOST_CORNERS, QUALITY, DISTANCE)
    return found if found is not None else np.zeros((0, 1, 2), np.float32)


def look(cv2: Any, camera: Any, images: list) -> Evidence:
    """At one window of rectified images."""
    corners = corners_of(cv2, images[0])
    evidence = Evidence(len(images), float(images[0].mean()), float(images[0].mean()), len(corners))
    if len(corners) < LEAST_TRACKS:
        return evidence
    begin, now = corners, corners
    for number, (first, second) in enumerate(zip(images, images[1:])):
        there, found = follow(cv2, first, second, now)
        if number == 0:
            evidence.kept_share = float(found.mean())
            moved = np.linalg.norm((there - now)[found].reshape(-1, 2), axis=1)
            evidence.neighbour_share = float(np.median(moved)) / camera.width if len(moved) else None
        begin, now = begin[found], there[found]
        if len(now) < LEAST_TRACKS:
            return evidence
    evidence.flow, evidence.turn_deg, evidence.left = motion(camera, begin.reshape(-1, 2), now.reshape(-1, 2))
    return evidence


def gather(run: Run) -> Optional[Evidence]:
    """Medians of what some of the images without a pose show; None where they cannot be had."""
    windows = windows_of(run)
    no_files = not all(row.image for row in run.rows)
    if not windows or 'lens' not in run.summary or (no_files and not Path(run.dataset).is_file()):
        return None
    try:
        cv2 = opencv('evidence')
        rectifier = Rectifier(calibration_of(run.summary['lens']))
        images = {index: np.nan_to_num(rectifier.rectify(image)).clip(0, 255).astype(np.uint8)
                  for index, image in decoded(cv2, run, set(sum(windows, [])))}
    except (ValueError, RuntimeError, OSError):
        return None
    seen = [look(cv2, rectifier.camera, [images[i] for i in window]) for window in windows if all(i in images for i in window)]
    if not seen:
        return None
    medians = {}
    for name in ('grey', 'corners', 'neighbour_share', 'kept_share', 'flow', 'turn_deg', 'left'):
        values = [getattr(e, name) for e in seen if getattr(e, name) is not None]
        medians[name] = float(np.median(values)) if values else None
    return Evidence(images=len(images), brightest=max(e.grey for e in seen), **medians)


def findings(evidence: Evidence) -> list[str]:
    """Sentences with what to do, the surest first."""
    e, lines = evidence, []
    if e.grey < DARK:
        lines.append(f'too dark: the mean grey level is {e.grey:.0f} of 255. More light, or a longer exposure, helps')
    elif e.corners < FEW_CORNERS:
        lines.append(f'too little texture, or blurred: {e.corners:.0f} corners an image. A scene with more detail, or a shorter '
                     'exposure, helps')
    if e.neighbour_share is not None and (e.neighbour_share > FAST_SHARE or e.kept_share < KEPT_SHARE) and e.grey >= DARK:
        lines.append(f'fast motion, or blur: from one image to the next points move by {100 * e.neighbour_share:.0f} % of the width '
                     f'and {100 * e.kept_share:.0f} % of them are found again. Slower motion, or more images a second, helps')
    if e.flow is None or e.grey < DARK:
        return lines
    if e.flow < STILL:
        lines.append(f'the camera stood still: over {LENGTH} images points move by {e.flow:.1f} px. Move it sideways, by about a '
                     'twentieth of the distance to the scene')
    elif e.turn_deg > TURN_DEG and e.left < max(STILL, LEFT_SHARE * e.flow):
        lines.append(f'the camera turned on the spot: over {LENGTH} images points move by {e.flow:.1f} px, and by {e.left:.1f} px '
                     f'without its turn of {e.turn_deg:.1f} deg. Walk instead of turning')
    return lines


def wrong_angle(run: Run) -> str:
    """[degrees] by which a direction has to be off to be called wrong, as the run was told."""
    try:
        found = re.search(r'wrong_angle_deg: ([\d.]+)', (run.folder / 'config.yaml').read_text(encoding='utf-8'))
    except OSError:
        found = None
    return found.group(1) if found else '10'
