# SPDX-License-Identifier: BSD-3-Clause
"""Images of a ROS 1 or ROS 2 bag or an MCAP file as a folder that dso_dataset reads. Needs the package rosbags."""
from __future__ import annotations

import itertools
import math
import os
import re
import shutil
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Optional

import numpy as np

from .pictures import opencv

STORAGES = ('.mcap', '.db3')  # of ROS 2
SUFFIXES = ('.bag', '.active', *STORAGES)
IMAGE_TYPES = ('sensor_msgs/msg/Image', 'sensor_msgs/msg/CompressedImage')
CAMERA_INFO = 'sensor_msgs/msg/CameraInfo'
MAGIC = {b'\xff\xd8\xff': '.jpg', b'\x89PNG': '.png', b'RIFF': '.webp', b'II*\0': '.tif', b'MM\0*': '.tif', b'BM': '.bmp'}
NANOSECONDS = 10**9
BACK, AHEAD = NANOSECONDS // 2, 60 * NANOSECONDS  # what the order of messages and their delay explain of a header's clock
LOOKED_AT = 10  # headers that tell whether their times are of any use
MARGIN = 2  # between an image's time and that of its recording, at most [s]
# Channels of an encoding, as PGM and PPM want them: grey, or red, green, blue.
CHANNELS = {'mono8': [0], '8uc1': [0], 'mono16': [0], '16uc1': [0], 'rgb8': [0, 1, 2], 'bgr8': [2, 1, 0], '8uc3': [2, 1, 0],
            'rgb16': [0, 1, 2], 'bgr16': [2, 1, 0], 'rgba8': [0, 1, 2, 3], 'bgra8': [2, 1, 0, 3], '8uc4': [2, 1, 0, 3]}
LUMA_FIRST, LUMA_SECOND = ('yuv422_yuy2', 'yuyv'), ('yuv422', 'uyvy')
# OpenCV names the second row's second pixel first.
BAYER = {f'bayer_{ours}{bits}': f'COLOR_BAYER_{theirs}2GRAY' for bits in (8, 16)
         for ours, theirs in {'rggb': 'BG', 'bggr': 'RG', 'gbrg': 'GR', 'grbg': 'GB'}.items()}
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
    calibration: Optional[Path]  # from a camera_info
    no_calibration: str  # why there is none
    notes: list[str] = field(default_factory=list)  # a sentence each


def is_bag(source: str) -> bool:
    path = Path(source)
    if path.is_file():
        return path.suffix in SUFFIXES
    return (path / 'metadata.yaml').is_file() or bool(storages(path))


def storages(folder: Path) -> list[Path]:
    """Files of a ROS 2 bag in their order."""
    found = [path for path in folder.glob('*') if path.suffix in STORAGES]
    return sorted(found, key=lambda path: [int(word) if word.isdigit() else word for word in re.split(r'(\d+)', path.name)])


def cure(path: Path) -> str:
    """What makes a bag whose end is missing readable."""
    if path.suffix in ('.bag', '.active'):
        return f'rosbag reindex {path}'
    return f'mcap recover {path} -o recovered.mcap'


@contextmanager
def opened(path: Path) -> Iterator[Any]:
    """The reader of a bag; what it finds wrong later is a BagError, too."""
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise BagError(f'{path}: reading bags needs the package rosbags: pip install rosbags') from None
    paths = [path] if path.is_file() or (path / 'metadata.yaml').is_file() else storages(path)
    try:
        with AnyReader(paths, default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
            yield reader
    except (BagError, OSError):
        raise
    except Exception as error:  # of many kinds, where the bytes are not what rosbags expects
        for file in paths:
            file = next(iter(storages(file)), file) if file.is_dir() else file
            if is_unfinished(file):
                raise BagError(f'{file}: ends in the middle, as that of a recorder that was killed; `{cure(file)}` saves what is there') from None
        raise BagError(f'{path}: damaged, or no bag: {str(error) or type(error).__name__}') from None


def is_unfinished(file: Path) -> bool:
    """Whether a file begins as a bag and has lost its end."""
    with file.open('rb') as stream:
        begin = stream.read(200)
        stream.seek(max(0, file.stat().st_size - 8))
        end = stream.read()
    if begin.startswith(b'\x89MCAP'):
        return end != begin[:8]
    header = re.search(rb'index_pos=(.{8})', begin, re.DOTALL)  # where the index of a ROS 1 bag lies
    return bool(header) and not 0 < int.from_bytes(header[1], 'little') < file.stat().st_size


def image_topics(reader: Any) -> dict[str, int]:
    """Number of messages of every topic that has images."""
    return {name: info.msgcount for name, info in reader.topics.items() if info.msgtype in IMAGE_TYPES and info.msgcount}


def choose(path: Path, topics: dict[str, int], wanted: Optional[str]) -> str:
    if not topics:
        raise BagError(f'{path}: has no topic of images')
    listed = ''.join(f'\n  {name}: {count} images' for name, count in topics.items())
    if wanted is None and len(topics) > 1:
        raise TopicError(f'{path}: has several topics of images; choose one with --topic:{listed}')
    if wanted is not None:
        names = [name + end for name in (wanted, '/' + wanted) for end in ('', '/compressed')]
        wanted = next((name for name in names if name in topics), wanted)
    if wanted is not None and wanted not in topics:
        raise TopicError(f"{path}: has no images of the topic '{wanted}'; those it has:{listed}")
    return wanted or next(iter(topics))


def stamp_of(message: Any) -> int:
    """[ns] of the header; 0 where nobody set it."""
    return message.header.stamp.sec * NANOSECONDS + message.header.stamp.nanosec


class Clock:
    """Times of messages, by their headers as long as these go on as the recording does.

    Where a header's clock was set anew, the later times continue those before as the recording does. Where headers have none,
    or the same again and again, they are those of the recording."""

    def __init__(self, stamps: list[int]):
        self.useful, self.offset, self.jumps = len(set(stamps)) > len(stamps) // 2 and any(stamps), 0, []
        self.last: Optional[tuple[int, int]] = None  # header and recording [ns]

    def time(self, stamp: int, received: int, number: int) -> int:
        stamp = stamp if self.useful and stamp else received
        if self.last is not None:
            step, passed = stamp - self.last[0], max(received - self.last[1], 1)
            if step < -BACK or step > passed + AHEAD:
                self.offset += passed - step
                self.jumps.append((number, step / NANOSECONDS))
        self.last = stamp, received
        return stamp + self.offset

    def notes(self) -> list[str]:
        notes = [] if self.useful else ['the headers have no times of their own: those of the recording are used']
        if self.jumps:
            number, step = self.jumps[0]
            more = f', and {len(self.jumps) - 1} time(s) more' if len(self.jumps) > 1 else ''
            notes.append(f'the clock of the headers jumps by {step:+.6g} s before image {number}{more}: images keep the order of the '
                         'recording, and times go on as it does')
        return notes


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
        return demosaiced(pixels[..., 0].astype(kind.newbyteorder('=')), encoding)
    pixels = pixels[..., CHANNELS[encoding][:3]].astype(kind.newbyteorder('='))
    return pixels[..., 0] if channels == 1 else pixels


def demosaiced(pixels: np.ndarray, encoding: str) -> np.ndarray:
    """Grey of a mosaic of colours."""
    cv2 = opencv(f'{encoding}: a mosaic of colours')
    return cv2.cvtColor(np.ascontiguousarray(pixels), getattr(cv2, BAYER[encoding]))


def mosaic_of(form: str) -> Optional[str]:
    """Encoding of a mosaic that a compressed image is, by its format: `bayer_rggb8; png compressed`, but not what was compressed
    as colours or grey, `bayer_rggb8; jpeg compressed bgr8`."""
    encoding, _, rest = form.lower().partition(';')
    last = rest.split()[-1:] or ['']
    return encoding.strip() if encoding.strip() in BAYER and not re.match('rgb|bgr|mono', last[0]) else None


def file_of(message: Any) -> tuple[str, bytes]:
    """Suffix and content of the file of an image."""
    if message.__msgtype__ == IMAGE_TYPES[0]:
        image = raw_image(message)
        return '.pgm' if image.ndim == 2 else '.ppm', pnm(image)
    data = bytes(message.data)
    for magic, suffix in MAGIC.items():
        if data.startswith(magic):
            mosaic = mosaic_of(message.format)
            return mosaic_file(data, mosaic) if mosaic else (suffix, data)
    raise BagError(f"compressed as '{message.format}'; expected JPEG, PNG, WebP or TIFF")


def mosaic_file(data: bytes, encoding: str) -> tuple[str, bytes]:
    """Suffix and content of the grey image of a compressed mosaic."""
    cv2 = opencv(f'{encoding}: a mosaic of colours')
    pixels = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if pixels is None or pixels.ndim != 2:
        raise BagError(f'{encoding}: cannot be decoded as an image of one channel')
    return '.pgm', pnm(demosaiced(pixels, encoding))


def messages_within(reader: Any, connections: list[Any], begin: float, end: float) -> Iterator[tuple[Any, int, Any]]:
    """Messages recorded from `begin` to `end` [s] after the first, MARGIN more on both sides; the first one always: times count
    from it."""
    first = next(reader.messages(connections=connections))
    start = first[1] + max(0, int((begin - MARGIN) * NANOSECONDS))
    if start > first[1]:
        yield first
    stop = None if end == math.inf else first[1] + int((end + MARGIN) * NANOSECONDS)
    yield from reader.messages(connections=connections, start=start, stop=stop)


def write_images(reader: Any, topic: str, folder: Path, begin: float, end: float) -> tuple[dict[int, str], int, list[str]]:
    """Files of the images by their times [ns], how many were left out because another one has their time, and notes."""
    files, left_out = {}, 0
    connections = [c for c in reader.connections if c.topic == topic]
    clock = Clock([stamp_of(reader.deserialize(data, connection.msgtype))
                   for connection, _, data in itertools.islice(reader.messages(connections=connections), LOOKED_AT)])
    for number, (connection, received, data) in enumerate(messages_within(reader, connections, begin, end)):
        message = reader.deserialize(data, connection.msgtype)
        time = clock.time(stamp_of(message), received, number)
        if time in files:
            left_out += 1
            continue
        try:
            suffix, content = file_of(message)
        except ValueError as error:
            raise BagError(f'{topic}, image {number}: {error}') from None
        files[time] = f'{time:020d}{suffix}'  # in the order of their times, which need not be that of the messages
        (folder / files[time]).write_bytes(content)
    return files, left_out, clock.notes()


def size_of(file: Path) -> Optional[tuple[int, int]]:
    """Width and height of a PNM, PNG or JPEG file; None of others."""
    data = file.read_bytes()
    if file.suffix in ('.pgm', '.ppm'):
        width, height = data.split(maxsplit=3)[1:3]
        return int(width), int(height)
    if file.suffix == '.png':
        return struct.unpack('>II', data[16:24])
    frame = re.search(rb'\xff[\xc0-\xc3]..\x08(....)', data, re.DOTALL) if file.suffix == '.jpg' else None
    return struct.unpack('>HH', frame[1])[::-1] if frame else None


def camera_info(reader: Any, topic: str, size: Optional[tuple[int, int]]) -> tuple[Any, str]:
    """The camera_info of a topic, and which topic has it or why there is none: the one beside it, else the only one for images of
    its size, or the one of these that shares the longest beginning with it."""
    base = base_of(topic)
    found = {}
    for connection in reader.connections:
        if connection.msgtype == CAMERA_INFO:
            message = next(reader.messages(connections=[connection]), None)
            if message:
                found[connection.topic] = reader.deserialize(message[2], connection.msgtype)
    beside = base.rpartition('/')[0] + '/camera_info'
    if beside in found:
        return found[beside], beside
    shared = {name: len(os.path.commonprefix([name.split('/'), base.split('/')]))
              for name, info in found.items() if size is None or size in sizes_of(info)}
    best = [name for name in shared if shared[name] == max(shared.values())]
    if len(best) == 1:
        return found[best[0]], best[0]
    listed = ''.join(f'\n  {name}: {info.width}x{info.height}' for name, info in found.items())
    what = f'there is no {beside}' if found else 'the bag has no camera_info'
    return None, what + (f', and not one other that is for images of {size[0]}x{size[1]}:{listed}' if found and size else '')


def numbers_of(info: Any) -> list[np.ndarray]:
    """K, D and P, which ROS 1 writes with capitals."""
    return [np.ravel(getattr(info, key, getattr(info, key.upper(), ()))) for key in 'kdp']


def region_of(info: Any) -> dict[str, int]:
    return {key: getattr(info.roi, key) for key in ('x_offset', 'y_offset', 'height', 'width')}


def camera_of(info: Any) -> tuple:
    """All of a camera_info that says where a point is seen."""
    return (info.width, info.height, info.distortion_model, *map(tuple, numbers_of(info)), info.binning_x, info.binning_y,
            region_of(info))


def changes_of(reader: Any, name: str) -> list[str]:
    """A sentence where the camera_info of a topic do not all say the same, as those of a zoom or of a region that moves."""
    connections = [connection for connection in reader.connections if connection.topic == name]
    cameras = [(received, camera_of(reader.deserialize(data, connection.msgtype)))
               for connection, received, data in reader.messages(connections=connections)]
    others = [received for received, camera in cameras if camera != cameras[0][1]]
    if not others:
        return []
    since = (others[0] - cameras[0][0]) / NANOSECONDS
    return [f'{name}: {len(others)} of {len(cameras)} messages say another camera than the first, from {since:.1f} s on; the first is '
            'used for all images']


def sizes_of(info: Any) -> list[tuple[int, int]]:
    """Sizes that images of a camera_info may have: the sensor's, its region's of interest, both with pixels added up."""
    sizes = [(info.width, info.height), (info.roi.width, info.roi.height)]
    return sizes + [(width // max(info.binning_x, 1), height // max(info.binning_y, 1)) for width, height in sizes]


def base_of(topic: str) -> str:
    return topic[:-len('/compressed')] if topic.endswith('/compressed') else topic


def write_calibration(reader: Any, topic: str, size: Optional[tuple[int, int]], file: Path) -> tuple[str, list[str]]:
    """The camera_info of a topic, as `ros2 topic echo` prints it. @return why there is none, empty where there is; notes

    Of images that were rectified (`image_rect`, `image_rect_color`) it is the camera of P, without distortion."""
    info, name = camera_info(reader, topic, size)
    if info is None:
        return name, []
    k, d, p = numbers_of(info)
    model, matrix = info.distortion_model or 'plumb_bob', 'K'
    if base_of(topic).rpartition('/')[2].startswith('image_rect'):
        k, d, model, matrix = p.reshape(3, 4)[:, :3].ravel(), (), 'none', 'P'
    if k[0] <= 0:
        return f'{name} is there, but its {matrix} is 0: nobody calibrated this camera', []
    numbers = [', '.join(f'{x:.17g}' for x in values) for values in (k, d)]
    region = ''.join(f'  {key}: {value}\n' for key, value in region_of(info).items())
    file.write_text(f'width: {info.width}\nheight: {info.height}\ndistortion_model: {model}\nd: [{numbers[1]}]\nk: [{numbers[0]}]\n'
                    f'binning_x: {info.binning_x}\nbinning_y: {info.binning_y}\nroi:\n{region}', encoding='utf-8')
    return '', changes_of(reader, name)


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
        files, left_out, notes = write_images(reader, chosen, images, begin, end)
        size = size_of(images / next(iter(files.values()))) if files else None
        why, changes = write_calibration(reader, chosen, size, folder / CALIBRATION)
    lines = [f'{files[time]} {time // NANOSECONDS}.{time % NANOSECONDS:09d}\n' for time in sorted(files)]
    (folder / TIMES).write_text(''.join(lines), encoding='utf-8')
    return Unpacked(folder, chosen, len(files), left_out, None if why else folder / CALIBRATION, why, notes + changes)
