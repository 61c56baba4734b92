#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# What is too long for every change: nightly.sh [STEP...], all steps by default, each also where one before it failed.
#   attack   test/attack on the package in build/python
#   soak     200,000 rendered frames
#   lost     rendered clips whose camera is lost, and what is found again
#   fuzz     each parser, 10 minutes (fuzz and contract need the build of clang of .ci/run)
#   contract those of all initializers under the sanitizers of clang, with Ceres
#   threads  what has threads, under ThreadSanitizer
#   lint     what changed since the last tag
#   memory   that it does not grow with the length of a run
#   wheels   scripts/wheels/build.sh, tried in empty roots (on Debian 12, as root)
#   portability  what macOS and Windows would say of the code, as far as Debian's compilers can tell
#   aarch64  unit and contract tests under qemu, then its wheels (after wheels; not by default, because it takes hours)
set -uo pipefail
cd "$(dirname "$0")/.."
export DSORB_BUILD_DIR=${DSORB_BUILD_DIR:-$PWD/build}
[ $# -gt 0 ] || set -- attack soak lost fuzz contract threads lint memory wheels portability

attack() {
  local python=${DSORB_PYTHON:-python3} script failed=0
  for script in test/attack/*.py; do
    PYTHONPATH=$DSORB_BUILD_DIR/python:test/python DSO_SYNTHESIZE=$DSORB_BUILD_DIR/bin/dso_synthesize "$python" "$script" || failed=1
  done
  return $failed
}
soak() { scripts/soak.sh 200000; }
lost() { scripts/lost_clips.py "$(mktemp -d)" --bin "$DSORB_BUILD_DIR/bin"; }
fuzz() { DSORB_BUILD_DIR=$PWD/build-clang scripts/fuzz.sh 600s; }
contract() {
  [ -e build-clang/build.ninja ] || { echo "nightly.sh: contract needs the build of .ci/run" >&2; return 1; }
  cmake -S . -B build-clang -DDSORB_WITH_CERES=ON >/dev/null && DSORB_BUILD_DIR=build-clang scripts/build.sh -- dso_dataset contract_tests &&
    ctest --test-dir build-clang --output-on-failure --parallel "$(nproc)" -L contract --repeat until-pass:3
}
threads() {
  local room
  room=$(mktemp -d)/room
  "$DSORB_BUILD_DIR/bin/dso_synthesize" room --output "$room" --frames 40 --width 320 --height 240 --quiet &&
    DSORB_SANITIZE=thread DSORB_FRAMES=25 DSORB_CMAKE_FLAGS=-DDSORB_WERROR=ON scripts/check_sanitizers.sh "$room"
}
lint() { scripts/lint.sh --since "$(git describe --tags --abbrev=0)"; }
memory() { python3 scripts/check_memory.py; }
wheels() { scripts/wheels/build.sh x86_64 && scripts/wheels/try.sh; }
portability() {
  scripts/install_dependencies.sh clang-14 g++-mingw-w64-x86-64-posix && scripts/check_portability.sh
}
aarch64() {
  scripts/wheels/test_aarch64.sh && scripts/wheels/build.sh aarch64 && DSORB_ARCH=aarch64 scripts/wheels/try.sh bookworm
}

failed=()
for step in "$@"; do
  printf '\n== %s (%d s since the start)\n' "$step" "$SECONDS"
  "$step" || failed+=("$step")
done
[ ${#failed[@]} -eq 0 ] || { echo "nightly.sh: failed: ${failed[*]}" >&2; exit 1; }
