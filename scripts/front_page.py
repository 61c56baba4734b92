#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Makes the pictures of the first page from a sequence with images:

  front_page.py --bin build/bin/dso_dataset --sequence DIR [--output docs/images]

  run.webp             the run while it goes on: inverse depths in the image, beside them the map and the path
  coarse_and_orb.png   what `coarse` and `orb` know of one frame when each has started

Needs numpy, matplotlib and Pillow (scripts/requirements.txt)."""
import argparse
import json
import subprocess
import tempfile
from pathlib import Path

import matplotlib
import numpy as np
from PIL import Image, ImageDraw, ImageFont

COLOURS = (np.array(matplotlib.colormaps['turbo'](np.arange(256)))[:, :3] * 255).astype(np.uint8)
WIDTH = 400  # [px] of a panel
STEP = 2  # every second image
MILLISECONDS = 80  # of a picture; the sequence has 30 images a second
FONT = ImageFont.load_default(13)


def coloured(inverse_depth, span):
    """Near red, far blue. @param span: low and high end"""
    low, high = span
    place = np.clip((inverse_depth - low) / (high - low), 0, 1)
    return COLOURS[(place * 255).astype(int)]


def span_of(inverse_depth):
    return np.percentile(inverse_depth, [2, 98])


def rotation(q):
    x, y, z, w = q
    return np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                     [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                     [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]])


def run(program, sequence, output, *arguments):
    subprocess.run([program, sequence, '--output', output, '--quiet', *arguments], check=True)


def points_of(pose, points, camera):
    """Points of a keyframe in the world. @return n x 3"""
    points = np.asarray(points, float).reshape(-1, 5)
    points = points[points[:, 2] > 0]
    rays = np.stack([(points[:, 0] - camera['cx']) / camera['fx'], (points[:, 1] - camera['cy']) / camera['fy'],
                     np.ones(len(points))], axis=1)
    return rays / points[:, 2:3] @ rotation(pose[3:]).T + pose[:3]


def moments(recording):
    """Collects for every posed image: file, pose, poses of the path so far, points of the map. @return camera, list"""
    camera, poses, keyframes, points, file, found = None, [], {}, {}, None, []
    for line in open(recording):
        event = json.loads(line)
        kind = event['kind']
        if kind == 'header':
            camera = event['camera']
        elif kind == 'image':
            file = recording.parent / event['file']
        elif kind == 'keyframe':
            keyframes[event['index']] = event['pose']
        elif kind == 'points':
            points[event['keyframe']] = event['points']
        elif kind == 'pose' and event['pose'] is not None:
            poses.append(event['pose'])
            hosts = [k for k in points if k in keyframes and points[k]]
            if hosts:
                world = np.concatenate([points_of(np.array(keyframes[k]), points[k], camera) for k in hosts])
                found.append((file, np.array(event['pose']), np.array(poses), world))
    return camera, found


def project(world, pose, camera, size):
    """@return pixels of what lies before the camera and in a picture of that width, depths, mask"""
    local = (world - pose[:3]) @ rotation(pose[3:])
    front = local[:, 2] > .05
    z = np.where(front, local[:, 2], 1)
    scale = size[0] / camera['width']
    u = (camera['fx'] * local[:, 0] / z + camera['cx'] + .5) * scale
    v = (camera['fy'] * local[:, 1] / z + camera['cy'] + .5) * scale
    inside = front & (u > 1) & (v > 1) & (u < size[0] - 2) & (v < size[1] - 2)
    return np.stack([u, v], 1).astype(int), z, inside


def scatter(canvas, pixels, colours, radius):
    for dy in range(-radius, radius + 1):
        for dx in range(-radius, radius + 1):
            canvas[pixels[:, 1] + dy, pixels[:, 0] + dx] = colours


def in_image(moment, camera, size, span):
    file, pose, _, world = moment
    canvas = np.array(Image.open(file).convert('L').resize(size).convert('RGB'))
    pixels, z, inside = project(world, pose, camera, size)
    order = np.argsort(-z[inside])
    scatter(canvas, pixels[inside][order], coloured(1 / z[inside][order], span), 1)
    return canvas


def view_of(world):
    """A camera behind and above the first one, which sees the whole map."""
    distance = np.percentile(world[:, 2], 60)
    tilt = np.radians(24)
    pose = np.zeros(7)
    pose[3], pose[6] = -np.sin(tilt / 2), np.cos(tilt / 2)
    centre = np.array([np.median(world[:, 0]), np.median(world[:, 1]), distance])
    pose[:3] = centre - 1.9 * distance * rotation(pose[3:])[:, 2]
    return pose


def from_above(moment, camera, size, view, span):
    _, pose, path, world = moment
    canvas = np.full((size[1], size[0], 3), 255, np.uint8)
    pixels, z, inside = project(world, view, camera, size)
    order = np.argsort(-z[inside])
    scatter(canvas, pixels[inside][order], coloured(1 / z[inside][order], span), 0)
    picture = Image.fromarray(canvas)
    draw = ImageDraw.Draw(picture)
    line, _, seen = project(path[:, :3], view, camera, size)
    if seen.sum() > 1:
        draw.line([tuple(map(int, p)) for p in line[seen]], fill=(200, 30, 30), width=2)
    corners = np.array([[-1, -.75, 1.3], [1, -.75, 1.3], [1, .75, 1.3], [-1, .75, 1.3], [0, 0, 0]]) * .12
    frustum, _, _ = project(corners @ rotation(pose[3:]).T + pose[:3], view, camera, size)
    corner = [tuple(map(int, p)) for p in frustum]
    draw.polygon(corner[:4], outline=(20, 20, 20))
    for p in corner[:4]:
        draw.line([p, corner[4]], fill=(20, 20, 20))
    return np.array(picture)


def moving_picture(program, sequence, file):
    with tempfile.TemporaryDirectory() as folder:
        recording = Path(folder) / 'recording.jsonl'
        run(program, sequence, folder, '--record', recording)
        camera, found = moments(recording)
        size = (WIDTH, WIDTH * camera['height'] // camera['width'])
        last = found[-1]
        _, z, inside = project(last[3], last[1], camera, size)
        span, view = span_of(1 / z[inside]), view_of(last[3])
        view_span = span_of(1 / project(last[3], view, camera, size)[1])
        pictures = [Image.fromarray(np.concatenate([in_image(moment, camera, size, span),
                                                    from_above(moment, camera, size, view, view_span)], axis=1))
                    for moment in found[::STEP]]
    pictures[0].save(file, save_all=True, append_images=pictures[1:], duration=[MILLISECONDS] * (len(pictures) - 1) + [1500], loop=0, quality=60, method=6)


def true_inverse_depth(sequence, index, pixels, camera):
    """From a depth/ folder (16-bit millimetres) where there is one."""
    files = sorted((Path(sequence) / 'depth').glob('*.png'))
    if not files:
        return None
    z = np.array(Image.open(files[index])).astype(float) / 1000
    scale = z.shape[1] / camera['width']
    u, v = np.round((pixels + .5) * scale - .5).astype(int).T
    return 1 / np.where(z > 0, z, np.nan)[np.clip(v, 0, z.shape[0] - 1), np.clip(u, 0, z.shape[1] - 1)]


def relative_error(points, truth):
    """Median after the best single scale."""
    ratio = points[:, 2] / truth
    ratio = ratio[np.isfinite(ratio) & (ratio > 0)]
    return np.median(np.abs(np.median(ratio) / ratio - 1))


def start(program, sequence, initializer):
    """Picture of the start and a line about it."""
    with tempfile.TemporaryDirectory() as folder:
        run(program, sequence, folder, f'--initializer={initializer}')
        found = json.loads((Path(folder) / 'initialization.json').read_text())['initializations'][0]
    camera, points = found['camera'], np.array(found['points'], float)
    reference = found['reference']['index']
    image = sorted((Path(sequence) / 'images').glob('*'))[reference]
    size = (WIDTH, WIDTH * camera['height'] // camera['width'])
    canvas = np.array(Image.open(image).convert('L').resize(size).convert('RGB'))
    pixels = ((points[:, :2] + .5) * size[0] / camera['width']).astype(int)
    inside = (pixels > 1).all(1) & (pixels[:, 0] < size[0] - 2) & (pixels[:, 1] < size[1] - 2)
    span = span_of(points[inside, 2])
    scatter(canvas, pixels[inside], coloured(points[inside, 2], span), 1)
    text = f'{initializer}: started after {found["frames_given"]} images, {len(points)} points'
    truth = true_inverse_depth(sequence, reference, points[:, :2], camera)
    if truth is not None:
        text += f', depths {100 * relative_error(points, truth):.1f} % off'
    return canvas, text


def comparison(program, sequence, file):
    panels = [start(program, sequence, name) for name in ('coarse', 'orb')]
    height = panels[0][0].shape[0]
    picture = Image.new('RGB', (2 * WIDTH + 8, height + 22), 'white')
    draw = ImageDraw.Draw(picture)
    for i, (canvas, text) in enumerate(panels):
        picture.paste(Image.fromarray(canvas), (i * (WIDTH + 8), 22))
        draw.text((i * (WIDTH + 8) + 2, 3), text, fill='black', font=FONT)
    picture.save(file, optimize=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--bin', required=True, metavar='DSO_DATASET')
    parser.add_argument('--sequence', required=True, help='folder with images/ and, for the figures of depth, depth/')
    parser.add_argument('--output', type=Path, default=Path(__file__).resolve().parent.parent / 'docs' / 'images')
    arguments = parser.parse_args()
    moving_picture(arguments.bin, arguments.sequence, arguments.output / 'run.webp')
    comparison(arguments.bin, arguments.sequence, arguments.output / 'coarse_and_orb.png')


if __name__ == '__main__':
    main()
