#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# What is too long for every change: nightly.sh [STEP...], all steps by default, each also where one before it failed.
#   attack   test/attack on the package in build/python
#   soak     200,000 rendered frames
#   fuzz     each parser, 10 minutes (needs the fuzzers of .ci/run)
#   memory   that it does not grow with the length of a run
set -uo pipefail
cd "$(dirname "$0")/.."
export DSORB_BUILD_DIR=${DSORB_BUILD_DIR:-$PWD/build}
[ $# -gt 0 ] || set -- attack soak fuzz memory

attack() {
  local python=${DSORB_PYTHON:-python3} script failed=0
  for script in test/attack/*.py; do
    PYTHONPATH=$DSORB_BUILD_DIR/python:test/python DSO_SYNTHESIZE=$DSORB_BUILD_DIR/bin/dso_synthesize "$python" "$script" || failed=1
  done
  return $failed
}
soak() { scripts/soak.sh 200000; }
fuzz() { DSORB_BUILD_DIR=$PWD/build-clang scripts/fuzz.sh 600s; }
memory() { python3 scripts/check_memory.py; }

failed=()
for step in "$@"; do
  printf '\n== %s (%d s since the start)\n' "$step" "$SECONDS"
  "$step" || failed+=("$step")
done
[ ${#failed[@]} -eq 0 ] || { echo "nightly.sh: failed: ${failed[*]}" >&2; exit 1; }
