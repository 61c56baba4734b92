# SPDX-License-Identifier: BSD-3-Clause
"""Figures in the style of [Gladkova]: cumulative plots per metric, one line per variant in its colours."""
import matplotlib

matplotlib.use('Agg')
import matplotlib.pyplot as plt  # noqa: E402
import numpy as np  # noqa: E402
from matplotlib.ticker import MaxNLocator  # noqa: E402

from .summary import finite, value_of  # noqa: E402

# [Gladkova]: CoarseInitializer red, v1 yellow, v2 blue, v3 green, the matching variant magenta. Its final ORBInitializer is
# v3; ours has parts of its own and is black.
COLOURS = {'coarse': '#d62728', 'orb-v1': '#e0b000', 'orb-v2': '#1f4fd6', 'orb-v3': '#2ca02c', 'orb-matching': '#d428c8',
           'orb': '#111111'}
OTHER_COLOURS = ('#17becf', '#8c564b', '#ff7f0e', '#7f7f7f')
RESOLUTION = 110  # [dots per inch]
CAP_PERCENTILE = 97  # the axis ends there: one wild run must not press all others against the left edge

# file name -> (title, axis, figures of [Gladkova], where the value of a run lies)
METRICS = {
    'initial_pose': ('Initial keyframe pose', 'relative pose error [1/m]', '7, 8, 11, 16', ('start', 'error_over_path')),
    'initial_depth': ('Initial 3d map', 'median relative depth error', '7, 8', ('start', 'depth', 'median')),
    'ate_frames': ('ATE, all frames', 'ATE over the way [1/m]', '9, 10, 12, 13, 19, 20', ('figures', 'frames', 'ate_over_path')),
    'ate_keyframes': ('ATE, keyframes', 'ATE over the way [1/m]', '15, 17, 18', ('figures', 'keyframes', 'ate_over_path')),
    'rpe_frames': ('RPE, all frames', 'RPE over the way [1/m]', '9, 10, 12, 13, 19, 20', ('figures', 'frames', 'rpe_over_path')),
    'rpe_keyframes': ('RPE, keyframes', 'RPE over the way [1/m]', '17, 18', ('figures', 'keyframes', 'rpe_over_path')),
    'direction': ('Direction of the initial translation', 'error [deg]', '', ('start', 'dir_deg')),
    'rotation': ('Rotation of the initial pose', 'error [deg]', '', ('start', 'rot_deg')),
    'frames_given': ('Frames needed to initialise', 'frames', '', ('start', 'frames_given')),
    'milliseconds': ('Time needed to initialise', 'milliseconds', '', ('start', 'ms_total')),
}


def colour(variant, variants):
    """Colour of a line; names that [Gladkova] does not have get one by their position."""
    others = [v for v in variants if v not in COLOURS]
    return COLOURS.get(variant) or OTHER_COLOURS[others.index(variant) % len(OTHER_COLOURS)]


def values(runs, path):
    """The finite values of a metric over runs."""
    return finite(value_of(dict(start=run.start, figures=run.figures), *path) for run in runs)


def cumulative(found):
    """Steps of a cumulative plot: n-th smallest error against n runs, from (first, 0) on."""
    x = np.sort(np.asarray(found, float))
    return np.concatenate([x[:1] if len(x) else [0.], x]), np.arange(len(x) + 1)


def axis_end(found):
    """Right end of the axis over the values of all variants."""
    everything = np.concatenate([np.asarray(v, float) for v in found.values() if len(v)])
    end = float(np.percentile(everything, CAP_PERCENTILE)) if len(everything) > 10 else float(everything.max())
    return end * 1.05 or 1.


def save(figure, path):
    """Writes a figure without date or version: the same runs give the same bytes."""
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=RESOLUTION, metadata={'Software': None})
    plt.close(figure)


def draw_cumulative(axes, metric, runs, variants):
    """One cumulative plot; False where no run has the metric. Runs without a value never count: lines end lower."""
    title, label, _, path = METRICS[metric]
    found = {v: values([r for r in runs if r.entry['variant'] == v], path) for v in variants}
    if not any(found.values()):
        return False
    end = axis_end(found)
    for position, variant in enumerate(variants):
        total = sum(r.entry['variant'] == variant for r in runs)
        x, y = cumulative(found[variant])
        x, y = np.append(x, max(end, x[-1])), np.append(y, y[-1])
        axes.step(x, y, where='post', color=colour(variant, variants),
                  linewidth=1.4 + .5 * (len(variants) - 1 - position),  # lines below others stay visible
                  label=f'{variant} ({len(found[variant])} of {total})')
    axes.set(title=title, xlabel=label, ylabel='number of runs', xlim=(0, end),
             ylim=(0, 1.04 * max(sum(r.entry['variant'] == v for r in runs) for v in variants)))
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))
    axes.grid(alpha=.3)
    axes.legend(fontsize=8, loc='lower right')
    return True


def cumulative_figure(metrics, runs, variants, path, heading):
    """Cumulative plots side by side in one file; False (and no file) where none of them has a value."""
    figure, axes = plt.subplots(1, len(metrics), figsize=(5.2 * len(metrics), 3.8), squeeze=False, layout='constrained')
    drawn = [draw_cumulative(a, metric, runs, variants) for a, metric in zip(axes[0], metrics)]
    for a, done in zip(axes[0], drawn):
        if not done:
            a.axis('off')
            a.text(.5, .5, 'no run has it', ha='center', color='#777777')
    figure.suptitle(heading)
    if not any(drawn):
        plt.close(figure)
        return False
    save(figure, path)
    return True


# Pairs of plots in [Gladkova]: file name, metrics, what it is compared with
PAIRS = (('initial', ('initial_pose', 'initial_depth'), 'figures 7, 8, 11, 16'),
         ('trajectory', ('ate_frames', 'rpe_frames'), 'figures 9, 10, 12, 13, 19, 20'),
         ('trajectory_keyframes', ('ate_keyframes', 'rpe_keyframes'), 'figures 15, 17, 18'),
         ('initial_angles', ('direction', 'rotation'), ''),
         ('effort', ('frames_given', 'milliseconds'), ''))


def all_figures(plan, runs, groups, folder):
    """All cumulative plots: over everything, then per data set.

    @param groups  data set -> names of its sequences
    @return list of (group, title, path, note)"""
    figures = []
    expected = {s['name'] for s in plan['sequences'] if not s['no_start']}
    everything = {'all': [name for name in expected]}
    for group, names in {**(everything if len(groups) > 1 else {}), **groups}.items():
        chosen = [run for run in runs if run.figures and run.entry['sequence'] in names]
        for name, metrics, note in PAIRS:
            path = folder / f'{group}_{name}.png'
            heading = f"{'All sequences' if group == 'all' else group}: {len(chosen)} runs"
            if chosen and cumulative_figure(metrics, chosen, plan['variants'], path, heading):
                figures.append((group, ' and '.join(METRICS[m][0] for m in metrics), path, note))
            else:
                path.unlink(missing_ok=True)
    return figures
