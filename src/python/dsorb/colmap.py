# SPDX-License-Identifier: BSD-3-Clause
"""A COLMAP model, text and binary: cameras, images, points3D (https://colmap.github.io/format.html). A corner that was followed
has the observations of all keyframes that see it; a point of the map has none, because an adjustment must not take it for one
that a single image fixes."""
import struct
from dataclasses import dataclass

import numpy as np

from .pictures import PicturesError, calibration_of
from .run_folder import TEXT

HALF_PIXEL = 0.5  # the centre of COLMAP's top-left pixel is (0.5, 0.5)
UNKNOWN_ERROR = -1.0
CAMERA = 1  # its number


@dataclass
class Sights:
    """Who sees points from the row `first` on: (m,) rows, (m,) indices of images, (m, 3) rays."""
    first: int
    rows: np.ndarray
    images: np.ndarray
    rays: np.ndarray


def camera_of(lens):
    """Name, number and parameters of COLMAP's model for a lens of run.json. Raises PicturesError where it has none."""
    focal = [lens['fx'], lens['fy'], lens['cx'] + HALF_PIXEL, lens['cy'] + HALF_PIXEL]
    c = lens['coefficients']
    if lens['model'] == 'pinhole':
        return 'PINHOLE', 1, focal
    if lens['model'] == 'fov':
        return 'FOV', 7, focal + c
    if lens['model'] == 'equidistant':
        return 'OPENCV_FISHEYE', 5, focal + c
    if lens['model'] not in ('radtan', 'rational'):
        raise PicturesError(f'COLMAP has no lens of the model {lens["model"]}: export with --undistort')
    if not any(c[4:]):
        return 'OPENCV', 4, focal + c[:4]
    return 'FULL_OPENCV', 6, focal + (c + [0.0, 0.0, 0.0])[:8]


def world_to_camera(frame):
    """Quaternion w x y z and translation of T_cam_world."""
    pose = frame.T_world_cam
    x, y, z, w = frame.quaternion / np.linalg.norm(frame.quaternion)
    return [w, -x, -y, -z], list(-pose[:3, :3].T @ pose[:3, 3])


def observations(frames, sights, pictures):
    """Yields for every frame its (m, 2) pixels, with half a pixel added, and the (m,) rows of the points that they show."""
    pixels = calibration_of(pictures.lens).project(sights.rays) + HALF_PIXEL
    seen = np.isfinite(pixels).all(1) & np.isin(sights.images, [frame.index for frame in frames])
    seen &= np.bincount(sights.rows[seen], minlength=sights.rows.max(initial=0) + 1)[sights.rows] > 1  # one image fixes no point
    for frame in frames:
        here = seen & (sights.images == frame.index)
        yield pixels[here], sights.rows[here]


def write_model(folder, frames, points, sights, pictures):
    folder.mkdir(parents=True)
    name, number, parameters = camera_of(pictures.lens)
    size = pictures.lens['width'], pictures.lens['height']
    seen = list(observations(frames, sights, pictures))
    # (image, position in the image) of those that see each row of `points`; images have numbers from 1.
    tracks = {row: [] for row in range(sights.first)}
    for frame, (_, rows) in zip(frames, seen):
        for place, row in enumerate(rows.tolist()):
            tracks.setdefault(row, []).append((frame.index + 1, place))
    with (folder / 'cameras.txt').open('w') as file:
        file.write(f'{CAMERA} {name} {size[0]} {size[1]} ' + ' '.join(repr(float(p)) for p in parameters) + '\n')
    (folder / 'cameras.bin').write_bytes(struct.pack('<QiiQQ', 1, CAMERA, number, *size) +
                                         struct.pack(f'<{len(parameters)}d', *parameters))
    write_images(folder, frames, seen, pictures)
    write_points(folder, points, tracks)


def write_images(folder, frames, seen, pictures):
    with (folder / 'images.txt').open('w', **TEXT) as text, (folder / 'images.bin').open('wb') as binary:
        binary.write(struct.pack('<Q', len(frames)))
        for frame, (pixels, rows) in zip(frames, seen):
            quaternion, translation = world_to_camera(frame)
            name = pictures.names[frame.index]
            pose = ' '.join(repr(float(value)) for value in (*quaternion, *translation))
            text.write(f'{frame.index + 1} {pose} {CAMERA} {name}\n')
            text.write(' '.join(f'{u:.4f} {v:.4f} {row + 1}' for (u, v), row in zip(pixels, rows)) + '\n')
            binary.write(struct.pack('<i7di', frame.index + 1, *quaternion, *translation, CAMERA) + name.encode(**TEXT) + b'\0')
            binary.write(struct.pack('<Q', len(rows)))
            binary.write(b''.join(struct.pack('<ddq', u, v, row + 1) for (u, v), row in zip(pixels, rows)))


def write_points(folder, points, tracks):
    with (folder / 'points3D.txt').open('w') as text, (folder / 'points3D.bin').open('wb') as binary:
        binary.write(struct.pack('<Q', len(tracks)))
        for row, track in sorted(tracks.items()):
            position, colour = points.positions[row], points.colours[row]
            text.write(f'{row + 1} ' + ' '.join(repr(float(x)) for x in position) + ' ' + ' '.join(map(str, colour)) +
                       f' {UNKNOWN_ERROR} ' + ' '.join(f'{image} {place}' for image, place in track) + '\n')
            binary.write(struct.pack('<Q3d3BdQ', row + 1, *position, *colour, UNKNOWN_ERROR, len(track)))
            binary.write(b''.join(struct.pack('<ii', *sight) for sight in track))
