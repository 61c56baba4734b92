# SPDX-License-Identifier: BSD-3-Clause
"""Squared error over predicted variance of everything that the factors of src/estimate/variance_factors.h enter, and by
what each factor is to be multiplied so that the median becomes that of a chi-squared distribution.

The value of a sequence is the median over its starts; the table has the median over sequences and their quartiles, so that
one long sequence does not decide. A factor is wrong where the right value is outside of the quartiles."""
import argparse
import sys
from collections import defaultdict
from pathlib import Path

import numpy as np

from .ablations import run_all
from .trajectory import FormatError

RIGHT = .4549  # median of chi-squared, one degree of freedom
RIGHT_OF_MEDIANS = .79  # of the mean of three of them, median over the frames
# statistic -> (right value, factor that it fits, power of the factor in a variance)
STATISTICS = {
    'nees_rot': (RIGHT, 'kStartTail', 1),
    'nees_dir': (RIGHT, 'kStartDirection', 2),
    'nees_final_rot': (RIGHT, 'kWindow', 2),
    'nees_tracked_rot': (RIGHT_OF_MEDIANS, 'kMapShare', 1),
    'nees_tracked_trans': (RIGHT_OF_MEDIANS, 'kTrackedScale', 2),
}


def values_of(run, name):
    """All values of a statistic in a run; it stands with the start or with the whole run."""
    value = (run.start or {}).get(name)
    if value is None:
        value = (run.figures or {}).get(name)
    return [x for x in np.atleast_1d(value).tolist() if np.isfinite(x)] if value is not None else []


def rows_of(runs):
    """One row a statistic: name, median over the sequences, quartiles, right value, factor, what it is to be multiplied by."""
    for name, (right, factor, power) in STATISTICS.items():
        by_sequence = defaultdict(list)
        for run in runs:
            by_sequence[run.entry['sequence']] += values_of(run, name)
        medians = [np.median(values) for values in by_sequence.values() if values]
        if not medians:
            continue
        low, middle, high = np.percentile(medians, [25, 50, 75])
        yield name, len(medians), middle, low, high, right, factor, (middle / right) ** (1 / power)


def parse_arguments(arguments):
    parser = argparse.ArgumentParser(prog='variance_factors.py', description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--bin', required=True, metavar='PATH', help='the dso_dataset program')
    parser.add_argument('--sequences', required=True, metavar='FILE.yaml', help='as for evaluate.py, with truth')
    parser.add_argument('--variant', default='orb')
    parser.add_argument('--starts', default='every:20', help='as for evaluate.py; default every:20')
    parser.add_argument('--frames', type=int, default=40, metavar='N', help='frames given to a run at most; default 40')
    parser.add_argument('--jobs', type=int, default=2, metavar='N', help='runs side by side; default 2')
    parser.add_argument('--output', required=True, metavar='DIR', help='runs, kept from one call to the next')
    return parser.parse_args(arguments)


def main(arguments=None):
    args = parse_arguments(arguments)
    try:
        runs, _ = run_all(args, '', Path(args.output).resolve())
    except FormatError as error:
        print(f'variance_factors.py: {error}', file=sys.stderr)
        return 2
    print('| statistic | sequences | median | quartiles | right | factor | to be multiplied by |\n|---|--:|--:|--:|--:|---|--:|')
    for name, count, middle, low, high, right, factor, change in rows_of(runs):
        print(f'| {name} | {count} | {middle:.2f} | {low:.2f} to {high:.2f} | {right:.2f} | {factor} | {change:.2f} |')
    return 0
