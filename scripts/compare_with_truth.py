#!/usr/bin/python3
# SPDX-License-Identifier: BSD-3-Clause
"""Compare an output folder of dso_dataset with the truth of a synthetic sequence and print a small table.

  compare_with_truth.py SEQUENCE OUT_DIR"""
import argparse
import json
import os
import sys

import cv2
import numpy as np


def load_tum(path):
    """timestamp -> 4x4 camera-to-world matrix"""
    poses = {}
    for row in np.atleast_2d(np.loadtxt(path)):
        x, y, z, w = row[4:8] / np.linalg.norm(row[4:8])
        T = np.eye(4)
        T[:3, :3] = [[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                     [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                     [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]]
        T[:3, 3] = row[1:4]
        poses[round(row[0], 6)] = T
    return poses


def angle_deg(cosine):
    return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))


def trajectory_error(estimate, truth):
    """Root mean square position error after the best similarity transform (Umeyama), and the way travelled."""
    stamps = sorted(set(estimate) & set(truth))
    p = np.array([estimate[t][:3, 3] for t in stamps])
    g = np.array([truth[t][:3, 3] for t in stamps])
    way = np.linalg.norm(np.diff(g, axis=0), axis=1).sum()
    a, b = p - p.mean(0), g - g.mean(0)
    U, D, Vt = np.linalg.svd(b.T @ a)
    S = np.diag([1, 1, np.sign(np.linalg.det(U) * np.linalg.det(Vt))])
    R, scale = U @ S @ Vt, (D * np.diag(S)).sum() / (a ** 2).sum()
    return np.sqrt(((scale * a @ R.T - b) ** 2).sum(1).mean()), way


def start_error(start, truth):
    """Rotation and direction error [deg] of the initializer's relative pose."""
    target = next(p for p in start['poses'] if p['index'] == start['target']['index'])
    T = np.linalg.inv(np.array(target['T_cam_ref']))
    G = np.linalg.inv(truth[round(start['reference']['timestamp'], 6)]) @ truth[round(start['target']['timestamp'], 6)]
    t, g = T[:3, 3], G[:3, 3]
    return (angle_deg((np.trace(T[:3, :3].T @ G[:3, :3]) - 1) / 2),
            angle_deg(t @ g / np.linalg.norm(t) / np.linalg.norm(g)))


def depth_error(start, sequence):
    """Median relative depth error after the best scale."""
    depths = sorted(os.listdir(os.path.join(sequence, 'depth')))
    z = cv2.imread(os.path.join(sequence, 'depth', depths[start['reference']['index']]), cv2.IMREAD_UNCHANGED) / 1000
    points = np.array(start['points'])
    true = z[np.rint(points[:, 1]).astype(int), np.rint(points[:, 0]).astype(int)]
    known = true > 0
    ratio = points[known, 2] * true[known]
    return float(np.median(np.abs(ratio / np.median(ratio) - 1)))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('sequence')
    parser.add_argument('out_dir')
    args = parser.parse_args()
    with open(os.path.join(args.out_dir, 'initialization.json'), encoding='utf-8') as file:
        starts = json.load(file)['initializations']
    with open(os.path.join(args.out_dir, 'run.json'), encoding='utf-8') as file:
        run = json.load(file)
    if not starts:
        sys.exit(f'{args.out_dir}: never initialized')
    truth = load_tum(os.path.join(args.sequence, 'groundtruth.txt'))
    rotation, direction = start_error(starts[0], truth)
    trajectory = os.path.join(args.out_dir, 'trajectory_0.txt')  # first of several segments, each has its own scale
    if not os.path.exists(trajectory):
        trajectory = os.path.join(args.out_dir, 'trajectory.txt')
    error, way = trajectory_error(load_tum(trajectory), truth)
    rows = [('frames until initialized', f"{starts[0]['frames_given']}"),
            ('time of the frame that initialized', f"{starts[0]['milliseconds']['last_frame']:.0f} ms"),
            ('points handed over', f"{len(starts[0]['points'])}"),
            ('rotation error of the start', f'{rotation:.3f} deg'),
            ('direction error of the start', f'{direction:.3f} deg'),
            ('median depth error of the start', f'{100 * depth_error(starts[0], args.sequence):.2f} %'),
            ('frames tracked afterwards', f"{run['frames_tracked']} of {run['frames_given'] - starts[0]['frames_given']}, {run['segments']} segment(s)"),
            ('trajectory error (RMS) over the way', f'{error:.3f} m of {way:.1f} m, {100 * error / way:.2f} %')]
    for name, value in rows:
        print(f'  {name:<38}{value}')


if __name__ == '__main__':
    main()
