# SPDX-License-Identifier: BSD-3-Clause
"""Exported files against the truth of the room: a point that its host sees at a pixel is projected into the other
images with what stands in the files alone, and has to land where exact depth and poses say."""
import json
import math
import shutil
import subprocess
import unittest
import zipfile
from dataclasses import replace

import dsorb
import numpy as np
from dsorb.command_line import program
from dsorb.export import export, model_of
from dsorb.pictures import Video, calibration_of, decoded_file, find_pictures, rectifying_maps, refined_lens
from dsorb.run_folder import FORMATS, read_run, remove_exports, rotation_of
from PIL import Image
from room import FRAMES, SIZE, image_files, room, room_run, temporary_folder, true_correspondences, true_poses

try:
    import pycolmap
except ImportError:
    pycolmap = None
try:
    import cv2
except ImportError:
    cv2 = None

CAMERA = dsorb.Camera(200, 200, 159.5, 119.5, *SIZE)
HALF = 0.5  # from our pixels to those of COLMAP and nerfstudio
MOST_PIXELS = 0.35  # median over the points of a pair of images; measured 0.253 for the worst pair
LENSES = {'pinhole': [], 'fov': [0.9], 'radtan': [-0.28, 0.07, 2e-4, -1e-4, 0.0], 'equidistant': [0.01, -0.02, 0.003, 1e-3]}


def exported(*formats, **options):
    folder = temporary_folder() / 'out'
    shutil.copytree(room_run(), folder)
    export(folder, formats, **options)
    return folder


def far_apart(indices):
    """Pairs of images of a model: the first with every other."""
    return [(indices[0], other) for other in indices[1:]]


def pixels_in_run(index, points):
    """Pixels of points by what the output folder says, in our convention: independent of what an export adds."""
    run = read_run(room_run())
    frame = next(f for f in run.segments[0].frames if f.index == index)
    camera = (points - frame.position) @ rotation_of(frame.quaternion)
    return camera[:, :2] / camera[:, 2:] * [CAMERA.fx, CAMERA.fy] + [CAMERA.cx, CAMERA.cy]


class Truth(unittest.TestCase):
    most_pixels = MOST_PIXELS

    def check(self, hosts, points, project):
        """hosts: image index -> pixels (ours) of its points, rows of `points`; project(image index, (n, 3))."""
        indices, worst = sorted(hosts), 0
        for index in indices:
            pixels, rows = hosts[index]
            ours = pixels_in_run(index, points[rows])
            distance = np.abs(pixels - ours).max(1)
            self.assertLess(distance.max(initial=0), 6)  # corners as other keyframes see them; measured 2
            np.testing.assert_allclose(project(index, points[rows]), ours, atol=1e-3)
        for first, second in far_apart(indices):
            rows = hosts[first][1]
            expected = true_correspondences(first, second, CAMERA, pixels_in_run(first, points[rows]))
            # A point of a pixel between two surfaces has the depth of either: the median is that of the others.
            error = np.linalg.norm(project(second, points[rows]) - expected, axis=1)
            worst = max(worst, np.nanmedian(error))
        self.assertGreater(len(indices), 3)
        self.assertLess(worst, self.most_pixels)


def read_colmap_text(folder):
    """Camera parameters, {index: (name, quaternion w x y z, translation, pixels, rows)}, points."""
    words = (folder / 'cameras.txt').read_text().split()
    points, order = [], {}
    for line in (folder / 'points3D.txt').read_text().splitlines():
        numbers = line.split()
        order[int(numbers[0])] = len(points)
        points.append([float(x) for x in numbers[1:4]])
    lines, images = (folder / 'images.txt').read_text().splitlines(), {}
    for head, body in zip(lines[::2], lines[1::2]):
        numbers, seen = head.split(), np.array(body.split(), float).reshape(-1, 3)
        index = [f.name for f in image_files()].index(numbers[9])
        images[index] = (np.array(numbers[1:5], float), np.array(numbers[5:8], float), seen[:, :2],
                         np.array([order[int(p)] for p in seen[:, 2]], int))
    return words[1], np.array(words[4:], float), images, np.array(points)


class Colmap(Truth):
    most_pixels = 2  # of corners; measured 1.0

    @classmethod
    def setUpClass(cls):
        cls.folder = exported('colmap')

    def test_text_meets_the_images(self):
        model, (fx, fy, cx, cy), images, points = read_colmap_text(self.folder / 'colmap/sparse/0')
        self.assertEqual(model, 'PINHOLE')

        def project(index, world):
            (w, x, y, z), translation = images[index][:2]
            camera = world @ rotation_of([x, y, z, w]).T + translation
            return camera[:, :2] / camera[:, 2:] * [fx, fy] + [cx, cy] - HALF

        self.check({index: (image[2] - HALF, image[3]) for index, image in images.items()}, points, project)

    @unittest.skipUnless(pycolmap, 'pycolmap is not installed')
    def test_pycolmap_reads_both_forms_and_meets_the_images(self):
        for read in ('read_text', 'read_binary'):
            model = pycolmap.Reconstruction()
            getattr(model, read)(str(self.folder / 'colmap/sparse/0'))
            names = [f.name for f in image_files()]
            images = {names.index(image.name): image for image in model.images.values()}
            order = {number: row for row, number in enumerate(model.points3D)}
            points = np.array([model.points3D[number].xyz for number in order])
            hosts = {index: (np.array([p.xy for p in image.points2D]).reshape(-1, 2) - HALF,
                             np.array([order[p.point3D_id] for p in image.points2D], int)) for index, image in images.items()}
            self.check(hosts, points, lambda index, world: np.array(
                [images[index].project_point(p) for p in world]).reshape(-1, 2) - HALF)  # pylint: disable=cell-var-from-loop

    @unittest.skipUnless(pycolmap, 'pycolmap is not installed')
    def test_pycolmap_adjusts_the_model_as_it_is(self):
        model = pycolmap.Reconstruction(str(self.folder / 'colmap/sparse/0'))
        lengths = np.array([point.track.length() for point in model.points3D.values()])
        self.assertGreater((lengths == 0).sum(), 100)  # points of the map
        self.assertGreater((lengths > 1).sum(), 100)  # corners
        self.assertFalse((lengths == 1).any())
        model.update_point_3d_errors()
        before = model.compute_mean_reprojection_error()
        pycolmap.bundle_adjustment(model)
        model.update_point_3d_errors()
        self.assertLess(model.compute_mean_reprojection_error(), before)

    def test_images_lie_beside_the_model(self):
        for name in (self.folder / 'colmap/sparse/0/images.txt').read_text().split('\n')[::2]:
            if name:
                self.assertTrue((self.folder / 'colmap/images' / name.split()[9]).is_file())

    @unittest.skipUnless(pycolmap, 'pycolmap is not installed')
    def test_lenses_are_those_of_colmap(self):
        from dsorb.colmap import camera_of
        rays = np.random.default_rng(1).uniform([-0.7, -0.5, 1], [0.7, 0.5, 1], (50, 3))
        for model, coefficients in LENSES.items():
            for k3 in (0.0, 0.02) if model == 'radtan' else (None,):
                lens = dict(model=model, fx=300.0, fy=310.0, cx=320.2, cy=239.1, width=640, height=480,
                            coefficients=coefficients[:4] + [k3] if model == 'radtan' else coefficients)
                name, _, parameters = camera_of(lens)
                camera = pycolmap.Camera(model=name, width=640, height=480, params=parameters)
                theirs = np.array([camera.img_from_cam(ray) for ray in rays])
                np.testing.assert_allclose(calibration_of(lens).project(rays) + HALF, theirs, atol=1e-6, err_msg=name)


def path_error(run):
    """Largest distance of keyframes from the truth after the best similarity, of the path's length."""
    frames, truth = run, true_poses()[[f.index for f in run], :3, 3]
    found = np.array([f.position for f in frames])
    a, b = found - found.mean(0), truth - truth.mean(0)
    u, s, v = np.linalg.svd(b.T @ a)
    rotation = u @ np.diag([1, 1, np.linalg.det(u @ v)]) @ v
    scale = (s * [1, 1, np.linalg.det(u @ v)]).sum() / (a**2).sum()
    return np.linalg.norm(scale * a @ rotation.T - b, axis=1).max() / np.linalg.norm(np.diff(truth, axis=0), axis=1).sum()


@unittest.skipUnless(pycolmap and int(pycolmap.__version__.split('.')[0]) >= 4, 'pycolmap 4 is not installed')
class Refinement(unittest.TestCase):
    def test_colmap_moves_the_poses_little_and_meets_the_truth(self):
        folder = temporary_folder() / 'out'
        shutil.copytree(room_run(), folder)
        notes = export(folder, ['colmap', 'nerfstudio'], refine='poses')
        self.assertRegex(notes[0], r'\d+ poses moved by 0\.\d\d% of their path .* focal length by \+0\.00 %')
        model = pycolmap.Reconstruction(str(folder / 'colmap/sparse/0'))
        names = [f.name for f in image_files()]
        centres = {names.index(i.name): i.projection_center() for i in model.images.values()}
        keyframes = [f for f in read_run(folder).segments[0].frames if f.is_keyframe]
        data = json.loads((folder / 'nerfstudio/transforms.json').read_text())
        for frame, written in zip(keyframes, data['frames']):
            np.testing.assert_allclose(np.array(written['transform_matrix'])[:3, 3], centres[frame.index], atol=1e-9)
            frame.position = centres[frame.index]
        self.assertLess(path_error(keyframes), 0.006)  # measured 0.0021; ours have 0.0006
        self.assertEqual(data['fl_x'], CAMERA.fx)

    def test_a_focal_length_that_was_guessed_is_found(self):
        for guess in (1.1, 0.9):
            folder = temporary_folder() / 'out'
            view = 2 * math.degrees(math.atan(SIZE[0] / 2 / (guess * CAMERA.fx)))
            subprocess.run([program(), room(), '--hfov', str(view), '--output', folder, '--quiet'], check=True)
            export(folder, ['nerfstudio'], refine='focal')
            found = json.loads((folder / 'nerfstudio/transforms.json').read_text())
            self.assertLess(abs(found['fl_x'] / CAMERA.fx - 1), 0.02)  # measured 0.007 and 0.005
            self.assertLess(abs(found['fl_y'] / CAMERA.fy - 1), 0.03)  # measured 0.018 and 0.015

    def test_a_segment_with_too_little_to_adjust_stays_as_it_was(self):
        run = read_run(room_run())
        whole = run.segments[0]
        short = replace(whole, number=1, frames=[f for f in whole.frames if f.is_keyframe][:2])
        run.segments.append(short)
        notes = []
        models = [model_of(run, segment, find_pictures(run, {f.index for f in whole.frames}), False, 'poses', notes)
                  for segment in run.segments]
        self.assertIsNotNone(models[0].refined)
        self.assertIsNone(models[1].refined)
        self.assertRegex(notes[-1], r'COLMAP .*; segment 1 stays as it was')

    def test_it_says_what_it_needs(self):
        with self.assertRaisesRegex(ValueError, 'colmap, nerfstudio'):
            export(room_run(), ['tum'], refine='poses')


class Nerfstudio(Truth):
    def test_transforms_meet_the_images(self):
        folder = exported('nerfstudio')
        data = json.loads((folder / 'nerfstudio/transforms.json').read_text())
        names = [f.resolve() for f in image_files()]
        poses = {names.index((folder / 'nerfstudio' / frame['file_path']).resolve()): np.array(frame['transform_matrix'])
                 for frame in data['frames']}

        def project(index, world):  # x right, y up, looking along -z; the image begins at its corner
            camera = (world - poses[index][:3, 3]) @ poses[index][:3, :3]
            u = data['cx'] + data['fl_x'] * camera[:, 0] / -camera[:, 2]
            v = data['cy'] - data['fl_y'] * camera[:, 1] / -camera[:, 2]
            return np.stack([u, v], 1) - HALF

        points = read_run(folder).segments[0].points
        hosts = {}
        for index in poses:
            rows = np.flatnonzero(points.keyframes == index)
            hosts[index] = project(index, points.positions[rows]), rows
        self.check(hosts, points.positions, project)
        self.assertEqual((data['w'], data['h'], data['camera_model']), (*SIZE, 'OPENCV'))

    def test_it_has_no_fov_lens(self):
        from dsorb.export import nerfstudio_lens
        with self.assertRaisesRegex(ValueError, '--undistort'):
            nerfstudio_lens(dict(model='fov'))


class Trajectories(unittest.TestCase):
    def test_all_forms_have_the_same_poses(self):
        folder = exported('tum', 'kitti', 'euroc')
        frames = read_run(folder).segments[0].frames
        self.assertEqual(len(frames), FRAMES)
        tum = np.loadtxt(folder / 'tum/trajectory.txt')
        kitti = np.loadtxt(folder / 'kitti/poses.txt').reshape(-1, 3, 4)
        euroc = np.loadtxt(folder / 'euroc/trajectory.csv', delimiter=',')
        self.assertEqual((folder / 'tum/trajectory.txt').read_text(), (folder / 'trajectory.txt').read_text())
        np.testing.assert_allclose(kitti, np.loadtxt(folder / 'trajectory_kitti.txt').reshape(-1, 3, 4), atol=3e-9)
        np.testing.assert_array_equal(euroc[:, [1, 2, 3, 5, 6, 7, 4]], tum[:, 1:])
        np.testing.assert_allclose(euroc[:, 0] * 1e-9, tum[:, 0])
        names = [line.split()[-1] for line in (folder / 'tum/images.txt').read_text().splitlines()]
        self.assertEqual(names, [str(f) for f in image_files()])


class Pictures(unittest.TestCase):
    @unittest.skipUnless(cv2, "OpenCV's Python module is not installed")
    def test_undistorted_images_of_a_pinhole_are_the_images(self):
        folder = exported('colmap', undistort=True)
        written = sorted((folder / 'images').iterdir())
        self.assertEqual(len(written), json.loads((folder / 'run.json').read_text())['keyframes'])
        image = cv2.imread(str(written[-1]), cv2.IMREAD_GRAYSCALE).astype(float)
        original = cv2.imread(str(image_files()[int(written[-1].stem)]), cv2.IMREAD_GRAYSCALE)
        self.assertLess(np.abs(image - original).mean(), 2)  # grey levels, of JPEG; measured 0.94

    @unittest.skipUnless(cv2, "OpenCV's Python module is not installed")
    def test_portrait_videos_are_upright(self):
        file = temporary_folder() / 'phone.mp4'
        video = cv2.VideoWriter(str(file), cv2.VideoWriter_fourcc(*'mp4v'), 10, (96, 64))
        image = np.full((64, 96, 3), 40, np.uint8)
        image[:, :48] = 200  # left: the top once it is upright
        video.write(image)
        video.release()
        data = file.read_bytes()
        header = data.index(b'tkhd')  # whose transformation matrix turns the picture clockwise, as phones do
        unity, turned = (np.array(m, '>i4').tobytes() for m in ([65536, 0, 0, 0, 65536], [0, 65536, 0, -65536, 0]))
        file.write_bytes(data[:header] + data[header:].replace(unity, turned, 1))
        with Video(file) as video:
            upright, turn = video.image(0)
            self.assertIsNone(video.image(1))
        self.assertEqual((upright.shape, turn), ((96, 64, 3), 90))
        self.assertLess(abs(int(upright[10, 32, 0]) - 200), 10)  # of a lossy codec
        self.assertLess(abs(int(upright[85, 32, 0]) - 40), 10)

    def test_a_refined_camera_is_the_lens_of_the_images_or_of_undistorted_ones(self):
        lens = dict(model='pinhole', fx=400.0, fy=400.0, cx=319.5, cy=239.5, width=640, height=480, coefficients=[])
        camera = dict(fx=200.0, fy=200.0, cx=159.5, cy=119.5, width=320, height=240)  # at half the size
        refined = dict(camera, fx=190.0, fy=188.0, cx=161.5, k1=-0.2)
        found = refined_lens(lens, camera, refined)
        self.assertEqual((found['model'], found['coefficients']), ('radtan', [-0.2, 0, 0, 0, 0]))
        self.assertEqual((found['fx'], found['fy'], found['cx'], found['cy']), (380, 376, 323.5, 239.5))
        # A ray in the undistorted images shows what the lens shows of it.
        x, y = rectifying_maps(lens, camera, refined)
        ray = [(20 - refined['cx']) / refined['fx'], (200 - refined['cy']) / refined['fy'], 1]
        np.testing.assert_allclose([x[200, 20], y[200, 20]], calibration_of(found).project(np.array([ray]))[0], atol=1e-4)
        straight = refined_lens(lens, camera, dict(refined, k1=0))
        self.assertEqual((straight['model'], straight['coefficients']), ('pinhole', []))

    @unittest.skipUnless(cv2, "OpenCV's Python module is not installed")
    def test_colours_are_those_of_the_images(self):
        folder = exported('ply')
        points = read_run(folder).segments[0].points
        data = (folder / 'ply/points.ply').read_bytes()
        body = np.frombuffer(data[data.index(b'end_header\n') + 11:], np.dtype([('p', '<f4', 3), ('c', 'u1', 3)]))
        self.assertGreaterEqual(len(body), len(points.positions))  # corners of several keyframes stand behind
        body = body[:len(points.positions)]
        np.testing.assert_allclose(body['p'], points.positions, rtol=1e-6)
        # Images of the room are grey: colour is the grey level of the host, which the map keeps as well.
        difference = np.abs(body['c'].astype(int) - points.colours)
        self.assertLess(np.percentile(difference, 95), 3)  # measured 0

    @unittest.skipUnless(cv2, "OpenCV's Python module is not installed")
    def test_images_are_not_turned_as_the_program_does_not_turn_them(self):
        file = temporary_folder() / 'turned.jpg'
        exif = Image.Exif()
        exif[0x0112] = 6  # Orientation: to be turned by 90 degrees
        with Image.open(image_files()[0]) as image:
            image.save(file, exif=exif)
        self.assertEqual(decoded_file(cv2, str(file)).shape, (SIZE[1], SIZE[0], 3))

    @unittest.skipUnless(cv2, "OpenCV's Python module is not installed")
    def test_images_of_an_archive_are_found(self):
        file = temporary_folder() / 'images.zip'
        with zipfile.ZipFile(file, 'w') as archive:
            archive.write(image_files()[3], 'some/3.png')
        image = decoded_file(cv2, f'{file}/some/3.png')
        np.testing.assert_array_equal(image[..., 0], np.asarray(Image.open(image_files()[3])))

    def test_folders_of_others_stay_as_they_are(self):
        folder = temporary_folder() / 'out'
        shutil.copytree(room_run(), folder)
        (folder / 'tum').mkdir()
        (folder / 'tum' / 'mine.txt').write_text('mine')
        with self.assertRaisesRegex(ValueError, 'tum: holds what no export has made'):
            export(folder, ['tum'])
        self.assertEqual((folder / 'tum' / 'mine.txt').read_text(), 'mine')
        export(folder, ['kitti'])
        (folder / 'kitti' / 'old.txt').touch()
        made = json.loads((folder / 'exports.json').read_text())
        made['kitti'].append('old.txt')
        (folder / 'exports.json').write_text(json.dumps(made))
        export(folder, ['kitti'])
        self.assertFalse((folder / 'kitti' / 'old.txt').exists())

    def test_every_format_can_be_exported_again(self):
        folder = exported(*FORMATS)
        files = {path: path.read_bytes() for path in folder.rglob('*') if path.is_file()}
        export(folder, FORMATS)
        self.assertEqual({path: path.read_bytes() for path in folder.rglob('*') if path.is_file()}, files)
        (folder / 'colmap' / 'sparse' / 'mine.txt').touch()
        with self.assertRaisesRegex(ValueError, 'colmap: holds what no export has made'):
            export(folder, ['colmap'])
        self.assertTrue((folder / 'colmap/sparse/0/points3D.bin').exists(), 'refused before anything is removed')

    def test_links_lead_nowhere(self):
        folder = temporary_folder() / 'out'
        shutil.copytree(room_run(), folder)
        others = folder.parent / 'others'
        others.mkdir()
        (others / 'file').write_text('mine')
        for name, made in (('colmap', {'colmap': ['file']}), ('images', {'images': None}), ('tum', {})):
            (folder / name).symlink_to('../others')
            (folder / 'exports.json').unlink(missing_ok=True)
            (folder / 'exports.json').write_text(json.dumps(made))
            with self.assertRaisesRegex(ValueError, f'{name}: holds what no export'):
                export(folder, ['colmap' if name == 'images' else name], undistort=name == 'images')
        (folder / 'exports.json').unlink()
        (folder / 'exports.json').symlink_to('../others/file')
        export(folder, ['kitti'])
        remove_exports(folder)
        self.assertEqual([path.name for path in others.iterdir()], ['file'])
        self.assertEqual((others / 'file').read_text(), 'mine')

    @unittest.skipUnless(cv2, "OpenCV's Python module is not installed")
    def test_images_of_others_stay_as_they_are(self):
        folder = temporary_folder() / 'out'
        shutil.copytree(room_run(), folder)
        shutil.copytree(image_files()[0].parent, folder / 'images')
        with self.assertRaisesRegex(ValueError, 'images: holds what no export'):
            export(folder, ['colmap'], undistort=True)
        self.assertEqual(len(list((folder / 'images').iterdir())), len(image_files()))

    def test_exports_of_an_earlier_run_go(self):
        folder = temporary_folder() / 'out'
        shutil.copytree(room_run(), folder)
        export(folder, ['tum', 'kitti'])
        others = folder.parent / 'others'
        others.mkdir()
        (others / 'file').touch()
        made = json.loads((folder / 'exports.json').read_text())
        outside = {name: None for name in ('', '..', '../others', str(others))}
        made['tum'].append('../../others/file')
        (folder / 'exports.json').write_text(json.dumps({**made, **outside}))
        (folder / 'kitti' / 'notes.txt').touch()
        remove_exports(folder)
        self.assertTrue((others / 'file').is_file())
        self.assertFalse((folder / 'tum').exists() or (folder / 'exports.json').exists())
        self.assertEqual([path.name for path in (folder / 'kitti').iterdir()], ['notes.txt'], 'of others')
        with self.assertRaisesRegex(ValueError, 'kitti: holds what no export'):
            export(folder, ['kitti'])
        (folder / 'exports.json').write_text('["tum"]')
        export(folder, ['tum'])

    def test_a_table_without_its_columns_is_refused(self):
        folder = temporary_folder() / 'out'
        shutil.copytree(room_run(), folder)
        table = folder / 'frames.csv'
        table.write_text(table.read_text().replace(',image', ',picture', 1))
        with self.assertRaisesRegex(ValueError, "frames.csv: not as a run leaves it: KeyError: 'image'"):
            export(folder, ['tum'])


if __name__ == '__main__':
    unittest.main()
