#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# Renders the sequences of docs/lab/results/held_out.txt and evaluates dense starts on them.
#   scripts/held_out.sh OUT [arguments of evaluate.py, for example --variants orb coarse --jobs 2]
set -euo pipefail
cd "$(dirname "$0")/.."
out=${1:?usage: scripts/held_out.sh OUT [arguments of evaluate.py]}
shift
bin=${DSORB_BUILD_DIR:-build}/bin
mkdir -p "$out/data"
list=$out/data/sequences.yaml
echo 'sequences:' >"$list"
while read -r name kind arguments; do
  case $name in '' | '#'*) continue ;; esac
  # shellcheck disable=SC2086 # the arguments are words
  [ -f "$out/data/$name/groundtruth.txt" ] ||
    "$bin/dso_synthesize" "$kind" $arguments --frames 60 --output "$out/data/$name" --quiet
  can_start='' && case $kind in static | rotation) can_start=', no_start: true' ;; esac
  echo "- {name: $name, path: $name, dataset: held_out$can_start}" >>"$list"
done <docs/lab/results/held_out.txt
scripts/evaluate.py --bin "$bin/dso_dataset" --sequences "$list" --starts every:20 --frames 40 --output "$out/evaluation" "$@"
