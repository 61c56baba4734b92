# SPDX-License-Identifier: BSD-3-Clause
"""Metres from distances, speeds, altitudes and GPS tracks, against the truth of the room."""
import json
import math
import shutil
import subprocess
import sys
import unittest
from datetime import datetime, timedelta, timezone

import numpy as np
from dsorb import metric
from dsorb.command_line import program as metric_program
from dsorb.run_folder import read_run, read_tum
from room import room, room_run, temporary_folder, true_poses

LATITUDE, LONGITUDE, ALTITUDE = 48.1, 11.5, 500.0


def run_copy():
    folder = temporary_folder() / 'out'
    shutil.copytree(room_run(), folder)
    return folder


def times():
    return np.loadtxt(room() / 'groundtruth.txt')[:, 0]


def centres():
    """True positions with z up: the room's cameras have y down."""
    return true_poses()[:, :3, 3] @ np.array([[1., 0, 0], [0, 0, 1], [0, -1, 0]]).T


def table(rows, header=None):
    file = temporary_folder() / 'known.csv'
    file.write_text((header + '\n' if header else '') + ''.join(','.join(f'{x:.12g}' for x in row) + '\n' for row in rows))
    return file


def degrees(positions):
    """(n, 3) latitude, longitude, altitude of east, north, up near the origin, found by iteration."""
    origin = np.array([LATITUDE, LONGITUDE, ALTITUDE])
    found = np.tile(origin, (len(positions), 1))
    per = np.array([111200., 111320 * math.cos(math.radians(LATITUDE)), 1])
    for _ in range(20):
        off = positions - metric.east_north_up(np.vstack([origin, found]))[1:]
        found += off[:, [1, 0, 2]] / per
    return found


def scale_of(folder):
    return json.loads((folder / 'metric/metric.json').read_text())[0]


def true_scale():
    """Metres a unit of the run."""
    run = read_run(room_run())
    segment = run.segments[0]
    source = np.array([frame.position for frame in segment.frames])
    return metric.umeyama(source, centres()[[frame.index for frame in segment.frames]])[0]


class Scales(unittest.TestCase):
    def check(self, knowledge, most=.02):
        folder = run_copy()
        notes = metric.to_metres(folder, knowledge)
        told = scale_of(folder)
        self.assertLess(abs(math.log(told['metres_per_unit'] / true_scale())), most)
        self.assertIn('m a unit', notes[0])
        return folder, told

    def test_distance(self):
        first, last = (frame.index for frame in (read_run(room_run()).segments[0].frames[i] for i in (0, -1)))
        metres = np.linalg.norm(centres()[last] - centres()[first])
        _, told = self.check({'distance': (first, last, metres, .02 * metres)})
        self.assertAlmostEqual(told['relative_sigma'], .02)

    def test_speed(self):
        t, c = times(), centres()
        speeds = np.linalg.norm(np.gradient(c, t, axis=0), axis=1)
        self.check({'speed': table(np.column_stack([t, speeds]), 'time,speed')}, .05)

    def test_altitude(self):
        noise = np.random.default_rng(5).normal(0, .002, len(times()))
        try:
            _, told = self.check({'altitude': table(np.column_stack([times(), centres()[:, 2] + 300 + noise]))}, .1)
        except metric.MetricError as error:  # a motion that does not tell it is refused
            self.assertRegex(str(error), 'altitudes do not tell the scale|too uncertain')
            return
        self.assertLess(abs(math.log(told['metres_per_unit'] / true_scale())), 4 * told['relative_sigma'] + .01)

    def test_gps_by_csv_has_the_trajectory_east_north_up(self):
        rng, offset = np.random.default_rng(7), 100
        measured = centres() + rng.normal(0, .01, centres().shape)
        file = table(np.column_stack([times() + offset, degrees(measured)]))
        folder, told = self.check({'gps': file, 'time_offset': -offset})
        found = np.array([pose[:3] for _, pose in read_tum(folder / 'metric/trajectory.txt')])
        indices = [frame.index for frame in read_run(room_run()).segments[0].frames]
        expected = centres() - measured[0]
        self.assertLess(np.sqrt(((found - expected[indices]) ** 2).sum(1).mean()), .03)
        covariance = np.array(told['covariance'])
        self.assertTrue((np.linalg.eigvalsh(covariance) > 0).all())
        self.assertLess(abs(math.log(told['metres_per_unit'] / true_scale())), 4 * told['relative_sigma'])
        np.testing.assert_allclose(told['origin'], degrees(measured[:1])[0], atol=1e-7)

    def test_gpx(self):
        begin = datetime(2026, 5, 1, 12, tzinfo=timezone.utc)
        points = ''.join(f'<trkpt lat="{a:.10f}" lon="{o:.10f}"><ele>{h:.4f}</ele><time>{(begin + timedelta(seconds=float(t))).isoformat().replace("+00:00", "Z")}</time></trkpt>'
                         for t, (a, o, h) in zip(times(), degrees(centres())))
        file = temporary_folder() / 'track.gpx'
        file.write_text(f'<gpx xmlns="http://www.topografix.com/GPX/1/1"><trk><trkseg>{points}</trkseg></trk></gpx>')
        self.check({'gps': file, 'time_offset': -begin.timestamp()})
        with self.assertRaisesRegex(metric.MetricError, 'fewer than three images lie within; --time-offset'):
            metric.to_metres(run_copy(), {'gps': file})


class Gyroscopes(unittest.TestCase):
    def test_rotations_of_a_file_take_part_in_the_start(self):
        folder, t, rotations = temporary_folder(), times(), true_poses()[:, :3, :3]
        turns = [rotations[i].T @ rotations[i + 1] for i in range(len(t) - 1)]
        rates = [np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / 2 / (b - a) for R, a, b in zip(turns, t, t[1:])]
        axes = np.array([[0, -1., 0], [0, 0, 1], [-1, 0, 0]])  # of the gyroscope to those of the camera
        rows = [[time, *(axes.T @ rate)] for a, b, rate in zip(t, t[1:], rates) for time in (a + 1e-6, b - 1e-6)]
        rows = [[t[0] - .01, *rows[0][1:]], *rows, [t[-1] + .01, *rows[-1][1:]]]
        file = table(rows, '#time,wx,wy,wz')
        words = [metric_program(), room(), '--gyro', file, '--gyro-axes', ','.join(map(str, axes.ravel())), '--output', folder / 'out']
        done = subprocess.run(list(map(str, words)), capture_output=True, text=True, check=False)
        self.assertEqual(done.returncode, 0, done.stderr)
        told = (folder / 'out/initialization.json').read_text()
        self.assertRegex(told, r'"known_pose_used"\s*:\s*(true|1)')
        wrong = subprocess.run([*map(str, words[:5]), '1,0,0,0,1,0,0,0,2'], capture_output=True, text=True, check=False)
        self.assertEqual(wrong.returncode, 2)
        self.assertIn('expected the nine numbers of a rotation', wrong.stderr)


class Refusals(unittest.TestCase):
    def test_what_is_wrong_is_named(self):
        line = [[t, LATITUDE + 1e-5 * t, LONGITUDE, ALTITUDE] for t in times()]
        for knowledge, why in (({'distance': (0, 10**6, 1, .1)}, 'image 1000000 has no pose in segment 0'),
                               ({'gps': table(line)}, 'the track is a line'),
                               ({'speed': table([[0, 1], [0, 1]])}, 'times do not increase'),
                               ({'speed': table([[0, 1, 2]])}, '1 lines with numbers'),
                               ({'altitude': table([[0], [1]])}, 'known.csv:1: 0: expected time')):
            with self.assertRaisesRegex(metric.MetricError, why):
                metric.to_metres(run_copy(), knowledge)

    def test_command(self):
        folder = run_copy()
        def command(*words):
            return subprocess.run([sys.executable, '-m', 'dsorb.command_line', 'metric', *map(str, words)], capture_output=True, text=True, check=False)
        self.assertEqual(command(folder).returncode, 2)
        self.assertIn('expected two different image numbers', command(folder, '--distance', 1, 1, 2).stderr)
        done = command(folder, '--distance', 5, 30, 1.5)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn('known to 1 %', done.stdout)
        self.assertEqual(command(folder, '--gps', 'no.csv').returncode, 1)


if __name__ == '__main__':
    unittest.main()
