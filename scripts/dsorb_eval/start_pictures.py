# SPDX-License-Identifier: BSD-3-Clause
"""Residuals and epipolar segments of one initialization per variant ([Gladkova], figures 5 and 3).

From what a run wrote (the initializer's poses and inverse depths) and the images that it read, rectified by the module `dsorb`:
that of the build that the program is from, or the installed one."""
import csv
import math
from pathlib import Path

import matplotlib

matplotlib.use('Agg')
import matplotlib.pyplot as plt  # noqa: E402
import numpy as np  # noqa: E402
from PIL import Image  # noqa: E402

from . import package, pictures, plots  # noqa: E402
from .judge import read_json  # noqa: E402

SEGMENTS = 24  # points drawn with their epipolar segment; more are a thicket
REACH = 2.  # the segment spans inverse depths from 1 / REACH to REACH times the estimate
FIT_ROUNDS = 3  # of the brightness fit, each without what lies beyond ...
FIT_CUT = 3.  # ... so many standard deviations, from the median absolute deviation
MAD_TO_SIGMA = 1.4826


def rectifier_for(dsorb, run, camera):
    """What made images of this camera of those that the run read; None where no way of rectifying does."""
    lens = {key: run['lens'][key] for key in ('fx', 'fy', 'cx', 'cy', 'width', 'height', 'model', 'coefficients')}
    for mode in ('crop', 'full', 'none'):
        rectifier = dsorb.Rectifier(dsorb.Calibration(**lens, rectification=mode))
        if all(math.isclose(getattr(rectifier.camera, key), value, rel_tol=1e-9) for key, value in camera.items()):
            return rectifier
    return None


def load_start(dsorb, out):
    """The first initialization and its rectified images by position; None where there is none, or its images are gone."""
    starts = (read_json(out / 'initialization.json') or {}).get('initializations') or []
    rectifier = rectifier_for(dsorb, read_json(out / 'run.json'), starts[0]['camera']) if starts else None
    if rectifier is None:
        return None
    with open(out / 'frames.csv', newline='') as file:
        files = {int(row['index']): row['image'] for row in csv.DictReader(file)}
    images = {}
    try:
        for index in (pose['index'] for pose in starts[0]['poses'] if pose['T_cam_ref'] is not None):
            with Image.open(files[index]) as image:
                images[index] = rectifier.rectify(np.asarray(image), rgb=True).astype(float)
    except OSError:
        return None
    return starts[0], images


def project(pixels, inverse_depths, T_cam_ref, camera):
    """Pixels of the reference with inverse depths, seen by another camera. @return n x 2, NaN behind it"""
    fx, fy, cx, cy = (camera[key] for key in ('fx', 'fy', 'cx', 'cy'))
    rays = np.stack([(pixels[:, 0] - cx) / fx, (pixels[:, 1] - cy) / fy, np.ones(len(pixels))], axis=1)
    points = rays @ T_cam_ref[:3, :3].T + inverse_depths[:, None] * T_cam_ref[:3, 3]
    with np.errstate(all='ignore'):
        seen = points[:, :2] / points[:, 2:] * [fx, fy] + [cx, cy]
    seen[points[:, 2] <= 0] = np.nan
    return seen


def sample(image, pixels):
    """Bilinear grey values, NaN outside."""
    height, width = image.shape
    inside = np.isfinite(pixels).all(1) & (pixels >= 0).all(1) & (pixels[:, 0] < width - 1) & (pixels[:, 1] < height - 1)
    values = np.full(len(pixels), np.nan)
    x, y = pixels[inside].T
    column, row = x.astype(int), y.astype(int)
    a, b = x - column, y - row
    values[inside] = ((1 - b) * ((1 - a) * image[row, column] + a * image[row, column + 1])
                      + b * ((1 - a) * image[row + 1, column] + a * image[row + 1, column + 1]))
    return values


def brightness_residuals(reference, target):
    """Target minus the reference's values brought to the target by the best gain and offset (equation 10, with brightness)."""
    keep = np.ones(len(reference), bool)
    residuals = target - reference
    for _ in range(FIT_ROUNDS):
        if keep.sum() < 3 or np.ptp(reference[keep]) == 0:
            break
        gain, offset = np.polyfit(reference[keep], target[keep], 1)
        residuals = target - (gain * reference + offset)
        spread = MAD_TO_SIGMA * float(np.median(np.abs(residuals[keep])))
        keep = np.abs(residuals) <= FIT_CUT * max(spread, 1e-6)
    return residuals


def residuals_of(start, images):
    """Photometric residuals of all initial points in all posed frames but the reference [grey levels]."""
    points = np.array(start['points'], float).reshape(-1, 4)
    reference = sample(images[start['reference']['index']], points[:, :2])
    found = []
    for pose in start['poses']:
        if pose['T_cam_ref'] is None or pose['index'] == start['reference']['index']:
            continue
        seen = project(points[:, :2], points[:, 2], np.array(pose['T_cam_ref'], float), start['camera'])
        target = sample(images[pose['index']], seen)
        known = np.isfinite(reference) & np.isfinite(target)
        found.append(brightness_residuals(reference[known], target[known]))
    return np.concatenate(found) if found else np.zeros(0)


def spread_points(points, image_width, count):
    """Up to `count` certain points, one a strip of the image from left to right."""
    strips = np.clip((points[:, 0] / image_width * count).astype(int), 0, count - 1)
    certainty = np.sqrt(points[:, 3]) / points[:, 2]
    best = [min(np.flatnonzero(strips == s), key=lambda i: certainty[i]) for s in range(count) if (strips == s).any()]
    return points[best]


def epipolar_figure(start, images, title, path):
    """Reference and target side by side: points, the epipolar segments they are searched on, and where they were found."""
    poses = {pose['index']: pose['T_cam_ref'] for pose in start['poses']}
    reference, target = start['reference']['index'], start['target']['index']
    points = np.array(start['points'], float).reshape(-1, 4)
    points = points[points[:, 2] > 0]
    if not len(points) or poses.get(target) is None:
        return False
    points = spread_points(points, start['camera']['width'], SEGMENTS)
    T_cam_ref = np.array(poses[target], float)
    ends = [project(points[:, :2], points[:, 2] * factor, T_cam_ref, start['camera']) for factor in (1 / REACH, 1, REACH)]
    figure, axes = plt.subplots(1, 2, figsize=(13, 5.2), layout='constrained')
    colours = plt.get_cmap('turbo')(np.linspace(.05, .95, len(points)))
    for axis, index, name in zip(axes, (reference, target), ('reference', 'target')):
        axis.imshow(images[index], cmap='gray', vmin=0, vmax=255)
        axis.set(xlim=(0, images[index].shape[1] - 1), ylim=(images[index].shape[0] - 1, 0))
        axis.set_title(f'{name}, frame {index}', fontsize=9)
        axis.axis('off')
    axes[0].scatter(*points[:, :2].T, s=28, facecolors='none', edgecolors=colours, linewidths=1.5)
    for far, found, near, colour in zip(*ends, colours):
        axes[1].plot([far[0], near[0]], [far[1], near[1]], color=colour, linewidth=1.4)
        axes[1].plot(*found, 'o', color=colour, markersize=5, markerfacecolor='none')
    figure.suptitle(f'{title}: epipolar segments from {1 / REACH:g} to {REACH:g} times the inverse depth found (circle)')
    plots.save(figure, path)
    return True


def choose(evaluation):
    """One run per variant: its own of the start that most variants share, in the first sequence that has one."""
    chosen = {}
    for sequence, (_, by_variant) in pictures.same_start(evaluation.plan, evaluation.runs).items():
        for variant, run in by_variant.items():
            chosen.setdefault(variant, (sequence, run))
    return chosen


def figures(evaluation):
    """@return histograms and epipolar pictures, each a list of (title, path, note); empty without the module"""
    dsorb = package.load(Path(evaluation.plan['program']).parent.parent)
    if dsorb is None:
        return [], []
    histograms, searches, folder = [], [], evaluation.folder / 'figures'
    for variant, (sequence, run) in sorted(choose(evaluation).items(), key=lambda item: evaluation.plan['variants'].index(item[0])):
        loaded = load_start(dsorb, evaluation.folder / 'runs' / run.entry['key'] / 'out')
        if not loaded:
            continue
        residuals = residuals_of(*loaded)
        path = folder / f'residuals_{variant}.png'
        fit = pictures.residual_histogram(residuals, f'{variant}, {sequence}: initial points', path)
        if fit and math.isfinite(fit['t']):
            histograms.append((f'Residuals of {variant}', path, 'figure 5'))
        path = folder / f'epipolar_search_{variant}.png'
        if epipolar_figure(*loaded, f'{variant}, {sequence}', path):
            searches.append((f'Epipolar search, {variant}', path, 'figure 3'))
    return histograms, searches
