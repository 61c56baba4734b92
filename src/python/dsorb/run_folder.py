# SPDX-License-Identifier: BSD-3-Clause
"""What `dso_dataset` and `dsorb run` leave in their output folder (docs/formats.md), read back."""
import contextlib
import csv
import json
import math
import os
import sys
from collections import namedtuple
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import unquote_to_bytes

import numpy as np

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None

FORMATS = ('tum', 'kitti', 'euroc', 'colmap', 'nerfstudio', 'ply')
TEXT = dict(encoding=sys.getfilesystemencoding(), errors='surrogateescape')  # names of files are bytes and stay what they are
EXPORTED = (*FORMATS, 'images', 'metric')  # folders that exports make
EXPORTS = 'exports.json'  # what they have made
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
class Tracks:
    """Corners that several keyframes see: (n, 3) world coordinates, and of every observation, (m,) each, the row of its point
    and the index of its image, and (m, 2) the pixel in the rectified image."""
    positions: np.ndarray
    points: np.ndarray
    keyframes: np.ndarray
    pixels: np.ndarray


@dataclass
class Segment:
    """A stretch of the video with one world and one unit of length."""
    number: int
    frames: list
    points: Points
    tracks: Tracks


@dataclass
class Run:
    folder: Path
    summary: dict  # run.json
    rows: list  # of frames.csv
    segments: list = field(default_factory=list)

    @property
    def dataset(self):
        """What was read, with the bytes of its name."""
        uri = self.summary.get('dataset_uri')
        return os.fsdecode(unquote_to_bytes(uri.removeprefix('file://'))) if uri else self.summary['dataset']

    @property
    def camera(self):
        """Camera of the rectified images, to which poses and points belong; the refined one where the run refined it."""
        return self.summary.get('refined_camera') or self.summary['camera']


class FolderError(ValueError):
    """A file of an output folder that is not as expected; the message names it."""


@contextlib.contextmanager
def reading(path):
    """Says of which file something is not as a run leaves it."""
    try:
        yield
    except FolderError:
        raise
    except (ValueError, LookupError, TypeError, AttributeError) as error:
        raise FolderError(f'{path}: not as a run leaves it: {type(error).__name__}: {error}') from None


@contextlib.contextmanager
def alone_in(folder):
    """Holds the lock of an output folder, as `dso_dataset` does while it writes. Raises ValueError where another has it."""
    folder.mkdir(parents=True, exist_ok=True)
    if fcntl is None:
        yield
        return
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
    """Everything of an output folder. Raises FolderError naming the file that is not as expected, OSError."""
    folder = Path(folder)
    summary = read_summary(folder / 'run.json')
    rows = read_rows(folder / 'frames.csv')
    run = Run(folder, summary, rows)
    if summary['camera'] is None:
        return run  # that read no image
    points, tracks = read_points(folder / 'points.ply'), read_tracks(folder / 'tracks.ply')
    by_time = {row.time: row for row in rows}
    for number, poses, keyframes in read_poses(folder, rows, summary.get('joined', [])):
        frames = []
        for time, pose in poses:
            if time not in by_time:
                raise FolderError(f'{folder / "frames.csv"}: no line for the time {time}')
            row = by_time[time]
            frames.append(PosedFrame(row.index, time, row.image, time in keyframes, pose[:3], pose[3:]))
        chosen = points['segment'] == number
        run.segments.append(Segment(number, frames, points_of(points[chosen]), tracks_of(tracks, number)))
    return run


def read_summary(path):
    with reading(path):
        summary = json.loads(path.read_text(encoding='utf-8'))
        for name in ('camera', 'lens', 'refined_camera'):
            camera = summary['camera'] if name == 'camera' else summary.get(name)
            for key in ('fx', 'fy', 'cx', 'cy', 'width', 'height') if camera is not None else ():
                if not math.isfinite(camera[key]) or (key[0] != 'c' and camera[key] <= 0):
                    raise ValueError(f'{key} of {name} is {camera[key]}')
        return summary


def read_rows(path):
    with reading(path), path.open(newline='', **TEXT) as file:
        return [Row(int(row['index']), row['timestamp'], row['state'], row['is_keyframe'] == '1', int(row['segment']),
                    row['image']) for row in csv.DictReader(file)]


def after_joins(segment, joined):
    """Number of the segment that has become of one, by `joined` of run.json."""
    for join in joined:
        segment = join['into'] if join['segment'] == segment else segment
    return segment


def read_poses(folder, rows, joined):
    """Per segment: number, [(time, numbers of the TUM line)], times of keyframes."""
    segment_at = {row.time: after_joins(row.segment, joined) for row in rows}
    of_segment, keyframes = {}, set()
    for ending in [''] + [f'_{n}' for n in sorted(set(segment_at.values()))]:  # the plain names have one of the segments
        trajectory, adjusted = folder / f'trajectory{ending}.txt', folder / f'keyframes{ending}.txt'
        for time, pose in read_tum(trajectory) if trajectory.exists() or not ending else ():
            of_segment.setdefault(segment_at.get(time, -1), {})[time] = pose
        keyframes |= times_of(adjusted) if adjusted.exists() or not ending else set()
    return [(number, list(poses.items()), keyframes) for number, poses in sorted(of_segment.items())]


def read_tum(path):
    with reading(path):
        text = path.read_text(encoding='utf-8')
        if text and not text.endswith('\n'):
            raise ValueError('it ends within a line')
        lines = [line.split() for line in text.splitlines() if line.strip() and not line.startswith('#')]
        poses = [(words[0], np.array(words[1:], float)) for words in lines]
        if not all(pose.shape == (7,) and np.isfinite(pose).all() for _, pose in poses):
            raise ValueError('expected a time and seven numbers a line')
        return poses


def times_of(path):
    return {time for time, _ in read_tum(path)}


PLY_TYPES = {'float': '<f4', 'uchar': 'u1', 'int': '<i4'}


def read_ply(path):
    """Elements of a PLY file by their names, as structured arrays."""
    data = path.read_bytes()
    end = data.find(b'end_header\n')
    header = data[:max(end, 0)].decode('ascii', 'replace').splitlines()
    if end < 0 or 'format binary_little_endian 1.0' not in header:
        raise FolderError(f'{path}: expected a binary little-endian PLY file')
    elements, place = [], end + len(b'end_header\n')
    with reading(path):
        for words in map(str.split, header):
            if words[0] == 'element':
                elements.append((words[1], int(words[2]), []))
            elif words[0] == 'property':
                elements[-1][2].append((words[2], PLY_TYPES[words[1]]))
        found = {}
        for name, count, fields in elements:
            found[name] = np.frombuffer(data, np.dtype(fields), count, place)
            place += found[name].nbytes
        return found


def read_points(path):
    """Vertices of points.ply as a structured array."""
    vertices = read_ply(path).get('vertex')
    if vertices is None or 'keyframe' not in vertices.dtype.names:
        raise FolderError(f'{path}: no property `keyframe`, as that of a run has')
    return vertices


def read_tracks(path):
    """Elements of tracks.ply; None where the run recognized no places."""
    if not path.exists():
        return None
    elements = read_ply(path)
    with reading(path):
        points, seen = elements['vertex'], elements['observation']
        if len(seen) and not 0 <= seen['point'].min() <= seen['point'].max() < len(points):
            raise ValueError('an observation of a point that is not there')
        return points, seen


def tracks_of(tracks, segment):
    if tracks is None:
        return Tracks(np.empty((0, 3)), np.empty(0, int), np.empty(0, int), np.empty((0, 2)))
    points, seen = tracks
    chosen = points['segment'] == segment
    row_of = np.cumsum(chosen) - 1
    seen = seen[chosen[seen['point']]]
    return Tracks(np.stack([points[axis] for axis in 'xyz'], 1).astype(float)[chosen], row_of[seen['point']],
                  seen['keyframe'].copy(), np.stack([seen['u'], seen['v']], 1).astype(float))


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
    return {name: files for name, files in made.items() if name in EXPORTED and
            (files is None or isinstance(files, list) and all(isinstance(file, str) for file in files))}


def note_exports(folder, made):
    (folder / EXPORTS).unlink(missing_ok=True)  # which may be a link
    (folder / EXPORTS).write_text(json.dumps(made, sort_keys=True) + '\n', encoding='utf-8')


def is_folder(path):
    return path.is_dir() and not path.is_symlink()


def files_below(target):
    """Names, relative to a folder, of all files and links in it; what links lead to is not in it."""
    there = target.rglob('*') if is_folder(target) else ()
    return sorted(str(path.relative_to(target)) for path in there if not is_folder(path))


def remove_made(target, files):
    """What an export has made; what others have put there stays. With None for files all of the folder."""
    for name in files_below(target):
        if files is None or name in files:
            (target / name).unlink()
    if not is_folder(target):
        return
    for path in sorted([target, *target.rglob('*')], reverse=True):
        if is_folder(path) and not any(path.iterdir()):
            path.rmdir()


def new_folder(folder, name):
    """An empty folder in the output folder, in place of that of an earlier export. Raises ValueError where there is another."""
    target, made = folder / name, exported(folder)
    files = made.get(name, [])
    others = files is not None and set(files_below(target)) - set(files)
    if others or target.is_symlink() or (target.exists() and not target.is_dir()):
        raise ValueError(f'{target}: holds what no export has made; move it away, or choose another folder for the run')
    remove_made(target, files)
    target.mkdir(exist_ok=True)
    note_exports(folder, {**made, name: None})
    return target


def finish_folder(folder, name):
    """Notes what an export has made, which is all that is there."""
    note_exports(folder, {**exported(folder), name: files_below(folder / name)})


def remove_exports(folder):
    """Those of an earlier run."""
    for name, files in exported(folder).items():
        remove_made(folder / name, files)
    (folder / EXPORTS).unlink(missing_ok=True)
