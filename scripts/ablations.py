#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Leaves mechanisms out one by one and says what each is worth; `ablations.py --help` says how."""
import sys

from evaluate import HERE, use_environment

if __name__ == '__main__':
    use_environment(__file__)
    sys.path.insert(0, HERE)
    from dsorb_eval.ablations import main
    sys.exit(main())
