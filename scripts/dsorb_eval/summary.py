# SPDX-License-Identifier: BSD-3-Clause
"""Rows of the tables: one per sequence and variant, one per data set and variant, one total per variant.

The same runs give the same bytes: order and rounding are fixed, and no table holds a date."""
import csv
import io
import math
from dataclasses import dataclass

import numpy as np

WRONG_DEG = 20.  # an initial direction further off is a wrong start
HIT_DEG = 10.  # one nearer is a hit
TOTAL = 'TOTAL'

# column -> what it says; the order of the tables
COLUMNS = dict(
    runs='runs planned and done',
    init='runs initialized',
    init_rate='share of the runs that initialized',
    crash='runs that ended with another exit code than 0 or 3, or left unreadable files',
    nan='runs that wrote nan or inf',
    good='runs initialized, one segment, over 95 % of the later frames tracked, ATE below 5 % of the way',
    given='frames fed until initialized, median',
    given_mean='the same, mean (as [Gladkova] gives it)',
    given90='the same, 90th percentile',
    since_ref='positions between reference and target, median',
    dir='error of the initial translation direction [deg], median',
    dir95='the same, 95th percentile',
    wrong20='share of the initialized whose direction is off by more than 20 degrees',
    hit10='share of all runs that initialized within 10 degrees',
    rot='rotation error of the initial pose [deg], median',
    init_rpe='error of the initial pose (equation 16, without the square) over the way, median',
    depth='median relative depth error of the initial points after the best single scale',
    depth10='share of the initial points within 10 % of the true depth',
    nees='error^2 / variance of the initial inverse depths, median (0.45 is ideal)',
    nees_rot='the same of the rotation components of the initial pose',
    nees_dir='the same of its direction components',
    nees_final_rot='nees_rot against the final poses of the run in place of the truth',
    nees_final_dir='nees_dir against the same',
    nees_tracked_rot='the same of the rotations of tracked frames relative to their keyframes, a degree of freedom, median over the frames (0.79 is ideal)',
    nees_tracked_trans='the same of their translations',
    points='initial points in the reference, median',
    ms_init='milliseconds of all frames until initialized, median',
    ms_last='milliseconds of the frame that succeeded, median',
    ate='ATE of all frames (equation 18) over the way, median',
    ate_kf='the same of the keyframes',
    rpe='RPE of all frames (equation 19, step 1) over the way, median',
    rpe_kf='the same of the keyframes',
    tracked='frames tracked after the initialization, median',
    tracked_after='their share of the frames after the initialization, median',
    lost='share of the initialized runs that were lost at least once',
    ms_track='milliseconds of a tracked frame, mean of a run, median over the runs',
    mb='peak memory [MB], median')


@dataclass
class Run:
    """A run of the plan with its record and figures; both None where it was not run yet."""
    entry: dict
    record: dict = None
    figures: dict = None

    @property
    def start(self):
        """Figures of the first initialization, None without one."""
        starts = (self.figures or {}).get('starts')
        return starts[0] if starts else None

    @property
    def failed(self):
        return bool(self.figures and self.figures['crashed'])


def value_of(run, *keys):
    """A figure by its path of keys; None where any of them is missing."""
    value = run
    for key in keys:
        value = value.get(key) if isinstance(value, dict) else None
    return value


def finite(values):
    return [v for v in values if isinstance(v, (int, float)) and math.isfinite(v)]


def percentile(values, q=50):
    values = finite(values)
    return float(np.percentile(values, q)) if values else None


def share(count, total):
    return count / total if total else None


def initial_columns(runs, starts):
    """Columns about the initial pose and map."""
    directions = finite(start.get('dir_deg') for start in starts)
    given = finite(start['frames_given'] for start in starts)
    row = dict(given=percentile(given), given_mean=float(np.mean(given)) if given else None, given90=percentile(given, 90),
               dir=percentile(directions), dir95=percentile(directions, 95),
               wrong20=share(sum(d > WRONG_DEG for d in directions), len(directions)),
               hit10=share(sum(d <= HIT_DEG for d in directions), len(runs)) if any(r.figures.get('truth') for r in runs) else None)
    paths = dict(since_ref=('since_ref',), rot=('rot_deg',), init_rpe=('error_over_path',), depth=('depth', 'median'),
                 depth10=('depth', 'within10'), nees=('nees',), points=('points',), ms_init=('ms_total',), ms_last=('ms_last',))
    row.update({column: percentile(value_of(start, *keys) for start in starts) for column, keys in paths.items()})
    for column in ('nees_rot', 'nees_dir', 'nees_final_rot', 'nees_final_dir'):
        row[column] = percentile(x for start in starts for x in start.get(column) or [])
    return row


def summarize(runs):
    """One row of a table. @param runs those that were done"""
    runs = [run for run in runs if run.figures]
    started = [run for run in runs if run.start]
    row = dict(runs=len(runs), init=len(started), init_rate=share(len(started), len(runs)), crash=sum(run.failed for run in runs),
               nan=sum(bool(run.figures['nonfinite']) for run in runs), good=sum(run.figures['good'] for run in runs),
               lost=share(sum(bool(run.figures.get('lost')) for run in started), len(started)))
    row.update(initial_columns(runs, [run.start for run in started]))
    paths = dict(ate=('frames', 'ate_over_path'), ate_kf=('keyframes', 'ate_over_path'), rpe=('frames', 'rpe_over_path'),
                 rpe_kf=('keyframes', 'rpe_over_path'), tracked=('tracked',), tracked_after=('tracked_after',))
    row.update({column: percentile(value_of(run.figures, *keys) for run in started) for column, keys in paths.items()})
    single = ('ms_track', 'mb', 'nees_tracked_rot', 'nees_tracked_trans')
    row.update({column: percentile(value_of(run.figures, column) for run in runs) for column in single})
    return {column: row[column] for column in COLUMNS}


def table(plan, runs):
    """Rows (sequence, variant, figures), then a total per variant over the sequences where a start can be expected."""
    rows = []
    expected = {s['name'] for s in plan['sequences'] if not s['no_start']}
    for name in [s['name'] for s in plan['sequences']]:
        for variant in plan['variants']:
            rows.append((name, variant, summarize(r for r in runs if (r.entry['sequence'], r.entry['variant']) == (name, variant))))
    for variant in plan['variants']:
        rows.append((TOTAL, variant, summarize(r for r in runs if r.entry['variant'] == variant and r.entry['sequence'] in expected)))
    return rows


def datasets(plan):
    """Data sets in their order, each with the names of its sequences."""
    groups = {}
    for sequence in plan['sequences']:
        groups.setdefault(sequence['dataset'], []).append(sequence['name'])
    return groups


def dataset_tables(plan, runs):
    """Per data set its own table(): [Gladkova] sums up KITTI, EuRoC and CARLA separately."""
    tables = {}
    for dataset, names in datasets(plan).items():
        part = dict(plan, sequences=[s for s in plan['sequences'] if s['name'] in names])
        tables[dataset] = table(part, [run for run in runs if run.entry['sequence'] in names])
    return tables


def text_of(value):
    """A figure for people: four significant digits, a dash where there is none."""
    if value is None:
        return '–'
    return str(value) if isinstance(value, int) else f'{value:.4g}'


def to_markdown(rows):
    columns = ['sequence', 'variant', *COLUMNS]
    lines = ['| ' + ' | '.join(columns) + ' |', '|---|---' + '|--:' * len(COLUMNS) + '|']
    lines += ['| ' + ' | '.join([name, variant, *(text_of(row[c]) for c in COLUMNS)]) + ' |' for name, variant, row in rows]
    return '\n'.join(lines) + '\n'


def to_csv(rows):
    """The same as CSV: six significant digits, an empty field where there is no value."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator='\n')
    writer.writerow(['sequence', 'variant', *COLUMNS])
    for name, variant, row in rows:
        writer.writerow([name, variant, *('' if row[c] is None else row[c] if isinstance(row[c], int) else f'{row[c]:.6g}'
                                          for c in COLUMNS)])
    return stream.getvalue()


def legend():
    """What the columns say, as a Markdown list."""
    return ''.join(f'- `{column}`: {meaning}\n' for column, meaning in COLUMNS.items())


def evo_agreement(runs):
    """How far evo's ATE and RPE are from ours: runs compared, largest relative differences, refusals."""
    compared, refused, worst = 0, 0, dict(ate=0., rpe=0.)
    for run in runs:
        for key in ('frames', 'keyframes'):
            figures = value_of(run.figures, key) or {}
            other = figures.get('evo')
            if other is None:
                continue
            if 'error' in other:
                refused += 1
                continue
            compared += 1
            for name in worst:
                if figures[name]:
                    worst[name] = max(worst[name], abs(other[name] - figures[name]) / figures[name])
    return dict(compared=compared, refused=refused, **worst)
