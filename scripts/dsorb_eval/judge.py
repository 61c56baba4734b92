# SPDX-License-Identifier: BSD-3-Clause
"""From the output folder of a run (docs/formats.md, and what dso_dataset --help lists) to its figures.

With several segments only the first is judged: each has its own origin and scale."""
import csv
import json
import math
import os
from pathlib import Path

import numpy as np

from . import evo, layout, metrics
from . import trajectory as tr
from .protocol import sha256

GOOD_ATE = .05  # a good run stays below this share of the way ...
GOOD_TRACKED = .95  # ... and tracks more than this share of the frames after its initialization
NORMAL_EXITS = (0, 3)  # tracked; never initialized or lost


def version():
    """Hash of the code that judges: figures of another version are computed anew."""
    files = (layout.__file__, metrics.__file__, tr.__file__, evo.__file__, __file__)
    return sha256(*(Path(file).read_bytes() for file in files))[:12]


def reject_constant(word):
    raise ValueError(f'{word} in a JSON file')


def read_json(path):
    """Content of a JSON file, None where it is missing. @throws ValueError where it is broken or holds NaN"""
    return json.loads(path.read_text(), parse_constant=reject_constant) if path.exists() else None


def read_frames(path):
    """Rows of frames.csv with numbers as numbers."""
    if not path.exists():
        return []
    with open(path, newline='') as file:
        return [dict(index=int(r['index']), timestamp=float(r['timestamp']), state=r['state'], segment=int(r['segment']),
                     milliseconds=float(r['milliseconds']) if r['milliseconds'] else None) for r in csv.DictReader(file)]


def count_nonfinite(out):
    """Lines with nan or inf in the text files of a run."""
    count = 0
    for name in ('trajectory.txt', 'keyframes.txt', 'frames.csv'):
        if (out / name).exists():
            for line in (out / name).read_text(errors='replace').lower().splitlines():
                words = line.replace(',', ' ').split()
                count += any(word.lstrip('+-') in ('nan', 'inf', 'infinity') for word in words)
    return count


def judge_points(start, dataset):
    """Depth errors and normalised variance errors of the reference's points, where depth is known."""
    known = layout.true_depth(Path(dataset), start['reference']['index'])
    points = np.array(start['points'], float).reshape(-1, 4)
    if known is None or not len(points):
        return {}
    camera = [start['camera'][key] for key in ('fx', 'fy', 'cx', 'cy')]
    true = metrics.true_depths(*known, camera, points[:, :2])
    depth = metrics.depth_errors(points[:, 2], true)
    return dict(depth=depth, nees=metrics.depth_nees(points[:, 2], points[:, 3], true, depth['scale'])) if depth else {}


def judge_start(start, dataset, truth, frame_times):
    """Figures of one entry of initialization.json."""
    reference, target, milliseconds = start['reference'], start['target'], start['milliseconds']
    figures = dict(frames_given=start['frames_given'], since_ref=abs(target['index'] - reference['index']),
                   resets=start['resets'], ms_total=milliseconds['total'], ms_last=milliseconds.get('last_frame'),
                   stages=milliseconds.get('stages'), points=len(start['points']))
    pose = next((p for p in start['poses'] if p['index'] == target['index']), None)
    if truth is not None and pose is not None and pose['T_cam_ref'] is not None:
        times = reference['timestamp'], target['timestamp']
        figures.update(metrics.initial_pose_errors(pose['T_cam_ref'], *times, truth, frame_times))
        if pose.get('covariance') and 'baseline' in figures:
            figures.update(metrics.initial_pose_nees(pose['T_cam_ref'], pose['covariance'], *map(truth.pose, times)))
    return {**figures, **judge_points(start, dataset)}


def judge_against_final(start, final):
    """The initial pose against where the window has it in the end, which knows no errors of a ground truth.

    @param final trajectory of the segment"""
    target = start['target']
    pose = next((p for p in start['poses'] if p['index'] == target['index']), None)
    ends = [final.pose(frame['timestamp']) for frame in (start['reference'], target)]
    if pose is None or not pose.get('covariance') or any(end is None for end in ends):
        return {}
    nees = metrics.initial_pose_nees(pose['T_cam_ref'], pose['covariance'], *ends)
    return {key.replace('nees', 'nees_final'): values for key, values in nees.items()}


def of_times(rows, times):
    """The rows of a trajectory whose time is among these."""
    times = np.asarray(times)
    keep = [bool(len(times)) and np.abs(times - t).min() < tr.SAME_TIME for t in rows[:, 0]]
    return rows[np.array(keep, bool)]


def first_segment_rows(out, name, frames, segment):
    """Trajectory of a run's first segment with a successful initialization; the file of that name has the longest one."""
    own = out / name.replace('.txt', f'_{segment}.txt')
    return of_times(tr.load_tum(own if own.exists() else out / name), [f['timestamp'] for f in frames if f['segment'] == segment])


def judge_trajectories(out, frames, starts, truth, with_evo):
    """ATE and RPE of all frames and of the keyframes, ours and evo's."""
    segment, figures = starts[0]['segment'], {}
    for key, name in (('frames', 'trajectory.txt'), ('keyframes', 'keyframes.txt')):
        rows = first_segment_rows(out, name, frames, segment)
        figures[key] = metrics.trajectory_errors(rows, truth)
        if figures[key] and with_evo:
            figures[key]['evo'] = evo.trajectory_errors(rows, truth)
    return figures


def judge_files(out, sequence, with_evo):
    """Figures from the files alone. @throws OSError, ValueError, KeyError, TypeError where they break the contract"""
    summary, frames = read_json(out / 'run.json'), read_frames(out / 'frames.csv')
    content = read_json(out / 'initialization.json')
    if summary is None or content is None or not frames:
        raise ValueError('run.json, initialization.json or frames.csv is missing or empty')
    starts = [s for s in content['initializations'] if not s.get('refused')]
    truth = layout.load_ground_truth(Path(sequence['groundtruth']) if sequence['groundtruth'] else None,
                                     Path(sequence['path']), sequence['format'])
    times = [f['timestamp'] for f in frames]
    tracked = [f['milliseconds'] for f in frames if f['state'] == 'tracked' and f['milliseconds'] is not None]
    figures = dict(status=summary['status'], segments=summary['segments'], mb=summary['peak_memory_mb'],
                   camera=summary.get('camera'), ms_track=float(np.mean(tracked)) if tracked else None,
                   lost=any(f['state'] == 'lost' for f in frames), truth=truth is not None,
                   starts=[judge_start(s, sequence['path'], truth, times) for s in starts])
    if starts:
        later = frames[starts[0]['frames_given']:]
        figures['tracked'] = sum(f['state'] == 'tracked' for f in later)
        figures['tracked_after'] = figures['tracked'] / len(later) if later else None
        rows = first_segment_rows(out, 'trajectory.txt', frames, starts[0]['segment'])
        if len(rows):
            figures['starts'][0].update(judge_against_final(starts[0], tr.GroundTruth(rows)))
        if truth is not None:
            figures.update(judge_trajectories(out, frames, starts, truth, with_evo))
            figures.update(metrics.tracking_nees(tr.load_motions(out / 'frames.csv', starts[0]['segment']), truth))
    return figures


def is_good(figures):
    frames = figures.get('frames')
    return bool(not figures['crashed'] and not figures['nonfinite'] and frames and figures['segments'] == 1
                and frames['ate_over_path'] < GOOD_ATE and (figures['tracked_after'] or 0) > GOOD_TRACKED)


def without_nonfinite(value):
    """The same value with None for every number that JSON does not know."""
    if isinstance(value, dict):
        return {key: without_nonfinite(v) for key, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [without_nonfinite(v) for v in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def judge(record, folder, sequence, with_evo):
    """All figures of a recorded run; never throws on what the program wrote: files that break the contract make the run
    a failed one, with the reason in `error`.

    @param sequence  entry of plan()['sequences']"""
    out = Path(folder) / 'out'
    figures = dict(judge=version(), evo=bool(with_evo), exit_code=record['exit_code'], error=None, starts=[],
                   crashed=record['exit_code'] not in NORMAL_EXITS, nonfinite=count_nonfinite(out))
    try:
        figures.update(judge_files(out, sequence, with_evo))
    except (OSError, ValueError, KeyError, TypeError, IndexError) as error:
        where = os.fspath(out)
        figures.update(crashed=True, error=f'{type(error).__name__}: {error}'.replace(where, 'out'))
    figures['nonfinite'] += sum(bool(start.get('nonfinite')) for start in figures['starts'])
    figures['good'] = is_good(figures)
    return without_nonfinite(figures)
