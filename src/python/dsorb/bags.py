# SPDX-License-Identifier: BSD-3-Clause
"""Images of a ROS 1 or ROS 2 bag or an MCAP file as a folder that dso_dataset reads. Needs the package rosbags."""
from __future__ import annotations

import math
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Optional

import numpy as np

from .pictures import opencv

SUFFIXES = ('.bag', '.mcap', '.db3')
IMAGE_TYPES = ('sensor_msgs/msg/Image', 'sensor_msgs/msg/CompressedImage')
CAMERA_INFO = 'sensor_msgs/msg/CameraInfo'
MAGIC = {b'\xff\xd8\xff': '.jpg', b'\x89PNG': '.png'}
NANOSECONDS = 10**9
MARGIN = 2  # between an image's time and that of its recording, at most [s]
# Channels of an encoding, as PGM and PPM want them: grey, or red, green, blue.
CHANNELS = {'mono8': [0], '8uc1': [0], 'mono16': [0], '16uc1': [0], 'rgb8': [0, 1, 2], 'bgr8': [2, 1, 0], '8uc3': [2, 1, 0],
            'rgba8': [0, 1, 2, 3], 'bgra8': [2, 1, 0, 3], '8uc4': [2, 1, 0, 3]}
LUMA_FIRST, LUMA_SECOND = ('yuv422_yuy2', 'yuyv'), ('yuv422', 'uyvy')
BAYER = {'bayer_rggb8': 'COLOR_BAYER_BG2GRAY', 'bayer_bggr8': 'COLOR_BAYER_RG2GRAY', 'bayer_gbrg8': 'COLOR_BAYER_GR2GRAY',
         'bayer_grbg8': 'COLOR_BAYER_GB2GRAY'}  # OpenCV names the second row's second pixel first
TIMES = 'times.txt'
CALIBRATION = 'camera_info.yaml'


class BagError(ValueError):
    """A bag that cannot be used; the message says why."""


class TopicError(BagError):
    """No image topic was chosen, or one that the bag does not have; the message lists those it has."""


@dataclass
class Unpacked:
    folder: Path  # images/ and times.txt
    topic: str
    images: int
    left_out: int  # whose time is that of another one
    calibration: Optional[Path]  # from the camera_info beside the topic


def is_bag(source: str) -> bool:
    path = Path(source)
    return path.suffix in SUFFIXES and path.is_file() or (path / 'metadata.yaml').is_file()


@contextmanager
def opened(path: Path) -> Iterator[Any]:
    """The reader of a bag; what it finds wrong later is a BagError, too."""
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise BagError(f'{path}: reading bags needs the package rosbags: pip install rosbags') from None
    try:
        with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
            yield reader
    except (BagError, OSError):
        raise
    except Exception as error:  # of many kinds, where the bytes are not what rosbags expects
        raise BagError(f'{path}: damaged, or no bag: {str(error) or type(error).__name__}') from None


def image_topics(reader: Any) -> dict[str, int]:
    """Number of messages of every topic that has images."""
    return {name: info.msgcount for name, info in reader.topics.items() if info.msgtype in IMAGE_TYPES and info.msgcount}


def choose(path: Path, topics: dict[str, int], wanted: Optional[str]) -> str:
    if not topics:
        raise BagError(f'{path}: has no topic of images')
    listed = ''.join(f'\n  {name}: {count} images' for name, count in topics.items())
    if wanted is None and len(topics) > 1:
        raise TopicError(f'{path}: has several topics of images; choose one with --topic:{listed}')
    if wanted is not None and wanted not in topics:
        raise TopicError(f"{path}: has no images of the topic '{wanted}'; those it has:{listed}")
    return wanted or next(iter(topics))


def time_of(message: Any, received: int) -> int:
    """[ns] of the header, or, where nobody set that, when the message was recorded."""
    stamp = message.header.stamp
    return (stamp.sec * NANOSECONDS + stamp.nanosec) or received


def pnm(image: np.ndarray) -> bytes:
    """PGM or PPM of (height, width) or (height, width, 3) of uint8 or uint16."""
    kind = b'P5' if image.ndim == 2 else b'P6'
    most = np.iinfo(image.dtype).max
    return b'%s %d %d %d\n' % (kind, image.shape[1], image.shape[0], most) + image.astype(image.dtype.newbyteorder('>')).tobytes()


def raw_image(message: Any) -> np.ndarray:
    """Pixels of a sensor_msgs/Image; colours where it has some, grey of a mosaic and of YUV."""
    encoding, (height, width) = message.encoding.lower(), (message.height, message.width)
    kind = np.dtype('u2' if encoding.endswith(('16', '16uc1')) else 'u1').newbyteorder('>' if message.is_bigendian else '<')
    yuv = encoding in LUMA_FIRST + LUMA_SECOND
    if not (encoding in CHANNELS or encoding in BAYER or yuv):
        raise BagError(f"encoding '{message.encoding}'; expected mono8, mono16, rgb8, bgr8, rgba8, bgra8, bayer_*8 or YUV 4:2:2")
    channels = 2 if yuv else len(CHANNELS.get(encoding, [0]))
    row = width * channels * kind.itemsize
    if message.step < row or len(message.data) < message.step * height:
        raise BagError(f'{len(message.data)} bytes, rows of {message.step}; expected {height} rows of {row} or more')
    rows = np.asarray(message.data, np.uint8)[:message.step * height].reshape(height, message.step)[:, :row]
    pixels = np.ascontiguousarray(rows).view(kind).reshape(height, width, channels)
    if yuv:
        return pixels[..., 0 if encoding in LUMA_FIRST else 1]
    if encoding in BAYER:
        cv2 = opencv(f'{encoding}: a mosaic of colours')
        return cv2.cvtColor(np.ascontiguousarray(pixels[..., 0]), getattr(cv2, BAYER[encoding]))
    pixels = pixels[..., CHANNELS[encoding][:3]].astype(kind.newbyteorder('='))
    return pixels[..., 0] if channels == 1 else pixels


def file_of(message: Any) -> tuple[str, bytes]:
    """Suffix and content of the file of an image."""
    if message.__msgtype__ == IMAGE_TYPES[0]:
        image = raw_image(message)
        return '.pgm' if image.ndim == 2 else '.ppm', pnm(image)
    data = bytes(message.data)
    for magic, suffix in MAGIC.items():
        if data.startswith(magic):
            return suffix, data
    raise BagError(f"compressed as '{message.format}'; expected JPEG or PNG")


def messages_within(reader: Any, connections: list[Any], begin: float, end: float) -> Iterator[tuple[Any, int, Any]]:
    """Messages recorded from `begin` to `end` [s] after the first, MARGIN more on both sides; the first one always: times count
    from it."""
    first = next(reader.messages(connections=connections))
    start = first[1] + max(0, int((begin - MARGIN) * NANOSECONDS))
    if start > first[1]:
        yield first
    stop = None if end == math.inf else first[1] + int((end + MARGIN) * NANOSECONDS)
    yield from reader.messages(connections=connections, start=start, stop=stop)


def write_images(reader: Any, topic: str, folder: Path, begin: float, end: float) -> tuple[dict[int, str], int]:
    """Files of the images by their times [ns], and how many were left out because another one has their time."""
    files, left_out = {}, 0
    connections = [c for c in reader.connections if c.topic == topic]
    for number, (connection, received, data) in enumerate(messages_within(reader, connections, begin, end)):
        message = reader.deserialize(data, connection.msgtype)
        time = time_of(message, received)
        if time in files:
            left_out += 1
            continue
        try:
            suffix, content = file_of(message)
        except ValueError as error:
            raise BagError(f'{topic}, image {number}: {error}') from None
        files[time] = f'{time:020d}{suffix}'  # in the order of their times, which need not be that of the messages
        (folder / files[time]).write_bytes(content)
    return files, left_out


def write_calibration(reader: Any, topic: str, file: Path) -> Optional[Path]:
    """The camera_info beside a topic, as `ros2 topic echo` prints it; None where there is none, or nobody calibrated.

    Of images that were rectified (`image_rect`, `image_rect_color`) it is the camera of P, without distortion."""
    base = topic[:-len('/compressed')] if topic.endswith('/compressed') else topic
    name = base.rpartition('/')[0] + '/camera_info'
    connections = [c for c in reader.connections if c.topic == name and c.msgtype == CAMERA_INFO]
    for connection, _, data in reader.messages(connections=connections) if connections else ():
        info = reader.deserialize(data, connection.msgtype)
        k, d, p = (np.ravel(getattr(info, key, getattr(info, key.upper(), ()))) for key in 'kdp')
        model, roi = info.distortion_model or 'plumb_bob', info.roi
        if base.rpartition('/')[2].startswith('image_rect'):
            k, d, model = p.reshape(3, 4)[:, :3].ravel(), (), 'none'
        if k[0] <= 0:
            return None
        numbers = [', '.join(f'{x:.17g}' for x in values) for values in (k, d)]
        region = ''.join(f'  {key}: {getattr(roi, key)}\n' for key in ('x_offset', 'y_offset', 'height', 'width'))
        file.write_text(f'width: {info.width}\nheight: {info.height}\ndistortion_model: {model}\nd: [{numbers[1]}]\nk: [{numbers[0]}]\n'
                        f'binning_x: {info.binning_x}\nbinning_y: {info.binning_y}\nroi:\n{region}', encoding='utf-8')
        return file
    return None


def remove_unpacked(folder: Path) -> None:
    """What an earlier call made. Raises BagError where others have put something there."""
    if not (folder / TIMES).is_file():
        return
    others = sorted({path.name for path in folder.iterdir()} - {'images', TIMES, CALIBRATION})
    if others:
        raise BagError(f'{folder}: holds {others[0]}, which is not of a bag; move it away, or choose another output folder')
    shutil.rmtree(folder)


def unpack(source: str, topic: Optional[str], folder: Path, begin: float = 0, end: float = math.inf) -> Unpacked:
    """Writes the images of a topic, as they are, with their times and the calibration beside them: those from `begin` to `end` [s]
    after the first, the first itself and a few more.

    `folder` is replaced where it is one of an earlier call. Raises BagError, TopicError where the topic is not
    there, OSError."""
    path = Path(source)
    with opened(path) as reader:
        chosen = choose(path, image_topics(reader), topic)
        remove_unpacked(folder)
        images = folder / 'images'
        images.mkdir(parents=True, exist_ok=True)
        (folder / TIMES).touch()  # this folder is ours, also after a kill
        files, left_out = write_images(reader, chosen, images, begin, end)
        calibration = write_calibration(reader, chosen, folder / CALIBRATION)
    lines = [f'{files[time]} {time // NANOSECONDS}.{time % NANOSECONDS:09d}\n' for time in sorted(files)]
    (folder / TIMES).write_text(''.join(lines), encoding='utf-8')
    return Unpacked(folder, chosen, len(files), left_out, calibration)
