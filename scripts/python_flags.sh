#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# Prints the CMake flags that build the Python package with the environment of scripts/venv.sh; none, and the reason on
# stderr, where that cannot be made or Python's headers are missing.
here=$(cd "$(dirname "$0")" && pwd)
python=$("$here/venv.sh") || { echo "python_flags.sh: no Python package: there is no environment to build it with" >&2; exit 0; }
header=$("$python" -c 'import sysconfig; print(sysconfig.get_path("include"))')/Python.h
[ -f "$header" ] || { echo "python_flags.sh: no Python package: $header is missing; on Debian: apt-get install python3-dev" >&2; exit 0; }
echo "-DDSORB_BUILD_PYTHON=ON -DPython_EXECUTABLE=$python"
