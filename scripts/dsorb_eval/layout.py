# SPDX-License-Identifier: BSD-3-Clause
"""What the evaluation must know of a data set without running the program: times of its images, ground truth, depth.

The layouts are those of `dso_dataset --format`: dso, kitti, euroc, tum, images; auto recognises them in its order."""
import zipfile
from pathlib import Path

import numpy as np
import yaml
from PIL import Image

from . import trajectory as tr

IMAGE_SUFFIXES = {'.png', '.jpg', '.jpeg', '.pgm', '.ppm', '.bmp', '.tif', '.tiff'}
DEFAULT_INTERVAL = 0.1  # [s] between images without times, as in dso_dataset
MILLIMETRES = 1000.


def image_names(folder):
    """Sorted names of the images in a folder or archive."""
    if folder.suffix.lower() == '.zip':
        with zipfile.ZipFile(folder) as archive:
            names = archive.namelist()
    else:
        names = [entry.name for entry in folder.iterdir()]
    return sorted(name for name in names if Path(name).suffix.lower() in IMAGE_SUFFIXES)


def first_existing(*paths):
    return next((path for path in paths if path.exists()), None)


def find_euroc(path):
    return next((f / 'data.csv' for f in (path / 'mav0/cam0', path / 'cam0', path) if (f / 'data.csv').exists()), None)


def find_kitti(path):
    if path.name in ('image_0', 'image_1', 'image_2', 'image_3'):
        return path
    return first_existing(*(path / f'image_{n}' for n in (0, 2, 1, 3)))


def find_tum(path):
    return first_existing(path / 'rgb.txt')


def find_dso(path):
    if path.suffix.lower() == '.zip':
        return path
    return first_existing(path / 'images', path / 'images.zip')


def find_images(path):
    return path if path.is_dir() and image_names(path) else None


FINDERS = dict(euroc=find_euroc, kitti=find_kitti, tum=find_tum, dso=find_dso, images=find_images)
FORMATS = ('auto', *FINDERS)


def recognise(path, layout='auto'):
    """Name of the layout and the file or folder that lists the images.

    @throws FormatError naming what was looked for"""
    if not path.exists():
        raise tr.FormatError(f'{path}: no such file or folder')
    for name, find in FINDERS.items():
        found = find(path) if layout in ('auto', name) else None
        if found:
            return name, found
    raise tr.FormatError(f'{path}: no data set of format {layout} (one of {", ".join(FORMATS)})')


def table_column(path, column, separator=None):
    """One column of a text table as strings, comments left out."""
    lines = (line.split('#')[0].strip() for line in path.read_text().splitlines())
    return [line.split(separator)[column].strip() for line in lines if line]


def timestamps(path, layout='auto'):
    """Times of all images [s], by position in the sequence."""
    name, found = recognise(path, layout)
    if name == 'euroc':
        return [int(t) * 1e-9 for t in table_column(found, 0, ',')]
    if name == 'tum':
        return [float(t) for t in table_column(found, 0)]
    count = len(image_names(found))
    times = first_existing(found.parent / 'times.txt', found / 'times.txt') if found.suffix.lower() != '.zip' else found.parent / 'times.txt'
    if times is None or not times.exists():
        return [DEFAULT_INTERVAL * i for i in range(count)]
    values = [float(t) for t in table_column(times, 0 if name == 'kitti' else 1)]
    if len(values) < count:
        raise tr.FormatError(f'{times}: {len(values)} times for {count} images')
    return values[:count]


def default_ground_truth(path, layout='auto'):
    """Ground truth where data sets keep it; None where there is none."""
    name, found = recognise(path, layout)
    base = path.parent if path.is_file() else path
    candidates = [base / 'groundtruth.txt']
    if name == 'kitti':
        sequence = found.parent
        candidates.append(sequence.parent.parent / 'poses' / f'{sequence.name}.txt')
    if name == 'euroc':
        candidates.append(found.parent.parent / 'state_groundtruth_estimate0' / 'data.csv')
    return first_existing(*candidates)


def load_ground_truth(file, path, layout='auto'):
    """GroundTruth of a TUM, KITTI or EuRoC file; None where `file` is None or holds fewer than three poses.

    @throws FormatError, OSError"""
    if file is None:
        return None
    with open(file) as stream:
        words = next((line.replace(',', ' ').split() for line in stream if line.strip() and not line.startswith('#')), [])
    if file.suffix == '.csv':
        _, listing = recognise(path, layout)
        camera = yaml.safe_load((listing.parent / 'sensor.yaml').read_text().replace('%YAML:1.0', ''))
        rows = tr.load_euroc(file, np.array(camera['T_BS']['data'], float).reshape(4, 4))
    elif len(words) == 12:
        rows = tr.load_kitti(file, timestamps(path, layout))
    else:
        rows = tr.load_tum(file)
    return tr.GroundTruth(rows) if len(rows) >= 3 else None


def true_depth(path, index):
    """True depth of an image [m], NaN where unknown: folder depth/ with 16-bit millimetres; None without one.

    @return depth image, (fx, fy, cx, cy) of it"""
    folder, calibration = path / 'depth', path / 'camera.txt'
    if not folder.is_dir() or not calibration.exists():
        return None
    names = image_names(folder)
    if index >= len(names):
        return None
    with Image.open(folder / names[index]) as image:
        depth = np.array(image, float) / MILLIMETRES
    depth[depth <= 0] = np.nan
    return depth, depth_camera(calibration, depth.shape)


def depth_camera(calibration, shape):
    """(fx, fy, cx, cy) of a camera.txt; values below one are shares of the image size (DSO's relative form)."""
    words = calibration.read_text().split('\n')[0].split()
    numbers = [float(word) for word in words if not word.isalpha()][:4]
    if numbers[2] < 1 and numbers[3] < 1:
        height, width = shape
        return [numbers[0] * width, numbers[1] * height, numbers[2] * width - .5, numbers[3] * height - .5]
    return numbers
