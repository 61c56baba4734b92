# SPDX-License-Identifier: BSD-3-Clause
"""The command `dsorb`, as it is installed or by its module."""
import itertools
import json
import math
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import time
import unittest
from pathlib import Path

import numpy as np
from dsorb import Camera, command_line, evidence
from dsorb.pictures import EXIF_IFD, FOCAL_LENGTH_35MM
from dsorb.run_folder import FORMATS, read_run
from dsorb.summary import of_lens, summarize
from PIL import Image
from room import FRAMES, SIZE, image_files, images, room, room_run, temporary_folder

try:
    import cv2
except ImportError:
    cv2 = None


def dsorb(*words, **options):
    return subprocess.run([sys.executable, '-m', 'dsorb.command_line', *map(str, words)], capture_output=True, text=True,
                          check=False, **options)


class Run(unittest.TestCase):
    def test_it_leaves_what_the_program_leaves(self):
        output = temporary_folder() / 'out'
        done = dsorb('run', room(), '--output', output)
        self.assertEqual(done.returncode, 0, done.stderr)
        files = {f.relative_to(output) for f in output.rglob('*')}
        self.assertEqual(files, {f.relative_to(room_run()) for f in room_run().rglob('*')})
        for name in ('trajectory.txt', 'keyframes.txt', 'points.ply', 'config.yaml'):
            self.assertEqual((output / name).read_bytes(), (room_run() / name).read_bytes(), name)
        self.assertIn(f'{FRAMES} of {FRAMES} images have a pose (100 %)', done.stdout)
        self.assertRegex(done.stdout, r'direction \+-\d\.\d deg, wrong by more than 10 deg with probability [\d.e-]+ %, depths \+-\d %')
        self.assertNotIn('stood in the way', done.stdout)

    def test_images_alone_are_enough(self):
        folder = temporary_folder()
        shutil.copytree(room() / 'images', folder / 'images')  # beside no calibration
        done = dsorb('run', folder / 'images', '--output', folder / 'out')
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn(f'{FRAMES} of {FRAMES} images have a pose (100 %)', done.stdout)
        self.assertRegex(done.stdout, r'focal length \d+(\.\d)? \+- \d+(\.\d)? px \(\d+\.\d degrees\)')
        self.assertNotIn('suspected', done.stdout)
        found = json.loads((folder / 'out' / 'run.json').read_text())['found_camera']
        self.assertAlmostEqual(found['fx'] / 200, 1, delta=.03)

    def test_options_of_the_program_are_passed_on(self):
        output = temporary_folder() / 'out'
        done = dsorb('run', room(), '--output', output, '--end', '30', '--set', 'orb.min_frames=9', '--quiet')
        self.assertEqual((done.returncode, done.stdout), (0, ''), done.stderr)
        self.assertEqual(json.loads((output / 'run.json').read_text())['frames_given'], 30)
        self.assertIn('min_frames: 9', (output / 'config.yaml').read_text())

    def test_options_may_stand_before_the_input(self):
        for words, rest in ((['--end', '30', 'clip.mp4', '--hfov', '70'], ['--end', '30']),
                            (['--reverse', 'clip.mp4', '--hfov=70', '--set', 'seed=3'], ['--reverse', '--set', 'seed=3']),
                            (['--width=640', '--export', 'tum', '--hfov', '70', 'clip.mp4', '--end'], ['--width=640', '--end'])):
            args, found = command_line.parse(['run', *words])
            self.assertEqual((args.input, args.hfov, found), ('clip.mp4', '70', rest))

    def test_the_output_is_named_after_the_input(self):
        folder = temporary_folder()
        done = dsorb('run', room(), '--end', '3', cwd=folder)
        self.assertEqual(done.returncode, 3, done.stderr)
        self.assertTrue((folder / 'out' / 'room' / 'run.json').exists())

    def test_exit_codes_and_texts_are_those_of_the_program(self):
        for words, code, text in ((('nowhere',), 1, 'nowhere'), ((room(), '--set', 'orb.min_frmes=3'), 2, 'min_frames'),
                                  ((room(), '--hfov', '400'), 2, '400'), ((), 2, 'no video')):
            done = dsorb('run', *words, cwd=temporary_folder())
            self.assertEqual(done.returncode, code, done.stderr)
            self.assertIn(text, done.stderr)
            self.assertNotIn('Traceback', done.stderr)

    def test_an_unknown_format_is_refused_before_anything_runs(self):
        folder = temporary_folder()
        done = dsorb('run', room(), '--export', 'colmap,kml', cwd=folder)
        self.assertEqual(done.returncode, 2)
        self.assertIn("'kml': expected some of tum,", done.stderr)
        self.assertEqual(list(folder.iterdir()), [])

    def test_what_the_program_tells_is_told(self):
        for words, text in ((('--version',), 'dso_dataset'), ((room(), '--print-config', '--set', 'orb.min_frames=3'), 'min_frames: 3')):
            folder = temporary_folder()
            done = dsorb('run', *words, cwd=folder)
            self.assertEqual(done.returncode, 0, done.stderr)
            self.assertIn(text, done.stdout)
            self.assertEqual(list(folder.iterdir()), [])

    def test_flags_of_exports_are_refused_without_one(self):
        for flag in ('--undistort', '--refine', '--all-frames'):
            done = dsorb('run', room(), flag, cwd=temporary_folder())
            self.assertEqual(done.returncode, 2)
            self.assertIn('expected beside --export', done.stderr)

    def test_interrupted_it_keeps_what_was_computed(self):
        output = temporary_folder() / 'out'
        with subprocess.Popen([sys.executable, '-m', 'dsorb.command_line', 'run', room(), '--output', output, '--speed', '0.1'],
                              stdout=subprocess.PIPE, text=True, start_new_session=True) as process:
            table, end = output / 'frames.csv', time.monotonic() + 60
            while not (table.exists() and table.read_text().count('\n') > 2) and time.monotonic() < end:
                time.sleep(0.05)
            os.killpg(process.pid, signal.SIGINT)  # as a terminal does
            text = process.communicate(timeout=60)[0]
        self.assertEqual(json.loads((output / 'run.json').read_text())['status'], 'interrupted')
        self.assertEqual(process.returncode, 3)
        self.assertIn('images have a pose', text)


    def test_names_may_hold_any_bytes(self):
        folder = Path(os.fsdecode(os.fsencode(temporary_folder()) + b'/caf\xe9'))
        (folder / 'images').mkdir(parents=True)
        for i, file in enumerate(image_files()):
            shutil.copy(file, os.fsencode(folder) + b'/images/\xe9 %04d.png' % i)
        shutil.copy(room() / 'camera.txt', folder)
        output = Path(f'{folder}_out')
        done = subprocess.run([sys.executable, '-m', 'dsorb.command_line', 'run', folder, '--output', output, '--export', ','.join(FORMATS)],
                              capture_output=True, check=False)
        self.assertEqual((done.returncode, done.stderr.count(b'Traceback')), (0, 0), done.stderr)
        self.assertIn(os.fsencode(output) + b': trajectory.txt', done.stdout)
        self.assertIn(b'\xe9 0000.png', (output / 'colmap/sparse/0/images.bin').read_bytes())
        self.assertIn(b'\xe9 0000.png', (output / 'tum/images.txt').read_bytes())
        self.assertEqual(read_run(output).dataset, str(folder))

    def test_interrupted_while_a_camera_does_not_answer(self):
        output = temporary_folder() / 'out'
        shutil.copytree(room_run(), output)
        with socket.create_server(('127.0.0.1', 0)) as silent:
            address = f'rtsp://127.0.0.1:{silent.getsockname()[1]}/x'
            with subprocess.Popen([sys.executable, '-m', 'dsorb.command_line', 'run', address, '--calib', room() / 'camera.txt', '--output',
                                   output, '--export', 'tum'], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
                                  start_new_session=True) as process:
                with silent.accept()[0]:
                    time.sleep(1)
                    os.killpg(process.pid, signal.SIGINT)
                    told, errors = process.communicate(timeout=60)
        self.assertEqual((process.returncode, 'Traceback' in errors), (3, False), errors)
        self.assertIn('No image was read', told)
        self.assertEqual(json.loads((output / 'run.json').read_text())['status'], 'interrupted')

    def test_a_terminal_that_is_closed_ends_a_run(self):
        output = temporary_folder() / 'out'
        with subprocess.Popen([sys.executable, '-m', 'dsorb.command_line', 'run', room(), '--output', output, '--speed', '0.1'],
                              stdout=subprocess.DEVNULL) as process:
            while not (output / 'frames.csv').exists():
                time.sleep(0.05)
            process.send_signal(signal.SIGHUP)
            process.wait(60)
        self.assertEqual(json.loads((output / 'run.json').read_text())['status'], 'interrupted')

    def test_damaged_folders_are_named(self):
        for name, size in itertools.product(('run.json', 'frames.csv', 'trajectory.txt', 'points.ply', 'keyframes.txt'), (0, 90, 930)):
            output = temporary_folder() / 'out'
            shutil.copytree(room_run(), output)
            os.truncate(output / name, size)
            done = dsorb('export', output, '--format', 'tum')
            self.assertNotIn('Traceback', done.stderr, (name, size))
            if size or name not in ('trajectory.txt', 'keyframes.txt'):
                self.assertEqual((done.returncode, f'{output}/' in done.stderr), (1, True), (name, size))
        for edit in (('"camera": {', '"camera": [{}], "c": {'), ('"fx": ', '"fx": 0, "f": '), ('"width": ', '"width": "x", "w": ')):
            output = temporary_folder() / 'out'
            shutil.copytree(room_run(), output)
            (output / 'run.json').write_text((output / 'run.json').read_text().replace(*edit, 1))
            done = dsorb('export', output, '--format', 'colmap,nerfstudio')
            self.assertEqual((done.returncode, 'run.json: not as a run leaves it' in done.stderr), (1, True), done.stderr)


class Photographs(unittest.TestCase):
    def photographs(self, focal):
        """The room as JPEG files that note a focal length in 35 mm terms."""
        folder = temporary_folder() / 'photographs'
        folder.mkdir()
        for file in image_files():
            with Image.open(file) as image:
                exif = Image.Exif()
                if focal:
                    exif.get_ifd(EXIF_IFD)[FOCAL_LENGTH_35MM] = focal
                image.save(folder / f'{file.stem}.jpg', quality=95, exif=exif)
        return folder

    def test_their_focal_length_is_used(self):
        focal = round(200 * math.hypot(36, 24) / math.hypot(*SIZE))  # 22 mm; the camera has 200 px
        self.assertIn('--hfov', command_line.words_of(*command_line.parse(['run', str(self.photographs(focal)), '--hfov', 'exif']), Path('out')))
        output = temporary_folder() / 'out'
        done = dsorb('run', self.photographs(focal), '--hfov', 'exif', '--output', output)
        self.assertEqual(done.returncode, 0, done.stderr)
        lens = json.loads((output / 'run.json').read_text())['lens']
        self.assertAlmostEqual(lens['fx'] / 200, 1, delta=.03)  # a guess that the run makes better

    def test_without_one_it_says_so(self):
        done = dsorb('run', self.photographs(0), '--hfov', 'exif', '--output', temporary_folder() / 'out')
        self.assertEqual(done.returncode, 1)
        self.assertIn('00000.jpg: notes no focal length', done.stderr)
        done = dsorb('run', 'clip.mp4', '--hfov', 'exif', '--output', temporary_folder() / 'out')
        self.assertIn('clip.mp4: no folder of JPEG files', done.stderr)


class Obstacles(unittest.TestCase):
    def test_the_summary_has_what_was_found_out_about_the_camera(self):
        camera = {'fx': 500, 'fy': 510}
        refined = {'fx': 404, 'fy': 400, 'sigma': {'fx': 1.01, 'fy': 2}, 'settled': True}
        self.assertEqual(of_lens({'camera': camera}), [])
        self.assertEqual(of_lens({'camera': camera, 'refined_camera': {'fx': 404, 'fy': 400}}), [])  # not a guess
        found = of_lens({'camera': camera, 'refined_camera': refined, 'readout': {'milliseconds': 25.04, 'sigma': .4}})
        self.assertEqual(found, ['  focal length 402.0 px, guessed as 505.0: +-0.5 %; refined_camera.txt is the calibration for the next run',
                                 '  calibration suspected: the images tell a focal length of 402 px, 20 % less than the 505 px given. '
                                 'Begin again with a focal length near that, or calibrate',
                                 '  rolling shutter: 25.0 +- 0.4 ms from the first to the last row'])
        found = of_lens({'camera': camera, 'refined_camera': {**refined, 'settled': False}, 'readout': {'milliseconds': -1, 'sigma': .4}})
        self.assertIn('guessed as 505.0: not known to 1 % yet', found[0])
        self.assertIn('calibration suspected: the images contradict the focal length of 505 px given without telling another', found[1])
        self.assertNotIn('402', found[1])
        self.assertEqual(found[2], '  no rolling shutter shows: -1.0 +- 0.4 ms from the first to the last row')

    def test_a_calibration_is_suspected_only_by_evidence(self):
        camera = {'fx': 500, 'fy': 500}
        for focal, sigma, suspected in ((560, 5, True), (540, 5, False), (560, 15, False), (440, 5, True)):
            refined = {'fx': focal, 'fy': focal, 'sigma': {'fx': sigma, 'fy': sigma}, 'settled': False}
            found = of_lens({'camera': camera, 'refined_camera': refined})
            self.assertEqual(any('calibration suspected' in line for line in found), suspected, (focal, sigma))

    def test_the_first_keyframes_may_contradict_the_calibration(self):
        camera = {'fx': 500, 'fy': 510}
        doubt = {'focal_change': -.3, 'focal_sigma': .05}
        found = of_lens({'camera': camera, 'calibration_suspected': doubt})
        self.assertEqual(found, ['  calibration suspected: the first keyframes ask for a shorter focal length than the 505 px given (by 6.0 standard '
                                 'deviations; chance explains 4). Give the field of view to --hfov, or calibrate (docs/calibration.md); a rolling shutter '
                                 'does the same (--readout auto)'])
        found = of_lens({'camera': camera, 'lens': {'fx': 1000, 'fy': 1020}, 'calibration_suspected': doubt})
        self.assertIn('than the 1010 px given', found[0])  # of the images as they were taken
        found = of_lens({'camera': camera, 'calibration_suspected': {**doubt, 'radial': -.1, 'radial_sigma': .01}})
        self.assertIn('ask for more barrel distortion than given (by 10.0', found[0])
        found = of_lens({'camera': camera, 'calibration_suspected': {'radial': .1, 'radial_sigma': .02}})
        self.assertIn('more pincushion distortion', found[0])
        refined = {'fx': 404, 'fy': 400, 'sigma': {'fx': 1, 'fy': 1}, 'settled': True}
        found = of_lens({'camera': camera, 'calibration_suspected': doubt, 'refined_camera': refined})
        self.assertEqual(sum('calibration suspected' in line for line in found), 1)  # the window knows it by now

    def summary_of(self, kind, *options):
        """Text of a run in which nothing starts."""
        folder = temporary_folder()
        subprocess.run([os.environ['DSO_SYNTHESIZE'], kind, '--output', folder / 'in', '--frames', '20', '--width', '320',
                        '--height', '240', '--quiet', *options], check=True)
        done = dsorb('run', folder / 'in', '--output', folder / 'out')
        self.assertEqual(done.returncode, 3, done.stderr)
        self.assertIn('0 of 20 images have a pose (0 %)', done.stdout)
        self.assertEqual('images without a pose show' in done.stdout, cv2 is not None)
        return done.stdout

    def test_a_camera_that_stands_is_told_to_move(self):
        text = self.summary_of('static')
        self.assertRegex(text, r'\d+ x too_little_parallax: the camera hardly moved')
        if cv2:
            self.assertRegex(text, r'stood still: over 10 images points move by 0\.\d px')

    def test_a_camera_that_turns_is_told_to_walk(self):
        text = self.summary_of('rotation')
        if cv2:
            self.assertRegex(text, r'turned on the spot: .* by \d+\.\d px, and by 0\.\d px without its turn of \d+\.\d deg')

    def test_darkness_is_named(self):
        text = self.summary_of('room', '--light', '0.01')
        if cv2:
            self.assertRegex(text, r'too dark: the mean grey level is \d of 255')
            self.assertNotIn('tracking_lost', text)  # follows from it
        else:
            self.assertRegex(text, r'tracking_lost: .*darkness')

    @unittest.skipUnless(cv2, "OpenCV's Python module is not installed")
    def test_fast_motion_and_missing_texture_are_named(self):
        image, camera = images()[0], Camera(200, 200, 159.5, 119.5, *SIZE)
        seen = evidence.look(cv2, camera, [np.roll(image, 60 * i, axis=1) for i in range(10)])
        self.assertIn('fast motion', evidence.findings(seen)[0])
        ramp = np.tile(np.linspace(50, 200, SIZE[0]).astype(np.uint8), (SIZE[1], 1))
        self.assertIn('too little texture', evidence.findings(evidence.look(cv2, camera, [ramp] * 10))[0])
        self.assertEqual(evidence.findings(evidence.look(cv2, camera, images()[:10])), [])

    def test_images_that_are_gone_leave_the_counts(self):
        run = read_run(room_run())
        run.segments = []
        self.assertIsNotNone(evidence.gather(run) or cv2 is None)
        run.rows = [row._replace(image='/nowhere.png') for row in run.rows]
        self.assertIsNone(evidence.gather(run))

    def test_segments_and_losses_are_told(self):
        cut = temporary_folder() / 'cut'
        subprocess.run([os.environ['DSO_SYNTHESIZE'], 'cut', '--output', cut, '--frames', '60', '--width', '320',
                        '--height', '240', '--quiet'], check=True)
        output = temporary_folder() / 'out'
        done = dsorb('run', cut, '--output', output, '--export', 'tum,colmap')
        run = read_run(output)
        self.assertEqual(len(run.segments), 2, done.stdout)
        self.assertIn('in 2 segments', done.stdout)
        self.assertIn('tracking was lost 1 time(s)', done.stdout)
        for place, segment in enumerate(run.segments):
            poses = np.loadtxt(output / f'tum/trajectory{"_1" if place else ""}.txt')
            self.assertEqual(len(poses), len(segment.frames))
            hosts = set(segment.points.keyframes)
            self.assertTrue(hosts <= {f.index for f in segment.frames})
            self.assertTrue((output / f'colmap/sparse/{place}/points3D.bin').exists())
        self.assertEqual(done.stdout.splitlines()[0], summarize(run).splitlines()[0])
        longest = max(run.segments, key=lambda segment: len(segment.frames)).number
        self.assertIn(f'trajectory.txt (segment {longest}, the longest; trajectory_N.txt the others)', done.stdout)
        for name in ('trajectory', 'keyframes'):
            self.assertEqual((output / f'{name}.txt').read_text(), (output / f'{name}_{longest}.txt').read_text())
            (output / f'{name}_{run.segments[0].number}.txt').replace(output / f'{name}.txt')  # as a run leaves them that is killed
        self.assertEqual([[f.index for f in segment.frames] for segment in read_run(output).segments],
                         [[f.index for f in segment.frames] for segment in run.segments])

    def test_images_that_were_dropped_count(self):
        run = read_run(room_run())
        run.summary['frames_dropped'] = 3 * FRAMES
        text = summarize(run)
        self.assertIn(f'{FRAMES} of {4 * FRAMES} images have a pose (25 %)', text)
        self.assertIn(f'{3 * FRAMES} came while the run was busy and were left out', text)
        self.assertNotIn('stood in the way', text, 'of those that were looked at all have a pose')

    def test_a_call_that_did_not_run_tells_nothing_of_an_earlier_run(self):
        output = temporary_folder() / 'out'
        shutil.copytree(room_run(), output)
        summary = json.loads((output / 'run.json').read_text())
        (output / 'run.json').write_text(json.dumps({**summary, 'status': 'error'}))
        done = dsorb('run', room(), '--calib', 'nowhere.txt', '--output', output, '--export', 'tum')
        self.assertEqual((done.returncode, done.stdout), (1, ''))
        self.assertFalse((output / 'tum').exists())


@unittest.skipUnless(cv2, "OpenCV's Python module is not installed")
class Videos(unittest.TestCase):
    def clip(self, folder):
        """The room as folder/clip.avi. @return its images"""
        pictures = [cv2.imread(str(f)) for f in image_files()]
        video = cv2.VideoWriter(str(folder / 'clip.avi'), cv2.VideoWriter_fourcc(*'MJPG'), 30, pictures[0].shape[1::-1])
        for image in pictures:
            video.write(image)
        video.release()
        return pictures

    def test_a_video_that_is_cut_off_is_told_and_exported_until_there(self):
        folder = temporary_folder()
        self.clip(folder)
        os.truncate(folder / 'clip.avi', (folder / 'clip.avi').stat().st_size * 7 // 10)
        done = dsorb('run', folder / 'clip.avi', '--calib', room() / 'camera.txt', '--output', folder / 'out', '--export', 'tum,colmap')
        self.assertEqual(done.returncode, 1, done.stderr)
        self.assertRegex(done.stderr, f'clip.avi: ends after .* of about {FRAMES} images')
        posed, given = map(int, re.match(r'(\d+) of (\d+) images have a pose', done.stdout).groups())
        self.assertEqual(len(np.loadtxt(folder / 'out/tum/trajectory.txt')), posed)
        self.assertGreater(posed, FRAMES // 2)
        self.assertLess(given, FRAMES)
        self.assertTrue((folder / 'out/colmap/sparse/0/points3D.bin').exists())

    def test_a_video_is_found_again_from_another_folder(self):
        folder = temporary_folder()
        self.clip(folder)
        done = dsorb('run', 'clip.avi', '--calib', room() / 'camera.txt', '--output', 'out', cwd=folder)
        self.assertEqual(done.returncode, 0, done.stderr)
        done = dsorb('export', '.', '--format', 'nerfstudio', cwd=folder / 'out')
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertTrue((folder / 'out/nerfstudio/transforms.json').exists())

    def test_a_video_becomes_models_with_images(self):
        folder = temporary_folder()
        pictures = self.clip(folder)
        done = dsorb('run', folder / 'clip.avi', '--calib', room() / 'camera.txt', '--output', folder / 'out',
                     '--export', 'nerfstudio,colmap')
        self.assertEqual(done.returncode, 0, done.stderr)
        frames = json.loads((folder / 'out/nerfstudio/transforms.json').read_text())['frames']
        self.assertGreater(len(frames), 3)
        for frame in frames:
            written = cv2.imread(str(folder / 'out/nerfstudio' / frame['file_path']))
            index = int(os.path.splitext(os.path.basename(frame['file_path']))[0])
            self.assertLess(np.abs(written.astype(float) - pictures[index]).mean(), 4)  # of JPEG, twice; another image: 20
            self.assertTrue((folder / 'out/colmap/images' / os.path.basename(frame['file_path'])).exists())


if __name__ == '__main__':
    unittest.main()
