#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Writes docs/lab/results.md from two evaluations of evaluate.py, beside the figures of other programs.

  results_page.py --five DIR --dense DIR

DIR are output folders of evaluate.py: `--starts five --frames 200` and `--starts every:10 --frames 40`, the same program and
sequences. Figures of the others: docs/lab/results/reference.csv. Pictures go to docs/lab/results/."""
import sys

from evaluate import HERE, use_environment

if __name__ == '__main__':
    use_environment(__file__)
    sys.path.insert(0, HERE)
    from dsorb_eval.results import main
    sys.exit(main())
