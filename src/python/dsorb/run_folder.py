# SPDX-License-Identifier: BSD-3-Clause
"""What `dso_dataset` and `dsorb run` leave in their output folder (docs/formats.md), read back."""
import contextlib
import csv
import fcntl
import json
import os
import shutil
from collections import namedtuple
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

EXPORTS = 'exports.json'  # what exports have made
Row = namedtuple('Row', 'index time state is_keyframe segment image')  # of frames.csv; the time as it is written


@dataclass
class PosedFrame:
    index: int  # position in the sequence
    time: str  # [s], as it is written, with 9 decimals
    image: str  # file; empty where the images are no files
    is_keyframe: bool
    position: np.ndarray  # (3,) in the world of the segment
    quaternion: np.ndarray  # (4,) x y z w, camera to world

    @property
    def T_world_cam(self):
        pose = np.eye(4)
        pose[:3, :3] = rotation_of(self.quaternion)
        pose[:3, 3] = self.position
        return pose


@dataclass
class Points:
    """The map of a segment: (n, 3) world coordinates, (n, 3) colours and, (n,) each, index of the host's image and
    variance of the inverse depth there."""
    positions: np.ndarray
    colours: np.ndarray
    keyframes: np.ndarray
    variances: np.ndarray


@dataclass
class Segment:
    """A stretch of the video with one world and one unit of length."""
    number: int
    frames: list
    points: Points


@dataclass
class Run:
    folder: Path
    summary: dict  # run.json
    rows: list  # of frames.csv
    segments: list = field(default_factory=list)

    @property
    def camera(self):
        """Of the rectified images; refined where the run did that: poses and points belong to it."""
        return self.summary.get('refined_camera') or self.summary['camera']


@contextlib.contextmanager
def alone_in(folder):
    """Holds the lock of an output folder, as `dso_dataset` does while it writes. Raises ValueError where another has it."""
    folder.mkdir(parents=True, exist_ok=True)
    lock = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        with contextlib.suppress(OSError):  # a file system without locks is no reason not to run
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise ValueError(f'output folder {folder}: another run writes into it') from None
        yield
    finally:
        os.close(lock)


def rotation_of(quaternion):
    """(3, 3) rotation of a quaternion x y z w."""
    x, y, z, w = np.asarray(quaternion) / np.linalg.norm(quaternion)
    return np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                     [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                     [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]])


def read_run(folder):
    """Everything of an output folder. Raises ValueError naming the file that is not as expected, OSError."""
    folder = Path(folder)
    summary = json.loads((folder / 'run.json').read_text(encoding='utf-8'))
    if summary.get('camera') is None:
        raise ValueError(f'{folder / "run.json"}: this run read no image')
    rows = read_rows(folder / 'frames.csv')
    points = read_points(folder / 'points.ply')
    run = Run(folder, summary, rows)
    by_time = {row.time: row for row in rows}
    for number, poses, keyframes in read_poses(folder, rows):
        frames = []
        for time, pose in poses:
            if time not in by_time:
                raise ValueError(f'{folder / "frames.csv"}: no line for the time {time}')
            row = by_time[time]
            frames.append(PosedFrame(row.index, time, row.image, time in keyframes, pose[:3], pose[3:]))
        chosen = points['segment'] == number
        run.segments.append(Segment(number, frames, points_of(points[chosen])))
    return run


def read_rows(path):
    with path.open(newline='', encoding='utf-8') as file:
        rows = list(csv.DictReader(file))
    if rows and 'image' not in rows[0]:
        raise ValueError(f'{path}: no column `image`; made by an older version, run again')
    return [Row(int(row['index']), row['timestamp'], row['state'], row['is_keyframe'] == '1', int(row['segment']),
                row['image']) for row in rows]


def read_poses(folder, rows):
    """Per segment: number, [(time, numbers of the TUM line)], times of keyframes."""
    numbers = sorted({row.segment for row in rows})
    several = [n for n in numbers if (folder / f'trajectory_{n}.txt').exists()]
    if several:
        return [(n, read_tum(folder / f'trajectory_{n}.txt'), times_of(folder / f'keyframes_{n}.txt')) for n in several]
    of_segment, segment_at = {}, {row.time: row.segment for row in rows}
    for time, pose in read_tum(folder / 'trajectory.txt'):  # of a run that was killed: of all segments
        of_segment.setdefault(segment_at.get(time, -1), []).append((time, pose))
    keyframes = times_of(folder / 'keyframes.txt')
    return [(number, poses, keyframes) for number, poses in sorted(of_segment.items())]


def read_tum(path):
    with path.open(encoding='utf-8') as file:
        lines = [line.split() for line in file if line.strip() and not line.startswith('#')]
    return [(words[0], np.array(words[1:8], float)) for words in lines]


def times_of(path):
    return {time for time, _ in read_tum(path)}


PLY_TYPES = {'float': '<f4', 'uchar': 'u1', 'int': '<i4'}


def read_points(path):
    """Vertices of points.ply as a structured array."""
    data = path.read_bytes()
    end = data.find(b'end_header\n')
    header = data[:max(end, 0)].decode('ascii', 'replace').splitlines()
    if end < 0 or 'format binary_little_endian 1.0' not in header:
        raise ValueError(f'{path}: expected a binary little-endian PLY file')
    fields = [(words[2], PLY_TYPES[words[1]]) for words in map(str.split, header) if words[0] == 'property']
    if 'keyframe' not in dict(fields):
        raise ValueError(f'{path}: no property `keyframe`; made by an older version, run again')
    return np.frombuffer(data, np.dtype(fields), offset=end + len(b'end_header\n'))


def points_of(vertices):
    return Points(np.stack([vertices[axis] for axis in 'xyz'], 1).astype(float),
                  np.stack([vertices[name] for name in ('red', 'green', 'blue')], 1),
                  vertices['keyframe'].copy(), vertices['inverse_depth_variance'].copy())


def exported(folder):
    """What exports have made in an output folder: the files of each of its folders, or None of one that was not finished."""
    try:
        made = json.loads((folder / EXPORTS).read_text(encoding='utf-8'))
    except (OSError, ValueError):
        return {}
    if not isinstance(made, dict):
        return {}
    return {name: files for name, files in made.items() if name and Path(name).name == name != '..'}  # none outside


def note_exports(folder, made):
    (folder / EXPORTS).write_text(json.dumps(made, sort_keys=True) + '\n', encoding='utf-8')


def remove_made(target, files):
    """What an export has made; what others have put there stays."""
    if files is None:
        shutil.rmtree(target, ignore_errors=True)
        return
    for path in (target / name for name in files):
        if target.resolve() in path.resolve().parents:
            path.unlink(missing_ok=True)
    for path in sorted([target, *target.rglob('*')], reverse=True):
        if path.is_dir() and not path.is_symlink() and not any(path.iterdir()):
            path.rmdir()


def new_folder(folder, name):
    """An empty folder in the output folder, in place of that of an earlier export. Raises ValueError where there is another."""
    target, made = folder / name, exported(folder)
    if name in made:
        remove_made(target, made[name])
    if target.exists() and (not target.is_dir() or any(target.iterdir())):
        raise ValueError(f'{target}: holds what no export has made; move it away, or choose another folder for the run')
    target.mkdir(exist_ok=True)
    note_exports(folder, {**made, name: None})
    return target


def finish_folder(folder, name):
    """Notes what an export has made, which is all that is there."""
    target = folder / name
    files = sorted(str(path.relative_to(target)) for path in target.rglob('*') if not path.is_dir())
    note_exports(folder, {**exported(folder), name: files})


def remove_exports(folder):
    """Those of an earlier run."""
    for name, files in exported(folder).items():
        remove_made(folder / name, files)
    (folder / EXPORTS).unlink(missing_ok=True)
