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

from .plots import save  # noqa: E402

ROOT = Path(__file__).resolve().parent.parent.parent
LIST = ROOT / 'docs' / 'results' / 'reliability.txt'
WRONG_DEG = 10
FRAMES = 60  # of a rendered sequence
BINS = (0, 1e-4, 1e-3, 1e-2, 1e-1, 1)  # edges, of the predicted probability
MIN_CORNERS, MIN_TRACK_SHARE = 60, .5  # as the gate asks for
COLUMNS = ('reference', 'target', 'frames', 'tracks', 'corners', 'error', 'rival', 'plane', 'sigma', 'second_sigma', 'misfit',
           'depth_sigma', 'parallax', 'off')
# Groups of sequences: name in the figure, colour.
GROUPS = {'chosen': ('rendered, half to choose on', '#1f4fd6'), 'check': ('rendered, never looked at while choosing', '#111111'),
          'real': ('recorded, and rendered along a recording', '#d62728')}


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
    return [Sequence(name, 'real', data / entry['path']) for name, entry in listed.items()
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
    predicted = 1 - (1 - of['error']) * (1 - of['rival']) * (1 - of['plane'])
    return predicted[judged], of['off'][judged] > WRONG_DEG


def binned(predicted, wrong):
    """(windows, mean predicted, observed share) of each bin."""
    place = np.clip(np.digitize(predicted, BINS) - 1, 0, len(BINS) - 2)
    rows = []
    for i in range(len(BINS) - 1):
        inside = place == i
        rows.append((int(inside.sum()), float(predicted[inside].mean()) if inside.any() else None,
                     float(wrong[inside].mean()) if inside.any() else None))
    return rows


def number(value):
    return '–' if value is None else f'{value:.2g}'


def table(groups):
    lines = ['| predicted | ' + ' | '.join(GROUPS[group][0] for group in groups) + ' |', '|---' * (len(groups) + 1) + '|']
    rows = {group: binned(*windows) for group, windows in groups.items()}
    for i in range(len(BINS) - 1):
        cells = [f'{count}: {number(mean)}, {number(share)}' for count, mean, share in (rows[group][i] for group in groups)]
        lines.append(f'| {BINS[i]:g} to {BINS[i + 1]:g} | ' + ' | '.join(cells) + ' |')
    return '\n'.join(lines) + '\n'


def draw(groups, path):
    """Observed over predicted share in bins of half a decade, with the band of a factor of two."""
    edges = np.r_[0, np.logspace(-4, 0, 9)]
    figure, axis = plt.subplots(figsize=(6.4, 5.2))
    line = np.logspace(-5, 0)
    axis.fill_between(line, line / 2, line * 2, color='#dddddd', label='a factor of two')
    axis.plot(line, line, color='#999999', linewidth=1)
    for group, (predicted, wrong) in groups.items():
        place = np.digitize(predicted, edges)
        points = [(predicted[place == i].mean(), wrong[place == i].mean(), (place == i).sum()) for i in np.unique(place)]
        x, y, count = map(np.array, zip(*points))
        sigma = np.sqrt(np.maximum(y * (1 - y), 1 / count) / count)
        axis.errorbar(np.maximum(x, 1e-5), np.maximum(y, 1e-5), yerr=[np.minimum(sigma, .999 * np.maximum(y, 1e-5)), sigma], fmt='o-',
                      markersize=4, linewidth=1, capsize=2, color=GROUPS[group][1], label=f'{GROUPS[group][0]}: {len(wrong)} windows')
    axis.set(xscale='log', yscale='log', xlim=(8e-6, 1.2), ylim=(8e-6, 1.2), xlabel='predicted probability of a wrong direction',
             ylabel=f'share of directions more than {WRONG_DEG} degrees off')
    axis.legend(fontsize=8)
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
