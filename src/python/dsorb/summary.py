# SPDX-License-Identifier: BSD-3-Clause
"""What a person wants to know of a run: how much of the video has a pose, how sure, what to do when it is little."""
import json
import math

import numpy as np

from . import evidence
from .run_folder import reading

ENOUGH = 0.9  # of the images posed: nothing to advise
# Share by which the window's focal length may be off the given one. Rendered walks: 0.5 % with the right one, 54 % with 2.2
# times the right one; people guess to 10 %.
SUSPECTED, SIGMAS = 0.1, 5
# Answers of the initializer that name an obstacle, and what helps.
ADVICE = {
    'too_few_points': 'too few corners to follow: too dark, blurred, or without texture. More light, a shorter exposure, '
                      'or a scene with more detail help',
    'too_little_parallax': 'the camera hardly moved sideways: move it by about a twentieth of the distance to the scene',
    'degenerate_motion': 'the camera turned on the spot, the motion does not tell depth, or a large object moves: walk instead of '
                         'turning, or hide the object (--mask)',
    'tracking_lost': 'what was followed was lost: darkness, cuts, fast motion, blur, or too few images a second (--every)',
    'poor_quality': 'the images contradict a rigid scene seen by this camera: check --calib or --hfov; a rolling shutter '
                    'or large moving objects do the same (--mask)',
    'timeout': 'no start within the images that one may take: slow motion (try --every 2) or none'}
FOLLOWS_FROM_DARKNESS = ('too_few_points', 'tracking_lost', 'timeout')
REFUSALS = 'the first adjustment contradicted {} start(s): check --calib or --hfov, or the shutter is a rolling one'


def summarize(run):
    """Some lines of text on an output folder that was read."""
    dropped = run.summary['frames_dropped']
    given = len(run.rows) + dropped
    if not given:
        return 'No image was read.'
    posed = sum(len(segment.frames) for segment in run.segments)
    lines = [f'{posed} of {given} images have a pose ({100 * posed / given:.0f} %)' + of_segments(run)]
    if run.summary['status'] == 'partly_tracked':
        lines.append('  fewer than half: this run does not count as tracked (exit code 3)')
    lines += [f'  segment {segment.number}: {span(run, segment)}, {len(segment.points.positions)} points'
              for segment in run.segments]
    unreadable = run.summary.get('unreadable', [])
    if unreadable:
        lines.append(f'  {len(unreadable)} image(s) could not be read and were passed over: {", ".join(unreadable[:3])}'
                     + (', ... (run.json)' if len(unreadable) > 3 else ''))
    if dropped:
        lines.append(f'  {dropped} came while the run was busy and were left out: smaller images (--width) or --pipelined take less time')
    lines += how_sure(run) + of_lens(run.summary)
    if posed < ENOUGH * len(run.rows):
        lines += advice(run)
    lines.append(f'{run.folder}: trajectory.txt{which_segment(run)}, points.ply, figures/trajectory.png; docs/formats.md has the rest')
    return '\n'.join(lines)


def of_segments(run):
    if len(run.segments) < 2:
        return ''
    return f', in {len(run.segments)} segments, each with a world and a unit of its own'


def which_segment(run):
    if len(run.segments) < 2:
        return ''
    longest = max(run.segments, key=lambda segment: len(segment.frames))
    return f' (segment {longest.number}, the longest; trajectory_N.txt the others)'


def span(run, segment):
    begin = float(run.rows[0].time)
    times = [abs(float(frame.time) - begin) for frame in segment.frames]  # backwards with --reverse
    return f'{min(times):.1f} to {max(times):.1f} s, {len(times)} images'


def starts_of(run):
    path = run.folder / 'initialization.json'
    with reading(path):
        starts = json.loads(path.read_text(encoding='utf-8'))['initializations']
        return [start for start in starts if not start['refused']]


def direction_sigma(start):
    """Standard deviation of the direction from the start's first to its last camera [deg]; None where unknown."""
    target = next(pose for pose in start['poses'] if pose['index'] == start['target']['index'])
    if target['covariance'] is None:
        return None
    translation = np.array(target['T_cam_ref'])[:3, 3]
    length = np.linalg.norm(translation)
    across = np.eye(3) - np.outer(translation, translation) / length**2
    covariance = across @ np.array(target['covariance'])[:3, :3] @ across
    return math.degrees(math.sqrt(np.linalg.eigvalsh(covariance)[-1]) / length)


def how_sure(run):
    lines = []
    for start in starts_of(run):
        sigma, wrong = direction_sigma(start), start['report'].get('wrong_probability')
        lines.append(f'  start at image {start["reference"]["index"]}, over {len(start["poses"])} images: '
                     + (f'direction +-{sigma:.1f} deg, ' if sigma is not None else '')
                     + (f'wrong by more than {evidence.wrong_angle(run)} deg with probability {100 * wrong:.2g} %, '
                        if wrong is not None else '')
                     + f'depths +-{100 * start["report"]["median_relative_sigma"]:.0f} %')
    lost = sum(row.state == 'lost' for row in run.rows)
    if lost:
        times = ', '.join(f'{float(row.time) - float(run.rows[0].time):.1f} s' for row in run.rows if row.state == 'lost')
        lines.append(f'  tracking was lost {lost} time(s): at {times}')
    missed = sum(row.state == 'missed' for row in run.rows)
    if missed:
        lines.append(f'  {missed} image(s) in between did not fit the map and have no pose (`missed` in frames.csv)')
    return lines


def of_lens(summary):
    """What the run found out about its camera, by run.json."""
    lines, camera, readout = [], summary.get('refined_camera', {}), summary.get('readout')
    found = summary.get('found_camera')
    if found:  # nobody gave a camera that could be suspected
        lines.append(f'  {found["text"]}' + (': refined_camera.txt' if found['known'] else ''))
        camera = {}
    doubt = None if found else summary.get('calibration_suspected')
    guessed = mean_focal(summary.get('lens') or summary['camera']) if camera or doubt else None
    if 'sigma' in camera:
        focal = guessed * mean_focal(camera) / mean_focal(summary['camera'])  # of the images as they were taken
        sigma = 100 * max(camera['sigma']['fx'] / camera['fx'], camera['sigma']['fy'] / camera['fy'])
        lines.append(f'  focal length {focal:.1f} px, guessed as {guessed:.1f}: '
                     + (f'+-{sigma:.2g} %; refined_camera.txt is the calibration for the next run' if camera['settled'] else
                        'not known to 1 % yet; turns and sideways motion tell it, or a calibration (docs/calibration.md)'))
        contradicted = abs(focal / guessed - 1) > max(SUSPECTED, SIGMAS * sigma / 100)
        if contradicted:
            lines.append('  calibration suspected: ' + against(focal, guessed, camera['settled']))
        if contradicted or camera['settled']:
            doubt = None  # the window knows more by now
    if doubt:
        lines.append('  calibration suspected: ' + asked_of_lens(doubt, guessed))
    if summary.get('stuck_share'):
        lines.append(f'  {100 * summary["stuck_share"]:.0f} % of the corners of a start move with the camera (a bonnet, a watermark): '
                     'hide them with --mask FILE')
    suspected = summary.get('rolling_shutter_suspected')
    if suspected and not readout and not found:
        lines.append(f'  rolling shutter suspected: the images of a start ask for {suspected["milliseconds"]:.0f} +- {suspected["sigma"]:.0f} ms '
                     'between the rows; a phone has 10 to 30. Try --readout auto')
    if readout:
        time, sigma = readout['milliseconds'], readout['sigma']
        lines.append(f'  rolling shutter: {time:.1f} +- {sigma:.1f} ms from the first to the last row' if abs(time) > 3 * sigma else
                     f'  no rolling shutter shows: {time:.1f} +- {sigma:.1f} ms from the first to the last row')
    return lines


def mean_focal(camera):
    return (camera['fx'] + camera['fy']) / 2


def asked_of_lens(doubt, given):
    """What the first keyframes say against the calibration with that focal length [px], and what to do."""
    focal, radial = (abs(doubt.get(name, 0)) / doubt.get(sigma, 1)
                     for name, sigma in (('focal_change', 'focal_sigma'), ('radial', 'radial_sigma')))
    other = (f'a {"longer" if doubt["focal_change"] > 0 else "shorter"} focal length than the {given:.0f} px given' if focal > radial else
             f'more {"barrel" if doubt["radial"] < 0 else "pincushion"} distortion than given')
    return (f'the first keyframes ask for {other} (by {max(focal, radial):.1f} standard deviations; chance explains 4). '
            'Give the field of view to --hfov, or calibrate (docs/calibration.md); a rolling shutter does the same (--readout auto)')


def against(focal, guessed, settled):
    """What speaks against a focal length [px] that was given, and what to do."""
    if not settled:
        return (f'the images contradict the focal length of {guessed:.0f} px given without telling another one: the lens may be distorted, '
                'or the motion does not tell. Calibrate (docs/calibration.md)')
    return (f'the images tell a focal length of {focal:.0f} px, {100 * abs(focal / guessed - 1):.0f} % {"more" if focal > guessed else "less"} '
            f'than the {guessed:.0f} px given. Begin again with a focal length near that, or calibrate')


def advice(run):
    """What the images show; then the most frequent obstacles, each with its count."""
    seen = evidence.gather(run)
    shown = [f'  {line}' for line in evidence.findings(seen)] if seen else []
    explained = FOLLOWS_FROM_DARKNESS if seen and seen.dark_throughout else ()
    named = sorted(((count, reason) for reason, count in run.summary.get('answers', {}).items()
                    if reason in ADVICE and reason not in explained), reverse=True)
    lines = [f'  {count} x {reason}: {ADVICE[reason]}' for count, reason in named]
    refused = sum(run.summary.get('refused', {}).values())
    if refused:
        lines.append('  ' + REFUSALS.format(refused))
    if any(row.state == 'lost' for row in run.rows) and not explained:
        lines.append('  after a loss: fast turns, darkness and cuts lose a track; a slower motion or more images a second help')
    if shown:
        shown = [f'What {seen.images} of the images without a pose show:'] + shown
    return shown + (['What stood in the way:'] + lines if lines else [])
