# SPDX-License-Identifier: BSD-3-Clause
"""Pictures of runs: initial inverse depth side by side ([Gladkova], figure 1), residual histograms (figure 5)."""
import csv
import math
from collections import defaultdict

import matplotlib

matplotlib.use('Agg')
import matplotlib.pyplot as plt  # noqa: E402
import numpy as np  # noqa: E402
from PIL import Image  # noqa: E402

from . import plots  # noqa: E402

OVERLAY = 'out/figures/initial_inverse_depth.png'
T_DEGREES = 5.  # of freedom, as in [Gladkova], section 3.4
FIT_ROUNDS = 100
FIT_TOLERANCE = 1e-9
HISTOGRAM_RANGE = 6.  # in scales of the t-distribution, to both sides
BINS = 80


def same_start(plan, runs):
    """Per sequence the first start (start, direction) that most variants initialized from, with run per variant."""
    found = defaultdict(lambda: defaultdict(dict))
    for run in runs:
        if run.start:
            span = (run.entry['start'], run.entry['end'], run.entry['reverse'])
            found[run.entry['sequence']][span][run.entry['variant']] = run
    best = {}
    for sequence in (s['name'] for s in plan['sequences']):
        if found[sequence]:
            best[sequence] = max(found[sequence].items(), key=lambda item: len(item[1]))  # max keeps the first of equals
    return best


def side_by_side(sequence, span, by_variant, variants, folder_of, path):
    """The overlays of all variants for one start as one image; False where no run left one."""
    images = {v: folder_of(by_variant[v]) / OVERLAY for v in variants if v in by_variant}
    images = {variant: file for variant, file in images.items() if file.exists()}
    if not images:
        return False
    columns = min(3, len(images))
    rows = math.ceil(len(images) / columns)
    figure, axes = plt.subplots(rows, columns, figsize=(5 * columns, 4 * rows), squeeze=False, layout='constrained')
    for axis in axes.flat:
        axis.axis('off')
    for axis, (variant, file) in zip(axes.flat, images.items()):
        start = by_variant[variant].start
        with Image.open(file) as image:
            axis.imshow(np.asarray(image))
        direction = '–' if start.get('dir_deg') is None else f"{start['dir_deg']:.1f} deg off"
        axis.set_title(f"{variant}: {start['frames_given']} frames, {start['points']} points, {direction}", fontsize=9)
    figure.suptitle(f"{sequence}, frames {span[0]} to {span[1] - 1}{', reversed' if span[2] else ''}: initial inverse depth")
    plots.save(figure, path)
    return True


def tracking_residuals(runs, folder_of):
    """The rmse of each tracked frame [grey levels]."""
    found = []
    for run in runs:
        path = folder_of(run) / 'out/frames.csv'
        if path.exists():
            with open(path, newline='') as file:
                found += [float(row['tracking_rmse']) for row in csv.DictReader(file)
                          if row['state'] == 'tracked' and row.get('tracking_rmse')]
    return np.array(found)


def t_scale(residuals, degrees=T_DEGREES):
    """Scale of a zero-mean t-distribution, by the fixed point of its maximum likelihood:
    sigma^2 = 1/n sum r^2 (v + 1) / (v + r^2 / sigma^2) ([Gladkova], equation 14, from [Kerl 2012])."""
    squares = np.square(np.asarray(residuals, float))
    variance = float(np.median(squares)) or float(squares.mean())
    if not variance:
        return 0.
    for _ in range(FIT_ROUNDS):
        last, variance = variance, float(np.mean(squares * (degrees + 1) / (degrees + squares / variance)))
        if abs(variance - last) <= FIT_TOLERANCE * variance:
            break
    return math.sqrt(variance)


def t_density(x, scale, degrees=T_DEGREES):
    constant = math.exp(math.lgamma((degrees + 1) / 2) - math.lgamma(degrees / 2)) / (math.sqrt(degrees * math.pi) * scale)
    return constant * (1 + (x / scale) ** 2 / degrees) ** (-(degrees + 1) / 2)


def gaussian_density(x, scale):
    return np.exp(-.5 * (x / scale) ** 2) / (math.sqrt(2 * math.pi) * scale)


def residual_histogram(residuals, title, path):
    """Histogram of residuals with the zero-mean Gaussian and t-distribution of greatest likelihood (figure 5).

    @return dict(gaussian, t) with the two scales, None (and no file) where there is nothing to fit"""
    if len(residuals) < 20 or not np.any(residuals):
        return None
    gaussian, scale = float(np.sqrt(np.mean(np.square(residuals)))), t_scale(residuals)
    reach = HISTOGRAM_RANGE * scale
    x = np.linspace(-reach, reach, 400)
    figure, axis = plt.subplots(figsize=(6, 4), layout='constrained')
    inside = residuals[np.abs(residuals) <= reach]
    counts, edges = np.histogram(inside, bins=BINS, range=(-reach, reach))
    axis.stairs(counts / (len(residuals) * np.diff(edges)), edges, fill=True, color='#b8c4d6', label=f'{len(residuals)} residuals')
    axis.plot(x, gaussian_density(x, gaussian), color='#d62728', label=f'Gaussian, sigma {gaussian:.2f}')
    axis.plot(x, t_density(x, scale), color='#1f4fd6', label=f't-distribution ({T_DEGREES:g}), scale {scale:.2f}')
    axis.set(title=title, xlabel='photometric residual [grey levels]', ylabel='density', xlim=(-reach, reach))
    axis.legend(fontsize=8)
    plots.save(figure, path)
    return dict(gaussian=gaussian, t=scale)


def tracking_histogram(values, title, path):
    """Histogram of the tracked frames' rmse."""
    if not len(values):
        return False
    figure, axis = plt.subplots(figsize=(6, 4), layout='constrained')
    axis.hist(values, bins=40, range=(0, float(np.percentile(values, 99)) or 1.), color='#b8c4d6')
    axis.set(title=title, xlabel='rmse of a tracked frame [grey levels]', ylabel='frames')
    plots.save(figure, path)
    return True


def tracking_figures(plan, runs, folder_of, folder):
    """The rmse of tracked frames, a figure per variant; (title, path, note) each."""
    figures = []
    for variant in plan['variants']:
        mine = [run for run in runs if run.figures and run.entry['variant'] == variant]
        path = folder / f'tracking_rmse_{variant}.png'
        if tracking_histogram(tracking_residuals(mine, folder_of), f'{variant}: tracked frames', path):
            figures.append((f'Tracked frames of {variant}', path, ''))
    return figures


def overlay_figures(plan, runs, folder_of, folder):
    """Overlays side by side, one picture a sequence (figure 1)."""
    figures = []
    for sequence, (span, by_variant) in same_start(plan, runs).items():
        path = folder / f'overlay_{sequence}.png'
        if side_by_side(sequence, span, by_variant, plan['variants'], folder_of, path):
            figures.append((f'Initial inverse depth: {sequence}', path, 'figure 1'))
    return figures
