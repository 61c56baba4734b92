#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# Feeds each parser of users' files with damaged inputs; stops at the first fault: fuzz.sh RUNS [PARSER...]
# The same runs give the same inputs, so that a change is judged by what it changes; DSORB_FUZZ_SEED draws others.
# Parsers are the folders of test/fuzz/corpus. An input that breaks one is left in the working directory; mend the parser
# and keep the input in the corpus, which the unit tests replay. Build: DSORB_BUILD_FUZZERS with Clang (see .ci/run).
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
runs=$1
shift
corpus=$here/../test/fuzz/corpus
parsers=("$@")
[ ${#parsers[@]} -gt 0 ] || mapfile -t parsers < <(ls "$corpus")
found=$(mktemp -d) # new inputs of interest
trap 'rm -rf "$found"' EXIT
for parser in "${parsers[@]}"; do
  mkdir "$found/$parser"
  DSORB_FUZZ=$parser "${DSORB_BUILD_DIR:-$here/../build-clang}/test/parser_fuzzer" -seed="${DSORB_FUZZ_SEED:-1}" -runs="$runs" -timeout=20 \
    -max_len=4096 -rss_limit_mb=2500 -artifact_prefix="$parser-" "$found/$parser" "$corpus/$parser" \
    >"$found/log" 2>&1 || { cat "$found/log"; echo "fuzz.sh: $parser has a fault" >&2; exit 1; }
  echo "$parser: $(tail -n 1 "$found/log")"
done
