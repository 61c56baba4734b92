# SPDX-License-Identifier: BSD-3-Clause
"""Files of other programs from an output folder of `dso_dataset` or `dsorb run`: one model a segment, because segments
have neither origin nor unit in common."""
import json
import os
import struct
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Optional

import numpy as np

from . import colmap
from .pictures import Pictures, colours_of, find_pictures, make_pictures
from .refine import Refined, TooFewPoints
from .refine import refine as adjust
from .run_folder import FORMATS, TEXT, Points, finish_folder, new_folder, read_run, remove_exports

NEED_PICTURES = {'colmap', 'nerfstudio'}
# Camera axes of OpenGL, which nerfstudio has: x right, y up, z backwards; ours are x right, y down, z forwards.
OPENGL = np.diag([1.0, -1, -1, 1])
# The top-left corner of an image, not the centre of its first pixel, is (0, 0) for COLMAP and nerfstudio.
HALF_PIXEL = 0.5


def export(folder, formats, all_frames=False, undistort=False, refine=None):
    """Writes the formats below the output folder: FOLDER/colmap, FOLDER/nerfstudio, ...

    Models have the keyframes or, with `all_frames`, every posed frame; trajectories always have every posed frame.
    With `undistort` they come with undistorted images, FOLDER/images; with `refine`, which is `poses` or `focal`, their
    poses and points, and the focal length, are those after COLMAP's adjustment. Returns sentences on what was written, raises
    ValueError where something cannot be had."""
    unknown = set(formats) - set(FORMATS)
    if unknown:
        raise ValueError(f'export {", ".join(sorted(unknown))}: expected some of {", ".join(FORMATS)}')
    run = read_run(folder)
    if not run.segments:
        remove_exports(run.folder)
        return ['nothing to export: no image has a pose']
    if refine and not set(formats) & NEED_PICTURES:
        raise ValueError(f'--refine: expected one of {", ".join(sorted(NEED_PICTURES))} among the formats')
    notes, pictures = [], None
    if set(formats) & (NEED_PICTURES | {'ply'}):
        pictures = pictures_for(run, formats, all_frames, undistort, notes)
    models = [model_of(run, segment, pictures, all_frames, refine, notes) for segment in run.segments]
    for name in formats:
        target = new_folder(run.folder, name)
        for place, model in enumerate(models):
            WRITERS[name](target, place, model)
        finish_folder(run.folder, name)
        notes.append(f'{name}: {target}' + (f' ({len(run.segments)} models, one a segment)' if len(run.segments) > 1 else ''))
    return notes


@dataclass
class Model:
    """What is written of a segment."""
    trajectory: list  # every PosedFrame
    frames: list  # those of models
    points: Points
    pictures: Optional[Pictures]
    refined: Optional[Refined] = None
    tracks: Optional[colmap.Sights] = None


def model_of(run, segment, pictures, all_frames, refine, notes):
    frames = [frame for frame in segment.frames if all_frames or frame.is_keyframe]
    if refine:
        try:
            refined = adjust(frames, pictures, refine == 'focal')
            notes.append(refined.note)
            return Model(segment.frames, refined.frames, refined.points, replace(pictures, lens=refined.lens), refined)
        except TooFewPoints as error:
            if len(run.segments) == 1:
                raise
            notes.append(f'{error}; segment {segment.number} stays as it was')
    points, tracks = with_tracks(segment.points, segment.tracks, run.camera)
    missing = 'points are grey: colours need OpenCV (pip install opencv-python-headless)'
    colours = colours_of(pictures, run, points) if pictures is not None else points.colours
    if colours is None and missing not in notes:
        notes.append(missing)
    return Model(segment.frames, frames, replace(points, colours=points.colours if colours is None else colours), pictures,
                 tracks=tracks)


def with_tracks(points, tracks, camera):
    """Points and, behind them, those of tracks; and who sees the latter."""
    first = len(points.positions)
    rows, at = np.unique(tracks.points, return_index=True)
    joined = Points(np.concatenate([points.positions, tracks.positions[rows]]),
                    np.concatenate([points.colours, np.full((len(rows), 3), 128, points.colours.dtype)]),
                    np.concatenate([points.keyframes, tracks.keyframes[at].astype(points.keyframes.dtype)]),
                    np.concatenate([points.variances, np.zeros(len(rows), points.variances.dtype)]))
    rays = np.column_stack([(tracks.pixels[:, 0] - camera['cx']) / camera['fx'],
                            (tracks.pixels[:, 1] - camera['cy']) / camera['fy'], np.ones(len(tracks.pixels))])
    return joined, colmap.Sights(first, first + np.searchsorted(rows, tracks.points), tracks.keyframes, rays)


def pictures_for(run, formats, all_frames, undistort, notes):
    """Images that models name and colours come from; None where only colours would need them and they are not there."""
    wanted = {frame.index for segment in run.segments for frame in segment.frames if all_frames or frame.is_keyframe}
    try:
        found = None if undistort else find_pictures(run, wanted)
        return found or make_pictures(run, wanted, undistort)
    except ValueError as error:
        if set(formats) & NEED_PICTURES:
            raise
        notes.append(f'points are grey: {error}')
        return None


def suffix(place):
    """Suffix of the names of a segment's files; the first segment has none."""
    return f'_{place}' if place else ''


def write_tum(folder, place, model):
    frames = model.trajectory
    lines = [f'{f.time} ' + ' '.join(f'{x:.9f}' for x in (*f.position, *f.quaternion)) for f in frames]
    write_lines(folder / f'trajectory{suffix(place)}.txt', lines)
    write_lines(folder / f'images{suffix(place)}.txt', [f'{f.time} {f.image or f.index}' for f in frames])


def write_kitti(folder, place, model):
    frames = model.trajectory
    lines = [' '.join(f'{x:.9e}' for x in f.T_world_cam[:3].ravel()) for f in frames]
    write_lines(folder / f'poses{suffix(place)}.txt', lines)
    write_lines(folder / f'times{suffix(place)}.txt', [f.time for f in frames])
    write_lines(folder / f'images{suffix(place)}.txt', [f.image or str(f.index) for f in frames])


def write_euroc(folder, place, model):
    frames = model.trajectory
    lines = ['#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z []']
    for f in frames:
        x, y, z, w = f.quaternion
        nanoseconds = int(f.time.replace('.', ''))  # there are nine decimals
        lines.append(f'{nanoseconds},' + ','.join(f'{value:.9f}' for value in (*f.position, w, x, y, z)))
    write_lines(folder / f'trajectory{suffix(place)}.csv', lines)
    write_lines(folder / f'images{suffix(place)}.csv',
                ['#timestamp [ns],filename'] + [f'{int(f.time.replace(".", ""))},{f.image or f.index}' for f in frames])


def write_colmap(folder, place, model):
    link_images(folder / 'images', model.pictures.folder)
    target = folder / 'sparse' / str(place)
    if model.refined is None:
        colmap.write_model(target, model.frames, model.points, model.tracks, model.pictures)
        return
    target.mkdir(parents=True)
    model.refined.model.write_text(str(target))
    model.refined.model.write_binary(str(target))


def write_nerfstudio(folder, place, model):
    path = folder / f'transforms{suffix(place)}.json'
    points = f'points{suffix(place)}.ply'
    write_ply_file(folder / points, model.points)
    lens = nerfstudio_lens(model.pictures.lens)
    transforms = [dict(file_path=Path(os.path.relpath(model.pictures.file(f.index), folder)).as_posix(),
                       transform_matrix=(f.T_world_cam @ OPENGL).tolist()) for f in model.frames]
    path.write_text(json.dumps(dict(lens, ply_file_path=points, frames=transforms), indent=1) + '\n', encoding='utf-8')


def nerfstudio_lens(lens):
    names = {'pinhole': ('OPENCV', ()), 'radtan': ('OPENCV', ('k1', 'k2', 'p1', 'p2', 'k3')),
             'equidistant': ('OPENCV_FISHEYE', ('k1', 'k2', 'k3', 'k4'))}
    if lens['model'] not in names:
        raise ValueError(f'nerfstudio has no lens of the model {lens["model"]}: export with --undistort')
    model, coefficients = names[lens['model']]
    return dict(camera_model=model, fl_x=lens['fx'], fl_y=lens['fy'], cx=lens['cx'] + HALF_PIXEL,
                cy=lens['cy'] + HALF_PIXEL, w=lens['width'], h=lens['height'],
                **dict(zip(coefficients, lens['coefficients'])))


def write_ply(folder, place, model):
    write_ply_file(folder / f'points{suffix(place)}.ply', model.points)


def write_ply_file(path, points):
    header = ('ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\nproperty float y\n'
              'property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n')
    vertices = bytearray(header.format(len(points.positions)).encode())
    for position, colour in zip(points.positions, points.colours):
        vertices += struct.pack('<3f3B', *position, *colour)
    path.write_bytes(vertices)


def link_images(link, folder):
    """COLMAP and what reads its models look for images beside the model."""
    if not link.is_symlink():
        link.symlink_to(os.path.relpath(folder, link.parent) if folder.is_relative_to(link.parent.parent) else folder.absolute())


def write_lines(path, lines):
    path.write_text('\n'.join(lines) + '\n', **TEXT)


WRITERS = {'tum': write_tum, 'kitti': write_kitti, 'euroc': write_euroc, 'colmap': write_colmap,
           'nerfstudio': write_nerfstudio, 'ply': write_ply}
