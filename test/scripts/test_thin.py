# SPDX-License-Identifier: BSD-3-Clause
"""Sequences of a low frame rate: which frames there are, their times, truth, depths, and EuRoC's layout."""
import json
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

import numpy as np
from PIL import Image

from dsorb_eval import layout, protocol
from dsorb_eval import trajectory as tr

SCRIPT = Path(__file__).resolve().parents[2] / 'scripts' / 'thin_sequences.py'
COUNT = 10


def write_images(folder):
    """Images whose grey value is their index."""
    folder.mkdir(parents=True)
    for i in range(COUNT):
        Image.fromarray(np.full((4, 6), i, np.uint8)).save(folder / f'{i:05d}.png')


def greys(folder):
    return [int(np.array(Image.open(folder / name))[0, 0]) for name in layout.image_names(folder)]


class Thinned(unittest.TestCase):
    def setUp(self):
        holder = tempfile.TemporaryDirectory(prefix='dsorb_test_')
        self.addCleanup(holder.cleanup)
        self.folder = Path(holder.name)

    def thin(self, source, *arguments):
        return subprocess.run([sys.executable, SCRIPT, source, '--to', self.folder / 'thinned', *arguments], capture_output=True, text=True)

    def write_dso(self):
        source = self.folder / 'walk'
        write_images(source / 'images')
        write_images(source / 'depth')
        (source / 'camera.txt').write_text('Pinhole 5 5 2.5 1.5 0\n6 4\nnone\n6 4\n')
        (source / 'times.txt').write_text(''.join(f'{i:05d} {100 + i / 10:.9f} {i}\n' for i in range(COUNT)))
        (source / 'groundtruth.txt').write_text(''.join(f'{100 + i / 10:.9f} {i} 0 0 0 0 0 1\n' for i in range(COUNT)))
        return source

    def test_there_and_back_without_a_frame_twice(self):
        self.assertEqual(self.thin(self.write_dso(), '--every', '3').returncode, 0)
        made = self.folder / 'thinned' / 'walk_every3'
        kept = [0, 3, 6, 9, 7, 4, 1]
        self.assertEqual(greys(made / 'images'), kept)
        self.assertEqual(greys(made / 'depth'), kept)
        times = layout.timestamps(made)
        np.testing.assert_allclose(times, [100, 100.3, 100.6, 100.9, 101.1, 101.4, 101.7])
        self.assertEqual([line.split()[2] for line in (made / 'times.txt').read_text().splitlines()], [str(i) for i in kept])  # exposures
        truth = tr.load_tum(made / 'groundtruth.txt')
        np.testing.assert_allclose(truth[:, 0], times)
        np.testing.assert_allclose(truth[:, 1], kept)

    def test_lists_are_those_of_the_evaluation(self):
        self.assertEqual(self.thin(self.write_dso(), '--every', '2', '3').returncode, 0)
        thinned = self.folder / 'thinned'
        self.assertEqual([s.name for s in protocol.read_sequences(thinned / 'sequences.yaml')], ['walk_every2', 'walk_every3'])
        self.assertEqual(json.loads((thinned / 'sequences.json').read_text())['walk_every3'], {'path': 'walk_every3', 'frames': 7})

    def test_euroc_keeps_its_layout(self):
        source = self.folder / 'flight'
        write_images(source / 'mav0/cam0/data')
        (source / 'mav0/cam0/sensor.yaml').write_text('sensor_type: camera\n')
        (source / 'mav0/cam0/data.csv').write_text('#timestamp [ns],filename\n' + ''.join(f'{10**18 + i * 10**8},{i:05d}.png\n' for i in range(COUNT)))
        self.assertEqual(self.thin(source, '--every', '4').returncode, 0)
        made = self.folder / 'thinned' / 'flight_every4'
        self.assertEqual(layout.recognise(made)[0], 'euroc')
        self.assertEqual(greys(made / 'mav0/cam0/data'), [0, 4, 8, 6, 2])

    def test_what_cannot_be_thinned_is_named(self):
        done = self.thin(self.folder / 'nothing')
        self.assertNotEqual(done.returncode, 0)
        self.assertIn('nothing', done.stderr)


if __name__ == '__main__':
    unittest.main()
