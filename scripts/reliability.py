#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Is the probability with which a start claims to be wrong the share of starts that are? `reliability.py --help` says how."""
import sys

from evaluate import HERE, use_environment

if __name__ == '__main__':
    use_environment(__file__)
    sys.path.insert(0, HERE)
    from dsorb_eval.reliability import main
    sys.exit(main())
