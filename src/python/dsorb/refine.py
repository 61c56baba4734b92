# SPDX-License-Identifier: BSD-3-Clause
"""Poses of a segment refined by COLMAP: features of its own, triangulated with our poses, then all adjusted together.
Needs pycolmap (BSD-3; `pip install pycolmap`)."""
import sqlite3
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from .colmap import HALF_PIXEL, camera_of
from .pictures import PicturesError
from .run_folder import Points, rotation_of

MOST_EXHAUSTIVE = 40  # images; of more only neighbours are matched
LEAST_POINTS = 50
OLDEST = 4  # version of pycolmap whose interface is used


class TooFewPoints(PicturesError):
    """COLMAP found too little to adjust."""


@dataclass
class Refined:
    frames: list  # PosedFrame, in the world and unit of the segment
    points: Points
    lens: dict
    model: object  # pycolmap.Reconstruction, in the same world and unit
    note: str


def refine(frames, pictures, focal=False):
    """Refines poses and, with `focal`, the focal length. Raises TooFewPoints, and PicturesError without pycolmap."""
    try:
        import pycolmap
    except ImportError:
        raise PicturesError('--refine needs pycolmap: pip install pycolmap') from None
    if int(pycolmap.__version__.split('.')[0]) < OLDEST:
        raise PicturesError(f'--refine needs pycolmap {OLDEST} or newer, found {pycolmap.__version__}')
    pycolmap.logging.minloglevel = pycolmap.logging.ERROR
    with tempfile.TemporaryDirectory() as name:
        model = triangulated(pycolmap, Path(name), frames, pictures)
    if model.num_points3D() < LEAST_POINTS:
        raise TooFewPoints(f'--refine: COLMAP triangulated {model.num_points3D()} points; expected {LEAST_POINTS} or more')
    before = reprojection_error(model)
    options = pycolmap.BundleAdjustmentOptions()
    options.refine_extra_params = options.print_summary = False
    options.refine_focal_length = focal
    pycolmap.bundle_adjustment(model, options)
    images = {image.name: image for image in model.images.values()}
    names = [pictures.names[frame.index] for frame in frames]
    model.transform(laid_over(pycolmap, [images[n] for n in names], frames))
    model.extract_colors_for_all_images(str(pictures.folder))
    refined = [posed(frame, images[n]) for frame, n in zip(frames, names)]
    return Refined(refined, points_of(model, {n: f.index for n, f in zip(names, frames)}),
                   lens_after(model, pictures.lens), model, note(frames, refined, model, before, pictures.lens))


def triangulated(pycolmap, folder, frames, pictures):
    """COLMAP's points in the cameras of our poses, which stay."""
    database, names = folder / 'database.db', [pictures.names[frame.index] for frame in frames]
    model_name, _, parameters = camera_of(pictures.lens)
    reader = pycolmap.ImageReaderOptions()
    reader.camera_model, reader.camera_params = model_name, ','.join(repr(float(p)) for p in parameters)
    pycolmap.extract_features(database, pictures.folder, image_names=names, camera_mode=pycolmap.CameraMode.SINGLE,
                              reader_options=reader)
    (pycolmap.match_exhaustive if len(names) <= MOST_EXHAUSTIVE else pycolmap.match_sequential)(database)
    with sqlite3.connect(database) as connection:
        numbers = dict(connection.execute('SELECT name, image_id FROM images'))
        camera = connection.execute('SELECT camera_id FROM cameras').fetchone()[0]
    connection.close()
    write_poses(folder, camera, [(numbers[n], n, frame) for n, frame in zip(names, frames)], pictures.lens)
    model = pycolmap.Reconstruction()
    model.read_text(str(folder))
    return pycolmap.triangulate_points(model, database, pictures.folder, folder)


def write_poses(folder, camera, numbered, lens):
    """A model without points whose images have the numbers of the database."""
    from .colmap import world_to_camera
    name, _, parameters = camera_of(lens)
    words = [camera, name, lens['width'], lens['height'], *map(float, parameters)]
    (folder / 'cameras.txt').write_text(' '.join(map(str, words)) + '\n', encoding='utf-8')
    lines = []
    for number, file, frame in numbered:
        quaternion, translation = world_to_camera(frame)
        lines += [' '.join(map(str, (number, *map(float, quaternion), *map(float, translation), camera, file))), '']
    (folder / 'images.txt').write_text('\n'.join(lines) + '\n', encoding='utf-8')
    (folder / 'points3D.txt').write_text('', encoding='utf-8')


def laid_over(pycolmap, images, frames):
    """Similarity from the adjusted world to that of the frames: the mean turn between their axes, which a path along a
    line determines as well, then scale and place by least squares over the centres."""
    turns = sum(rotation_of(f.quaternion) @ i.cam_from_world().rotation.matrix() for f, i in zip(frames, images))
    u, _, v = np.linalg.svd(turns)
    rotation = u @ np.diag([1, 1, np.linalg.det(u @ v)]) @ v
    centres = np.array([rotation @ i.projection_center() for i in images])
    wanted = np.array([f.position for f in frames])
    a, b = centres - centres.mean(0), wanted - wanted.mean(0)
    scale = (a * b).sum() / (a * a).sum()
    return pycolmap.Sim3d(scale, pycolmap.Rotation3d(rotation), wanted.mean(0) - scale * centres.mean(0))


def posed(frame, image):
    camera_from_world = image.cam_from_world()
    return replace(frame, position=np.array(image.projection_center()),
                   quaternion=np.array(camera_from_world.inverse().rotation.quat))  # x y z w


def points_of(model, indices):
    """Every point with the first image that sees it."""
    points = list(model.points3D.values())
    first = [indices[model.images[min(e.image_id for e in p.track.elements)].name] for p in points]
    return Points(np.array([p.xyz for p in points]), np.array([p.color for p in points]), np.array(first),
                  np.full(len(points), np.nan))


def lens_after(model, lens):
    fx, fy, cx, cy = next(iter(model.cameras.values())).params[:4]
    return dict(lens, fx=fx, fy=fy, cx=cx - HALF_PIXEL, cy=cy - HALF_PIXEL)


def note(before, after, model, error_before, lens):
    moved = np.array([np.linalg.norm(b.position - a.position) for b, a in zip(before, after)])
    path = sum(np.linalg.norm(b.position - a.position) for b, a in zip(after, after[1:]))
    turned = [2 * np.degrees(np.arccos(min(1, abs(a.quaternion @ b.quaternion)))) for a, b in zip(before, after)]
    focal = 100 * (lens_after(model, lens)['fx'] / lens['fx'] - 1)
    return (f'refined by COLMAP: {len(after)} poses moved by {np.median(moved) / path:.2%} of their path and '
            f'{np.median(turned):.2f} deg (medians), focal length by {focal:+.2f} %, reprojection error '
            f'{error_before:.2f} to {reprojection_error(model):.2f} px, {model.num_points3D()} points')


def reprojection_error(model):
    """Median over the points [px]; a mean knows only of those that the adjustment has put behind a camera."""
    model.update_point_3d_errors()
    return float(np.median([point.error for point in model.points3D.values()]))
