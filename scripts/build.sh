#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# Builds in the folder DSORB_BUILD_DIR (default build) and says how long it takes and how far it is:
# build.sh [CMAKE FLAGS...] [-- TARGETS...]. Without flags a folder keeps those it was configured with. Sources of one
# folder are compiled together, which is the quickest way from nothing; -DCMAKE_UNITY_BUILD=OFF is quicker for one that
# is edited over and over.
set -euo pipefail
cd "$(dirname "$0")/.."
build=${DSORB_BUILD_DIR:-build}
flags=()
while [ $# -ne 0 ] && [ "$1" != -- ]; do flags+=("$1"); shift; done
[ $# -eq 0 ] || shift

if [ ! -f "$build/build.ninja" ] || [ ${#flags[@]} -ne 0 ]; then
  log=$(cmake -S . -B "$build" -G Ninja -DCMAKE_CXX_COMPILER_LAUNCHER=ccache -DCMAKE_UNITY_BUILD=ON \
    "${flags[@]}" 2>&1) || { echo "$log"; exit 1; }
fi

seconds_per_source=3.3 # of one core, on average
! grep -q '^CMAKE_UNITY_BUILD:.*=ON' "$build/CMakeCache.txt" || seconds_per_source=16
sources=$(ninja -C "$build" -t commands "$@" | grep -c -- ' -c ' || true)
missing=$((sources - $(find "$build" -name '*.o' -o -name '*.gch' -o -name '*.pch' | wc -l)))
if [ "$missing" -gt 9 ]; then
  awk -v n="$missing" -v s="$seconds_per_source" -v c="$(nproc)" \
    'BEGIN { printf "Compiling %d times: about %.0f minutes on %d cores, less where ccache knows them.\n", n, n * s / c / 60, c }'
fi
if [ -t 1 ]; then
  ninja -C "$build" "$@"
else # one line for each tenth of the way, and whatever the compiler says
  ninja -C "$build" "$@" | {
    shown=
    while IFS= read -r line; do
      if [[ $line =~ ^\[([0-9]+)/([0-9]+)\] ]]; then
        tenth=$((10 * BASH_REMATCH[1] / BASH_REMATCH[2]))
        [ "$tenth" != "$shown" ] || continue
        shown=$tenth
      fi
      printf '%s\n' "$line"
    done
  }
fi
