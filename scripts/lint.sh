#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# clang-tidy over all sources, or over those changed since a commit: lint.sh [--since COMMIT]. Without precompiled
# headers, so that a source that does not include what it uses fails; build-lint is configured for it, nothing is built.
set -euo pipefail
cd "$(dirname "$0")/.."
build=build-lint
if [ $# -ne 0 ] && { [ $# -ne 2 ] || [ "$1" != --since ]; }; then
  echo "usage: lint.sh [--since COMMIT]" >&2
  exit 2
fi
# shellcheck disable=SC2046 # several flags or none
cmake -S . -B "$build" -G Ninja -DCMAKE_DISABLE_PRECOMPILE_HEADERS=ON -DDSORB_BUILD_TESTS=OFF $(scripts/python_flags.sh) >/dev/null
if [ $# -eq 2 ]; then
  mapfile -t files < <(git diff --name-only --diff-filter=d "$2" -- 'src/*.cpp')
else
  mapfile -t files < <(git ls-files 'src/*.cpp')
fi
if ! grep -q src/python/module.cpp "$build/compile_commands.json"; then
  mapfile -t files < <(printf '%s\n' "${files[@]}" | grep -v '^src/python/')
  echo "lint: without src/python, which is not built here"
fi
[ ${#files[@]} -eq 0 ] && { echo "lint: nothing changed"; exit 0; }
printf '%s\n' "${files[@]}" | xargs -P "$(nproc)" -n 1 clang-tidy-14 -p "$build" --quiet 2>/dev/null
echo "lint: ${#files[@]} files clean"
