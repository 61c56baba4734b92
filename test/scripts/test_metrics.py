# SPDX-License-Identifier: BSD-3-Clause
"""Metrics against cases worked out by hand, and against evo."""
import math
import unittest
from types import SimpleNamespace

import numpy as np

from dsorb_eval import evo, metrics, pictures, plots, start_pictures, summary
from dsorb_eval import trajectory as tr


def turned(axis, degrees):
    """Rotation about a unit axis (Rodrigues)."""
    k = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]], float)
    angle = math.radians(degrees)
    return np.eye(3) + math.sin(angle) * k + (1 - math.cos(angle)) * k @ k


def pose(rotation, translation):
    result = np.eye(4)
    result[:3, :3], result[:3, 3] = rotation, translation
    return result


def still(points):
    """Rows of a camera that never turns, a second apart."""
    return np.array([[i, *p, 0, 0, 0, 1] for i, p in enumerate(points)], float)


# On a cross of arms 1.5 and 0.5 against one of arms 1, the best scale is 1 / (1 + 0.5^2) = 0.8 (least squares by hand):
# distances 0.2 and 0.6 along the arms, and (0.2, 0.6) between neighbours.
CROSS = still([(1, 0, 0), (0, 1, 0), (-1, 0, 0), (0, -1, 0)])
STRETCHED = still([(1.5, 0, 0), (0, .5, 0), (-1.5, 0, 0), (0, -.5, 0)])


class TrajectoryErrors(unittest.TestCase):
    def test_cross_by_hand(self):
        errors = metrics.trajectory_errors(STRETCHED, tr.GroundTruth(CROSS))
        path = 3 * math.sqrt(2)
        self.assertAlmostEqual(errors['scale'], .8, places=12)
        self.assertAlmostEqual(errors['ate'], math.sqrt((.2 ** 2 + .6 ** 2) / 2), places=12)
        self.assertAlmostEqual(errors['rpe'], math.hypot(.2, .6), places=12)
        self.assertAlmostEqual(errors['path'], path, places=12)
        self.assertAlmostEqual(errors['ate_over_path'], errors['ate'] / path, places=12)
        self.assertAlmostEqual(errors['rpe_over_path'], errors['rpe'] / path, places=12)

    def test_similarity_of_the_truth_is_no_error(self):
        rotation, rng = turned([0, .6, .8], 130), np.random.default_rng(4)
        poses = [pose(turned([1, 0, 0], 10 * i), rng.normal(size=3)) for i in range(12)]
        moved = [pose(rotation @ p[:3, :3], 3.5 * rotation @ p[:3, 3] + [1, 2, 3]) for p in poses]
        truth = tr.GroundTruth(np.array([tr.row_of(i, p) for i, p in enumerate(poses)]))
        errors = metrics.trajectory_errors(np.array([tr.row_of(i, p) for i, p in enumerate(moved)]), truth)
        self.assertLess(errors['ate'], 1e-12)
        self.assertLess(errors['rpe'], 1e-12)
        self.assertLess(errors['rpe_rot_deg'], 1e-5)
        self.assertAlmostEqual(errors['scale'], 1 / 3.5, places=12)

    def test_relative_error_is_seen_from_the_true_next_camera(self):
        turn = turned([0, 0, 1], 90)  # equation 15: the true motion moves by x and turns by 90 degrees, the estimate stays
        error, = metrics.relative_errors([np.eye(4), np.eye(4)], [np.eye(4), pose(turn, [1, 0, 0])], 1)
        np.testing.assert_allclose(error[:3, 3], [0, 1, 0], atol=1e-15)
        self.assertAlmostEqual(tr.rotation_angle(error[:3, :3]), 90, places=12)

    def test_nothing_to_say_without_motion_or_truth(self):
        truth = tr.GroundTruth(CROSS)
        self.assertIsNone(metrics.trajectory_errors(still([(1, 1, 1)] * 4), truth))
        self.assertIsNone(metrics.trajectory_errors(STRETCHED[:2], truth))
        self.assertIsNone(metrics.trajectory_errors(STRETCHED + [100, 0, 0, 0, 0, 0, 0, 0], truth))

    @unittest.skipUnless(evo.available(), 'evo is not installed')
    def test_agrees_with_evo(self):
        rng = np.random.default_rng(7)
        true, estimate, walk = [], [], np.zeros(3)
        for i in range(40):
            walk = walk + rng.normal(size=3) * .2 + [0, 0, .5]
            rotation = turned([0, 1, 0], 3 * i)
            true.append(tr.row_of(1e9 + i / 30, pose(rotation, walk)))
            noise = turned([1, 0, 0], rng.normal() * 2)
            estimate.append(tr.row_of(1e9 + i / 30, pose(rotation @ noise, (walk + rng.normal(size=3) * .05) * .3)))
        truth = tr.GroundTruth(np.array(true))
        ours, theirs = metrics.trajectory_errors(np.array(estimate), truth), evo.trajectory_errors(np.array(estimate), truth)
        self.assertGreater(ours['ate'], .02)
        # both see numbers rounded to nine decimals; measured 2e-9 of them
        self.assertAlmostEqual(ours['ate'], theirs['ate'], delta=1e-7 * ours['ate'])
        self.assertAlmostEqual(ours['rpe'], theirs['rpe'], delta=1e-7 * ours['rpe'])


class InitialPose(unittest.TestCase):
    truth = tr.GroundTruth(still([(0, 0, 0), (1, 1, 0), (2, 0, 0)]))

    def test_direction_thirty_degrees_off(self):
        centre = 7 * np.array([math.cos(math.radians(30)), math.sin(math.radians(30)), 0])  # its unit is free
        T_cur_ref = tr.inverse(pose(np.eye(3), centre))
        errors = metrics.initial_pose_errors(T_cur_ref, 0, 2, self.truth, [0, 1, 2])
        self.assertAlmostEqual(errors['dir_deg'], 30, places=10)
        self.assertAlmostEqual(errors['rot_deg'], 0, places=10)
        self.assertAlmostEqual(errors['error'], 2 * 2 * math.sin(math.radians(15)), places=12)  # chord, length 2
        self.assertAlmostEqual(errors['path'], 2 * math.sqrt(2), places=12)  # through the frame between
        self.assertAlmostEqual(errors['error_over_path'], errors['error'] / (2 * math.sqrt(2)), places=12)

    def test_rotation_off_and_reversed_times(self):
        T_cur_ref = tr.inverse(pose(turned([0, 1, 0], 5), [-4, 0, 0]))
        errors = metrics.initial_pose_errors(T_cur_ref, 2, 0, self.truth, [2, 1, 0])
        self.assertAlmostEqual(errors['rot_deg'], 5, places=10)
        self.assertAlmostEqual(errors['dir_deg'], 0, places=10)
        self.assertAlmostEqual(errors['path'], 2 * math.sqrt(2), places=12)

    def test_no_rotation_matrix_is_the_worst_answer(self):
        errors = metrics.initial_pose_errors(2 * np.eye(4), 0, 2, self.truth, [])
        self.assertEqual((errors['nonfinite'], errors['rot_deg'], errors['dir_deg']), (True, 180., 180.))
        self.assertEqual(metrics.initial_pose_errors(np.eye(4), 0, 9, self.truth, []), {})

    def test_nees_of_known_errors(self):
        angle = .01  # [rad] about x; sin(angle) is what the skew part gives
        estimate = pose(turned([1, 0, 0], math.degrees(angle)), [0, 0, 2])
        covariance = np.diag([.04, .04, .04, 1e-4, 1e-4, 1e-4])
        # truth T_cur_ref: no rotation, direction z: camera moves by -z
        nees = metrics.initial_pose_nees(estimate, covariance, np.eye(4), pose(np.eye(3), [0, 0, -1]))
        np.testing.assert_allclose(nees['nees_rot'], [math.sin(angle) ** 2 / 1e-4, 0, 0], atol=1e-12)
        np.testing.assert_allclose(nees['nees_dir'], [0, 0], atol=1e-12)
        tilted = pose(np.eye(3), [-.02, 0, -1])
        nees = metrics.initial_pose_nees(pose(np.eye(3), [0, 0, 2]), covariance, np.eye(4), tilted)
        # variance across the direction: (0.04 + 2^2 * 1e-4) / 2^2, J = [I, -[t]x]
        self.assertAlmostEqual(sum(nees['nees_dir']), math.sin(math.atan(.02)) ** 2 / (.0404 / 4), places=10)


class Depth(unittest.TestCase):
    def test_scale_is_free_and_outliers_count(self):
        true = np.linspace(2, 6, 100)
        inverse = 3 / true  # unit: 1/3 of a metre
        inverse[:30] *= 2  # thirty points at half their depth
        inverse[30] = -1
        errors = metrics.depth_errors(inverse, true)
        self.assertAlmostEqual(errors['scale'], 3, delta=3 * 2e-4)  # the search's finest step
        self.assertLess(errors['median'], 2e-4)
        self.assertEqual((errors['points'], errors['not_positive']), (99, 1))
        self.assertAlmostEqual(errors['within10'], .69, places=12)

    def test_unknown_depth_says_nothing(self):
        self.assertIsNone(metrics.depth_errors(np.ones(100), np.full(100, np.nan)))

    def test_nees_of_tracked_poses(self):
        random = np.random.default_rng(1)
        sigma = np.array([.01, .02, .03, .001, .002, .003])
        rows = [[i, .1 * i, .05 * i, 0, 0, 0, 0, 1] for i in range(300)]
        truth, motions = tr.GroundTruth(np.array(rows, float)), []
        for i in range(1, 300):
            v, w = np.split(sigma * random.standard_normal(6), 2)
            increment = pose(tr.rotation_of([*w / 2, 1]), v)
            true = tr.inverse(truth.pose(i)) @ truth.pose(i - i % 10)
            true[:3, 3] /= 3  # another unit
            motions.append((i, i - i % 10, increment @ true, np.diag(sigma ** 2)))
        nees = metrics.tracking_nees(motions, truth)
        # 0.79 is the median of chi-square with three degrees of freedom over three; that of 299 values is sure to 0.05
        self.assertAlmostEqual(nees['nees_tracked_rot'], .79, delta=.15)
        self.assertAlmostEqual(nees['nees_tracked_trans'], .79, delta=.15)
        self.assertEqual(metrics.tracking_nees(motions[:5], truth), {})

    def test_nees_of_inverse_depths(self):
        true = np.full(50, 2.)
        self.assertAlmostEqual(metrics.depth_nees(np.full(50, .6), np.full(50, .01), true, 1.), 1., places=12)

    def test_depth_under_pixels(self):
        image = np.full((4, 6), 3.)
        image[2, 3], image[0, 0] = 9., np.nan
        camera = (100., 100., 2., 2.)
        pixels = np.array([[4.5, .5], [2.5, 1.5], [.2, .2], [5.5, 1], [-1, 1]])
        depths = metrics.true_depths(image, camera, camera, pixels)
        np.testing.assert_array_equal(np.isnan(depths), [False, True, False, True, True])  # flat, edge, hole beside, outside
        self.assertEqual(depths[0], 3.)
        # a camera of half the focal length sees the same ray at half the offset
        halved = metrics.true_depths(image, camera, (50., 50., 2., 2.), np.array([[2.25, 1.75]]))
        self.assertTrue(np.isnan(halved[0]))  # lands on pixel (2.5, 1.5), the edge


class Poses(unittest.TestCase):
    def test_quaternions_there_and_back(self):
        for degrees in (0, 1e-7, 30, 179.999, 180):
            rotation = turned([.36, .48, .8], degrees)
            np.testing.assert_allclose(tr.rotation_of(tr.quaternion_of(rotation)), rotation, atol=1e-9)

    def test_truth_between_two_poses(self):
        rows = np.array([tr.row_of(i * .1, pose(turned([0, 0, 1], 20 * i), [i, 0, 0])) for i in range(4)])
        middle = tr.GroundTruth(rows).pose(.15)
        np.testing.assert_allclose(middle[:3, 3], [1.5, 0, 0], atol=1e-12)
        self.assertAlmostEqual(tr.rotation_angle(middle[:3, :3] @ turned([0, 0, 1], -30)), 0, places=6)

    def test_holes_and_ends_of_the_truth_are_not_bridged(self):
        rows = still([(i, 0, 0) for i in range(5)])
        rows[:, 0] = [0, .1, .2, 1.2, 1.3]
        truth = tr.GroundTruth(rows)
        self.assertIsNone(truth.pose(.7))
        self.assertIsNone(truth.pose(-.01))
        self.assertIsNone(truth.pose(1.31))
        self.assertIsNotNone(truth.pose(1.3 + 1e-4))


class Residuals(unittest.TestCase):
    def test_t_scale_is_found_again(self):
        samples = 3.2 * np.random.default_rng(1).standard_t(5, size=20000)
        # standard deviation of the estimate: about scale / sqrt(2 n) * 1.3 = 0.02; four of them
        self.assertAlmostEqual(pictures.t_scale(samples), 3.2, delta=.08)

    def test_densities_sum_to_one(self):
        x = np.linspace(-400, 400, 400001)
        for density in (pictures.t_density, pictures.gaussian_density):
            self.assertAlmostEqual(float(np.trapezoid(density(x, 1.7), x)), 1, places=5)


class StartPictures(unittest.TestCase):
    camera = dict(fx=100., fy=100., cx=31.5, cy=23.5, width=64, height=48)

    def test_a_step_to_the_side_moves_near_pixels_further(self):
        pixels = np.array([[31.5, 23.5], [31.5, 23.5], [11.5, 3.5]])
        seen = start_pictures.project(pixels, np.array([.5, 1., .5]), pose(np.eye(3), [-.1, 0, 0]), self.camera)
        np.testing.assert_allclose(seen, [[26.5, 23.5], [21.5, 23.5], [6.5, 3.5]], atol=1e-12)
        behind = start_pictures.project(pixels[:1], np.array([1.]), pose(np.eye(3), [0, 0, -2]), self.camera)
        self.assertTrue(np.isnan(behind).all())

    def test_values_between_pixels_and_outside(self):
        image = np.add.outer(10. * np.arange(5), np.arange(6))
        values = start_pictures.sample(image, np.array([[1.5, 2.25], [0, 0], [5, 1], [-.1, 1], [np.nan, 1]]))
        np.testing.assert_allclose(values[:2], [24, 0], atol=1e-12)
        self.assertTrue(np.isnan(values[2:]).all())

    def test_brightness_is_no_residual_and_outliers_keep_theirs(self):
        reference = np.linspace(20, 200, 200)
        target = 1.3 * reference - 12 + np.tile([.5, -.5], 100)
        target[::20] += 60
        residuals = start_pictures.brightness_residuals(reference, target)
        np.testing.assert_allclose(residuals[::20], 60.5, atol=.1)
        np.testing.assert_allclose(np.abs(np.delete(residuals, np.s_[::20])), .5, atol=.1)

    def test_residuals_of_a_plane_seen_twice(self):
        x, y = np.meshgrid(np.arange(64.), np.arange(48.))
        texture = lambda shift: 100 + 3 * (x + shift) + y  # noqa: E731 (linear: bilinear values are exact)
        points = [[10. + i % 40, 10. + i // 40, .5, .01] for i in range(400)]
        start = dict(camera=self.camera, points=points, reference=dict(index=0), target=dict(index=3),
                     poses=[dict(index=0, T_cam_ref=np.eye(4).tolist()), dict(index=3, T_cam_ref=pose(np.eye(3), [-.1, 0, 0]).tolist()),
                            dict(index=4, T_cam_ref=None)])
        residuals = start_pictures.residuals_of(start, {0: texture(0), 3: .8 * texture(5) + 4})
        self.assertEqual(len(residuals), 400)
        self.assertLess(np.abs(residuals).max(), 1e-9)

    def test_rectifies_as_the_run_did(self):
        cameras = {mode: SimpleNamespace(**dict(self.camera, fx=fx)) for mode, fx in (('crop', 40.), ('full', 30.), ('none', 50.))}
        module = SimpleNamespace(Calibration=lambda rectification, **lens: rectification,
                                 Rectifier=lambda mode: SimpleNamespace(mode=mode, camera=cameras[mode]))
        run = dict(lens=dict(self.camera, model='pinhole', coefficients=[]))
        self.assertEqual(start_pictures.rectifier_for(module, run, dict(self.camera, fx=30.)).mode, 'full')
        self.assertIsNone(start_pictures.rectifier_for(module, run, dict(self.camera, fx=35.)))


class Tables(unittest.TestCase):
    def test_row_by_hand(self):
        def run(direction, crashed=False, lost=False):
            figures = dict(crashed=crashed, nonfinite=0, good=not crashed, lost=lost, truth=True, starts=[] if direction is None else [
                dict(frames_given=5, since_ref=4, dir_deg=direction, ms_total=10., points=3)], ms_track=2., mb=80)
            return summary.Run(dict(sequence='a', variant='orb'), dict(exit_code=1 if crashed else 0), figures)
        row = summary.summarize([run(2.), run(8.), run(50., lost=True), run(None, crashed=True)])
        self.assertEqual((row['runs'], row['init'], row['crash'], row['good']), (4, 3, 1, 3))
        self.assertEqual((row['init_rate'], row['dir'], row['hit10']), (.75, 8., .5))
        self.assertAlmostEqual(row['wrong20'], 1 / 3)
        self.assertAlmostEqual(row['lost'], 1 / 3)
        self.assertIsNone(row['ate'])
        self.assertEqual(list(row), list(summary.COLUMNS))

    def test_cumulative_steps(self):
        x, y = plots.cumulative([3., 1., 2.])
        np.testing.assert_array_equal(x, [1, 1, 2, 3])
        np.testing.assert_array_equal(y, [0, 1, 2, 3])
        self.assertEqual(plots.values([SimpleNamespace(start=dict(dir_deg=4.), figures={})], ('start', 'dir_deg')), [4.])


if __name__ == '__main__':
    unittest.main()
