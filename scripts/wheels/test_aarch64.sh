#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# Unit and contract tests compiled for aarch64 (without Ceres), under qemu: test_aarch64.sh [CTEST ARGUMENTS...] (default: all of
# both). Libraries are Debian 12's packages for arm64, unpacked and not installed; that and the build stay in
# DSORB_CACHE/aarch64-debian. Needs g++-12-aarch64-linux-gnu, cmake, ninja-build, ccache, pkg-config and qemu-user-static.
# DSORB_TARGETS (default: unit_tests contract_tests dso_dataset) is what is built.
set -euo pipefail
cd "$(dirname "$0")/../.."
folder=$(mkdir -p "${DSORB_CACHE:-.cache/wheels}/aarch64-debian" && readlink -f "${DSORB_CACHE:-.cache/wheels}/aarch64-debian")
root=$folder/root libraries=$folder/root/usr/lib/aarch64-linux-gnu
read -ra targets <<<"${DSORB_TARGETS:-unit_tests contract_tests dso_dataset}"

if [ ! -e "$folder/done" ]; then
  # shellcheck disable=SC2046 # one word a package
  scripts/wheels/archive.sh bookworm arm64 "$folder/apt" install --download-only libc6-dev libstdc++6 \
    $(grep -o '[a-z0-9-]*-dev' scripts/install_dependencies.sh | grep -v -e ceres -e suitesparse -e python3) >/dev/null
  mkdir -p "$root"
  for package in "$folder"/apt/archives/*.deb; do dpkg-deb -x "$package" "$root"; done
  for name in blas lapack; do ln -sfn "$name/lib$name.so.3" "$libraries/"; done # what the packages' scripts would do
  find "$root"/lib "$root"/usr/lib -type l -lname '/lib/*' -printf '%l %p\n' |
    while read -r target link; do ln -sfnr "$root$target" "$link"; done
  touch "$folder/done"
fi

cat >"$folder/toolchain.cmake" <<END
set(CMAKE_SYSTEM_NAME Linux)
set(CMAKE_SYSTEM_PROCESSOR aarch64)
set(CMAKE_C_COMPILER aarch64-linux-gnu-gcc-12)
set(CMAKE_CXX_COMPILER aarch64-linux-gnu-g++-12)
set(CMAKE_SYSROOT $root)
set(CMAKE_LIBRARY_ARCHITECTURE aarch64-linux-gnu)
set(CMAKE_FIND_ROOT_PATH_MODE_PROGRAM NEVER)
set(CMAKE_FIND_ROOT_PATH_MODE_LIBRARY ONLY)
set(CMAKE_FIND_ROOT_PATH_MODE_INCLUDE ONLY)
set(CMAKE_FIND_ROOT_PATH_MODE_PACKAGE ONLY)
set(CMAKE_CROSSCOMPILING_EMULATOR $(command -v qemu-aarch64-static) -L $root)
set(ENV{PKG_CONFIG_LIBDIR} $libraries/pkgconfig:$root/usr/share/pkgconfig)
set(ENV{PKG_CONFIG_SYSROOT_DIR} $root)
END
cmake -S . -B "$folder/build" -G Ninja --toolchain "$folder/toolchain.cmake" -DCMAKE_BUILD_TYPE=Release -DCMAKE_UNITY_BUILD=ON \
  -DCMAKE_CXX_COMPILER_LAUNCHER=ccache -DDSORB_WITH_CERES=OFF -DDSORB_INSTALL=OFF >/dev/null
cmake --build "$folder/build" --parallel "${DSORB_JOBS:-$(nproc)}" --target "${targets[@]}"
[ $# -gt 0 ] || set -- -L 'unit|contract'
ctest --test-dir "$folder/build" --parallel "$(nproc)" --output-on-failure "$@"
