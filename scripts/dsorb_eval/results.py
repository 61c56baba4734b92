# SPDX-License-Identifier: BSD-3-Clause
"""docs/lab/results.md: all variants against each other and against other programs; every number comes from a table."""
import argparse
import csv
import datetime
import os
import platform
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from . import start_pictures, summary
from .store import Evaluation
from .trajectory import FormatError

ROOT = Path(__file__).resolve().parent.parent.parent
WORDS = ('protocol', 'method', 'sequence', 'program', 'run')  # columns of reference.csv that are no figures
REFERENCE = 'reference'  # rows of DSO's own program in reference.csv
OURS = ('orb', 'coarse')  # variants that are held against it, sentence by sentence
FREE_TO_SHOW = ('room_hand', 'tartanair')  # sequences whose images may be passed on
SAME = .02  # relative difference of two figures that count as equal

COLUMNS = {
    'dense': ('runs', 'init', 'good', 'crash', 'given', 'since_ref', 'dir', 'dir95', 'wrong20', 'hit10', 'rot', 'init_rpe', 'depth', 'depth10',
              'nees', 'nees_rot', 'nees_dir', 'nees_final_rot', 'nees_final_dir', 'nees_tracked_rot', 'nees_tracked_trans', 'points',
              'ms_init', 'ms_last', 'ate', 'tracked_after', 'mb'),
    'five': ('runs', 'init', 'good', 'crash', 'given', 'dir', 'dir95', 'wrong20', 'rot', 'init_rpe', 'depth', 'depth10', 'ms_init', 'ate', 'ate_kf',
             'rpe', 'tracked_after', 'lost', 'ms_track', 'mb')}
HIGHER_IS_BETTER = ('init', 'good', 'hit10', 'depth10', 'tracked_after')
LOWER_IS_BETTER = ('crash', 'given', 'dir', 'dir95', 'wrong20', 'rot', 'init_rpe', 'depth', 'ms_init', 'ate', 'ate_kf', 'mb')
TITLES = {'dense': 'Dense starts: every 10th frame, forward and reversed, 40 frames each',
          'five': "Gladkova's protocol: five starts forward, five reversed, at most 200 frames each"}
CURVES = {'dense': ('all_initial', 'all_initial_angles', 'all_effort'), 'five': ('all_trajectory', 'all_trajectory_keyframes')}


@dataclass
class Protocol:
    """An evaluation with its table and the rows of other programs under the same protocol."""
    name: str
    evaluation: Evaluation
    rows: list  # (sequence, variant, figures)
    others: list  # the same


def read_others(path, protocol):
    """Rows of reference.csv. @throws FormatError"""
    rows = []
    with open(path, newline='') as stream:
        for number, line in enumerate(csv.DictReader(stream), 2):
            if line['protocol'] != protocol:
                continue
            try:
                figures = {key: float(value) if '.' in value or 'e' in value else int(value)
                           for key, value in line.items() if value and key not in WORDS}
            except ValueError as error:
                raise FormatError(f'{path}, line {number}: {error}; expected numbers') from None
            rows.append((line['sequence'], line['method'], figures))
    return rows


def load(name, folder, others):
    evaluation = Evaluation(folder)
    missing = len(evaluation.runs) - len(evaluation.done())
    if missing:
        raise FormatError(f'{folder}: {missing} runs of its plan were not done')
    return Protocol(name, evaluation, summary.table(evaluation.plan, evaluation.done()), read_others(others, name))


def table_of(protocol):
    """Markdown table: per sequence our variants, then those of other programs."""
    columns = COLUMNS[protocol.name]
    lines = ['| sequence | variant | ' + ' | '.join(columns) + ' |', '|---|---' + '|--:' * len(columns) + '|']
    for sequence in dict.fromkeys(name for name, _, _ in protocol.rows):
        for name, variant, row in protocol.rows + protocol.others:
            if name == sequence:
                label = f'*{variant}*' if (name, variant, row) in protocol.others else variant
                lines.append('| ' + ' | '.join([name, label, *(summary.text_of(row.get(c)) for c in columns)]) + ' |')
    return '\n'.join(lines) + '\n'


def verdict(column, ours, theirs):
    """1 better, -1 worse, 0 equal or not comparable."""
    if ours is None or theirs is None or abs(ours - theirs) <= SAME * abs(theirs):
        return 0
    return 1 if (ours > theirs) == (column in HIGHER_IS_BETTER) else -1


def comparison(protocol, variant):
    """Sentences: where a variant is better and where it is worse than the reference, each with both numbers."""
    found = {1: [], -1: []}
    reference = {name: row for name, method, row in protocol.others if method == REFERENCE}
    for name, row_variant, row in protocol.rows:
        if row_variant != variant or name not in reference or row['runs'] != reference[name]['runs']:
            continue
        parts = {1: [], -1: []}
        for column in (c for c in COLUMNS[protocol.name] if c in HIGHER_IS_BETTER + LOWER_IS_BETTER):
            kind = verdict(column, row[column], reference[name].get(column))
            if kind:
                parts[kind].append(f'{column} {summary.text_of(row[column])} ({summary.text_of(reference[name][column])})')
        for kind, texts in parts.items():
            if texts:
                found[kind].append(f'  - {name}: ' + ', '.join(texts))
    lines = []
    for kind, word in ((1, 'better'), (-1, 'worse')):
        lines.append(f'- `{variant}` is {word} than the reference (its figure in brackets) in:' if found[kind]
                     else f'- `{variant}` is {word} than the reference in no column where both have a figure and as many runs.')
        lines += found[kind]
    return '\n'.join(lines) + '\n'


def copy_pictures(protocol, target):
    """Copies the figures that may be shown. @return Markdown lines"""
    lines, figures = [], protocol.evaluation.folder / 'figures'
    names = [figures / f'{name}.png' for name in CURVES[protocol.name]]
    if protocol.name == 'dense':
        names += [path for sequence in FREE_TO_SHOW for path in sorted(figures.glob(f'overlay*{sequence}*.png'))]
        names += sorted(figures.glob('residuals_*.png'))
        names += [path for path in sorted(figures.glob('epipolar_search_orb.png')) if may_be_shown(protocol)]
    for path in names:
        if path.exists():
            shutil.copyfile(path, target / f'{protocol.name}_{path.name}')
            lines.append(f'![{path.stem.replace("_", " ")}]({target.name}/{protocol.name}_{path.name})\n')
    return lines


def may_be_shown(protocol):
    """Whether the start of orb that start_pictures draws comes from images that may be passed on."""
    sequence, _ = start_pictures.choose(protocol.evaluation).get('orb', (None, None))
    return sequence in FREE_TO_SHOW


def commit():
    """Commit of the sources, marked where files were changed."""
    out = subprocess.run(['git', '-C', str(ROOT), 'describe', '--always', '--dirty', '--abbrev=12', '--exclude=*'], capture_output=True, text=True)
    return out.stdout.strip() or 'unknown'


def machine():
    try:
        lines = Path('/proc/cpuinfo').read_text().splitlines()
        model = next(line.split(':', 1)[1].strip() for line in lines if line.startswith('model name'))
    except (OSError, StopIteration):
        model = platform.machine()
    return f'{os.cpu_count()} cores, {model}'


def page(protocols, target, of_commit, note):
    """The whole page as Markdown."""
    plan = protocols[0].evaluation.plan
    parts = ['# Results\n', f'Written by `scripts/results_page.py` on {datetime.date.today()} from runs of commit `{of_commit}` (program '
             f'`{plan["build"][:16]}`) on {machine()}; {plan["threads"]} thread a run. Sequences: excerpts of public data sets '
             '(KITTI odometry, EuRoC, TUM RGB-D, 7-Scenes, TartanAir) and a rendered hand-held one (`room_hand`).\n',
             'Rows in *italics* are other programs, measured by us (`docs/lab/results/reference.csv`): *reference* is the original DSO program with its own '
             'initializer (`coarse+reference` is our `--preset reference`), the others are two-view initializations on the same starts. Its runs on `euroc_static` were made on a longer '
             'excerpt, its depth on 7-Scenes judged against depth images that we do not have; its milliseconds are from a busy machine of the same kind. '
             'That file says of each row which program made it and how it was run; command lines were not kept.\n',
             '**Development data.** The limits of the start rule and many constants of `orb` and `coarse` were chosen on these very sequences (the history: '
             '`docs/lab/experiments.md`): read the rows of both as figures on development data, not as a test. The published variants and the '
             'programs in italics had no constant chosen on them.\n']
    parts += [note + '\n'] if note else []
    for protocol in protocols:
        parts += [f'## {TITLES[protocol.name]}\n', table_of(protocol)]
        parts += [comparison(protocol, variant) for variant in OURS if variant in plan['variants']]
        parts += copy_pictures(protocol, target)
    parts += ['## Columns\n', summary.legend(),
              '\nImages: `room_hand` is ours (trajectory: TUM RGB-D fr2_desk, CC BY 4.0, Sturm et al.), TartanAir CC BY 4.0 (Wang et al.).']
    return '\n'.join(parts) + '\n'


def main(arguments=None):
    parser = argparse.ArgumentParser(prog='results_page.py', description='Writes the results page from two evaluations.')
    parser.add_argument('--five', required=True, metavar='DIR', help='output of evaluate.py --starts five --frames 200')
    parser.add_argument('--dense', required=True, metavar='DIR', help='output of evaluate.py --starts every:10 --frames 40')
    parser.add_argument('--others', default=str(ROOT / 'docs' / 'lab' / 'results' / 'reference.csv'), metavar='FILE.csv')
    parser.add_argument('--output', default=str(ROOT / 'docs' / 'lab' / 'results.md'), metavar='FILE.md', help='pictures go to the folder results beside it')
    parser.add_argument('--commit', default=commit(), help='of the program that ran; default: of the sources as they are')
    parser.add_argument('--note', default='', help='a sentence about the runs, for the head of the page')
    args = parser.parse_args(arguments)
    try:
        protocols = [load(name, getattr(args, name), args.others) for name in ('dense', 'five')]
        if len({p.evaluation.plan['build'] for p in protocols}) > 1:
            raise FormatError('the two evaluations were made with different programs')
        target = Path(args.output).parent / 'results'
        target.mkdir(parents=True, exist_ok=True)
        Path(args.output).write_text(page(protocols, target, args.commit, args.note))
    except (FormatError, OSError) as error:
        print(f'results_page.py: {error}', file=sys.stderr)
        return 2
    print(args.output)
    return 0
