#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""From sequences to tables and figures with one command; `evaluate.py --help` says how.

Needs scripts/requirements.txt: `scripts/venv.sh` makes a virtual environment, and this uses it where it is."""
import os
import sys

HERE = os.path.dirname(os.path.abspath(__file__))


def use_environment(script):
    """Goes on in the virtual environment of scripts/venv.sh, unless this Python has what is needed."""
    python = os.path.join(os.environ.get('DSORB_VENV') or os.path.join(HERE, '..', '.venv'), 'bin', 'python')
    if os.path.exists(python) and os.path.realpath(sys.prefix) != os.path.realpath(os.path.dirname(os.path.dirname(python))):
        os.execv(python, [python, os.path.abspath(script), *sys.argv[1:]])


if __name__ == '__main__':
    use_environment(__file__)
    sys.path.insert(0, HERE)
    try:
        from dsorb_eval.cli import main
    except ImportError as error:
        sys.exit(f'evaluate.py: {error}; run scripts/venv.sh first')
    sys.exit(main())
