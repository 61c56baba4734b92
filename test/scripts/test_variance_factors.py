# SPDX-License-Identifier: BSD-3-Clause
"""What the factors on variances should be, from figures of runs."""
import unittest
from types import SimpleNamespace

from dsorb_eval.variance_factors import RIGHT, rows_of


def run_of(sequence, nees_dir):
    return SimpleNamespace(entry={'sequence': sequence}, start={'nees_dir': nees_dir}, figures={})


class VarianceFactors(unittest.TestCase):
    def test_a_sequence_counts_once_however_many_starts_it_has(self):
        runs = [run_of('a', [RIGHT] * 50), run_of('b', [4 * RIGHT]), run_of('c', [4 * RIGHT, float('nan')])]
        (name, count, middle, low, high, right, factor, change), = rows_of(runs)
        self.assertEqual((name, count, factor), ('nees_dir', 3, 'kStartDirection'))
        self.assertAlmostEqual(middle, 4 * RIGHT)
        self.assertAlmostEqual(change, 2)  # a scale: its square enters the variance


if __name__ == '__main__':
    unittest.main()
