# SPDX-License-Identifier: BSD-3-Clause
"""Bags as `rosbags` itself writes them, through `dsorb run`."""
import io
import subprocess
import sys
import unittest
from types import SimpleNamespace
from unittest import mock

import numpy as np
from dsorb import Calibration, bags
from dsorb.run_folder import alone_in
from PIL import Image
from room import FRAMES, SIZE, images, room, room_run, temporary_folder

try:
    import cv2
except ImportError:
    cv2 = None

try:
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import StoragePlugin
    from rosbags.rosbag2 import Writer as Writer2
    from rosbags.typesys import Stores, get_typestore
except ImportError:
    raise unittest.SkipTest('the package rosbags is not installed') from None

BEGIN = 1_700_000_000 * bags.NANOSECONDS
TOPIC = '/camera/image_raw'


def stamped(store, nanoseconds, ros1):
    time = store.types['builtin_interfaces/msg/Time'](sec=nanoseconds // bags.NANOSECONDS, nanosec=nanoseconds % bags.NANOSECONDS)
    return store.types['std_msgs/msg/Header'](**({'seq': 0} if ros1 else {}), stamp=time, frame_id='camera')


def message(store, image, nanoseconds=0, encoding='mono8', ros1=False):
    """sensor_msgs/Image with three bytes between rows that mean nothing."""
    rows = image.reshape(len(image), -1).view(np.uint8)
    rows = np.hstack([rows, np.full((len(rows), 3), 77, np.uint8)])
    return store.types[bags.IMAGE_TYPES[0]](header=stamped(store, nanoseconds, ros1), height=image.shape[0], width=image.shape[1],
                                            encoding=encoding, is_bigendian=0, step=rows.shape[1], data=rows.ravel())


def compressed(store, image, nanoseconds, kind, ros1=False):
    file = io.BytesIO()
    Image.fromarray(image).save(file, kind)
    return store.types[bags.IMAGE_TYPES[1]](header=stamped(store, nanoseconds, ros1), format=kind,
                                            data=np.frombuffer(file.getvalue(), np.uint8))


def camera_info(store, ros1, focal=200, size=SIZE, region=(0, 0, 0, 0), binning=0):
    """@param region x_offset, y_offset, height, width"""
    class_of = store.types
    k = np.array([focal, 0, 159.5, 0, focal, 119.5, 0, 0, 1.])
    values = {'d': np.zeros(5), 'k': k, 'r': np.eye(3).ravel(), 'p': np.zeros(12)}
    region = class_of['sensor_msgs/msg/RegionOfInterest'](*region, do_rectify=False)
    return class_of[bags.CAMERA_INFO](header=stamped(store, BEGIN, ros1), height=size[1], width=size[0], distortion_model='plumb_bob',
                                      binning_x=binning, binning_y=binning, roi=region,
                                      **{key.upper() if ros1 else key: value for key, value in values.items()})


def write(path, topics, ros1=False, storage='MCAP'):
    """A bag of topics, each a list of (time of recording [ns], message)."""
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    with Writer1(path) if ros1 else Writer2(path, version=9, storage_plugin=StoragePlugin[storage]) as writer:
        for topic, messages in topics.items():
            connection = writer.add_connection(topic, messages[0][1].__msgtype__, typestore=store)
            for time, content in messages:
                serialize = store.serialize_ros1 if ros1 else store.serialize_cdr
                writer.write(connection, time, bytes(serialize(content, content.__msgtype__)))
    return path


def room_bag(path, ros1=False, storage='MCAP', info=True, frames=FRAMES):
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    times = [BEGIN + round(float(line.split()[1]) * bags.NANOSECONDS) for line in (room() / 'times.txt').read_text().splitlines()]
    topics = {TOPIC: [(time + 5000, message(store, image, time, ros1=ros1)) for time, image in zip(times, images()[:frames])]}
    if info:
        topics['/camera/camera_info'] = [(BEGIN, camera_info(store, ros1))]
    return write(path, topics, ros1, storage)


def dsorb(*words, **options):
    return subprocess.run([sys.executable, '-m', 'dsorb.command_line', *map(str, words)], capture_output=True, text=True,
                          check=False, **options)


class Runs(unittest.TestCase):
    def check(self, bag, *words):
        output = temporary_folder() / 'out'
        done = dsorb('run', bag, '--output', output, *words)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn(f'{TOPIC}: {FRAMES} images', done.stdout)
        found, expected = (np.loadtxt(folder / 'trajectory.txt') for folder in (output, room_run()))
        np.testing.assert_allclose(found[:, 0] - BEGIN / bags.NANOSECONDS, expected[:, 0], atol=1e-5)
        np.testing.assert_allclose(found[:, 1:], expected[:, 1:], atol=1e-3)  # times of this size are told to 2e-7 s
        return done

    def test_ros1(self):
        self.assertIn('calibration from camera_info', self.check(room_bag(temporary_folder() / 'room.bag', ros1=True)).stdout)

    def test_mcap_as_a_folder_and_as_a_file(self):
        bag = room_bag(temporary_folder() / 'room')
        self.assertIn('calibration from camera_info', self.check(bag, '--topic', TOPIC).stdout)
        self.check(next(bag.glob('*.mcap')))

    def test_sqlite_with_a_calibration_of_ones_own(self):
        bag = room_bag(temporary_folder() / 'room', storage='SQLITE3', info=False)
        self.assertNotIn('camera_info', self.check(bag, '--calib', room() / 'camera.txt').stdout)

    def test_a_second_run_replaces_what_the_first_unpacked(self):
        folder = temporary_folder()
        for name, frames in (('long', 6), ('short', 3)):
            dsorb('run', room_bag(folder / name, frames=frames), '--output', folder / 'out')
            self.assertEqual(len(list((folder / 'out/bag_images/images').iterdir())), frames)
        self.assertEqual(dsorb('run', folder / 'long', '--output', folder / 'out', '--evry', '2').returncode, 2)
        self.assertEqual(len(list((folder / 'out/bag_images/images').iterdir())), 3)
        with alone_in(folder / 'out'):
            self.assertIn('another run writes into it', dsorb('run', folder / 'long', '--output', folder / 'out').stderr)
        self.assertEqual(len(list((folder / 'out/bag_images/images').iterdir())), 3)
        (folder / 'out/bag_images/notes.txt').touch()
        with self.assertRaisesRegex(bags.BagError, 'holds notes.txt'):
            bags.unpack(folder / 'short', None, folder / 'out/bag_images')


class Calibrations(unittest.TestCase):
    def test_rectified_images_have_the_camera_of_p_without_distortion(self):
        region = SimpleNamespace(x_offset=0, y_offset=0, height=0, width=0)
        camera = SimpleNamespace(width=320, height=240, distortion_model='plumb_bob', binning_x=0, binning_y=0, roi=region,
                                 k=[200, 0, 160, 0, 200, 120, 0, 0, 1],
                                 d=[-.3, .1, 0, 0, 0], p=[180, 0, 150, 0, 0, 180, 110, 0, 0, 0, 1, 0])
        reader = SimpleNamespace(connections=[SimpleNamespace(topic='/camera/camera_info', msgtype=bags.CAMERA_INFO)],
                                 messages=lambda connections: iter([(connections[0], 0, camera)]), deserialize=lambda data, _: data)
        file = temporary_folder() / 'calibration.yaml'
        for topic, focal, k1 in (('image_raw', 200, '-0.2'), ('image_rect', 180, ']'), ('image_rect_color/compressed', 180, ']')):
            bags.write_calibration(reader, f'/camera/{topic}', SIZE, file)
            self.assertIn(f'k: [{focal}, 0, ', file.read_text())
            self.assertIn(f'd: [{k1}', file.read_text())

    def test_region_and_binning_cut_the_calibration(self):
        store = get_typestore(Stores.ROS2_HUMBLE)
        info = camera_info(store, False, region=(60, 40, 120, 160), binning=2)
        reader = SimpleNamespace(connections=[SimpleNamespace(topic='/camera/camera_info', msgtype=bags.CAMERA_INFO)],
                                 messages=lambda connections: iter([(connections[0], 0, info)]), deserialize=lambda data, _: data)
        file = temporary_folder() / 'info.yaml'
        bags.write_calibration(reader, '/camera/image_raw', (80, 60), file)
        found = Calibration.read(file)
        self.assertEqual((found.width, found.height, found.fx, found.cx, found.cy), (80, 60, 100, 49.5, 39.5))
        with self.assertRaisesRegex(ValueError, 'by its roi and binning'):
            found.for_size(320, 240)

    def found(self, topics, topic='/device/Color_0/image/data'):
        """Content of the calibration, and why there is none."""
        store = get_typestore(Stores.ROS2_HUMBLE)
        bag = write(temporary_folder() / 'bag', {topic: [(BEGIN, message(store, images()[0]))],
                                                 **{name: [(BEGIN, camera_info(store, False, **how))] for name, how in topics.items()}})
        unpacked = bags.unpack(bag, None, temporary_folder() / 'bag_images')
        return unpacked.calibration and unpacked.calibration.read_text(), unpacked.no_calibration

    def test_the_one_camera_info_of_that_size_is_found(self):
        text, _ = self.found({'/device/Color_0/info/camera_info': {'focal': 210}})
        self.assertIn('k: [210, 0, ', text)
        text, _ = self.found({'/device/Color_0/info': {'focal': 210}, '/device/Infrared_1/info': {'focal': 220}})
        self.assertIn('k: [210, 0, ', text)
        text, _ = self.found({'/left/info': {'focal': 210}, '/right/info': {'focal': 220, 'size': (640, 480)}})
        self.assertIn('k: [210, 0, ', text)

    def test_a_calibration_that_changes_is_told(self):
        store = get_typestore(Stores.ROS2_HUMBLE)
        infos = [(BEGIN + k * bags.NANOSECONDS // 10, camera_info(store, False, focal=200 + 10 * (k >= 20))) for k in range(30)]
        bag = write(temporary_folder() / 'bag', {TOPIC: [(BEGIN, message(store, images()[0]))], '/camera/camera_info': infos})
        unpacked = bags.unpack(bag, None, temporary_folder() / 'bag_images')
        self.assertIn('k: [200, 0, ', unpacked.calibration.read_text())
        self.assertIn('/camera/camera_info: 10 of 30 messages say another camera than the first, from 2.0 s on; the first is used for '
                      'all images', unpacked.notes)

    def test_why_there_is_no_calibration(self):
        for topics, why in (({}, 'the bag has no camera_info'),
                            ({'/left/info': {}, '/right/info': {}}, 'not one other that is for images of 320x240:\n  /left/info: 320x240'),
                            ({'/device/Color_0/image/camera_info': {'focal': 0}}, 'its K is 0: nobody calibrated')):
            text, told = self.found(topics)
            self.assertIsNone(text)
            self.assertIn(why, told)
        done = dsorb('run', room_bag(temporary_folder() / 'bag', info=False, frames=3), cwd=temporary_folder())
        self.assertEqual(done.returncode, 3)  # of three images nothing starts
        self.assertIn('no camera_info; the camera is found out', done.stderr)


class Clocks(unittest.TestCase):
    def times(self, stamps, received):
        clock = bags.Clock(stamps[:bags.LOOKED_AT])
        return [clock.time(*pair, number) for number, pair in enumerate(zip(stamps, received))], clock.notes()

    def test_a_clock_that_was_set_anew_goes_on_as_the_recording(self):
        tenth, received = bags.NANOSECONDS // 10, [BEGIN + i * bags.NANOSECONDS // 10 for i in range(20)]
        for jump in (-1_600_000_000 * bags.NANOSECONDS, -bags.NANOSECONDS, 1_600_000_000 * bags.NANOSECONDS):
            times, notes = self.times([BEGIN + i * tenth + (jump if i >= 12 else 0) for i in range(20)], received)
            self.assertEqual(times, received)
            self.assertRegex(notes[0], 'before image 12: images keep the order')

    def test_messages_in_another_order_are_none(self):
        stamps = [BEGIN, BEGIN + 200_000_000, BEGIN + 100_000_000, BEGIN + 300_000_000]
        self.assertEqual(self.times(stamps, [BEGIN + 9 * i for i in range(4)]), (stamps, []))

    def test_headers_without_times(self):
        received = [BEGIN + i * 10**8 for i in range(20)]
        for stamp in (0, 77):
            times, notes = self.times([stamp] * 20, received)
            self.assertEqual(times, received)
            self.assertIn('no times of their own', notes[0])


class Mosaics(unittest.TestCase):
    def test_formats_that_name_one(self):
        for form, mosaic in (('bayer_rggb8; png compressed ', 'bayer_rggb8'), ('bayer_gbrg16; png compressed bayer_gbrg16', 'bayer_gbrg16'),
                             ('bayer_rggb8; jpeg compressed bgr8', None), ('mono8; png compressed', None), ('png', None)):
            self.assertEqual(bags.mosaic_of(form), mosaic, form)

    @unittest.skipUnless(cv2, "OpenCV's Python module is not installed")
    def test_a_compressed_mosaic_becomes_grey(self):
        store = get_typestore(Stores.ROS2_HUMBLE)
        mosaic = np.full((24, 32), 100, np.uint8)
        mosaic[::2, ::2] = 60  # red
        compressed_one = compressed(store, mosaic, 0, 'png')
        compressed_one.format = 'bayer_rggb8; png compressed '
        suffix, content = bags.file_of(compressed_one)
        grey = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
        self.assertEqual(suffix, '.pgm')
        self.assertLessEqual(np.abs(grey[4:-4, 4:-4].astype(int) - round(100 - 40 * .299)).max(), 1)


class Refusals(unittest.TestCase):
    def test_a_recording_without_its_end(self):
        folder = temporary_folder()
        bag = next(room_bag(folder / 'room', frames=5).glob('*.mcap'))
        (folder / 'killed.mcap').write_bytes(bag.read_bytes()[:-2000])
        done = dsorb('run', folder / 'killed.mcap', cwd=folder)
        self.assertEqual(done.returncode, 1)
        self.assertRegex(done.stderr, r'killed.mcap: ends in the middle, .*`mcap recover ')

    def test_files_of_a_bag_without_its_metadata_are_read(self):
        folder = temporary_folder()
        bag = room_bag(folder / 'room', frames=3)
        (bag / 'metadata.yaml').unlink()
        self.assertTrue(bags.is_bag(bag))
        self.assertEqual(bags.unpack(bag, None, folder / 'out').images, 3)

    def test_a_topic_is_found_without_how_it_is_compressed(self):
        store = get_typestore(Stores.ROS2_HUMBLE)
        picture = compressed(store, images()[0], BEGIN, 'png')
        bag = write(temporary_folder() / 'bag', {'/left/compressed': [(BEGIN, picture)], '/right/compressed': [(BEGIN, picture)]})
        for topic in ('/left', 'left', '/left/compressed'):
            self.assertEqual(bags.unpack(bag, topic, temporary_folder() / 'out').topic, '/left/compressed')

    def test_topics_are_listed(self):
        store = get_typestore(Stores.ROS2_HUMBLE)
        picture = [(BEGIN, message(store, images()[0]))]
        bag = write(temporary_folder() / 'two', {'/left': picture, '/right': picture * 2, '/info': [(BEGIN, camera_info(store, False))]})
        for words, text in (((), 'has several topics of images; choose one'), (('--topic', '/info'), "no images of the topic '/info'")):
            done = dsorb('run', bag, *words, cwd=temporary_folder())
            self.assertEqual(done.returncode, 2, done.stderr)
            self.assertIn(text, done.stderr)
            self.assertIn('/left: 1 images\n  /right: 2 images', done.stderr)
            self.assertNotIn('/info:', done.stderr)

    def test_a_bag_without_images(self):
        bag = write(temporary_folder() / 'none', {'/info': [(BEGIN, camera_info(get_typestore(Stores.ROS2_HUMBLE), False))]})
        done = dsorb('run', bag, cwd=temporary_folder())
        self.assertEqual((done.returncode, 'has no topic of images' in done.stderr), (1, True), done.stderr)

    def test_damaged_bags(self):
        for bag, ros1 in ((room_bag(temporary_folder() / 'room.bag', ros1=True, frames=5), True),
                          (next(room_bag(temporary_folder() / 'room', frames=5).glob('*.mcap')), False)):
            data = bag.read_bytes()
            for part in (data[:len(data) // 2], b'', b'x' * 1000):
                bag.write_bytes(part)
                done = dsorb('run', bag, '--hfov', 77, cwd=temporary_folder())
                self.assertEqual(done.returncode, 1, (ros1, len(part), done.stderr))
                self.assertIn(bag.name, done.stderr)
                self.assertNotIn('Traceback', done.stderr)

    def test_a_topic_of_something_else(self):
        done = dsorb('run', room(), '--topic', '/left', cwd=temporary_folder())
        self.assertEqual((done.returncode, 'is no bag' in done.stderr), (2, True), done.stderr)

    def test_the_missing_package_is_named(self):
        with mock.patch.dict(sys.modules, {'rosbags': None, 'rosbags.highlevel': None}):
            with self.assertRaisesRegex(bags.BagError, 'pip install rosbags'):
                bags.unpack(room_bag(temporary_folder() / 'room', frames=1), None, temporary_folder())


class Encodings(unittest.TestCase):
    def unpacked(self, messages):
        folder = temporary_folder()
        found = bags.unpack(write(folder / 'bag', {'/x': [(BEGIN + i, m) for i, m in enumerate(messages)]}), None, folder / 'out')
        return found, [np.asarray(Image.open(file)) for file in sorted((folder / 'out/images').iterdir())]

    def test_pixels_arrive(self):
        store, grey = get_typestore(Stores.ROS2_HUMBLE), images()[0]
        colour = np.dstack([grey, grey // 2, 255 - grey])
        alpha = np.dstack([colour, grey])
        deep = grey.astype(np.uint16) * 257
        luma = np.dstack([grey, np.full_like(grey, 128)])
        for image, encoding, expected in ((grey, 'mono8', grey), (colour, 'rgb8', colour), (colour, 'bgr8', colour[..., ::-1]),
                                          (alpha, 'bgra8', colour[..., ::-1]), (deep, 'mono16', deep), (luma, 'yuv422_yuy2', grey),
                                          (luma[..., ::-1].copy(), 'uyvy', grey)):
            with self.subTest(encoding):
                np.testing.assert_array_equal(self.unpacked([message(store, image, 1, encoding)])[1][0], expected)

    def test_mosaics(self):
        try:
            import cv2  # noqa: F401
        except ImportError:
            self.skipTest("OpenCV's Python module is not installed")
        store, red = get_typestore(Stores.ROS2_HUMBLE), np.zeros(SIZE[::-1], np.uint8)
        for place, encoding in (((0, 0), 'bayer_rggb8'), ((1, 1), 'bayer_bggr8'), ((1, 0), 'bayer_gbrg8'), ((0, 1), 'bayer_grbg8')):
            red[:] = 0
            red[place[0]::2, place[1]::2] = 200
            found = self.unpacked([message(store, red, 1, encoding)])[1][0]
            self.assertAlmostEqual(float(found[100:110, 100:110].mean()), 0.299 * 200, delta=1, msg=encoding)

    def test_compressed_ones_stay_as_they_are(self):
        store = get_typestore(Stores.ROS2_HUMBLE)
        found, pictures = self.unpacked([compressed(store, image, BEGIN + i, kind) for i, (image, kind)
                                         in enumerate(zip(images(), ('PNG', 'JPEG')))])
        self.assertEqual(sorted(f.suffix for f in (found.folder / 'images').iterdir()), ['.jpg', '.png'])
        np.testing.assert_array_equal(pictures[0], images()[0])
        with self.assertRaisesRegex(bags.BagError, "/x, image 0: compressed as 'GIF'"):
            self.unpacked([compressed(store, images()[0], BEGIN, 'GIF')])

    def test_only_what_is_asked_for_is_unpacked(self):
        store = get_typestore(Stores.ROS2_HUMBLE)
        image, step = images()[0], bags.NANOSECONDS // 2
        bag = write(temporary_folder() / 'bag', {'/x': [(BEGIN + i * step + 5000, message(store, image, BEGIN + i * step)) for i in range(40)]})
        everything = bags.unpack(bag, None, temporary_folder() / 'all')
        self.assertEqual(everything.images, 40)
        part = bags.unpack(bag, None, temporary_folder() / 'part', 10, 12)
        times = [float(line.split()[1]) - BEGIN / bags.NANOSECONDS for line in (part.folder / 'times.txt').read_text().splitlines()]
        self.assertEqual(times, [0] + [8 + i / 2 for i in range(12)])  # the first, and two seconds on both sides, the end excluded

    def test_times_out_of_order_repeated_and_unset(self):
        store = get_typestore(Stores.ROS2_HUMBLE)
        found, pictures = self.unpacked([message(store, image, time) for image, time in zip(images(), (BEGIN + 9, BEGIN + 5, BEGIN + 5, 0))])
        self.assertEqual((found.images, found.left_out), (3, 1))
        for picture, index in zip(pictures, (3, 1, 0)):  # the one without a time was recorded at BEGIN + 3
            np.testing.assert_array_equal(picture, images()[index])
        times = [line.split()[1] for line in (found.folder / 'times.txt').read_text().splitlines()]
        self.assertEqual(times, ['1700000000.000000003', '1700000000.000000005', '1700000000.000000009'])

    def test_what_does_not_fit_is_told(self):
        store = get_typestore(Stores.ROS2_HUMBLE)
        for change, text in (({'encoding': 'h264'}, "encoding 'h264'"), ({'height': SIZE[1] + 1}, 'expected 241 rows'),
                             ({'step': 10}, 'rows of 10')):
            broken = message(store, images()[0], BEGIN)
            for key, value in change.items():
                object.__setattr__(broken, key, value)
            with self.assertRaisesRegex(bags.BagError, f'/x, image 0: .*{text}'):
                self.unpacked([broken])


if __name__ == '__main__':
    unittest.main()
