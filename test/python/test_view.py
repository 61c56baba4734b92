# SPDX-License-Identifier: BSD-3-Clause
"""Reading recordings, also while they grow, turning them into .rrd files and showing them in a browser, without a window."""
import json
import os
import re
import shutil
import socket
import subprocess
import sys
import tempfile
import threading
import time
import unittest
import unittest.mock
from pathlib import Path

import numpy as np
from dsorb import recording
from dsorb.recording import FormatError
from PIL import Image
from room import FRAMES, room, room_run, temporary_folder

try:
    from dsorb import rerun_view
except ImportError:
    raise unittest.SkipTest('the package rerun-sdk is not installed') from None

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
                 keyframe=index, rmse=4., affine=[0, 0])]


def entities_of(file):
    """Names of what is in an .rrd file."""
    text = subprocess.run([shutil.which('rerun', path=Path(sys.executable).parent) or 'rerun', 'rrd', 'print', file], check=True,
                          capture_output=True, text=True, env=dict(os.environ, HOME=str(temporary_folder()))).stdout
    return set(re.findall(r'/segment_[\w/]+', text))


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
        self.assertEqual([e['kind'] for e in recording.events(self.path, recording.patient(30))], ['header', 'lost', 'end'])
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
        window = rerun_view.Window('test', save=target)
        self.assertEqual(window.play(self.path), 4)
        window.close()
        entities = entities_of(target)
        for entity in ('camera', 'camera/image', 'camera/image/tracks', 'path/0', 'keyframes/2', 'map/2'):
            self.assertIn(f'/segment_0/{entity}', entities)
        self.assertIn('/segment_1/map/0', entities)

    def test_tracks_are_the_points_of_the_keyframe_as_the_frame_sees_them(self):
        view, logged = rerun_view.View(self.path, None, .3), []
        view.log = lambda entity, what, static=False: logged.append(what) if entity.endswith('/tracks') else None
        view.camera, view.rectified = CAMERA, True
        for event in (dict(kind='keyframe', index=0, segment=0, final=False, pose=[0, 0, 0, 0, 0, 0, 1]),
                      # At depth 2; one unit nearer the first is twice as far from the middle, the others are behind the camera and outside.
                      dict(kind='points', keyframe=0, segment=0, final=False,
                           points=[[41.5, 23.5, .5, 1., 9], [41.5, 23.5, 1.25, 1., 9], [61.5, 23.5, .5, 1., 9]]),
                      dict(kind='pose', index=1, segment=0, keyframe=0, pose=[0, 0, 1, 0, 0, 0, 1])):
            view.show(event)
        tracks, = logged
        self.assertEqual(tracks.positions.as_arrow_array().to_pylist(), [[52, 24]])

    def test_images_are_those_of_the_recording(self):
        self.images(1)
        view = rerun_view.View(self.path, None, .3)
        other = temporary_folder() / 'image.png'
        other.write_bytes((self.folder / 'run_images/0.png').read_bytes())
        (self.folder / 'link.png').symlink_to(other)
        (self.folder / 'notes.png').write_text('mine')
        for name, shown in (('run_images/0.png', True), ('/etc/passwd', False), (str(other), False), ('link.png', False),
                            (os.path.relpath(other, self.folder), False), ('notes.png', False), ('/dev/null', False), ('.', False)):
            self.assertEqual(view.may_show(self.folder / name), shown, name)

    def test_damaged_recordings_are_named(self):
        for event in (dict(kind='pose', segment=0, pose=[1]), dict(kind='pose'), dict(kind='points', segment=0, keyframe=0, points=[[1]]),
                      dict(kind='image', index=0, segment={}, file=3)):
            self.write([event])
            with self.assertRaisesRegex(FormatError, rf'recording.jsonl:2: a `{event["kind"]}` that'):
                rerun_view.Window('test', save=self.folder / 'run.rrd').play(self.path)

    def test_a_file_of_others_is_not_replaced(self):
        (self.folder / 'camera.txt').write_text('mine')
        with self.assertRaisesRegex(OSError, 'is no recording of Rerun'):
            rerun_view.Window('test', save=self.folder / 'camera.txt')
        self.assertEqual((self.folder / 'camera.txt').read_text(), 'mine')

    def test_a_server_listens_on_this_machine_alone(self):
        with socket.socket() as free:
            free.bind(('127.0.0.1', 0))
            port = min(free.getsockname()[1], 65000)
        for bind, listens in (('127.0.0.1', False), ('0.0.0.0', True)):
            window = rerun_view.Window('test', serve=port, bind=bind)
            self.assertEqual([rerun_view.answers(address, number) for number in (port, port + 1) for address in ('127.0.0.1', '127.0.0.2')],
                             [True, listens, True, listens])
            window.close()
            self.assertFalse(rerun_view.answers('127.0.0.1', port))

    def test_points_of_a_keyframe_are_of_its_own_camera(self):
        view = rerun_view.View(self.path, None, .3)
        logged = {}
        view.log = lambda entity, what, static=False: logged.__setitem__(entity, what)
        view.header(HEADER)
        keyframe, points = frame_events(0)[2:4]
        for camera, x in ((None, 4), (dict(CAMERA, fx=50), 8)):
            view.keyframe(keyframe if camera is None else dict(keyframe, camera=camera))
            view.points(points)
            shown = np.array(logged['segment_0/map/0'].positions.as_arrow_array().to_pylist())
            np.testing.assert_allclose(shown, [[0, 0, 2], [x, 0, 4]], atol=1e-6)

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

    def test_a_refused_start_takes_its_path_alone(self):
        view = rerun_view.View(self.path, None, .3)
        view.log = lambda entity, what, static=False: None
        view.say = lambda *words: None
        view.header(HEADER)
        start = dict(kind='init', segment=0, status='initialized', reason='enough', poses=[[0, [0, 0, 0, 0, 0, 0, 1]], [1, [0, 0, 1, 0, 0, 0, 1]]])
        refused = dict(kind='refused', index=1, segment=0, reason='depths')
        for event, poses in ((start, 2), (refused, 0), (start, 2), (start, 4), (refused, 2)):  # the third found its place again
            view.show(dict(event, index=1))
            self.assertEqual(len(view.paths['segment_0']), poses)


class Commands(unittest.TestCase):
    def dsorb(self, *words):
        return subprocess.run([sys.executable, '-m', 'dsorb.command_line', *map(str, words)], capture_output=True, text=True,
                              check=False)

    def test_a_run_is_saved_while_it_goes_on_and_viewed_later(self):
        output = temporary_folder() / 'out'
        done = self.dsorb('run', room(), '--output', output, '--save', output / 'run.rrd')
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn(f'{FRAMES} of {FRAMES} images have a pose', done.stdout)
        self.assertEqual((output / 'trajectory.txt').read_bytes(), (room_run() / 'trajectory.txt').read_bytes())
        entities = entities_of(output / 'run.rrd')
        self.assertLessEqual({f'/segment_0/{name}' for name in ('camera', 'camera/image', 'camera/image/tracks', 'path/0', 'map/0',
                                                                'keyframes/0')}, entities)
        kinds = {event['kind'] for event in recording.events(output / 'recording.jsonl')}
        self.assertEqual(kinds, {'header', 'image', 'init', 'pose', 'keyframe', 'points', 'end'})
        done = self.dsorb('view', output, '--save', output / 'again.rrd')
        self.assertEqual((done.returncode, done.stdout), (0, f'{FRAMES} images; {output / "again.rrd"}\n'), done.stderr)
        self.assertEqual(entities_of(output / 'again.rrd'), entities)

    def test_wrong_options_leave_an_earlier_recording_alone(self):
        output = temporary_folder() / 'out'
        output.mkdir()
        (output / 'recording.jsonl').write_text('precious')
        (output / 'run.rrd').write_text('precious')
        done = self.dsorb('run', room(), '--output', output, '--save', output / 'run.rrd', '--set', 'no_such_key=3')
        self.assertEqual((done.returncode, 'no_such_key' in done.stderr), (2, True), done.stderr)
        self.assertEqual({path.read_text() for path in output.iterdir()}, {'precious'})

    def test_a_port_that_is_taken_and_a_missing_display_are_named(self):
        with socket.socket() as taken:
            taken.bind(('', 0))
            taken.listen()
            port = taken.getsockname()[1]
            done = self.dsorb('run', room(), '--output', temporary_folder() / 'out', '--serve', '--port', port - 1)
        self.assertEqual((done.returncode, f'port {port}: ' in done.stderr), (1, True), done.stderr)
        environment = {key: value for key, value in os.environ.items() if key not in ('DISPLAY', 'WAYLAND_DISPLAY')}
        with unittest.mock.patch.dict(os.environ, environment, clear=True):
            done = self.dsorb('run', room(), '--output', temporary_folder() / 'out', '--view')
        self.assertEqual((done.returncode, 'use --serve or --save' in done.stderr), (1, True), done.stderr)

    def test_what_is_missing_is_said(self):
        done = self.dsorb('view', room_run(), '--save', temporary_folder() / 'run.rrd')
        self.assertEqual((done.returncode, 'no recording (*.jsonl); make one with' in done.stderr), (1, True), done.stderr)
        done = self.dsorb('run', temporary_folder(), '--save', '/proc/nowhere/run.rrd')
        self.assertEqual((done.returncode, '/proc/nowhere' in done.stderr), (1, True), done.stderr)
        done = self.dsorb('run', '/nowhere', '--output', temporary_folder() / 'out', '--save', temporary_folder() / 'run.rrd')
        self.assertEqual((done.returncode, '/nowhere: no such file' in done.stderr), (1, True), done.stderr)
        self.assertNotIn('Traceback', done.stderr)


if __name__ == '__main__':
    unittest.main()
