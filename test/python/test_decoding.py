# SPDX-License-Identifier: BSD-3-Clause
"""Exported images are those that were tracked, over containers and codecs that FFmpeg writes. One decoder serves both."""
import json
import subprocess
import unittest

import numpy as np
from dsorb.pictures import Video, program
from room import FRAMES, SIZE, image_files, images, room, temporary_folder

try:
    import cv2
    import imageio_ffmpeg
except ImportError:
    raise unittest.SkipTest("OpenCV's Python module and imageio-ffmpeg are not installed") from None

H264 = ('-c:v', 'libx264', '-crf', '16', '-bf', '3', '-g', '10', '-pix_fmt', 'yuv420p')
COPY = ('-c', 'copy')
INTERLACE = ('-vf', 'tinterlace=interleave_top', '-flags', '+ildct+ilme')
SOUND = ('-f', 'lavfi', '-i', 'anullsrc=r=48000:cl=mono', '-t', '4')
UNEVEN = ('-vf', r'setpts=if(gt(N\,20)\,N+7\,N)/30/TB', '-fps_mode', 'passthrough')
# name: arguments before the input, after it, and which images of the room there are
KINDS = {
    'plain.mp4': ((), H264, range(FRAMES)),
    'ten_bits.mp4': ((), ('-c:v', 'libx265', '-crf', '14', '-pix_fmt', 'yuv420p10le', '-x265-params', 'log-level=none'), range(FRAMES)),
    'ten_bits.mov': ((), ('-c:v', 'prores_ks', '-profile:v', '3', '-pix_fmt', 'yuv422p10le'), range(FRAMES)),
    'interlaced.mp4': ((), (*INTERLACE, '-c:v', 'libx264', '-crf', '12', '-pix_fmt', 'yuv420p'), range(0, FRAMES, 2)),
    'interlaced.mpg': ((), (*INTERLACE, '-c:v', 'mpeg2video', '-q:v', '2', '-r', '30'), np.repeat(range(0, FRAMES, 2), 2)),  # each twice
    'camcorder.MTS': ((), (*H264, '-f', 'mpegts'), range(FRAMES)),
    'raspberry.h264': ((), ('-c:v', 'libx264', '-crf', '16', '-bf', '0', '-pix_fmt', 'yuv420p'), range(FRAMES)),
    'uneven.mkv': ((), (*UNEVEN, *H264), range(FRAMES)),
    'camera.avi': ((), ('-c:v', 'mjpeg', '-q:v', '2', '-pix_fmt', 'yuvj420p'), range(FRAMES)),
    'web.webm': ((), ('-c:v', 'libvpx-vp9', '-crf', '14', '-b:v', '0', '-deadline', 'realtime'), range(FRAMES)),
    'windows.wmv': ((), ('-c:v', 'wmv2', '-q:v', '2'), range(FRAMES)),
    'flash.flv': ((), ('-c:v', 'flv', '-q:v', '2'), range(FRAMES)),
    # of plain.mp4
    'long_sound.mkv': ((), (*SOUND, *COPY, '-c:a', 'aac'), range(FRAMES)),
    'late.mkv': (('-itsoffset', '5'), COPY, range(FRAMES)),
    'trimmed.mp4': (('-ss', '0.4'), COPY, range(12, FRAMES)),
    'trimmed.mov': (('-ss', '0.5', '-t', '0.5'), COPY, (*range(15, 31), 34)),  # one more, which others need
    'turned90.mp4': (('-display_rotation', '90'), COPY, range(FRAMES)),
    'turned180.mp4': (('-display_rotation', '180'), COPY, range(FRAMES)),
}
TURNED = {'turned90.mp4': 3, 'turned180.mp4': 2}  # quarters, clockwise
TOLD = {'interlaced.mp4': 'interlaced', 'interlaced.mpg': 'interlaced', 'raspberry.h264': 'no times', 'uneven.mkv': 'rate varies'}


def ffmpeg(*words):
    subprocess.run([imageio_ffmpeg.get_ffmpeg_exe(), '-loglevel', 'error', '-y', *map(str, words)], check=True, stdin=subprocess.DEVNULL)


def room_as_input():
    first = image_files()[0]
    return '-framerate', 30, '-start_number', int(first.stem), '-i', first.with_name(f'%0{len(first.stem)}d.png')


def clips():
    """Folder with all of them."""
    folder, pattern = temporary_folder(), room_as_input()
    for name, (before, after, _) in KINDS.items():
        source = pattern if after[-2:] != COPY and COPY[1] not in after else (*before, '-i', folder / 'plain.mp4')
        ffmpeg(*source, *after, folder / name)
    return folder


class Decoding(unittest.TestCase):
    def test_exported_images_are_those_that_were_tracked(self):
        folder, truth = clips(), images()
        for name, (_, _, indices) in KINDS.items():
            with self.subTest(name):
                out = folder / f'{name}_out'
                done = subprocess.run([program(), folder / name, '--hfov', '77', '--output', out, '--record', out / 'recording.jsonl'],
                                      capture_output=True, text=True, check=False)
                self.assertIn(done.returncode, (0, 3), done.stderr)  # some are too short to start
                self.assertEqual(TOLD.get(name, 'interlaced') in done.stderr, name in TOLD, done.stderr)
                self.assertEqual(json.loads((out / 'run.json').read_text())['frames_given'], len(indices))
                self.compare(folder / name, out, [np.rot90(truth[i], -TURNED.get(name, 0)) for i in indices])

    def test_what_the_container_says_of_the_display(self):
        folder = temporary_folder()
        ffmpeg(*room_as_input(), *H264, folder / 'plain.mp4')
        for name, before, after, told in (('wide.mp4', (), ('-vf', 'setsar=4/3', *H264), ''),
                                          ('mirrored.mp4', ('-display_hflip',), COPY, 'mirrored'),
                                          ('tilted.mp4', ('-display_rotation', '30'), COPY, 'no right angle'),
                                          ('two.mp4', (), ('-map', '0', '-map', '0', *COPY), 'has 2 videos')):
            with self.subTest(name):
                ffmpeg(*before, '-i', folder / 'plain.mp4', *after, folder / name)
                done = subprocess.run([program(), folder / name, '--hfov', '77', '--end', '3', '--output', folder / 'out'],
                                      capture_output=True, text=True, check=False)
                self.assertIn(told, done.stderr)
                self.assertEqual('image 0: ' in done.stderr, bool(told), done.stderr)
                camera = json.loads((folder / 'out/run.json').read_text())['camera']
                self.assertAlmostEqual(camera['fy'] / camera['fx'], 4 / 3 if name == 'wide.mp4' else 1, places=6)

    def compare(self, clip, out, truth):
        tracked = sorted((out / 'recording_images').iterdir())
        with Video(clip) as video:
            for position, (file, expected) in enumerate(zip(tracked, truth)):
                exported = cv2.cvtColor(video.image(position)[0], cv2.COLOR_BGR2GRAY)
                seen = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)
                self.assertEqual(seen.shape, exported.shape)
                self.assertLessEqual(np.abs(seen.astype(int) - exported).max(), 1, f'{clip}, image {position}')
                self.assertLess(np.abs(exported - expected.astype(float)).mean(), 4, f'{clip}, image {position}')
            self.assertIsNone(video.image(len(truth)))


if __name__ == '__main__':
    unittest.main()
