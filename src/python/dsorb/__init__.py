# SPDX-License-Identifier: BSD-3-Clause
"""Monocular direct visual odometry, started from features.

Poses `T_a_b` are (4, 4) arrays that map points of b to a. Cameras are rectified pinholes in pixels, the centre of the
top-left pixel is (0, 0), depth is along the optical axis. The unit of length is such that the mean inverse depth of a
start's reference points is 1. docs/python.md has examples.
"""
import importlib

from ._dsorb import (Calibration, Camera, ConfigError, Estimate, Initialization, Initializer, InitStep, IoError, Keyframe,
                     Odometry, Priors, Rectifier, Report, StartFrame, __version__, initializer_names)

__all__ = ['Calibration', 'Camera', 'ConfigError', 'Estimate', 'Initialization', 'Initializer', 'InitStep', 'IoError',
           'Keyframe', 'Odometry', 'Priors', 'Rectifier', 'Report', 'StartFrame', '__version__', 'initializer_names']


def __getattr__(name):
    """Modules of the package are loaded when they are first used."""
    if name in ('export', 'run_folder'):
        return importlib.import_module(f'.{name}', __name__)
    raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
