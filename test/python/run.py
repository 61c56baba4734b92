# SPDX-License-Identifier: BSD-3-Clause
"""Runs one test module: run.py MODULE. Exit code 77, by which ctest skips, where every test of it was skipped."""
import sys
import unittest


def skip(reasons):
    print('SKIPPED:', '; '.join(sorted(reasons)))
    sys.exit(77)


try:
    result = unittest.main(module=None, argv=['run.py', *sys.argv[1:]], exit=False).result
except unittest.SkipTest as reason:  # of the whole module
    skip({str(reason)})
if result.skipped and len(result.skipped) >= result.testsRun:
    skip({reason for _, reason in result.skipped})
sys.exit(not result.wasSuccessful())
