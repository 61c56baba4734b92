#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# Builds what the library needs to be, with every compiler of a list that is found, warnings as errors, and runs the unit
# tests of the core with it: check_compilers.sh [COMPILER...] (default: g++-11 to g++-14, clang++-14 to clang++-22, those
# that are found; apt-get install g++-11 clang-19). At last once without Ceres, no part of which may be linked, and each
# source by itself.
# For the night: minutes for each compiler.
set -euo pipefail
cd "$(dirname "$0")/.."

compilers=("$@")
if [ ${#compilers[@]} -eq 0 ]; then
  for name in g++-{11..14} clang++-{14..22}; do
    ! command -v "$name" >/dev/null || compilers+=("$name")
  done
fi
targets=(dsorb_io test_core)
for compiler in "${compilers[@]}"; do
  folder=build-compilers/$compiler
  echo "== $("$compiler" --version | head -1)"
  # std::stable_sort of GCC 12's library asks for its buffer by what newer Clangs call deprecated.
  DSORB_BUILD_DIR=$folder scripts/build.sh -DCMAKE_CXX_COMPILER="$compiler" -DDSORB_WERROR=ON \
    -DCMAKE_CXX_FLAGS=-Wno-error=deprecated-declarations -- "${targets[@]}"
  "$folder/test/test_core" --gtest_brief=1
done

echo "== Without Ceres, each source by itself"
folder=build-compilers/without-ceres
DSORB_BUILD_DIR=$folder scripts/build.sh -DDSORB_WITH_CERES=OFF -DDSORB_WERROR=ON -DCMAKE_UNITY_BUILD=OFF -- \
  unit_tests dso_dataset dso_synthesize
ctest --test-dir "$folder" --output-on-failure --parallel "$(nproc)" -L unit
if readelf -d "$folder"/lib/libdsorb_*.so "$folder/bin/dso_dataset" |
  grep -E 'NEEDED.*(ceres|cholmod|spqr|cxsparse|umfpack|opencv_video\.)'; then
  echo "a build without Ceres is linked with it" >&2
  exit 1
fi
! ldd "$folder/lib/libdsorb_init.so" | grep -E 'lib(ceres|cholmod|spqr|opencv_video|opencv_imgcodecs)\.' ||
  { echo "libdsorb_init drags in what it must not" >&2; exit 1; }
