# SPDX-License-Identifier: BSD-3-Clause
"""Recordings of runs (docs/formats.md), read whole or while they grow."""
import json
import time
from pathlib import Path

import numpy as np

from .trajectory import FormatError, pose_of

FORMAT, VERSION = 'dsorb-recording', 1
POLL = .1  # [s] between looks at a growing file


def complete_lines(path, follow, patience):
    """Lines of a file with their numbers; with `follow` those too that come later, until none came for `patience` seconds."""
    rest, number, last = b'', 0, time.monotonic()
    while not path.exists():
        if not follow or time.monotonic() - last > patience:
            raise FileNotFoundError(f'{path}: no such recording')
        time.sleep(POLL)
    with open(path, 'rb') as file:
        while True:
            piece = file.read(1 << 20)
            if piece:
                last = time.monotonic()
                *lines, rest = (rest + piece).split(b'\n')
                for line in lines:
                    number += 1
                    yield number, line
            elif not follow or time.monotonic() - last > patience:
                return  # an unfinished last line is of a run that was killed
            else:
                time.sleep(POLL)


def events(path, follow=False, patience=60.):
    """Events of a recording, in order, as dicts; ends after `end`.

    @throws FormatError naming file and line, FileNotFoundError"""
    path = Path(path)
    for number, line in complete_lines(path, follow, patience):
        try:
            event = json.loads(line)
            kind = event['kind']
        except (ValueError, KeyError, TypeError):
            raise FormatError(f'{path}:{number}: expected one JSON object with `kind`') from None
        if number == 1 and (kind != 'header' or event.get('format') != FORMAT or event.get('version') != VERSION):
            raise FormatError(f'{path}:1: expected the header of a {FORMAT}, version {VERSION}')
        yield event
        if kind == 'end':
            return


def find(path):
    """The recording meant by a file or a folder of a run. @throws FileNotFoundError saying how to make one"""
    path = Path(path)
    if not path.is_dir():
        return path
    found = sorted(path.glob('*.jsonl'))
    if len(found) == 1:
        return found[0]
    what = 'several recordings; name one of them' if found else \
        f'no recording (*.jsonl); make one with `dso_dataset ... --record {path / "recording.jsonl"}`'
    raise FileNotFoundError(f'{path}: {what}')


def pose(seven):
    """4x4 T_world_cam of a recording's pose."""
    return pose_of([0, *seven])


def world_points(points, T_world_cam, camera):
    """Points of a keyframe in the world of its segment.

    @param points  n x 5: u, v, inverse depth, variance, grey level; inverse depths positive
    @return n x 3"""
    points = np.asarray(points, float).reshape(-1, 5)
    rays = np.stack([(points[:, 0] - camera['cx']) / camera['fx'], (points[:, 1] - camera['cy']) / camera['fy'],
                     np.ones(len(points))], axis=1)
    return (rays / points[:, 2:3]) @ T_world_cam[:3, :3].T + T_world_cam[:3, 3]


def certain(points, max_relative_sigma):
    """The points in front of the camera whose inverse depth is known to this share of itself."""
    points = np.asarray(points, float).reshape(-1, 5)
    keep = (points[:, 2] > 0) & (np.sqrt(np.maximum(points[:, 3], 0)) <= max_relative_sigma * points[:, 2])
    return points[keep]
