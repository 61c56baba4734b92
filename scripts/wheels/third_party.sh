#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# What dsorb needs, from Debian 12's source packages, as static libraries with the parts that we use:
# third_party.sh ARCH FOLDER [PACKAGE...] (default: all but googletest), FOLDER being that of toolchain.sh. Installs into FOLDER/prefix; does what is not done yet.
# FFmpeg is shared (LGPL: whoever has the wheel may put another one in its place) and has no GPL part.
set -euo pipefail
all=(zlib libpng1.6 libjpeg-turbo libwebp tiff eigen3 nlohmann-json3 fmtlib spdlog cli11 yaml-cpp tinyxml2 libzip sqlite3 onetbb opencv ffmpeg)
here=$(cd "$(dirname "$0")" && pwd) arch=$1 folder=$(readlink -f "$2") sources=${DSORB_SOURCES:-$(dirname "$(readlink -f "$2")")/sources}
prefix=$folder/prefix triplet=$arch-linux-gnu jobs=${DSORB_JOBS:-$(($(nproc) + 1))}

# source_of PACKAGE: unpacks Debian's source package, its patches applied, and names the folder
source_of() {
  if [ ! -d "$sources/$1" ]; then
    (cd "$sources" && "$here/archive.sh" bookworm "$(dpkg --print-architecture)" apt source --download-only "$1" >/dev/null &&
      dpkg-source --no-check -x "$1"_*.dsc "$1.part" >/dev/null)
    mv "$sources/$1.part" "$sources/$1"
  fi
  echo "$sources/$1"
}

# cmake_package PACKAGE ARGS...: CMake, ninja, install; only where it is not installed yet
cmake_package() {
  local name=$1 source
  shift
  [ ! -e "$prefix/done/$name" ] || return 0
  echo "third_party.sh: $name"
  source=$(source_of "$name")
  cmake -S "$source" -B "$folder/build/$name" -G Ninja --toolchain "$folder/toolchain.cmake" -Wno-dev \
    -DCMAKE_BUILD_TYPE=Release -DCMAKE_INSTALL_PREFIX="$prefix" -DCMAKE_INSTALL_LIBDIR:STRING=lib -DBUILD_SHARED_LIBS=OFF \
    -DCMAKE_POSITION_INDEPENDENT_CODE=ON -DCMAKE_CXX_STANDARD=17 -DBUILD_TESTING=OFF -DBUILD_TESTS=OFF --no-warn-unused-cli \
    -DCMAKE_C_VISIBILITY_PRESET=hidden -DCMAKE_CXX_VISIBILITY_PRESET=hidden \
    -DCMAKE_C_COMPILER_LAUNCHER="$(command -v ccache)" -DCMAKE_CXX_COMPILER_LAUNCHER="$(command -v ccache)" "$@" >"$folder/build/$name.log"
  cmake --build "$folder/build/$name" --parallel "$jobs" >>"$folder/build/$name.log"
  cmake --install "$folder/build/$name" >>"$folder/build/$name.log"
  mkdir -p "$prefix/done"
  touch "$prefix/done/$name"
}

# licence PACKAGE: its own licence files, without the GPL that some bring for parts that are not compiled
licence() {
  local source file
  source=$(source_of "$1")
  rm -rf "$prefix/licences/$1"* && mkdir -p "$prefix/licences/$1"
  for file in "$source"/{LICENSE,COPYING,COPYRIGHT,README.ijg}*; do
    [ -f "$file" ] && case $(basename "$file") in *.GPL* | *.LGPLv3) ;; *) cp "$file" "$prefix/licences/$1/" ;; esac
  done
  [ -n "$(ls "$prefix/licences/$1")" ] || { echo "third_party.sh: $1 brings no licence" >&2; exit 1; }
}

zlib() { # its CMakeLists.txt names what Debian leaves out
  [ ! -e "$prefix/done/zlib" ] || return 0
  local source
  source=$(source_of zlib)
  mkdir -p "$folder/build/zlib" "$prefix/done"
  (cd "$folder/build/zlib" && CC=$folder/bin/$triplet-gcc CFLAGS='-O3 -fPIC -fvisibility=hidden' "$source/configure" --static --prefix="$prefix" &&
    make -j "$jobs" libz.a && make install) >"$folder/build/zlib.log" 2>&1
  touch "$prefix/done/zlib"
}

sqlite3() { # Debian has its many sources; tclsh makes the one file of them
  [ ! -e "$prefix/done/sqlite3" ] || return 0
  echo "third_party.sh: sqlite3"
  local source build=$folder/build/sqlite3
  source=$(source_of sqlite3)
  mkdir -p "$build" "$prefix/lib" "$prefix/include" "$prefix/done"
  (cd "$build" && "$source/configure" --disable-tcl --disable-readline && make sqlite3.c &&
    "$folder/bin/$triplet-gcc" -O2 -fPIC -fvisibility=hidden -DSQLITE_OMIT_LOAD_EXTENSION -c sqlite3.c -o sqlite3.o &&
    ar rcs "$prefix/lib/libsqlite3.a" sqlite3.o && cp sqlite3.h "$prefix/include/") >"$build.log" 2>&1
  touch "$prefix/done/sqlite3"
}

ffmpeg() {
  [ ! -e "$prefix/done/ffmpeg" ] || return 0
  echo "third_party.sh: ffmpeg"
  local source video containers assembler=()
  source=$(source_of ffmpeg)
  video=h264,hevc,vp8,vp9,mpeg1video,mpeg2video,mpeg4,msmpeg4v1,msmpeg4v2,msmpeg4v3,h263,h263p,mjpeg,prores,dnxhd,dvvideo,vc1,wmv1,wmv2,wmv3,flv
  video=$video,svq1,svq3,theora,ffv1,huffyuv,ffvhuff,utvideo,cinepak,png,rawvideo,gif
  containers=mov,matroska,avi,mpegts,mpegps,mpegvideo,flv,asf,ogg,dv,h264,hevc,m4v,mjpeg,ivf,rtsp,rtp,sdp,wav,mp3,aac,image2,gif,yuv4mpegpipe,rawvideo
  [ "$arch" = x86_64 ] || assembler=(--disable-x86asm)
  mkdir -p "$folder/build/ffmpeg"
  cd "$folder/build/ffmpeg"
  "$source/configure" --prefix="$prefix" --enable-cross-compile --arch="$arch" --target-os=linux --cc="$folder/bin/$triplet-gcc" \
    --ld="$folder/bin/$triplet-gcc" --cross-prefix="$triplet-" --pkg-config=pkg-config --enable-shared --disable-static --disable-everything \
    --disable-programs --disable-doc --disable-autodetect --disable-debug --disable-avdevice --disable-avfilter --disable-swresample \
    --disable-postproc --enable-zlib --extra-cflags="-I$prefix/include" --extra-ldflags="-L$prefix/lib" "${assembler[@]}" \
    --enable-decoder=$video --enable-demuxer=$containers --enable-protocol=file,pipe,tcp,udp,rtp,http \
    --enable-parser=h264,hevc,vp8,vp9,mpegvideo,mpeg4video,h263,mjpeg,dnxhd,vc1,png,gif --enable-bsf=h264_mp4toannexb,hevc_mp4toannexb,vp9_superframe_split,extract_extradata \
    >"$folder/build/ffmpeg.log" || { tail -3 "$folder/build/ffmpeg.log" >&2; exit 1; }
  make -j "$jobs" >>"$folder/build/ffmpeg.log" 2>&1
  make install >>"$folder/build/ffmpeg.log" 2>&1
  cd - >/dev/null
  grep -q 'define FFMPEG_LICENSE "LGPL version 2.1 or later"' "$folder/build/ffmpeg/config.h"
  touch "$prefix/done/ffmpeg"
}

package() {
  case $1 in
    zlib) zlib ;;
    libpng1.6) cmake_package "$1" -DPNG_SHARED=OFF -DPNG_TESTS=OFF ;;
    libjpeg-turbo) cmake_package "$1" -DENABLE_SHARED=OFF -DWITH_TURBOJPEG=OFF ;;
    libwebp)
      cmake_package "$1" -DWEBP_BUILD_ANIM_UTILS=OFF -DWEBP_BUILD_CWEBP=OFF -DWEBP_BUILD_DWEBP=OFF -DWEBP_BUILD_GIF2WEBP=OFF \
      -DWEBP_BUILD_IMG2WEBP=OFF -DWEBP_BUILD_VWEBP=OFF -DWEBP_BUILD_WEBPINFO=OFF -DWEBP_BUILD_WEBPMUX=OFF -DWEBP_BUILD_EXTRAS=OFF
      ;;
    tiff)
      cmake_package "$1" -Djpeg=OFF -Dlzma=OFF -Dzstd=OFF -Dwebp=OFF -Djbig=OFF -Dlerc=OFF -Dlibdeflate=OFF -Dtiff-tools=OFF -Dtiff-tests=OFF \
      -Dtiff-contrib=OFF -Dtiff-docs=OFF -Dtiff-deprecated=OFF -Dcxx=OFF
      ;;
    eigen3) cmake_package "$1" -DEIGEN_BUILD_DOC=OFF -DEIGEN_BUILD_PKGCONFIG=OFF ;;
    nlohmann-json3) cmake_package "$1" -DJSON_BuildTests=OFF ;;
    fmtlib) cmake_package "$1" -DFMT_TEST=OFF -DFMT_DOC=OFF ;;
    spdlog) cmake_package "$1" -DSPDLOG_FMT_EXTERNAL=ON -DSPDLOG_BUILD_EXAMPLE=OFF ;;
    cli11) cmake_package "$1" -DCLI11_BUILD_TESTS=OFF -DCLI11_BUILD_EXAMPLES=OFF -DCLI11_BUILD_DOCS=OFF ;;
    yaml-cpp) cmake_package "$1" -DYAML_CPP_BUILD_TESTS=OFF -DYAML_CPP_BUILD_TOOLS=OFF -DYAML_CPP_BUILD_CONTRIB=OFF ;;
    tinyxml2) cmake_package "$1" ;;
    libzip)
      cmake_package "$1" -DHAVE_ARC4RANDOM=OFF -DENABLE_COMMONCRYPTO=OFF -DENABLE_GNUTLS=OFF -DENABLE_MBEDTLS=OFF -DENABLE_OPENSSL=OFF -DENABLE_BZIP2=OFF \
      -DENABLE_LZMA=OFF -DENABLE_ZSTD=OFF -DBUILD_TOOLS=OFF -DBUILD_REGRESS=OFF -DBUILD_EXAMPLES=OFF -DBUILD_DOC=OFF
      ;;
    sqlite3) sqlite3 ;;
    onetbb) cmake_package "$1" -DTBB_TEST=OFF -DTBB_STRICT=OFF -DTBBMALLOC_BUILD=OFF -DTBB_DISABLE_HWLOC_AUTOMATIC_SEARCH=ON ;;
    opencv)
      cmake_package "$1" -DBUILD_LIST=core,imgproc,flann,features2d,calib3d,imgcodecs,videoio -DCPU_DISPATCH= \
      -DCMAKE_CXX_FLAGS_RELEASE='-O2 -DNDEBUG' -DBUILD_PERF_TESTS=OFF -DBUILD_EXAMPLES=OFF -DBUILD_opencv_apps=OFF -DBUILD_JAVA=OFF -DBUILD_opencv_python3=OFF -DOPENCV_GENERATE_PKGCONFIG=OFF \
      -DBUILD_ZLIB=OFF -DBUILD_JPEG=OFF -DBUILD_PNG=OFF -DBUILD_TIFF=OFF -DBUILD_WEBP=OFF -DBUILD_ITT=OFF \
      -DWITH_{1394,ADE,CAROTENE,FFMPEG,GSTREAMER,GTK,IPP,ITT,JASPER,LAPACK,OPENCL,OPENEXR,OPENJPEG,PROTOBUF,QUIRC,TBB,VA,VA_INTEL,VTK,GDAL,GDCM,GPHOTO2}=OFF \
      -DWITH_{EIGEN,JPEG,PNG,TIFF,WEBP,V4L,PTHREADS_PF}=ON -DOPENCV_ENABLE_NONFREE=OFF -DCV_TRACE=OFF -DENABLE_PRECOMPILED_HEADERS=OFF
      ;;
    ffmpeg) ffmpeg ;;
    googletest) cmake_package "$1" ;;
    *)
      echo "third_party.sh: $1: expected some of ${all[*]} googletest" >&2
      exit 2
      ;;
  esac
}

mkdir -p "$folder/build" "$sources"
shift 2
[ $# -gt 0 ] || set -- "${all[@]}"
for name; do
  package "$name"
  licence "$name"
done
