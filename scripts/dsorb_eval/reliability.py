# SPDX-License-Identifier: BSD-3-Clause
"""Predicted probability of a wrong start against the observed share, over every window that the gate can judge: a reference
every fifth frame, at each of its ages, forward and reversed (build/benchmark/start_windows). A window is wrong where its
direction of translation is more than WRONG_DEG off the truth."""
import argparse
import json
import shlex
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import matplotlib

matplotlib.use('Agg')
import matplotlib.pyplot as plt  # noqa: E402
import numpy as np  # noqa: E402
from scipy.stats import chi2  # noqa: E402

from .plots import save  # noqa: E402

ROOT = Path(__file__).resolve().parent.parent.parent
LIST = ROOT / 'docs' / 'lab' / 'results' / 'reliability.txt'
WRONG_DEG = 10
FRAMES = 60  # of a rendered sequence
MIN_WINDOWS = 20  # of a point in the figure
BINS = (0, 1e-4, 1e-3, 1e-2, 1e-1, 1)  # edges, of the predicted probability
MIN_CORNERS, MIN_TRACK_SHARE = 60, .5  # as the gate asks for
COLUMNS = ('reference', 'target', 'frames', 'tracks', 'corners', 'error', 'plane', 'sigma', 'second_sigma', 'misfit',
           'depth_sigma', 'parallax', 'off')
# Groups of sequences: name in the figure, colour.
GROUPS = {'chosen': ('rendered, half to choose on', '#1f4fd6'), 'check': ('rendered, never looked at while choosing', '#111111'),
          'global': ('recorded, or rendered along a recording', '#2ca02c'), 'rolling': ('rolling shutter, not modelled', '#d62728')}
ROLLING = ('7scenes', 'room_rolling')  # cameras that read their rows one after the other


@dataclass
class Sequence:
    name: str
    group: str
    folder: Path
    arguments: tuple = ()  # of dso_synthesize; none: the folder is there


def rendered(folder):
    """The listed sequences; those whose name ends with an odd digit are the check."""
    lines = [line.split(None, 1) for line in LIST.read_text(encoding='utf-8').splitlines() if not line.startswith('#')]
    return [Sequence(name, 'check' if int(name[-1]) % 2 else 'chosen', folder / name, tuple(shlex.split(arguments)))
            for name, arguments in lines]


def recorded(data):
    """Sequences of a folder with sequences.json; none where it is missing."""
    listed = json.loads((data / 'sequences.json').read_text(encoding='utf-8')) if data and data.is_dir() else {}
    return [Sequence(name, 'rolling' if name in ROLLING else 'global', data / entry['path']) for name, entry in listed.items()
            if not entry.get('no_start') and (data / entry['path'] / 'groundtruth.txt').is_file()]


def windows_of(sequence, build, out):
    """File of the windows of a sequence; made where it is not there yet. Raises subprocess.CalledProcessError."""
    file = out / f'{sequence.name}.txt'
    if file.exists():
        return file
    if sequence.arguments and not (sequence.folder / 'groundtruth.txt').exists():
        subprocess.run([build / 'bin' / 'dso_synthesize', *sequence.arguments, '--frames', str(FRAMES), '--output', sequence.folder,
                        '--quiet'], check=True)
    program = build / 'benchmark' / 'start_windows'
    text = ''.join(subprocess.run([program, sequence.folder, *way], check=True, capture_output=True, text=True).stdout
                   for way in ((), ('reverse',)))
    file.write_text(text, encoding='utf-8')
    return file


def read_windows(file):
    """Predicted probabilities and whether each window was wrong, of those with enough corners."""
    rows = np.loadtxt(file, ndmin=2)
    if rows.size == 0:
        return np.zeros(0), np.zeros(0, bool)
    of = {name: rows[:, i] for i, name in enumerate(COLUMNS)}
    judged = (of['corners'] >= MIN_CORNERS) & (of['corners'] >= MIN_TRACK_SHARE * of['tracks'])
    predicted = 1 - (1 - of['error']) * (1 - of['plane'])
    return predicted[judged], of['off'][judged] > WRONG_DEG


def counted(predicted, wrong):
    """(windows, wrong ones predicted, wrong ones observed) of each bin."""
    place = np.clip(np.digitize(predicted, BINS) - 1, 0, len(BINS) - 2)
    return [(int((place == i).sum()), float(predicted[place == i].sum()), int(wrong[place == i].sum())) for i in range(len(BINS) - 1)]


def interval(count):
    """95 % of the expected counts with which this one agrees (Garwood 1936)."""
    return chi2.ppf(.025, 2 * count) / 2 if count else 0, chi2.ppf(.975, 2 * count + 2) / 2


def short(value):
    """Two digits, without an exponent where there are thousands at most."""
    return f'{float(f"{value:.2g}"):g}'


def table(groups):
    lines = ['| predicted | ' + ' | '.join(GROUPS[group][0] for group in groups) + ' |', '|---' * (len(groups) + 1) + '|']
    rows = {group: counted(*windows) for group, windows in groups.items()}
    for i in range(len(BINS) - 1):
        cells = []
        for group in groups:
            windows, expected, seen = rows[group][i]
            low, high = interval(seen)
            cells.append(f'{windows}: {short(expected)}, {seen} ({short(low)} to {short(high)})' if windows else '–')
        lines.append(f'| {BINS[i]:g} to {BINS[i + 1]:g} | ' + ' | '.join(cells) + ' |')
    return '\n'.join(lines) + '\n'


def draw(groups, path):
    """Observed over predicted share in bins of a decade, with the band of a factor of two; triangles: upper limits where none was wrong."""
    figure, axis = plt.subplots(figsize=(6.4, 5.2))
    line = np.logspace(-6, 0)
    axis.fill_between(line, line / 2, line * 2, color='#dddddd', label='a factor of two')
    axis.plot(line, line, color='#999999', linewidth=1)
    for group, windows in groups.items():
        label, colour = GROUPS[group]
        axis.plot([], [], 'o-', color=colour, label=f'{label}: {len(windows[1])} windows')
        for count, expected, seen in counted(*windows):
            if count < MIN_WINDOWS:
                continue
            low, high = (limit / count for limit in interval(seen))
            x = expected / count
            if seen:
                axis.errorbar(x, seen / count, yerr=[[seen / count - low], [high - seen / count]], fmt='o', markersize=4, capsize=2, color=colour)
            else:
                axis.plot(x, high, 'v', color=colour)
    axis.set(xscale='log', yscale='log', xlim=(2e-6, 1.2), ylim=(2e-5, 1.2), xlabel='predicted probability of a wrong direction',
             ylabel=f'share of directions more than {WRONG_DEG} degrees off')
    axis.legend(fontsize=8, loc='lower right')
    axis.grid(alpha=.3)
    figure.tight_layout()
    save(figure, path)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('out', type=Path, help='folder of what is made; what is there already is used again')
    parser.add_argument('--build', type=Path, default=ROOT / 'build', help='with benchmarks (-DDSORB_BUILD_BENCHMARKS=ON)')
    parser.add_argument('--data', type=Path, default=ROOT.parent / 'shared' / 'data', help='folder with sequences.json')
    parser.add_argument('--jobs', type=int, default=1, metavar='N', help='sequences at a time')
    args = parser.parse_args()
    (args.out / 'windows').mkdir(parents=True, exist_ok=True)
    sequences = rendered(args.out / 'data') + recorded(args.data)
    with ThreadPoolExecutor(args.jobs) as pool:
        files = list(pool.map(lambda sequence: windows_of(sequence, args.build, args.out / 'windows'), sequences))
    groups = {}
    for group in GROUPS:
        parts = [read_windows(file) for sequence, file in zip(sequences, files) if sequence.group == group]
        if parts:
            groups[group] = tuple(map(np.concatenate, zip(*parts)))
    draw(groups, args.out / 'reliability.png')
    text = table(groups)
    (args.out / 'reliability.md').write_text(text, encoding='utf-8')
    sys.stdout.write(text)
    return 0
