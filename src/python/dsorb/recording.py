# SPDX-License-Identifier: BSD-3-Clause
"""Recordings of runs (docs/formats.md), read whole or while they grow."""
from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Optional, Union

import numpy as np

from .run_folder import rotation_of

FORMAT, VERSION = 'dsorb-recording', 1
POLL = .1  # [s] between looks at a growing file
PATIENCE = 60.0  # [s] without news of a run that somebody else started


class FormatError(ValueError):
    """A recording that is not one; the message names file and line."""


def change_time(path: Path) -> Optional[int]:
    """@return of a file [ns]; None where it is not there"""
    try:
        return path.stat().st_mtime_ns
    except OSError:
        return None


def patient(seconds: float = PATIENCE) -> Callable[[bool], bool]:
    """Whether to wait on for a run that somebody else started: until nothing came for `seconds`."""
    last = time.monotonic()

    def going(news: bool) -> bool:
        nonlocal last
        last = time.monotonic() if news else last
        return time.monotonic() - last < seconds
    return going


def complete_lines(path: Path, going: Optional[Callable[[bool], bool]]) -> Iterator[tuple[int, bytes]]:
    """Lines of a file with their numbers; as long as `going`, told whether something came, says so, those too that come later."""
    rest, number = b'', 0
    while not path.exists():
        if going is None or not going(False):
            raise FileNotFoundError(f'{path}: no such recording')
        time.sleep(POLL)
    with open(path, 'rb') as file:
        while True:
            goes_on = going is not None and going(False)  # asked before reading: what was written until then is read
            piece = file.read(1 << 20)
            if piece:
                if going is not None:
                    going(True)
                *lines, rest = (rest + piece).split(b'\n')
                for line in lines:
                    number += 1
                    yield number, line
            elif not goes_on:
                return  # an unfinished last line is of a run that was killed
            else:
                time.sleep(POLL)


def events(path: Union[str, Path], going: Optional[Callable[[bool], bool]] = None) -> Iterator[dict[str, Any]]:
    """Events of a recording, in order; ends after `end`. `going`: see complete_lines.

    Raises FormatError naming file and line, FileNotFoundError."""
    path = Path(path)
    for number, line in complete_lines(path, going):
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


def find(path: Union[str, Path]) -> Path:
    """The recording meant by a file or a folder of a run. Raises FileNotFoundError saying how to make one."""
    path = Path(path)
    if not path.is_dir():
        return path
    found = sorted(path.glob('*.jsonl'))
    if len(found) == 1:
        return found[0]
    what = 'several recordings; name one of them' if found else \
        f'no recording (*.jsonl); make one with `dsorb run ... --record {path / "recording.jsonl"}`'
    raise FileNotFoundError(f'{path}: {what}')


def pose(seven: list) -> np.ndarray:
    """(4, 4) T_world_cam of a recording's pose."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation_of(seven[3:]), seven[:3]
    return matrix


def world_points(points: Any, T_world_cam: np.ndarray, camera: dict) -> np.ndarray:
    """(n, 3): points of a keyframe, n x 5 of u, v, inverse depth (positive), variance, grey level, in the world of its segment."""
    points = np.asarray(points, float).reshape(-1, 5)
    rays = np.stack([(points[:, 0] - camera['cx']) / camera['fx'], (points[:, 1] - camera['cy']) / camera['fy'],
                     np.ones(len(points))], axis=1)
    return (rays / points[:, 2:3]) @ T_world_cam[:3, :3].T + T_world_cam[:3, 3]


def certain(points: Any, max_relative_sigma: float) -> np.ndarray:
    """The points in front of the camera whose inverse depth is known to this share of itself."""
    points = np.asarray(points, float).reshape(-1, 5)
    keep = (points[:, 2] > 0) & (np.sqrt(np.maximum(points[:, 3], 0)) <= max_relative_sigma * points[:, 2])
    return points[keep]
