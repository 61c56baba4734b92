#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# Installs what is missing, builds everything and runs all tests. Arguments go to ctest (-L unit, -R name, ...).
set -euo pipefail
cd "$(dirname "$0")/.."

scripts/install_dependencies.sh
build=${DSORB_BUILD_DIR:-build}
cmake -S . -B "$build" -G Ninja -DCMAKE_CXX_COMPILER_LAUNCHER=ccache -DDSORB_BUILD_TESTS=ON ${DSORB_CMAKE_FLAGS:-} >"$build.log" 2>&1 ||
  { cat "$build.log"; exit 1; }
rm -f "$build.log"
cmake --build "$build"
ctest --test-dir "$build" --output-on-failure --parallel "$(nproc)" "$@"
