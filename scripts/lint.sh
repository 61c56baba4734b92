#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# clang-tidy over all sources, or over those changed since a commit: lint.sh [--since COMMIT].
# Needs a build folder configured before (DSORB_BUILD_DIR, default build).
set -euo pipefail
cd "$(dirname "$0")/.."
build=${DSORB_BUILD_DIR:-build}
if [ $# -ne 0 ] && { [ $# -ne 2 ] || [ "$1" != --since ]; }; then
  echo "usage: lint.sh [--since COMMIT]" >&2
  exit 2
fi
[ -f "$build/compile_commands.json" ] || { echo "lint: no $build/compile_commands.json; configure $build first" >&2; exit 2; }
if [ $# -eq 2 ]; then
  mapfile -t files < <(git diff --name-only --diff-filter=d "$2" -- 'src/*.cpp')
else
  mapfile -t files < <(git ls-files 'src/*.cpp')
fi
[ ${#files[@]} -eq 0 ] && { echo "lint: nothing changed"; exit 0; }
printf '%s\n' "${files[@]}" | xargs -P "$(nproc)" -n 1 clang-tidy-14 -p "$build" --quiet 2>/dev/null
echo "lint: ${#files[@]} files clean"
