# SPDX-License-Identifier: BSD-3-Clause
"""Reading recordings, also while they grow, and turning them into .rrd files without a window."""
import json
import os
import re
import subprocess
import sys
import tempfile
import threading
import time
import unittest
from pathlib import Path

import numpy as np
from PIL import Image

from dsorb_eval import recording, rerun_view
from dsorb_eval.trajectory import FormatError

SCRIPTS = Path(__file__).resolve().parents[2] / 'scripts'
CAMERA = dict(fx=100, fy=100, cx=31.5, cy=23.5, width=64, height=48)
HEADER = dict(kind='header', format='dsorb-recording', version=1, program='p 1', dataset='d', initializer='orb', camera=CAMERA)


def frame_events(index, segment=0):
    """What is written of one tracked frame that moves by one along z."""
    pose = [0, 0, index, 0, 0, 0, 1]
    return [dict(kind='image', index=index, timestamp=index / 10, segment=segment, file=f'run_images/{index}.png', rectified=True),
            dict(kind='of a later version', index=index),
            dict(kind='keyframe', index=index, timestamp=index / 10, segment=segment, final=False, pose=pose),
            dict(kind='points', keyframe=index, segment=segment, final=False,
                 points=[[31.5, 23.5, .5, 1e-4, 200], [131.5, 23.5, .25, 1e-4, 100], [0, 0, .5, 1., 10]]),
            dict(kind='pose', index=index, timestamp=index / 10, segment=segment, state='tracked', is_keyframe=True, pose=pose,
                 keyframe=index, rmse=4., affine=[0, 0]),
            dict(kind='tracks', index=index, segment=segment, source='map_points', tracks=[[3, 4, .5]])]


class Recordings(unittest.TestCase):
    def setUp(self):
        holder = tempfile.TemporaryDirectory(prefix='dsorb_recording_')
        self.addCleanup(holder.cleanup)
        self.folder = Path(holder.name)
        self.path = self.folder / 'recording.jsonl'

    def write(self, events, end=True):
        lines = [HEADER, *events, *([dict(kind='end', status='tracked')] if end else [])]
        self.path.write_text(''.join(json.dumps(event) + '\n' for event in lines))

    def images(self, count):
        (self.folder / 'run_images').mkdir()
        for i in range(count):
            Image.fromarray(np.full((48, 64), 40 * i, np.uint8)).save(self.folder / 'run_images' / f'{i}.png')

    def test_points_in_the_world(self):
        points = recording.certain(frame_events(0)[3]['points'], .3)
        self.assertEqual(len(points), 2)  # the third is known to twice its own value only
        turned = recording.pose([1, 0, 0, 0, np.sqrt(.5), 0, np.sqrt(.5)])  # by 90 degrees about y: z becomes x
        np.testing.assert_allclose(recording.world_points(points, turned, CAMERA), [[3, 0, 0], [5, 0, -4]], atol=1e-12)

    def test_an_unfinished_last_line_is_left_out(self):
        self.write([dict(kind='lost', index=1, segment=0)], end=False)
        with open(self.path, 'a') as file:
            file.write('{"kind": "po')
        self.assertEqual([e['kind'] for e in recording.events(self.path)], ['header', 'lost'])

    def test_following_a_run_that_writes(self):
        self.write([], end=False)

        def write():
            for piece in ('{"kind": "lo', 'st", "index": 1, "segment": 0}\n', '{"kind": "end", "status": "lost"}\n'):
                time.sleep(.15)
                with open(self.path, 'a') as file:
                    file.write(piece)
        writer = threading.Thread(target=write)
        writer.start()
        self.assertEqual([e['kind'] for e in recording.events(self.path, follow=True, patience=30)], ['header', 'lost', 'end'])
        writer.join()

    def test_mistakes_name_file_and_line(self):
        self.write([], end=False)
        with open(self.path, 'a') as file:
            file.write('[1, 2]\n')
        with self.assertRaisesRegex(FormatError, r'recording\.jsonl:2: expected one JSON object'):
            list(recording.events(self.path))
        self.path.write_text(json.dumps(dict(HEADER, version=2)) + '\n')
        with self.assertRaisesRegex(FormatError, 'version 1'):
            list(recording.events(self.path))
        with self.assertRaisesRegex(FileNotFoundError, '--record'):
            recording.find(tempfile.mkdtemp(dir=self.folder))

    def test_rrd_holds_images_tracks_path_keyframes_and_map(self):
        self.images(3)
        self.write([e for i in range(3) for e in frame_events(i)] + frame_events(0, segment=1))
        target = self.folder / 'run.rrd'
        self.assertEqual(rerun_view.show(self.path, save=target), 4)
        text = subprocess.run([Path(sys.executable).with_name('rerun'), 'rrd', 'print', target], check=True, capture_output=True,
                              text=True, env=dict(os.environ, HOME=str(self.folder))).stdout
        entities = set(re.findall(r'/segment_[\w/]+', text))
        for entity in ('camera', 'camera/image', 'camera/image/tracks', 'path/0', 'keyframes/2', 'map/2'):
            self.assertIn(f'/segment_0/{entity}', entities)
        self.assertIn('/segment_1/map/0', entities)

    def test_a_long_path_is_kept_in_pieces_that_meet(self):
        view = rerun_view.View(self.path, None, .3)
        logged = {}
        view.log = lambda entity, what, static=False: logged.__setitem__(entity, what)
        view.paths['s'] = []
        for i in range(250):
            view.paths['s'].append(np.array([i, 0, 0.]))
            view.log_path('s', i)
        strips = [np.array(logged[f's/path/{chunk}'].strips.as_arrow_array().to_pylist()[0]) for chunk in range(3)]
        self.assertEqual([(s[0][0], s[-1][0]) for s in strips], [(0, 100), (100, 200), (200, 249)])

    @unittest.skipUnless(os.path.exists(os.environ.get('DSO_DATASET', '')), 'DSO_DATASET names no program')
    def test_what_the_program_records_is_understood(self):
        subprocess.run([os.environ['DSO_SYNTHESIZE'], 'room', '-o', self.folder / 'room', '--frames', '20', '--width', '320', '--height',
                        '240', '--threads', '1', '--quiet'], check=True)
        out = self.folder / 'out'
        subprocess.run([os.environ['DSO_DATASET'], self.folder / 'room', '--output', out, '--record', out / 'recording.jsonl',
                        '--threads', '1', '--quiet'], check=True)
        answer = subprocess.run([sys.executable, SCRIPTS / 'view_rerun.py', out, '--save', self.folder / 'run.rrd'],
                                capture_output=True, text=True, env=dict(os.environ, DSORB_VENV=sys.prefix))
        self.assertEqual(answer.returncode, 0, answer.stderr)
        self.assertIn('20 images', answer.stdout)
        kinds = [event['kind'] for event in recording.events(out / 'recording.jsonl')]
        self.assertEqual(set(kinds), {'header', 'image', 'init', 'pose', 'keyframe', 'points', 'tracks', 'end'})
        self.assertGreater((self.folder / 'run.rrd').stat().st_size, 20 * 1000)  # the images alone


if __name__ == '__main__':
    unittest.main()
