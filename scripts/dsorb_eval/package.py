# SPDX-License-Identifier: BSD-3-Clause
"""The Python package `dsorb` for the evaluation."""
import importlib
import sys
from pathlib import Path


def load(build):
    """The package of a build, else the installed one; None where there is neither."""
    folder = str(Path(build) / 'python')
    sys.path.insert(0, folder)
    try:
        return importlib.import_module('dsorb')
    except ImportError:
        return None
    finally:
        sys.path.remove(folder)
