# SPDX-License-Identifier: BSD-3-Clause
"""Commands on names, folders and recordings that somebody else has made: nothing outside of them is read, written or removed."""
import json
import os
import shutil
import subprocess
import sys

from attack import case, main
from room import image_files, room, room_run, temporary_folder

CASES = {}
ALL = 'tum,kitti,euroc,colmap,nerfstudio,ply'


def dsorb(*words, **options):
    """@return exit code, all that was told; a traceback is a fault"""
    done = subprocess.run([sys.executable, '-m', 'dsorb.command_line', *words], capture_output=True, check=False, **options)
    told = os.fsdecode(done.stdout + done.stderr)
    assert 'Traceback' not in told and done.returncode >= 0, told
    return done.returncode, told


def copy_of_run():
    folder = temporary_folder() / 'run'
    shutil.copytree(room_run(), folder)
    return folder


def precious(folder):
    """A folder of others beside that one, with a file."""
    others = folder.parent / 'others'
    (others / 'sparse').mkdir(parents=True)
    (others / 'thesis.txt').write_text('mine')
    return others


def untouched(others):
    return sorted(path.name for path in others.rglob('*')) == ['sparse', 'thesis.txt'] and (others / 'thesis.txt').read_text() == 'mine'


@case(CASES)
def names_of_images():
    for pattern in (b'caf\xe9 %04d.png', b'a\nb %04d.png', b'q",\';$(touch pwned)`touch pwned` %04d.png', b'=cmd|calc %04d.png', b'-x %04d.png',
                    '\u202e%04d.png'.encode()):
        folder = temporary_folder()
        (folder / 'in/images').mkdir(parents=True)
        shutil.copy(room() / 'camera.txt', folder / 'in')
        for i, file in enumerate(image_files()):
            shutil.copy(file, os.fsencode(folder) + b'/in/images/' + pattern.replace(b'%04d', b'%04d' % i))
        code, told = dsorb('run', 'in', '--output', 'out', '--export', ALL, cwd=folder)
        assert code == 0, told
        assert sorted(path.name for path in folder.iterdir()) == ['in', 'out'], 'nothing in a name is run'


@case(CASES)
def names_of_folders():
    for name in (b'caf\xe9', b'a b', b'<script>', b'"; touch pwned; "'):
        folder = os.fsencode(temporary_folder()) + b'/' + name
        shutil.copytree(os.fsencode(room()), folder)
        code, told = dsorb('run', folder, '--output', folder + b'/out', '--export', ALL)
        assert code == 0, told


@case(CASES)
def links_in_a_run():
    for name in (*ALL.split(','), 'images', 'figures', 'exports.json', 'bag_images'):
        folder = copy_of_run()
        others = precious(folder)
        shutil.rmtree(folder / name, ignore_errors=True)
        (folder / name).symlink_to('../others' if name != 'exports.json' else '../others/thesis.txt')
        if name != 'exports.json':
            (folder / 'exports.json').write_text(json.dumps({name: ['thesis.txt', 'sparse', '../others/thesis.txt']}))
        dsorb('export', folder, '--format', ALL)
        dsorb('export', folder, '--format', 'colmap', '--undistort')
        dsorb('run', room(), '--output', folder, '--export', ALL)
        assert untouched(others), name


@case(CASES)
def recordings_name_files():
    output = temporary_folder() / 'out'
    assert dsorb('run', room(), '--output', output, '--record', output / 'recording.jsonl', '--end', '30')[0] == 0
    lines = (output / 'recording.jsonl').read_text().splitlines()
    image = next(json.loads(line) for line in lines if '"kind":"image"' in line)
    for file in ('/etc/passwd', '../../../../../../../etc/passwd', '/dev/zero', str(image_files()[0]), 3, None, {}, '\0'):
        (output / 'other.jsonl').write_text(lines[0] + '\n' + json.dumps(dict(image, file=file)) + '\n')
        dsorb('view', output / 'other.jsonl', '--save', output / 'other.rrd')
        assert b'root:x:0' not in (output / 'other.rrd').read_bytes() and (output / 'other.rrd').stat().st_size < 30000, file


@case(CASES)
def files_in_the_way():
    folder = temporary_folder()
    shutil.copytree(room(), folder / 'in')
    before = {path: path.read_bytes() for path in (folder / 'in').rglob('*') if path.is_file()}
    for option, name in (('--record', 'camera.txt'), ('--record', 'groundtruth.txt'), ('--save', 'camera.txt')):
        assert dsorb('run', folder / 'in', '--output', folder / 'out', option, folder / 'in' / name)[0] != 0
    assert {path: path.read_bytes() for path in (folder / 'in').rglob('*') if path.is_file()} == before


@case(CASES)
def damaged_folders():
    for path in sorted(room_run().rglob('*.*')):
        for size in (0, 1, 100, 1000):
            folder = copy_of_run()
            os.truncate(folder / path.relative_to(room_run()), size)
            dsorb('export', folder, '--format', ALL)
    for text in ('[]', '{}', '3', '{"camera": 3}', '{"camera": {"fx": NaN}}', '{"camera": null}'):
        folder = copy_of_run()
        (folder / 'run.json').write_text(text)
        dsorb('export', folder, '--format', ALL)


if __name__ == '__main__':
    main(CASES)
