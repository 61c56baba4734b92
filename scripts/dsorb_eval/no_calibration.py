# SPDX-License-Identifier: BSD-3-Clause
"""Sequences whose calibration is hidden: as files, and as an H.264 video; beside the run with the calibration."""
import json
import os
import resource
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from . import layout, metrics, protocol
from . import trajectory as tr

QUALITY = 18  # of x264; 23 is what programs take by default
COLUMNS = ('calibrated', 'files', 'video')


@dataclass
class Outcome:
    """What one run came to; the error of the focal length and its sigma are relative."""
    segments: int
    posed: int
    ate: float | None
    focal_error: float | None
    focal_sigma: float | None
    k1: float
    readout: float  # [ms]
    seconds: float  # of the processor


def images_of(sequence):
    """Files of a sequence in its own order; a FormatError of an archive."""
    name, found = layout.recognise(Path(sequence.path), sequence.format)
    if name == 'euroc':
        files = [found.parent / 'data' / entry for entry in layout.table_column(found, 1, ',')]
    elif name == 'tum':
        files = [found.parent / entry for entry in layout.table_column(found, 1)]
    elif found.suffix == '.zip':
        raise tr.FormatError(f'{found}: images in files are expected')
    else:
        files = [found / entry for entry in layout.image_names(found)]
    return files[sequence.first:sequence.last + 1]


def hide(sequence, times, folder):
    """The images by links, and their times, without the calibration."""
    shutil.rmtree(folder, ignore_errors=True)
    (folder / 'images').mkdir(parents=True)
    lines = []
    for i, (file, time) in enumerate(zip(images_of(sequence), times)):
        (folder / 'images' / f'{i:06d}{file.suffix}').symlink_to(file.resolve())
        lines.append(f'{i:06d} {time:.9f}\n')
    (folder / 'times.txt').write_text(''.join(lines), encoding='utf-8')


def encoder():
    """FFmpeg: the system's, else that of the package imageio-ffmpeg."""
    if shutil.which('ffmpeg'):
        return 'ffmpeg'
    import imageio_ffmpeg
    return imageio_ffmpeg.get_ffmpeg_exe()


def film(folder, rate, video):
    suffix = next((folder / 'images').iterdir()).suffix
    subprocess.run([encoder(), '-y', '-loglevel', 'error', '-framerate', f'{rate:.6f}', '-i', folder / 'images' / f'%06d{suffix}',
                    '-vf', 'crop=trunc(iw/2)*2:trunc(ih/2)*2:0:0', '-c:v', 'libx264', '-crf', str(QUALITY), '-pix_fmt', 'yuv420p', video],
                   check=True, stdin=subprocess.DEVNULL)


def run(program, source, output, times, threads, extra=()):
    """@return run.json, trajectory with the times of the sequence, seconds of the processor"""
    shutil.rmtree(output, ignore_errors=True)
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([program, source, '--output', output, '--quiet', '--threads', str(threads), *extra], check=False,
                   stdin=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    rows = tr.load_tum(output / 'trajectory.txt') if (output / 'trajectory.txt').exists() else np.zeros((0, 8))
    if times is not None and len(rows):  # those of a video count from its beginning
        step = float(np.median(np.diff(times)))
        rows[:, 0] = [times[min(len(times) - 1, round(time / step))] for time in rows[:, 0]]
    return json.loads((output / 'run.json').read_text()), rows, seconds


def outcome(summary, rows, seconds, truth, focal):
    errors = metrics.trajectory_errors(rows, truth) if truth and len(rows) else None
    found = summary.get('found_camera')
    return Outcome(summary['segments'], len(rows), errors and errors['ate_over_path'], found and found['fx'] / focal - 1,
                   found and found['sigma']['focal'] / found['fx'], found['coefficients'][0] if found and found['coefficients'] else 0,
                   found['readout'] if found else 0, seconds)


def measure(args, sequence, folder):
    """Outcomes of one sequence by column."""
    times = layout.timestamps(Path(sequence.path), sequence.format)[sequence.first:sequence.last + 1]
    truth = layout.load_ground_truth(Path(sequence.groundtruth), Path(sequence.path), sequence.format) if sequence.groundtruth else None
    span = ['--format', sequence.format, '--start', str(sequence.first), '--end', str(sequence.last + 1)]
    summary, rows, seconds = run(args.bin, sequence.path, folder / 'calibrated', None, args.threads, span)
    focal = summary['lens']['fx']
    hide(sequence, times, folder / 'hidden')
    film(folder / 'hidden', 1 / float(np.median(np.diff(times))), folder / 'video.mp4')
    return {'calibrated': outcome(summary, rows, seconds, truth, focal),
            'files': outcome(*run(args.bin, folder / 'hidden', folder / 'files', None, args.threads), truth, focal),
            'video': outcome(*run(args.bin, folder / 'video.mp4', folder / 'film', times, args.threads), truth, focal)}


def cells(found, calibrated):
    if found is calibrated:
        return f'{found.segments}, {percent(found.ate)}, {found.seconds:.1f} s'
    return (f'{found.segments}, {percent(found.ate)}, {percent(found.focal_error)} ± {percent(found.focal_sigma)}, '
            f'{found.seconds / max(found.seconds and calibrated.seconds, 1e-9):.1f}')


def percent(share):
    return '–' if share is None else f'{100 * share:.2g} %'


def table(results):
    """Segments, error of the trajectory over its way, error of the focal length and its sigma, processor time over that with
    the calibration."""
    lines = ['| no calibration | ' + ' | '.join(COLUMNS) + ' |', '|---' * (len(COLUMNS) + 1) + '|']
    lines += [f'| {name} | ' + ' | '.join(cells(found[c], found['calibrated']) for c in COLUMNS) + ' |' for name, found in results.items()]
    return '\n'.join(lines) + '\n'


def evaluate(args):
    """@return exit code"""
    folder = Path(args.output)
    args.bin = os.path.abspath(args.bin)
    results = {}
    for sequence in protocol.read_sequences(args.sequences):
        if not sequence.no_start:
            results[sequence.name] = measure(args, sequence, folder / 'no_calibration' / sequence.name)
    text = table(results)
    (folder / 'no_calibration.md').write_text(text, encoding='utf-8')
    print(text, end='')
    return 0
