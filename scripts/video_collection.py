#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""A collection to try scripts/videos.smk with: clips of ten seconds, half of them bad, and the list that names them.

  video_collection.py FOLDER [--clips N] [--bin BUILD/bin]

Renders each walk, and each fault that has to be rendered (standing, turning, rolling shutter), for --walks
seeds; every clip is one of these as it is, mirrored, backwards or both, in its own light and with its own
compression. Faults that need no rendering (darkness, blur, wrong focal length, cuts, a file without images or cut short) are
made of the walks. FOLDER/list.txt has the clips, named after what they are. Needs OpenCV's Python module."""
import argparse
import itertools
import pathlib
import subprocess
import sys
import wave

import cv2
import numpy as np

WIDTH, HEIGHT, RATE, SECONDS = 320, 240, 30, 10
FOV = {'room': 77, 'street': 82}  # [deg] of dso_synthesize
# What is rendered: kind of scene and arguments of dso_synthesize.
RENDERED = {'room': ('room', ''), 'street': ('street', ''), 'standing': ('static', ''), 'turning': ('rotation', ''),
            'rolling': ('room', '--readout 25')}
GOOD = ('room', 'street')
BAD = ('dark', 'standing', 'turning', 'rolling', 'focal', 'blurred', 'cuts', 'sound', 'short', 'text')
LIGHT = (1.0, 0.8, 0.6, 1.15)  # of the rendered grey levels, clipped at 255
DARKNESS = 0.03
BLUR = 4  # [px] standard deviation: out of focus
WRONG_FOV = 40  # [deg] declared for a walk of 77 or 82: focal length 2.2 or 2.4 times the true one
QUALITY = (95, 85, 70)  # of the JPEG images
CUT = 20  # frames between cuts


class Renderings:
    """Images of walks, each made once."""

    def __init__(self, program, folder, seeds):
        self.program, self.folder, self.seeds = program, folder, seeds

    def files(self, walk, seed):
        target = self.folder / f'{walk}_{seed}'
        if not (target / 'groundtruth.txt').exists():
            kind, extra = RENDERED[walk]
            subprocess.run([self.program, kind, *extra.split(), '--output', target, '--seed', str(seed), '--frames',
                            str(RATE * SECONDS), '--width', str(WIDTH), '--height', str(HEIGHT), '--quiet'], check=True)
        return sorted((target / 'images').iterdir())


def pictures(files, number):
    """Images of clip `number` of a rendering: mirrored, backwards, in another light."""
    for file in reversed(files) if number & 2 else files:
        image = cv2.imread(str(file))
        if image is None:
            sys.exit(f'video_collection.py: {file}: no image')
        image = cv2.flip(image, 1) if number & 1 else image
        yield cv2.convertScaleAbs(image, alpha=LIGHT[number % len(LIGHT)])


def encode(path, images, number):
    video = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*'MJPG'), RATE, (WIDTH, HEIGHT))
    video.set(cv2.VIDEOWRITER_PROP_QUALITY, QUALITY[number % len(QUALITY)])
    for image in images:
        video.write(image)
    video.release()


def cut_up(first, second):
    """Every CUT frames the other of two videos."""
    for place, pair in enumerate(zip(first, second)):
        yield pair[place // CUT % 2]


def sound(path):
    with wave.open(str(path), 'wb') as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(8000)
        file.writeframes((3000 * np.sin(np.arange(8000 * SECONDS) / 3)).astype('<i2').tobytes())


def scene_of(what, number):
    """The rendering that a clip is made of."""
    return what if what in RENDERED else GOOD[number % 2]


def write_clip(path, what, number, renderings):
    seed = 1 + number // 4 % renderings.seeds
    files = renderings.files(scene_of(what, number), seed)
    images = pictures(files, number)
    if what == 'dark':
        images = (np.uint8(np.round(image * DARKNESS)) for image in images)
    elif what == 'blurred':
        images = (cv2.GaussianBlur(image, (0, 0), BLUR) for image in images)
    elif what == 'cuts':
        images = cut_up(images, pictures(renderings.files(GOOD[1 - number % 2], seed), number))
    encode(path, images, number)
    if what == 'short':
        data = path.read_bytes()
        path.write_bytes(data[:(1 + number % 3) * len(data) // 4])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('folder', type=pathlib.Path)
    parser.add_argument('--clips', type=int, default=200, help='half of them bad (default: %(default)s)')
    parser.add_argument('--walks', type=int, default=4, help='seeds that are rendered (default: %(default)s)')
    parser.add_argument('--bin', default='build/bin', help='where dso_synthesize is (default: %(default)s)')
    args = parser.parse_args()
    args.folder.mkdir(parents=True, exist_ok=True)
    renderings = Renderings(pathlib.Path(args.bin) / 'dso_synthesize', args.folder / 'rendered', args.walks)
    kinds = itertools.chain.from_iterable(zip(itertools.cycle(GOOD), itertools.cycle(BAD)))
    lines, counts = [], {}
    for what in itertools.islice(kinds, args.clips):
        number = counts[what] = counts.get(what, -1) + 1
        path = args.folder / f'{what}_{number:03d}{".wav" if what == "sound" else ".avi"}'
        fov = WRONG_FOV if what == 'focal' else FOV.get(scene_of(what, number), FOV['room'])
        lines.append(f'{path.name} --hfov {fov}\n')
        if path.exists():
            continue
        if what == 'sound':
            sound(path)
        elif what == 'text':
            path.write_text('no video\n' * 1000)
        else:
            write_clip(path, what, number, renderings)
    (args.folder / 'list.txt').write_text(''.join(lines))


if __name__ == '__main__':
    main()
