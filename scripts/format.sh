#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# Formats every C++ file; with --check only says which files differ and fails.
set -euo pipefail
cd "$(dirname "$0")/.."
if [ $# -ne 0 ] && [ "$*" != --check ]; then
  echo "usage: format.sh [--check]" >&2
  exit 2
fi
mapfile -t files < <(git ls-files '*.h' '*.cpp')
if [ "${1:-}" = --check ]; then
  clang-format-14 --dry-run --Werror "${files[@]}" && echo "format: ${#files[@]} files as they should be"
else
  clang-format-14 -i "${files[@]}"
fi
