#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Measures what the factors on variances should be; `variance_factors.py --help` says how."""
import sys

from evaluate import HERE, use_environment

if __name__ == '__main__':
    use_environment(__file__)
    sys.path.insert(0, HERE)
    from dsorb_eval.variance_factors import main
    sys.exit(main())
