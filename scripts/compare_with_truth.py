#!/usr/bin/python3
# SPDX-License-Identifier: BSD-3-Clause
"""Compare an output folder of dso_dataset with the truth of a synthetic sequence and print a small table.

  compare_with_truth.py SEQUENCE OUT_DIR"""
import argparse
import json
import sys
from pathlib import Path

import cv2
import numpy as np

from dsorb_eval import metrics
from dsorb_eval import trajectory as tr


def pose_error(start, truth):
    """Errors of the initializer's relative pose, with keys `rot_deg` and `dir_deg`."""
    target = next(p for p in start['poses'] if p['index'] == start['target']['index'])
    times = start['reference']['timestamp'], start['target']['timestamp']
    return metrics.initial_pose_errors(target['T_cam_ref'], *times, truth, times)


def depth_error(start, sequence):
    """Median relative depth error of the start's points after the best scale."""
    image = sorted((sequence / 'depth').iterdir())[start['reference']['index']]
    depth = cv2.imread(str(image), cv2.IMREAD_UNCHANGED) / 1000
    depth[depth <= 0] = np.nan
    camera = [start['camera'][key] for key in ('fx', 'fy', 'cx', 'cy')]  # rendered images need no rectification
    points = np.array(start['points'])
    return metrics.depth_errors(points[:, 2], metrics.true_depths(depth, camera, camera, points[:, :2]))['median']


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('sequence', type=Path)
    parser.add_argument('out_dir', type=Path)
    args = parser.parse_args()
    starts = json.loads((args.out_dir / 'initialization.json').read_text())['initializations']
    run = json.loads((args.out_dir / 'run.json').read_text())
    if not starts:
        sys.exit(f'{args.out_dir}: never initialized')
    truth = tr.GroundTruth(tr.load_tum(args.sequence / 'groundtruth.txt'))
    pose = pose_error(starts[0], truth)
    trajectory = args.out_dir / 'trajectory_0.txt'  # first of several segments, each has its own scale
    if not trajectory.exists():
        trajectory = args.out_dir / 'trajectory.txt'
    whole = metrics.trajectory_errors(tr.load_tum(trajectory), truth)
    errors = metrics.tracking_nees(tr.load_motions(args.out_dir / 'frames.csv', starts[0]['segment']), truth)
    rows = [('frames until initialized', f"{starts[0]['frames_given']}"),
            ('time of the frame that initialized', f"{starts[0]['milliseconds']['last_frame']:.0f} ms"),
            ('points handed over', f"{len(starts[0]['points'])}"),
            ('rotation error of the start', f"{pose['rot_deg']:.3f} deg"),
            ('direction error of the start', f"{pose['dir_deg']:.3f} deg"),
            ('median depth error of the start', f'{100 * depth_error(starts[0], args.sequence):.2f} %'),
            ('frames tracked afterwards', f"{run['frames_tracked']} of {run['frames_given'] - starts[0]['frames_given']}, {run['segments']} segment(s)"),
            ('trajectory error (RMS) over the way', f"{whole['ate']:.3f} m of {whole['path']:.1f} m, {100 * whole['ate_over_path']:.2f} %")]
    if errors:
        rows.append(('error^2 / variance of tracked poses', f"{errors['nees_tracked_rot']:.2f} rotation, {errors['nees_tracked_trans']:.2f} translation"))
    for name, value in rows:
        print(f'  {name:<38}{value}')


if __name__ == '__main__':
    main()
