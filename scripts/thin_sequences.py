#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Makes sequences of a low frame rate out of others, for evaluations of starts from frames far apart.

    scripts/thin_sequences.py DATA/room_hand DATA/tartanair --every 3 6 --to out/thinned

Every K-th image there, and on the way back those in the middle between them: a short sequence gives twice as many frames, and
none of them twice. Images and depths are links, times go on growing with the interval of the frames, the truth is carried
along. The folders have the layout of their source (DSO's, or EuRoC's); TO/sequences.yaml lists them for
scripts/evaluate.py, TO/sequences.json for programs that want the number of frames."""
import argparse
import json
import os
import shutil
import sys
from pathlib import Path

from evaluate import HERE, use_environment

NANOSECONDS = 1e9


def there_and_back(count, every):
    """Indices of the frames that are kept, in their new order."""
    there = list(range(0, count, every))
    back = range(there[-1] - (every + 1) // 2, -1, -every)
    return there + list(back)


def new_times(times, kept):
    """Times that grow by what lies between neighbours, whichever way they are passed through [s]."""
    result = [times[kept[0]]]
    for before, after in zip(kept, kept[1:]):
        result.append(result[-1] + abs(times[after] - times[before]))
    return result


def link(source, target):
    target.parent.mkdir(parents=True, exist_ok=True)
    target.symlink_to(os.path.relpath(source.resolve(), target.parent.resolve()))


def link_images(source, kept, target):
    """Links with names that sort in the new order. @return the names"""
    from dsorb_eval import layout
    names = layout.image_names(source)
    made = []
    for position, index in enumerate(kept):
        made.append(f'{position:05d}{Path(names[index]).suffix}')
        link(source / names[index], target / made[-1])
    return made


def thin_dso(source, target, kept, times):
    """@param times new ones [s]"""
    link_images(source / 'images', kept, target / 'images')
    link(source / 'camera.txt', target / 'camera.txt')
    lines = [line.split() for line in (source / 'times.txt').read_text().splitlines() if line.strip() and not line.startswith('#')]
    with open(target / 'times.txt', 'w') as file:
        for position, (index, time) in enumerate(zip(kept, times)):
            print(f'{position:05d}', f'{time:.9f}', *lines[index][2:], file=file)
    if (source / 'depth').is_dir():
        link_images(source / 'depth', kept, target / 'depth')


def thin_euroc(source, listing, target, kept, times):
    """@param listing data.csv of the camera @param times new ones [s]"""
    from dsorb_eval import layout
    names = layout.table_column(listing, 1, ',')
    folder = target / 'mav0/cam0'
    link(listing.parent / 'sensor.yaml', folder / 'sensor.yaml')
    with open(folder / 'data.csv', 'w') as file:
        print('#timestamp [ns],filename', file=file)
        for index, time in zip(kept, times):
            stamp = round(time * NANOSECONDS)
            print(f'{stamp},{stamp}.png', file=file)
            link(listing.parent / 'data' / names[index], folder / 'data' / f'{stamp}.png')


def thin(source, every, target):
    """@return number of frames @throws FormatError"""
    from dsorb_eval import layout, trajectory
    name, listing = layout.recognise(source)
    if name not in ('dso', 'euroc'):
        raise trajectory.FormatError(f"{source}: a data set of format {name}; dso and euroc can be thinned")
    old_times = layout.timestamps(source)
    kept = there_and_back(len(old_times), every)
    times = new_times(old_times, kept)
    shutil.rmtree(target, ignore_errors=True)
    target.mkdir(parents=True)
    if name == 'dso':
        thin_dso(source, target, kept, times)
    else:
        thin_euroc(source, listing, target, kept, times)
    truth = layout.load_ground_truth(layout.default_ground_truth(source), source)
    if truth is not None:
        poses = [(time, truth.pose(old_times[index])) for index, time in zip(kept, times)]
        trajectory.save_tum(target / 'groundtruth.txt', [trajectory.row_of(t, pose) for t, pose in poses if pose is not None])
    return len(kept)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('sequences', nargs='+', type=Path, metavar='FOLDER')
    parser.add_argument('--every', nargs='+', type=int, default=[3, 6], metavar='K', help='default 3 6')
    parser.add_argument('--to', required=True, type=Path, metavar='TO')
    args = parser.parse_args()
    if min(args.every) < 1:
        parser.error(f'--every {min(args.every)}: expected at least 1')
    from dsorb_eval import trajectory
    made = {}
    for source in args.sequences:
        for every in args.every:
            name = f'{source.resolve().name}_every{every}'
            try:
                made[name] = {'path': name, 'frames': thin(source, every, args.to / name)}
            except (trajectory.FormatError, OSError) as error:
                sys.exit(f'thin_sequences.py: {error}')
    (args.to / 'sequences.json').write_text(json.dumps(made, indent=1) + '\n')
    entries = [f'- {{name: {name}, path: {name}}}\n' for name in made]
    (args.to / 'sequences.yaml').write_text('sequences:\n' + ''.join(entries))


if __name__ == '__main__':
    use_environment(__file__)
    sys.path.insert(0, HERE)
    main()
