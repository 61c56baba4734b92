#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# Builds the wheel, looks into it, installs it in a fresh virtual environment and runs the tests of the Python package
# there: check_wheel.sh [BUILD_FOLDER] (default build; it has the program that renders). Optional packages are installed
# for the tests that need them. Other Pythons: PYTHON=python3.12 scripts/check_wheel.sh. Exit code
# 77: no virtual environment or no package index.
set -euo pipefail
cd "$(dirname "$0")/.."
renderer=$(readlink -f "${1:-build}")/bin/dso_synthesize
[ -x "$renderer" ] || { echo "check_wheel.sh: $renderer is missing; build it first" >&2; exit 1; }
most_bytes=15000000
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
skip() { echo "SKIPPED: $1"; exit 77; }

"${PYTHON:-python3}" -m venv "$work/venv" || skip "no virtual environment"
pip=("$work/venv/bin/python" -m pip --quiet --disable-pip-version-check)
"${pip[@]}" install Pillow numpy || skip "no package index"
CMAKE_CXX_COMPILER_LAUNCHER=$(command -v ccache || true) "${pip[@]}" wheel . --no-deps --wheel-dir "$work"
wheel=$(ls "$work"/*.whl)
bytes=$(stat -c %s "$wheel")
echo "$(basename "$wheel"): $bytes bytes"
[ "$bytes" -le $most_bytes ] || { echo "more than $most_bytes" >&2; exit 1; }

"${pip[@]}" install "$wheel"
package=$("$work/venv/bin/python" -c 'import dsorb; print(dsorb.__path__[0])')
needed=$(readelf -d "$package"/_dsorb*.so "$package/bin/dso_dataset" | grep NEEDED)
if grep -E 'ceres|cholmod|spqr|suitesparse|glog' <<<"$needed"; then echo "GPL parts are linked" >&2; exit 1; fi
scripts/check_module.sh "$package"/_dsorb*.so
for optional in 'pycolmap>=4' opencv-python-headless imageio-ffmpeg rosbags rerun-sdk PyYAML; do # not every Python has each
  "${pip[@]}" install "$optional" || echo "without $optional: its tests are skipped"
done
export PYTHONPATH=$PWD/test/python PYTHONDONTWRITEBYTECODE=1 DSO_SYNTHESIZE=$renderer
for module in test_module test_export test_metric test_command test_calibrate test_bags test_decoding test_view test_browser test_vslamlab; do
  "$work/venv/bin/python" test/python/run.py "$module" || [ $? = 77 ]
done

"$work/venv/bin/dsorb" --version
