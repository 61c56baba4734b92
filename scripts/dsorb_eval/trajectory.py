# SPDX-License-Identifier: BSD-3-Clause
"""Trajectories, ground truth and their alignment.

A pose is a 4x4 matrix T_world_cam (camera to world); a trajectory is an n x 8 array of TUM rows
`timestamp tx ty tz qx qy qz qw`, sorted by time. Angles leave this module in degrees."""
import csv
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

SAME_TIME = 2e-4  # [s] timestamps closer than this are one: half of the precision of the shortest files
MIN_GAP = 0.12  # [s] holes of the ground truth longer than this, and than 2.5 median steps, are not bridged
GAP_STEPS = 2.5


class FormatError(ValueError):
    """A file that is not what it should be; the message names it."""


def rotation_of(quaternion):
    """3x3 rotation of a quaternion (x, y, z, w), normalised here."""
    q = np.asarray(quaternion, float)
    x, y, z, w = q / np.linalg.norm(q)
    return np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                     [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                     [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]])


def quaternion_of(rotation):
    """Quaternion (x, y, z, w) of a 3x3 rotation, w not negative (Bar-Itzhack 2000: largest eigenvector)."""
    r = np.asarray(rotation, float)
    k = np.array([[r[0, 0] - r[1, 1] - r[2, 2], 0, 0, 0],
                  [r[1, 0] + r[0, 1], r[1, 1] - r[0, 0] - r[2, 2], 0, 0],
                  [r[2, 0] + r[0, 2], r[2, 1] + r[1, 2], r[2, 2] - r[0, 0] - r[1, 1], 0],
                  [r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], np.trace(r)]])
    q = np.linalg.eigh(k)[1][:, -1]  # eigh reads the lower triangle
    return q if q[3] >= 0 else -q


def pose_of(row):
    """4x4 pose of one TUM row."""
    pose = np.eye(4)
    pose[:3, :3] = rotation_of(row[4:8])
    pose[:3, 3] = row[1:4]
    return pose


def inverse(pose):
    """Inverse of a rigid 4x4 pose."""
    result = np.eye(4)
    result[:3, :3] = pose[:3, :3].T
    result[:3, 3] = -pose[:3, :3].T @ pose[:3, 3]
    return result


def row_of(timestamp, pose):
    """TUM row of a 4x4 pose."""
    return np.concatenate([[timestamp], pose[:3, 3], quaternion_of(pose[:3, :3])])


def rotation_angle(rotation):
    """Angle of a 3x3 rotation [deg]; by atan2, exact for small angles too."""
    axis = np.array([rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]])
    return math.degrees(math.atan2(np.linalg.norm(axis), np.trace(rotation) - 1))


def angle_between(a, b):
    """Angle between two vectors [deg]; None where one has no direction."""
    if not np.linalg.norm(a) or not np.linalg.norm(b):
        return None
    return math.degrees(math.atan2(np.linalg.norm(np.cross(a, b)), float(np.dot(a, b))))


def slerp(a, b, share):
    """Quaternion between a (share 0) and b (share 1) on the shorter way."""
    a, b = np.asarray(a) / np.linalg.norm(a), np.asarray(b) / np.linalg.norm(b)
    if np.dot(a, b) < 0:
        b = -b
    angle = 2 * math.atan2(np.linalg.norm(a - b), np.linalg.norm(a + b))
    if angle < 1e-9:
        return a
    return (math.sin((1 - share) * angle) * a + math.sin(share * angle) * b) / math.sin(angle)


def align(source, target):
    """Sim(3) with target ~ scale * rotation @ source + translation, least squares (Umeyama 1991, eq. 34-42).

    @param source, target  n x 3
    @return scale, 3x3 rotation, translation"""
    mean_source, mean_target = source.mean(0), target.mean(0)
    a, b = source - mean_source, target - mean_target
    u, d, vt = np.linalg.svd(b.T @ a / len(source))
    sign = np.diag([1, 1, -1 if np.linalg.det(u) * np.linalg.det(vt) < 0 else 1])
    rotation = u @ sign @ vt
    variance = (a ** 2).sum() / len(source)
    scale = float((d * np.diag(sign)).sum() / variance) if variance > 0 else 1.
    return scale, rotation, mean_target - scale * rotation @ mean_source


def tidy(rows):
    """Finite rows sorted by time, the first of each timestamp."""
    rows = np.array(rows, float).reshape(-1, 8)
    rows = rows[np.isfinite(rows).all(1)]
    rows = rows[np.argsort(rows[:, 0], kind='stable')]
    return rows[np.concatenate([[True], np.diff(rows[:, 0]) > 0])] if len(rows) else rows


def load_tum(path):
    """Trajectory of a TUM file; empty where the file is missing. Commas and comments are understood."""
    path, rows = Path(path), []
    if path.exists():
        for number, line in enumerate(path.read_text().splitlines(), 1):
            words = line.split('#')[0].replace(',', ' ').split()
            if not words:
                continue
            try:
                rows.append([float(word) for word in words[:8]])
            except ValueError:
                raise FormatError(f'{path}:{number}: expected 8 numbers `timestamp tx ty tz qx qy qz qw`') from None
            if len(rows[-1]) != 8:
                raise FormatError(f'{path}:{number}: expected 8 numbers, found {len(words)}')
    return tidy(rows)


def load_motions(path, segment):
    """Tracked poses of frames.csv relative to their keyframes, with covariances, as metrics.tracking_nees takes them;
    none in tables without these columns."""
    with open(path, newline='') as file:
        rows = list(csv.DictReader(file))
    times, motions = {row['index']: float(row['timestamp']) for row in rows}, []
    for row in rows:
        if row['state'] != 'tracked' or int(row['segment']) != segment or not row.get('cov_00') or row['keyframe'] not in times:
            continue
        pose = pose_of([0, *(float(row[f'rel_{name}']) for name in ('tx', 'ty', 'tz', 'qx', 'qy', 'qz', 'qw'))])
        covariance = [[float(row[f'cov_{min(i, j)}{max(i, j)}']) for j in range(6)] for i in range(6)]
        motions.append((float(row['timestamp']), times[row['keyframe']], pose, covariance))
    return motions


def load_kitti(path, timestamps):
    """Trajectory of a KITTI pose file (3x4 matrices, one line an image) with the times of those images."""
    poses = np.loadtxt(path, ndmin=2)
    if poses.shape[1] != 12:
        raise FormatError(f'{path}: expected 12 numbers a line, found {poses.shape[1]}')
    rows = []
    for timestamp, numbers in zip(timestamps, poses):
        pose = np.eye(4)
        pose[:3] = numbers.reshape(3, 4)
        rows.append(row_of(timestamp, pose))
    return tidy(rows)


def load_euroc(path, T_body_cam):
    """Trajectory of a camera from EuRoC's state estimates of the body (`#timestamp [ns], p, q wxyz, ...`)."""
    rows = []
    with open(path, newline='') as file:
        for words in csv.reader(file):
            if not words or words[0].startswith('#'):
                continue
            t, x, y, z, qw, qx, qy, qz = (float(word) for word in words[:8])
            T_world_body = pose_of([0, x, y, z, qx, qy, qz, qw])
            rows.append(row_of(t * 1e-9, T_world_body @ T_body_cam))
    return tidy(rows)


@dataclass
class GroundTruth:
    """True poses of the camera; between two of them positions are interpolated linearly, rotations by slerp
    ([Gladkova], section 4.1, does so for EuRoC)."""
    rows: np.ndarray

    def __post_init__(self):
        self.times = self.rows[:, 0]
        steps = np.diff(self.times)
        self.max_gap = max(MIN_GAP, GAP_STEPS * float(np.median(steps))) if len(steps) else 0.

    def pose(self, timestamp):
        """4x4 T_world_cam, None outside the ground truth or in a hole of it."""
        after = int(np.searchsorted(self.times, timestamp))
        for i in (after - 1, after):
            if 0 <= i < len(self.times) and abs(self.times[i] - timestamp) < SAME_TIME:
                return pose_of(self.rows[i])
        if after == 0 or after >= len(self.times) or self.times[after] - self.times[after - 1] > self.max_gap:
            return None
        a, b = self.rows[after - 1], self.rows[after]
        share = (timestamp - a[0]) / (b[0] - a[0])
        return pose_of(np.concatenate([[timestamp], (1 - share) * a[1:4] + share * b[1:4], slerp(a[4:8], b[4:8], share)]))

    def path_length(self, timestamps):
        """Way through the true positions at these times, in their order of time."""
        poses = [self.pose(t) for t in sorted(timestamps)]
        points = np.array([pose[:3, 3] for pose in poses if pose is not None]).reshape(-1, 3)
        return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())

    def matched(self, trajectory):
        """The rows of a trajectory that have a true pose, and those poses as rows of the same times."""
        pairs = [(row, self.pose(row[0])) for row in trajectory]
        pairs = [(row, row_of(row[0], pose)) for row, pose in pairs if pose is not None]
        return (np.array([p[0] for p in pairs]).reshape(-1, 8), np.array([p[1] for p in pairs]).reshape(-1, 8))


def save_tum(path, rows):
    """Writes a trajectory as TUM file, nine decimals."""
    Path(path).write_text(''.join(' '.join(f'{value:.9f}' for value in row) + '\n' for row in rows))
