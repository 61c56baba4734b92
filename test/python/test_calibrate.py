# SPDX-License-Identifier: BSD-3-Clause
"""Chessboards rendered through known lenses."""
import subprocess
import sys
import unittest

import dsorb
import numpy as np
from room import temporary_folder

try:
    import cv2
except ImportError:
    cv2 = None

SIZE = 640, 480
BOARD = 9, 6  # inner corners
TRUTH = {'radtan': dsorb.Calibration(520, 515, 322.5, 236.0, *SIZE, 'radtan', [-0.25, 0.08, 4e-4, -3e-4, 0.0]),
         'equidistant': dsorb.Calibration(300, 302, 318.0, 242.0, *SIZE, 'equidistant', [0.02, -0.01, 0.004, -0.001])}


def rays(calibration):
    """(h, w, 2): x, y at z = 1 of every pixel, by fixed-point iteration over Calibration.project."""
    u, v = np.meshgrid(np.arange(SIZE[0], dtype=float), np.arange(SIZE[1], dtype=float))
    pixels = np.stack([u, v], 2).reshape(-1, 2)
    focal, found = np.array([calibration.fx, calibration.fy]), np.zeros_like(pixels)
    for _ in range(60):
        there = calibration.project(np.column_stack([found, np.ones(len(found))]))
        found += 0.8 * np.nan_to_num(pixels - there) / focal
    return found.reshape(SIZE[1], SIZE[0], 2)


def board_image(seen, rotation, translation):
    """Grey image of a chessboard of squares of 1 in the plane z = 0 of the board, anti-aliased by 3 x 3 samples."""
    total = np.zeros(seen.shape[:2])
    step = np.stack([np.gradient(seen[..., 0], axis=1), np.gradient(seen[..., 1], axis=0)], 2)
    for dx in (-1 / 3, 0, 1 / 3):
        for dy in (-1 / 3, 0, 1 / 3):
            ray = np.dstack([seen + step * [dx, dy], np.ones(seen.shape[:2])]) @ rotation  # in the board's axes
            origin = -rotation.T @ translation
            point = origin[:2] + ray[..., :2] * (-origin[2] / ray[..., 2])[..., None]
            column, row = np.floor(point[..., 0]).astype(int), np.floor(point[..., 1]).astype(int)
            inside = (column >= -1) & (column < BOARD[0]) & (row >= -1) & (row < BOARD[1])
            total += np.where(inside & ((column + row) % 2 == 0), 30, 220)
    return (total / 9 + 0.5).astype(np.uint8)


def write_board(path, calibration, views=24):
    random, seen = np.random.default_rng(3), rays(calibration)
    video = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*'MJPG'), 10, SIZE)
    middle = np.array([(BOARD[0] - 1) / 2, (BOARD[1] - 1) / 2, 0])
    for _ in range(views):
        rotation = cv2.Rodrigues(random.uniform(-0.5, 0.5, 3))[0]
        distance = random.uniform(11, 17) * calibration.fx / 520
        place = np.array([*(random.uniform(-0.22, 0.22, 2) * distance * 520 / calibration.fx), distance])
        video.write(cv2.cvtColor(board_image(seen, rotation, place - rotation @ middle), cv2.COLOR_GRAY2BGR))
    video.release()


def dsorb_calibrate(*words):
    return subprocess.run([sys.executable, '-m', 'dsorb.command_line', 'calibrate', *map(str, words)], capture_output=True,
                          text=True, check=False)


@unittest.skipUnless(cv2, "OpenCV's Python module is not installed")
class Calibrate(unittest.TestCase):
    def check(self, model, most_percent, most_pixels):
        folder, truth = temporary_folder(), TRUTH[model]
        write_board(folder / 'board.avi', truth)
        done = dsorb_calibrate(folder / 'board.avi', '--board', '9x6', '--model', model, '--output', folder / 'camera.txt')
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertTrue((folder / 'camera.png').exists())
        found = dsorb.Calibration.read(folder / 'camera.txt')
        self.assertEqual((found.model, found.width, found.height), (model, *SIZE))
        self.assertLess(100 * abs(found.fx / truth.fx - 1), most_percent)
        self.assertLess(100 * abs(found.fy / truth.fy - 1), most_percent)
        self.assertLess(max(abs(found.cx - truth.cx), abs(found.cy - truth.cy)), most_pixels)
        grid = np.array([[x, y, 1.0] for x in np.linspace(-0.5, 0.5, 9) for y in np.linspace(-0.35, 0.35, 7)])
        self.assertLess(np.abs(found.project(grid) - truth.project(grid)).max(), most_pixels)
        return done.stdout

    def test_a_distorted_lens_is_found(self):
        text = self.check('radtan', 0.1, 1)  # measured 0.01 % and 0.41 px
        self.assertRegex(text, r'fx \d+\.\d+ \+-\d\.\d+')

    def test_a_fisheye_is_found(self):
        self.check('equidistant', 0.3, 1)  # measured 0.12 % and 0.43 px

    def test_a_board_that_is_never_seen(self):
        folder = temporary_folder()
        video = cv2.VideoWriter(str(folder / 'grey.avi'), cv2.VideoWriter_fourcc(*'MJPG'), 10, SIZE)
        for _ in range(5):
            video.write(np.full((SIZE[1], SIZE[0], 3), 128, np.uint8))
        video.release()
        done = dsorb_calibrate(folder / 'grey.avi', '--board', '9x6', '--output', folder / 'camera.txt')
        self.assertEqual(done.returncode, 1)
        self.assertIn('9x6 inner corners was seen in 0 images', done.stderr)
        self.assertFalse((folder / 'camera.txt').exists())

    def test_words_that_say_no_board(self):
        done = dsorb_calibrate('nowhere.mp4', '--board', 'nine')
        self.assertEqual(done.returncode, 2)
        self.assertIn('COLUMNSxROWS', done.stderr)
        done = dsorb_calibrate('nowhere.mp4', '--board', '9x6', '--output', temporary_folder() / 'camera.txt')
        self.assertEqual((done.returncode, 'nowhere.mp4' in done.stderr), (1, True))
        done = dsorb_calibrate('nowhere.mp4', '--board', '9x6', '--output', 'camera.yaml')
        self.assertEqual((done.returncode, 'expected the name of a .txt' in done.stderr), (2, True))


if __name__ == '__main__':
    unittest.main()
