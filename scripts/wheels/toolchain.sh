#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# A compiler for the libc of Debian 11 (glibc 2.31), which every Linux since 2020 has: toolchain.sh ARCH FOLDER, ARCH being
# x86_64 or aarch64. FOLDER/bin/cc and c++ are Debian 12's GCC with headers and libraries of Debian 11 and a static
# libstdc++, FOLDER/toolchain.cmake tells CMake; FOLDER/python3.N are headers of Python. Packages are unpacked, not installed.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd) arch=$1 folder=$(mkdir -p "$2" && readlink -f "$2")
case $arch in
  x86_64) debian=amd64 ;;
  aarch64) debian=arm64 ;;
  *) echo "toolchain.sh: $arch: expected x86_64 or aarch64" >&2; exit 2 ;;
esac
triplet=$arch-linux-gnu
gcc=$(command -v "$triplet-gcc-12") || { echo "toolchain.sh: $triplet-gcc-12 is missing: apt-get install g++-12-${triplet//_/-}" >&2; exit 1; }
inside=$(dirname "$("$gcc" -print-libgcc-file-name)")
# unpack SUITE FOLDER PACKAGE...
unpack() {
  local suite=$1 target=$2 archives=$folder/apt/$1/archives package
  shift 2
  mkdir -p "$archives" "$target"
  (cd "$archives" && "$here/archive.sh" "$suite" "$debian" .. download "$@")
  for package in "$@"; do dpkg -x "$archives/${package}"_*.deb "$target"; done
}
for version in 3.9:bullseye 3.10:jammy 3.11:bookworm 3.13:trixie; do
  python=python${version%:*} own=$triplet
  [ ! -e "$folder/$python/pyconfig.h" ] || continue
  if [ "$version" = 3.10:jammy ]; then # in no release of Debian; of Ubuntu's package the headers serve both machines
    own=x86_64-linux-gnu
    /usr/lib/apt/apt-helper -o APT::Sandbox::User=root download-file http://archive.ubuntu.com/ubuntu/pool/main/p/python3.10/libpython3.10-dev_3.10.4-3_amd64.deb \
      "$folder/apt/libpython3.10-dev.deb" SHA256:89246f12cdfb1fac7675bc94d5cc8b9c72320f152e855197668305c73c8588ec >/dev/null
    dpkg -x "$folder/apt/libpython3.10-dev.deb" "$folder/unpacked"
  else
    unpack "${version#*:}" "$folder/unpacked" "lib$python-dev"
  fi
  mkdir -p "$folder/$python"
  cp -r "$folder/unpacked/usr/include/$python/." "$folder/$python/"
  cp "$folder/unpacked/usr/include/$own/$python/pyconfig.h" "$folder/$python/pyconfig.h"
done
[ ! -e "$folder/toolchain.cmake" ] || exit 0
unpack bullseye "$folder/sysroot" libc6 libc6-dev linux-libc-dev libcrypt1 libcrypt-dev libgcc-s1
find "$folder/sysroot" -type l -lname '/*' -printf '%l %p\n' | while read -r target link; do ln -sfn "$folder/sysroot$target" "$link"; done

# What the static libstdc++ asks of newer libcs: whether there are threads ("perhaps" is right), random bytes.
mkdir -p "$folder/bin"
cat >"$folder/newer_libc.c" <<'END'
#include <sys/random.h>
__attribute__((visibility("hidden"))) char __libc_single_threaded = 0;
__attribute__((visibility("hidden"))) unsigned arc4random(void) {
  unsigned bits = 0;
  while (getrandom(&bits, sizeof bits, 0) != sizeof bits) {}
  return bits;
}
END
root=$folder/sysroot
for language in c c++; do
  headers="-isystem $inside/include -isystem $root/usr/include/$triplet -isystem $root/usr/include"
  libraries="-B $root/usr/lib/$triplet -L $root/usr/lib/$triplet -L $root/lib/$triplet"
  if [ $language = c++ ]; then
    standard=/usr/include/c++/12
    [ "$debian" = "$(dpkg --print-architecture)" ] || standard=/usr/$triplet/include/c++/12
    own=$standard/$triplet
    [ -d "$own" ] || own=/usr/include/$triplet/c++/12
    headers="-isystem $standard -isystem $own -isystem $standard/backward $headers"
    libraries="$libraries -static-libstdc++"
  fi
  program=$triplet-g++-12
  [ $language = c++ ] || program=$triplet-gcc-12
  cat >"$folder/bin/${program%-12}" <<END
#!/bin/sh
# What is linked gets newer_libc.o, and the threads that libstdc++ counts on (of newer libcs they are a part).
link="$folder/newer_libc.o -Wl,--push-state,--no-as-needed -lpthread -Wl,--pop-state"
for word; do case \$word in -c|-S|-E|-M|-MM|-fsyntax-only|--version|-v|-dump*|-print*|-r) link= ;; esac; done
exec $program --sysroot=$root -nostdinc $headers $libraries "\$@" \$link
END
  chmod +x "$folder/bin/${program%-12}"
done
"$folder/bin/$triplet-gcc" -O2 -fPIC -c "$folder/newer_libc.c" -o "$folder/newer_libc.o"
cat >"$folder/toolchain.cmake" <<END
set(CMAKE_SYSTEM_NAME Linux)
set(CMAKE_SYSTEM_PROCESSOR $arch)
set(CMAKE_C_COMPILER $folder/bin/$triplet-gcc)
set(CMAKE_CXX_COMPILER $folder/bin/$triplet-g++)
set(CMAKE_LIBRARY_ARCHITECTURE $triplet)
set(CMAKE_FIND_ROOT_PATH $folder/prefix $folder/sysroot)
set(CMAKE_FIND_ROOT_PATH_MODE_PROGRAM NEVER)
set(CMAKE_FIND_ROOT_PATH_MODE_LIBRARY ONLY)
set(CMAKE_FIND_ROOT_PATH_MODE_INCLUDE ONLY)
set(CMAKE_FIND_ROOT_PATH_MODE_PACKAGE ONLY)
set(CMAKE_PREFIX_PATH $folder/prefix)
set(ENV{PKG_CONFIG_LIBDIR} $folder/prefix/lib/pkgconfig)
set(ENV{PKG_CONFIG_PATH} "")
END
