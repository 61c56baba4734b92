# SPDX-License-Identifier: BSD-3-Clause
"""Errors of trajectories, initial poses and initial depths.

Source: [Gladkova] (docs/references.md), section 4.1, equations 15-19, and
Sturm et al., A benchmark for the evaluation of RGB-D SLAM systems (IROS 2012). Lengths are in the unit of the ground
truth; every error called `_over_path` is divided by the distance travelled."""
import math
import warnings

import numpy as np

from . import trajectory as tr

MIN_POSES = 3  # a similarity has seven unknowns: three positions
MIN_TRACKED = 10  # poses with a covariance; their median should mean something
MIN_DEPTHS = 20  # fewer points give no median worth the name
MAX_DEPTH_SPAN = 0.05  # relative; true depths under a pixel that differ more lie on an edge
ROTATION_TOLERANCE = 1e-3  # |det - 1| of a matrix that claims to be a rotation


def relative_errors(estimate, truth, step):
    """Equation 15: E = (Q_i^-1 Q_j)^-1 (P_i^-1 P_j) with j = i + step, for lists of 4x4 poses."""
    return [tr.inverse(tr.inverse(q) @ q_next) @ (tr.inverse(p) @ p_next)
            for q, q_next, p, p_next in zip(truth, truth[step:], estimate, estimate[step:])]


def root_mean_square(values):
    return math.sqrt(float(np.mean(np.square(values))))


def trajectory_errors(rows, truth, step=1):
    """ATE after Sim(3) alignment (equations 17, 18) and RPE with the scale of that alignment (equations 15, 19).

    @param rows   trajectory, n x 8
    @param truth  GroundTruth
    @return None where fewer than three poses have a truth or one of the two never moves"""
    estimate, true = truth.matched(rows)
    if len(estimate) < MIN_POSES:
        return None
    path = float(np.linalg.norm(np.diff(true[:, 1:4], axis=0), axis=1).sum())
    if path == 0 or np.ptp(estimate[:, 1:4], axis=0).max() == 0:
        return None
    scale, rotation, translation = tr.align(estimate[:, 1:4], true[:, 1:4])
    distances = np.linalg.norm(scale * estimate[:, 1:4] @ rotation.T + translation - true[:, 1:4], axis=1)
    scaled = estimate.copy()
    scaled[:, 1:4] *= scale
    errors = relative_errors([tr.pose_of(r) for r in scaled], [tr.pose_of(r) for r in true], step)
    ate = root_mean_square(distances)
    rpe = root_mean_square([np.linalg.norm(e[:3, 3]) for e in errors]) if errors else None
    return dict(poses=len(estimate), path=path, scale=scale, ate=ate, ate_over_path=ate / path, ate_max=float(distances.max()),
                rpe=rpe, rpe_over_path=None if rpe is None else rpe / path,
                rpe_rot_deg=root_mean_square([tr.rotation_angle(e[:3, :3]) for e in errors]) if errors else None)


def initial_pose_errors(T_cur_ref, reference_time, target_time, truth, frame_times):
    """Errors of the relative pose an initializer delivers. Its unit is free, so its translation is first scaled to the
    true length; then the norm of equation 16 (without the square, which the plots of [Gladkova] do not have either).

    @param T_cur_ref  4x4, reference camera to target camera
    @param frame_times   times of all frames of the run: the way between the two goes through them
    @return empty where there is no truth"""
    true_reference, true_target = truth.pose(reference_time), truth.pose(target_time)
    if true_reference is None or true_target is None:
        return {}
    pose = np.array(T_cur_ref, float)
    if pose.shape != (4, 4) or not np.isfinite(pose).all() or abs(np.linalg.det(pose[:3, :3]) - 1) > ROTATION_TOLERANCE:
        return dict(nonfinite=True, rot_deg=180., dir_deg=180.)
    true_motion, motion = tr.inverse(true_reference) @ true_target, tr.inverse(pose)
    true_length, length = np.linalg.norm(true_motion[:3, 3]), np.linalg.norm(motion[:3, 3])
    motion[:3, 3] *= true_length / length if length > 0 else 0.
    error = float(np.linalg.norm((tr.inverse(true_motion) @ motion)[:3, 3]))
    low, high = sorted((reference_time, target_time))
    way = truth.path_length({low, high, *(t for t in frame_times if low <= t <= high)})
    direction = tr.angle_between(true_motion[:3, 3], motion[:3, 3]) if length > 0 else 180.
    return dict(rot_deg=tr.rotation_angle(motion[:3, :3] @ true_motion[:3, :3].T), dir_deg=direction, path=way,
                baseline=float(true_length), error=error, error_over_path=error / way if way > 0 else None)


def rotation_vector(rotation):
    """Rotation vector [rad] of a small rotation: the sine of its angle stands for the angle."""
    return np.array([rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]]) / 2


def initial_pose_nees(T_cur_ref, covariance, true_reference, true_target):
    """Squared error over variance, of the three rotation and the two direction components of the initial pose.

    @param covariance  6x6, [translation; rotation], of a left increment: t_est = t + v + w x t, so that the
                       translation's own variance is J C J^T with J = [I, -[t]x]"""
    pose, covariance = np.array(T_cur_ref, float), np.array(covariance, float)
    true = tr.inverse(true_target) @ true_reference
    t, length, true_length = pose[:3, 3], np.linalg.norm(pose[:3, 3]), np.linalg.norm(true[:3, 3])
    if covariance.shape != (6, 6) or not np.isfinite(covariance).all() or not length or not true_length:
        return {}
    e = pose[:3, :3] @ true[:3, :3].T
    w = rotation_vector(e)
    cross = np.array([[0, -t[2], t[1]], [t[2], 0, -t[0]], [-t[1], t[0], 0]])
    jacobian = np.hstack([np.eye(3), -cross])
    spread = jacobian @ covariance @ jacobian.T / length ** 2
    basis = np.linalg.svd((t / length)[None])[2][1:]  # two unit vectors across the direction
    offset = basis @ (t / length - true[:3, 3] / true_length)
    rotation_variance, direction_variance = np.diag(covariance)[3:], np.einsum('ij,jk,ik->i', basis, spread, basis)
    with np.errstate(divide='ignore', invalid='ignore'):
        return dict(nees_rot=[float(x) for x in w ** 2 / rotation_variance],
                    nees_dir=[float(x) for x in offset ** 2 / direction_variance])


def tracking_nees(motions, truth):
    """Squared error over variance of tracked poses relative to their keyframes, a degree of freedom: medians. The unit
    is free: one scale, that fits all motions best, is taken out. 0.79 would be the ideal of a Gaussian.

    @param motions  (time, time of the keyframe, T_cam_keyframe 4x4, covariance 6x6 of a left increment [translation;
                    rotation]) of one segment
    @return empty where fewer than ten poses have a truth or none of them moves"""
    known = [(t, k, np.array(pose, float), np.array(covariance, float)) for t, k, pose, covariance in motions]
    known = [(pose, covariance, tr.inverse(truth.pose(t)) @ truth.pose(k)) for t, k, pose, covariance in known
             if truth.pose(t) is not None and truth.pose(k) is not None]
    length = sum(pose[:3, 3] @ pose[:3, 3] for pose, _, _ in known)
    scale = sum(pose[:3, 3] @ true[:3, 3] for pose, _, true in known) / length if length else 0
    if len(known) < MIN_TRACKED or not scale > 0:
        return {}
    moved, turned = [], []
    for pose, covariance, true in known:
        true[:3, 3] /= scale
        error = pose @ tr.inverse(true)
        for values, e, block in ((moved, error[:3, 3], covariance[:3, :3]), (turned, rotation_vector(error), covariance[3:, 3:])):
            values.append(e @ np.linalg.solve(block, e) / 3)
    return dict(nees_tracked_rot=float(np.median(turned)), nees_tracked_trans=float(np.median(moved)))


def true_depths(depth_image, depth_camera, camera, pixels):
    """True depth under rectified pixels: median of the 2 x 2 neighbourhood; NaN in holes, outside and on edges.

    @param depth_image   h x w, metres along the optical axis, NaN where unknown
    @param depth_camera  (fx, fy, cx, cy) of that image
    @param camera        (fx, fy, cx, cy) of the pixels
    @param pixels        n x 2"""
    u = (pixels[:, 0] - camera[2]) / camera[0] * depth_camera[0] + depth_camera[2]
    v = (pixels[:, 1] - camera[3]) / camera[1] * depth_camera[1] + depth_camera[3]
    column, row = np.floor(u).astype(int), np.floor(v).astype(int)
    height, width = depth_image.shape
    inside = (column >= 0) & (row >= 0) & (column + 1 < width) & (row + 1 < height)
    around = np.stack([depth_image[row[inside] + a, column[inside] + b] for a in (0, 1) for b in (0, 1)])
    with warnings.catch_warnings(), np.errstate(all='ignore'):
        warnings.simplefilter('ignore', RuntimeWarning)  # neighbourhoods without any depth
        median = np.nanmedian(around, axis=0)
        span = (np.nanmax(around, axis=0) - np.nanmin(around, axis=0)) / median
    median[~(span < MAX_DEPTH_SPAN)] = np.nan
    depths = np.full(len(pixels), np.nan)
    depths[inside] = median
    return depths


def depth_errors(inverse_depths, true):
    """Relative depth errors after the one scale that makes their median smallest.

    @param inverse_depths  n, in a free unit; those not positive count as wrong
    @param true            n depths, NaN where unknown
    @return None with fewer than twenty points; `scale` = true unit of one estimated unit"""
    known = np.isfinite(true) & (true > 0)
    usable = known & np.isfinite(inverse_depths) & (inverse_depths > 0)
    estimate, wanted = 1 / inverse_depths[usable], true[usable]
    if len(estimate) < MIN_DEPTHS:
        return None
    middle = float(np.median(wanted / estimate))
    scales = middle * np.exp(np.linspace(-0.7, 0.7, 281))  # half a per cent apart, up to a factor of two
    for _ in range(2):
        errors = np.abs(scales[:, None] * estimate - wanted) / wanted
        best = int(np.argmin(np.median(errors, axis=1)))
        scale, errors = float(scales[best]), errors[best]
        scales = scale * np.exp(np.linspace(-0.005, 0.005, 51))  # then 0.02 per cent apart
    share = len(estimate) / int(known.sum())
    return dict(points=len(estimate), not_positive=int(known.sum()) - len(estimate), scale=scale,
                median=float(np.median(errors)), within10=float((errors < .10).mean()) * share,
                within25=float((errors < .25).mean()) * share)


def depth_nees(inverse_depths, variances, true, scale):
    """Median of squared error over variance of inverse depths; 0.45 (median of chi-square with one degree) is ideal."""
    with np.errstate(all='ignore'):
        values = (inverse_depths - scale / true) ** 2 / variances
    values = values[np.isfinite(values)]
    return float(np.median(values)) if len(values) else None
