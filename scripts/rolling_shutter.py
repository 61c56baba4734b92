#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""What a rolling shutter costs, with its readout given and not? `rolling_shutter.py --help` says how."""
import sys

from evaluate import HERE, use_environment

if __name__ == '__main__':
    use_environment(__file__)
    sys.path.insert(0, HERE)
    from dsorb_eval.rolling import main
    sys.exit(main())
