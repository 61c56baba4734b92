#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Rendered clips whose camera is lost: is its place found again?

    scripts/lost_clips.py WORK_FOLDER [--seeds 1 2 3 4] [--bin build/bin]

Renders rooms and streets (once, by dso_synthesize) and makes five clips of each: a cut to another place and back, darkness
of two seconds, a covered lens, a camera that is carried to another part of the map, and a whip pan. Runs dso_dataset over
them, prints a line a clip and writes WORK_FOLDER/lost_clips.json. The exit code is 1 where less than 95 % are found within
ten images of seeing the old place again, at a position within 1 % of the way, in one segment."""
import argparse
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
from PIL import Image, ImageFilter

from evaluate import HERE, use_environment

BEFORE = 60  # images before the camera is lost
AFTER = 30  # images of the old place after that
RATES = {'room': 30, 'street': 10}  # images a second
FIRST_AFTER = {'cut': 25, 'dark': 45, 'covered': 60, 'carried': 10, 'whip': 60}
SHARE = 0.95
MOST_WAITING = 10  # images
MOST_ERROR = 0.01  # of the way


def render(program, folder, kind, seed):
    if not (folder / 'groundtruth.txt').exists():
        subprocess.run([program, kind, '--seed', str(seed), '--frames', str(BEFORE + AFTER), '--noise', '2', '--width', '480', '--height', '360',
                        '--output', folder, '--quiet'], check=True)
    return folder


def while_lost(event, images, others, rate):
    """What the camera sees meanwhile."""
    noise = np.random.default_rng(1)
    last = Image.open(images[BEFORE - 1])
    if event == 'cut':
        return [Image.open(file) for file in others[:25]]
    if event == 'dark':
        return [Image.fromarray(noise.integers(0, 4, (last.height, last.width), np.uint8)) for _ in range(2 * rate)]
    if event == 'covered':
        hand = np.asarray(last.filter(ImageFilter.GaussianBlur(60))) * 0.3
        return [Image.fromarray((hand + noise.normal(0, 2, hand.shape)).clip(0, 255).astype(np.uint8)) for _ in range(15)]
    if event == 'whip':
        pixels = np.cumsum(np.tile(np.asarray(last, float), 3), 1)
        turned = [(60 * k, 120 + 20 * k) for k in (1, 2, 3, 3, 2, 1)]  # start and width of the blur [px]
        return [Image.fromarray(((pixels[:, a + b:a + b + last.width] - pixels[:, a:a + last.width]) / b).astype(np.uint8)) for a, b in turned]
    return []


def make_clip(event, source, other, rate, folder):
    """Writes a clip in DSO's layout. @return truth, an index into the rendered images for each image, -1 without"""
    images, others = (sorted((path / 'images').iterdir()) for path in (source, other))
    shown = list(range(BEFORE))
    lost = while_lost(event, images, others, rate)
    first = FIRST_AFTER[event]
    shown += [-1] * len(lost) + list(range(first, first + AFTER))
    (folder / 'images').mkdir(parents=True, exist_ok=True)
    (folder / 'camera.txt').write_text((source / 'camera.txt').read_text())
    for position, index in enumerate(shown):
        (Image.open(images[index]) if index >= 0 else lost[position - BEFORE]).save(folder / 'images' / f'{position:05d}.png')
    (folder / 'times.txt').write_text(''.join(f'{i:05d} {i / rate:.9f}\n' for i in range(len(shown))))
    return np.array(shown)


def outcome(out, source, shown, rate):
    from dsorb_eval import trajectory as tr
    truth = tr.load_tum(source / 'groundtruth.txt')[:, 1:4]
    segments = []  # position in the clip and place of the frames of the old place
    for file in sorted(out.glob('trajectory_[0-9]*.txt')) or [out / 'trajectory.txt']:
        rows = tr.load_tum(file)
        index = np.rint(rows[:, 0] * rate).astype(int)
        if (shown[index] >= 0).any():
            segments.append((index[shown[index] >= 0], rows[shown[index] >= 0, 1:4]))
    index, places = max(segments, key=lambda segment: (segment[0] < BEFORE).sum(), default=(np.array([]), None))
    before, after = index < BEFORE, index >= BEFORE
    if before.sum() < 10:
        return {'segments': len(segments), 'waited': None, 'error': None, 'started': False}
    scale, rotation, shift = tr.align(places[before], truth[shown[index[before]]])
    errors = np.linalg.norm(scale * places[after] @ rotation.T + shift - truth[shown[index[after]]], axis=1)
    way = np.linalg.norm(np.diff(truth[:BEFORE], axis=0), axis=1).sum()
    return {'segments': len(segments), 'started': True,
            'waited': int(index[after][0] - np.flatnonzero(shown >= 0)[BEFORE]) if after.any() else None,
            'error': float(np.sqrt((errors ** 2).mean()) / way) if after.any() else None}


def is_found(clip):
    return clip['waited'] is not None and clip['waited'] < MOST_WAITING and clip['error'] <= MOST_ERROR and clip['segments'] == 1


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('work', type=Path)
    parser.add_argument('--seeds', type=int, nargs='+', default=[1, 2, 3, 4])
    parser.add_argument('--events', nargs='+', choices=FIRST_AFTER, default=list(FIRST_AFTER))
    parser.add_argument('--bin', type=Path, default=Path(HERE).parent / 'build/bin')
    args = parser.parse_args()
    clips = {}
    for seed in args.seeds:
        for kind, rate in RATES.items():
            source, other = (render(args.bin / 'dso_synthesize', args.work / f'{kind}_{s}', kind, s) for s in (seed, seed + 100))
            for event in args.events:
                name = f'{event}_{kind}_{seed}'
                shown = make_clip(event, source, other, rate, args.work / name)
                subprocess.run([args.bin / 'dso_dataset', args.work / name, '--output', args.work / name / 'out', '--threads', '1'],
                               stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=False)
                clips[name] = outcome(args.work / name / 'out', source, shown, rate)
                print(f'{name:20}', *(f'{key} {value}' for key, value in clips[name].items()), '' if is_found(clips[name]) else 'NOT FOUND', flush=True)
    (args.work / 'lost_clips.json').write_text(json.dumps(clips, indent=1))
    found = sum(map(is_found, clips.values()))
    print(f'{found} of {len(clips)} found')
    return 0 if found >= SHARE * len(clips) else 1


if __name__ == '__main__':
    use_environment(__file__)
    sys.path.insert(0, HERE)
    sys.exit(main())
