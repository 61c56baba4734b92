#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# How much of the arithmetic of hot functions is on vectors: neon.sh OBJECT_OR_PROGRAM [PATTERN] (for aarch64). For every
# function with more than 60 instructions of floating point: how many of them on vectors, how many on scalars.
set -euo pipefail
aarch64-linux-gnu-objdump -d --no-show-raw-insn -C "$1" | awk -v pattern="${2:-.}" '
  /^[0-9a-f]+ </ { name = $0; sub(/^[0-9a-f]+ </, "", name); sub(/>:$/, "", name); next }
  name ~ pattern && $2 ~ /^f/ { if ($3 ~ /v[0-9]+\.(4s|2d|2s)/) vector[name]++; else scalar[name]++; all[name]++ }
  END { for (name in all) if (all[name] > 60) printf "%6d on vectors %6d on scalars  %s\n", vector[name], scalar[name], substr(name, 1, 100) }' |
  sort -rn
