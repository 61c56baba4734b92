# SPDX-License-Identifier: BSD-3-Clause
"""Error of the trajectory against the readout of a rolling shutter, given to the program and not: rendered rooms and streets
of one seed each, whole sequences of FRAMES images."""
import argparse
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import matplotlib

matplotlib.use('Agg')
import matplotlib.pyplot as plt  # noqa: E402
import numpy as np  # noqa: E402
from PIL import Image  # noqa: E402

from . import metrics, package  # noqa: E402
from . import trajectory as tr  # noqa: E402
from .plots import save  # noqa: E402

ROOT = Path(__file__).resolve().parent.parent.parent
FRAMES = 60
SEEDS = {'room': 51, 'street': 52}
READOUTS = (-32, -24, -16, -8, 0, 8, 16, 24, 32)  # [ms]
# Label: initializer, whether the readout is given, line.
VARIANTS = {'orb': ('orb', True, 'o-', '#1f4fd6'), 'orb, global shutter': ('orb', False, 'o--', '#1f4fd6'),
            'coarse': ('coarse', True, 's-', '#d62728'), 'coarse, global shutter': ('coarse', False, 's--', '#d62728')}


@dataclass
class Run:
    kind: str
    readout: int
    label: str

    @property
    def sequence(self):
        return f'{self.kind}_{self.readout}'


def render(program, kind, readout, folder):
    if not (folder / 'groundtruth.txt').exists():
        subprocess.run([program, kind, '--seed', str(SEEDS[kind]), '--frames', str(FRAMES), '--noise', '2', f'--readout={readout}',
                        '--output', folder, '--quiet'], check=True)


def trajectory_of(dsorb, data, initializer, readout):
    """TUM rows of the frames that were tracked, each where its keyframe ended up."""
    calibration = dsorb.Calibration.read(data / 'camera.txt')
    calibration.set_readout(readout)
    rectifier = dsorb.Rectifier(calibration)
    odometry = dsorb.Odometry(rectifier, initializer, num_threads=1)
    times, images = np.loadtxt(data / 'times.txt', usecols=1), sorted((data / 'images').iterdir())
    tracked, T_world_keyframe = [], {}
    for time, file in zip(times, images):
        estimate = odometry.process(rectifier.rectify(np.asarray(Image.open(file))), time)
        if estimate.state == 'lost':
            break
        T_world_keyframe.update((keyframe.id, keyframe.T_world_cam) for keyframe in estimate.keyframes)
        if estimate.state == 'tracked':
            tracked.append((time, estimate.keyframe, estimate.T_cam_keyframe))
    T_world_keyframe.update((keyframe.id, keyframe.T_world_cam) for keyframe in odometry.finish().keyframes)
    return np.array([tr.row_of(time, T_world_keyframe[keyframe] @ tr.inverse(pose)) for time, keyframe, pose in tracked])


def error_of(dsorb, run, data):
    """Error of the trajectory over its length; None where there is none."""
    initializer, given, *_ = VARIANTS[run.label]
    rows = trajectory_of(dsorb, data, initializer, run.readout if given else 0)
    found = metrics.trajectory_errors(rows, tr.GroundTruth(tr.load_tum(data / 'groundtruth.txt'))) if len(rows) else None
    return found and found['ate_over_path']


def table(errors):
    lines = ['| | ' + ' | '.join(f'{readout:+d}' if readout else '0' for readout in READOUTS) + ' |', '|---' + '|--:' * len(READOUTS) + '|']
    for kind in SEEDS:
        for label in VARIANTS:
            cells = (errors[kind, readout, label] for readout in READOUTS)
            lines.append(f'| {kind}, `{label.replace(",", "`,", 1)}' + ('`' if ',' not in label else '') + ' | '
                         + ' | '.join('–' if error is None else f'{1e4 * error:.2g}' for error in cells) + ' |')
    return '\n'.join(lines) + '\n'


def draw(errors, path):
    figure, axes = plt.subplots(1, len(SEEDS), figsize=(10, 4), sharey=True)
    for axis, kind in zip(axes, SEEDS):
        for label, (_, _, line, colour) in VARIANTS.items():
            axis.plot(READOUTS, [errors[kind, readout, label] for readout in READOUTS], line, color=colour, markersize=4, label=label)
        axis.set(title=kind, yscale='log', xlabel='from the first to the last row [ms]')
        axis.grid(alpha=.3)
    axes[0].set_ylabel('error of the trajectory over its length')
    axes[0].legend(fontsize=8)
    figure.tight_layout()
    save(figure, path)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('out', type=Path, help='folder of what is made; sequences that are there already are used again')
    parser.add_argument('--build', type=Path, default=ROOT / 'build', help='folder of a build with DSORB_BUILD_PYTHON')
    parser.add_argument('--jobs', type=int, default=1, metavar='N', help='runs at a time')
    args = parser.parse_args()
    dsorb = package.load(args.build)
    if dsorb is None:
        sys.exit(f'rolling_shutter.py: no Python package in {args.build / "python"}')
    runs = [Run(kind, readout, label) for kind in SEEDS for readout in READOUTS for label in VARIANTS]
    with ThreadPoolExecutor(args.jobs) as pool:
        list(pool.map(lambda run: render(args.build / 'bin' / 'dso_synthesize', run.kind, run.readout, args.out / run.sequence),
                      runs[::len(VARIANTS)]))
        found = pool.map(lambda run: error_of(dsorb, run, args.out / run.sequence), runs)
        errors = {(run.kind, run.readout, run.label): error for run, error in zip(runs, found)}
    draw(errors, args.out / 'rolling_shutter.png')
    text = table(errors)
    (args.out / 'rolling_shutter.md').write_text(text, encoding='utf-8')
    sys.stdout.write(text)
    return 0
