# SPDX-License-Identifier: BSD-3-Clause
# Every dependency of dsorb, in one place. README.md beside this file lists versions and licences.

# dsorb_find(NAME DEBIAN_PACKAGE ARGS...): find_package that names the Debian package when it fails.
set(dsorb_message_level ${CMAKE_MESSAGE_LOG_LEVEL})
set(CMAKE_MESSAGE_LOG_LEVEL NOTICE) # QUIET does not reach what Ceres' package looks for
macro(dsorb_find name debian_package)
  find_package(${name} ${ARGN} QUIET)
  if(NOT ${name}_FOUND)
    message(FATAL_ERROR "dsorb needs ${name}: apt-get install ${debian_package}")
  endif()
endmacro()

dsorb_find(Threads libc6-dev)
dsorb_find(Eigen3 libeigen3-dev 3.4 NO_MODULE)
dsorb_find(TBB libtbb-dev CONFIG)
dsorb_find(OpenCV libopencv-dev 4.5 COMPONENTS core imgproc imgcodecs features2d calib3d video)
dsorb_find(Ceres "libceres-dev libsuitesparse-dev" 2.1)
dsorb_find(yaml-cpp libyaml-cpp-dev 0.7)
dsorb_find(nlohmann_json nlohmann-json3-dev 3.9)
dsorb_find(fmt libfmt-dev 9)
dsorb_find(JPEG libjpeg-dev)
dsorb_find(PkgConfig pkg-config)
pkg_check_modules(libzip QUIET IMPORTED_TARGET libzip) # its CMake targets want a program of another package
if(NOT libzip_FOUND)
  message(FATAL_ERROR "dsorb needs libzip: apt-get install libzip-dev")
endif()
if(DSORB_BUILD_PROGRAMS)
  dsorb_find(CLI11 libcli11-dev 2.1)
  dsorb_find(spdlog libspdlog-dev 1.10)
endif()
if(DSORB_BUILD_TESTS)
  dsorb_find(GTest "libgtest-dev libgmock-dev" 1.12)
endif()
if(DSORB_BUILD_BENCHMARKS)
  dsorb_find(benchmark libbenchmark-dev 1.7)
endif()
set(CMAKE_MESSAGE_LOG_LEVEL ${dsorb_message_level})
