# SPDX-License-Identifier: BSD-3-Clause
"""A sequence as VSLAM-LAB prepares them, through the command of a baseline."""
import csv
import subprocess
import sys
import unittest

import numpy as np
from dsorb import vslamlab
from room import FRAMES, image_files, room, room_run, temporary_folder

try:
    import yaml  # noqa: F401
except ImportError:
    raise unittest.SkipTest('the package PyYAML is not installed') from None

BEGIN = 1_403_636_579_763_555_584  # [ns]
CAMERA = '''%YAML 1.2
---
cameras:
  - {cam_name: rgb_0,
     cam_type: gray,
     cam_model: pinhole,
     DISTORTION
     focal_length: [200.0, 200.0],
     principal_point: [159.5, 119.5],
     image_dimension: [320, 240],
     fps: 30.0,
     T_BS: [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]
    }
'''


def times():
    return [BEGIN + round(float(line.split()[1]) * 1e9) for line in (room() / 'times.txt').read_text().splitlines()]


def sequence(distortion=''):
    """rgb_0 with the images, rgb.csv, calibration.yaml."""
    folder = temporary_folder() / 'a room'
    folder.mkdir()
    (folder / 'rgb_0').symlink_to(room() / 'images')
    (folder / 'calibration.yaml').write_text(CAMERA.replace('DISTORTION', distortion))
    rows = [f'{time},rgb_0/{file.name}\n' for time, file in zip(times(), image_files())]
    (folder / 'rgb.csv').write_text('ts_rgb_0 (ns),path_rgb_0\n' + ''.join(rows))
    return folder


def execute(folder, *words, pairs=False):
    results = folder.parent / 'results'
    results.mkdir(exist_ok=True)
    given = dict(sequence_path=folder, calibration_yaml=folder / 'calibration.yaml', rgb_csv=folder / 'rgb.csv', exp_folder=results,
                 exp_id='3')
    arguments = [word for key, value in given.items() for word in ([f'{key}:{value}'] if pairs else [f'--{key}', str(value)])]
    done = subprocess.run([sys.executable, '-m', 'dsorb.vslamlab', *arguments, *map(str, words)], capture_output=True, text=True,
                          check=False)
    return done, results / '00003_KeyFrameTrajectory.csv'


class Baseline(unittest.TestCase):
    def test_the_trajectory_has_every_pose_at_its_time(self):
        for pairs in (False, True):
            done, file = execute(sequence(), '--mode', 'mono', '--verbose', '0', pairs=pairs)
            self.assertEqual((done.returncode, done.stdout), (0, ''), done.stderr)
            with file.open(newline='') as stream:
                rows = list(csv.reader(stream))
            self.assertEqual(rows[0], ['ts (ns)', 'tx (m)', 'ty (m)', 'tz (m)', 'qx', 'qy', 'qz', 'qw'])
            self.assertEqual([int(row[0]) for row in rows[1:]], times())
            expected = np.loadtxt(room_run() / 'trajectory.txt')[:, 1:]
            np.testing.assert_allclose(np.array(rows[1:])[:, 1:].astype(float), expected, atol=1e-3)  # times are told to 2e-7 s

    def test_options_and_settings_reach_the_program(self):
        folder = sequence()
        (folder / 'settings.yaml').write_text('window:\n  max_keyframes: 5\n')
        done, file = execute(folder, '--settings_yaml', folder / 'settings.yaml', '--end', '30', '--set', 'orb.min_frames=6')
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertEqual(file.read_text().count('\n'), 31)
        config = (file.parent / 'dsorb_00003/config.yaml').read_text()
        self.assertIn('max_keyframes: 5', config)
        self.assertIn('min_frames: 6', config)

    def test_all_of_it_may_be_pairs(self):
        done, file = execute(sequence(), 'initializer:coarse', 'end:30', pairs=True)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn('kind: coarse', (file.parent / 'dsorb_00003/config.yaml').read_text())

    def test_nothing_is_left_where_nothing_starts(self):
        done, file = execute(sequence(), '--end', '3')
        self.assertEqual((done.returncode, file.exists()), (3, False), done.stderr)

    def test_lenses(self):
        camera = dict(cam_name='rgb_0', cam_model='pinhole', focal_length=[458.654, 457.296], principal_point=[367.215, 248.375],
                      image_dimension=[752, 480])
        for kind, coefficients, line in (
                (None, [], 'Pinhole 458.654 457.296 367.215 248.375 0'),
                ('radtan4', [0, 0, 0, 0], 'Pinhole 458.654 457.296 367.215 248.375 0'),
                ('radtan5', [-0.25, 0.125, 0.5, 0.75, 0.375], 'RadTan 458.654 457.296 367.215 248.375 -0.25 0.125 0.5 0.75 0.375'),
                ('equid4', [0.25, 0.5, 0.75, 1], 'EquiDistant 458.654 457.296 367.215 248.375 0.25 0.5 0.75 1')):
            lens = dict(camera, **({'distortion_type': kind, 'distortion_coefficients': coefficients} if kind else {}))
            words = vslamlab.camera_txt(lens).split('\n')[0].split()
            self.assertEqual([words[0], *map(float, words[1:])], [line.split()[0], *map(float, line.split()[1:])], kind)
        for change, text in (({'cam_model': 'unknown'}, "'unknown' with 'None'"), ({'image_dimension': None}, 'expected focal_length'),
                             ({'distortion_type': 'radtan8', 'distortion_coefficients': [0] * 8}, "with 'radtan8'"),
                             ({'distortion_type': 'radtan5', 'distortion_coefficients': [0] * 4}, '4 coefficients; radtan5 has 5')):
            with self.assertRaisesRegex(ValueError, text):
                vslamlab.camera_txt(dict(camera, **change))

    def test_mistakes_are_named(self):
        folder = sequence()
        done, _ = execute(folder, '--camera', 'rgb_1')
        self.assertEqual((done.returncode, 'ts_rgb_1 (ns)' in done.stderr), (1, True), done.stderr)
        (folder / 'calibration.yaml').write_text('cameras: 3\n')
        done, _ = execute(folder)
        self.assertEqual((done.returncode, 'expected a list `cameras`' in done.stderr), (1, True), done.stderr)
        self.assertNotIn('Traceback', done.stderr)


if __name__ == '__main__':
    unittest.main()
