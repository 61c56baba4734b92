# SPDX-License-Identifier: BSD-3-Clause
"""Sequences file, start frames, identities of runs, data set layouts, and what is made of a run's folder."""
import contextlib
import io
import json
import math
import tempfile
import time
import unittest
from pathlib import Path

import numpy as np
from PIL import Image

from dsorb_eval import cli, judge, layout, protocol, runner
from dsorb_eval import trajectory as tr

COUNT = 30
PROGRAM = """#!/bin/sh
case "$*" in *--print-config*) echo "option: {option}"; exit 0;; esac
{action}
"""


def write_dataset(folder, count=COUNT):
    """A data set in DSO's layout: a camera that moves along x, one depth everywhere; images are empty files."""
    (folder / 'images').mkdir(parents=True)
    (folder / 'depth').mkdir()
    for i in range(count):
        (folder / 'images' / f'{i:05d}.png').touch()
    Image.fromarray(np.full((48, 64), 4000, np.uint16)).save(folder / 'depth' / '00000.png')
    (folder / 'camera.txt').write_text('Pinhole 50 50 31.5 23.5 0\n64 48\nnone\n64 48\n')
    (folder / 'times.txt').write_text(''.join(f'{i:05d} {i / 10:.9f} 10\n' for i in range(count)))
    (folder / 'groundtruth.txt').write_text(''.join(f'{i / 10:.9f} {i * .1:.9f} {math.sin(i):.9f} 0 0 0 0 1\n' for i in range(count)))


def write_program(path, action='exit 0', option=1):
    path.write_text(PROGRAM.format(action=action, option=option))
    path.chmod(0o755)
    return path


class InFolder(unittest.TestCase):
    def setUp(self):
        holder = tempfile.TemporaryDirectory(prefix='dsorb_test_')
        self.addCleanup(holder.cleanup)
        self.folder = Path(holder.name)

    def sequences(self, text):
        path = self.folder / 'sequences.yaml'
        path.write_text(text)
        return path


class Sequences(InFolder):
    def setUp(self):
        super().setUp()
        write_dataset(self.folder / 'data')

    def test_defaults_are_the_whole_sequence_and_its_truth(self):
        sequence, = protocol.read_sequences(self.sequences('sequences: [{name: room_1, path: data}]'))
        self.assertEqual((sequence.first, sequence.last, sequence.format, sequence.dataset), (0, COUNT - 1, 'auto', 'room'))
        self.assertEqual(sequence.groundtruth, str((self.folder / 'data/groundtruth.txt').resolve()))

    def test_mistakes_are_named(self):
        cases = {'sequences: []': 'expected `sequences:`', 'sequences: [{name: a}]': 'at least `name` and `path`',
                 'sequences: [{name: a, path: nowhere}]': 'no such file or folder',
                 'sequences: [{name: a, path: data, frist: 3}]': "unknown key 'frist'",
                 'sequences: [{name: a, path: data, last: 30}]': 'last 30: expected 0 <= first <= last <= 29',
                 'sequences: [{name: a, path: data, format: ros}]': "format 'ros'",
                 'sequences: [{name: a/b, path: data}]': "name 'a/b'",
                 'sequences: [{name: a, path: data, groundtruth: gone.txt}]': 'no such file',
                 'sequences: [{name: a, path: data}, {name: a, path: data}]': "two sequences are called 'a'",
                 'sequences: [': 'sequences.yaml'}
        for text, words in cases.items():
            with self.assertRaises(tr.FormatError, msg=text) as caught:
                protocol.read_sequences(self.sequences(text))
            self.assertIn(words, str(caught.exception))

    def test_broken_truth_is_said_before_anything_runs(self):
        (self.folder / 'data/groundtruth.txt').write_text('0 1 2 3\n')
        with self.assertRaisesRegex(tr.FormatError, r'groundtruth.txt:1: expected 8 numbers'):
            protocol.read_sequences(self.sequences('sequences: [{name: a, path: data}]'))


class Starts(unittest.TestCase):
    def ranges(self, first, last, starts, frames):
        sequence = protocol.Sequence('a', '', 'auto', '', first, last)
        return list(protocol.ranges_of(sequence, starts, frames))

    def test_five_of_two_hundred(self):
        runs = self.ranges(0, 199, 'five', 200)
        self.assertEqual(len(runs), 10)
        self.assertEqual(runs[:4], [(0, 200, False), (0, 200, True), (10, 200, False), (0, 190, True)])
        self.assertEqual(runs[-2:], [(40, 200, False), (0, 160, True)])

    def test_dense_starts_leave_out_what_is_too_short(self):
        runs = self.ranges(0, 50, 'every:10', 40)
        self.assertEqual(runs, [(0, 40, False), (11, 51, True), (10, 50, False), (1, 41, True), (20, 51, False), (0, 31, True),
                                (30, 51, False), (0, 21, True)])

    def test_first_and_last_are_included(self):
        self.assertEqual(self.ranges(100, 129, 'every:30', 200), [(100, 130, False), (100, 130, True)])

    def test_other_words_are_refused(self):
        for word in ('six', 'every:0', 'every:', 'every:-3'):
            with self.assertRaises(tr.FormatError):
                protocol.start_offsets(word, 100)


class Identity(InFolder):
    def setUp(self):
        super().setUp()
        write_dataset(self.folder / 'data')
        self.program = write_program(self.folder / 'program')
        self.file = self.sequences('sequences: [{name: a, path: data}]')

    def keys(self, variants=('orb',), **more):
        plan = protocol.plan(protocol.Request(str(self.program), str(self.file), list(variants), 'every:10', 25, **more))
        return [run['key'] for run in plan['runs']]

    def test_same_request_same_keys(self):
        self.assertEqual(self.keys(), self.keys())
        self.assertEqual(len(set(self.keys(variants=('orb', 'coarse')))), 8)
        self.assertEqual(self.keys(), [k for k in self.keys(variants=('coarse', 'orb')) if '/orb/' in k])

    def test_everything_that_decides_a_result_changes_the_keys(self):
        before = set(self.keys())
        self.assertFalse(before & set(self.keys(extra=('--set', 'a=1'))))
        self.assertFalse(before & set(self.keys(threads=2)))
        write_program(self.program, action='exit 1')  # another build
        self.assertFalse(before & set(self.keys()))
        write_program(self.program)
        self.assertEqual(before, set(self.keys()))
        (self.folder / 'data/images/99999.png').touch()  # another excerpt under the same path
        with open(self.folder / 'data/times.txt', 'a') as file:
            file.write('99999 99 10\n')
        self.assertFalse(before & set(self.keys()))

    def test_another_configuration_of_the_same_arguments(self):
        settings = self.folder / 'settings.yaml'
        settings.write_text('1')
        self.program.write_text(f'#!/bin/sh\ncat {settings}\n')
        before = set(self.keys())
        settings.write_text('2')
        self.assertFalse(before & set(self.keys()))

    def test_a_preset_goes_with_its_variant(self):
        self.assertEqual(protocol.arguments_of('orb'), ['--initializer', 'orb'])
        self.assertEqual(protocol.arguments_of('coarse+reference'), ['--initializer', 'coarse', '--preset', 'reference'])
        self.program.write_text('#!/bin/sh\necho "$*" >&2\nexit 2\n')
        with self.assertRaisesRegex(tr.FormatError, 'exit 2: --initializer coarse --preset reference --print-config'):
            self.keys(variants=('coarse+reference',))

    def test_a_variant_the_program_lacks_is_refused_with_its_words(self):
        self.program.write_text('#!/bin/sh\necho "no such initializer" >&2\nexit 2\n')
        with self.assertRaisesRegex(tr.FormatError, 'exit 2: no such initializer'):
            self.keys()


class CommandLine(InFolder):
    def refused(self, *arguments):
        with contextlib.redirect_stderr(io.StringIO()) as stream:
            code = cli.main(['--no-evo', '--output', str(self.folder / 'out'), *arguments])
        return code, stream.getvalue()

    def test_mistakes_end_with_two_and_one_line(self):
        program = str(write_program(self.folder / 'program'))
        for arguments, words in ((('--bin', 'nowhere', '--sequences', 'x'), 'no such program'),
                                 (('--bin', program, '--sequences', 'x', '--frames', '5'), 'at least 20'),
                                 (('--bin', program, '--sequences', 'x', '--variants', 'orb', 'orb'), 'named twice')):
            code, text = self.refused(*arguments)
            self.assertEqual(code, 2)
            self.assertIn(words, text)
            self.assertEqual(text.count('\n'), 1)


class Layouts(InFolder):
    def test_kitti_times_and_poses(self):
        sequence = self.folder / 'sequences/07'
        (sequence / 'image_0').mkdir(parents=True)
        for i in range(3):
            (sequence / 'image_0' / f'{i:06d}.png').touch()
        (sequence / 'times.txt').write_text('0\n1.5e-01\n3e-01\n')
        (self.folder / 'poses').mkdir()
        (self.folder / 'poses/07.txt').write_text(''.join(f'0 -1 0 {i} 1 0 0 0 0 0 1 0\n' for i in range(3)))
        truth = layout.load_ground_truth(layout.default_ground_truth(sequence), sequence)
        np.testing.assert_allclose(truth.times, [0, .15, .3])
        np.testing.assert_allclose(truth.pose(.3), [[0, -1, 0, 2], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]], atol=1e-12)

    def test_euroc_truth_is_carried_from_body_to_camera(self):
        camera = self.folder / 'mav0/cam0'
        camera.mkdir(parents=True)
        (camera / 'data.csv').write_text('#timestamp [ns],filename\n1000000000,a.png\n1050000000,b.png\n')
        (camera / 'sensor.yaml').write_text('%YAML:1.0\nT_BS:\n  data: [0, -1, 0, 0.5, 1, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]\n')
        state = self.folder / 'mav0/state_groundtruth_estimate0'
        state.mkdir()
        half = math.sqrt(.5)  # body turned by 90 degrees about z: the camera, 0.5 along x of it, lies along y
        (state / 'data.csv').write_text('#timestamp,p,q\n' + ''.join(f'{10 ** 9 + i * 5 * 10 ** 7},{i},0,0,{half},0,0,{half},9\n'
                                                                    for i in range(3)))
        self.assertEqual(layout.timestamps(self.folder), [1., 1.05])
        truth = layout.load_ground_truth(layout.default_ground_truth(self.folder), self.folder)
        pose = truth.pose(1.05)
        np.testing.assert_allclose(pose[:3, 3], [1, .5, 0], atol=1e-12)
        np.testing.assert_allclose(pose[:3, :3], [[-1, 0, 0], [0, -1, 0], [0, 0, 1]], atol=1e-12)

    def test_images_without_times_are_ten_a_second(self):
        for i in range(3):
            (self.folder / f'{i}.jpg').touch()
        np.testing.assert_allclose(layout.timestamps(self.folder), [0, .1, .2])


class Runner(InFolder):
    def run_program(self, action, timeout=20):
        program = write_program(self.folder / 'program', action)
        return runner.run_one(dict(key='k', command=[str(program)]), self.folder / 'run', timeout)

    def test_a_failing_program_is_a_result(self):
        record = self.run_program('echo no disk >&2; exit 1')
        self.assertEqual((record['exit_code'], runner.read_record(self.folder / 'run')), (1, record))
        self.assertEqual((self.folder / 'run/log.txt').read_text(), 'no disk\n')
        figures = judge.judge(record, self.folder / 'run', dict(groundtruth='', path='', format='auto'), False)
        self.assertTrue(figures['crashed'])
        self.assertIn('run.json', figures['error'])

    def test_a_hanging_program_is_ended_with_its_children(self):
        record = self.run_program('sleep 60 & echo $! > "$2/child"; wait', timeout=3)
        self.assertEqual(record['exit_code'], runner.TIMED_OUT)
        child = int((self.folder / 'run/out/child').read_text())
        limit = time.monotonic() + 20
        while self.alive(child):
            self.assertLess(time.monotonic(), limit, 'the child goes on')
            time.sleep(.05)

    @staticmethod
    def alive(process):
        try:
            return Path(f'/proc/{process}/stat').read_text().split()[2] not in 'ZX'
        except OSError:
            return False

    def test_an_interrupted_run_leaves_no_record(self):
        with self.assertRaises(runner.Interrupted):
            self.run_program("""echo '{"status": "interrupted"}' > "$2/run.json" """)
        self.assertIsNone(runner.read_record(self.folder / 'run'))


class Judge(InFolder):
    """An output folder written by hand: the true path in another unit, one wrong initial direction."""

    def setUp(self):
        super().setUp()
        self.data, self.out = self.folder / 'data', self.folder / 'run/out'
        write_dataset(self.data)
        self.out.mkdir(parents=True)
        states = ['initializing'] * 4 + ['initialized'] + ['tracked'] * (COUNT - 5)
        (self.out / 'frames.csv').write_text('index,timestamp,state,milliseconds,is_keyframe,tracking_rmse,segment\n' + ''.join(
            f'{i},{i / 10:.9f},{state},2.5,0,,0\n' for i, state in enumerate(states)))
        rows = tr.load_tum(self.data / 'groundtruth.txt')
        rows[:, 1:4] *= .5
        tr.save_tum(self.out / 'trajectory.txt', rows)
        tr.save_tum(self.out / 'keyframes.txt', rows[::5])
        self.write_json('run.json', dict(status='tracked', segments=1, peak_memory_mb=80., camera={}))
        centre = rows[4, 1:4] - rows[0, 1:4]
        points = [[5 + i % 50, 5 + i // 50, .25 * 1.1 ** (i % 3 - 1), .0025] for i in range(150)]
        self.start = dict(segment=0, frames_given=5, resets=0, refused=False, reference=dict(index=0, timestamp=0.),
                          target=dict(index=4, timestamp=.4), camera=dict(fx=50., fy=50., cx=31.5, cy=23.5), points=points,
                          poses=[dict(index=4, T_cam_ref=tr.inverse(tr.pose_of([0, *centre, 0, 0, 0, 1])).tolist())],
                          milliseconds=dict(total=100., last_frame=40.))
        self.write_json('initialization.json', dict(initializations=[dict(self.start, refused=True), self.start]))

    def write_json(self, name, content):
        (self.out / name).write_text(json.dumps(content))

    def judge(self, code=0):
        sequence = dict(groundtruth=str(self.data / 'groundtruth.txt'), path=str(self.data), format='auto')
        return judge.judge(dict(exit_code=code), self.folder / 'run', sequence, False)

    def test_a_good_run(self):
        figures = self.judge()
        self.assertIsNone(figures['error'])
        self.assertTrue(figures['good'])
        self.assertAlmostEqual(figures['frames']['scale'], 2, places=6)
        self.assertLess(figures['keyframes']['ate_over_path'], 1e-8)
        self.assertEqual((figures['tracked'], figures['tracked_after'], figures['ms_track']), (25, 1., 2.5))
        start, = figures['starts']  # the one refused does not count
        self.assertEqual((start['frames_given'], start['since_ref'], start['points']), (5, 4, 150))
        self.assertLess(start['dir_deg'], 1e-5)
        # a third each of 1/1.1, 1 and 1.1 times the true inverse depth: the best scale lies between two of them, 4.8 % from each
        self.assertAlmostEqual(start['depth']['median'], .1 / 2.1, delta=1e-3)
        self.assertAlmostEqual(start['depth']['within10'], 2 / 3, places=12)

    def test_tables_with_covariances_are_judged_by_them(self):
        names = ['rel_tx', 'rel_ty', 'rel_tz', 'rel_qx', 'rel_qy', 'rel_qz', 'rel_qw'] + [f'cov_{i}{j}' for i in range(6) for j in range(i, 6)]
        poses, lines = [tr.pose_of(row) for row in tr.load_tum(self.out / 'trajectory.txt')], []
        for i, line in enumerate((self.out / 'frames.csv').read_text().splitlines()):
            if i == 0:
                lines.append(','.join([line, 'image', 'keyframe', *names]))
            elif 'tracked' not in line:
                lines.append(line + ',' * (len(names) + 2))
            else:
                row = tr.row_of(0, tr.inverse(poses[i - 1]) @ poses[4])[1:]
                row[0] += .01 * (-1) ** i  # one standard deviation
                covariance = [1e-4 if a == b else 0 for a in range(6) for b in range(a, 6)]
                lines.append(','.join([line, '', '4', *map(str, row), *map(str, covariance)]))
        (self.out / 'frames.csv').write_text('\n'.join(lines) + '\n')
        figures = self.judge()
        self.assertIsNone(figures['error'])
        self.assertLess(figures['nees_tracked_rot'], 1e-6)
        self.assertAlmostEqual(figures['nees_tracked_trans'], 1 / 3, delta=.03)

    def test_another_segment_is_not_judged_with_the_first(self):
        lines = (self.out / 'frames.csv').read_text().splitlines()
        lines[21:] = [line[:-1] + '1' for line in lines[21:]]
        (self.out / 'frames.csv').write_text('\n'.join(lines) + '\n')
        self.write_json('run.json', dict(status='tracked', segments=2, peak_memory_mb=80.))
        figures = self.judge()
        self.assertEqual(figures['frames']['poses'], 20)
        self.assertFalse(figures['good'])

    def test_broken_files_make_a_failed_run(self):
        (self.out / 'run.json').write_text('{"status": NaN}')
        self.assertTrue(self.judge()['crashed'])
        (self.out / 'run.json').write_text('{"status":')
        self.assertIn('JSONDecodeError', self.judge()['error'])

    def test_nan_is_counted(self):
        with open(self.out / 'trajectory.txt', 'a') as file:
            file.write('9.0 nan 0 0 0 0 0 1\n')
        self.assertEqual(self.judge()['nonfinite'], 1)
        self.assertFalse(self.judge()['good'])

    def test_exit_code_decides_what_failed(self):
        self.assertTrue(self.judge(code=-11)['crashed'])
        self.assertFalse(self.judge(code=3)['crashed'])


if __name__ == '__main__':
    unittest.main()
