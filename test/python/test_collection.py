# SPDX-License-Identifier: BSD-3-Clause
"""`dsorb run` over a list of videos by scripts/Snakefile."""
import csv
import importlib.util
import shutil
import subprocess
import sys
import unittest
from pathlib import Path

import numpy as np
from PIL import Image
from room import FRAMES, SIZE, room, temporary_folder

if not importlib.util.find_spec('snakemake'):
    raise unittest.SkipTest('the package snakemake is not installed')
try:
    from pyarrow import parquet
except ImportError:
    parquet = None

SCRIPTS = Path(__file__).resolve().parents[2] / 'scripts'
sys.path.insert(0, str(SCRIPTS))
from dsorb_eval.collection import suspected_of  # noqa: E402


def snakemake(folder, *words):
    done = subprocess.run([sys.executable, '-m', 'snakemake', '-s', SCRIPTS / 'Snakefile', '--directory', folder, *words,
                           '--config', f'videos={folder / "list.txt"}', f'dsorb={sys.executable} -m dsorb.command_line'],
                          capture_output=True, text=True, check=False)
    if done.returncode:
        raise AssertionError(done.stdout + done.stderr)
    return done.stdout + done.stderr


def on_a_cluster(profile):
    return '--profile', SCRIPTS / 'profiles' / profile, '--workflow-profile', SCRIPTS / 'profiles/videos'


def collect(folder, *words):
    """One call of Snakemake. @return rows of the table by the stem of the video"""
    snakemake(folder, *(words or ('--profile', SCRIPTS / 'profiles/videos')), '--cores', '2')
    with (folder / 'table.csv').open(newline='') as file:
        return {Path(row['video']).stem: row for row in csv.DictReader(file)}


class Collection(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = temporary_folder()
        (cls.folder / 'text file.mp4').write_text('no video')
        (cls.folder / 'black').mkdir()
        for number in range(12):
            Image.fromarray(np.zeros(SIZE[::-1], np.uint8)).save(cls.folder / f'black/{number:02d}.png')
        cls.list = cls.folder / 'list.txt'
        cls.list.write_text(f"# good, bad, missing, black\n{room()}  # the room\n'text file.mp4' --hfov 77\n"
                            'missing.mp4 --hfov 77\nblack --hfov 77\n')
        cls.rows = collect(cls.folder)

    def test_a_row_for_each(self):
        good = self.rows['room']
        self.assertEqual((good['status'], good['exit_code'], good['error'], good['images'], good['share_posed'], good['segments']),
                         ('tracked', '0', '', str(FRAMES), '1.0', '1'))
        self.assertLessEqual(float(good['wrong_probability']), 0.01)  # the gate's limit
        self.assertGreater(float(good['ms_per_image']), 0)
        self.assertGreater(float(good['processor_seconds']), 0)
        self.assertEqual(good['suspected'], '')
        for name, text in (('text file', 'no video that can be decoded'), ('missing', 'no such file')):
            row = self.rows[name]
            self.assertEqual((row['status'], row['exit_code'], row['images'], row['share_posed']), ('error', '1', '0', ''))
            self.assertIn(text, row['error'])

    def test_a_row_says_what_stood_in_the_way(self):
        self.assertEqual(self.rows['room']['obstacle'], '')
        black = self.rows['black']
        self.assertEqual((black['exit_code'], black['error'], black['share_posed']), ('3', '', '0.0'))
        self.assertIn(black['obstacle'], ('too dark', 'too_few_points'))  # without OpenCV's module the latter

    def test_a_row_says_what_is_suspected(self):
        folder = temporary_folder()
        for text, suspected in (('  focal length 402.0 px\n', None),
                                ('  calibration suspected: 402 px\n  rolling shutter suspected: 25 ms\nout: x', 'calibration, rolling shutter')):
            (folder / 'log.txt').write_text(text)
            self.assertEqual(suspected_of(folder), suspected)

    @unittest.skipUnless(parquet, 'the package pyarrow is not installed')
    def test_parquet_has_the_same(self):
        table = parquet.read_table(self.folder / 'table.parquet').to_pylist()
        self.assertEqual([row['exit_code'] for row in table[:3]], [0, 1, 1])
        self.assertEqual(table[0]['share_posed'], 1.0)
        self.assertIsNone(table[1]['share_posed'])

    def test_only_what_is_new_is_run(self):
        before = {file: file.stat().st_mtime_ns for file in self.folder.glob('videos/*/record.json')}
        self.assertEqual(len(before), 4)
        with self.list.open('a') as file:
            file.write(f'{room()} --end 12\n')
        rows = collect(self.folder)
        self.assertEqual(rows['room']['images'], '12')  # the later line of two with this stem
        self.assertEqual({file: file.stat().st_mtime_ns for file in before}, before)


class Elsewhere(unittest.TestCase):
    def setUp(self):
        self.folder = temporary_folder()
        (self.folder / 'list.txt').write_text(f'{room()} --end 12\nmissing.mp4 --hfov 77\n')

    def test_the_command_for_a_cluster_is_complete(self):
        for profile in ('slurm', 'kubernetes'):
            plan = snakemake(self.folder, *on_a_cluster(profile), '--default-storage-prefix', self.folder, '--dry-run')
            self.assertRegex(plan, r'\nvideo +2\n', profile)

    @unittest.skipUnless(shutil.which('rsync'), 'rsync is not installed')
    def test_jobs_may_work_on_copies(self):
        rows = collect(self.folder, *on_a_cluster('copies'), '--default-storage-prefix', self.folder)
        self.assertEqual((rows['room']['images'], rows['missing']['exit_code']), ('12', '1'))
        self.assertIn('no such file', rows['missing']['error'])
        names = {file.name for file in next(self.folder.glob('videos/room-*')).iterdir()}
        self.assertEqual(names, {'record.json', 'log.txt', 'out'})
        self.assertEqual((self.folder / 'table.parquet').exists(), parquet is not None)


if __name__ == '__main__':
    unittest.main()
