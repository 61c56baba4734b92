# SPDX-License-Identifier: BSD-3-Clause
"""Metres for the trajectory of a run, from what somebody knows beside the images: a distance between two of them, speeds,
altitudes or a GPS track by time. Writes FOLDER/metric: trajectory.txt, points.ply, metric.json."""
import csv
import json
import math
import re
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import Optional
from xml.etree import ElementTree

import numpy as np

from .run_folder import finish_folder, new_folder, read_run

EARTH_RADIUS, FLATTENING = 6378137.0, 1 / 298.257223563  # WGS 84 [m]
MOST_UNCERTAIN = .2  # relative standard deviation of a scale that is still written
LEAST_TRAVEL = .2  # of a window between two speeds' displacements [s]
ITERATIONS, HUBER = 10, 2.0  # of robust least squares; in standard deviations


class MetricError(ValueError):
    """Why there is no scale; the message names the file and what was expected."""


@dataclass
class Similarity:
    """p_metric = scale R p + t."""
    scale: float
    relative_sigma: float
    R: np.ndarray
    t: np.ndarray
    frame: str  # what the axes are
    covariance: Optional[np.ndarray] = None  # (7, 7) of t, a left increment of R, log scale
    residual: Optional[float] = None  # RMS [m or m/s]
    samples: int = 0
    origin: Optional[tuple] = None  # latitude, longitude [degrees], altitude [m]


def numbers_of(path, columns, what):
    """(n, columns) of a CSV file; a first line that has no numbers is a header, lines with # are comments."""
    rows = []
    try:
        with Path(path).open(newline='', encoding='utf-8-sig') as file:
            for number, words in enumerate(csv.reader(file), 1):
                words = [word.strip() for word in words]
                if not any(words) or words[0].startswith('#') or (not rows and re.match('[a-zA-Z]', words[0])):
                    continue
                try:
                    row = [seconds_of(words[0]), *map(float, words[1:columns])]
                except ValueError:
                    row = []
                if len(row) != columns or not np.isfinite(row).all():
                    raise MetricError(f'{path}:{number}: {",".join(words)[:60]}: expected {what}')
                rows.append(row)
    except UnicodeDecodeError:
        raise MetricError(f'{path}: no text; expected lines of {what}') from None
    if len(rows) < 2:
        raise MetricError(f'{path}: {len(rows)} lines with numbers; expected two or more of {what}')
    rows = np.array(rows)
    if (np.diff(rows[:, 0]) <= 0).any():
        raise MetricError(f'{path}: times do not increase at line {int(np.argmax(np.diff(rows[:, 0]) <= 0)) + 2} of the numbers')
    return rows


def seconds_of(word):
    """Seconds; nanoseconds where they are that many, or a date of ISO 8601."""
    if re.match(r'\d{4}-\d\d-\d\dT', word):
        moment = datetime.fromisoformat(re.sub(r'Z$', '+00:00', word))
        return (moment if moment.tzinfo else moment.replace(tzinfo=timezone.utc)).timestamp()
    value = float(word)
    return value * 1e-9 if value > 1e16 else value


def gpx_of(path):
    """(n, 4): time, latitude, longitude, altitude of the points of a GPX track."""
    try:
        root = ElementTree.parse(path).getroot()
    except ElementTree.ParseError as error:
        raise MetricError(f'{path}: no GPX: {error}') from None
    rows = []
    for point in root.iterfind('.//{*}trkpt'):
        time = point.find('{*}time')
        if time is None or not time.text:
            raise MetricError(f'{path}: track point {len(rows) + 1} has no <time>')
        height = point.find('{*}ele')
        rows.append([seconds_of(time.text.strip()), float(point.get('lat')), float(point.get('lon')), float(height.text) if height is not None else 0.])
    if len(rows) < 3:
        raise MetricError(f'{path}: {len(rows)} track points; expected three or more <trkpt>')
    return np.array(rows)


def east_north_up(track):
    """(n, 3) [m] from the first point, of latitude, longitude [degrees] and altitude [m]."""
    latitude, longitude = np.radians(track[:, 0]), np.radians(track[:, 1])
    squared = FLATTENING * (2 - FLATTENING)
    across = EARTH_RADIUS / np.sqrt(1 - squared * np.sin(latitude) ** 2)
    ecef = np.stack([(across + track[:, 2]) * np.cos(latitude) * np.cos(longitude), (across + track[:, 2]) * np.cos(latitude) * np.sin(longitude),
                     (across * (1 - squared) + track[:, 2]) * np.sin(latitude)], 1)
    (s, c), (sl, cl) = (np.sin(latitude[0]), np.cos(latitude[0])), (np.sin(longitude[0]), np.cos(longitude[0]))
    axes = np.array([[-sl, cl, 0], [-s * cl, -s * sl, c], [c * cl, c * sl, s]])
    return (ecef - ecef[0]) @ axes.T


def within(times, table, path):
    """Which frames lie within the times of a table. Raises where fewer than three do."""
    inside = (times >= table[0, 0]) & (times <= table[-1, 0])
    if inside.sum() < 3:
        raise MetricError(f'{path}: its times are {table[0, 0]:.3f} to {table[-1, 0]:.3f} s, those of the images {times[0]:.3f} to {times[-1]:.3f} s: '
                          f'fewer than three images lie within; --time-offset SECONDS is added to the former: {times[0] - table[0, 0]:.3f} where both begin at once')
    return inside


def by_distance(segment, path_words):
    first, second, metres, sigma = path_words
    at = {frame.index: frame.position for frame in segment.frames}
    for index in (first, second):
        if index not in at:
            raise MetricError(f'--distance: image {index} has no pose in segment {segment.number}')
    units = np.linalg.norm(at[second] - at[first])
    if not units > 0:
        raise MetricError(f'--distance: the camera stands at one place in images {first} and {second}')
    return Similarity(metres / units, sigma / metres, np.eye(3), np.zeros(3), 'as the segment', samples=1)


def by_speed(times, positions, table, path):
    """Displacements between images against those of the integrated speed."""
    inside = within(times, table, path)
    times, positions = times[inside], positions[inside]
    travelled = np.concatenate([[0], np.cumsum(np.diff(table[:, 0]) * (table[1:, 1] + table[:-1, 1]) / 2)])
    metres_at = np.interp(times, table[:, 0], travelled)
    ends, last = [0], times[0]
    for i, time in enumerate(times):
        if time - last >= LEAST_TRAVEL:
            ends, last = ends + [i], time
    units = np.linalg.norm(np.diff(positions[ends], axis=0), axis=1)
    metres = np.diff(metres_at[ends])
    if len(units) < 3 or not (units > 0).any():
        raise MetricError(f'{path}: fewer than three stretches of {LEAST_TRAVEL} s with poses and speeds')
    scale, sigma, residual = robust(units[:, None], metres)
    return Similarity(scale[0], math.sqrt(sigma[0, 0]) / abs(scale[0]), np.eye(3), np.zeros(3), 'as the segment', residual=residual, samples=len(units))


def robust(A, b):
    """Least squares of A x = b with Huber's weights: x, its covariance from the residuals, their RMS."""
    weights = np.ones(len(b))
    for _ in range(ITERATIONS):
        normal = A.T @ (weights[:, None] * A)
        x = np.linalg.lstsq(normal, A.T @ (weights * b), rcond=None)[0]
        errors = np.abs(A @ x - b)
        spread = max(1.4826 * np.median(errors), 1e-12)
        weights = np.minimum(1, HUBER * spread / np.maximum(errors, 1e-12))
    freedom = max(len(b) - A.shape[1], 1)
    variance = (weights * errors ** 2).sum() / freedom
    return x, variance * np.linalg.pinv(normal), math.sqrt((errors ** 2).mean())


def by_altitude(times, positions, table, path):
    """Altitudes are linear in the position: the gradient's length is metres a unit, its direction is up."""
    inside = within(times, table, path)
    centre = positions[inside].mean(0)
    x, covariance, residual = robust(np.column_stack([positions[inside] - centre, np.ones(inside.sum())]), np.interp(times[inside], table[:, 0], table[:, 1]))
    scale = np.linalg.norm(x[:3])
    up = x[:3] / max(scale, 1e-300)
    spread = np.linalg.svd(positions[inside] - centre, compute_uv=False)
    if spread[2] < .02 * spread[0]:
        raise MetricError(f'{path}: the camera moved along a line or in a plane: altitudes do not tell the scale; expected motion up and down and to two sides')
    sigma = math.sqrt(max(up @ covariance[:3, :3] @ up, 0)) / max(scale, 1e-300)
    aside = np.cross(up, [1., 0, 0] if abs(up[0]) < .9 else [0, 1., 0])
    aside /= np.linalg.norm(aside)
    R = np.stack([aside, np.cross(up, aside), up])
    return Similarity(scale, sigma, R, np.array([0, 0, x[3]]) - scale * R @ centre, 'z up, heading free', residual=residual, samples=int(inside.sum()))


def hat(v):
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


def exp_so3(w):
    angle = np.linalg.norm(w)
    if angle < 1e-12:
        return np.eye(3) + hat(w)
    k = hat(w / angle)
    return np.eye(3) + math.sin(angle) * k + (1 - math.cos(angle)) * k @ k


def umeyama(source, target):
    """Umeyama, Least-squares estimation of transformation parameters between two point patterns."""
    a, b = source - source.mean(0), target - target.mean(0)
    u, d, vt = np.linalg.svd(b.T @ a / len(a))
    s = np.diag([1, 1, np.sign(np.linalg.det(u) * np.linalg.det(vt))])
    scale = np.trace(np.diag(d) @ s) / (a ** 2).sum() * len(a)
    R = u @ s @ vt
    return scale, R, target.mean(0) - scale * R @ source.mean(0)


def by_gps(times, positions, track, path):
    """Sim(3) to east, north, up of the track's first point; covariance from the residuals."""
    inside = within(times, track, path)
    metres = east_north_up(track[:, 1:])
    target = np.stack([np.interp(times[inside], track[:, 0], metres[:, i]) for i in range(3)], 1)
    source = positions[inside]
    spread = np.linalg.svd(target - target.mean(0), compute_uv=False)
    if spread[0] <= 0 or spread[1] < .01 * spread[0]:
        raise MetricError(f'{path}: the track is a line: the rotation about it is not known; expected a turn')
    scale, R, t = umeyama(source, target)
    for _ in range(ITERATIONS):
        turned = scale * source @ R.T
        errors = turned + t - target
        length = np.linalg.norm(errors, axis=1)
        spread = max(np.median(length), 1e-12)
        weights = np.repeat(np.minimum(1, HUBER * spread / np.maximum(length, 1e-12)), 3)
        J = np.concatenate([np.column_stack([np.eye(3), -hat(p), p]) for p in turned])
        normal = J.T @ (weights[:, None] * J)
        step = -np.linalg.solve(normal, J.T @ (weights * errors.ravel()))
        t, R, scale = t + step[:3], exp_so3(step[3:6]) @ R, scale * math.exp(step[6])
    # Interpolated fixes are not independent: as many count as the track has.
    fixes = int(((track[:, 0] >= times[inside][0]) & (track[:, 0] <= times[inside][-1])).sum())
    variance = (weights * errors.ravel() ** 2).sum() / max(3 * inside.sum() - 7, 1) * max(inside.sum() / max(fixes, 1), 1)
    covariance = variance * np.linalg.inv(normal)
    return Similarity(scale, math.sqrt(covariance[6, 6]), R, t, 'east, north, up', covariance, math.sqrt((errors ** 2).sum(1).mean()), fixes, tuple(track[0, 1:]))


def similarity_for(segment, knowledge):
    """@param knowledge dictionary with one of distance, speed, altitude, gps, and time_offset [s]"""
    times = np.array([float(frame.time) for frame in segment.frames])
    positions = np.array([frame.position for frame in segment.frames])
    if knowledge.get('distance'):
        return by_distance(segment, knowledge['distance'])
    kind, fit, columns, what = next(row for row in TABLES if knowledge.get(row[0]))
    path = knowledge[kind]
    table = gpx_of(path) if kind == 'gps' and str(path).lower().endswith('.gpx') else numbers_of(path, columns, what)
    table[:, 0] += knowledge.get('time_offset') or 0
    return fit(times, positions, table, path)


TABLES = (('speed', by_speed, 2, 'time [s], speed [m/s]'), ('altitude', by_altitude, 2, 'time [s], altitude [m]'),
          ('gps', by_gps, 4, 'time [s], latitude, longitude [degrees], altitude [m]'))


def quaternion_of(R):
    """x y z w"""
    w = math.sqrt(max(0, 1 + np.trace(R))) / 2
    if w > .1:
        return np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1], 4 * w * w]) / (4 * w)
    values, vectors = np.linalg.eigh(np.array([  # of the largest eigenvalue; w may be 0
        [R[0, 0] - R[1, 1] - R[2, 2], R[0, 1] + R[1, 0], R[0, 2] + R[2, 0], R[2, 1] - R[1, 2]],
        [R[0, 1] + R[1, 0], R[1, 1] - R[0, 0] - R[2, 2], R[1, 2] + R[2, 1], R[0, 2] - R[2, 0]],
        [R[0, 2] + R[2, 0], R[1, 2] + R[2, 1], R[2, 2] - R[0, 0] - R[1, 1], R[1, 0] - R[0, 1]],
        [R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1], np.trace(R)]]))
    return vectors[:, np.argmax(values)]


def write_segment(target, ending, segment, found):
    lines = []
    for frame in segment.frames:
        pose = frame.T_world_cam
        position = found.scale * found.R @ pose[:3, 3] + found.t
        lines.append(f'{frame.time} ' + ' '.join(f'{x:.9f}' for x in [*position, *quaternion_of(found.R @ pose[:3, :3])]) + '\n')
    (target / f'trajectory{ending}.txt').write_text(''.join(lines), encoding='utf-8')
    points = segment.points
    vertices = np.empty(len(points.positions), [('xyz', '<f8', 3), ('rgb', 'u1', 3)])
    vertices['xyz'], vertices['rgb'] = found.scale * points.positions @ found.R.T + found.t, points.colours
    header = f'ply\nformat binary_little_endian 1.0\ncomment metres, {found.frame}\nelement vertex {len(vertices)}\n' + \
        ''.join(f'property double {axis}\n' for axis in 'xyz') + ''.join(f'property uchar {c}\n' for c in ('red', 'green', 'blue')) + 'end_header\n'
    (target / f'points{ending}.ply').write_bytes(header.encode() + vertices.tobytes())


def to_metres(folder, knowledge):
    """Writes FOLDER/metric. Returns sentences; raises MetricError where no segment has a scale."""
    run = read_run(folder)
    if not run.segments:
        raise MetricError(f'{folder}: no image has a pose')
    notes, done, why = [], [], []
    for segment in run.segments:
        try:
            found = similarity_for(segment, knowledge)
            if not found.scale > 0 or not found.relative_sigma < MOST_UNCERTAIN:
                raise MetricError(f'metres a unit would be {found.scale:.3g} with a relative standard deviation of {found.relative_sigma:.2g}: too uncertain')
            done.append((segment, found))
        except MetricError as error:
            why.append(f'segment {segment.number}: {error}')
    if not done:
        raise MetricError('; '.join(why))
    target = new_folder(run.folder, 'metric')
    told = []
    for place, (segment, found) in enumerate(done):
        write_segment(target, f'_{place}' if place else '', segment, found)
        told.append({'segment': segment.number, 'metres_per_unit': found.scale, 'relative_sigma': found.relative_sigma, 'axes': found.frame,
                     'R': found.R.tolist(), 't': found.t.tolist(), 'covariance': None if found.covariance is None else found.covariance.tolist(),
                     'residual_rms': found.residual, 'samples': found.samples, 'origin': found.origin})
        notes.append(f'segment {segment.number}: {found.scale:.4g} m a unit, known to {100 * found.relative_sigma:.2g} % (1 sigma)' +
                     (f', residuals {found.residual:.2g} (RMS) over {found.samples}' if found.residual is not None else ''))
    (target / 'metric.json').write_text(json.dumps(told, indent=1) + '\n', encoding='utf-8')
    finish_folder(run.folder, 'metric')
    return notes + why + [f'metric: {target}']
