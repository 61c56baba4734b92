# SPDX-License-Identifier: BSD-3-Clause
"""What each mechanism is worth in the finished stack: the same starts with it and without it, pair by pair.

Every mechanism of `dso_dataset --skip list` is left out alone, and sets of them together. A ratio is the geometric mean, over the
starts that have the figure both times, of the figure without the mechanism over the figure with it; its error is that of a
bootstrap over blocks of neighbouring starts, which overlap. Above 1: the mechanism helps."""
import argparse
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

from . import protocol, runner, summary
from .store import figures_of
from .trajectory import FormatError

BLOCK = 4  # neighbouring starts that overlap
DRAWS = 500  # of the bootstrap
RATIOS = dict(given=('given',), direction=('dir_deg',), depth=('depth', 'median'), trajectory=None, ms=('ms_total',))
WHOLE = 'nothing'  # the row of the finished stack


def mechanisms_of(program):
    """Names and descriptions of all mechanisms. @throws FormatError where the program knows none"""
    answer = subprocess.run([str(program), '--skip', 'list'], capture_output=True, text=True, timeout=60)
    if answer.returncode:
        raise FormatError(f'{program} --skip list: exit {answer.returncode}: {answer.stderr.strip()}')
    return dict(line.split(None, 1) for line in answer.stdout.splitlines())


def run_all(args, skip, folder):
    """Runs of the stack without some mechanisms. @return summary.Run, in the order of the plan"""
    extra = ('--skip', skip) if skip else ()
    request = protocol.Request(args.bin, args.sequences, [args.variant], args.starts, args.frames, extra=extra, evo=False)
    plan = protocol.plan(request)
    sequences = {entry['name']: entry for entry in plan['sequences']}

    def run_one(entry):
        where = folder / 'runs' / entry['key']
        record = runner.read_record(where) or runner.run_one(entry, where, request.timeout)
        return summary.Run(entry, record, figures_of(record, where, sequences[entry['sequence']], False))

    with ThreadPoolExecutor(args.jobs) as pool:
        return list(pool.map(run_one, plan['runs'])), sequences


def figure(run, name):
    """A positive figure of a run, or None."""
    if name == 'trajectory':
        value = summary.value_of(run.figures, 'frames', 'ate_over_path')
    elif name == 'given':
        value = run.start and run.start['frames_given']
    else:
        value = summary.value_of(run.start, *RATIOS[name])
    return value if value and np.isfinite(value) and value > 0 else None


def ratio(pairs, name, rng):
    """Geometric mean of figures without over figures with a mechanism, and its standard error; None without a pair."""
    values = [(figure(a, name), figure(b, name)) for a, b in pairs]
    logs = np.log([b / a for a, b in values if a and b])
    if not len(logs):
        return None
    blocks = [logs[i:i + BLOCK] for i in range(0, len(logs), BLOCK)]
    means = [np.concatenate([blocks[j] for j in rng.integers(len(blocks), size=len(blocks))]).mean() for _ in range(DRAWS)]
    return float(np.exp(logs.mean())), float(np.exp(logs.mean()) * np.std(means))


def text_of_ratio(value):
    return '–' if value is None else f'{value[0]:.2f} ± {value[1]:.2f}'


def same_bits(a, b, folder):
    """Whether two runs wrote the same trajectory."""
    texts = [folder / 'runs' / run.entry['key'] / 'out' / 'trajectory.txt' for run in (a, b)]
    return all(t.exists() for t in texts) and texts[0].read_bytes() == texts[1].read_bytes()


def row_of(name, lines, whole, without, sequences, folder):
    """One row of the table. Counts are of the runs where a start can be expected; `forbidden` of the others."""
    fair = [i for i, run in enumerate(whole) if not sequences[run.entry['sequence']]['no_start']]
    started = [without[i] for i in fair if without[i].start]
    wrong = sum((run.start.get('dir_deg') or 0) > summary.WRONG_DEG for run in started)
    forbidden = sum(bool(run.start) for run in without) - len(started)
    pairs = [(whole[i], without[i]) for i in fair]
    rng = np.random.default_rng(1)
    cells = [name, '' if lines is None else str(lines), f'{len(started)} of {len(fair)}', str(sum(without[i].figures['good'] for i in fair)),
             str(wrong), str(forbidden), *(text_of_ratio(ratio(pairs, key, rng)) for key in RATIOS),
             f'{sum(same_bits(a, b, folder) for a, b in pairs)}']
    return '| ' + ' | '.join(cells) + ' |'


HEAD = ('without', 'lines', 'started', 'good', 'wrong', 'forbidden', 'images given', 'direction', 'depth', 'trajectory', 'ms', 'same bits')


def lines_of(root, patterns):
    """Lines of the sources that exist for a mechanism."""
    return sum(len(path.read_text().splitlines()) for pattern in patterns for path in sorted(root.glob(pattern)))


def parse_arguments(arguments):
    parser = argparse.ArgumentParser(prog='ablations.py', description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--bin', required=True, metavar='PATH', help='the dso_dataset program')
    parser.add_argument('--sequences', required=True, metavar='FILE.yaml', help='as for evaluate.py')
    parser.add_argument('--skip', nargs='*', metavar='NAME,...', help='mechanisms or sets of them; default: each, and all together')
    parser.add_argument('--variant', default='orb')
    parser.add_argument('--starts', default='every:20', help='as for evaluate.py; default every:20')
    parser.add_argument('--frames', type=int, default=30, metavar='N', help='frames given to a run at most; default 30')
    parser.add_argument('--jobs', type=int, default=1, metavar='N', help='runs side by side; 1 (default) when times matter')
    parser.add_argument('--lines', metavar='FILE.yaml', help='mechanism: list of the sources that exist for it')
    parser.add_argument('--output', required=True, metavar='DIR', help='runs, kept from one call to the next, and ablations.md')
    return parser.parse_args(arguments)


def write_table(args, folder):
    import yaml
    names = mechanisms_of(args.bin)
    sources = yaml.safe_load(Path(args.lines).read_text()) if args.lines else {}
    root = Path(__file__).resolve().parent.parent.parent
    whole, sequences = run_all(args, '', folder)
    rows = ['| ' + ' | '.join(HEAD) + ' |', '|---' + '|--:' * (len(HEAD) - 1) + '|',
            row_of(WHOLE, None, whole, whole, sequences, folder)]
    for skip in args.skip or [*names, ','.join(names)]:
        without, _ = run_all(args, skip, folder)
        lines = lines_of(root, sources[skip]) if skip in sources else None
        rows.append(row_of(skip.replace(',', ', '), lines, whole, without, sequences, folder))
        protocol.write_if_changed(folder / 'ablations.md', '\n'.join(rows) + '\n')
        print(rows[-1], flush=True)


def main(arguments=None):
    args = parse_arguments(arguments)
    folder = Path(args.output).resolve()
    try:
        write_table(args, folder)
    except FormatError as error:
        print(f'ablations.py: {error}', file=sys.stderr)
        return 2
    return 0
