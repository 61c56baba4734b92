#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# Whether the code stands in the way of macOS and Windows, as far as a Debian can tell: Clang with its own C++ library takes all
# of core, init, odometry and place, warnings as errors (no code is made: OpenCV's library here has GCC's strings); MinGW takes
# what is Windows' own. Needs clang-14 g++-mingw-w64-x86-64-posix.
set -euo pipefail
cd "$(dirname "$0")/.."
folder=$PWD/build-compilers/libc++ unpacked=$PWD/build-compilers/libc++-14-dev

# Only unpacked: installed it takes the place of the libunwind-dev that glog, and with it Ceres, needs.
mkdir -p "$unpacked"
(cd "$unpacked" && apt-get download -qq libc++-14-dev && dpkg -x libc++-14-dev_*.deb .)

cmake -S . -B "$folder" -G Ninja -DCMAKE_CXX_COMPILER=clang++-14 -DCMAKE_C_COMPILER=clang-14 -DCMAKE_UNITY_BUILD=ON -DCMAKE_DISABLE_PRECOMPILE_HEADERS=ON \
  "-DCMAKE_CXX_FLAGS=-nostdinc++ -isystem $unpacked/usr/lib/llvm-14/include/c++/v1" -DDSORB_WITH_CERES=OFF -DDSORB_BUILD_TESTS=OFF -DDSORB_WERROR=ON >/dev/null
ninja -C "$folder" -t commands dsorb_core dsorb_init dsorb_odometry dsorb_place | sed -n 's/ -o [^ ]* -c / -fsyntax-only /p' |
  (cd "$folder" && xargs -d '\n' -n 1 -P "$(nproc)" sh -ec)
for source in src/platform/*_windows.cpp; do
  x86_64-w64-mingw32-g++-posix -std=c++17 -Wall -Wextra -Wconversion -Wshadow -Werror -Isrc -Iinclude -fsyntax-only "$source"
done
