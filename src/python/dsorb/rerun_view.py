# SPDX-License-Identifier: BSD-3-Clause
"""A recording in the Rerun viewer: images with what is tracked in them, camera path, keyframes, the growing map.

Every segment of a run is a space of its own, `segment_<n>`: it has its own origin and unit. Needs the package rerun-sdk."""
from __future__ import annotations

import colorsys
import contextlib
import ctypes
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Optional

import numpy as np
import rerun as rr
import rerun_cli

from . import recording

APPLICATION = 'dsorb'
MAX_RELATIVE_SIGMA = .3  # of the inverse depths of points that are shown
START = 20.  # [s] until a server that was started listens
FLUSH = 60.  # [s] for a viewer that is closed, or slow, at the end
TIMELINE = 'frame'  # counts the images given; positions and times run backwards in a reversed run
PATH_CHUNK = 100  # camera positions an entity: logging one strip of all at every frame would grow with the square
FRUSTUM = .08  # depth of a keyframe's drawn pyramid, in units of its segment
IMAGE = re.compile(rb'\x89PNG\r\n|\xff\xd8\xff')  # begins so: PNG, JPEG
PATH_COLOUR, KEYFRAME_COLOUR, FINAL_COLOUR = (31, 79, 214), (44, 160, 44), (120, 120, 120)
NEAR_HUE, FAR_HUE = 0., .67  # red to blue, as in the program's figures


def depth_colours(inverse_depths: Any) -> np.ndarray:
    """Colours from near red to far blue, between the 5th and 95th percentile."""
    values = np.asarray(inverse_depths, float)
    if not len(values):
        return np.zeros((0, 3), np.uint8)
    low, high = np.percentile(values, [5, 95])
    share = np.clip((values - low) / (high - low if high > low else 1), 0, 1)
    return np.array([[255 * c for c in colorsys.hsv_to_rgb(FAR_HUE + s * (NEAR_HUE - FAR_HUE), 1, 1)] for s in share], np.uint8)


class View:
    """Logs events one after the other; `stream` is a rerun.RecordingStream."""

    def __init__(self, path: Path, stream: Any, max_relative_sigma: float):
        self.folder, self.stream, self.max_relative_sigma = Path(path).resolve().parent, stream, max_relative_sigma
        self.camera, self.images, self.rectified = None, 0, False
        self.paths, self.keyframes, self.hosted, self.known, self.start = {}, {}, {}, set(), None
        self.handlers = dict(header=self.header, image=self.image, init=self.init, refused=self.refused, pose=self.pose,
                             keyframe=self.keyframe, points=self.points, lost=self.lost, end=self.end)

    def show(self, event: dict) -> None:
        """One event; kinds of later versions are skipped."""
        handler = self.handlers.get(event['kind'])
        if handler:
            handler(event)

    def log(self, entity: str, what: Any, static: bool = False) -> None:
        rr.log(entity, what, static=static, recording=self.stream)

    def say(self, text: str, level: str = rr.TextLogLevel.INFO) -> None:
        self.log('log', rr.TextLog(text, level=level))

    def root(self, event: dict) -> str:
        """The space of an event's segment, set up when first seen."""
        segment = event['segment']
        root = f'segment_{segment}'
        if segment not in self.known:
            self.known.add(segment)
            self.log(root, rr.ViewCoordinates.RDF, static=True)
            self.log(f'{root}/camera/image', self.pinhole(.25), static=True)
        return root

    def pinhole(self, size: float) -> rr.Pinhole:
        c = self.camera
        return rr.Pinhole(focal_length=[c['fx'], c['fy']], principal_point=[c['cx'] + .5, c['cy'] + .5],  # Rerun counts from the corner
                          resolution=[c['width'], c['height']], image_plane_distance=size)

    def header(self, event: dict) -> None:
        self.camera = event['camera']
        self.say(f"{event['program']}, {event['initializer']}, {event['dataset']}")

    def image(self, event: dict) -> None:
        rr.set_time(TIMELINE, sequence=self.images, recording=self.stream)
        self.images += 1
        root, self.rectified = self.root(event), bool(event.get('rectified'))
        self.log(f'{root}/camera/image/tracks', rr.Clear(recursive=True))
        file = self.folder / event['file'] if event.get('file') else None
        if file is not None and self.may_show(file):
            self.log(f'{root}/camera/image', rr.EncodedImage(path=file))

    def may_show(self, file: Path) -> bool:
        """Whether it is an image in the recording's own folder: one by somebody else must not publish other files."""
        place = file.resolve()
        if self.folder not in place.parents or not place.is_file():
            return False
        with place.open('rb') as opened:
            return IMAGE.match(opened.read(16)) is not None

    def init(self, event: dict) -> None:
        root = self.root(event)
        self.say(f"frame {event['index']}: {event['status']} ({event['reason']})")
        if event['status'] != 'initialized':
            return
        path = self.paths.setdefault(root, [])
        self.start = root, len(path)
        path += [recording.pose(pose)[:3, 3] for _, pose in event['poses'] if pose]
        self.log_path(root, self.start[1])

    def refused(self, event: dict) -> None:
        """The path of the last start goes; it has no keyframes yet."""
        self.say(f"frame {event['index']}: start refused ({event['reason']})", rr.TextLogLevel.WARN)
        root, first = self.start
        del self.paths[root][first:]
        self.log(f'{root}/path', rr.Clear(recursive=True))
        self.log_path(root, 0)

    def tracks(self, event: dict, T_world_cam: np.ndarray) -> None:
        """The points of the keyframe that a frame hangs on, where the frame sees them."""
        host = event['segment'], event['keyframe']
        if not self.rectified or host not in self.hosted:
            return
        T_world_host, c = self.keyframes[host]
        local = (recording.world_points(self.hosted[host], T_world_host, c) - T_world_cam[:3, 3]) @ T_world_cam[:3, :3]
        local = local[local[:, 2] > 0]
        pixels = local[:, :2] / local[:, 2:] * (c['fx'], c['fy']) + (c['cx'], c['cy']) + .5
        seen = np.all((pixels > 0) & (pixels < (c['width'], c['height'])), axis=1)
        self.log(f'{self.root(event)}/camera/image/tracks', rr.Points2D(pixels[seen], colors=depth_colours(1 / local[seen, 2]), radii=2.))

    def pose(self, event: dict) -> None:
        root = self.root(event)
        if event['pose'] is None:
            return
        T_world_cam = recording.pose(event['pose'])
        self.log(f'{root}/camera', rr.Transform3D(translation=T_world_cam[:3, 3], mat3x3=T_world_cam[:3, :3]))
        self.tracks(event, T_world_cam)
        self.paths.setdefault(root, []).append(T_world_cam[:3, 3])
        self.log_path(root, len(self.paths[root]) - 1)
        if event.get('rmse') is not None:
            self.log('tracking_rmse', rr.Scalars(event['rmse']))

    def log_path(self, root: str, first: int) -> None:
        """The pieces of the camera path from a position on; neighbours share one position."""
        path = self.paths[root]
        for chunk in range(max(0, first - 1) // PATH_CHUNK, (len(path) - 1) // PATH_CHUNK + 1):
            piece = path[chunk * PATH_CHUNK:(chunk + 1) * PATH_CHUNK + 1]
            self.log(f'{root}/path/{chunk}', rr.LineStrips3D([np.array(piece)], colors=[PATH_COLOUR]))

    def keyframe(self, event: dict) -> None:
        root, T_world_cam = self.root(event), recording.pose(event['pose'])
        c = event.get('camera', self.camera)
        self.keyframes[event['segment'], event['index']] = T_world_cam, c
        corners = np.array([[(u - c['cx']) / c['fx'], (v - c['cy']) / c['fy'], 1.]
                            for u, v in ((0, 0), (c['width'], 0), (c['width'], c['height']), (0, c['height']))]) * FRUSTUM
        strips = [corners[[0, 1, 2, 3, 0]], *(np.array([np.zeros(3), corner]) for corner in corners)]
        entity = f"{root}/keyframes/{event['index']}"
        self.log(entity, rr.LineStrips3D([s @ T_world_cam[:3, :3].T + T_world_cam[:3, 3] for s in strips],
                                         colors=[FINAL_COLOUR if event['final'] else KEYFRAME_COLOUR]))

    def points(self, event: dict) -> None:
        host = event['segment'], event['keyframe']
        points = recording.certain(event['points'], np.inf)
        if host not in self.keyframes:
            return
        if event['final']:
            self.hosted.pop(host, None)
        else:
            self.hosted[host] = points
        points = recording.certain(points, self.max_relative_sigma)
        grey = np.clip(points[:, 4:5], 0, 255).astype(np.uint8)
        self.log(f"{self.root(event)}/map/{event['keyframe']}",
                 rr.Points3D(recording.world_points(points, *self.keyframes[host]), colors=np.repeat(grey, 3, axis=1)))

    def lost(self, event: dict) -> None:
        self.say(f"frame {event['index']}: lost", rr.TextLogLevel.WARN)

    def end(self, event: dict) -> None:
        self.say(f"end: {event['status']}")


def refuse_taken(port: int) -> None:
    """Raises OSError where another program listens there."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(('', port))
        except OSError as error:
            raise OSError(f'port {port}: {error.strerror}; choose another one with --port') from None


def refuse_others(save: Path) -> None:
    """Raises OSError where a file is there that is none of Rerun's."""
    with contextlib.suppress(FileNotFoundError), save.open('rb') as file:
        if file.read(2) in (b'', b'RR'):
            return
        raise OSError(f'{save}: is no recording of Rerun, and would be replaced; choose another name')


def end_with_parent() -> None:
    """In a child: no server outlives the command, however that ends."""
    ctypes.CDLL(None).prctl(1, signal.SIGTERM)  # PR_SET_PDEATHSIG


def reachable(bind: str) -> str:
    return {'0.0.0.0': '127.0.0.1', '::': '[::1]'}.get(bind, bind)


def answers(bind: str, port: int) -> bool:
    try:
        socket.create_connection((reachable(bind).strip('[]'), port), timeout=1).close()
    except OSError:
        return False
    return True


class Window:
    """Where a recording is shown: a window of the viewer, an .rrd file (`save`), or a browser (`serve`, a port, at the address `bind`).

    Raises OSError where the file cannot be written, the port is taken, or the viewer cannot be started."""

    def __init__(self, name: str, save: Optional[Path] = None, serve: Optional[int] = None, bind: str = '127.0.0.1'):
        self.stream, self.address, self.server = rr.RecordingStream(APPLICATION, recording_id=name), None, None
        # The viewer lies beside this Python, also where its environment was not activated.
        os.environ['PATH'] = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get('PATH', '')])
        try:
            if serve:
                self.serve(serve, bind)
            else:
                self.open(save)
        except RuntimeError as error:
            raise OSError(f'Rerun: {str(error).splitlines()[0]}') from None

    def serve(self, port: int, bind: str) -> None:
        """Serves by the viewer's own program, because the module's server listens on all addresses."""
        refuse_taken(port)
        refuse_taken(port + 1)  # Rerun says so only in its log
        self.server = subprocess.Popen(
            [Path(rerun_cli.__file__).parent / 'rerun', '--serve-web', '--bind', bind, '--web-viewer-port', str(port), '--port',
             str(port + 1)], stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True,
            preexec_fn=end_with_parent)  # pylint: disable=subprocess-popen-preexec-fn
        end = time.monotonic() + START
        while not all(answers(bind, number) for number in (port, port + 1)):
            if self.server.poll() is not None or time.monotonic() > end:
                self.close()
                raise OSError(f'Rerun cannot listen on {bind}, ports {port} and {port + 1}')
            time.sleep(.05)
        self.stream.connect_grpc(f'rerun+http://{reachable(bind)}:{port + 1}/proxy')
        self.address = f'http://localhost:{port}/?url=rerun+http://localhost:{port + 1}/proxy'

    def open(self, save: Optional[Path]) -> None:
        if save:
            save.parent.mkdir(parents=True, exist_ok=True)
            refuse_others(save)
            save.open('wb').close()  # rerun only logs that it could not
            self.stream.save(str(save))
        else:
            if sys.platform.startswith('linux') and not (os.environ.get('DISPLAY') or os.environ.get('WAYLAND_DISPLAY')):
                raise OSError('no display to open a window on: use --serve or --save')
            self.stream.spawn()

    def play(self, path: Path, going: Optional[Callable[[bool], bool]] = None,
             max_relative_sigma: float = MAX_RELATIVE_SIGMA) -> int:
        """Shows a recording. @return number of images shown"""
        view = View(path, self.stream, max_relative_sigma)
        for number, event in enumerate(recording.events(path, going), 1):
            try:
                view.show(event)
            except (ValueError, LookupError, TypeError, AttributeError) as error:
                raise recording.FormatError(f'{path}:{number}: a `{event["kind"]}` that is not as a run writes it: '
                                            f'{type(error).__name__}: {error}') from None
        self.stream.flush(timeout_sec=FLUSH)
        return view.images

    def close(self) -> None:
        self.stream.disconnect()
        if self.server:
            self.server.terminate()
            self.server.wait()


class Live:
    """Shows a recording in a thread while a run writes it; one of an earlier run is not shown."""

    def __init__(self, window: Window, path: Path):
        self.window, self.error, self.over, self.earlier = window, None, threading.Event(), recording.change_time(path)
        self.thread = threading.Thread(target=self.work, args=[path], daemon=True)
        self.thread.start()

    def work(self, path: Path) -> None:
        try:
            while self.earlier is not None and recording.change_time(path) == self.earlier:
                if self.over.wait(recording.POLL):
                    return
            self.window.play(path, lambda _: not self.over.is_set())
        except FileNotFoundError:  # the run ended before it had an image, and said so
            pass
        except Exception as error:  # a view that fails is no reason to end a run
            self.error = error

    def end(self) -> Optional[Exception]:
        """Waits until everything is shown. @return what went wrong, or None"""
        self.over.set()
        self.thread.join()
        return self.error
