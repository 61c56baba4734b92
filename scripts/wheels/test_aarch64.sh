#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# Unit and contract tests compiled for aarch64, under qemu: test_aarch64.sh [GTEST_FILTER]. Uses what build.sh aarch64 has
# made, builds GoogleTest from Debian's source and needs qemu-user-static. DSORB_TARGETS (default: unit_tests contract_tests).
set -euo pipefail
cd "$(dirname "$0")/../.."
cache=$(readlink -f "${DSORB_CACHE:-.cache/wheels}") folder=$cache/aarch64
filter=${1:-*}
read -ra targets <<<"${DSORB_TARGETS:-unit_tests contract_tests}"
scripts/wheels/third_party.sh aarch64 "$folder" googletest
cmake -S . -B "$folder/tests" -G Ninja --toolchain "$folder/toolchain.cmake" -DCMAKE_BUILD_TYPE=Release -DCMAKE_UNITY_BUILD=ON \
  -DCMAKE_CXX_COMPILER_LAUNCHER="$(command -v ccache)" -DBUILD_SHARED_LIBS=OFF -DDSORB_WITH_CERES=OFF -DDSORB_BUILD_TESTS=ON -DDSORB_INSTALL=OFF >/dev/null
cmake --build "$folder/tests" --parallel "${DSORB_JOBS:-$(nproc)}" --target "${targets[@]}"
root=$folder/sysroot
find -L "$folder/tests" -maxdepth 3 -type f -name '*_test*' -perm -u+x | while read -r program; do
  qemu-aarch64-static -L "$root" -E LD_LIBRARY_PATH="$folder/prefix/lib:$root/usr/lib/aarch64-linux-gnu:$root/lib/aarch64-linux-gnu" "$program" --gtest_filter="$filter" --gtest_brief=1
done
