# SPDX-License-Identifier: BSD-3-Clause
"""Calibration of a camera from a video or photographs of a chessboard, by OpenCV."""
import itertools
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .pictures import PicturesError, Video, opencv

LEAST_VIEWS = 8
MOST_VIEWS = 40
NEW_VIEW = 0.04  # of the image's width that corners move by, in the mean, between two views that are taken
ARROW = 30  # times the residual
LENSES = {'radtan': 'RadTan', 'equidistant': 'EquiDistant'}  # as docs/calibration.md names them


@dataclass
class Calibrated:
    model: str
    size: tuple  # width, height [px]
    numbers: np.ndarray  # fx fy cx cy, then the coefficients
    sigmas: np.ndarray  # of fx fy cx cy [px]; NaN where OpenCV does not tell
    rms: float  # [px]
    views: list  # (n, 2) corners each
    residuals: list  # (n, 2) each: found minus projected [px]

    def text(self):
        """Content of a camera.txt."""
        numbers = ' '.join(f'{x:.9g}' for x in self.numbers)
        size = f'{self.size[0]} {self.size[1]}'
        return f'{LENSES[self.model]} {numbers}\n{size}\ncrop\n{size}\n'


def frames_of(cv2, source):
    """Grey images of a video, or of the image files of a folder in the order of their names."""
    if Path(source).is_dir():
        for file in sorted(Path(source).iterdir()):
            image = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION) if file.is_file() else None
            if image is not None:
                yield image
        return
    with Video(source) as video:
        for index in itertools.count():
            found = video.image(index)
            if found is None:
                return
            image, turn = found
            # Upside down is told by no size: such a video has the calibration of the sensor, which a run turns with the images.
            image = cv2.rotate(image, cv2.ROTATE_180) if turn == 180 else image
            yield cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)


def find_views(cv2, frames, board, every):
    """Size of the images and the corners of every view that differs from those before, (n, 2) each."""
    size, views, seen = None, [], 0
    for index, image in enumerate(frames):
        if size is not None and image.shape[::-1] != size:
            raise PicturesError(f'image {index}: {image.shape[1]}x{image.shape[0]} px, those before {size[0]}x{size[1]}')
        size = image.shape[::-1]
        if index % every:
            continue
        found, corners = cv2.findChessboardCornersSB(image, board, flags=cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_ACCURACY)
        if not found:
            continue
        seen += 1
        corners = corners.reshape(-1, 2)
        if all(np.linalg.norm(corners - view, axis=1).mean() > NEW_VIEW * size[0] for view in views):
            views.append(corners)
    if size is None:
        raise PicturesError('no image could be read')
    if len(views) < LEAST_VIEWS:
        raise PicturesError(f'the board of {board[0]}x{board[1]} inner corners was seen in {seen} images, {len(views)} of them '
                            f'different views; expected {LEAST_VIEWS} or more: near and far, tilted, in all corners')
    return size, [views[i] for i in np.linspace(0, len(views) - 1, min(len(views), MOST_VIEWS)).round().astype(int)]


def calibrate(source, board, model='radtan', every=1):
    """Lens of a camera that saw a chessboard.

    `board` is (columns, rows) of inner corners, `every` uses each N-th image only. Raises PicturesError (a ValueError)
    where the images cannot be read or show too few views."""
    cv2 = opencv('calibrating')
    size, views = find_views(cv2, frames_of(cv2, source), tuple(board), every)
    try:
        return lens_of(cv2, views, size, board, model)
    except cv2.error as error:
        raise PicturesError(f'these {len(views)} views determine no {model} lens ({error.err}); '
                            'take others: near and far, tilted, in all corners') from None


def lens_of(cv2, views, size, board, model):
    """Raises cv2.error where the views do not determine it."""
    plane = np.zeros((board[0] * board[1], 3), np.float32)
    plane[:, :2] = np.mgrid[:board[0], :board[1]].T.reshape(-1, 2)
    if model == 'equidistant':
        objects, images = [plane[None].astype(float)] * len(views), [view[None].astype(float) for view in views]
        names = cv2.fisheye if hasattr(cv2.fisheye, 'CALIB_FIX_SKEW') else cv2  # OpenCV 5 moved them
        rms, K, coefficients, rotations, translations = cv2.fisheye.calibrate(
            objects, images, size, None, None, flags=names.CALIB_RECOMPUTE_EXTRINSIC | names.CALIB_FIX_SKEW)
        sigmas = np.full(4, np.nan)
        projected = [cv2.fisheye.projectPoints(plane[None].astype(float), r, t, K, coefficients)[0]
                     for r, t in zip(rotations, translations)]
    else:
        rms, K, coefficients, rotations, translations, deviations = cv2.calibrateCameraExtended(
            [plane] * len(views), [view[:, None] for view in views], size, None, None)[:6]
        sigmas = deviations.ravel()[:4]
        projected = [cv2.projectPoints(plane, r, t, K, coefficients)[0] for r, t in zip(rotations, translations)]
    numbers = np.concatenate([[K[0, 0], K[1, 1], K[0, 2], K[1, 2]], np.ravel(coefficients)])
    residuals = [view - points.reshape(-1, 2) for view, points in zip(views, projected)]
    return Calibrated(model, size, numbers, sigmas, rms, views, residuals)


def draw_residuals(calibrated, path):
    """Picture of all corners with their residuals, enlarged: they should point everywhere and cover the image."""
    cv2 = opencv('drawing')
    canvas = np.full((calibrated.size[1], calibrated.size[0], 3), 255, np.uint8)
    for corners, residuals in zip(calibrated.views, calibrated.residuals):
        for corner, residual in zip(corners, residuals):
            begin, end = (tuple(int(x) for x in np.rint(p)) for p in (corner, corner + ARROW * residual))
            cv2.line(canvas, begin, end, (200, 80, 0), 1, cv2.LINE_AA)
            cv2.circle(canvas, begin, 2, (0, 0, 0), -1, cv2.LINE_AA)
    if not cv2.imwrite(str(path), canvas):
        raise PicturesError(f'{path}: cannot be written')


def report(calibrated):
    """Some lines of text for a person."""
    names = ('fx', 'fy', 'cx', 'cy')
    parts = [f'{name} {value:.2f}' + (f' +-{sigma:.2f}' if np.isfinite(sigma) else '')
             for name, value, sigma in zip(names, calibrated.numbers, calibrated.sigmas)]
    coefficients = ' '.join(f'{x:.4f}' for x in calibrated.numbers[4:])
    width = np.degrees(2 * np.arctan(calibrated.size[0] / 2 / calibrated.numbers[0]))
    lines = [f'{len(calibrated.views)} views, {calibrated.rms:.3f} px rms',
             f'{calibrated.model}: {", ".join(parts)} px; coefficients {coefficients}']
    if calibrated.model == 'radtan':
        lines.append(f'{width:.0f} degrees from left to right, without the distortion')
    corners = np.concatenate(calibrated.views)
    covered = np.ptp(corners, axis=0) / calibrated.size
    if covered.min() < 0.7:
        lines.append(f'the board covered {100 * covered[0]:.0f} % of the width and {100 * covered[1]:.0f} % of the height '
                     'only: the distortion outside is a guess')
    return '\n'.join(lines)
