# SPDX-License-Identifier: BSD-3-Clause
"""A run as VSLAM-LAB calls its baselines (`execute-mono`):

    python -m dsorb.vslamlab --sequence_path DIR --calibration_yaml FILE --rgb_csv FILE --exp_folder DIR --exp_id N

Reads the times [ns] and files of `rgb_csv` (relative to the sequence) and the camera of `calibration_yaml`, leaves
`exp_folder/<N>_KeyFrameTrajectory.csv` with a pose for every image that has one, and the whole output folder as
`exp_folder/dsorb_<N>`. Other arguments are options of dso_dataset (`--initializer coarse`). Needs the package PyYAML."""
from __future__ import annotations

import argparse
import csv
import sys
from pathlib import Path
from typing import Any, Optional

from .command_line import NOT_TRACKED, RUNTIME_ERROR, run_program
from .run_folder import Run, read_run

LENSES = {'radtan4': ('RadTan', 4), 'radtan5': ('RadTan', 5), 'equid4': ('EquiDistant', 4)}  # name in camera.txt, coefficients
COLUMNS = ['ts (ns)', 'tx (m)', 'ty (m)', 'tz (m)', 'qx', 'qy', 'qz', 'qw']
NANOSECONDS = 10**9
OURS = ('sequence_path', 'calibration_yaml', 'rgb_csv', 'exp_folder', 'exp_id', 'exp_it', 'settings_yaml', 'mode', 'verbose', 'camera')


def parse(words: list[str]) -> tuple[argparse.Namespace, list[str]]:
    parser = argparse.ArgumentParser('dsorb.vslamlab', description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter,
                                     allow_abbrev=False)
    for name in ('sequence_path', 'calibration_yaml', 'rgb_csv', 'exp_folder'):
        parser.add_argument(f'--{name}', type=Path, required=True)
    parser.add_argument('--exp_id', '--exp_it', required=True, help='number of the run')
    parser.add_argument('--camera', default='rgb_0', help='in both files; default rgb_0')
    parser.add_argument('--mode', choices=['mono'], default='mono')
    parser.add_argument('--verbose', default='0', help='0: errors only')
    parser.add_argument('--settings_yaml', type=Path, help='options as --config has them, where the file exists')
    # `key:value`, as baselines in C++ get it, is `--key value`; of options of dso_dataset where all words are such
    alone = not any(word.startswith('--') for word in words)
    pairs = [word.split(':', 1) if alone or word.split(':', 1)[0] in OURS else [word] for word in words]
    return parser.parse_known_args([part for pair in pairs for part in (['--' + pair[0], pair[1]] if len(pair) == 2 else pair)])


def camera_of(path: Path, name: str) -> dict[str, Any]:
    """An entry of `cameras`. Raises ValueError."""
    try:
        import yaml
    except ImportError:
        raise ValueError(f'{path}: reading it needs the package PyYAML: pip install PyYAML') from None
    try:
        content = yaml.safe_load(path.read_text(encoding='utf-8'))
        cameras = {camera['cam_name']: camera for camera in content['cameras']}
    except (yaml.YAMLError, KeyError, TypeError) as error:
        raise ValueError(f'{path}: expected a list `cameras`, each with `cam_name`: {error}') from None
    if name not in cameras:
        raise ValueError(f'{path}: has no camera {name}; those it has: {", ".join(cameras)}')
    return cameras[name]


def camera_txt(camera: dict[str, Any]) -> str:
    """Calibration as DSO's camera.txt. Raises ValueError where dsorb does not know the lens."""
    name, lens = camera['cam_name'], camera.get('distortion_type')
    try:
        numbers = [*map(float, camera['focal_length']), *map(float, camera['principal_point'])]
        width, height = map(int, camera['image_dimension'])
        coefficients = [float(x) for x in camera['distortion_coefficients']] if lens else []
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError(f'camera {name}: expected focal_length, principal_point, image_dimension, with distortion_type also '
                         f'distortion_coefficients: {error}') from None
    if len(numbers) != 4 or camera.get('cam_model') != 'pinhole' or (lens and lens not in LENSES):
        raise ValueError(f"camera {name}: '{camera.get('cam_model')}' with '{lens}'; expected pinhole, alone or with "
                         f'{", ".join(LENSES)}')
    if lens and len(coefficients) != LENSES[lens][1]:
        raise ValueError(f'camera {name}: {len(coefficients)} coefficients; {lens} has {LENSES[lens][1]}')
    distorted = any(coefficients)
    words = [LENSES[lens][0], *numbers, *coefficients] if distorted else ['Pinhole', *numbers, 0]
    line = ' '.join(f'{word:.17g}' if isinstance(word, float) else str(word) for word in words)
    return f'{line}\n{width} {height}\n{"crop" if distorted else "none"}\n{width} {height}\n'


def images_of(path: Path, name: str) -> list[tuple[int, str]]:
    """Times [ns] and files. Raises ValueError."""
    time, file = f'ts_{name} (ns)', f'path_{name}'
    with path.open(newline='', encoding='utf-8') as stream:
        rows = list(csv.DictReader(stream, skipinitialspace=True))
    if not rows or time not in rows[0] or file not in rows[0]:
        raise ValueError(f'{path}: expected columns `{time}` and `{file}`, and images')
    try:
        return sorted((int(row[time]), row[file]) for row in rows)
    except ValueError as error:
        raise ValueError(f'{path}: {error}') from None


def write_input(folder: Path, sequence: Path, images: list[tuple[int, str]], camera: str) -> None:
    """The sequence in TUM's layout; images stay where they are."""
    folder.mkdir(parents=True, exist_ok=True)
    link = folder / 'sequence'  # its path may have spaces, which the layout's words may not
    link.unlink(missing_ok=True)
    link.symlink_to(sequence.resolve())
    lines = [f'{time // NANOSECONDS}.{time % NANOSECONDS:09d} {link.name}/{file}\n' for time, file in images]
    (folder / 'rgb.txt').write_text(''.join(lines), encoding='utf-8')
    (folder / 'camera.txt').write_text(camera, encoding='utf-8')


def write_trajectory(path: Path, run: Run, times: list[int]) -> Optional[str]:
    """Poses of the longest segment: others have a world and a unit of their own. @return a note on what was left out"""
    longest = max(run.segments, key=lambda segment: len(segment.frames))
    with path.open('w', newline='', encoding='utf-8') as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        for frame in longest.frames:
            writer.writerow([times[frame.index], *(f'{x:.9g}' for x in (*frame.position, *frame.quaternion))])
    others = sum(len(segment.frames) for segment in run.segments) - len(longest.frames)
    return f'{others} images of {len(run.segments) - 1} other segments are left out' if others else None


def execute(args: argparse.Namespace, options: list[str]) -> int:
    """@return exit code, as of dso_dataset. Raises ValueError, OSError."""
    number = args.exp_id.zfill(5)
    images = images_of(args.rgb_csv, args.camera)
    output = args.exp_folder / f'dsorb_{number}'
    trajectory = args.exp_folder / f'{number}_KeyFrameTrajectory.csv'
    trajectory.unlink(missing_ok=True)
    write_input(output / 'input', args.sequence_path, images, camera_txt(camera_of(args.calibration_yaml, args.camera)))
    words = [str(output / 'input'), '--output', str(output), *options]
    words += ['--config', str(args.settings_yaml)] if args.settings_yaml and args.settings_yaml.is_file() else []
    code = run_program(words + ([] if int(args.verbose) else ['--quiet']))
    if code not in (0, NOT_TRACKED):
        return code if code > 0 else RUNTIME_ERROR
    run = read_run(output)
    if not run.segments:
        print('dsorb: no image got a pose', file=sys.stderr)
        return NOT_TRACKED
    note = write_trajectory(trajectory, run, [time for time, _ in images])
    if note:
        print(f'dsorb: {note}', file=sys.stderr)
    return 0


def main(words: Optional[list[str]] = None) -> None:
    args, options = parse(sys.argv[1:] if words is None else words)
    try:
        sys.exit(execute(args, options))
    except (ValueError, OSError) as error:
        sys.exit(f'dsorb: {error}')


if __name__ == '__main__':
    main()
