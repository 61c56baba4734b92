#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# Feeds each parser of users' files with damaged inputs; stops at the first fault: fuzz.sh RUNS|SECONDSs [PARSER...]
# for example fuzz.sh 20000, fuzz.sh 60s. Inputs come in the same order every time, so that a change is judged by what it
# changes; DSORB_FUZZ_SEED draws others.
# Parsers are the folders of test/fuzz/corpus. An input that breaks one is left in the working directory; mend the parser
# and keep the input in the corpus, which the unit tests replay. Build: DSORB_BUILD_FUZZERS with Clang (see .ci/run).
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
case $1 in
  *s) limit=-max_total_time=${1%s} ;;
  *) limit=-runs=$1 ;;
esac
shift
corpus=$here/../test/fuzz/corpus
parsers=("$@")
[ ${#parsers[@]} -gt 0 ] || mapfile -t parsers < <(ls "$corpus")
found=$(mktemp -d) # new inputs of interest
trap 'rm -rf "$found"' EXIT

feed() { # PARSER
  mkdir "$found/$1"
  DSORB_FUZZ=$1 "${DSORB_BUILD_DIR:-$here/../build-clang}/test/parser_fuzzer" -seed="${DSORB_FUZZ_SEED:-1}" "$limit" -timeout=20 \
    -max_len=4096 -rss_limit_mb=2500 -artifact_prefix="$1-" "$found/$1" "$corpus/$1" \
    >"$found/$1.log" 2>&1 || { cat "$found/$1.log"; echo "fuzz.sh: $1 has a fault" >&2; return 255; }
  echo "$1: $(tail -n 1 "$found/$1.log")"
}
export -f feed
export here limit corpus found
# One parser a processor; the first fault ends it.
printf '%s\n' "${parsers[@]}" | xargs -P "$(nproc)" -I {} bash -c 'feed {}'
