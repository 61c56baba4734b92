# SPDX-License-Identifier: BSD-3-Clause
import ast
import contextlib
import io
import os
import re
import shlex
import subprocess
import sys
import tempfile
import threading
import time
import unittest
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import dsorb
import numpy as np
from dsorb import command_line
from room import FRAMES, SIZE, image_files, images, render, room, true_depth, true_poses

README = Path(__file__).resolve().parents[2] / 'README.md'
CAMERA = dsorb.Camera(200, 200, 159.5, 119.5, *SIZE)


def start(initializer, pictures):
    for i, image in enumerate(pictures):
        step = initializer.add(image, timestamp=0.1 * i)
        if step.result is not None:
            return step.result
    raise AssertionError(f'no start: {step.reason}')


class Arrays(unittest.TestCase):
    def setUp(self):
        self.image = images()[0]
        self.rectifier = dsorb.Rectifier(dsorb.Calibration.read(room() / 'camera.txt'))

    def test_without_distortion_a_rectified_image_is_the_image(self):
        rectified = self.rectifier.rectify(self.image)
        self.assertEqual((rectified.dtype, rectified.shape), (np.float32, (SIZE[1], SIZE[0])))
        np.testing.assert_array_equal(rectified, self.image)

    def test_strides_of_views_are_respected(self):
        wide = np.zeros((SIZE[1], 2 * SIZE[0]), np.uint8)
        wide[:, 7:7 + SIZE[0]] = self.image
        np.testing.assert_array_equal(self.rectifier.rectify(wide[:, 7:7 + SIZE[0]]), self.image)

    def test_colour_is_blue_first_unless_said(self):
        blue = np.zeros((SIZE[1], SIZE[0], 3), np.uint8)
        blue[..., 0] = 200
        self.assertAlmostEqual(self.rectifier.rectify(blue)[0, 0], 0.114 * 200, delta=1)  # luma of ITU-R BT.601
        self.assertAlmostEqual(self.rectifier.rectify(blue, rgb=True)[0, 0], 0.299 * 200, delta=1)

    def test_masks_of_bool_and_of_grey_levels_are_the_same(self):
        mask = np.ones((SIZE[1], SIZE[0]), bool)
        mask[:50] = False
        by_flags = self.rectifier.rectify(self.image, mask)
        np.testing.assert_array_equal(by_flags, self.rectifier.rectify(self.image, mask.astype(np.uint8) * 255))
        self.assertTrue(np.isnan(by_flags[:49]).all() and not np.isnan(by_flags[51:]).any())

    def test_other_arrays_are_refused_with_what_they_are(self):
        for array, text in ((self.image.astype(float), r'\(240, 320\) and float64'), (self.image[:, ::2], 'ascontiguousarray'),
                            (self.image.T, 'ascontiguousarray'),
                            (np.broadcast_to(self.image[100], self.image.shape), 'rows overlap'), (self.image[0], r'shape \(320\)'),
                            (self.image[:100], '320x100')):
            with self.assertRaisesRegex(ValueError, text):
                self.rectifier.rectify(array)
        with self.assertRaisesRegex(ValueError, 'Rectifier makes'):
            dsorb.Initializer(CAMERA).add(np.zeros((240, 320, 3), np.uint8), 0.0)

    def test_results_outlive_what_made_them(self):
        result = start(dsorb.Initializer(CAMERA), images())
        pixels, copy = result.pixels, result.pixels.copy()
        del result
        np.testing.assert_array_equal(pixels, copy)


    def test_masks_of_masked_arrays_are_not_dropped(self):
        masked = np.ma.masked_array(self.image, self.image > 128)
        for call in (self.rectifier.rectify, lambda image: dsorb.Odometry(CAMERA).process(image, 0.0),
                     lambda image: dsorb.Initializer(CAMERA).add(image, 0.0), lambda image: dsorb.Priors().set_depth(image, .1)):
            with self.assertRaisesRegex(TypeError, 'its mask would be lost'):
                call(masked)
            with self.assertRaisesRegex(TypeError, 'expected an array, found str'):
                call('image')

    def test_a_rectifier_serves_several_threads(self):
        calibration = dsorb.Calibration(200, 200, 159.5, 119.5, *SIZE, 'radtan', [-.2, .05, 0, 0])
        rectifier, pictures, done = dsorb.Rectifier(calibration), images(), threading.Event()
        expected = [rectifier.rectify(image) for image in pictures]

        def change_mask():
            while not done.is_set():
                rectifier.set_mask(np.ones((SIZE[1], SIZE[0]), bool))
                rectifier.set_mask(None)

        thread = threading.Thread(target=change_mask)
        thread.start()
        with ThreadPoolExecutor(4) as pool:
            found = list(pool.map(rectifier.rectify, 3 * pictures))
        done.set()
        thread.join()
        self.assertTrue(all(np.array_equal(f, e, equal_nan=True) for f, e in zip(found, 3 * expected)))


class RollingShutter(unittest.TestCase):
    READOUT = 25  # [ms]

    def last_readout(self, sigma_ms):
        folder = render('rolling', '--readout', str(self.READOUT))
        calibration = dsorb.Calibration.read(folder / 'camera.txt')
        calibration.set_readout(0, sigma_ms)
        rectifier = dsorb.Rectifier(calibration)
        odometry = dsorb.Odometry(rectifier)
        for i, image in enumerate(images(folder)):
            odometry.process(rectifier.rectify(image), timestamp=i / 30)
        return odometry.finish().keyframes[-1].readout_ms

    def test_of_a_rectifier_s_frames_is_estimated(self):
        milliseconds, sigma = self.last_readout(sigma_ms=20)
        self.assertAlmostEqual(milliseconds, self.READOUT, delta=4)  # measured: 23.9, sigma 1.9
        self.assertLess(sigma, 3)

    def test_of_a_global_shutter_is_not(self):
        self.assertIsNone(self.last_readout(sigma_ms=0))

    def test_that_no_camera_has_is_refused(self):
        calibration = dsorb.Calibration.from_hfov(70, *SIZE)
        with self.assertRaisesRegex(ValueError, 'at most 1000 ms'):
            calibration.set_readout(float('nan'))
        calibration.set_readout(-12.5)
        self.assertEqual((calibration.readout_ms, calibration.readout_sigma_ms), (-12.5, 0))


class WrongCalibration(unittest.TestCase):
    def test_is_contradicted_by_the_first_keyframes(self):
        for factor, suspected in ((1, False), (.7, True)):
            odometry = dsorb.Odometry(dsorb.Camera(200 * factor, 200 * factor, 159.5, 119.5, *SIZE))
            for i, image in enumerate(images()):
                odometry.process(image, timestamp=i / 30)
            deviations = odometry.finish().keyframes[-1].calibration_deviations
            self.assertEqual(deviations > 4, suspected, (factor, deviations))


class Cameras(unittest.TestCase):
    def test_files_and_numbers_are_one(self):
        read = dsorb.Calibration.read(room() / 'camera.txt')
        made = dsorb.Calibration(200, 200, 159.5, 119.5, *SIZE)
        for name in ('model', 'fx', 'fy', 'cx', 'cy', 'width', 'height', 'coefficients', 'rectification'):
            self.assertEqual(getattr(read, name), getattr(made, name))

    def test_an_unknown_camera_is_a_guess_that_the_odometry_refines(self):
        camera = dsorb.Camera.unknown(*SIZE)
        self.assertGreater(camera.focal_sigma, 0)
        self.assertEqual(dsorb.Camera(200, 200, 159.5, 119.5, *SIZE).focal_sigma, 0)
        self.assertEqual(dsorb.Rectifier(dsorb.Calibration.unknown(*SIZE)).camera.focal_sigma, camera.focal_sigma)
        odometry = dsorb.Odometry(camera)
        keyframes = [k for i, image in enumerate(images()) for k in odometry.process(image, i / 30).keyframes]
        self.assertLess(abs(keyframes[-1].camera.fx / 200 - 1), abs(camera.fx / 200 - 1))

    def test_field_of_view(self):
        calibration = dsorb.Calibration.from_hfov(90, 640, 480)
        self.assertAlmostEqual(calibration.fx, 320)

    def test_a_file_that_is_not_there_raises_io_error(self):
        with self.assertRaisesRegex(dsorb.IoError, 'nowhere.txt'):
            dsorb.Calibration.read('nowhere.txt')
        self.assertTrue(issubclass(dsorb.IoError, RuntimeError))
        with tempfile.NamedTemporaryFile(suffix='.txt') as file:
            file.write(b'Pinhole 5\xa05 50 31.5 23.5 0\n')
            file.flush()
            with self.assertRaisesRegex(dsorb.IoError, r"\.txt:1: .*'5\\xa05', is not a finite number"):
                dsorb.Calibration.read(file.name)

    def test_impossible_lenses_are_refused(self):
        with self.assertRaisesRegex(ValueError, 'radtan'):
            dsorb.Calibration(200, 200, 160, 120, 320, 240, model='fisheye')
        with self.assertRaisesRegex(ValueError, '6 coefficients'):
            dsorb.Calibration(200, 200, 160, 120, 320, 240, model='radtan', coefficients=[0] * 6)
        with self.assertRaises(ValueError):
            dsorb.Rectifier(dsorb.Calibration(-1, 200, 160, 120, 320, 240))


class Options(unittest.TestCase):
    def test_names_are_those_of_the_configuration(self):
        for options in ({'options': {'orb.min_frames': 99, 'orb.max_frames': 99}}, {'initializer': {'kind': 'orb', 'orb': {'min_frames': 99, 'max_frames': 99}}},
                        {'options': {'initializer': {'orb': {'min_frames': 99, 'max_frames': 99}}}}):
            steps = [dsorb.Initializer(CAMERA, **options).add(images()[0], 0.0)]
            initializer = dsorb.Initializer(CAMERA, **options)
            steps = [initializer.add(image, 0.1 * i) for i, image in enumerate(images())]
            self.assertTrue(all(step.result is None for step in steps), options)

    def test_a_reference_must_live_until_it_is_tried(self):
        with self.assertRaisesRegex(dsorb.ConfigError, 'min_frames = 20 is more than orb.max_frames = 10'):
            dsorb.Initializer(CAMERA, orb={'min_frames': 20, 'max_frames': 10})

    def test_a_typing_error_is_answered_with_the_closest_key(self):
        with self.assertRaisesRegex(dsorb.ConfigError, "closest valid key is 'window.max_keyframes'"):
            dsorb.Odometry(CAMERA, window={'max_keyfames': 5})
        self.assertTrue(issubclass(dsorb.ConfigError, ValueError))

    def test_values_are_checked(self):
        for wrong in ({'orb.min_frames': 0}, {'orb.min_frames': 'six'}, {'pipelined': 1}, {'initializer': 'orbit'}):
            with self.assertRaises(dsorb.ConfigError):
                dsorb.Odometry(CAMERA, options=wrong)
        dsorb.Odometry(CAMERA, 'coarse', pipelined=False, num_threads=np.int64(1), preset='fast')


class Starts(unittest.TestCase):
    MOST_DIRECTION_DEG = 3  # measured: orb 0.57, coarse 1.28

    def test_poses_and_points_are_those_of_the_room(self):
        truth = true_poses()
        for name in ('orb', 'coarse'):
            result = start(dsorb.Initializer(CAMERA, name), images())
            last = result.frames[-1]
            expected = (np.linalg.inv(truth[last.id]) @ truth[result.frames[0].id])[:3, 3]
            found = last.T_cam_ref[:3, 3]
            cosine = expected @ found / np.linalg.norm(expected) / np.linalg.norm(found)
            self.assertLess(np.degrees(np.arccos(min(cosine, 1))), self.MOST_DIRECTION_DEG, name)
            self.assertEqual(len(result.hosts), len(result.pixels))
            self.assertAlmostEqual(result.inverse_depths[result.hosts == 0].mean(), 1, places=4)
            self.assertTrue((result.variances > 0).all())
            # the limit of the gate of `orb`; `coarse` has none and tells no less than 0.01
            self.assertLessEqual(result.report['wrong_probability'], 0.01 if name == 'orb' else 0.5)
            np.testing.assert_array_equal(result.frames[0].T_cam_ref, np.eye(4))

    def test_after_a_start_comes_a_reset(self):
        initializer = dsorb.Initializer(CAMERA)
        first = start(initializer, images())
        with self.assertRaises(RuntimeError):
            initializer.add(images()[0], 100.0)
        initializer.reset()
        second = start(initializer, images())
        np.testing.assert_array_equal(first.pixels, second.pixels)
        np.testing.assert_array_equal(first.frames[-1].T_cam_ref, second.frames[-1].T_cam_ref)


def motion(truth, i):
    """(4, 4): camera i - 1 to camera i."""
    return np.linalg.inv(truth[i]) @ truth[i - 1]


class WhatTheCallerKnows(unittest.TestCase):
    def feed(self, feeder, priors_of, every=1):
        for i, image in list(enumerate(images()))[::every]:
            answer = feeder(image, timestamp=.1 * i, id=i, priors=priors_of(i))
            found = getattr(answer, 'result', None) or getattr(answer, 'initialization', None)
            if found is not None:
                return found
        raise AssertionError('no start')

    def test_depths_start_from_two_frames_in_metres(self):
        def priors_of(i):
            priors = dsorb.Priors()
            priors.set_depth(true_depth(i).astype(np.float32), relative_sigma=.01)
            return priors
        result = self.feed(dsorb.Initializer(CAMERA).add, priors_of, every=2)
        self.assertEqual(len(result.frames), 2)
        self.assertLess(result.report['wrong_probability'], .008)  # .0046; of neighbouring images it is the .01 asked for
        self.assertTrue(result.report['depth_prior_used'])
        metres, sigma = result.metric
        reference = result.hosts == 0
        x, y = np.rint(result.pixels[reference]).astype(int).T
        self.assertAlmostEqual(np.median(true_depth(0)[y, x] * result.inverse_depths[reference]) / metres, 1, delta=.01)
        self.assertTrue(0 < sigma < .05)

    def test_poses_are_taken_and_give_metres(self):
        truth = true_poses()
        covariance = np.diag([1e-6] * 3 + [1e-8] * 3)

        def priors_of(i):
            priors = dsorb.Priors()
            if i > 0:
                priors.set_pose(i - 1, motion(truth, i), covariance)
            return priors
        result = self.feed(dsorb.Odometry(CAMERA).process, priors_of)
        self.assertTrue(result.report['pose_prior_used'])
        last = result.frames[-1]
        moved = np.linalg.norm((np.linalg.inv(truth[last.id]) @ truth[0])[:3, 3])
        self.assertAlmostEqual(result.metric[0] * np.linalg.norm(last.T_cam_ref[:3, 3]) / moved, 1, delta=.05)

    def test_rotations_say_nothing_of_metres(self):
        truth = true_poses()

        def priors_of(i):
            priors = dsorb.Priors()
            if i > 0:
                priors.set_rotation(i - 1, np.ascontiguousarray(motion(truth, i)[:3, :3]), 1e-8 * np.eye(3))
            return priors
        result = self.feed(dsorb.Initializer(CAMERA).add, priors_of)
        self.assertTrue(result.report['pose_prior_used'])
        self.assertIsNone(result.metric)
        self.assertEqual(result.stuck, [])

    def test_distances_give_metres(self):
        truth = true_poses()

        def priors_of(i):
            priors = dsorb.Priors()
            if i > 0:
                priors.set_distance(i - 1, np.linalg.norm(motion(truth, i)[:3, 3]), .001)
            return priors
        self.assertIsNotNone(self.feed(dsorb.Initializer(CAMERA).add, priors_of).metric)

    def test_impossible_ones_are_refused(self):
        priors = dsorb.Priors()
        with self.assertRaisesRegex(ValueError, 'rotation'):
            priors.set_rotation(0, 2 * np.eye(3), np.eye(3))
        with self.assertRaisesRegex(ValueError, 'sigma'):
            priors.set_sparse_depth(*SIZE, np.array([[10., 10., 2., 0.]]))
        priors.set_pose(0, np.eye(4), -np.eye(6))
        with self.assertRaisesRegex(ValueError, 'positive definite'):
            dsorb.Initializer(CAMERA).add(images()[0], 0.0, priors=priors)


    def test_dictionaries_that_hold_themselves_are_refused(self):
        options = {}
        options['window'] = options
        with self.assertRaisesRegex(ValueError, 'nested deeper than any option'):
            dsorb.Odometry(CAMERA, options=options)


class Processes(unittest.TestCase):
    """What ends or forks an interpreter that computes."""

    def check(self, code, *words):
        code = f'import os, sys, threading, time\nimport dsorb\nfrom room import images\nfrom test_module import CAMERA\n{code}'
        done = subprocess.run([sys.executable, '-c', code, *words], capture_output=True, text=True, timeout=120, check=False)
        self.assertEqual((done.returncode, done.stderr), (0, ''))
        return done.stdout

    def test_a_daemon_thread_may_compute_at_the_end(self):
        for pipelined in ('', 'yes'):
            self.check("""
odometry, pictures = dsorb.Odometry(CAMERA, num_threads=1, pipelined=bool(sys.argv[1])), images()
def work():
    for i in range(10**9):
        if odometry.process(pictures[i % len(pictures)], i * .1).state == 'lost':
            odometry.restart()
threading.Thread(target=work, daemon=True).start()
time.sleep(.5)""", pipelined)

    def test_a_pipelined_odometry_stays_where_it_was_made(self):
        told = self.check("""
odometry, pictures = dsorb.Odometry(CAMERA, num_threads=1, pipelined=True), images()
for i, image in enumerate(pictures[:30]):
    odometry.process(image, i * .1)
if os.fork() == 0:
    try:
        odometry.process(pictures[30], 3.)
    except RuntimeError as error:
        print(error, flush=True)
    del odometry
    os._exit(0)
os.wait()
odometry.process(pictures[30], 3.)""")
        self.assertIn('after fork() make another one', told)

    def test_objects_that_are_alive_at_the_end_are_no_fault(self):
        self.check('sys.kept = dsorb.Odometry(CAMERA), dsorb.Priors()')


class Runs(unittest.TestCase):
    def test_objects_say_what_they_are(self):
        odometry = dsorb.Odometry(CAMERA)
        estimates = [odometry.process(image, 0.1 * i) for i, image in enumerate(images()[:20])]
        self.assertEqual(repr(estimates[0]), "Estimate(id=0, timestamp=0.0, state='initializing', segment=0)")
        self.assertEqual(str(estimates[0]), 'image 0 at 0.000 s: initializing')
        self.assertRegex(str(estimates[-1]), r'^image \d+ at [\d.]+ s: tracked at \(-?[\d.]+, -?[\d.]+, -?[\d.]+\) of segment 0, \+- (?=.*[1-9])[\de.-]+, [\d.]+ grey levels off')
        start = next(e.initialization for e in estimates if e.initialization)
        keyframe = next(k for e in estimates for k in e.keyframes)
        self.assertEqual(repr(CAMERA), 'Camera(fx=200.0, fy=200.0, cx=159.5, cy=119.5, width=320, height=240)')
        for thing in (odometry, odometry.finish(), start, start.frames[0], keyframe, dsorb.Priors(), dsorb.Initializer(CAMERA),
                      dsorb.Calibration.from_hfov(60, *SIZE), dsorb.Rectifier(dsorb.Calibration.from_hfov(60, *SIZE))):
            self.assertRegex(repr(thing), rf'^{type(thing).__name__}\(')

    def test_ids_are_taken_once(self):
        odometry, pictures = dsorb.Odometry(CAMERA), images()
        odometry.process(pictures[0], 0., id=0)
        odometry.process(pictures[1], .1, id=1)
        for taken, text in ((0, 'an earlier frame has the same id'), (-1, 'expected an id from 0')):
            with self.assertRaisesRegex(ValueError, text):
                odometry.process(pictures[2], .2, id=taken)
        self.assertEqual(odometry.process(pictures[2], .2).id, 2)

    def test_estimates_tell_the_run(self):
        odometry = dsorb.Odometry(CAMERA)
        estimates = [odometry.process(image, timestamp=0.1 * i) for i, image in enumerate(images())]
        self.assertEqual([e.id for e in estimates], list(range(FRAMES)))
        self.assertEqual(estimates[-1].state, 'tracked')
        begun = [e for e in estimates if e.initialization is not None]
        self.assertEqual([e.state for e in begun], ['initialized'])
        self.assertIsNone(estimates[0].covariance)
        self.assertTrue((np.linalg.eigvalsh(estimates[-1].covariance) > 0).all())
        keyframes = {k.id: k for e in estimates for k in e.keyframes}
        report = odometry.finish()
        keyframes.update({k.id: k for k in report.keyframes})
        self.assertEqual(len(keyframes), report.keyframe_count)
        self.assertTrue(all(k.final for k in report.keyframes))
        self.assertEqual(report.keyframes[-1].world_points().shape, (len(report.keyframes[-1].pixels), 3))
        with self.assertRaises(RuntimeError):
            odometry.process(images()[0], timestamp=100)

    def test_refused_frames_use_up_no_id_and_a_reset_begins_anew(self):
        small, pictures = np.zeros((100, 100), np.uint8), images()
        initializer, odometry = dsorb.Initializer(CAMERA), dsorb.Odometry(CAMERA)
        for feeder in (initializer.add, odometry.process):
            feeder(pictures[0], timestamp=0.)
            with self.assertRaises(ValueError):
                feeder(small, timestamp=.1)
        self.assertEqual(odometry.process(pictures[1], timestamp=.1).id, 1)
        initializer.reset()
        self.assertEqual([f.id for f in start(initializer, pictures).frames][0], 0)

    def test_modules_of_the_package_are_there(self):
        self.assertTrue(callable(dsorb.run_folder.read_run) and dsorb.export is not None)
        with self.assertRaises(AttributeError):
            dsorb.no_such_module

    def test_who_is_in_a_hurry_starts_later(self):
        initializer, odometry = dsorb.Initializer(CAMERA), dsorb.Odometry(CAMERA)
        *early, last = images()[:10]
        initializer.hurried = odometry.hurried = True
        for i, image in enumerate(early):
            step = initializer.add(image, timestamp=0.1 * i)
            estimate = odometry.process(image, timestamp=0.1 * i)
        initializer.hurried = odometry.hurried = False
        self.assertEqual((step.status, step.reason, estimate.state), ('needs_more_frames', 'hurried', 'initializing'))
        self.assertEqual(initializer.add(last, timestamp=0.9).status, 'initialized')
        self.assertEqual(odometry.process(last, timestamp=0.9).state, 'initialized')

    def test_a_lost_camera_is_restarted(self):
        odometry = dsorb.Odometry(CAMERA)
        pictures = images()
        dark = np.zeros_like(pictures[0])
        states = [odometry.process(image, timestamp=0.1 * i).state for i, image in enumerate(pictures + [dark] * 4)]
        self.assertEqual(states[-4:], ['missed'] * 3 + ['lost'])
        with self.assertRaises(RuntimeError):
            odometry.process(dark, timestamp=100)
        odometry.restart()
        estimate = odometry.process(pictures[0], timestamp=101)
        self.assertEqual((estimate.state, estimate.segment), ('initializing', 1))

    def test_other_threads_run_while_it_computes(self):
        odometry, done, counts = dsorb.Odometry(CAMERA, num_threads=1), threading.Event(), [0]

        def count():
            while not done.is_set():
                counts[0] += 1
                time.sleep(1e-4)

        # No thread is made to give up the lock: what counts during a call has got it from the call.
        self.addCleanup(sys.setswitchinterval, sys.getswitchinterval())
        sys.setswitchinterval(1000)
        thread = threading.Thread(target=count)
        thread.start()
        inside = []
        for i, image in enumerate(images()):
            before = counts[0]
            odometry.process(image, timestamp=0.1 * i)
            inside.append(counts[0] - before)
        done.set()
        thread.join()
        # 40 of 40 on a machine that has nothing else to do, 0 with a call that keeps the lock.
        self.assertGreater(sum(n > 0 for n in inside), FRAMES / 10)


class Pages(unittest.TestCase):
    def test_the_lines_of_the_readme_run(self):
        blocks = re.findall(r'```python\n(.*?)```', README.read_text(encoding='utf-8'), re.DOTALL)
        self.assertTrue(blocks)
        before, printed = os.getcwd(), io.StringIO()
        os.chdir(room())
        try:
            with contextlib.redirect_stdout(printed):
                for block in blocks:
                    exec(compile(block, 'README.md', 'exec'), {})  # pylint: disable=exec-used
        finally:
            os.chdir(before)
        self.assertGreater(len(printed.getvalue().splitlines()), len(image_files()) / 2, 'lines of poses')

    def test_the_commands_of_the_readme_are_understood(self):
        commands = re.findall(r'^dsorb (.*)$', README.read_text(encoding='utf-8'), re.MULTILINE)
        self.assertGreater(len(commands), 3)
        for command in commands:
            _, unknown = command_line.parse(shlex.split(command, comments=True))
            self.assertEqual(unknown, [], command)

    def test_stubs_name_what_the_module_has(self):
        stub = ast.parse((Path(dsorb.__file__).parent / '_dsorb.pyi').read_text(encoding='utf-8'))
        classes = {node.name: node for node in stub.body if isinstance(node, ast.ClassDef)}
        for name in dsorb.__all__:
            thing = getattr(dsorb, name)
            if not isinstance(thing, type):
                continue
            described = {node.name for node in classes[name].body if isinstance(node, ast.FunctionDef)}
            there = {member for member in vars(thing) if not member.startswith('_')}
            self.assertEqual(there - described, set(), name)


if __name__ == '__main__':
    unittest.main()
