# SPDX-License-Identifier: BSD-3-Clause
"""The callbacks of scripts/ros2/dsorb_ros on recorded bags, without ROS: dsorb_ros_replay (scripts/ros2/stub) gives them the
messages of a bag as they lie there, and what they publish is read by `rosbags`."""
import io
import os
import subprocess
import unittest
from collections import defaultdict

import numpy as np
from dsorb import bags
from room import FRAMES, images, room, temporary_folder, true_poses

try:
    from rosbags.typesys import Stores, get_typestore
    from test_bags import BEGIN, TOPIC, camera_info, compressed, message, write
except ImportError:
    raise unittest.SkipTest('the package rosbags is not installed') from None
if not os.access(os.environ.get('DSORB_ROS_REPLAY', ''), os.X_OK):
    raise unittest.SkipTest('DSORB_ROS_REPLAY names no program: dsorb_ros_replay is built where Python has rosbags')

STORE = get_typestore(Stores.ROS2_HUMBLE)
NAMES = {TOPIC: 'image', TOPIC + '/compressed': 'image/compressed', '/camera/camera_info': 'camera_info'}
BODY_FROM_OPTICAL = np.array([[0, 0, 1], [-1, 0, 0], [0, -1, 0]])


def bag(make=message, end='', **how):
    times = [BEGIN + round(float(line.split()[1]) * bags.NANOSECONDS) for line in (room() / 'times.txt').read_text().splitlines()]
    kept = [(time, make(STORE, image, time, **how)) for time, image in zip(times, images())]
    return write(temporary_folder() / 'bag', {'/camera/camera_info': [(BEGIN - 1, camera_info(STORE, False))], TOPIC + end: kept})


def replay(path, *parameters, calls=()):
    """What the node publishes over a bag, by topic, its answers, and what it says. `calls`: (after so many messages, service)."""
    stream = io.BytesIO()
    with bags.opened(path) as reader:
        for number, (connection, _, data) in enumerate(reader.messages()):
            stream.write(b'%s %d\n' % (NAMES[connection.topic].encode(), len(data)) + bytes(data))
            for after, service in calls:
                if after == number:
                    stream.write(b'call %s\n' % service.encode())
    done = subprocess.run([os.environ['DSORB_ROS_REPLAY'], *parameters], input=stream.getvalue(), capture_output=True, check=False)
    published, answers, out = defaultdict(list), [], io.BytesIO(done.stdout)
    for line in iter(out.readline, b''):
        name, kind, size = line.decode().split()
        data = out.read(int(size))
        if '/msg/' in kind:
            published[name].append(STORE.deserialize_cdr(data, kind))
        else:
            answers.append((name, kind, data.decode()))
    return done, published, answers


def poses_of(messages):
    """(n,) times of the room, (n, 3) positions, (n, 3, 3) rotations."""
    from dsorb.run_folder import rotation_of
    positions = np.array([[m.pose.pose.position.x, m.pose.pose.position.y, m.pose.pose.position.z] for m in messages])
    rotations = np.array([rotation_of([m.pose.pose.orientation.x, m.pose.pose.orientation.y, m.pose.pose.orientation.z, m.pose.pose.orientation.w])
                          for m in messages])
    times = np.array([m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec for m in messages]) - BEGIN / bags.NANOSECONDS
    return times, positions, rotations


class Callbacks(unittest.TestCase):
    def check(self, path, *parameters):
        done, published, _ = replay(path, *parameters)
        self.assertEqual(done.returncode, 0, done.stderr)
        odometry = published['~/odometry']
        self.assertGreater(len(odometry), FRAMES - 12, done.stderr)
        times, positions, rotations = poses_of(odometry)
        indices = np.searchsorted([float(line.split()[1]) for line in (room() / 'times.txt').read_text().splitlines()], times - 1e-4)
        truth = true_poses()[indices]
        # Relative to the first pose: the body's axes, and one scale.
        first = np.linalg.inv(truth[0])
        expected = np.array([(first @ pose)[:3, 3] for pose in truth]) @ BODY_FROM_OPTICAL.T
        start = rotations[0] @ BODY_FROM_OPTICAL.T
        found = (positions - positions[0]) @ start
        scale = (found * expected).sum() / (found ** 2).sum()
        self.assertLess(np.abs(scale * found - expected).max(), .02 * np.linalg.norm(expected[-1]) + .01)
        return published, odometry

    def test_raw_images_give_poses_covariance_transform_path_and_points(self):
        published, odometry = self.check(bag())
        self.assertEqual((odometry[0].header.frame_id, odometry[0].child_frame_id), ('odom', 'camera'))
        covariance = np.array(odometry[-1].pose.covariance).reshape(6, 6)
        np.testing.assert_allclose(covariance, covariance.T, rtol=1e-9)
        self.assertTrue((np.linalg.eigvalsh(covariance) > 0).all())
        self.assertEqual(len(published['/tf']), len(odometry))
        transform = published['/tf'][-1].transforms[0]
        self.assertEqual(transform.transform.translation.x, odometry[-1].pose.pose.position.x)
        self.assertEqual(transform.child_frame_id, 'camera')
        self.assertGreater(len(published['~/path'][-1].poses), len(published['~/path'][0].poses))
        cloud = published['~/points'][-1]
        points = np.frombuffer(bytes(cloud.data), '<f4').reshape(-1, 4)
        self.assertEqual([field.name for field in cloud.fields], ['x', 'y', 'z', 'intensity'])
        self.assertEqual((len(points), cloud.point_step, cloud.row_step), (cloud.width, 16, 16 * cloud.width))
        self.assertGreater(np.mean(points[:, 0] > 0), .95)  # in front of a camera that looks along x
        self.assertTrue(np.isfinite(points).all())

    def test_colours_and_compressed_images(self):
        self.check(bag(lambda store, image, time: message(store, np.repeat(image[..., None], 3, 2), time, 'rgb8')))
        self.check(bag(compressed, '/compressed', kind='PNG'), 'compressed=true', 'world_frame=map')

    def test_reset_begins_anew_and_save_writes_the_path(self):
        folder = temporary_folder()
        done, published, answers = replay(bag(), f'save_to={folder}/saved', calls=((20, '~/reset'), (FRAMES, '~/save')))
        self.assertEqual([answer[:2] for answer in answers], [('~/reset', 'ok'), ('~/save', 'ok')], done.stderr)
        saved = np.loadtxt(folder / 'saved/trajectory.txt')
        times, positions, _ = poses_of(published['~/odometry'])
        after = times > float((room() / 'times.txt').read_text().splitlines()[20].split()[1]) - 1e-4
        self.assertEqual(len(saved), after.sum())  # what came before the reset is forgotten
        np.testing.assert_allclose(saved[:, 1:4], positions[after], atol=1e-8)

    def test_parameters_are_options(self):
        done, published, _ = replay(bag(), 'window.max_keyframes=5', 'width=160', f'calibration={room() / "camera.txt"}', 'preset=fast')
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertGreater(len(published['~/odometry']), 0)
        done, _, _ = replay(bag(), 'window.max_keyframs=5')
        self.assertEqual(done.returncode, 1)
        self.assertIn(b'window.max_keyframes', done.stderr)

    def test_what_cannot_be_used_is_said(self):
        done, published, _ = replay(bag(lambda store, image, time: message(store, image, time, 'bayer_nonsense')))
        self.assertIn(b"encoding 'bayer_nonsense': expected mono8", done.stderr)
        self.assertFalse(published['~/odometry'])
        done, _, _ = replay(bag(lambda store, image, time: message(store, image, BEGIN)))
        self.assertIn(b'its time is not after that of the image before', done.stderr)


if __name__ == '__main__':
    unittest.main()
