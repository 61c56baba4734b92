#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# Builds dso_dataset with sanitizers and runs it on one start of every sequence given, with both initializers, forward
# and in reverse; fails at the first report, crash, nan or inf: check_sanitizers.sh [FOLDER...]
# Under ThreadSanitizer the tests of what runs in several threads come first.
#   FOLDER            sequences; default: all that sequences.json in DSORB_DATA (default ../shared/data) lists
#   DSORB_SANITIZE    address,undefined (default) or thread: then with tracking, mapping and inner loops in parallel
#   DSORB_FRAMES      frames of each run, default 50
#   DSORB_CMAKE_FLAGS more flags for cmake
set -euo pipefail
cd "$(dirname "$0")/.."
sanitize=${DSORB_SANITIZE:-address,undefined}
frames=${DSORB_FRAMES:-50}
sequences=("$@")
for sequence in "${sequences[@]}"; do
  [ -e "$sequence" ] || { echo "check_sanitizers: $sequence: no such sequence" >&2; exit 2; }
done
if [ ${#sequences[@]} -eq 0 ]; then
  data=${DSORB_DATA:-../shared/data}
  mapfile -t sequences < <(python3 -c 'import json, sys
for entry in json.load(open(sys.argv[1] + "/sequences.json")).values(): print(sys.argv[1] + "/" + entry["path"])' "$data")
fi

build=build-sanitize
read -r -a flags <<<"${DSORB_CMAKE_FLAGS:-}"
extra=(--threads 1)
if [ "$sanitize" = thread ]; then
  build=build-thread
  flags+=(-DDSORB_WITH_CERES=OFF) # what needs it has no threads of ours
  extra=(--threads 2 --pipelined)
  export TSAN_OPTIONS="suppressions=$PWD/scripts/tsan_suppressions.txt history_size=4"
fi
targets=(dso_dataset)
if [ "$sanitize" = thread ]; then targets+=(thread_tests); fi
# dlopen() of a sanitizer does not look where the caller's libraries are.
export LD_LIBRARY_PATH=$PWD/$build/lib
DSORB_BUILD_DIR=$build scripts/build.sh -DCMAKE_BUILD_TYPE=Debug -DCMAKE_CXX_FLAGS_DEBUG=-O1 "-DDSORB_SANITIZE=$sanitize" \
  "${flags[@]}" -- "${targets[@]}"
if [ "$sanitize" = thread ]; then # two parts side by side: much waits for another thread
  seq 0 1 | GTEST_TOTAL_SHARDS=2 xargs -P 2 -I {} env GTEST_SHARD_INDEX={} "$build/bin/thread_tests" --gtest_brief=1
fi

output=$(mktemp -d)
trap 'rm -rf "$output"' EXIT

run() { # SEQUENCE INITIALIZER [--reverse]
  local begin=$SECONDS code=0 folder
  folder=$(mktemp -d -p "$output")
  # shellcheck disable=SC2086 # several options
  "$build/bin/dso_dataset" "$1" --end "$frames" ${3:+"$3"} --initializer="$2" $extra_options --output "$folder" --quiet || code=$?
  echo "$1 $2${3:+ reversed}: exit code $code, $((SECONDS - begin)) s"
  if [ "$code" -ne 0 ] && [ "$code" -ne 3 ]; then return 255; fi # 3: not initialized or lost
  if grep -rwiE --include='*.txt' --include='*.csv' --include='*.json' -- '-?(nan|inf)' "$folder"; then return 255; fi
  rm -rf "$folder"
}
export -f run
export build frames output
export extra_options="${extra[*]}"
# As many side by side as there are processors; the first fault ends it.
for sequence in "${sequences[@]}"; do
  for direction in "" --reverse; do printf '%s\0' "$sequence" coarse "$direction" "$sequence" orb "$direction"; done
done | xargs -0 -n 3 -P "$(nproc)" bash -c 'run "$@"' _
