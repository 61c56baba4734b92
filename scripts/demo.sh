#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# Installs what is missing, builds, renders a synthetic street, runs dso_dataset on it and compares with the truth.
set -euo pipefail
cd "$(dirname "$0")/.."

[ $# -eq 0 ] || { echo "usage: demo.sh (build folder: DSORB_BUILD_DIR, default build)" >&2; exit 2; }
scripts/install_dependencies.sh python3-numpy python3-opencv
build=${DSORB_BUILD_DIR:-build}
scripts/build.sh -- dso_dataset dso_synthesize

sequence=out/demo/street
results=out/demo/results
[ -f "$sequence/groundtruth.txt" ] || "$build/bin/dso_synthesize" street --output "$sequence" --frames 80
"$build/bin/dso_dataset" "$sequence" --initializer=orb --output "$results" || [ $? -eq 3 ] # 3: lost before the end

echo
/usr/bin/python3 scripts/compare_with_truth.py "$sequence" "$results"
echo
echo "Look at $results/figures/initial_inverse_depth.png and $results/figures/trajectory.png;"
echo "$results/points.ply opens in MeshLab or CloudCompare."
