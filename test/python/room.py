# SPDX-License-Identifier: BSD-3-Clause
"""A rendered room with its truth, made once for all tests of a process."""
import atexit
import os
import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image

SIZE = 320, 240  # [px]
FRAMES = 40
MILLIMETRES = 1000  # of the depth images

_folders = {}


def temporary_folder():
    folder = Path(tempfile.mkdtemp(prefix='dsorb_'))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder


def render(name, *arguments):
    """Folder with images/, camera.txt, groundtruth.txt, depth/."""
    if name not in _folders:
        _folders[name] = temporary_folder() / name
        subprocess.run([os.environ['DSO_SYNTHESIZE'], 'room', '--output', _folders[name], '--frames', str(FRAMES),
                        '--width', str(SIZE[0]), '--height', str(SIZE[1]), '--quiet', *arguments], check=True)
    return _folders[name]


def room():
    return render('room')


def room_run():
    """Output folder of a run over the room."""
    if 'run' not in _folders:
        from dsorb.command_line import program
        _folders['run'] = temporary_folder() / 'out'
        subprocess.run([program(), room(), '--output', _folders['run'], '--quiet'], check=True)
    return _folders['run']


def image_files(folder=None):
    return sorted(((folder or room()) / 'images').iterdir())


def images(folder=None):
    return [np.asarray(Image.open(file)) for file in image_files(folder)]


def true_poses():
    """(n, 4, 4): camera to world."""
    from dsorb.run_folder import PosedFrame
    rows = np.loadtxt(room() / 'groundtruth.txt')
    return np.array([PosedFrame(i, '', '', False, row[1:4], row[4:8]).T_world_cam for i, row in enumerate(rows)])


def true_depth(index):
    return np.asarray(Image.open(sorted((room() / 'depth').iterdir())[index])) / MILLIMETRES


def true_correspondences(first, second, camera, pixels):
    """(n, 2) pixels of one image to those of another one by exact depth and poses; NaN where depth is not known."""
    u, v = np.rint(pixels).astype(int).T
    depth = np.where(true_depth(first)[v, u] > 0, true_depth(first)[v, u], np.nan)
    rays = np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones(len(u))], 1)
    poses = true_poses()
    motion = np.linalg.inv(poses[second]) @ poses[first]
    points = (rays * depth[:, None]) @ motion[:3, :3].T + motion[:3, 3]
    return points[:, :2] / points[:, 2:] * [camera.fx, camera.fy] + [camera.cx, camera.cy]
