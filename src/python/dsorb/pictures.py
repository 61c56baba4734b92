# SPDX-License-Identifier: BSD-3-Clause
"""The images of a run, for programs that want them beside the poses: found where they lie, or taken out of a video or
an archive, or undistorted. Needs OpenCV's Python module (`pip install dsorb[images]`) where pixels are touched."""
import os
import re
import subprocess
import tempfile
import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ._dsorb import Calibration
from .run_folder import finish_folder, new_folder

JPEG_QUALITY = 95
JPEG_SUFFIXES = ('.jpg', '.jpeg')
EXIF_IFD, FOCAL_LENGTH_35MM = 0x8769, 0xA405


class PicturesError(ValueError):
    """Images that cannot be had; the message says why and what to do."""


@dataclass
class Pictures:
    folder: Path  # that names refer to
    names: dict  # of the images by their index
    lens: dict  # as `lens` in run.json, that of these images

    def file(self, index):
        return self.folder / self.names[index]


def opencv(reason):
    try:
        import cv2
    except ImportError:
        raise PicturesError(f'{reason} needs OpenCV: pip install opencv-python-headless') from None
    return cv2


def program():
    """The dso_dataset that came with the package."""
    return Path(__file__).parent / 'bin' / ('dso_dataset.exe' if os.name == 'nt' else 'dso_dataset')


def pinhole(camera):
    """The rectified camera in the form of a lens."""
    return dict(camera, model='pinhole', coefficients=[])


def calibration_of(lens):
    """Calibration of a lens of run.json."""
    return Calibration(lens['fx'], lens['fy'], lens['cx'], lens['cy'], lens['width'], lens['height'], lens['model'],
                       lens['coefficients'])


def lens_of(run):
    """Lens of the images as they were taken. Raises PicturesError where poses belong to another one."""
    if 'lens' not in run.summary:
        raise PicturesError(f'{run.folder / "run.json"}: no `lens`; run again')
    lens = run.summary['lens']
    if 'refined_camera' not in run.summary:
        return lens
    if lens['model'] != 'pinhole':
        raise PicturesError('the run refined its camera, which is that of undistorted images: export with --undistort')
    return refined_lens(lens, run.summary['camera'], run.camera)


def refined_lens(lens, camera, refined):
    """Lens of the images as they were taken, where they were taken for those of the pinhole `lens`, rectified for `camera`."""
    sx, sy = lens['fx'] / camera['fx'], lens['fy'] / camera['fy']
    k1 = refined.get('k1', 0)
    return dict(lens, model='radtan' if k1 else 'pinhole', coefficients=[k1, 0, 0, 0, 0] if k1 else [],
                fx=sx * refined['fx'], fy=sy * refined['fy'],
                cx=lens['cx'] + sx * (refined['cx'] - camera['cx']), cy=lens['cy'] + sy * (refined['cy'] - camera['cy']))


def find_pictures(run, indices):
    """Image files where they lie; None where they are not files or not there any more."""
    files = {row.index: Path(row.image) for row in run.rows if row.index in indices}
    if not files or not all(file.is_file() for file in files.values()):
        return None
    folder = Path(os.path.commonpath([file.parent for file in files.values()]))
    return Pictures(folder, {index: file.relative_to(folder).as_posix() for index, file in files.items()}, lens_of(run))


def make_pictures(run, indices, undistort):
    """Writes the images of these indices to the folder `images` of the run: those of videos and archives, undistorted ones."""
    cv2 = opencv('taking images out of videos and archives, and undistorting them,')
    lens = run.summary.get('lens') if undistort else lens_of(run)
    if lens is None:
        raise PicturesError(f'{run.folder / "run.json"}: no `lens`; run again')
    camera = run.summary['camera']
    maps = rectifying_maps(lens, camera, run.camera) if undistort else None
    folder, names = new_folder(run.folder, 'images'), {}
    for index, image in decoded(cv2, run, indices):
        if image.shape[:2] != (lens['height'], lens['width']):
            raise PicturesError(f'image {index}: {image.shape[1]}x{image.shape[0]} px, the run had '
                                f'{lens["width"]}x{lens["height"]}')
        if maps is not None:
            image = cv2.remap(image, *maps, cv2.INTER_LINEAR)
        names[index] = f'{index:06d}.jpg'
        if not cv2.imwrite(str(folder / names[index]), image, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]):
            raise PicturesError(f'{folder / names[index]}: cannot be written')
    missing = set(indices) - set(names)
    if missing:
        raise PicturesError(f'{run.dataset}: ends before image {min(missing)}')
    finish_folder(run.folder, folder.name)
    return Pictures(folder, names, pinhole(run.camera) if undistort else lens)


def rectifying_maps(lens, camera, refined):
    """Pixels of the images as taken, (height, width) each, for every pixel of the rectified camera as it was refined."""
    u, v = np.meshgrid(np.arange(camera['width']), np.arange(camera['height']))
    if refined.get('k1'):
        u, v = bent(u, v, refined)
    rays = np.stack([(u - camera['cx']) / camera['fx'], (v - camera['cy']) / camera['fy'], np.ones(u.shape)], 2)
    pixels = calibration_of(lens).project(rays.reshape(-1, 3)).reshape(*u.shape, 2).astype(np.float32)
    pixels[np.isnan(pixels)] = -1e4  # black
    return pixels[..., 0], pixels[..., 1]


def bent(u, v, camera):
    """Where the rectified images of a refined camera show what its pinhole model sees at (u, v) [px]."""
    x, y = (u - camera['cx']) / camera['fx'], (v - camera['cy']) / camera['fy']
    factor = 1 + camera['k1'] * (x * x + y * y)
    return camera['fx'] * x * factor + camera['cx'], camera['fy'] * y * factor + camera['cy']


def decoded(cv2, run, indices):
    """(index, image) of every wanted image that can be had, in ascending order."""
    files = {row.index: row.image for row in run.rows if row.index in indices}
    if all(files.values()):
        for index in sorted(files):
            yield index, decoded_file(cv2, files[index])
        return
    if not Path(run.dataset).is_file():
        raise PicturesError(f'{run.dataset}: no file; cameras leave no images behind')
    with Video(run.dataset) as video:
        for index in sorted(indices):
            found = video.image(index)
            if found is None:
                return
            yield index, found[0]


class Video:
    """Images of a video as `dso_dataset` decodes it, upright: those that a run tracks. Raises PicturesError where it cannot."""

    def __init__(self, path):
        self.errors = tempfile.TemporaryFile()
        self.program = subprocess.Popen([str(program()), str(path), '--format', 'video', '--serve-images'], stdin=subprocess.PIPE,
                                        stdout=subprocess.PIPE, stderr=self.errors)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.program.kill()
        self.program.communicate()
        self.errors.close()

    def image(self, index):
        """(height, width, 3) of BGR, and how far it was turned clockwise [degrees]; None after the last one. Indices ascend."""
        try:
            self.program.stdin.write(b'%d\n' % index)
            self.program.stdin.flush()
        except OSError:
            return self.end()
        if self.program.stdout.readline() != b'P6\n':
            return self.end()
        turn = int(self.program.stdout.readline().split()[-1])
        width, height = map(int, self.program.stdout.readline().split())
        self.program.stdout.readline()
        data = self.program.stdout.read(width * height * 3)
        return np.ascontiguousarray(np.frombuffer(data, np.uint8).reshape(height, width, 3)[..., ::-1]), turn

    def end(self):
        if self.program.wait() != 0:
            self.errors.seek(0)
            raise PicturesError(self.errors.read().decode('utf-8', 'replace').strip())


def decoded_file(cv2, name):
    packed = re.match(rf'(.*?\.zip){re.escape(os.sep)}(.*)', name, re.DOTALL | re.IGNORECASE)
    try:
        if packed and not os.path.isfile(name):
            with zipfile.ZipFile(packed[1]) as file:
                data = file.read(packed[2])
        else:
            data = Path(name).read_bytes()
    except (OSError, KeyError, zipfile.BadZipFile) as error:
        raise PicturesError(f'{name}: {error}') from None
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
    if image is None:
        raise PicturesError(f'{name}: cannot be decoded')
    return image


def colours_of(pictures, run, points):
    """(n, 3) red, green, blue of a segment's points, from the images of their hosts; None without OpenCV."""
    try:
        cv2 = opencv('colour')
    except PicturesError:
        return None
    calibration = calibration_of(pictures.lens)
    poses = {frame.index: frame.T_world_cam for segment in run.segments for frame in segment.frames}
    colours = points.colours.copy()
    for host in np.unique(points.keyframes):
        if host not in pictures.names:
            continue
        image, chosen = decoded_file(cv2, str(pictures.file(host))), points.keyframes == host
        pixels = calibration.project(to_camera(poses[host], points.positions[chosen]))
        x, y = (np.clip(np.rint(np.nan_to_num(pixels[:, axis])), 0, image.shape[1 - axis] - 1).astype(int) for axis in (0, 1))
        colours[chosen] = image[y, x, ::-1]
    return colours


def view_of_exif(source):
    """What photographs show from left to right [degrees], by the focal length that the first one of a folder notes.

    Equivalents in 35 mm are those of the diagonal (CIPA DCG-001). Raises PicturesError where nothing is noted."""
    try:
        from PIL import Image
    except ImportError:
        raise PicturesError('reading EXIF data needs Pillow: pip install Pillow') from None
    folders = [Path(source), Path(source) / 'images']
    files = [f for folder in folders if folder.is_dir() for f in sorted(folder.iterdir()) if f.suffix.lower() in JPEG_SUFFIXES]
    if not files:
        raise PicturesError(f'{source}: no folder of JPEG files, which note a focal length')
    with Image.open(files[0]) as image:
        focal, (width, height) = image.getexif().get_ifd(EXIF_IFD).get(FOCAL_LENGTH_35MM), image.size
    if not focal:
        raise PicturesError(f'{files[0]}: notes no focal length in 35 mm terms; expected the EXIF entry FocalLengthIn35mmFilm')
    half = np.hypot(36, 24) / 2 * width / np.hypot(width, height)  # [mm]
    return float(np.degrees(2 * np.arctan(half / focal)))


def to_camera(T_world_cam, positions):
    """(n, 3) world coordinates to camera coordinates."""
    return np.ascontiguousarray((positions - T_world_cam[:3, 3]) @ T_world_cam[:3, :3])
